"""Output files of a command: checked before the work, named one for each profile."""

import os
from collections.abc import Sequence
from pathlib import Path

import typer

from lsvision.errors import UnwritableFile

PICTURE_SUFFIXES = (".png", ".svg")


def check_outputs(outputs: Sequence[Path | None], sources: Sequence[Path]) -> None:
    """Refuse outputs that could not be written once the work is done.

    Parameters
    ----------
    outputs : sequence of Path or None
        None where the user wants no such file.
    sources : sequence of Path
        The inputs, which no output may overwrite.

    Raises
    ------
    UnwritableFile
        If a folder is missing or refuses, or the file is a folder or not ours to change.
    typer.BadParameter
        If two outputs, or an output and an input, are the same file.
    """
    taken = {source.resolve(): "an input" for source in sources}
    for output in outputs:
        if output is None or _is_device(output):
            continue
        place = output.resolve()
        if place in taken:
            raise typer.BadParameter(f"want another file than {output}: it is {taken[place]} too")
        taken[place] = "an output"
        trouble = _write_problem(place)
        if trouble:
            raise UnwritableFile(f"{output}: {trouble}")


def check_picture(plot: Path | None) -> None:
    """Refuse a picture of another format.

    Raises
    ------
    typer.BadParameter
        If the suffix is neither .png nor .svg.
    """
    if plot is not None and plot.suffix.lower() not in PICTURE_SUFFIXES:
        raise typer.BadParameter(f"want --plot F.png or F.svg, got {plot.name!r}")


class Pictures:
    """Names of the pictures of one command, none given twice.

    Parameters
    ----------
    plot : Path
        As the user names it; of one profile in one file the picture has just this name.
    several : bool
        Whether there is more than one file.
    """

    def __init__(self, plot: Path, *, several: bool) -> None:
        self._plot, self._several = plot, several
        self._taken: set[Path] = set()

    def path_of(self, source: Path, number: int, parts: int) -> Path:
        """Where a profile's picture goes: ``out.png``, or ``out-SOURCE-NUMBER.png``.

        Parameters
        ----------
        source : Path
            File of the profile; named if there are several.
        number, parts : int
            Its place in the file, named if the file holds more than one, and how many it holds.
        """
        tags = [source.stem] * self._several + [str(number)] * (parts > 1)
        stem = "-".join([self._plot.stem, *tags])
        path, again = self._plot.with_name(stem + self._plot.suffix), 2
        while path in self._taken:  # two folders may hold files of the same name
            path = self._plot.with_name(f"{stem}-{again}{self._plot.suffix}")
            again += 1
        self._taken.add(path)
        return path


def _write_problem(place: Path) -> str | None:
    if place.is_dir():
        return "a directory: name a file in it"
    if not place.parent.is_dir():
        return "its folder does not exist: make it first, or name another"
    if not os.access(place.parent, os.W_OK | os.X_OK):
        return "no permission to write there: name another folder"
    return None


def _is_device(output: Path) -> bool:
    """A terminal or pipe, as ``/dev/stdout``: written to directly."""
    return output.exists() and not output.is_file() and not output.is_dir()
