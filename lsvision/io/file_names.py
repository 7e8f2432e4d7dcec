"""Files that a name denotes: one file, the files of a folder, or those that match a pattern."""

import glob
import os
from collections.abc import Collection
from pathlib import Path

from lsvision.errors import UnreadableFile
from lsvision.files.file_kinds import (
    STDIN,
    build_natural_sort_key,
    exists,
    is_directory,
    is_regular,
)

PROFILE_SUFFIXES = frozenset(
    [
        *(".csv", ".tsv", ".txt", ".asc", ".xyz", ".xz", ".dat", ".yml", ".yaml", ".xml"),
        *(".npy", ".npz", ".ply", ".pcd", ".parquet", ".bag", ".db3", ".mcap"),
    ]
)
"""Files that count as profiles when a folder is named; any file can be named explicitly. JSON and
images are left out: folders also hold results and pictures."""

# Files of a ROS 2 bag: its messages, and their description, which holds no profile.
_ROS2_STORAGE, _ROS2_METADATA = (".db3", ".mcap"), "metadata.yaml"


def find_files(name: str, suffixes: frozenset[str] = PROFILE_SUFFIXES) -> list[Path]:
    """Return the files that a name denotes, in natural order (2 before 10).

    The name is a file; ``-``, standard input; a folder: the files directly in it with one of
    `suffixes` (any if empty), without hidden ones; or a pattern, in which ``**`` matches any
    folders. A folder or a pattern may match no file. Any other name is returned as it is, also if
    there is no such file: reading it fails then.

    Raises
    ------
    UnreadableFile
        If a folder cannot be listed.
    """
    path = Path(name)
    if name in (STDIN, ""):  # Path("") is the current folder, which an empty name does not mean
        return [path]
    if is_directory(path):
        visible = [file for file in _list_folder(path) if not file.name.startswith(".")]
        files = [file for file in visible if not suffixes or file.suffix.lower() in suffixes]
        if any(file.suffix.lower() in _ROS2_STORAGE for file in files):
            files = [file for file in files if file.name != _ROS2_METADATA]
    elif exists(path) or not glob.has_magic(name):
        return [path]
    else:
        files = [Path(match) for match in glob.glob(name, recursive=True)]  # noqa: PTH207 - Path.glob takes no absolute pattern
    return sorted(filter(is_regular, files), key=build_natural_sort_key)


def find_left_out(name: str, found: Collection[Path]) -> tuple[list[Path], list[Path]]:
    """Return what a folder or pattern contains besides the files that were found in it.

    Parameters
    ----------
    name : str
        Folder or pattern; any other name leaves nothing out.
    found : collection of Path
        Files that `find_files` returned for the name.

    Returns
    -------
    folders, files : list of Path
        Subfolders, and files of other suffixes and broken links, in natural order, without hidden
        ones. Of a pattern with ``**``, folders are not left out: it also matches what is in them.
    """
    path = Path(name)
    if is_directory(path):
        visible = [entry for entry in _list_folder(path) if not entry.name.startswith(".")]
    elif exists(path) or not glob.has_magic(name):
        return [], []
    else:
        visible = [Path(match) for match in glob.glob(name, recursive=True)]  # noqa: PTH207 - see `find_files`
    left_out = sorted({*visible}.difference(found), key=build_natural_sort_key)
    folders = [entry for entry in left_out if is_directory(entry)]
    files = [entry for entry in left_out if not is_directory(entry)]
    return [] if "**" in name else folders, files


def find_unlistable_folders(name: str) -> list[Path]:
    """Return the folders below a pattern with ``**`` that cannot be listed, without hidden ones.

    `find_files` leaves them out.
    """
    if "**" not in name or exists(name):
        return []
    root = Path(name)
    while glob.has_magic(str(root)):
        root = root.parent
    errors: list[OSError] = []
    for _, folders, _ in os.walk(root, onerror=errors.append):
        folders[:] = [folder for folder in folders if not folder.startswith(".")]
    return sorted((Path(error.filename) for error in errors), key=build_natural_sort_key)


def _list_folder(path: Path) -> list[Path]:
    try:
        return list(path.iterdir())
    except OSError as error:
        raise UnreadableFile(
            f"{path}: cannot be listed ({error.strerror}): check its owner and mode"
        ) from None
