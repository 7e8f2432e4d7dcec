"""``lsvision demo``: measure and draw a profile that comes with the package."""

from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.messages import FAILED
from lsvision.errors import UnwritableFile

DEFAULT_FOLDER = Path("lsvision-demo")
"""Folder of profile and picture, made in the current folder."""
NEXT_COMMANDS = (
    ("{profile} -v", "why the other arcs were rejected"),
    ("{profile} --radius 20:30 --range-std 0.05", "with search range and sensor noise"),
    ("{profile} --json results.json --csv results.csv", "results for other programs"),
    ("YOUR_PROFILE.csv --plot yours.png", "your own data: x and height in mm, one point per line"),
)
"""Arguments of ``lsvision measure`` for the printed commands, and the purpose of each."""


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of profile and picture.")
    ] = DEFAULT_FOLDER,
    show: Annotated[bool, typer.Option("--open", help="Open the picture, too.")] = False,
) -> None:
    """Measure a profile that comes with lsvision, draw it, and print further commands.

    The profile shows two welded tubes of 23.7 and 25.3 mm among bars and bent sheets, with noise of
    0.05 mm. Needs no file and no network; writes DIR/profile.csv and DIR/profile.png.

    \b
    Into the folder lsvision-demo:
      lsvision demo
    Into a folder of yours, and open the picture:
      lsvision demo --out /tmp/first-look --open
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.cli.file_chunk import FileOptions
    from lsvision.cli.measure_files import RunOptions, measure_sources
    from lsvision.cli.measure_options import build_measure_function
    from lsvision.cli.outputs import Pictures

    profile, picture = _write_profile(out), out / "profile.png"
    typer.echo(f"$ lsvision measure {_quote_for_shell(profile)} --plot {_quote_for_shell(picture)}")
    pictures = Pictures(picture, several=False)
    options = FileOptions(measure_function=build_measure_function())
    failed = measure_sources([profile], RunOptions(options=options, pictures=pictures))
    if failed:
        raise typer.Exit(FAILED)
    typer.echo("\n".join(_format_next_lines(profile, picture)))
    if show:
        typer.launch(str(picture))


def _write_profile(folder: Path) -> Path:
    """Write the shipped profile into a folder, made if missing; return its path.

    Raises
    ------
    UnwritableFile
        If the folder cannot be made, or holds another file of that name.
    """
    from importlib import resources

    from lsvision.files.atomic_files import write_atomic

    content = (resources.files("lsvision.cli") / "demo_data" / "profile.csv").read_bytes()
    profile = folder / "profile.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        differs = profile.exists() and (not profile.is_file() or profile.read_bytes() != content)
    except OSError as error:
        raise UnwritableFile(
            f"{folder}: cannot be made or read ({error.strerror}): name another with --out"
        ) from None
    if differs:
        raise UnwritableFile(
            f"{profile}: exists with other content: name another folder with --out"
        )
    write_atomic(profile, content)
    return profile


def _format_next_lines(profile: Path, picture: Path) -> list[str]:
    """Return the printed text: where the picture is, and commands to try next."""
    commands = [
        (f"lsvision measure {arguments.format(profile=_quote_for_shell(profile))}", purpose)
        for arguments, purpose in NEXT_COMMANDS
    ]
    commands.append(("lsvision --help", "scans, camera images, calibration, robots"))
    return [
        "",
        f"The picture shows points, ellipses and rejected arcs: {picture}",
        "",
        "Next:",
        *(line for command, purpose in commands for line in (f"  # {purpose}", f"  {command}")),
    ]


def _quote_for_shell(path: Path) -> str:
    """Return a path as it is typed in a shell."""
    import shlex

    return shlex.quote(str(path))
