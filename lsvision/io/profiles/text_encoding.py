"""Text of a file in any of the encodings that exports of profiles have."""

import re

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_words import count_non_ascii_words

_LEGACY_ENCODINGS = ("latin-1", "cp1250", "cp1251", "cp1254", "cp932", "gb18030", "cp949", "big5")
"""Encodings of text that is not UTF-8; of several with equally many known words, the first one is
taken."""
_HEAD_LENGTH = 4000
"""Number of bytes, from the start of the file, in which known words are searched."""
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1b\x7f]")
"""Control character that no text contains."""
_CHECKED_BYTES = 1 << 16  # at once: few enough for the processor's cache


def decode_text(content: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16, UTF-32, Latin-1 or a legacy code page.

    Raises
    ------
    UnreadableFile
        If the bytes are not text.
    """
    content = content.rstrip(b"\x1a")  # the end of a DOS file
    for encoding in _list_encodings(content):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not _has_control_characters(content, text):
            return text
    raise UnreadableFile("binary data of no known format: export the profile as text (x,z in mm)")


def _has_control_characters(content: bytes, text: str) -> bool:
    """Return whether a text has control characters, which binary data have.

    These are the characters of `_CONTROL`. ASCII is searched in its bytes, which is faster.
    """
    if not (content.isascii() and len(content) == len(text)):  # the bytes of UTF-16 may be ASCII
        return bool(_CONTROL.search(text))
    codes = np.frombuffer(content, np.uint8)
    blocks = (codes[i : i + _CHECKED_BYTES] for i in range(0, len(codes), _CHECKED_BYTES))
    return any(  # unsigned: the difference is below 0x0E from 0x0E to 0x1B only
        bool(block.min() < 0x09 or block.max() > 0x7E or (block - np.uint8(0x0E) < 0x0E).any())
        for block in blocks
    )


def _list_encodings(content: bytes) -> list[str]:
    """Return the encodings to try, in this order.

    UTF-16 and UTF-32 are recognised by a byte order mark, UTF-16 without one by its null bytes:
    every second byte of Latin letters and digits.
    """
    if content.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return ["utf-32"]
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ["utf-16"]
    start = content[:400]
    if len(start) >= 4 and start[1::2].count(0) > 0.8 * len(start[1::2]):
        return ["utf-16-le"]
    if len(start) >= 4 and start[::2].count(0) > 0.8 * len(start[::2]):
        return ["utf-16-be"]
    return ["utf-8-sig", _guess_legacy_encoding(content), "latin-1"]


def _guess_legacy_encoding(content: bytes) -> str:
    """Return the code page in which a text has the most words that name coordinates.

    Spreadsheets write CSV in the code page of their language, and its names of columns show which
    one it is. It is Latin-1 if the text is ASCII or has no such word.
    """
    head = content[:_HEAD_LENGTH]
    if head.isascii():
        return "latin-1"
    return max(
        _LEGACY_ENCODINGS,
        key=lambda encoding: count_non_ascii_words(head.decode(encoding, "replace")),
    )
