import math

import numpy as np
import pytest

from lsvision import Arc, CylinderSection
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.section import THETA_UNKNOWN_STD
from lsvision.planning import section_bound
from tests.ellipse.arcs import SENSOR, measured, pipe, upper_arc

QUANTITIES = ("radius", "theta", "phi")


def section_of(phi_deg, rng=None, count=70):
    truth, exact = pipe(phi_deg), upper_arc(pipe(phi_deg), count=count)
    points = exact if rng is None else measured(exact, rng)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    return CylinderSection(fit, Arc(10, 10 + count), np.arange(10, 10 + count))


def test_the_covariance_at_the_truth_is_the_bound():
    truth, exact = pipe(30.0), upper_arc(pipe(30.0))
    bound = section_bound(truth, exact, SENSOR.covariances(exact))
    section = section_of(30.0)
    sigmas = np.sqrt(np.diag(bound.covariance))
    np.testing.assert_allclose(
        section.covariance / np.outer(sigmas, sigmas),
        bound.covariance / np.outer(sigmas, sigmas), atol=1e-3,
    )  # fmt: skip


def test_the_covariance_is_in_the_order_x_y_a_b_theta(rng):
    section = section_of(30.0, rng)
    covariance = section.covariance
    assert covariance.shape == (5, 5)
    assert section.radius_std == pytest.approx(math.sqrt(covariance[3, 3]))
    assert section.theta_std == pytest.approx(math.sqrt(covariance[4, 4]))
    # The centre lies deep or high with the radius, not left or right.
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert correlation[1, 3] < -0.5


def test_the_numbers_are_those_of_the_ellipse(rng):
    section = section_of(30.0, rng)
    ellipse = section.ellipse
    numbers = (section.radius, section.theta, section.phi, section.centre)
    assert numbers == (ellipse.semi_minor, ellipse.theta, ellipse.phi, ellipse.centre)
    np.testing.assert_array_equal(section.axis_twins, ellipse.axis_twins)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_far_from_a_circle_a_sigma_is_half_the_68_percent_interval(quantity):
    section = section_of(40.0, count=300)
    low, high = section.interval(quantity, 0.6827)
    # Skewed and curved by a few percent at this noise.
    assert (high - low) / 2 == pytest.approx(getattr(section, f"{quantity}_std"), rel=0.1)


def test_of_a_circle_theta_is_unknown_and_phi_has_a_finite_sigma():
    section = section_of(0.0)
    assert section.theta_std == THETA_UNKNOWN_STD == pytest.approx(math.pi / math.sqrt(12))
    assert 0 < section.phi_std < math.radians(20)
    assert not section.theta_determined


def test_near_a_circle_all_numbers_are_finite(rng):
    for phi_deg in (0.0, 1e-6, 0.01, 1.0):
        section = section_of(phi_deg, rng)
        stds = (section.radius_std, section.theta_std, section.phi_std)
        assert np.isfinite(stds).all()
        assert np.isfinite(section.covariance).all()


def test_theta_of_a_tilted_pipe_is_determined(rng):
    section = section_of(40.0, rng)
    assert section.theta_determined is True
    assert section.theta_std < math.radians(5)


def test_what_is_no_quantity_is_refused(rng):
    with pytest.raises(ValueError, match="want one of radius, theta"):
        section_of(30.0, rng).interval("diameter")
    with pytest.raises(ValueError, match="level between 0 and 1"):
        section_of(30.0, rng).interval("radius", 1.5)
