"""Known radii that the points contradict, and those that they do not."""

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.prior_check import find_contradicting_radius
from lsvision.ellipse.problem import RadiusPrior
from lsvision.simulate import Scene, SectionSettings, Tube, simulate_section
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc

TRUTH = pipe(25.0)


def fitted(known, *, std=0.05, degrees=140.0, seed=3, given=True, prior_std=0.0):
    """An arc of 19 mm with isotropic errors, fitted with a known radius."""
    exact = upper_arc(TRUTH, degrees=degrees)
    points = exact + std * np.random.default_rng(seed).normal(size=exact.shape)
    covariances = np.tile(std**2 * np.eye(2), (len(points), 1, 1)) if given else None
    prior = None if known is None else RadiusPrior(known, prior_std)
    return fit_ellipse(points, about(TRUTH), covariances, known_radius=prior)


def smallest_contradiction(**options):
    """Return the smallest difference of a known radius from that of the points that is detected."""
    radius = fitted(None, **options).ellipse.radius
    for difference in np.arange(0.05, 6.0, 0.05):
        if find_contradicting_radius(fitted(radius - difference, **options)):
            return difference
    return np.inf


@pytest.mark.parametrize("given", [True, False])
def test_six_sigmas_of_the_radius_are_a_contradiction(given):
    options = {"std": 0.1, "degrees": 150.0, "given": given}
    free = fitted(None, **options)
    gradient = np.array([0, 0, 1, *(-free.parameters[3:] / np.hypot(*free.parameters[3:]))])
    std = np.sqrt(gradient @ free.parameter_covariance @ gradient)
    assert 6 * std > 0.03 * 19
    assert smallest_contradiction(**options) == pytest.approx(6 * std, rel=0.15)


def test_two_per_cent_are_none_however_small_the_errors():
    assert smallest_contradiction(std=0.005) == pytest.approx(0.02 * 19, abs=0.06)


def test_the_radius_of_the_points_is_returned():
    points = find_contradicting_radius(fitted(17.0))
    assert abs(points.radius - 19.0) < 4 * points.std < 1.0


def test_an_uncertain_radius_is_contradicted_later():
    assert find_contradicting_radius(fitted(17.0, prior_std=0.1)) is not None
    assert find_contradicting_radius(fitted(17.0, prior_std=1.0)) is None


def test_a_short_arc_contradicts_no_radius():
    assert find_contradicting_radius(fitted(14.0, degrees=45.0)) is None


def test_without_a_known_radius_there_is_no_contradiction():
    assert find_contradicting_radius(fitted(None)) is None


def test_right_radii_are_not_contradicted():
    """400 arcs of 60 to 150 deg, with a noise model or without."""
    for seed in range(400):
        rng = np.random.default_rng([9, seed])
        exact = upper_arc(TRUTH, degrees=rng.uniform(60, 150), count=int(rng.integers(15, 120)))
        covariances = SENSOR.covariances(exact) if seed % 2 else None
        fit = fit_ellipse(
            measured(exact, rng), about(TRUTH), covariances, known_radius=RadiusPrior(19.0),
            settings=FittingSettings(),
        )  # fmt: skip
        assert find_contradicting_radius(fit) is None


@pytest.mark.parametrize("sensor", [None, SENSOR])
def test_a_pipe_of_another_radius_is_rejected_with_both(sensor):
    scene = Scene((Tube.of(19.0, 0.3, 0.35, (0.0, -400.0)),))
    section = simulate_section(scene, SENSOR, SectionSettings(), rng=np.random.default_rng(5))
    profile = Profile(section.profile.points)
    assert measure_cylinders(profile, sensor=sensor, known_radius=19.2).cylinders
    wrong = measure_cylinders(profile, sensor=sensor, known_radius=17.0)
    assert not wrong.cylinders
    assert wrong.reason.startswith("the known radius of 17 mm contradicts the points: they give 1")


def test_a_rejection_names_the_known_tilt_with_which_the_radius_does_not_agree():
    scene = Scene((Tube.of(13.0, 1.57, 0.6, (0.0, -400.0)),))
    section = simulate_section(scene, SENSOR, SectionSettings(), rng=np.random.default_rng(5))
    profile = Profile(section.profile.points)
    assert measure_cylinders(profile, known_radius=(13.0, 0.05)).cylinders
    wrong = measure_cylinders(profile, known_radius=(13.0, 0.05), known_phi=(0.0, 0.1))
    assert not wrong.cylinders
    assert "contradicts the points: with the known tilt they give 11." in wrong.reason
