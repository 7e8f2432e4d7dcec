"""Images: known by their first bytes, and their size before they are unpacked."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.images import read_image, read_image_size

GREY = np.arange(30 * 41, dtype=np.uint8).reshape(30, 41)


def png_header(width, height):
    return b"\x89PNG\r\n\x1a\n" + chunk(
        b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    )


def chunk(kind, data=b""):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@pytest.mark.parametrize("suffix", ["png", "jpg", "tiff", "bmp", "pgm", "ppm", "webp"])
def test_the_header_states_the_size(tmp_path, suffix):
    image = np.dstack([GREY] * 3) if suffix in ("ppm", "webp") else GREY
    content = cv2.imencode(f".{suffix}", image)[1].tobytes()
    assert read_image_size(content) == (41, 30)
    (tmp_path / "a").write_bytes(content)
    assert read_image(tmp_path / "a").shape[:2] == (30, 41)
    for length in range(0, min(len(content), 200), 3):
        read_image_size(content[:length])  # cut short anywhere


@pytest.mark.parametrize(
    "content",
    [
        png_header(100_000, 100_000) + chunk(b"IEND"),
        b"BM" + bytes(12) + struct.pack("<Iii", 40, 1 << 30, -(1 << 30)),
        b"P5 99999 99999 255 ",
        b"II*\0\x08\0\0\0\x02\0"
        + struct.pack("<HHII", 256, 4, 1, 99999)
        + struct.pack("<HHII", 257, 4, 1, 99999),
        b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03",
    ],
    ids=["png", "bmp", "pgm", "tiff", "jpeg"],
)
def test_an_image_of_many_pixels_is_rejected_before_it_is_unpacked(tmp_path, content, monkeypatch):
    (tmp_path / "large").write_bytes(content)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("unpacked"))
    with pytest.raises(UnreadableFile, match="large: expected an image of at most 100 megapixels"):
        read_image(tmp_path / "large")


@pytest.mark.parametrize(
    "content", [b"", b"no image", png_header(9, 9), b"v/1\x01", b"P5 0 0 255\n"]
)
def test_what_is_no_image_is_rejected(tmp_path, content):
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(UnreadableFile, match="a is not an image of 8 or 16 bit"):
        read_image(tmp_path / "a")


@pytest.mark.parametrize(
    "tail",
    [
        b"\0\0\xff\xffIDAT" + bytes(9),
        chunk(b"acTL", bytes(8)) + chunk(b"IEND"),
        b"",
        chunk(b"IDAT", zlib.compress(bytes(90)))[:-6],
    ],
    ids=["long chunk", "animated", "no end", "cut"],
)
def test_a_png_of_broken_chunks_is_rejected_and_never_hangs(tmp_path, tail):
    (tmp_path / "a.png").write_bytes(png_header(9, 9) + tail)
    with pytest.raises(UnreadableFile, match="is not an image of 8 or 16 bit"):
        read_image(tmp_path / "a.png")
