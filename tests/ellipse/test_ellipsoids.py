"""Points on the surfaces of ellipsoids, checked by the equations that define them."""

import numpy as np
import pytest

from lsvision.ellipse.cost_expansion import expand_cost
from lsvision.ellipse.ellipsoids import MAX_TANGENT_SINE, Ellipsoids
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.fit_stack import FitStack
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc

SHIFT = np.array([0.02, -0.03, 0.02, 0.01, -0.02])  # mm: about a sigma
RHO = np.array([2.0, 2.5])
ROWS = np.array([0, 1])


@pytest.fixture
def expansion(rng):
    """Expansion about the estimate of a pipe tilted by 20 deg, and beside it."""
    truth = pipe(20.0)
    points = measured(upper_arc(truth), rng)
    stack = FitStack.of([fit_ellipse(points, truth, SENSOR.covariances(points))])
    estimate = stack.parameters[0]
    return expand_cost(stack, np.zeros(2, dtype=int), np.array([estimate, estimate + SHIFT]))


@pytest.fixture
def ellipsoids(expansion):
    return Ellipsoids.of(expansion, np.full(2, expansion.cost[0]))


def squared_radii(ellipsoids, points):
    offsets = points - ellipsoids.centres
    return np.einsum("ki,kij,kj->k", offsets, ellipsoids.information, offsets)


def test_the_expansion_of_the_cost_is_c_above_the_least_cost_on_the_surface(
    expansion, ellipsoids, rng
):
    c = 3.84
    rho = np.sqrt(c + ellipsoids.excess)
    surface = ellipsoids.find_extrema(rng.normal(size=(2, 5)), rho)
    steps = surface - expansion.parameters
    expanded = expansion.cost + 2 * (expansion.gradient * steps).sum(axis=1)
    expanded += np.einsum("ki,kij,kj->k", steps, expansion.information, steps)
    np.testing.assert_allclose(expanded, expansion.cost[0] + c)


def test_no_point_of_the_surface_has_a_larger_value_than_the_extremum(ellipsoids, rng):
    f = rng.normal(size=(2, 5))
    extrema = ellipsoids.find_extrema(f, RHO)
    np.testing.assert_allclose(squared_radii(ellipsoids, extrema), RHO**2)
    for _ in range(200):
        others = ellipsoids.find_extrema(rng.normal(size=(2, 5)), RHO)
        assert ((f * others).sum(axis=1) <= (f * extrema).sum(axis=1)).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_tangent_meets_the_ellipse_of_d_where_it_is_normal_to_its_gradient(ellipsoids, side):
    f = np.zeros((2, 5))
    f[:, 3:], rho, contacts = ellipsoids.find_tangents(ROWS, RHO, np.full(2, side))
    np.testing.assert_array_equal(rho, RHO)
    extrema = ellipsoids.find_extrema(f, rho)
    np.testing.assert_allclose(extrema[:, 3] + 1j * extrema[:, 4], contacts)
    normal = f[:, 3] + 1j * f[:, 4]
    np.testing.assert_allclose((normal.conj() * contacts).real, 0, atol=1e-9)  # through d = 0
    centres = ellipsoids.centres[:, 3] + 1j * ellipsoids.centres[:, 4]
    assert (side * np.angle(contacts / centres) > 0).all()


def test_an_ellipse_around_the_circle_is_made_smaller_for_its_tangents(ellipsoids):
    _, rho, _ = ellipsoids.find_tangents(ROWS, np.full(2, 1e3), np.ones(2))
    np.testing.assert_allclose(rho, MAX_TANGENT_SINE * np.abs(ellipsoids.whitened))


def test_extreme_circles_lie_on_the_surface_and_no_other_circle_is_beyond_them(ellipsoids, rng):
    _, rho_of_best = ellipsoids.to_circles(ROWS)
    rho, f = 1.5 * rho_of_best, rng.normal(size=(2, 3))
    circles = ellipsoids.find_extreme_circles(ROWS, rho, f)
    assert (circles[:, 3:] == 0).all()
    np.testing.assert_allclose(squared_radii(ellipsoids, circles), rho**2)
    for _ in range(200):
        others = ellipsoids.find_extreme_circles(ROWS, rho, rng.normal(size=(2, 3)))
        assert ((f * others[:, :3]).sum(axis=1) <= (f * circles[:, :3]).sum(axis=1)).all()
