"""`lsvision measure` and `lsvision line` on images, videos and a camera."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.special import erf

from lsvision.calibration.board_in_plane import calibrate_board_in_plane
from lsvision.calibration.target import Chessboard
from lsvision.io import frames
from lsvision.io.frames import read_frames
from lsvision.io.images import read_image
from lsvision.laser_line.extraction import extract_laser_line

REPOSITORY = Path(__file__).parents[2]
IMAGES = REPOSITORY / "fixtures" / "images"
RIG = ("--light-section", IMAGES / "rig.json")
REAL = REPOSITORY.parent / "shared" / "real"
FOUR_SIGMA = 4
CORE_RADIUS, CORE_RADIUS_ERROR = 23.75, 0.35  # mm; the photo's author measured 47.5 +/- 0.7 across
needs_real = pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not here")


def radii(rows, result):
    assert result.exit_code == 0, result.output
    return [tuple(map(float, row[1].split(" ± "))) for row in rows(result)]


def error_line(result):
    """The one line that a failure is."""
    assert result.exit_code == 1, result.output
    (line,) = result.stderr.splitlines()
    assert "Traceback" not in line
    return line


def saved(path, image):
    cv2.imwrite(str(path), image)
    return path


@pytest.fixture
def single():
    return read_image(IMAGES / "single.png")


def test_the_pair_is_measured_and_drawn_into_the_photo(run, rows, tmp_path):
    plot = tmp_path / "pair.png"
    result = run("measure", IMAGES / "pair.png", *RIG, "--plot", plot)
    for (radius, sigma), true in zip(radii(rows, result), (16, 20), strict=True):
        assert abs(radius - true) < FOUR_SIGMA * sigma
    assert "image, line along columns, 7 of 800 points lost" in result.stdout
    assert read_image(plot).shape == (1500, 1300, 3)


def test_a_laser_off_frame_takes_the_second_line_away(run, rows):
    alone = run("measure", IMAGES / "clutter.png", *RIG)
    assert "a second line runs through" in alone.stdout
    dark = run("measure", IMAGES / "clutter.png", *RIG, "--laser-off",
               IMAGES / "clutter_laser_off.png")  # fmt: skip
    assert "second line" not in dark.stdout
    ((_, before),), ((radius, after),) = radii(rows, alone), radii(rows, dark)
    assert after < 0.8 * before  # the second line hides points, and blurs those beside it
    assert abs(radius - 18) < FOUR_SIGMA * after


def test_images_and_profiles_go_through_one_command(run, single, tmp_path):
    folder, out = tmp_path / "shots", tmp_path / "all.json"
    folder.mkdir()
    for name in ("10.png", "2.png"):
        saved(folder / name, single)
    (folder / "README.md").write_text("no source")
    profile = REPOSITORY / "fixtures" / "single.csv"
    result = run("measure", folder, profile, *RIG, "--json", out)
    assert result.exit_code == 0, result.output
    records = json.loads(out.read_text())["measurements"]
    assert [Path(record["source"]).name for record in records] == ["2.png", "10.png", "single.csv"]
    assert [len(record["cylinders"]) for record in records] == [1, 1, 1]


def test_one_bad_image_does_not_stop_the_rest(run, rows, tmp_path):
    dark = saved(tmp_path / "dark.png", np.full((600, 800), 9, np.uint8))
    result = run("measure", dark, IMAGES / "single.png", *RIG)
    assert result.exit_code == 1
    assert len(rows(result)) == 1
    first, last = result.stderr.splitlines()
    assert "dark.png: no laser line" in first
    assert "1 of 2 could not be measured" in last


def test_colours_are_taken_by_the_lasers(run, rows, single, tmp_path):
    red = cv2.merge([np.full_like(single, 10), np.full_like(single, 10), single])
    result = run("measure", saved(tmp_path / "red.png", red), *RIG, "--laser", "red")
    ((radius, sigma),) = radii(rows, result)
    assert abs(radius - 25) < FOUR_SIGMA * sigma


def test_a_raw_mosaic_is_measured_by_the_lasers_pixels(run, rows, single, tmp_path):
    raw = np.full_like(single, 10)
    raw[::2, ::2] = single[::2, ::2]
    file = saved(tmp_path / "raw.png", raw)
    ((radius, sigma),) = radii(
        rows, run("measure", file, *RIG, "--laser", "red", "--bayer", "rggb")
    )
    assert abs(radius - 25) < FOUR_SIGMA * sigma
    assert "400 columns" in run("line", file, "--laser", "red", "--bayer", "RGGB").stdout
    assert "name its pattern (--bayer RGGB)" in error_line(run("line", file, "--laser", "red"))


def test_a_line_thinner_than_a_pixel_is_noted(run, single, tmp_path):
    line = extract_laser_line(single)
    places = np.nan_to_num(line.pixels[:, 1], nan=-99.0)
    edges = np.arange(single.shape[0] + 1)[:, None] - 0.5 - places
    notes = {}
    for sigma in (0.1, 0.6):
        light = np.diff(erf(edges / (np.sqrt(2) * sigma)), axis=0)
        thin = saved(tmp_path / "thin.png", (10 + 180 * light / light.max()).astype(np.uint8))
        notes[sigma] = "thinner than a pixel" in run("measure", thin, *RIG).stdout
    assert notes == {0.1: True, 0.6: False}


def test_sixteen_bits_are_measured_like_eight(run, rows, single, tmp_path):
    deep = saved(tmp_path / "deep.png", single.astype(np.uint16) * 16)
    ((radius, sigma),) = radii(rows, run("measure", deep, *RIG))
    assert abs(radius - 25) < FOUR_SIGMA * sigma


def test_roughness_of_the_surface_widens_the_result(run, rows):
    words = ("measure", IMAGES / "single.png", *RIG)
    ((_, smooth),) = radii(rows, run(*words))
    ((_, rough),) = radii(rows, run(*words, "--surface-std", "0.05"))
    assert rough > 2 * smooth


@pytest.fixture
def video(single, tmp_path):
    """Two frames of the pipe and one of nothing between them."""
    path = tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, single.shape[::-1])
    for image in (single, np.full_like(single, 10), single):
        writer.write(cv2.merge([image] * 3))
    writer.release()
    return path


def test_a_video_is_measured_frame_by_frame(run, rows, video, tmp_path):
    result = run("measure", video, *RIG, "--plot", tmp_path / "p.png", "--laser", "white")
    assert len(radii(rows, result)) == 2
    assert "1 of 3 frames contain no laser line" in result.stdout
    assert "frame 2:" in result.stdout
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["p-0.png", "p-2.png"]


def test_a_grey_video_needs_no_laser_colour(run, rows, video, tmp_path):
    """Its frames have colours by the rounding of motion JPEG."""
    (_, dark, _) = read_frames(video)
    cv2.imwrite(str(tmp_path / "dark.png"), dark)
    for more in ((), ("--laser-off", tmp_path / "dark.png")):
        result = run("measure", video, *RIG, *more)
        assert len(radii(rows, result)) == 2, result.output


def test_a_video_in_colours_needs_one(run, single, tmp_path):
    path = tmp_path / "red.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, single.shape[::-1])
    writer.write(cv2.merge([single // 4, single // 4, single]))
    writer.release()
    assert "red.avi: it has colours" in run("measure", path, *RIG).stderr


def test_only_so_many_frames_are_taken(run, rows, video):
    result = run("measure", video, *RIG, "--frames", 1, "--laser", "white")
    assert len(radii(rows, result)) == 1


def test_a_live_camera_is_measured(run, rows, single, monkeypatch):
    class Capture:
        def __init__(self, index):
            assert index == 1

        def read(self):
            return True, single

        def release(self):
            pass

    monkeypatch.setattr(frames.cv2, "VideoCapture", Capture)
    result = run("measure", "--camera", 1, "--frames", 2, *RIG)
    assert "camera-1: 2 frames" in result.stdout
    assert len(radii(rows, result)) == 2


def test_an_image_without_a_rig_names_the_option(run, tmp_path):
    assert "single.png: an image needs the rig that took it, --light-section" in error_line(
        run("measure", IMAGES / "single.png")
    )
    saved(tmp_path / "a.png", np.zeros((99, 99), np.uint8))
    assert "only images: if they show a laser line, measure them" in run("measure", tmp_path).stderr


BAD = {
    "another size": (np.zeros((480, 640), np.uint8), (), "640 x 480 px and the rig's camera 800"),
    "no line": (np.full((600, 800), 10, np.uint8), (), "no laser line"),
    "all saturated": (np.full((600, 800), 255, np.uint8), (), "shorten the exposure"),
    "colour as grey": (np.full((600, 800, 3), (9, 8, 200), np.uint8), (), "name the laser"),
    "grey as colour": (np.zeros((600, 800), np.uint8), ("--laser", "red"), "leave --laser red out"),
}  # fmt: skip


@pytest.mark.parametrize(("image", "options", "words"), BAD.values(), ids=BAD.keys())
def test_a_bad_image_is_rejected_by_name_with_what_to_do(run, tmp_path, image, options, words):
    line = error_line(run("measure", saved(tmp_path / "bad.png", image), *RIG, *options))
    assert f"{tmp_path / 'bad.png'}: " in line
    assert words in line


def test_a_line_at_the_border_is_rejected(run, single, tmp_path):
    rows = np.arange(600)[:, None]
    border = 10 + 180 * np.exp(-0.5 * (rows / 1.2) ** 2) * np.ones(800)
    line = error_line(run("measure", saved(tmp_path / "b.png", border.astype(np.uint8)), *RIG))
    assert "b.png: " in line
    assert "border" in line


def test_what_is_no_image_is_rejected(run, tmp_path):
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "text.mp4").write_text("no video")
    assert "text.png is not an image of 8 or 16 bit" in error_line(
        run("measure", tmp_path / "text.png", *RIG)
    )
    assert "holds no frame" in error_line(run("measure", tmp_path / "text.mp4", *RIG))
    assert "gone.png: no such file" in error_line(run("measure", tmp_path / "gone.png", *RIG))


def test_a_laser_off_frame_that_does_not_fit_is_rejected(run, single, tmp_path):
    words = ("measure", IMAGES / "single.png", *RIG, "--laser-off")
    small = saved(tmp_path / "small.png", single[::2, ::2])
    assert "small.png: the laser-off frame is 400 x 300 px" in error_line(run(*words, small))
    deep = saved(tmp_path / "deep.png", single.astype(np.uint16))
    assert "expected a laser_off frame like the image" in error_line(run(*words, deep))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distance": 0.0}, "rig.json: the laser plane passes 0 mm from the camera's centre"),
        ({"normal": [0.0, 1.0, 0.0]}, "rig.json: the laser plane is parallel to the optical axis"),
    ],
)
def test_a_useless_rig_is_rejected_by_name(run, tmp_path, change, words):
    values = json.loads((IMAGES / "rig.json").read_text())
    values["laser_plane"].update(change)
    (tmp_path / "rig.json").write_text(json.dumps(values))
    rig = ("--light-section", tmp_path / "rig.json")
    assert words in error_line(run("measure", IMAGES / "single.png", *rig))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--laser", "pink"), "expected --laser among grey, red, green, blue, white, got 'pink'"),
        (
            ("--laser", "red", "--bayer", "RGB"),
            "expected --bayer among RGGB, BGGR, GRBG, GBRG, got 'RGB'",
        ),
        (("--bayer", "RGGB"), "expected --laser red, green or blue beside --bayer"),
        (
            ("--method", "guess"),
            "expected --method among derivative, gaussian, steger, got 'guess'",
        ),
        (("--surface-std", "-1"), "--surface-std"),
        (("--surface-std", "inf"), "Invalid value for '--surface-std': "),
        (("--frames", "0"), "--frames"),
        (("--frames", "3"), "expected a video or --camera with --frames, got none"),
        (("--surface-std", "1", "--sensor", "lps36"), "expected --surface-std, or --paper, --sen"),
        (("--units", "um"), "expected profiles with options for reading them, such as --un"),
    ],
)
def test_a_slip_in_an_option_is_a_usage_error(run, options, words):
    result = run("measure", IMAGES / "single.png", *RIG, *options)
    assert result.exit_code == 2
    assert words in result.stderr


def test_line_shows_writes_and_sums_up_the_extraction(run, tmp_path):
    plot, table = tmp_path / "line.png", tmp_path / "line.csv"
    result = run("line", IMAGES / "single.png", "--plot", plot, "--csv", table)
    assert result.exit_code == 0, result.output
    assert "single.png: 800 columns, 5 lost, std 0.011 px" in result.stdout
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    truth = json.loads((IMAGES / "single.truth.json").read_text())["line_v_px"]
    off = np.abs(rows[:, 1] - np.array(truth, dtype=float))
    assert np.nanmedian(off) < 0.02
    assert np.isnan(rows[:, 1]).sum() == 5
    assert read_image(plot).shape[1:] == (1295, 3)


def test_line_rejects_by_name(run, tmp_path):
    dark = saved(tmp_path / "dark.png", np.full((99, 99), 9, np.uint8))
    assert "dark.png: no laser line" in error_line(run("line", dark))
    assert "leave --laser red out" in error_line(
        run("line", IMAGES / "single.png", "--laser", "red")
    )


@needs_real
@pytest.mark.parametrize("tilt", ["0", "0:2"])
def test_the_drill_core_is_found_and_its_clutter_rejected(run, rows, tmp_path, tilt):
    """Square to the laser plane: the arc is too short for a free ellipse.

    Two sets of points fit nearly as well, with and without the rough right flank: 23.26 and 23.50
    mm. The release of OpenCV decides between them; both agree with the author's calliper.
    """
    core = REAL / "drill-core"
    board = read_image(core / "checkerboard_in_laser_plane.jpg")
    rig = tmp_path / "rig.json"
    calibrate_board_in_plane(board, Chessboard(6, 6, 16.0)).light_section.save(rig)
    result = run("measure", core / "cylinder_with_laser.jpg", "--light-section", rig, "--laser",
                 "red", "--radius", "10:60", "--known-phi-deg", tilt,
                 "--json", tmp_path / "core.json")  # fmt: skip
    assert len(radii(rows, result)) == 1
    (record,) = json.loads((tmp_path / "core.json").read_text())["measurements"]
    (found,) = record["cylinders"]
    low, high = found["radius_interval_95_mm"]
    assert low - CORE_RADIUS_ERROR < CORE_RADIUS < high + CORE_RADIUS_ERROR
    # Without the tilt 18.7 to 24.1 mm.
    assert high - low < 1.2


@needs_real
def test_real_stripes_are_found_and_daylight_has_none(run):
    for number in range(6):
        image = REAL / "green-stripe" / f"{number}_right.jpg"
        assert "480 rows" in run("line", image, "--laser", "green").stdout
    stripe = REAL / "etna" / "data_calib4" / "frame0004.png"
    assert "1024 rows, 1 lost" in run("line", stripe, "--laser", "white").stdout
    for name in ("left01", "left09", "right05"):
        line = error_line(run("line", REAL / "opencv-samples" / f"{name}.jpg"))
        assert f"{name}.jpg: no laser line" in line


def test_a_rig_without_an_image_is_a_usage_error(run, written, pipe):
    result = run("measure", written(pipe), *RIG)
    assert result.exit_code == 2
    assert "expected images with --light-section, got profiles only" in result.stderr


@pytest.mark.parametrize(
    "option",
    [("--laser", "red"), ("--method", "steger"), ("--surface-std", 0.1), ("--frames", 3)],
)
def test_options_of_images_do_not_vanish_without_a_rig(run, written, pipe, option):
    result = run("measure", written(pipe), *option)
    assert result.exit_code == 2
    assert f"expected --light-section RIG.json with {option[0]}, got none" in result.stderr
