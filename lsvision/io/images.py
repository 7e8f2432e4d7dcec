"""Image files of 8 or 16 bit, grey or colour; their size is checked before they are decoded."""

import os
import re
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import read_bytes

_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
"""First bytes of a PNG file."""
# Chunks of animated PNG files, which are not read.
_ANIMATION_CHUNKS = frozenset([b"acTL", b"fcTL", b"fdAT"])
# Magic number, width and height, with comments between them.
_PNM = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257  # tags
_TIFF_TYPES = {3: "H", 4: "I"}  # SHORT and LONG as formats of struct
# Markers of frame headers (SOF0 to SOF15), which hold the size; C4, C8 and CC are other segments.
_JPEG_FRAMES = frozenset([*range(0xC0, 0xD0)]) - {0xC4, 0xC8, 0xCC}
# Markers that no length and no content follow: TEM, RST0 to RST7.
_JPEG_WITHOUT_LENGTH = frozenset([0x01, *range(0xD0, 0xD8)])
_JPEG_SCAN, _JPEG_END = 0xDA, 0xD9
"""Markers after which no size is stated: start of the scan, end of the image."""
_WEBP_SIDE_MASK = (1 << 14) - 1  # width and height have 14 bits
MAX_PIXELS = 10**8
"""Largest number of pixels of an image that is read; extracting its laser line takes 20 to 50 times
the memory of the pixels."""


def read_image_size(content: bytes) -> tuple[int, int] | None:
    r"""Return the size of a PNG, JPEG, TIFF, BMP, PNM or WebP image.

    Parameters
    ----------
    content : bytes
        The whole file.

    Returns
    -------
    tuple of int, optional
        ``(width, height)``; None for anything else, an animated PNG, and a header or a PNG that is
        truncated. Units: px.

    Examples
    --------
    >>> read_image_size(b"P5\n# made by hand\n640 480\n255\n")
    (640, 480)
    """
    try:
        for magic, read_size in _FORMATS:
            if content.startswith(magic):
                return read_size(content)
    except struct.error:  # truncated
        pass
    return None


def _read_png_size(content: bytes) -> tuple[int, int] | None:
    """Return the size of a PNG whose chunks are complete: OpenCV may hang at a truncated one."""
    if content[12:16] != b"IHDR":
        return None
    offset, kind = len(_PNG_MAGIC), b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", content, offset)
        offset += 12 + length
        if offset > len(content) or kind in _ANIMATION_CHUNKS:
            return None
    return struct.unpack_from(">II", content, 16)


def _read_pnm_size(content: bytes) -> tuple[int, int] | None:
    match = _PNM.match(content[:4096])
    return (int(match[1]), int(match[2])) if match else None


def _read_bmp_size(content: bytes) -> tuple[int, int]:
    (header,) = struct.unpack_from("<I", content, 14)
    if header == 12:  # BMP of OS/2
        return struct.unpack_from("<HH", content, 18)
    width, height = struct.unpack_from("<ii", content, 18)
    return abs(width), abs(height)


def _read_webp_size(content: bytes) -> tuple[int, int] | None:
    """Return the size of a WebP: extended (VP8X), lossless (VP8L) or lossy (VP8)."""
    kind = content[12:16] if content[8:12] == b"WEBP" else b""
    if kind == b"VP8X":  # width - 1 and height - 1 of 24 bits each
        low, middle, high = struct.unpack_from("<HHH", content, 24)
        return 1 + low + ((middle & 0xFF) << 16), 1 + (middle >> 8) + (high << 8)
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return 1 + (bits & _WEBP_SIDE_MASK), 1 + (bits >> 14 & _WEBP_SIDE_MASK)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & _WEBP_SIDE_MASK, height & _WEBP_SIDE_MASK
    return None


def _read_jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Return the size in the first frame header of a JPEG; None if the scan begins before it."""
    offset = 2
    while True:
        offset = content.find(b"\xff", offset)
        if offset < 0:
            return None
        marker = content[offset + 1] if offset + 1 < len(content) else _JPEG_END
        if marker in _JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", content, offset + 5)
            return width, height
        if marker in (_JPEG_SCAN, _JPEG_END):
            return None
        if marker == 0xFF:
            offset += 1
        elif marker in _JPEG_WITHOUT_LENGTH or marker == 0:  # FF 00 is a byte of data, FF
            offset += 2
        else:
            (length,) = struct.unpack_from(">H", content, offset + 2)
            offset += 2 + length


def _read_tiff_size(content: bytes) -> tuple[int, int] | None:
    """Return the size in the first directory of a TIFF."""
    order = "<" if content.startswith(b"II") else ">"
    (start,) = struct.unpack_from(f"{order}I", content, 4)
    (count,) = struct.unpack_from(f"{order}H", content, start)
    sides: dict[int, int] = {}
    for entry in range(start + 2, start + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(f"{order}HH", content, entry)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT) and kind in _TIFF_TYPES:
            (value,) = struct.unpack_from(f"{order}{_TIFF_TYPES[kind]}", content, entry + 8)
            sides.setdefault(tag, value)
    if len(sides) < 2:
        return None
    return sides[_TIFF_WIDTH], sides[_TIFF_HEIGHT]


_FORMATS = (
    (_PNG_MAGIC, _read_png_size),
    (b"\xff\xd8\xff", _read_jpeg_size),
    (b"II*\0", _read_tiff_size),
    (b"MM\0*", _read_tiff_size),
    (b"BM", _read_bmp_size),
    (b"RIFF", _read_webp_size),
    (b"P", _read_pnm_size),
)
"""First bytes of each image format that is read, and the function that reads its size."""


def read_image(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Read an image as it was stored.

    Parameters
    ----------
    path : path
        PNG, TIFF, JPEG, BMP, PGM, PPM or WebP, detected by its first bytes; ``"-"`` is standard
        input.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray of uint8 or uint16
        Channels in the order blue, green, red; transparency and orientation tags are ignored.

    Raises
    ------
    UnreadableFile
        If the file is missing, not such an image, or larger than `MAX_PIXELS`; names the file
        and the remedy.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "dot.png"
    >>> _ = path.write_bytes(cv2.imencode(".png", np.full((2, 3), 700, np.uint16))[1].tobytes())
    >>> read_image(path).shape, read_image(path).dtype.name
    ((2, 3), 'uint16')
    """
    source = Path(path)
    try:
        image = decode_image(read_bytes(source))
    except TooManyPixels as error:
        raise UnreadableFile(f"{source}: {error}: crop it to the laser line") from None
    if image is None or image.dtype not in (np.uint8, np.uint16) or not image.size:
        raise UnreadableFile(
            f"{source} is not an image of 8 or 16 bit: save it as PNG, TIFF or JPEG, and copy it "
            "again if it is truncated"
        )
    return image[..., :3] if image.ndim == 3 else image


def encode_png(image: npt.NDArray[Any]) -> bytes:
    """Return the content of a PNG file of an image of 8 or 16 bit (blue, green, red).

    Examples
    --------
    >>> image = np.full((2, 3), 700, np.uint16)
    >>> bool((decode_image(encode_png(image)) == image).all())
    True
    """
    _, content = cv2.imencode(".png", np.ascontiguousarray(image))
    return bytes(content)


class TooManyPixels(ValueError):
    """Error of an image with more than `MAX_PIXELS`."""


def decode_image(content: bytes) -> npt.NDArray[Any] | None:
    """Return the image of a file's content, as it was stored.

    The size is read from the header and checked before the image is decoded.

    Returns
    -------
    ndarray, optional
        Image of any bit depth; None if the bytes are not an image.

    Raises
    ------
    TooManyPixels
        If the image is larger than `MAX_PIXELS`.
    """
    size = read_image_size(content)
    if size is None:
        return None
    if size[0] * size[1] > MAX_PIXELS:
        raise TooManyPixels(
            f"expected an image of at most {MAX_PIXELS / 1e6:g} megapixels, got "
            f"{size[0]} x {size[1]} px"
        )
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image)
