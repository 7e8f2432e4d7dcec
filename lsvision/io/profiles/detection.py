"""Detection of a file's format by its content; the suffix only shows some that cannot be read."""

import io
import re
import zipfile

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_roles import names_section
from lsvision.io.profiles.matrix import MIN_COLUMNS
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.text_layout import (
    find_separator,
    is_comment,
    is_number_or_lost,
    split_cells,
)
from lsvision.io.profiles.units import split_label

_MAGIC = (
    (b"\x93NUMPY", "npy"),
    (b"PAR1", "parquet"),
    (b"ply\n", "ply"),
    (b"ply\r\n", "ply"),
    (b"# .PCD", "pcd"),
)
"""First bytes of the formats that are read, and their names."""

_ZIP = (b"PK\x03\x04", b"PK\x05\x06", b"PK\x07\x08")
"""First bytes of a ZIP archive, such as NPZ or a spreadsheet."""
_SPREADSHEET = "a spreadsheet: save it as CSV and read that"
_UNPACK = "unpack it first and read what is in it"
_EXPORT = "export its profiles as CSV with x and z in mm and read that"
_IMAGE = (
    "an image: read it with LightSection (lsvision measure --light-section), which makes a profile "
    "of it; heights must be a TIFF or PNG of more than 8 bit"
)
# First bytes of formats that are not read, and the message with the remedy.
_UNSUPPORTED_MAGIC = (
    (b"RIFF", f"a video container (scanCONTROL .avi): {_EXPORT}"),
    (b"\x89HDF", "HDF5 is not read: write its points as NPZ or CSV"),
    (b"MATLAB 7.3", "a MAT file (HDF5): save x and z in MATLAB with writematrix as CSV"),
    (b"MATLAB 5.0", "a MAT file: save x and z in MATLAB with writematrix as CSV"),
    (b"%PDF", "a PDF: export the numbers as CSV"),
    (
        b"\xd0\xcf\x11\xe0",
        "an old Office document (.xls, .doc): save its table as CSV and read that",
    ),
    (b"{\\rtf", "a text document (RTF): save it as plain text"),
    (b"\x1f\x8b", f"a gzip archive: {_UNPACK}"),
    (b"7z\xbc\xaf", f"a 7z archive: {_UNPACK}"),
    (b"Rar!", f"a RAR archive: {_UNPACK}"),
    (b"BZh", f"a bzip2 archive: {_UNPACK}"),
    (b"\xfd7zXZ", f"an xz archive: {_UNPACK}"),
    (b"\x28\xb5\x2f\xfd", f"a zstd archive: {_UNPACK}"),
    (b"ARROW1", "an Arrow (Feather) file: write it as Parquet"),
    (b"SQLite format 3", "a database (SQLite) and no ROS 2 bag: export its points as CSV"),
    (b"TDSm", "a TDMS file of LabVIEW: export its points as CSV"),
    (b"LASF", "a LAS cloud: write its points as PLY or CSV"),
    (b"ASTM-E57", "an E57 cloud: write its points as PLY or CSV"),
    (b"solid ", "an STL mesh: write its points as PLY or CSV"),
    *(
        (bytes([0x80, protocol]), "a Python pickle, which may run code: save arrays with np.save")
        for protocol in range(2, 6)
    ),
    (b"GIF8", _IMAGE),
    (b"BM", _IMAGE),
    (b"\xff\xd8\xff", _IMAGE),
)
_BAGS = (b"\x89MCAP", b"#ROSBAG")
_BAG_TABLE = re.compile(rb"CREATE TABLE [\"'`\[]?topics", re.IGNORECASE)
"""Description of the table in an SQLite file that is a ROS 2 bag."""
_SCHEMA_BYTES = 100_000  # of a database, whose tables are described in its first page
_HEAD_BYTES = 16_000  # at least 4000 characters in any encoding
_MARKUP = re.compile(r"\s*<(?:!doctype\b|\?xml|html|table|svg|kml|gpx)", re.IGNORECASE)
"""Start of HTML or XML."""
_OFFICE_PARTS = {
    "xl/": _SPREADSHEET,
    "word/": "a text document: save its table as CSV and read that",
    "ppt/": "a presentation: save its table as CSV and read that",
    "content.xml": "an OpenDocument file: save its table as CSV and read that",
    "Index/": f"a Numbers document, {_SPREADSHEET}",
}
"""Beginning of the name of a part of an office document, and the message."""
_UNSUPPORTED_SUFFIX = {
    ".avi": f"a scanCONTROL recording needs the maker's library: {_EXPORT}",
    ".llt": f"a scanCONTROL recording needs the maker's library: {_EXPORT}",
    **dict.fromkeys(
        [".rec", ".gprec", ".gdp"],
        "a Gocator recording: convert it to CSV with the sensor's web page or kFileConvert",
    ),
}

# Patterns of the first lines of text formats, and name of the format.
_FIRST_LINES = (
    (re.compile(r"\s*%YAML", re.IGNORECASE), "opencv"),
    (re.compile(r"\s*(<\?xml[^>]*>\s*)?<opencv_storage>"), "opencv"),
    (re.compile(r"\s*\{"), "json"),
    (re.compile(r"\s*\[\s*[\[{]"), "json"),
    # the columns of `rostopic echo -p`, with its prefix or without
    (re.compile(r"[^\n]*\bfield\.(angle_min|ranges)|[^\n]*\bangle_increment\s*,"), "laserscan"),
    # YAML: a ROS message, a key with a list on its line, or a key of points with a list below it
    (re.compile(r"(?:\s*#[^\n]*\n|\s*---[ \t]*\n)*\s*header:\s*\n\s+\w+:"), "yaml"),
    (re.compile(r"(?:\s*#[^\n]*\n|\s*---[ \t]*\n)*\s*[A-Za-z_]\w*:[ \t]*\[[^\]\n]*,"), "yaml"),
    (
        re.compile(r"(?:[^\n]*\n)*?(?:ranges|points|x|scan_line|profile):[ \t]*(?:\n\s*-\s|\[)"),
        "yaml",
    ),
    (re.compile(r"\s*Info\s*\n\s*CSV Version,"), "gocator"),
    # a list of points of a Gocator, without the sections of its recordings
    (re.compile(r"[^\n]*\bx0\s*,\s*z0\b", re.IGNORECASE), "gocator-points"),
)
_KEYENCE_ROW = re.compile(r"\s*[-+]?[0-9.]+\t[-+]?[0-9.]+\s*[\r\n]")
"""First line of a UTF-16 file that Keyence's software exports."""
_RESULT_LOG = re.compile(r"\W*www\.micro-epsilon\.\w+\W+scanCONTROL", re.IGNORECASE)
"""First two lines of a log that the scanCONTROL Configuration Tools write."""
_KEYENCE_WIDTHS = frozenset([800, 1600, 3200, 6400])  # columns of an LJ-V and LJ-X profile


def detect_format(content: bytes, suffix: str) -> str:
    r"""Return the name of the format, one of `FORMATS` in `settings`, of the content of a file.

    The suffix, such as ``".csv"``, only shows formats that are not read.

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
    if not content or content.isspace():
        raise UnreadableFile("the file is empty: expected x and height in mm, one point per line")
    for magic, name in _MAGIC:
        if content.startswith(magic):
            return name
    if content.startswith(b"VERSION") and b"FIELDS" in content[:4000]:
        return "pcd"
    if content.startswith(_ZIP):
        return _detect_zip_format(content, suffix.lower())
    if content.startswith(_BAGS) or _is_ros2_database(content):
        return "rosbag"
    if content.startswith((b"II*\0", b"MM\0*", b"\x89PNG")):
        return "height-map"
    _check_supported(content, suffix.lower())
    return _detect_text_format(content)


def _check_supported(content: bytes, suffix: str) -> None:
    """Raise the error of a format that is not read; a suffix is in lower case."""
    if content.startswith(b"RIFF") and content[8:12] == b"WEBP":
        raise UnreadableFile(_IMAGE)
    for magic, advice in _UNSUPPORTED_MAGIC:
        # A text may begin with BM or with the word solid.
        is_text = (magic == b"BM" and content[:400].isascii()) or (
            magic == b"solid " and b"facet" not in content[:_HEAD_BYTES]
        )
        if content.startswith(magic) and not is_text:
            raise UnreadableFile(advice)
    if suffix in _UNSUPPORTED_SUFFIX:
        raise UnreadableFile(_UNSUPPORTED_SUFFIX[suffix])


def _is_ros2_database(content: bytes) -> bool:
    """Return whether a file is an SQLite database with a table of topics."""
    if not content.startswith(b"SQLite format 3"):
        return False
    return bool(_BAG_TABLE.search(content[:_SCHEMA_BYTES]))


def _detect_zip_format(content: bytes, suffix: str) -> str:
    """Return npz for a zip archive of arrays; raise an error for other archives."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError, EOFError):
        return "npz"  # the reader of npz reports what is wrong
    if names and all(name.endswith(".npy") for name in names):
        return "npz"
    if suffix in (".xlsx", ".xlsm", ".xlsb", ".ods", ".numbers"):
        raise UnreadableFile(_SPREADSHEET)
    for prefix, advice in _OFFICE_PARTS.items():
        if any(name.startswith(prefix) for name in names):
            raise UnreadableFile(advice)
    contents = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    raise UnreadableFile(f"a zip archive of {contents or 'nothing'}: {_UNPACK}")


def _detect_text_format(content: bytes) -> str:
    """Return the name of the reader for a text; raises an error for a text without points."""
    # A text of ASCII bytes (UTF-16 and UTF-32 without a mark, too) can be cut at a multiple of 4.
    head = content[:_HEAD_BYTES] if content.isascii() else content
    start = "\n".join(decode_text(head)[:4000].splitlines())
    for pattern, name in _FIRST_LINES:
        if pattern.match(start):
            return name
    if _MARKUP.match(start):
        raise UnreadableFile("a web page or an XML file, no table: export the points as CSV")
    if _RESULT_LOG.match(start):
        raise UnreadableFile(
            "a scanCONTROL log of results, not of profiles: export the profiles as X;Z text"
        )
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) and _KEYENCE_ROW.match(start):
        return "keyence"
    has_first_line = len(start.splitlines()) > 1  # else it is longer than `start`
    return _detect_table_format(start if has_first_line else decode_text(content))


def _detect_table_format(text: str) -> str:
    """Return the name of the reader for a table, by the cells of its first row of numbers.

    A wide table is a list of points if x and a height are named above it. The reader of "text"
    takes a matrix, too.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    cells = re.split(r"[,;\t]|\s+", lines[0] if lines else "")
    if len(cells) in _KEYENCE_WIDTHS and all(cell.isdecimal() for cell in cells):
        return "keyence-raw"
    for index, line in enumerate(lines):
        separator = find_separator(line)
        cells = split_cells(line, separator)
        if not is_comment(line) and all(map(is_number_or_lost, cells)):
            above = [row.lstrip("#%/! \t") for row in lines[:index]]
            labels = [label for row in above for label in split_cells(row, separator)]
            names = [split_label(label)[0] for label in labels]
            return "text" if len(cells) < MIN_COLUMNS or names_section(names) else "matrix"
    return "text"
