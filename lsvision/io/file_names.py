"""Which files a name stands for: a file, those right in a folder, or those of a pattern."""

import glob
from pathlib import Path

from lsvision.files.file_kinds import exists, is_directory, is_regular, natural_order
from lsvision.files.limited_reading import STDIN

PROFILE_SUFFIXES = frozenset(
    [
        *(".csv", ".tsv", ".txt", ".asc", ".xyz", ".xz", ".dat", ".yml", ".yaml", ".xml"),
        *(".npy", ".npz", ".ply", ".pcd", ".parquet", ".bag", ".db3", ".mcap"),
    ]
)
"""Files that count as profiles when a folder is named; any file can be named by itself."""

_ROS2_STORAGE, _ROS2_METADATA = (".db3", ".mcap"), "metadata.yaml"


def find_files(name: str, suffixes: frozenset[str] = PROFILE_SUFFIXES) -> list[Path]:
    """Return the files that a name stands for, in natural order (2 before 10).

    Parameters
    ----------
    name : str
        A file; ``-``, standard input; a folder: the files right in it that have one of
        `suffixes`, hidden ones left out; or a pattern, in which ``**`` reaches into folders.
    suffixes : frozenset of str
        What counts when a folder is named.

    Returns
    -------
    list of Path
        Empty if a folder or a pattern holds none. A name that is neither is returned as it is,
        also if there is no such file: reading it tells.
    """
    path = Path(name)
    if name == STDIN:
        return [path]
    if is_directory(path):
        shown = (file for file in path.iterdir() if not file.name.startswith("."))
        wanted = [file for file in shown if file.suffix.lower() in suffixes and is_regular(file)]
        if any(file.suffix.lower() in _ROS2_STORAGE for file in wanted):
            wanted = [file for file in wanted if file.name != _ROS2_METADATA]
        return sorted(wanted, key=natural_order)
    if exists(path) or not glob.has_magic(name):
        return [path]
    found = glob.glob(name, recursive=True)  # noqa: PTH207 - Path.glob takes no absolute pattern
    matches = [Path(match) for match in found]
    return sorted((match for match in matches if is_regular(match)), key=natural_order)
