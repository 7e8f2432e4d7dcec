"""Blur along the line shifts it; taking that back, against images blurred by OpenCV, and pipes."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.special import ive

from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.laser_line.line import LaserLine
from lsvision.laser_line.line_blur import correct_line_blur
from lsvision.laser_line.line_shape import (
    POLYNOMIAL_COLUMNS,
    compute_line_shape,
    find_continuous_runs,
)
from lsvision.laser_line.line_spread import estimate_line_spread
from lsvision.measure import measure_cylinders
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Tube
from tests.laser_line.line_scenes import RIG, STAND_OFF, rendered
from tests.laser_line.other_pictures import Picture, photograph

BLUR = 0.8  # px
FADE = 160.0  # px
MIDDLE = slice(40, -40)
U = np.arange(400.0)
FLANK = 60 + (U - 20) ** 2 / 1200  # steeper and darker to the right
BRIGHTNESS = 200 * np.exp(-U / FADE)


def blurred_line(place=FLANK, brightness=BRIGHTNESS, blur=BLUR):
    """Noise-free image of a line, blurred along u alone, where it does harm."""
    rows = np.arange(240.0)[:, None]
    sharp = 5 + brightness * np.exp(-0.5 * ((rows - place) / 1.6) ** 2)
    return cv2.GaussianBlur(sharp, (0, 0), sigmaX=blur, sigmaY=1e-3)


def errors(line, place=FLANK):
    across = 1 if line.direction == "columns" else 0
    return (line.pixels[:, across] - place)[MIDDLE]


@pytest.mark.parametrize("turned", [False, True], ids=["columns", "rows"])
def test_a_known_blur_is_corrected(turned):
    image = blurred_line().astype(np.float32)
    image = (100 * (image.T if turned else image)).round().astype(np.uint16)
    line = extract_laser_line(image)
    before, after = errors(line), errors(correct_line_blur(line, BLUR))
    assert abs(before.mean()) > 4 * abs(after.mean())


def test_the_correction_follows_the_formula():
    line = extract_laser_line((100 * blurred_line()).round().astype(np.uint16))
    slope, bend, fall = (U - 20) / 600, 1 / 600, -1 / FADE
    expected = (BLUR**2 * (slope * fall + bend / 2))[MIDDLE]
    np.testing.assert_allclose(errors(line), expected, rtol=0, atol=2e-3)
    np.testing.assert_allclose(errors(correct_line_blur(line, BLUR)), 0, rtol=0, atol=2e-3)


def test_without_blur_nothing_is_corrected():
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    np.testing.assert_array_equal(correct_line_blur(line, 0.0).pixels, line.pixels)


def test_only_pixels_change_and_lost_points_stay_lost():
    image = blurred_line()
    image[:, 200:230] = 5
    line = extract_laser_line(image.round().astype(np.uint8))
    moved = correct_line_blur(line, BLUR)
    np.testing.assert_array_equal(np.isnan(moved.pixels), np.isnan(line.pixels))
    np.testing.assert_array_equal(moved.pixels[:, 0], line.pixels[:, 0])
    assert (moved.std[np.isfinite(line.std)] >= line.std[np.isfinite(line.std)]).all()
    for name in ("intensity", "width", "saturated"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(line, name))


def test_runs_shorter_than_the_window_are_not_corrected():
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    pixels = line.pixels.copy()
    pixels[:: POLYNOMIAL_COLUMNS - 1] = np.nan
    pieces = replace(line, pixels=pixels)
    np.testing.assert_array_equal(correct_line_blur(pieces, BLUR).pixels, pixels)


def error_of_pipe(line, picture):
    """Distance along v of each point from the true line, and which points lie on the pipe."""
    section = picture.light_section()

    def outside(pixels):
        offset = section.points_from_pixels(pixels) - picture.centre
        return offset, np.hypot(*offset.T) - picture.radius

    offset, gap = outside(line.pixels)
    by_v = (outside(line.pixels + np.array([0, 1e-3]))[1] - gap) / 1e-3
    return gap / by_v, (np.abs(offset[:, 0]) < 1.02 * picture.radius) & (np.abs(gap) < 3)


PIPES = {
    "level": Picture(psf=0.8),
    "alone": Picture(psf=0.6, wall=None, radius=23.0),
    "abrupt ends": Picture(psf=0.5, cut=0.35),
    "roll 30": Picture(psf=0.6, roll=30.0),
    "roll 45": Picture(psf=0.5, roll=45.0, cut=0.35),
    "thick sheet": Picture(psf=0.4, roll=20.0, sheet=0.3),
    "paint": Picture(psf=0.7, dark=(6.0, 10.0)),
}


@cache
def line_of(name):
    """A picture and its line without noise, of the std that usual noise would give."""
    picture = PIPES[name]
    settings = LineSettings(full_scale=255.0, read_noise=2.0, gain=0.025)
    return picture, extract_laser_line(8 + 180 * picture.light(), settings)


@pytest.mark.parametrize("name", PIPES)
@pytest.mark.parametrize("stated", [True, False], ids=["stated", "unstated"])
def test_a_pipe_is_corrected_within_what_is_said(name, stated):
    picture, raw = line_of(name)
    direction, _ = picture.light_section()._normal_in_image(raw.pixels)
    line = correct_line_blur(raw, picture.blur if stated else None, direction)
    (before, on_pipe), (after, _) = error_of_pipe(raw, picture), error_of_pipe(line, picture)
    assert np.abs(after / line.std)[on_pipe].max() < 3
    weights = line.std[on_pipe] ** -2

    def rms(errors):
        return np.sqrt(np.average(errors[on_pipe] ** 2, weights=weights))

    assert rms(after) < 0.6 * rms(before)
    assert rms(after) < 0.006


@pytest.mark.parametrize("roll", [0.0, 30.0])
@pytest.mark.parametrize("blur", [0.5, 0.9])
def test_the_blur_is_known_from_the_widths(blur, roll):
    picture = Picture(psf=blur, wall=None, roll=roll)
    line = extract_laser_line(photograph(picture.light(), np.random.default_rng(5)))
    (run,) = find_continuous_runs(line.pixels[:, 1])
    width = line.width[run]
    shape = compute_line_shape(
        line.pixels[run, 1], line.intensity[run] * width, line.std[run] / width
    )
    normal, _ = picture.light_section()._normal_in_image(line.pixels)
    spread = estimate_line_spread(width, line.std[run], shape, None, normal, None)
    # A tilt of the camera by 30 deg shows the sheet, 0.15 mm seen at 60 deg, aslant.
    sheet = 0.15 * picture.focal_length / 300.0 * np.cos(np.radians(30.0))
    aslant = sheet * np.array([-np.sin(np.radians(roll)), np.cos(np.radians(roll))])
    u, v = aslant
    truth = picture.blur**2 * np.array([1, 0, 1]) + [v * v, u * v, u * u]
    assert (np.abs(spread.values - truth) < 3 * np.sqrt(np.diag(spread.covariance))).all()
    assert np.sqrt(spread.covariance[2, 2]) < 0.15


@pytest.mark.parametrize("stated", [True, False], ids=["stated", "unstated"])
def test_a_thick_sheet_seen_along_a_steep_flank_leaves_the_radius_right(stated):
    # The sheet's blur runs along the line on one flank, where a column holds 5 px of it.
    picture = Picture(psf=0.6, roll=45.0, sheet=0.25, wall=None, radius=23.0)
    section = picture.light_section(picture.blur if stated else 0.0)
    errors = []
    for seed in range(3):
        image = photograph(picture.light(), np.random.default_rng(seed))
        (cylinder,) = measure_cylinders(section.profile(image)).cylinders
        assert abs(cylinder.radius - 23.0) < 3 * cylinder.radius_std
        errors.append(cylinder.radius - 23.0)
    assert abs(np.mean(errors)) < 0.1


@pytest.mark.parametrize("method", ["derivative", "gaussian"])
@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_a_sheet_that_is_thicker_at_the_top_leaves_the_radius_right(tilt, method):
    # The top of the pipe is nearer to the camera: without that the radius is 16 um too large.
    picture = Picture(psf=0.6, sheet=0.3, wall=None, tilt=(0.0, tilt))
    settings = LineSettings(full_scale=255.0, read_noise=2.0, gain=0.025, method=method)
    profile = picture.light_section().profile(8 + 180 * picture.light(), settings)
    (cylinder,) = measure_cylinders(profile).cylinders
    assert abs(cylinder.radius - picture.radius) < 0.005


@pytest.mark.parametrize(("seed", "blur"), [(2, 0.7), (3, 0.7), (0, 1.0), (3, 1.0)])
def test_the_std_at_a_limb_covers_the_shift_by_blur(seed, blur):
    # The line on a pipe of 75 px ends so steeply that blur shifts the end points by up to 3 px.
    tube = Tube.of(10.0, np.pi / 2, np.radians(20.0), (0.0, STAND_OFF - 10.0))
    simulated = rendered(Scene((tube,)), seed, psf_sigma=blur)
    section = LightSection(Camera(RIG.matrix, RIG.distortion, RIG.size), RIG.laser_plane)
    line = section.line(simulated.image)
    errors = (line.pixels - simulated.truth_pixels)[:, 1] / line.std
    assert np.nanmax(np.abs(errors)) < 3.2


def test_a_line_without_a_run_of_points_stays_as_it_is():
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    lost = replace(line, pixels=np.full_like(line.pixels, np.nan))
    assert correct_line_blur(lost, BLUR) is lost


def test_the_length_of_the_direction_of_the_sheet_does_not_count():
    picture = PIPES["roll 30"]
    line = extract_laser_line(photograph(picture.light(), np.random.default_rng(5)))
    direction, growth = picture.light_section()._normal_in_image(line.pixels)
    plain, longer = (correct_line_blur(line, None, k * direction, growth) for k in (1.0, 7.0))
    np.testing.assert_allclose(longer.pixels, plain.pixels, rtol=0, atol=1e-9)


@pytest.mark.parametrize("slope", [0.0, -0.0384, 0.29])
def test_a_straight_line_without_noise_is_not_shifted(slope):
    count = 40
    pixels = np.column_stack([np.arange(count), 100 + slope * np.arange(count)])
    std, light, width = np.full((3, count), [[1e-11], [100.0], [0.7]])
    saturated = np.zeros(count, dtype=bool)
    line = LaserLine(pixels, std, light, width, saturated, "columns", 0.0, 2.0)
    np.testing.assert_allclose(correct_line_blur(line, BLUR).pixels, pixels, rtol=0, atol=1e-9)


@pytest.mark.parametrize("blur", [-0.8, np.nan, np.inf])
def test_a_blur_below_zero_is_rejected(blur):
    line = extract_laser_line(blurred_line().round().astype(np.uint8))
    with pytest.raises(ValueError, match="expected blur >= 0 px, got"):
        correct_line_blur(line, blur)


def test_points_far_from_edges_by_no_column_are_all_but_the_edges():
    shape = compute_line_shape(FLANK, BRIGHTNESS, np.full(len(U), 0.01))
    assert (shape.is_far_from_edges(0) == ~shape.edge).all()


def blurred_ring(peak, radius=84.0, blur=1.2):
    """Lower half of a thin ring after an isotropic Gaussian blur, in closed form, and its place."""
    v, u = np.mgrid[:130, :220]
    distance = np.hypot(u - 110.0, v - 10.0)
    light = np.exp(-0.5 * ((distance - radius) / blur) ** 2) * ive(0, distance * radius / blur**2)
    light *= np.where(v > 20, 1 / ive(0, radius**2 / blur**2), 0.0)
    noise = np.random.default_rng(3).normal(0.0, 0.5, light.shape)
    image = np.clip(np.rint(8 + peak * light + noise), 0, 255).astype(np.uint8)
    columns = np.arange(220.0)
    with np.errstate(invalid="ignore"):
        return image, 10 + np.sqrt(radius**2 - (columns - 110) ** 2), columns - 110


@pytest.mark.parametrize("peak", [350.0, 500.0])
@pytest.mark.parametrize("method", ["derivative", "gaussian", "derivative, red"])
def test_a_line_at_full_scale_is_corrected_or_uncertain(method, peak):
    """Its blur was taken as zero, exactly: radii were off by 6 to 9 of their stds."""
    image, place, along = blurred_ring(peak)
    exact = method != "derivative, red"  # by the excess of a colour no Gaussian is fitted
    settings = LineSettings(method=method) if exact else LineSettings(channel="red")
    dark = np.full_like(image, 8)
    line = extract_laser_line(image if exact else np.dstack([dark, dark, image]), settings)
    flank = (np.abs(along) > 45) & (np.abs(along) < 62) & np.isfinite(line.pixels[:, 1])
    assert line.saturated[flank].all()
    corrected = correct_line_blur(line)
    before, after = ((x.pixels[:, 1] - place)[flank] for x in (line, corrected))
    assert abs(before.mean()) > 5 * line.std[flank].mean() / np.sqrt(len(before))
    assert abs(after.mean()) < (0.5 if exact else 0.75) * abs(before.mean())
    # The error that is left is common to all columns.
    assert abs(np.mean(after / corrected.std[flank])) < 2


@pytest.mark.parametrize("method", ["derivative", "gaussian"])
def test_the_flanks_of_a_clipped_line_are_shifted_to_the_other_side_than_its_middle(method):
    # The skewness of a curved line's section, seen by its flanks alone.
    image, place, along = blurred_ring(1500.0, blur=2.0)
    line = extract_laser_line(image, LineSettings(method=method))
    flank = (np.abs(along) > 30) & (np.abs(along) < 55)
    before, after = ((x.pixels[:, 1] - place)[flank] for x in (line, correct_line_blur(line)))
    assert abs(after.mean()) < 0.15 * abs(before.mean())


@pytest.mark.parametrize("method", ["derivative", "gaussian"])
def test_a_pipe_at_full_scale_is_measured_within_what_is_said(method):
    deviations, errors = [], []
    for tilt in ((10.0, 0.0), (15.0, 15.0), (20.0, -10.0)):
        view = {"focal_length": 1132.0, "size": (640, 512)}
        picture = Picture(psf=1.6, radius=16.0, tilt=tilt, wall=None, cut=0.15, **view)
        section = picture.light_section()
        for seed in range(3):
            image = photograph(4 * picture.light(), np.random.default_rng(seed))
            profile = section.profile(image, LineSettings(method=method))
            (cylinder,) = measure_cylinders(profile).cylinders
            errors.append(cylinder.radius - 16.0)
            deviations.append(errors[-1] / cylinder.radius_std)
    assert np.sqrt(np.mean(np.square(deviations))) < 1.3
    assert np.sqrt(np.mean(np.square(errors))) < 0.06


def test_a_lens_out_of_focus_is_told_by_the_std_of_the_radius():
    # A blur of 3 px, 6 % of the pipe's radius in the image, is corrected to the first order only.
    deviations = []
    for tilt in ((10.0, 0.0), (15.0, 15.0), (20.0, -10.0)):
        view = {"focal_length": 1132.0, "size": (640, 512)}
        picture = Picture(psf=3.0, radius=14.0, tilt=tilt, wall=None, cut=0.15, **view)
        for seed in range(3):
            image = photograph(picture.light(), np.random.default_rng(seed))
            (cylinder,) = measure_cylinders(picture.light_section().profile(image)).cylinders
            deviations.append((cylinder.radius - 14.0) / cylinder.radius_std)
    assert np.sqrt(np.mean(np.square(deviations))) < 2.0
    assert np.abs(deviations).max() < 3


def test_blur_that_is_equal_in_all_directions_does_not_shift_a_straight_ridge():
    # Located down its columns, the line is shifted towards its bright end.
    rows, columns = np.mgrid[:240.0, :400.0]
    along, across = (columns + rows) / np.sqrt(2), (rows - columns + 80) / np.sqrt(2)
    image = 800 + 2e4 * np.exp(-along / 120 - 0.5 * (across / 1.4) ** 2)
    moved = {}
    for method in ("derivative", "steger"):
        settings = LineSettings(method=method, direction="columns")
        line = extract_laser_line(image.round().astype(np.uint16), settings)
        errors = ((line.pixels[:, 1] - line.pixels[:, 0] + 80) / np.sqrt(2))[100:-140]
        corrected = correct_line_blur(line, 1.4, (0.0, 0.0))
        moved[method] = np.nanmean(corrected.pixels[100:-140, 1] - line.pixels[100:-140, 1])
        assert line.is_ridge == (method == "steger")
        if line.is_ridge:
            assert abs(np.nanmean(errors)) < 1e-3
    assert abs(moved["derivative"]) > 5e-3
    assert abs(moved["steger"]) < 5e-4


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (15.0, 15.0), (20.0, -10.0)])
def test_the_radius_of_a_pipe_by_its_ridge_is_unbiased(tilt):
    picture = Picture(psf=0.8, radius=20.0, tilt=tilt, wall=None, cut=0.15)
    section, errors = picture.light_section(), []
    for seed in range(3):
        image = photograph(picture.light(), np.random.default_rng(seed))
        profile = section.profile(image, LineSettings(method="steger"))
        (cylinder,) = measure_cylinders(profile).cylinders
        errors.append(cylinder.radius - 20.0)
    assert abs(np.mean(errors)) < 0.02
