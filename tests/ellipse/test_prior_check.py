"""Known radii and tilts that the points contradict, and those that they do not."""

import math

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.prior_check import find_contradicting_radius, find_contradicting_tilt
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


def test_of_a_wrong_tilt_and_a_right_radius_the_tilt_is_named():
    scene = Scene((Tube.of(13.0, 1.57, 0.6, (0.0, -400.0)),))
    section = simulate_section(scene, SENSOR, SectionSettings(), rng=np.random.default_rng(5))
    profile = Profile(section.profile.points)
    assert measure_cylinders(profile, known_radius=(13.0, 0.05)).cylinders
    wrong = measure_cylinders(profile, known_radius=(13.0, 0.05), known_phi=(0.0, 0.1))
    assert not wrong.cylinders
    assert wrong.reason.startswith("the known tilt of 0 deg contradicts the points: with the known")


def test_of_a_right_tilt_and_a_wrong_radius_the_radius_is_named():
    scene = Scene((Tube.of(13.0, 1.57, 0.6, (0.0, -400.0)),))
    section = simulate_section(scene, SENSOR, SectionSettings(), rng=np.random.default_rng(5))
    profile = Profile(section.profile.points)
    wrong = measure_cylinders(profile, known_radius=(14.2, 0.05), known_phi=(0.6, 0.01))
    assert not wrong.cylinders
    assert "contradicts the points: with the known tilt they give 1" in wrong.reason


def test_a_rough_surface_does_not_contradict_a_right_tilt():
    """Errors over a fifth of the arc, as of a drill core: an ellipse absorbs a part of them."""
    turn = np.radians(np.linspace(20, 160, 300))
    tilts_deg = []
    for seed in range(60):
        rng = np.random.default_rng([11, seed])
        phases, orders = rng.uniform(0, 2 * math.pi, 8), np.arange(1, 9)
        waves = np.cos(np.outer(turn, orders) * math.pi / math.radians(70) + phases) / orders
        radii = 20 + 0.12 * waves @ rng.normal(size=8) + 0.02 * rng.normal(size=300)
        points = radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]) - (0, 150)
        pipes = measure_cylinders(points, known_phi=0.0).cylinders
        assert len(pipes) == 1
        free = measure_cylinders(points).cylinders
        tilts_deg += [math.degrees(pipe.phi) for pipe in free]
    assert np.median(tilts_deg) > 11.5


def tilt_contradicting(known_deg, *, std_deg=0.0, **options):
    """The tilt of the points of such an arc, where they contradict the known one."""
    fit = fitted_with_tilt(known_deg, std_deg=std_deg, **options)
    known = PhiPrior(math.radians(known_deg), math.radians(std_deg))
    return find_contradicting_tilt(fit, known)


def fitted_with_tilt(known_deg, *, phi_deg=25.0, std=0.05, degrees=140.0, std_deg=0.0, seed=3):
    """An arc of 19 mm with isotropic errors, fitted with a known tilt or without."""
    truth = pipe(phi_deg)
    exact = upper_arc(truth, degrees=degrees)
    points = exact + std * np.random.default_rng(seed).normal(size=exact.shape)
    covariances = np.tile(std**2 * np.eye(2), (len(points), 1, 1))
    prior = None
    if known_deg is not None:
        prior = PhiPrior(math.radians(known_deg), math.radians(std_deg))
    return fit_ellipse(points, about(truth), covariances, known_phi=prior)


@pytest.mark.parametrize("known_deg", [0.0, 10.0, 40.0])
def test_the_tilt_of_the_points_is_returned(known_deg):
    points = tilt_contradicting(known_deg)
    assert abs(points.phi - math.radians(25.0)) < 4 * points.std < math.radians(4)


def test_the_std_of_the_returned_tilt_is_its_scatter():
    results = [tilt_contradicting(0.0, seed=seed) for seed in range(100)]
    found = [points for points in results if points is not None]
    assert len(found) > 95  # residuals that are correlated by chance contradict less
    assert np.std([points.phi for points in found]) == pytest.approx(
        np.mean([points.std for points in found]), rel=0.2
    )


@pytest.mark.parametrize(("phi_deg", "is_contradicted"), [(10.5, False), (12.5, True)])
def test_two_per_cent_of_the_axis_ratio_are_none_however_small_the_errors(phi_deg, is_contradicted):
    """A circle whose section is an oval of 2 % seems to have a tilt of 11.5 deg."""
    contradicting = tilt_contradicting(0.0, phi_deg=phi_deg, std=0.002)
    assert (contradicting is not None) is is_contradicted


@pytest.mark.parametrize("seed", range(4))
def test_six_sigmas_are_a_contradiction_of_a_tilt(seed):
    """By the sums of squares of the fits of a circle and of an ellipse to uncorrelated errors."""
    stds = np.linspace(0.05, 0.6, 56)
    is_contradicted = [tilt_contradicting(0.0, std=std, seed=seed) is not None for std in stds]
    options = {"std": stds[is_contradicted.index(False)], "seed": seed}
    circle, free = fitted_with_tilt(0.0, **options), fitted_with_tilt(None, **options)
    assert free.correlation.autocorrelation_time == 1
    squares = [float(fit.residuals @ fit.residuals) for fit in (circle, free)]
    variance = squares[1] / (len(free.residuals) - 5)
    assert math.sqrt((squares[0] - squares[1]) / variance) == pytest.approx(6.0, rel=0.06)


def test_an_uncertain_tilt_is_contradicted_later():
    assert tilt_contradicting(0.0, std_deg=3.0) is not None
    assert tilt_contradicting(0.0, std_deg=15.0) is None


def test_a_short_arc_contradicts_no_tilt():
    assert tilt_contradicting(0.0, degrees=40.0) is None


def test_without_a_known_tilt_there_is_no_contradiction():
    assert find_contradicting_tilt(fitted(19.0), None) is None


def test_right_tilts_are_not_contradicted():
    """400 arcs of 60 to 150 deg, with a noise model or without, of circles and of ellipses."""
    for seed in range(400):
        rng = np.random.default_rng([10, seed])
        phi_deg = (0.0, 25.0)[seed // 2 % 2]
        truth = pipe(phi_deg)
        exact = upper_arc(truth, degrees=rng.uniform(60, 150), count=int(rng.integers(15, 120)))
        covariances = SENSOR.covariances(exact) if seed % 2 else None
        known = PhiPrior(math.radians(phi_deg))
        fit = fit_ellipse(measured(exact, rng), about(truth), covariances, known_phi=known)
        assert find_contradicting_tilt(fit, known) is None


@pytest.mark.parametrize("sensor", [None, SENSOR])
def test_a_pipe_of_another_tilt_is_rejected_with_both(sensor):
    scene = Scene((Tube.of(19.0, 0.3, math.radians(25), (0.0, -400.0)),))
    section = simulate_section(scene, SENSOR, SectionSettings(), rng=np.random.default_rng(5))
    profile = Profile(section.profile.points)
    assert measure_cylinders(profile, sensor=sensor, known_phi=math.radians(25)).cylinders
    wrong = measure_cylinders(profile, sensor=sensor, known_phi=0.0)
    assert not wrong.cylinders
    assert wrong.reason.startswith("the known tilt of 0 deg contradicts the points: they give 2")
    both = measure_cylinders(profile, sensor=sensor, known_phi=0.0, known_radius=(19.0, 2.0))
    assert "with the known radius they give 2" in both.reason


def test_a_known_tilt_of_a_circle_is_contradicted_though_it_is_no_prior_of_its_fit():
    """Where theta is not determined, a prior that excludes a circle is not used."""
    fit = fitted_with_tilt(25.0, phi_deg=0.0, degrees=160.0)
    assert fit.problem.known_phi is None
    points = tilt_contradicting(25.0, phi_deg=0.0, degrees=160.0)
    assert points.phi < math.radians(12)
    assert tilt_contradicting(25.0, phi_deg=0.0, degrees=160.0, std_deg=10.0) is None
    assert tilt_contradicting(25.0, phi_deg=0.0, degrees=60.0) is None
    assert tilt_contradicting(11.0, phi_deg=0.0, degrees=160.0, std=0.002) is None


def test_right_tilts_that_are_no_priors_are_not_contradicted():
    unused = 0
    for seed in range(300):
        rng = np.random.default_rng([14, seed])
        truth = pipe(12.0)
        exact = upper_arc(truth, degrees=rng.uniform(60, 150), count=int(rng.integers(15, 120)))
        covariances = SENSOR.covariances(exact) if seed % 2 else None
        known = PhiPrior(math.radians(12.0))
        fit = fit_ellipse(measured(exact, rng), about(truth), covariances, known_phi=known)
        unused += fit.problem.known_phi is None
        assert find_contradicting_tilt(fit, known) is None
    assert unused > 30
