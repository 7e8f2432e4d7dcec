import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scipy.optimize import approx_fprime, least_squares
from scipy.stats import chi2

from lsvision.ellipse.fit import FittingSettings, fit_ellipse, refit_with_known_radius
from lsvision.ellipse.fit import fit_noisy_points as fit_several
from lsvision.ellipse.outcomes import unwrap
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.ellipse.section import CylinderSection
from lsvision.errors import FitFailed, TooFewPoints
from lsvision.geometry import Ellipse, orthogonal_residuals
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.planning import section_bound
from lsvision.profile import Arc
from tests.alike import assert_same_ellipse, turn_between
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc
from tests.strategies import PROPERTY, arcs_with_noise
from tests.tolerances import CONVERGED, FIVE_SIGMA, spread_of_rms, spread_of_share

RUNS = 300


@PROPERTY
@given(arcs_with_noise(0.0))
def test_noise_free_points_give_their_ellipse_back(arc):
    truth, points = arc
    assert_same_ellipse(fit_ellipse(points, about(truth)).ellipse, truth, atol=CONVERGED)


@pytest.mark.parametrize("residual", ["orthogonal", "radial"])
def test_both_residuals_vanish_at_the_truth(residual):
    truth = pipe(30.0)
    fit = fit_ellipse(upper_arc(truth), about(truth), settings=FittingSettings(residual=residual))
    assert_same_ellipse(fit.ellipse, truth, atol=CONVERGED)
    assert fit.rms < CONVERGED


def test_the_rounding_of_exact_points_does_not_show_correlated_errors(rng):
    settings = FittingSettings(reweightings=0, max_evaluations=20, tolerance=1e-3)
    for phi_deg in rng.uniform(5, 50, 30):
        truth = pipe(phi_deg, rng.uniform(10, 40))
        points = upper_arc(truth, degrees=150.0, count=200)
        fit = fit_ellipse(points, truth, SENSOR.covariances(points), settings=settings)
        assert fit.rms < 1e-12
        assert fit.variance_factor == 1.0
        inexact = points + 1e-9 * np.sin(np.linspace(0, 30, len(points)))[:, None]
        fit = fit_ellipse(inexact, truth, SENSOR.covariances(points), settings=settings)
        assert fit.variance_factor > 2.0


def fits_of_many(truth, rng, runs=RUNS, known_radius=None):
    exact = upper_arc(truth)
    for _ in range(runs):
        points = measured(exact, rng)
        yield fit_ellipse(
            points, about(truth), SENSOR.covariances(points), known_radius=known_radius
        )


def errors_over(fits, truth):
    return np.array([
        (fit.ellipse.radius - truth.radius, turn_between(truth.theta, fit.ellipse.theta),
         fit.ellipse.phi - truth.phi, *np.subtract(fit.ellipse.centre, truth.centre))
        for fit in fits
    ])  # fmt: skip


def bound_of(truth, known_radius_std=None):
    exact = upper_arc(truth)
    bound = section_bound(truth, exact, SENSOR.covariances(exact), known_radius_std)
    return np.array([bound.radius_std, bound.theta_std, bound.phi_std, bound.centre_x_std,
                     bound.centre_y_std])  # fmt: skip


def test_the_fit_reaches_the_cramer_rao_bound_without_bias(rng):
    truth = pipe(30.0)
    errors = errors_over(fits_of_many(truth, rng), truth) / bound_of(truth)
    rms = np.sqrt(np.mean(errors**2, axis=0))
    np.testing.assert_array_less(np.abs(rms - 1), spread_of_rms(RUNS) + 0.02)  # 2 %: curvature
    # Bias within its own error and the 0.15 sigma of the goals.
    np.testing.assert_array_less(np.abs(errors.mean(axis=0)), 0.15 + FIVE_SIGMA / math.sqrt(RUNS))


def test_a_known_radius_reaches_its_bound(rng):
    truth = pipe(20.0)
    fits = fits_of_many(truth, rng, known_radius=RadiusPrior(truth.radius))
    errors = errors_over(fits, truth)[:, 1:] / bound_of(truth, 0.0)[1:]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    np.testing.assert_array_less(rms, 1.1 + spread_of_rms(RUNS))
    assert bound_of(truth, 0.0)[2] < bound_of(truth)[2] / 2


def test_an_exactly_known_radius_is_kept(rng):
    truth = pipe(20.0)
    points = measured(upper_arc(truth), rng)
    fit = fit_ellipse(
        points, about(truth), SENSOR.covariances(points), known_radius=RadiusPrior(19.3)
    )
    assert fit.ellipse.radius == pytest.approx(19.3, abs=1e-3)


@pytest.mark.parametrize("with_noise_model", [True, False])
def test_a_radius_that_is_known_later_leaves_the_scale_of_the_residuals(rng, with_noise_model):
    truth = pipe(30.0)
    points = measured(upper_arc(truth), rng)
    covariances = SENSOR.covariances(points) if with_noise_model else None
    fit = fit_ellipse(points, truth, covariances)
    known = refit_with_known_radius(fit, RadiusPrior(truth.radius, 0.5))
    before, after = np.std(fit.normalised), np.std(known.normalised)
    assert after == pytest.approx(before, rel=0.1)


def test_a_vague_radius_changes_nothing(rng):
    truth = pipe(20.0)
    points = measured(upper_arc(truth), rng)
    covariances = SENSOR.covariances(points)
    free = fit_ellipse(points, truth, covariances)
    vague = fit_ellipse(points, truth, covariances, known_radius=RadiusPrior(30.0, 1e5))
    # Without priors the bias, 0.007 mm, is removed to first order.
    assert_same_ellipse(vague.ellipse, free.ellipse, atol=3e-4)
    np.testing.assert_allclose(vague.parameter_covariance, free.parameter_covariance, rtol=3e-3)


def test_a_true_noise_model_is_taken_at_its_word(rng):
    factors = [fit.variance_factor for fit in fits_of_many(pipe(30.0), rng, runs=30)]
    assert sum(factor == 1.0 for factor in factors) >= 24  # chance correlation passes 5 % each lag


def test_an_optimistic_noise_model_is_corrected(rng):
    truth, exact = pipe(30.0), upper_arc(pipe(30.0), count=200)
    points = measured(exact, rng)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points) / 9)
    assert fit.variance_factor == pytest.approx(9, rel=FIVE_SIGMA * math.sqrt(2 / 195))


def test_without_a_noise_model_the_covariance_comes_from_the_residuals(rng):
    truth = pipe(30.0)
    points = upper_arc(truth, count=200) + 0.1 * rng.normal(size=(200, 2))
    fit = fit_ellipse(points, truth)
    isotropic = section_bound(
        truth, upper_arc(truth, count=200), np.tile(0.01 * np.eye(2), (200, 1, 1))
    )
    section = CylinderSection(fit, Arc(0, 200), np.arange(200))
    slack = FIVE_SIGMA / math.sqrt(2 * 195) + 0.1  # and that of a chance correlation
    assert section.radius_std == pytest.approx(isotropic.radius_std, rel=slack)
    assert 0 < fit.degrees_of_freedom <= 195


def test_correlated_errors_widen_the_covariance(rng):
    truth, exact = pipe(30.0), upper_arc(pipe(30.0), count=300)
    white = rng.normal(size=340)
    smooth = np.convolve(white, np.ones(9) / 3, mode="same")[20:320, None]
    toward = exact / np.linalg.norm(exact, axis=1)[:, None]
    points = exact + 0.05 * smooth * toward
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    assert fit.variance_factor > 4  # nine neighbours have nearly the same error


ESTIMATED = FittingSettings(variance="estimated", reweightings=0)


def noisy(points, variance_ratio=1.0):
    return NoisyPoints.of(points, variance_ratio * SENSOR.covariances(points))


def fit_noisy_points(points, start, known_radius=None, known_phi=None, settings=FittingSettings()):
    """Fit of one arc with the covariances of its points."""
    (outcome,) = fit_several([(points, start)], Priors(known_radius, known_phi), settings)
    return unwrap(outcome)


def ellipse_of(values):
    """Return the ellipse of centre, semi-minor axis, a - b and theta."""
    x, y, minor, excess, theta = values
    return Ellipse.from_axes((x, y), minor + excess, minor, theta)


def least_squares_by_scipy(points, stds, truth, further=lambda _: ()):
    """Return the least-squares ellipse over centre, axes and theta, by numerical derivatives."""

    def residuals(values):
        off = orthogonal_residuals(points, ellipse_of(values)) / stds
        return np.append(off, further(ellipse_of(values)))

    start = (*truth.centre, truth.semi_minor, truth.semi_major - truth.semi_minor, truth.theta)
    best = least_squares(residuals, start, x_scale=(1, 1, 1, 1, 0.1), xtol=1e-14, ftol=1e-14)
    return ellipse_of(best.x), best


def ray_stds(points, ellipse, std=0.05):
    """Return the stds along the normals of errors along the rays, which grow with range^2."""
    u, v = ellipse.to_ellipse_frame(points).T
    gradient = np.column_stack([u / ellipse.semi_major**2, v / ellipse.semi_minor**2])
    normals = ellipse.from_ellipse_frame(gradient) - ellipse.centre
    normals /= np.hypot(*normals.T)[:, None]
    matrices = SENSOR.covariances(points)
    return np.sqrt(np.einsum("ni,nij,nj->n", normals, matrices, normals)) * std / 0.05


def test_the_fit_is_the_weighted_least_squares_of_another_solver(rng):
    truth = pipe(30.0)
    points = measured(upper_arc(truth), rng)
    fit = fit_noisy_points(noisy(points), truth, settings=FittingSettings(reweightings=0))
    wanted, _ = least_squares_by_scipy(fit.problem.points, ray_stds(points, truth), truth)
    assert_same_ellipse(fit.ellipse, wanted, atol=1e-5)


def test_an_estimated_variance_leaves_the_ellipse_and_scales_the_covariance(rng):
    points = measured(upper_arc(pipe(30.0), count=200), rng)
    given = fit_noisy_points(noisy(points), pipe(30.0), settings=FittingSettings(reweightings=0))
    for ratio in (1.0, 1e-4, 1e4):
        fit = fit_noisy_points(noisy(points, ratio), pipe(30.0), settings=ESTIMATED)
        assert_same_ellipse(fit.ellipse, given.ellipse, atol=CONVERGED)
        misfit = given.residuals / ray_stds(points, pipe(30.0))
        scatter = float(misfit @ misfit) / 195
        assert fit.variance_factor * ratio == pytest.approx(
            scatter * fit.correlation.autocorrelation_time, rel=1e-6
        )
        np.testing.assert_allclose(
            fit.parameter_covariance,
            scatter * fit.correlation.autocorrelation_time * given.unscaled_covariance,
            rtol=1e-5,
        )


def test_an_estimated_variance_follows_chi_square(rng):
    """70 points have 65 degrees of freedom, which are reported if there is no correlation."""
    truth, factors = pipe(30.0), []
    for _ in range(RUNS):
        points = measured(upper_arc(truth), rng)
        fit = fit_noisy_points(noisy(points), truth, settings=ESTIMATED)
        if fit.correlation.autocorrelation_time == 1:
            assert fit.degrees_of_freedom == 65
            factors.append(fit.variance_factor)
    below = np.mean(65 * np.array(factors) < chi2.median(65))
    assert abs(below - 0.5) < spread_of_share(0.5, len(factors))


def test_a_form_error_of_five_half_waves_has_four_degrees_of_freedom(rng):
    """A form error of five half waves, which the ellipse cannot follow."""
    exact = upper_arc(pipe(30.0), count=200)
    outwards = exact - pipe(30.0).centre
    outwards /= np.hypot(*outwards.T)[:, None]
    wave = 0.02 * np.cos(np.linspace(0, 5 * math.pi, 200))[:, None]
    points = measured(exact, rng) + wave * outwards
    for settings in (ESTIMATED, FittingSettings()):
        fit = fit_noisy_points(noisy(points), pipe(30.0), settings=settings)
        assert fit.degrees_of_freedom == 4
        assert fit.variance_factor > 2


def chi_square_of(fit):
    return float(fit.normalised @ fit.normalised)


@pytest.mark.parametrize(("sigmas", "accepted"), [(-5, True), (3, True), (3.6, False), (5, False)])
def test_a_noise_model_is_accepted_up_to_3_3_sigma_of_chi_square(sigmas, accepted):
    truth = pipe(30.0)
    points = measured(upper_arc(truth, count=200), np.random.default_rng(3))
    fit = fit_noisy_points(noisy(points), truth)
    assert fit.correlation.autocorrelation_time == 1
    wanted = 1 + sigmas * math.sqrt(2 / 195)
    ratio = chi_square_of(fit) / 195 / wanted
    again = fit_noisy_points(noisy(points, ratio), truth)
    assert chi_square_of(again) / 195 == pytest.approx(wanted, rel=1e-3)
    assert again.variance_factor == (1.0 if accepted else pytest.approx(wanted, rel=1e-3))
    assert math.isinf(again.degrees_of_freedom)


@pytest.mark.parametrize(
    ("sigmas", "surely"), [(4.0, False), (4.9, False), (5.1, True), (6.0, True)]
)
def test_an_ellipse_is_surely_no_circle_from_five_sigma_on(sigmas, surely, rng):
    fit = fit_ellipse(measured(upper_arc(pipe(30.0)), rng), pipe(30.0))
    h = math.hypot(*fit.parameters[3:])
    largest = np.linalg.norm(fit.unscaled_covariance[3:, 3:], 2)
    message = replace(fit, variance_factor=(h / sigmas) ** 2 / largest)
    assert message.is_noncircular is surely


def test_normals_point_outwards_across_the_ellipse(rng):
    truth = pipe(30.0)
    fit = fit_ellipse(measured(upper_arc(truth), rng), truth)
    np.testing.assert_allclose(np.abs(fit.normals), 1.0, atol=1e-12)
    for point, normal in zip(fit.problem.points, fit.normals, strict=True):
        slope = approx_fprime(
            point, lambda xy: orthogonal_residuals(xy[None], fit.ellipse)[0], 1e-6
        )
        assert abs(complex(*slope) - normal) < 1e-4


def test_the_correlation_of_the_residuals_comes_with_the_fit(rng):
    exact = upper_arc(pipe(30.0), count=300)
    averaged = np.convolve(rng.normal(size=304), np.ones(5) / math.sqrt(5), mode="valid")
    toward = exact / np.linalg.norm(exact, axis=1)[:, None]
    fit = fit_noisy_points(noisy(exact + 0.05 * averaged[:, None] * toward), pipe(30.0))
    assert fit.correlation.neighbours_correlated
    # A fit of five parameters takes a little of it away.
    assert 3 < fit.correlation.autocorrelation_time < 25
    assert fit.variance_factor == pytest.approx(fit.correlation.autocorrelation_time, rel=0.5)


@pytest.mark.parametrize("assumed", [1e-4, 1.0, 1e4], ids=["too small", "right", "too large"])
def test_a_known_radius_weighs_as_its_std_says_whatever_the_assumed_noise(assumed):
    """The noise is estimated: the given variances are only relative weights."""
    truth, std = pipe(30.0), 0.1
    points = measured(upper_arc(truth, count=200), np.random.default_rng(1))
    known = RadiusPrior(truth.radius + 0.3, std)
    fit = fit_noisy_points(noisy(points, assumed), truth, known, settings=ESTIMATED)
    stds = ray_stds(points, truth)
    points = fit.problem.points  # without the bias
    free, solution = least_squares_by_scipy(points, stds, truth)
    size = math.sqrt(2 * solution.cost / 195)
    wanted, _ = least_squares_by_scipy(
        points, size * stds, truth, lambda e: (e.semi_minor - known.radius) / std
    )
    assert truth.radius < free.radius + 0.3 * std
    assert abs(free.radius - wanted.radius) > 0.1 * std
    # Of the noise, which the second scaling takes from the fit with the prior: 1 in 400.
    assert_same_ellipse(fit.ellipse, wanted, atol=0.02 * abs(free.radius - wanted.radius))


def test_with_a_prior_a_too_optimistic_noise_model_scales_the_points_and_not_the_prior(rng):
    truth = pipe(25.0)
    points = measured(upper_arc(truth), rng)
    known = RadiusPrior(19.0, 0.5)
    fit = fit_ellipse(points, truth, SENSOR.covariances(points) / 16, known_radius=known)
    right = fit_ellipse(points, truth, SENSOR.covariances(points), known_radius=known)
    assert fit.variance_factor == 1
    np.testing.assert_allclose(fit.problem.stds / right.problem.stds, 1.0, atol=0.4)


def test_a_known_tilt_weighs_as_its_std_says_whatever_the_assumed_noise():
    truth, std = pipe(30.0), math.radians(0.5)
    points = measured(upper_arc(truth, count=200), np.random.default_rng(1))
    known = PhiPrior(math.radians(32.0), std)
    for assumed in (1e-4, 1e4):
        fit = fit_noisy_points(noisy(points, assumed), truth, None, known, ESTIMATED)
        unbiased, stds = fit.problem.points, ray_stds(points, truth)
        free, solution = least_squares_by_scipy(unbiased, stds, truth)
        size = math.sqrt(2 * solution.cost / 195)
        wanted, _ = least_squares_by_scipy(
            unbiased, size * stds, truth, lambda e: (e.phi - known.phi) / std
        )
        assert wanted.phi - free.phi > 0.1 * std
        assert fit.ellipse.phi == pytest.approx(wanted.phi, abs=0.03 * (wanted.phi - free.phi))


def test_a_tilt_known_to_be_none_makes_a_circle_of_an_arc_with_estimated_noise(rng):
    truth = pipe(0.0)
    points = measured(upper_arc(truth, 70.0), rng)
    fit = fit_noisy_points(noisy(points, 1e-4), truth, None, PhiPrior(0.0), ESTIMATED)
    free = fit_noisy_points(noisy(points, 1e-4), truth, settings=ESTIMATED)
    assert fit.ellipse.phi < math.radians(0.2)
    stds = [CylinderSection(each, Arc(0, 70), np.arange(70)).radius_std for each in (fit, free)]
    assert stds[0] < stds[1] / 3
    assert abs(fit.ellipse.radius - truth.radius) < 4 * stds[0]


def test_the_fit_forgets_its_start(rng):
    truth = pipe(25.0)
    points = measured(upper_arc(truth), rng)
    covariances = SENSOR.covariances(points)
    first = fit_ellipse(points, truth, covariances, settings=FittingSettings(reweightings=3))
    second = fit_ellipse(
        points, about(truth), covariances, settings=FittingSettings(reweightings=3)
    )
    assert_same_ellipse(second.ellipse, first.ellipse, atol=1e-5)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_too_few_points_are_rejected(count):
    with pytest.raises(TooFewPoints, match=f"an arc has {count} points? and needs 6: scan slower"):
        fit_ellipse(upper_arc(pipe(20.0))[:count], pipe(20.0))


@pytest.mark.parametrize("slope", [0.0, 0.3])
@pytest.mark.parametrize("with_noise_model", [False, True])
def test_a_straight_line_has_no_ellipse(slope, with_noise_model):
    x = np.linspace(-20, 20, 50)
    points = np.column_stack([x, slope * x - 400])
    covariances = np.tile(1e-4 * np.eye(2), (50, 1, 1)) if with_noise_model else None
    with pytest.raises(FitFailed, match="straight line"):
        fit_ellipse(points, pipe(0.0), covariances)
