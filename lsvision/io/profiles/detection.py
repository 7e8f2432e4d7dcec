"""Which format a file is in: first its magic bytes, then its first lines, then its name."""

import re

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.matrix import MIN_COLUMNS
from lsvision.io.profiles.text_table import decode_text

_MAGIC = (
    (b"\x93NUMPY", "npy"),
    (b"PK\x03\x04", "npz"),
    (b"PK\x05\x06", "npz"),
    (b"PAR1", "parquet"),
    (b"ply\n", "ply"),
    (b"ply\r\n", "ply"),
    (b"# .PCD", "pcd"),
    (b"VERSION", "pcd"),
)

_EXPORT = "export its profiles as CSV with x and z in mm and read that"
_REFUSED_MAGIC = (
    (b"RIFF", f"a video container (scanCONTROL .avi): {_EXPORT}"),
    (b"\x89HDF", "HDF5 is not read: write its points as NPZ or CSV"),
    (b"\x89MCAP", "a ROS bag is not read: write its points as PCD or CSV"),
    (b"#ROSBAG", "a ROS bag is not read: write its points as PCD or CSV"),
    (b"\x1f\x8b", "a gzip archive: unpack it first"),
    (b"\x89PNG", "an image: read it with LightSection, which makes a profile of it"),
    (b"\xff\xd8\xff", "an image: read it with LightSection, which makes a profile of it"),
)
_REFUSED_SUFFIX = {
    ".avi": f"a scanCONTROL recording needs the maker's library: {_EXPORT}",
    ".llt": f"a scanCONTROL recording needs the maker's library: {_EXPORT}",
    **dict.fromkeys(
        [".rec", ".gprec", ".gdp"],
        "a Gocator recording: convert it to CSV with the sensor's web page or kFileConvert",
    ),
}

_FIRST_LINES = (
    (re.compile(r"\s*%YAML", re.IGNORECASE), "opencv"),
    (re.compile(r"\s*(<\?xml[^>]*>\s*)?<opencv_storage>"), "opencv"),
    (re.compile(r"\s*\{"), "opencv"),
    (re.compile(r"\s*Info\s*\n\s*CSV Version,"), "gocator"),
    (re.compile(r"[^\n]*\bx0\s*,\s*z0\b", re.IGNORECASE), "gocator-points"),
)
_KEYENCE_ROW = re.compile(r"\s*[-+]?[0-9.]+\t[-+]?[0-9.]+\s*[\r\n]")
"""First line of the exporter's UTF-16 files."""
_RESULT_LOG = re.compile(r"micro-epsilon|scanCONTROL", re.IGNORECASE)
_KEYENCE_WIDTHS = frozenset([800, 1600, 3200, 6400])  # columns of an LJ-V and LJ-X profile


def detect_format(content: bytes, suffix: str) -> str:
    r"""Name of the format, one of `FORMATS`.

    Parameters
    ----------
    content : bytes
        The whole file.
    suffix : str
        As ``".csv"``; asked only where the content does not tell.

    Raises
    ------
    UnreadableFile
        For an empty file, binary data of no known format, and files that only their maker's
        software reads, with what to do.

    Examples
    --------
    >>> detect_format(b"1.0, 2.0\n", ".csv"), detect_format(b"%YAML:1.0\n", ".txt")
    ('text', 'opencv')
    """
    if not content.strip():
        raise UnreadableFile("the file is empty: want x and height in mm, one point a line")
    for magic, name in _MAGIC:
        if content.startswith(magic):
            return name
    for magic, advice in _REFUSED_MAGIC:
        if content.startswith(magic):
            raise UnreadableFile(advice)
    if suffix.lower() in _REFUSED_SUFFIX:
        raise UnreadableFile(_REFUSED_SUFFIX[suffix.lower()])
    return _text_format(content)


def _text_format(content: bytes) -> str:
    start = decode_text(content)[:4000]
    for pattern, name in _FIRST_LINES:
        if pattern.match(start):
            return name
    if _RESULT_LOG.search("\n".join(start.splitlines()[:3])):
        raise UnreadableFile(
            "a scanCONTROL log of results, not of profiles: export the profiles as X;Z text"
        )
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) and _KEYENCE_ROW.match(start):
        return "keyence"
    return _table_format(start if len(start.splitlines()) > 1 else decode_text(content))


def _table_format(text: str) -> str:
    line = next((line for line in text.splitlines() if line.strip()), "").strip()
    cells = re.split(r"[,;\t]|\s+", line)
    if len(cells) in _KEYENCE_WIDTHS and all(cell.isdecimal() for cell in cells):
        return "keyence-raw"
    return "matrix" if len(cells) >= MIN_COLUMNS else "text"
