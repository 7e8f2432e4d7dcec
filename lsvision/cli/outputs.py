"""Output files of a command: checks before the work, and a name for each picture."""

import os
import stat
from collections.abc import Hashable, Sequence
from pathlib import Path

import typer

from lsvision.cli.sources import resolve_path
from lsvision.errors import UnwritableFile
from lsvision.files.file_kinds import STDOUT, exists, is_directory, is_regular, read_file_status
from lsvision.files.printable import escape_text

PICTURE_SUFFIXES = (".png", ".svg")
"""Suffixes of the formats of a picture."""
MAX_STEM_BYTES = 100
"""Largest part of a file's name that goes into the name of its picture."""


def check_outputs(
    outputs: Sequence[Path | None],
    sources: Sequence[Path],
    streams: Sequence[Path | None] = (),
) -> "CommandFiles":
    """Raise an error if an output could not be written after the work.

    Parameters
    ----------
    outputs : sequence of Path or None
        Output files, of which none may be ``-``; None for a file that is not written.
    sources : sequence of Path
        All inputs, which no output may overwrite.
    streams : sequence of Path or None
        Further output files, of which one may be ``-``, standard output.

    Raises
    ------
    UnwritableFile
        If a folder is missing or not writable, or the file is a folder.
    typer.BadParameter
        If two outputs, or an output and an input, are the same file, two inputs are ``-``, or an
        output is ``-`` that cannot be.
    """
    command_files = CommandFiles()
    for source in sources:
        if source == STDOUT and source in command_files:
            raise typer.BadParameter("expected one input from standard input (-), got two")
        command_files.add(source, "an input")
    if STDOUT in outputs:
        raise typer.BadParameter("expected the name of a file, got - for standard output")
    if streams.count(STDOUT) > 1:
        raise typer.BadParameter("expected one output to standard output (-), got two")
    for output in [*outputs, *(stream for stream in streams if stream != STDOUT)]:
        if output is None or _is_device(output):
            continue
        if output in command_files:
            raise typer.BadParameter(
                f"expected different files, got {escape_text(str(output))}: it is also "
                f"{command_files.find_role(output)}"
            )
        command_files.add(output, "an output")
        problem = _find_write_problem(Path(resolve_path(output)))
        if problem:
            raise UnwritableFile(f"{output}: {problem}")
    return command_files


class CommandFiles:
    """Files that a command reads or writes; a file is recognised by any of its names."""

    def __init__(self) -> None:
        self._roles: dict[Hashable, str] = {}

    def __contains__(self, path: Path) -> bool:
        return any(key in self._roles for key in _find_identities(path))

    def find_role(self, path: Path) -> str:
        """Return the role of a file that was added, under this name or another one."""
        return next(self._roles[key] for key in _find_identities(path) if key in self._roles)

    def add(self, path: Path, role: str) -> None:
        """Add a file with its role, such as "an input"."""
        self._roles.update(dict.fromkeys(_find_identities(path), role))


def write_output(path: Path, content: str) -> None:
    """Write a text to a file atomically, or to standard output if it is ``-``.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    if path == STDOUT:
        typer.echo(content, nl=False)
        return
    from lsvision.files.atomic_files import write_atomic

    write_atomic(path, content)


def check_picture(plot: Path | None) -> None:
    """Raise an error if the suffix of a picture is neither .png nor .svg."""
    if plot is not None and plot.suffix.lower() not in PICTURE_SUFFIXES:
        raise typer.BadParameter(f"expected --plot F.png or F.svg, got {plot.name!r}")


class Pictures:
    """Names of the pictures of a command: unique, and different from its other files.

    With several pictures each name begins with the stem of `plot`; `several` is whether there is
    more than one input file. `command_files` are inputs and outputs of the command, including
    `plot`.
    """

    def __init__(
        self, plot: Path, *, several: bool, command_files: CommandFiles | None = None
    ) -> None:
        self._plot, self._several = plot, several
        self._files = CommandFiles() if command_files is None else command_files

    def assign_path(self, source: Path, number: int | None) -> Path:
        """Return a new path for a profile's picture, such as ``out.png`` or ``out-SOURCE-3.png``.

        The name of the file `source` is part of it if there are several files, and the index of the
        profile if the file has several profiles (else None).
        """
        tags = [_shorten(source.stem)] if self._several else []
        if number is not None:
            tags.append(str(number))
        if not tags:
            return self._plot
        stem = "-".join([self._plot.stem, *tags])
        path, counter = self._plot.with_name(stem + self._plot.suffix), 2
        while path in self._files:  # two folders may hold files of the same name
            path = self._plot.with_name(f"{stem}-{counter}{self._plot.suffix}")
            counter += 1
        self._files.add(path, "a picture")
        return path


def _shorten(stem: str) -> str:
    """Return the stem of a file's name as printable text, short enough for a picture's name."""
    return escape_text(stem).encode()[:MAX_STEM_BYTES].decode("utf-8", "ignore")


def _find_identities(path: Path) -> list[Hashable]:
    """Return keys that are equal for two names of one file: real path, device and inode."""
    keys: list[Hashable] = [resolve_path(path)]
    status = read_file_status(path)
    if status is not None and status.st_ino:  # 0 on file systems without inodes
        keys.append((status.st_dev, status.st_ino))
    return keys


def _find_write_problem(path: Path) -> str | None:
    """Return why a file cannot be written, and the remedy; None if nothing is known against it."""
    if is_directory(path):
        return "a directory: name a file in it"
    if not is_directory(path.parent):
        return "its folder does not exist: create it first, or name another"
    try:
        is_link = stat.S_ISLNK(path.lstat().st_mode)  # the true path is a link only in a loop
    except FileNotFoundError:
        is_link = False
    except (OSError, ValueError) as error:  # too long, or with a null character
        return f"{getattr(error, 'strerror', error)}: name another file"
    if is_link:
        return "a loop of symbolic links: name another file"
    if not os.access(path.parent, os.W_OK | os.X_OK):
        return "no permission to write there: name another folder"
    return None


def _is_device(output: Path) -> bool:
    """Return whether a path is a terminal, a pipe or another device, such as ``/dev/stdout``."""
    return exists(output) and not is_regular(output) and not is_directory(output)
