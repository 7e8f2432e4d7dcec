"""Size and kind of a file are checked before it is read; pipes and standard input are read."""

import io
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from lsvision.errors import UnreadableFile
from lsvision.files import limited_reading
from lsvision.files.limited_reading import check_readable, limit_file_size, read_bytes, read_text

needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")


@pytest.fixture
def pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_a_file_is_read_up_to_the_limit(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    with limit_file_size(5):
        assert read_bytes(path) == b"12345"
        check_readable(path)
    for read in (read_bytes, check_readable):
        with (
            limit_file_size(4),
            pytest.raises(UnreadableFile, match=r"a: expected .* --max-size 8GB"),
        ):
            read(path)


def test_a_sparse_file_of_a_terabyte_is_rejected_before_it_is_read(tmp_path):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(UnreadableFile, match=r"expected 2 GB at most, got 1000 GB"):
        read_bytes(path)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "/dev/full"])
def test_a_device_is_rejected_by_name(device):
    if not Path(device).exists():
        pytest.skip("no such device here")
    for read in (read_bytes, check_readable):
        with pytest.raises(UnreadableFile, match=f"{device}: a device or socket: name a file"):
            read(device)


@needs_pipes
def test_a_pipe_is_read_to_its_end(pipe):
    def write():
        with pipe.open("wb") as file:
            for _ in range(3):
                file.write(b"x" * 100_000)
                file.flush()
                time.sleep(0.05)

    writer = threading.Thread(target=write)
    writer.start()
    assert read_bytes(pipe) == b"x" * 300_000
    writer.join()


@needs_pipes
def test_a_pipe_is_no_way_around_the_limit(pipe):
    def write():
        with suppress(BrokenPipeError), pipe.open("wb", buffering=0) as file:
            while file.write(b"x" * 100_000):
                pass

    writer = threading.Thread(target=write)
    writer.start()
    with (
        limit_file_size(1_000_000),
        pytest.raises(UnreadableFile, match=r"got more: split the file"),
    ):
        read_bytes(pipe)
    writer.join()


@needs_pipes
def test_a_pipe_without_a_writer_is_rejected_after_a_while(pipe, monkeypatch):
    monkeypatch.setattr(limited_reading, "WRITER_TIMEOUT_S", 0.2)
    with pytest.raises(UnreadableFile, match=r"pipe: a named pipe that no program opened"):
        read_bytes(pipe)


def test_a_hyphen_is_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"1,2\n")))
    assert read_bytes("-") == b"1,2\n"
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"1,2\n")))
    with limit_file_size(3), pytest.raises(UnreadableFile, match=r"^-: expected"):
        read_bytes("-")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none", "no such file: check the name"),
        ("file/none", "no such file: check the name"),
        (".", "a directory: name a file in it"),
        ("n" * 300, "the name is too long for a file: check it"),
        ("a\0b", "no file can have this name: check it"),
        ("loop", "a loop of symbolic links: check where they point"),
    ],
)
def test_a_name_that_is_no_file_is_rejected_with_the_remedy(tmp_path, name, message):
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for read in (read_bytes, check_readable):
        with pytest.raises(UnreadableFile, match=message):
            read(tmp_path / name)


def test_text_is_utf_8(tmp_path):
    path = tmp_path / "t"
    path.write_bytes(b"\xef\xbb\xbf19 \xc2\xb5m")
    assert read_text(path) == "19 µm"
    path.write_bytes(b"19 \xb5m")
    with pytest.raises(UnreadableFile, match="t: expected a text file in UTF-8, got byte 0xb5 at"):
        read_text(path)
    path.write_bytes(b"\x93NUMPY\x01\x00")
    with pytest.raises(UnreadableFile, match="got a NumPy array: write it with numpy"):
        read_text(path)
