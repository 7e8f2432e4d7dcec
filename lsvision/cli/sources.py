"""Input files of a command line, and their profiles."""

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.messages import print_notes
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import STDIN, is_directory
from lsvision.io.file_names import (
    PROFILE_SUFFIXES,
    find_files,
    find_left_out,
    find_unlistable_folders,
)
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.io.profiles.streaming import ProfileChunk
    from lsvision.profile import Profile

IMAGE_SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp"))
"""Suffixes of images in a folder."""

VIDEO_SUFFIXES = frozenset((".avi", ".mp4", ".mkv", ".mov", ".m4v", ".webm"))
"""Suffixes of videos in a folder."""

MEASURED_SUFFIXES = PROFILE_SUFFIXES | IMAGE_SUFFIXES | VIDEO_SUFFIXES
"""Suffixes of measured files in a folder if a rig is given."""

HEIGHT_MAP_SUFFIXES = frozenset((".tif", ".tiff", ".png"))
"""Suffixes of height maps in a folder, which are read if the spacing of columns is given."""


MAX_NAMES = 3
"""Largest number of names in a note."""


def list_suffixes_of_profiles(dx: float | None) -> frozenset[str]:
    """Return the suffixes of profiles in a folder, with ``--dx`` or without."""
    return PROFILE_SUFFIXES if dx is None else PROFILE_SUFFIXES | HEIGHT_MAP_SUFFIXES


def find_sources(
    names: Sequence[str], suffixes: frozenset[str] = PROFILE_SUFFIXES
) -> tuple[list[Path], list[LsvisionError]]:
    """Return the files that the arguments of a command line name, and an error for each without.

    The names are files, folders (the files directly in them with one of `suffixes`), patterns
    (``**`` matches folders) and ``-`` for standard input. Each file is returned once, with a note
    on stderr if it is there under two names; within a folder or pattern in natural order, 2 before
    10.
    """
    files_by_path: dict[str, Path] = {}
    failures: list[LsvisionError] = []
    for name in names:
        if not name:  # as of an unset variable; `Path` would take it for the current folder
            failures.append(
                UnreadableFile(
                    "expected the name of a file or folder, got an empty one: check that the "
                    "variable is set"
                )
            )
            continue
        try:
            files = find_files(name, suffixes)
            if not files:
                failures.append(_build_no_file_error(name, suffixes))
            failures += [
                UnreadableFile(f"{folder}: cannot be listed: check its owner and mode")
                for folder in find_unlistable_folders(name)
            ]
        except UnreadableFile as error:  # a folder that may not be listed
            failures.append(error)
            continue
        for file in files:
            first = files_by_path.setdefault(resolve_path(file), file)
            if file.absolute() != first.absolute():
                print_notes({f"the same file as {first}, read once": [file]})
    return list(files_by_path.values()), failures


def list_left_out(names: Sequence[str], suffixes: frozenset[str], results: Path) -> Iterator[str]:
    """Yield a note for each folder or pattern with subfolders or files that are not read.

    The folder `results` is none of them.
    """
    for name in filter(None, names):
        try:
            folders, files = find_left_out(name, find_files(name, suffixes))
        except UnreadableFile:  # reported by `find_sources`
            continue
        folders = [folder for folder in folders if resolve_path(folder) != resolve_path(results)]
        if folders:
            yield (
                f"{name}: note: {_list_names(folders, 'folder')} in it not searched: "
                f"'{Path(name) / '**' / '*.csv'}' names the files in subfolders, too"
                if is_directory(name)
                else f"{name}: note: {_list_names(folders, 'folder')} not searched: a pattern with "
                "** also names the files in folders"
            )
        if files:
            yield f"{name}: note: {_list_names(files, 'file')} left out: name each to measure it"


def _list_names(paths: Sequence[Path], kind: str) -> str:
    """Return the number of paths, and the names of the first ones."""
    shown = [path.name for path in paths[:MAX_NAMES]]
    more = ["..."] if len(paths) > MAX_NAMES else []
    return f"{format_count(len(paths), kind)} ({', '.join([*shown, *more])})"


def resolve_path(path: Path) -> str:
    """Return the path with its links resolved; standard input stays ``-``."""
    try:
        return STDIN if str(path) == STDIN else os.path.realpath(path)
    except ValueError:  # contains a null character, so there is no such file: its reader reports it
        return str(path)


def read_source(source: Path, options: "ReadOptions") -> "ProfileFile":
    """Return the profiles of a file.

    Raises
    ------
    UnreadableFile
        If it cannot be read, or its coordinates are implausible for the unit that was assumed; the
        message states the remedy.
    """
    from lsvision.io.profiles import inspect_profiles
    from lsvision.io.profiles.reading import require_plausible_units

    file = inspect_profiles(source, **options)
    require_plausible_units(file)
    return file


def iterate_source(source: Path, options: "ReadOptions") -> "Iterator[ProfileChunk]":
    """Yield the profiles of a file in chunks; see `read_source`."""
    from lsvision.io.profiles.reading import require_plausible_units
    from lsvision.io.profiles.streaming import iterate_profiles

    for chunk in iterate_profiles(source, **options):
        require_plausible_units(chunk.file)
        yield chunk


def read_sources(
    sources: Sequence[Path], options: "ReadOptions", *, may_be_lost: bool = False
) -> "list[ProfileFile]":
    """Return the profiles of each file; the assumptions made are printed on stderr, each once.

    With `may_be_lost` a file whose points are all lost has profiles without points, and a note.

    Raises
    ------
    UnreadableFile
        If a file cannot be read; see `read_source`.
    """
    from lsvision.batch.measure_file import list_notes

    read = _read_file_of_scan if may_be_lost else read_source
    files = [read(source, options) for source in sources]
    paths_by_note: dict[str, list[Path]] = {}
    for file in files:
        for note in list_notes(file):
            paths_by_note.setdefault(note, []).append(file.path)
    print_notes(paths_by_note)
    return files


def require_points_of_scan(profiles: "Sequence[Profile]", sources: Sequence[Path]) -> None:
    """Raise UnreadableFile if all points of all sections of a scan are lost."""
    if all(profile.lost == len(profile) for profile in profiles):
        raise UnreadableFile(
            f"{sources[0]}: all points of all sections ({len(profiles)}) are lost: check exposure "
            "and range, or --columns"
        )


def _read_file_of_scan(source: Path, options: "ReadOptions") -> "ProfileFile":
    """Return the profiles of a file, without points if they are all lost; see `read_source`."""
    from lsvision.io.profiles.lost_points import AllPointsLost
    from lsvision.io.profiles.reading import ProfileFile
    from lsvision.profile import Profile

    try:
        return read_source(source, options)
    except AllPointsLost as error:
        return ProfileFile(
            path=source, profiles=(Profile([[math.nan, math.nan]]),) * error.sections,
            reader=options.get("format") or "text", units="mm", units_assumed=False, flipped=False,
            positions=None, notes=("all points are lost: a section without points",),
        )  # fmt: skip


def name_profiles(file: "ProfileFile", name: str) -> list[str]:
    """Return a name for each profile of a file: `name`, with its number if there are several."""
    count = len(file.profiles)
    if count == 1:
        return [name]
    return [f"{name}, profile {number}" for number in range(count)]


def _build_no_file_error(name: str, suffixes: frozenset[str]) -> UnreadableFile:
    """Return the error for a folder or pattern without a file, with what to name instead."""
    if is_directory(name):
        if suffixes is PROFILE_SUFFIXES and find_files(name, IMAGE_SUFFIXES | VIDEO_SUFFIXES):
            return UnreadableFile(
                f"{name}: no profile in this folder, only images: if they show a laser line, "
                "measure them with the rig that took them, lsvision measure --light-section "
                "rig.json"
            )
        kind, pattern = ("image", "*.png") if suffixes is IMAGE_SUFFIXES else ("profile", "*.csv")
        return UnreadableFile(
            f"{name}: no {kind} in this folder: name another folder, its subfolders by "
            f"'{Path(name) / '**' / pattern}', or each file if its suffix is not one of "
            f"{' '.join(sorted(suffixes))}"
        )
    return UnreadableFile(f"{name}: no file matches this pattern: check it with ls")
