"""`lsvision calibrate capture`, with a video or a fake GenICam camera in place of a real one."""

import importlib.util
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from lsvision.errors import LsvisionError
from lsvision.io.frames import open_camera
from lsvision.io.images import read_image

EXAMPLE = Path(__file__).parents[2] / "calibration" / "example"
PAIRS = 3


def video_of(path, numbers):
    """A lossless video: for each number an empty view, a board held still, its laser line."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 10, (640, 480))
    for number in numbers:
        board = read_image(EXAMPLE / "boards" / f"board_{number:02d}.jpg")
        line = read_image(EXAMPLE / "lines" / f"line_{number:02d}.jpg")
        for image in (np.full_like(board, 90), board, board, line):
            writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return video_of(tmp_path_factory.mktemp("video") / "session.avi", range(PAIRS))


def words(tmp_path, video, pairs=PAIRS):
    return ("calibrate", "capture", "--camera", video, "--boards", tmp_path / "boards",
            "--lines", tmp_path / "lines", "--pairs", pairs)  # fmt: skip


def test_pairs_are_taken_and_serve_the_calibration(run, video, tmp_path):
    done = run(*words(tmp_path, video))
    assert done.exit_code == 0, done.output
    assert "pair 1 taken: move the board" in done.stdout
    assert "missing: 2 more; board into the image's" in done.stdout
    assert f"{PAIRS} of {PAIRS} pairs" in done.stdout
    names = sorted(path.name for path in tmp_path.rglob("*.png"))
    assert names == [f"{kind}_{k:02d}.png" for kind in ("board", "line") for k in range(PAIRS)]
    camera, rig = tmp_path / "camera.json", tmp_path / "rig.json"
    assert run("calibrate", "camera", tmp_path / "boards", "--out", camera).exit_code == 0
    found = run("calibrate", "laser-plane", "--boards", tmp_path / "boards", "--lines",
                tmp_path / "lines", "--camera", camera, "--out", rig)  # fmt: skip
    assert f"laser plane from {PAIRS} of {PAIRS} poses" in found.stdout


def test_a_raw_stream_is_judged_by_the_lasers_own_pixels(run, video, tmp_path):
    done = run(*words(tmp_path, video), "--laser", "red", "--bayer", "RGGB")
    assert done.exit_code == 0, done.output
    assert f"{PAIRS} of {PAIRS} pairs" in done.stdout
    without = run(*words(tmp_path / "other", video), "--laser", "red")
    assert without.exit_code == 1


def test_a_stream_that_ends_early_says_what_is_missing(run, video, tmp_path):
    done = run(*words(tmp_path, video, PAIRS + 2))
    assert done.exit_code == 1
    assert f"{PAIRS} of {PAIRS + 2} pairs" in done.stdout
    assert "ended early; still missing: 2 more; board into" in done.stderr
    assert len(list((tmp_path / "boards").iterdir())) == PAIRS


def test_images_of_before_are_not_mixed_with_new_ones(run, video, tmp_path):
    folder = tmp_path / "lines"
    folder.mkdir()
    (folder / "line_07.png").write_bytes(b"x")
    done = run(*words(tmp_path, video))
    assert done.exit_code == 1
    assert f"{folder} holds images (line_07.png): name a folder that is new or empty" in done.stderr
    assert not (tmp_path / "boards").exists()


def test_a_folder_that_cannot_be_made_is_named(run, video, tmp_path):
    (tmp_path / "boards").write_text("a file")
    done = run(*words(tmp_path, video))
    assert done.exit_code == 1
    assert f"{tmp_path / 'boards'}: a file: name a folder that is new or empty" in done.stderr
    assert not done.stdout  # before the first picture is taken
    done = run(*words(tmp_path, video), "--boards", tmp_path / "boards" / "in a file")
    assert done.exit_code == 1
    assert "in a file: Not a directory: name a folder that can be created" in done.stderr


def test_boards_and_lines_are_not_mixed_in_one_folder(run, video, tmp_path):
    done = run(*words(tmp_path, video), "--lines", tmp_path / "x" / ".." / "boards")
    assert done.exit_code == 2
    assert "expected different folders for --boards and --lines" in done.stderr


@pytest.mark.parametrize(
    ("more", "message"),
    [(("--laser", "pink"), "--laser"), (("--target", "chessboard"), "--counts"),
     (("--pairs", 1), "--pairs")],
)  # fmt: skip
def test_slips_in_options_are_usage_errors(run, video, tmp_path, more, message):
    done = run(*words(tmp_path, video), *more)
    assert done.exit_code == 2
    assert message in done.stderr


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("97", "camera 97 sent 0 frames: check its cable"),
        ("none.avi", "none.avi"),
        (__file__, "frame"),
    ],
)
def test_a_camera_that_is_not_there_is_named(camera, message):
    with pytest.raises(LsvisionError, match=message):
        next(open_camera(camera))


def test_genicam_without_its_package_is_rejected_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "viva_genicam", None)
    with pytest.raises(LsvisionError, match=r"pip install 'lsvision\[genicam\]'"):
        next(open_camera("genicam:127.0.0.1"))


needs_genicam = pytest.mark.skipif(
    importlib.util.find_spec("viva_genicam") is None, reason="viva-genicam is not installed"
)


@needs_genicam
def test_frames_of_a_genicam_camera_arrive_whole():
    from viva_genicam.testing import FakeGigeCamera

    with FakeGigeCamera(width=640, height=480, fps=20, pixel_format="Mono8"):
        frames = open_camera("genicam:127.0.0.1")
        shapes = [next(frames).shape for _ in range(3)]
        frames.close()
    assert shapes == [(480, 640)] * 3


@needs_genicam
def test_a_genicam_camera_that_is_not_there_is_named():
    with pytest.raises(LsvisionError, match=r"one GenICam camera at 127\.9\.9\.9, found"):
        next(open_camera("genicam:127.9.9.9"))
