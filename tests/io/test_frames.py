"""Frames of videos and cameras."""

import cv2
import numpy as np
import pytest

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.io import frames
from lsvision.io.frames import capture_frames, open_camera, read_frames


def written(path, levels):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, (64, 48))
    assert writer.isOpened()
    for level in levels:
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    return path


class Capture:
    """Stands in for a connected camera that sends a few frames."""

    def __init__(self, source, sent=3):
        assert source == 2
        self.left = sent

    def read(self):
        self.left -= 1
        return self.left >= 0, np.full((4, 6), max(self.left, 0), np.uint8)

    def release(self):
        pass


def test_frames_come_in_their_order(tmp_path):
    found = list(read_frames(written(tmp_path / "v.avi", (10, 120, 240))))
    assert [frame.shape for frame in found] == [(48, 64, 3)] * 3
    np.testing.assert_allclose([frame.mean() for frame in found], (10, 120, 240), atol=2)


def test_frames_are_read_one_by_one(tmp_path):
    assert next(read_frames(written(tmp_path / "v.avi", (10, 120)))).mean() < 20


def test_missing_and_broken_videos_are_rejected_by_name(tmp_path):
    with pytest.raises(UnreadableFile, match=r"gone\.avi: no such file: check the name"):
        next(read_frames(tmp_path / "gone.avi"))
    (tmp_path / "text.mp4").write_bytes(b"no video at all" * 50)
    with pytest.raises(UnreadableFile, match=r"text\.mp4 holds no frame .* save it again"):
        next(read_frames(tmp_path / "text.mp4"))


def test_a_camera_gives_as_many_frames_as_asked(monkeypatch):
    monkeypatch.setattr(frames.cv2, "VideoCapture", Capture)
    assert [frame[0, 0] for frame in capture_frames(2, 2)] == [2, 1]


@pytest.mark.parametrize("name", ["99999999999", "9" * 400])
def test_an_index_beyond_the_range_of_opencv_is_reported(name):
    with pytest.raises(LsvisionError, match="sent 0 frames: check its cable"):
        next(capture_frames(int(name)))
    with pytest.raises(LsvisionError, match=r"no such file|too long"):
        next(open_camera(name))


def test_a_camera_that_stops_or_is_not_there_is_reported(monkeypatch):
    monkeypatch.setattr(frames.cv2, "VideoCapture", Capture)
    with pytest.raises(LsvisionError, match="camera 2 sent 3 of 5 frames: check its cable"):
        list(capture_frames(2, 5))
