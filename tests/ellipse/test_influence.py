import numpy as np
import pytest

from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.influence import reject_influential_points
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc

TRUTH = pipe(30.0)


def fit_of(points, noise_factor=1.0):
    covariances = SENSOR.covariances(points) * noise_factor**2
    return fit_ellipse(points, about(TRUTH), covariances)


def test_a_clean_arc_keeps_all_its_points(rng):
    assert reject_influential_points(fit_of(measured(upper_arc(TRUTH), rng))).all()


@pytest.mark.parametrize("end", [0, -1])
def test_a_jump_that_the_ellipse_went_through_is_left_out(end, rng):
    points = measured(upper_arc(TRUTH), rng)
    points[end] *= 1 - 3.0 / np.hypot(*points[end])  # 3 mm along the ray, towards the sensor
    fit = fit_of(points)
    kept = reject_influential_points(fit)
    assert not kept[end]
    assert kept.sum() >= len(points) - 2
    mended = fit_ellipse(points[kept], fit.ellipse, SENSOR.covariances(points[kept]))
    assert fit.variance_factor > 1 == mended.variance_factor


def test_noise_that_is_larger_than_said_is_no_single_points_fault(rng):
    fit = fit_of(measured(upper_arc(TRUTH), rng), noise_factor=0.4)
    assert fit.variance_factor > 4
    assert reject_influential_points(fit).mean() > 0.95
