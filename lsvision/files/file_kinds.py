"""Kind of a file, without an exception for invalid names."""

import os
import re
import stat
from pathlib import Path

STDIN, STDOUT = "-", Path("-")
"""Name of standard input, and path of standard output."""


def read_file_status(path: str | os.PathLike[str]) -> os.stat_result | None:
    """Return the status of a file, following links.

    None if there is no such file, its name is not possible, its links go in a loop, or its folder
    may not be searched.
    """
    try:
        return Path(path).stat()
    except (OSError, ValueError):  # ValueError: a null in the name
        return None


def exists(path: str | os.PathLike[str]) -> bool:
    """Return whether anything of that name exists."""
    return read_file_status(path) is not None


def is_directory(path: str | os.PathLike[str]) -> bool:
    """Return whether the path names a directory."""
    status = read_file_status(path)
    return status is not None and stat.S_ISDIR(status.st_mode)


def is_regular(path: str | os.PathLike[str]) -> bool:
    """Return whether the path names a file on a disk: no directory, device, pipe or socket."""
    status = read_file_status(path)
    return status is not None and stat.S_ISREG(status.st_mode)


def build_natural_sort_key(path: Path) -> list[tuple[bool, int, str]]:
    """Return a sorting key for paths: numbers by their value, other text by its letters.

    Examples
    --------
    >>> [path.name for path in sorted(map(Path, ["p10.csv", "p2.csv"]), key=build_natural_sort_key)]
    ['p2.csv', 'p10.csv']
    """
    parts = re.split(r"([0-9]+)", str(path))  # text and digits in turn
    return [
        (index % 2 == 1, int(part) if index % 2 == 1 else 0, part)
        for index, part in enumerate(parts)
        if part
    ]
