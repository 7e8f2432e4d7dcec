"""Simulated images compared with independent computations of geometry and optics."""

import math

import cv2
import numpy as np
import pytest
from scipy.special import erf

from lsvision.geometry import Pose
from lsvision.simulate.image_effects import ImageSensor, StrayLight, expose, simulate_speckle_field
from lsvision.simulate.images import ImageSettings, simulate_image
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Prism, Tube
from tests.laser_line.line_scenes import (
    ACROSS,
    RIG,
    SMALL_RIG,
    STAND_OFF,
    nothing,
    pipe_on_floor,
    plank,
    rendered,
)

SAMPLED = 1e-3  # px: the truth is interpolated between samples a third of a pixel apart
QUIET = ImageSensor(full_well=1e9, read_noise=0.0, prnu=0.0)
DARK = StrayLight(ambient=0.0)


def in_camera(rig, points):
    """Project section points to pixels by OpenCV."""
    solid = np.column_stack([points, np.zeros(len(points))])
    pixels, _ = cv2.projectPoints(
        rig.camera_from_section.apply(solid), np.zeros(3), np.zeros(3), rig.matrix, rig.distortion
    )
    return pixels.reshape(-1, 2)


def test_truth_is_where_opencv_projects_the_section():
    rig = ImagingRig.triangulating(distortion=(-0.25, 0.1, 1e-3, -5e-4, 0.02))
    truth = rendered(plank(slope=0.1), rig=rig).truth_pixels
    x = np.linspace(-110.0, 110.0, 4000)
    seen = in_camera(rig, np.column_stack([x, STAND_OFF + 0.1 * x]))
    v = np.interp(truth[50:-50, 0], seen[:, 0], seen[:, 1])
    np.testing.assert_allclose(truth[50:-50, 1], v, rtol=0, atol=SAMPLED)


def test_truth_on_a_pipe_lies_on_its_section():
    pipe = Tube.of(radius=25.0, theta=math.pi / 2, phi=0.4, centre=(3.0, STAND_OFF - 25))
    truth = rendered(Scene((pipe,))).truth_pixels
    truth = truth[np.isfinite(truth[:, 1])]
    rays = RIG.compute_rays(truth)
    depth = -rays.origins[:, 2] / rays.directions[:, 2]
    points = rays.origins + depth[:, None] * rays.directions
    off = pipe.cylinder.signed_distances(points)
    np.testing.assert_allclose(off[5:-5], 0, rtol=0, atol=1e-3)


def test_centroid_of_a_noise_free_line_is_the_truth():
    image = rendered(plank(slope=0.02), sensor=QUIET, stray=DARK)
    v = np.arange(1024)[:, None]
    light = image.image.astype(float)
    centroid = (light * v).sum(axis=0) / light.sum(axis=0)
    error = centroid - image.truth_pixels[:, 1]
    assert abs(error).max() < 0.05  # whole numbers of grey: 0.3 DN in each of a dozen pixels
    assert abs(error.mean()) < 0.001


def test_width_is_that_of_sheet_and_lens():
    image = rendered(plank(slope=0.0), sensor=QUIET, stray=DARK)
    v = np.arange(1024)
    column = image.image[:, 640].astype(float)
    centre = (column * v).sum() / column.sum()
    sigma = math.sqrt((column * (v - centre) ** 2).sum() / column.sum())
    on_sensor = 0.12 * 2264 / (300 * math.cos(math.radians(30)))
    # The lens's blur, and that of the pixel itself.
    assert sigma == pytest.approx(math.sqrt(on_sensor**2 + 0.7**2 + 1 / 12), abs=0.03)


def test_brightness_decreases_with_the_cosine_of_incidence():
    image = rendered(pipe_on_floor(phi=0.0), sensor=QUIET, stray=DARK, psf_sigma=0.0)
    heights = image.image.max(axis=0).astype(float)
    seen = np.isfinite(image.truth_pixels[:, 1])
    middle, flank = heights[640], heights[640 + 120]
    assert seen[640 + 120]
    assert 0.3 * middle < flank < 0.9 * middle


def test_a_wall_hides_the_line_from_the_camera_and_from_the_laser():
    wall = Prism([[60.0, STAND_OFF], [60.0, STAND_OFF + 60.0]], along=(0, 0, 1))
    floor = Prism([[-500.0, STAND_OFF], [500.0, STAND_OFF]], ACROSS)
    shaded = rendered(Scene((floor, wall))).truth_pixels[:, 1]
    assert np.isnan(shaded).sum() > 20
    assert np.isfinite(shaded[:600]).all()


def test_a_scene_beside_the_sheet_yields_an_image_without_a_line():
    image = rendered(nothing())
    assert np.isnan(image.truth_pixels[:, 1]).all()
    assert image.image.max() < 30


def test_the_laser_off_image_differs_by_the_line_only():
    stray = StrayLight(ambient=20, streaks=5, blobs=5)
    image = rendered(plank(), sensor=QUIET, stray=stray, peak=50)
    rows, _ = np.nonzero(image.image.astype(int) - image.laser_off > 1)
    assert np.ptp(rows) < 80  # 40 px of slope and the line's own width


def test_the_same_seed_yields_the_same_bytes():
    settings = {"rig": SMALL_RIG, "speckle_looks": 2, "glints": 3}
    first, again = (rendered(pipe_on_floor(), 5, **settings) for _ in range(2))
    other = rendered(pipe_on_floor(), 6, **settings)
    np.testing.assert_array_equal(first.image, again.image)
    assert (first.image != other.image).any()


def test_glints_saturate_the_line_and_do_not_change_the_truth():
    plain, shining = (rendered(plank(), glints=count) for count in (0, 5))
    assert (shining.image == 255).sum() > (plain.image == 255).sum() + 20
    np.testing.assert_array_equal(plain.truth_pixels, shining.truth_pixels)


def test_twelve_bits_fill_a_uint16():
    sensor = ImageSensor(bits=12)
    image = rendered(plank(), rig=SMALL_RIG, sensor=sensor, peak=9000.0).image
    assert image.dtype == np.uint16
    assert image.max() == 4095


def test_noise_is_that_of_the_sensor(rng):
    sensor = ImageSensor(full_well=10_000, read_noise=13, prnu=0.01)
    flat = np.full((400, 400), 120.0)
    image = expose(flat, sensor.draw_sensitivity(flat.shape, rng), sensor, rng).astype(float)
    per_number = 10_000 / 255
    shot_and_read = (120 * per_number + 13**2) / per_number**2
    expected = math.sqrt(shot_and_read + (0.01 * 120) ** 2 + 1 / 12)
    assert image.std() == pytest.approx(expected, rel=0.01)
    assert image.mean() == pytest.approx(120, abs=0.05)


@pytest.mark.parametrize("looks", [1, 4])
def test_speckle_has_its_contrast_and_width(looks, rng):
    field = simulate_speckle_field((400, 400), looks, 3.0, rng=rng)
    assert field.std() == pytest.approx(1 / math.sqrt(looks), rel=0.08)  # pixels average a little
    shifted = np.mean((field[:, :-3] - 1) * (field[:, 3:] - 1)) / field.var()
    # A Gaussian of 3 px FWHM, wider by the pixels' own correlation (a triangle, 1 / 6 px^2).
    wide = (3.0 / 2.3548) ** 2 + 1 / 6
    assert shifted == pytest.approx(math.exp(-(3.0**2) / (2 * wide)), abs=0.03)


REJECTED = {
    "no light": (lambda: ImageSettings(peak=0.0), "positive peak"),
    "blur": (lambda: ImageSettings(psf_sigma=-1.0), "psf_sigma >= 0"),
    "infinite": (lambda: ImageSettings(peak=np.inf), "positive peak, got inf"),
    "reversed": (lambda: StrayLight(brightness=(300.0, 100.0)), "smallest, largest"),
    "bits": (lambda: ImageSensor(bits=7), "8 to 16 bits, got 7"),
    "well": (lambda: ImageSensor(full_well=0), "full_well > 0"),
    "dark": (lambda: StrayLight(ambient=1.0, gradient=2.0), "light is never negative"),
    "streaks": (lambda: StrayLight(streaks=-1), "counts >= 0"),
    "angle": (lambda: ImagingRig.triangulating(angle=0.0), "triangulation angle"),
    "lens": (lambda: ImagingRig.triangulating(distortion=np.zeros(8)), "up to 5 distortion"),
    "size": (
        lambda: ImagingRig(matrix=np.eye(3), size=(0, 5), camera_from_section=Pose()),
        "width, height",
    ),
    "looks": (
        lambda: simulate_speckle_field((4, 4), 0, 1.5, rng=np.random.default_rng(1)),
        "at least one look",
    ),
}


@pytest.mark.parametrize(("make", "message"), REJECTED.values(), ids=REJECTED.keys())
def test_invalid_settings_raise_errors(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_default_settings_render():
    image = simulate_image(plank(), SMALL_RIG, rng=np.random.default_rng(1))
    assert image.image.shape == (320, 640)
    assert image.image.dtype == np.uint8


def test_no_pixel_has_a_negative_sensitivity(rng):
    sensor = ImageSensor(prnu=0.5)
    sensitivity = sensor.draw_sensitivity((200, 200), rng)
    assert sensitivity.min() == 0
    assert expose(np.full((200, 200), 100.0), sensitivity, sensor, rng).min() == 0


@pytest.mark.parametrize("blur", [0.35, 0.5])
def test_a_narrow_blur_precedes_the_sampling_by_the_pixels(blur):
    """The section in a column is a Gaussian that each pixel integrates, at any place in a pixel."""
    settings = {"sheet_sigma": 0.04, "psf_sigma": blur, "sensor": QUIET, "stray": DARK}
    simulated = rendered(plank(), peak=200.0, **settings)
    sheet = 0.04 * 2264 / (300 * math.cos(math.radians(30)))
    rows = np.arange(simulated.image.shape[0])
    deviations = []
    for column in range(400, 440):
        place = simulated.truth_pixels[column, 1]
        section = simulated.image[:, column] / simulated.image[:, column].sum()
        sigma = math.hypot(sheet, blur)
        edges = (np.append(rows, rows[-1] + 1) - 0.5 - place) / (math.sqrt(2) * sigma)
        deviations.append(np.abs(section - 0.5 * np.diff(erf(edges))).max())
    assert max(deviations) < 0.02
