"""Which files a command line names, and what one of them holds."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.io.file_names import PROFILE_SUFFIXES, find_files

if TYPE_CHECKING:
    from lsvision.io.profiles import ProfileFile, ReadOptions

IMAGE_SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".webp"))
"""Files that count as images when a folder is named."""

VIDEO_SUFFIXES = frozenset((".avi", ".mp4", ".mkv", ".mov", ".m4v", ".webm"))
"""Files that are read frame by frame."""

MEASURED_SUFFIXES = PROFILE_SUFFIXES | IMAGE_SUFFIXES | VIDEO_SUFFIXES
"""What counts in a folder where a rig turns images into profiles."""


def find_sources(
    words: Sequence[str], suffixes: frozenset[str] = PROFILE_SUFFIXES
) -> tuple[list[Path], list[LsvisionError]]:
    """Files that the words of a command line name.

    Parameters
    ----------
    words : sequence of str
        Files, folders (the profile files right in them) and patterns (``**`` reaches into
        folders), in the order of the command line.
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
    found: dict[Path, Path] = {}
    failures: list[LsvisionError] = []
    for word in words:
        files = find_files(word, suffixes)
        if not files:
            failures.append(_nothing_in(word, suffixes))
        for file in files:
            found.setdefault(file.resolve(), file)
    return list(found.values()), failures


def read_source(source: Path, options: "ReadOptions") -> "ProfileFile":
    """Profiles of a file, with how they were read.

    Raises
    ------
    UnreadableFile
        Names the file and the mend.
    """
    from lsvision.io.profiles import inspect_profiles

    return inspect_profiles(source, **options)


def _nothing_in(word: str, suffixes: frozenset[str]) -> UnreadableFile:
    if Path(word).is_dir():
        if suffixes is PROFILE_SUFFIXES and find_files(word, IMAGE_SUFFIXES | VIDEO_SUFFIXES):
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
