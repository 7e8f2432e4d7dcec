import math

import cv2
import numpy as np
import pytest

from lsvision.sensors.camera import Camera

EXACT = 1e-9  # px: an inversion that has converged, in double precision
MATRIX = [[1100.0, 0.0, 651.3], [0.0, 1108.0, 498.7], [0.0, 0.0, 1.0]]
SIZE = (1280, 1024)
LENSES = {
    "none": [],
    "mild": [-0.12, 0.1, 0.001, -0.0007],
    "strong barrel": [-0.35, 0.12, 0.001, -0.002, -0.02],
    "pincushion": [0.3, 0.2, 0.0, 0.0, 0.1],
    "rational": [0.8, 0.3, 1e-3, -1e-3, 0.02, 1.1, 0.5, 0.04],
    "thin prism": [-0.2, 0.1, 0, 0, 0, 0, 0, 0, 3e-3, -1e-3, 2e-3, 5e-4],
    "tilted": [-0.3, 0.1, 1e-3, 1e-3, 0, 0, 0, 0, 1e-3, 0, 0, 0, math.radians(8), -0.1],
}
lenses = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())


@pytest.fixture
def pixels():
    u, v = np.meshgrid(np.linspace(0, 1279, 33), np.linspace(0, 1023, 27))
    return np.column_stack([u.ravel(), v.ravel()])


@lenses
def test_projection_agrees_with_opencv(lens, rng_points):
    camera = Camera(MATRIX, lens, SIZE)
    by_cv2, _ = cv2.projectPoints(
        rng_points, np.zeros(3), np.zeros(3), camera.matrix, np.array(lens, float)
    )
    np.testing.assert_allclose(
        camera.project(rng_points), by_cv2.reshape(-1, 2), rtol=0, atol=EXACT
    )


@pytest.fixture
def rng_points():
    rng = np.random.default_rng(4)
    return rng.uniform((-150, -120, 280), (150, 120, 400), (200, 3))


@lenses
def test_projecting_the_ray_of_a_pixel_gives_the_pixel(lens, pixels):
    camera = Camera(MATRIX, lens, SIZE)
    np.testing.assert_allclose(camera.project(camera.rays(pixels)), pixels, rtol=0, atol=EXACT)


@lenses
def test_jacobian_of_rays_is_their_difference_quotient(lens, pixels):
    camera, step = Camera(MATRIX, lens, SIZE), 0.01
    _, jacobian = camera.rays_with_jacobian(pixels)
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        quotient = (camera.rays(pixels + shift) - camera.rays(pixels - shift))[:, :2] / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, axis], quotient, rtol=1e-6, atol=1e-9)


def test_skew_shifts_u_with_y():
    camera = Camera([[1000, 5, 0], [0, 1000, 0], [0, 0, 1]], [], (10, 10))
    np.testing.assert_allclose(camera.project([[0, 1, 1]]), [[5, 1000]])
    np.testing.assert_allclose(camera.rays([[5, 1000]]), [[0, 1, 1]], atol=1e-15)


def test_lost_pixels_stay_lost():
    rays = Camera(MATRIX, LENSES["mild"], SIZE).rays([[np.nan, np.nan], [5.0, 5.0]])
    assert np.isnan(rays[0]).all()
    assert np.isfinite(rays[1]).all()


def test_pixels_beyond_the_fold_of_the_model_have_no_ray():
    # x (1 - 0.3 x^2) has its maximum 0.70 at x = 1.05: nothing is drawn beyond 0.70 f.
    camera = Camera([[100, 0, 0], [0, 100, 0], [0, 0, 1]], [-0.3, 0, 0, 0], (200, 200))
    rays = camera.rays([[69.0, 0.0], [75.0, 0.0]])
    assert np.isnan(rays[:, 0]).tolist() == [False, True]


def test_points_behind_the_camera_have_no_pixel():
    assert np.isnan(Camera(MATRIX, [], SIZE).project([[0, 0, -5.0], [0, 0, 0]])).all()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((np.transpose(MATRIX), [], SIZE), "expected a camera matrix"),
        ((np.diag([-5.0, 5.0, 1.0]), [], SIZE), "expected a camera matrix"),
        ((np.eye(4), [], SIZE), r"camera matrix of shape \(3, 3\), got \(4, 4\)"),
        ((MATRIX, [0.1, 0.2], SIZE), "finite distortion coefficients .* got 2"),
        ((MATRIX, [np.nan] * 4, SIZE), "finite distortion coefficients"),
        ((MATRIX, [], (0, 5)), "expected a size"),
        ((MATRIX, [], (640.9, 480)), r"expected a size .*, got \(640.9, 480\)"),
        ((MATRIX, [], (np.inf, 480)), r"expected a size .*, got \(inf, 480\)"),
        ((MATRIX, [], ("640", 480)), r"expected a size .*, got \('640', 480\)"),
        ((MATRIX, [], (640,)), r"expected a size .*, got \(640,\)"),
        ((MATRIX, [], (1e300, 480)), r"expected a size of 1 to 1048576 px, got 1e\+300 x 480"),
        (([[800.0, 0, 1e300], [0, 800.0, 240.0], [0, 0, 1]], [], SIZE), "no number above 1e.09"),
        ((MATRIX, [0, 1e300, 0, 0], SIZE), "no number above 1e.09 in the distortion"),
        ((np.diag([1e-300, 1e-300, 1.0]), [], SIZE), "focal length of at least 0.001 px"),
        ((MATRIX, [], (640, 480, 3)), r"expected a size .*, got \(640, 480, 3\)"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, match):
    with pytest.raises(ValueError, match=match):
        Camera(*arguments)


@pytest.mark.parametrize("huge", [1e300, -1e160, np.inf])
def test_pixels_and_points_beyond_all_images_are_lost(huge):
    camera = Camera(MATRIX, [-0.1, 0, 0, 0], SIZE)
    assert np.isnan(camera.rays([[huge, 1.0]])).all()
    assert np.isnan(camera.project([[huge, 1.0, 300.0]])).all()


def test_pixels_beyond_a_second_fold_have_no_ray():
    """x (1 - 0.4 x^2 + 0.05 x^4) falls from 0.65 at x = 1.03 and rises again from x = 1.93."""
    camera = Camera([[100, 0, 0], [0, 100, 0], [0, 0, 1]], [-0.4, 0.05, 0, 0], (400, 400))
    rays = camera.rays([[64.0, 0.0], [195.0, 0.0], [0.0, 198.0]])
    assert np.isnan(rays[:, 0]).tolist() == [False, True, True]


@pytest.mark.parametrize("lens", [[-2.0, 1.5, 0, 0], [-8.0, 0, 0, 0]])
def test_pixels_beyond_a_second_fold_near_the_axis_have_no_ray(lens):
    """The image of the first fold ends at 0.30 and 0.14 focal lengths."""
    camera = Camera([[100, 0, 0], [0, 100, 0], [0, 0, 1]], lens, (200, 200))
    rays = camera.rays([[10.0, 0.0], [35.0, 0.0], [0.0, 45.0]])
    assert np.isnan(rays[:, 0]).tolist() == [False, True, True]
    assert np.isnan(camera.rays([[35.0, 0.0]])).all()
    assert np.isnan(camera.rays([[1000.0, 0.0]])).all()
