"""Which files a command line names, and what one of them holds."""

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.messages import print_lines
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import exists, is_directory, is_regular, natural_order
from lsvision.files.limited_reading import STDIN

if TYPE_CHECKING:
    from lsvision.io.profiles import ProfileFile, ReadOptions

PROFILE_SUFFIXES = frozenset(
    [
        *(".csv", ".tsv", ".txt", ".asc", ".xyz", ".xz", ".dat", ".yml", ".yaml", ".xml"),
        *(".npy", ".npz", ".ply", ".pcd", ".parquet"),
    ]
)
"""Files that count as profiles when a folder is named; any file can be named by itself."""


IMAGE_SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp"))
"""Files that count as images when a folder is named."""

VIDEO_SUFFIXES = frozenset((".avi", ".mp4", ".mkv", ".mov", ".m4v", ".webm"))
"""Files that are read frame by frame."""

MEASURED_SUFFIXES = PROFILE_SUFFIXES | IMAGE_SUFFIXES | VIDEO_SUFFIXES
"""What counts in a folder where a rig turns images into profiles."""


HEIGHT_MAP_SUFFIXES = frozenset((".tif", ".tiff", ".png"))
"""Files that count as profiles beside `PROFILE_SUFFIXES` where the spacing of columns is given."""


def suffixes_of_profiles(dx: float | None) -> frozenset[str]:
    """What counts as a profile in a folder, with ``--dx`` or without."""
    return PROFILE_SUFFIXES if dx is None else PROFILE_SUFFIXES | HEIGHT_MAP_SUFFIXES


def find_sources(
    words: Sequence[str], suffixes: frozenset[str] = PROFILE_SUFFIXES
) -> tuple[list[Path], list[LsvisionError]]:
    """Files that the words of a command line name.

    Parameters
    ----------
    words : sequence of str
        Files, folders (the profile files right in them), patterns (``**`` reaches into folders)
        and ``-`` for standard input, in the order of the command line.
    suffixes : frozenset of str
        What counts when a folder is named: `PROFILE_SUFFIXES`, `IMAGE_SUFFIXES` or
        `MEASURED_SUFFIXES`.

    Returns
    -------
    sources : list of Path
        Each file once; within a folder or pattern in natural order, 2 before 10.
    failures : list of LsvisionError
        One for each word that names nothing.
    """
    found: dict[str, Path] = {}
    failures: list[LsvisionError] = []
    for word in words:
        try:
            files = _files_of(word, suffixes)
            if not files:
                failures.append(_nothing_in(word, suffixes))
        except OSError as error:  # a folder that may not be listed
            failures.append(UnreadableFile(f"{word}: cannot be listed ({error.strerror})"))
            continue
        for file in files:
            found.setdefault(true_path(file), file)
    return list(found.values()), failures


def true_path(path: Path) -> str:
    """The path with its links followed, as far as they lead; standard input stays ``-``."""
    try:
        return STDIN if str(path) == STDIN else os.path.realpath(path)
    except ValueError:  # a null in it: no file, and told so by its reader
        return str(path)


def read_source(source: Path, options: "ReadOptions") -> "ProfileFile":
    """Profiles of a file, with how they were read.

    Raises
    ------
    UnreadableFile
        Names the file and the mend; also where nobody states the unit and mm cannot be right.
    """
    from lsvision.io.profiles import inspect_profiles

    file = inspect_profiles(source, **options)
    if file.doubts and file.units_assumed:
        marked = [f"{marker.count} by {marker.text}" for marker in file.markers]
        lost = f" (without {file.lost} lost points, {', '.join(marked)})" if marked else ""
        raise UnreadableFile(
            f"{source}: {'; '.join(file.doubts)}, or --units mm if it is right{lost}"
        )
    return file


def print_reading_notes(files: "Sequence[ProfileFile]") -> None:
    """Write on stderr what was guessed while files were read, each remark once."""
    remarks: dict[str, list[Path]] = {}
    for file in files:
        assumed = f"units taken as {file.units}: say --units" if file.units_assumed else ""
        for remark in (*file.notes, assumed):
            if remark:
                remarks.setdefault(remark, []).append(file.path)
    for remark, paths in remarks.items():
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        print_lines([f"{paths[0]}{more}: note: {remark}"], err=True)


def _files_of(word: str, suffixes: frozenset[str]) -> list[Path]:
    path = Path(word)
    if word == STDIN:
        return [path]
    if is_directory(path):
        shown = (file for file in path.iterdir() if not file.name.startswith("."))
        wanted = (file for file in shown if file.suffix.lower() in suffixes)
        return sorted((file for file in wanted if is_regular(file)), key=natural_order)
    if exists(path) or not glob.has_magic(word):
        return [path]
    found = glob.glob(word, recursive=True)  # noqa: PTH207 - Path.glob takes no absolute pattern
    matches = [Path(match) for match in found]
    return sorted((match for match in matches if is_regular(match)), key=natural_order)


def _nothing_in(word: str, suffixes: frozenset[str]) -> UnreadableFile:
    if is_directory(word):
        if suffixes is PROFILE_SUFFIXES and _files_of(word, IMAGE_SUFFIXES | VIDEO_SUFFIXES):
            return UnreadableFile(
                f"{word}: no profile in this folder, only images: they need the rig that took "
                "them, --light-section rig.json"
            )
        what, pattern = ("image", "*.png") if suffixes is IMAGE_SUFFIXES else ("profile", "*.csv")
        return UnreadableFile(
            f"{word}: no {what} in this folder: name another, its subfolders as "
            f"'{Path(word) / '**' / pattern}', or files whose suffix is none of "
            f"{' '.join(sorted(suffixes))}"
        )
    return UnreadableFile(f"{word}: no file matches this pattern: check it with ls")
