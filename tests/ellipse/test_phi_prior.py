"""Fits with a known tilt: what it improves on short arcs, and valid uncertainties."""

import math

import numpy as np
import pytest

from lsvision import Arc, CylinderSection, Ellipse
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.intervals import find_intervals_of_fits
from lsvision.ellipse.phi_prior import PhiPrior
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc
from tests.tolerances import CONVERGED, DIFFERENCES, FOUR_SIGMA, spread_of_rms, spread_of_share

RUNS = 60
SHORT, LONG = 60.0, 140.0  # deg
SQUARE_ON = PhiPrior(0.0)
HARDLY_TILTED = 2.5e-3  # rad; an exact 0 has a std of 1e-3


def section_of(truth, known_phi, rng=None, degrees=SHORT, covariances=True):
    points = upper_arc(truth, degrees)
    points = points if rng is None else measured(points, rng)
    noise = SENSOR.covariances(points) if covariances else None
    fit = fit_ellipse(points, about(truth), noise, known_phi=known_phi)
    return CylinderSection(fit, Arc(0, len(points)), np.arange(len(points)))


def drawn_about_square_on(std_deg, rng):
    phi_deg = abs(rng.normal(0.0, std_deg))
    return pipe(phi_deg, theta=rng.uniform(0, math.pi))


@pytest.mark.parametrize("phi_deg", [0.0, 20.0])
def test_noise_free_points_of_the_known_tilt_give_their_ellipse_back(phi_deg):
    truth = pipe(phi_deg)
    section = section_of(truth, PhiPrior(math.radians(phi_deg)), degrees=LONG)
    assert section.radius == pytest.approx(truth.radius, abs=CONVERGED)
    np.testing.assert_allclose(section.centre, truth.centre, atol=CONVERGED)


def test_a_short_arc_has_a_radius_where_the_tilt_is_known(rng):
    truth = pipe(0.0)
    free, known = (section_of(truth, prior, rng) for prior in (None, SQUARE_ON))
    assert abs(known.radius - truth.radius) < FOUR_SIGMA * known.radius_std
    # Measured: 0.12 mm against about 3.
    assert known.radius_std < free.radius_std / 10


@pytest.mark.parametrize("std_deg", [0.0, 2.0, 8.0])
@pytest.mark.parametrize("degrees", [SHORT, LONG])
def test_sigma_and_interval_of_the_radius_are_valid(std_deg, degrees, rng):
    prior = PhiPrior(0.0, math.radians(std_deg))
    pipes = [drawn_about_square_on(std_deg, rng) for _ in range(RUNS)]
    sections = [section_of(truth, prior, rng, degrees) for truth in pipes]
    found = find_intervals_of_fits([section.fit for section in sections], 0.9)
    radii = np.array([truth.radius for truth in pipes])
    low, high = np.transpose([each.radius for each in found])
    held = (low <= radii) & (radii <= high)
    normalised = [(s.radius - r) / s.radius_std for s, r in zip(sections, radii, strict=True)]
    assert abs(np.mean(held) - 0.9) < spread_of_share(0.9, RUNS)
    assert np.sqrt(np.mean(np.square(normalised))) < 1.1 + spread_of_rms(RUNS)


def test_an_estimated_noise_serves_as_well(rng):
    normalised = [
        (section.radius - 19.0) / section.radius_std
        for section in (section_of(pipe(0.0), SQUARE_ON, rng, covariances=False) for _ in range(60))
    ]
    assert abs(np.sqrt(np.mean(np.square(normalised))) - 1) < spread_of_rms(60)


def test_square_on_is_a_circle_without_theta(rng):
    section = section_of(pipe(0.0), SQUARE_ON, rng)
    assert section.phi < HARDLY_TILTED
    assert not section.theta_determined
    assert section.interval("theta") == (0.0, math.pi)
    assert section.interval("phi")[1] < HARDLY_TILTED


def test_a_loose_prior_leaves_a_long_arc_as_it_was(rng):
    points = measured(upper_arc(pipe(30.0)), rng)
    free, loose = (
        fit_ellipse(points, about(pipe(30.0)), SENSOR.covariances(points), known_phi=prior)
        for prior in (None, PhiPrior(0.5, 0.5))
    )
    off = np.array([free.ellipse.radius, free.ellipse.theta]) - [
        loose.ellipse.radius, loose.ellipse.theta
    ]  # fmt: skip
    assert (np.abs(off) < 0.3 * np.sqrt([free.parameter_covariance[2, 2], 1e-3])).all()


def test_a_tilt_that_is_known_sharpens_the_radius_of_an_arc_that_tells_theta(rng):
    truth = pipe(20.0)
    free, known = (
        section_of(truth, prior, rng, LONG) for prior in (None, PhiPrior(math.radians(20.0)))
    )
    assert known.phi == pytest.approx(truth.phi, abs=1e-4)
    assert known.radius_std < free.radius_std / 2
    assert abs(known.radius - truth.radius) < FOUR_SIGMA * known.radius_std


def test_a_tilt_without_direction_is_not_used(rng):
    """All (p, q) on a ring have this phi: it is used only if the points determine theta."""
    points = measured(upper_arc(pipe(20.0), 50.0), rng)
    free, known = (
        fit_ellipse(points, pipe(20.0), SENSOR.covariances(points), known_phi=prior)
        for prior in (None, PhiPrior(math.radians(20.0)))
    )
    np.testing.assert_array_equal(free.parameters, known.parameters)
    assert not free.is_noncircular


@pytest.mark.parametrize("prior", [PhiPrior(0.0, 0.1), PhiPrior(0.4, 0.05), PhiPrior(0.3)])
def test_the_derivative_is_that_of_differences(prior):
    at = np.array([1.0, -400.0, 20.0, 0.5, -0.3])
    residuals, jacobian = prior.residuals_and_jacobian(at)
    assert jacobian.shape == (len(residuals), 5)
    for axis in range(5):
        step = 1e-6 * np.eye(5)[axis]
        slope = (
            prior.residuals_and_jacobian(at + step)[0] - prior.residuals_and_jacobian(at - step)[0]
        ) / 2e-6
        scale = np.abs(jacobian).max()
        np.testing.assert_allclose(slope, jacobian[:, axis], atol=scale * DIFFERENCES)


def test_far_from_a_circle_the_residual_is_that_of_phi():
    at = np.array([0.0, 0.0, 20.0, 0.0, 1.0])
    tilt = Ellipse((0.0, 0.0), 21.0, 19.0, 0.0).phi
    residuals, _ = PhiPrior(0.5, 0.01).residuals_and_jacobian(at)
    assert residuals == pytest.approx([(tilt - 0.5) / 0.01])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-0.1,), "expected a known phi from 0 to below pi / 2 rad, got -0.1"),
        ((math.pi / 2,), "from 0 to below pi / 2"),
        ((math.nan,), "got nan"),
        ((0.0, -0.1), "known phi with std >= 0 rad, got -0.1"),
        ((0.0, math.inf), "std >= 0 rad, got inf"),
    ],
)
def test_what_is_no_tilt_is_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        PhiPrior(*arguments)


@pytest.mark.parametrize("std_deg", [2.0, 5.0])
def test_where_the_points_say_nothing_of_phi_its_interval_is_that_of_the_prior(std_deg, rng):
    prior = PhiPrior(0.0, math.radians(std_deg))
    high = section_of(pipe(0.0), prior, rng).interval("phi", 0.95)[1]
    # 1.96 sigma, slightly reduced by the information of an arc of 60 deg on larger tilts.
    assert high == pytest.approx(1.96 * prior.std, rel=0.1)
