"""What the three steps share: a command of ``lsvision`` on a folder, its results beside it."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLE = HERE / "example"
sys.path.insert(0, str(HERE.parent))  # a checkout that is not installed runs too


def run_step(
    about: str | None,
    command: Callable[[Path, Path], list[str]],
    example_options: tuple[str, ...] = (),
) -> None:
    """Run a step on the folder that is named, or else on the shipped example.

    Parameters
    ----------
    about : str
        The script's own docstring, for ``--help``.
    command : callable
        Words behind ``lsvision calibrate``, given the folder and that of the results.
    example_options : tuple of str
        Options that the shipped example needs beside them.
    """
    from lsvision.cli import main

    words = argparse.ArgumentParser(description=about)
    words.add_argument("folder", nargs="?", type=Path)
    words.add_argument("--results", type=Path)
    given, options = words.parse_known_args()
    if given.folder is None:
        options = [*example_options, *options]
    folder = given.folder or EXAMPLE
    results = given.results or folder / "results"
    if folder.is_dir():
        results.mkdir(exist_ok=True)
    sys.argv = ["lsvision", "calibrate", *command(folder, results), *options]
    main()
