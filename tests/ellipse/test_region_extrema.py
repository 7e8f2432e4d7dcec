"""Extrema of radius, phi and centre over ellipsoids, against points drawn on their surfaces."""

import numpy as np
import pytest

from lsvision.ellipse import region_extrema
from lsvision.ellipse.cost_expansion import expand_cost
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.region_extrema import Regions, Rows, Targets
from lsvision.geometry.arrays import select_rows
from tests.ellipse.arcs import SENSOR, measured, pipe, ratios_of, upper_arc

LEVEL, DRAWN = 0.95, 400_000
QUANTITIES = {
    region_extrema.RADIUS_LOW: lambda x, y, m, h: -(m - h),
    region_extrema.RADIUS_HIGH: lambda x, y, m, h: m - h,
    region_extrema.PHI_LOW: lambda x, y, m, h: -h / m,
    region_extrema.PHI_HIGH: lambda x, y, m, h: h / m,
    region_extrema.X_LOW: lambda x, y, m, h: -x,
    region_extrema.X_HIGH: lambda x, y, m, h: x,
    region_extrema.Y_LOW: lambda x, y, m, h: -y,
    region_extrema.Y_HIGH: lambda x, y, m, h: y,
}


def targets_and_ellipsoid(phi_deg, rng):
    """Return targets and estimate of a fit, and offsets (DRAWN, 5) at which F is min F + 1."""
    truth = pipe(phi_deg)
    points = measured(upper_arc(truth, 150.0), rng)
    stack = FitStack.of([fit_ellipse(points, truth, SENSOR.covariances(points))])
    ratios = ratios_of(stack.fits[0], LEVEL)
    regions = Regions(stack, ratios, expand_cost(stack, np.array([0]), stack.parameters))
    ends = np.array(list(QUANTITIES))
    rows = Rows(np.zeros(len(ends), dtype=int), ends)
    start = np.repeat(stack.parameters, len(ends), axis=0)
    angles, m_factors = np.zeros((2, len(ends)))
    directed = ends < region_extrema.DIRECTED_END_COUNT
    searched = regions.search_directions()
    angles[directed], m_factors[directed] = (each[0, ends[directed]] for each in searched)
    critical = np.repeat(ratios.one_dof, len(ends))
    last = Targets(start, angles, m_factors, critical, np.full(1, np.inf))
    found = regions.find_targets(rows, select_rows(regions.best, rows.fit_indices), last)
    drawn = rng.normal(size=(DRAWN, 5))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    factor = np.linalg.cholesky(regions.best.covariance[0])
    return found, stack.parameters[0], drawn @ factor.T


def test_gradients_of_the_centre_are_the_derivatives_of_the_maximised_quantities():
    for end in (
        region_extrema.X_LOW,
        region_extrema.X_HIGH,
        region_extrema.Y_LOW,
        region_extrema.Y_HIGH,
    ):
        derivatives = [QUANTITIES[end](*step, h=0.0) for step in np.eye(3)]
        assert region_extrema.LINEAR_GRADIENTS[end].tolist() == [*derivatives, 0.0, 0.0]


@pytest.mark.parametrize("phi_deg", [14.0, 25.0, 40.0])
def test_targets_are_the_extrema_of_their_quantities(phi_deg, rng):
    found, estimate, ball = targets_and_ellipsoid(phi_deg, rng)
    for row, value in enumerate(QUANTITIES.values()):
        surface = estimate + np.sqrt(found.critical[row]) * ball
        x, y, m, p, q = surface.T
        heights = value(x, y, m, np.hypot(p, q))
        x, y, m, p, q = found.parameters[row]
        top, middle = value(x, y, m, np.hypot(p, q)), value(*estimate[:3], np.hypot(*estimate[3:]))
        assert top > heights.max() - 1e-9
        assert top - middle == pytest.approx(heights.max() - middle, rel=0.02)  # of the draws


@pytest.mark.parametrize("phi_deg", [6.0, 8.0, 14.0])
def test_d_of_a_target_has_the_direction_that_was_found(phi_deg, rng):
    """Otherwise the extremum of the linear function is not that of radius or phi."""
    found, _, _ = targets_and_ellipsoid(phi_deg, rng)
    for row, end in enumerate(QUANTITIES):
        if end in (region_extrema.RADIUS_LOW, region_extrema.PHI_HIGH):
            turned = complex(*found.parameters[row, 3:]) * np.exp(-1j * found.angles[row])
            assert abs(np.angle(turned)) < 2 * region_extrema.DIRECTION_TOLERANCE**2
