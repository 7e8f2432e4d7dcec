"""Run a command ``lsvision calibrate`` on a folder, for the scripts of the three steps."""

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
    """Run a step on the folder of the command line, or else on the shipped example.

    Parameters
    ----------
    about : str
        The script's own docstring, for ``--help``.
    command : callable
        Returns the arguments of ``lsvision calibrate`` for a folder and that of its results.
    example_options : tuple of str
        Further options for the shipped example.
    """
    from lsvision.cli import main

    parser = argparse.ArgumentParser(
        description=about, usage="%(prog)s [FOLDER] [--results DIR] [options]", allow_abbrev=False
    )
    parser.add_argument("--results", type=Path)
    arguments, options = parser.parse_known_args()
    # Only the first word is a folder: others may be values of options that this parser lacks.
    has_folder = len(sys.argv) > 1 and not sys.argv[1].startswith("-")
    folder = Path(options.pop(0)) if has_folder else EXAMPLE
    if not has_folder:
        options = [*example_options, *options]
    results = arguments.results or folder / "results"
    if folder.is_dir():  # a folder with a wrong name is not made
        results.mkdir(parents=True, exist_ok=True)
    sys.argv = ["lsvision", "calibrate", *command(folder, results), *options]
    main()
