import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lsvision import Ellipse
from lsvision.geometry import orthogonal_residuals, radial_residuals
from lsvision.geometry.ellipse import find_foot_points
from tests.alike import assert_same_ellipse
from tests.strategies import PROPERTY, angles, ellipses, seeds
from tests.tolerances import BRUTE_FORCE, MACHINE, ROUNDING

TILTED = Ellipse((3.0, -400.0), 20.0, 15.0, math.radians(30))


def paper_eq_1(x, y, ellipse):
    """Left side of the paper's Eq. (1) as printed."""
    dx, dy = x - ellipse.centre[0], y - ellipse.centre[1]
    sin, cos = math.sin(ellipse.theta), math.cos(ellipse.theta)
    a, b = ellipse.semi_major, ellipse.semi_minor
    return (dx * sin - dy * cos) ** 2 / a**2 + (dx * cos + dy * sin) ** 2 / b**2


def paper_eq_4(x, y, ellipse):
    """The paper's r_j as printed."""
    dx, dy = x - ellipse.centre[0], y - ellipse.centre[1]
    sin, cos = math.sin(ellipse.theta), math.cos(ellipse.theta)
    a, b = ellipse.semi_major, ellipse.semi_minor
    k = dy / dx
    below = a**2 * (k * sin + cos) ** 2 + b**2 * (sin - k * cos) ** 2
    return abs(math.hypot(dx, dy) - math.sqrt((dx**2 + dy**2) / dx**2 * a**2 * b**2 / below))


def tip(ellipse, direction):
    x, y = ellipse.centre
    return x + ellipse.semi_major * math.cos(direction), y + ellipse.semi_major * math.sin(
        direction
    )


def test_theta_is_the_direction_of_the_major_axis_not_what_eqs_1_and_4_print():
    at_theta = tip(TILTED, TILTED.theta)
    np.testing.assert_allclose(TILTED.points_at(np.zeros(1)), [at_theta], atol=MACHINE)
    assert radial_residuals(np.array([at_theta]), TILTED)[0] == pytest.approx(0, abs=MACHINE)
    # As printed, Eqs. (1) and (4) put a at theta + 90 deg: README, Conventions, trap 1.
    at_90 = tip(TILTED, TILTED.theta + math.pi / 2)
    assert paper_eq_1(*at_theta, TILTED) == pytest.approx(20**2 / 15**2)
    assert paper_eq_4(*at_theta, TILTED) == pytest.approx(20 - 15)
    assert paper_eq_1(*at_90, TILTED) == pytest.approx(1)
    assert paper_eq_4(*at_90, TILTED) == pytest.approx(0, abs=MACHINE)


def test_radial_residuals_are_eq_4_with_theta_turned_by_90_deg(rng):
    printed = Ellipse(
        TILTED.centre, TILTED.semi_major, TILTED.semi_minor, TILTED.theta + math.pi / 2
    )
    points = TILTED.centre + rng.normal(size=(50, 2)) * 20
    by_the_paper = [paper_eq_4(x, y, printed) for x, y in points]
    np.testing.assert_allclose(np.abs(radial_residuals(points, TILTED)), by_the_paper, atol=MACHINE)


def test_theta_increases_from_x_towards_y():
    upright = Ellipse((0.0, 0.0), 2.0, 1.0, math.pi / 2)
    np.testing.assert_allclose(upright.points_at(np.zeros(1)), [[0.0, 2.0]], atol=MACHINE)


@PROPERTY
@given(angles)
def test_theta_is_stored_in_zero_to_pi(theta):
    kept = Ellipse((0.0, 0.0), 2.0, 1.0, theta).theta
    assert 0 <= kept < math.pi
    assert math.sin(kept - theta) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("theta", [-1e-17, -1e-300, math.pi, -math.pi, 5 * math.pi])
def test_theta_at_pi_is_zero(theta):
    assert Ellipse((0.0, 0.0), 2.0, 1.0, theta).theta == pytest.approx(0, abs=1e-15)


@PROPERTY
@given(st.floats(1, 9), st.floats(1, 9), angles)
def test_from_axes_orders_a_pair_of_axes(first, second, direction):
    ordered = Ellipse.from_axes((1.0, 2.0), first, second, direction)
    swapped = Ellipse.from_axes((1.0, 2.0), second, first, direction + math.pi / 2)
    assert ordered.semi_major >= ordered.semi_minor
    assert_same_ellipse(swapped, ordered, atol=MACHINE)


def test_tilt_and_radius_come_from_the_axes():
    pipe = Ellipse((0.0, 0.0), 20.0, 10.0, 0.0)
    assert (pipe.radius, pipe.phi) == (10.0, pytest.approx(math.radians(60)))
    assert Ellipse((0.0, 0.0), 10.0, 10.0, 0.0).phi == 0.0


@PROPERTY
@given(ellipses())
def test_twin_axes_are_unit_vectors_at_phi_from_the_normal(ellipse):
    twins = ellipse.axis_twins
    np.testing.assert_allclose(np.linalg.norm(twins, axis=1), 1, atol=ROUNDING)
    np.testing.assert_allclose(twins[:, 2], math.cos(ellipse.phi), atol=ROUNDING)
    np.testing.assert_allclose(twins[0, :2], -twins[1, :2], atol=ROUNDING)
    across = twins[0, 0] * math.sin(ellipse.theta) - twins[0, 1] * math.cos(ellipse.theta)
    assert across == pytest.approx(0, abs=ROUNDING)


@PROPERTY
@given(ellipses())
def test_to_and_from_ellipse_frame_are_inverse(ellipse):
    points = np.array([[1.0, 2.0], [-300.0, 40.0]])
    back = ellipse.from_ellipse_frame(ellipse.to_ellipse_frame(points))
    np.testing.assert_allclose(back, points, atol=MACHINE)


def brute_force_radial(point, ellipse):
    """Bisection along the ray, by the implicit equation in coordinates of two foci."""
    focus = math.sqrt(ellipse.semi_major**2 - ellipse.semi_minor**2)
    major = np.array([math.cos(ellipse.theta), math.sin(ellipse.theta)]) * focus
    centre = np.array(ellipse.centre)
    ray = (point - centre) / np.linalg.norm(point - centre)
    low, high = 0.0, 2 * ellipse.semi_major
    for _ in range(80):
        middle = (low + high) / 2
        on_ray = centre + middle * ray
        to_foci = math.dist(on_ray, centre + major) + math.dist(on_ray, centre - major)
        low, high = (middle, high) if to_foci < 2 * ellipse.semi_major else (low, middle)
    return np.linalg.norm(point - centre) - low


@PROPERTY
@given(ellipses(), seeds)
def test_radial_residual_is_the_distance_along_the_ray(ellipse, seed):
    point = ellipse.centre + np.random.default_rng(seed).normal(size=2) * ellipse.semi_major
    expected = brute_force_radial(point, ellipse)
    assert radial_residuals(point[None], ellipse)[0] == pytest.approx(expected, abs=1e-7)


def test_radial_residual_at_the_centre_is_minus_b():
    assert radial_residuals(np.array([TILTED.centre]), TILTED)[0] == -15.0


def nearest_by_grid(own, a, b):
    """Distance of one point from the ellipse: a dense grid of anomalies, then a finer one."""
    low, high = 0.0, 2 * math.pi
    for _ in range(6):
        t = np.linspace(low, high, 2001)
        gaps = np.hypot(a * np.cos(t) - own[0], b * np.sin(t) - own[1])
        best, step = t[np.argmin(gaps)], (high - low) / 2000
        low, high = best - 2 * step, best + 2 * step
    return float(gaps.min())


@PROPERTY
@given(ellipses(phi_deg=(0.0, 89.0)), seeds)
def test_orthogonal_residual_is_the_distance_to_the_nearest_point(ellipse, seed):
    rng = np.random.default_rng(seed)
    a, b = ellipse.semi_major, ellipse.semi_minor
    own = rng.normal(size=(4, 2)) * rng.choice([0.3, 1.0, 3.0]) * (a, b)
    expected = [nearest_by_grid(point, a, b) for point in own]
    found = orthogonal_residuals(ellipse.from_ellipse_frame(own), ellipse)
    np.testing.assert_allclose(np.abs(found), expected, rtol=BRUTE_FORCE, atol=BRUTE_FORCE)
    inside = (own[:, 0] / a) ** 2 + (own[:, 1] / b) ** 2 < 1
    np.testing.assert_array_equal(found < 0, inside & (found != 0))


def evolute(t, a, b):
    return (a * a - b * b) / a * math.cos(t) ** 3, (b * b - a * a) / b * math.sin(t) ** 3


HARD = {
    "centre": (0.0, 0.0),
    "on the major axis, within the cusp": (5.0, 0.0),
    "on the cusp": (20 - 225 / 20, 0.0),
    "on the major axis, outside": (31.0, 0.0),
    "tip": (20.0, 0.0),
    "on the minor axis": (0.0, -7.0),
    "on the minor axis, outside": (0.0, 50.0),
    "beyond the other cusp": (0.0, -30.0),
    "on the evolute": evolute(0.7, 20.0, 15.0),
    "on the evolute, other quadrant": evolute(2.5, 20.0, 15.0),
    "far away": (3e5, -4e5),
    "hardly off the major axis": (9.0, 1e-13),
}


@pytest.mark.parametrize("name", HARD)
def test_foot_points_of_difficult_points(name):
    own = np.array([HARD[name]])
    foot = find_foot_points(own, 20.0, 15.0)[0]
    assert (foot[0] / 20) ** 2 + (foot[1] / 15) ** 2 == pytest.approx(1, abs=1e-12)
    gap = math.dist(foot, own[0])
    assert gap == pytest.approx(nearest_by_grid(own[0], 20.0, 15.0), rel=1e-9, abs=BRUTE_FORCE)


@pytest.mark.parametrize("phi_deg", [85.0, 89.0, 89.9])
def test_foot_points_of_thin_ellipses(phi_deg, rng):
    b = 10.0
    a = b / math.cos(math.radians(phi_deg))
    t = rng.uniform(0, 2 * math.pi, 60)
    own = np.column_stack([a * np.cos(t), b * np.sin(t)]) * rng.uniform(0.5, 1.5, (60, 1))
    gaps = np.hypot(*(find_foot_points(own, a, b) - own).T)
    expected = [nearest_by_grid(point, a, b) for point in own]
    np.testing.assert_allclose(gaps, expected, atol=1e-4)


def test_foot_points_on_a_circle_lie_on_the_ray_from_its_centre():
    own = np.array([[3.0, 4.0], [-30.0, 40.0], [0.0, -2.0]])
    expected = 10 * own / np.linalg.norm(own, axis=1)[:, None]
    np.testing.assert_allclose(find_foot_points(own, 10.0, 10.0), expected, atol=MACHINE)


def test_orthogonal_residual_at_the_centre_is_minus_the_smaller_semi_axis():
    for semi_major in (15.0, 20.0):
        ellipse = Ellipse((3.0, -400.0), semi_major, 15.0, 0.5)
        residuals = orthogonal_residuals(np.array([ellipse.centre]), ellipse)
        np.testing.assert_allclose(residuals, [-15.0], rtol=0, atol=MACHINE)


def test_no_points_have_no_residuals():
    nothing = np.empty((0, 2))
    assert radial_residuals(nothing, TILTED).shape == (0,)
    assert orthogonal_residuals(nothing, TILTED).shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        pytest.param(((0, 0), 1.0, 2.0, 0.0), "expected semi_major >= semi_minor", id="order"),
        pytest.param(((0, 0), 1.0, 0.0, 0.0), "got 1 and 0", id="flat"),
        pytest.param(((0, 0), -1.0, -2.0, 0.0), "from_axes orders", id="negative"),
        pytest.param(((0, math.nan), 2.0, 1.0, 0.0), "expected finite numbers", id="nan"),
        pytest.param(((0, 0), math.inf, 1.0, 0.0), "expected finite numbers", id="endless"),
        pytest.param(
            ((0, 0, 5), 2.0, 1.0, 0.0),
            r"expected a centre \(x, y\) in mm, got \(0, 0, 5\)",
            id="three coordinates",
        ),
    ],
)
def test_an_invalid_ellipse_raises_an_error(arguments, message):
    with pytest.raises(ValueError, match=message):
        Ellipse(*arguments)
