"""An output file is written whole or not at all."""

import os
from pathlib import Path

import pytest

from lsvision.errors import UnwritableFile
from lsvision.files.atomic_files import write_atomic


def test_text_and_bytes_are_written_as_they_are(tmp_path):
    write_atomic(tmp_path / "text", "r = 19 µm\r\n")
    write_atomic(tmp_path / "bytes", b"\x00\xff")
    assert (tmp_path / "text").read_bytes() == "r = 19 µm\r\n".encode()
    assert (tmp_path / "bytes").read_bytes() == b"\x00\xff"


def test_an_old_file_is_replaced_and_keeps_its_permissions(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("a long old content")
    path.chmod(0o640)
    write_atomic(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_new_file_gets_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_text("")
    write_atomic(tmp_path / "whole", "")
    assert (tmp_path / "whole").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_atomic(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    path.write_text("old")

    def disk_is_full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", disk_is_full)
    with pytest.raises(UnwritableFile, match=r"result.json: cannot be written \(No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not Path("/dev/null").exists(), reason="no such device here")
def test_a_device_is_written_to_not_replaced():
    write_atomic("/dev/null", "gone")
    assert not Path("/dev/null").is_file()


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="no such folder here")
def test_standard_output_may_be_a_pipe():
    reader, writer = os.pipe()
    write_atomic(f"/dev/fd/{writer}", "{}")
    os.close(writer)
    with os.fdopen(reader) as file:
        assert file.read() == "{}"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "a directory: name a file in it"),
        ("none/result.json", "its folder does not exist: create it first, or name another"),
        ("file/result.json", "its folder does not exist"),
        ("a\0b", r"cannot be written \(embedded null byte\): name another file"),
    ],
)
def test_a_path_that_takes_no_file_is_rejected_with_the_remedy(tmp_path, name, message):
    (tmp_path / "file").write_text("")
    with pytest.raises(UnwritableFile, match=message):
        write_atomic(f"{tmp_path}/{name}", "content")


def test_a_folder_without_permission_is_named(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", fail)
    with pytest.raises(UnwritableFile, match="no permission to write there: name another folder"):
        write_atomic(tmp_path / "result.json", "content")


def test_a_loop_of_links_is_rejected(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(UnwritableFile, match="a loop of symbolic links"):
        write_atomic(tmp_path / "loop", "content")


def test_the_longest_name_is_written(tmp_path):
    for name in ("n" * 255, "µ" * 127):
        write_atomic(tmp_path / name, "content")
        assert (tmp_path / name).read_text() == "content"


def test_text_that_is_no_utf_8_is_escaped(tmp_path):
    write_atomic(tmp_path / "a", "\udcff")
    assert (tmp_path / "a").read_bytes() == b"\\udcff"
