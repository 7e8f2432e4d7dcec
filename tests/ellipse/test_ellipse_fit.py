import math

import numpy as np
import pytest
from hypothesis import given

from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.problem import RadiusPrior
from lsvision.ellipse.section import CylinderSection
from lsvision.errors import FitFailed, TooFewPoints
from lsvision.planning import section_bound
from lsvision.profile import Arc
from lsvision.statistics.correlation import autocorrelation_time
from tests.alike import assert_same_ellipse, turn_between
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc
from tests.strategies import PROPERTY, arcs_with_noise
from tests.tolerances import CONVERGED, FIVE_SIGMA, spread_of_rms

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


def test_a_vague_radius_changes_nothing(rng):
    truth = pipe(20.0)
    points = measured(upper_arc(truth), rng)
    covariances = SENSOR.covariances(points)
    free = fit_ellipse(points, truth, covariances)
    vague = fit_ellipse(points, truth, covariances, known_radius=RadiusPrior(30.0, 1e5))
    assert_same_ellipse(vague.ellipse, free.ellipse, atol=1e-5)
    np.testing.assert_allclose(vague.parameter_covariance, free.parameter_covariance, rtol=1e-3)


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


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_correlation_along_the_line_is_estimated(rho, rng):
    series = np.zeros(4000)
    for i in range(1, len(series)):
        series[i] = rho * series[i - 1] + rng.normal()
    # Of a first-order process; the cut at insignificant lags leaves a little out.
    assert autocorrelation_time(series) == pytest.approx((1 + rho) / (1 - rho), rel=0.2)


@pytest.mark.parametrize(
    "series", [np.zeros(50), np.ones(50), np.array([1.0, -1.0] * 20), np.arange(7.0)],
    ids=["zero", "constant", "alternating", "short"],
)  # fmt: skip
def test_series_without_positive_correlation_count_in_full(series):
    assert autocorrelation_time(series) == 1.0


def test_correlated_errors_widen_the_covariance(rng):
    truth, exact = pipe(30.0), upper_arc(pipe(30.0), count=300)
    white = rng.normal(size=340)
    smooth = np.convolve(white, np.ones(9) / 3, mode="same")[20:320, None]
    toward = exact / np.linalg.norm(exact, axis=1)[:, None]
    points = exact + 0.05 * smooth * toward
    fit = fit_ellipse(points, truth, SENSOR.covariances(points))
    assert fit.variance_factor > 4  # nine neighbours say the same


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
def test_too_few_points_are_refused(count):
    with pytest.raises(TooFewPoints, match=f"an arc has {count} points and needs 6: scan slower"):
        fit_ellipse(upper_arc(pipe(20.0))[:count], pipe(20.0))


@pytest.mark.parametrize("slope", [0.0, 0.3])
@pytest.mark.parametrize("with_noise_model", [False, True])
def test_a_straight_line_has_no_ellipse(slope, with_noise_model):
    x = np.linspace(-20, 20, 50)
    points = np.column_stack([x, slope * x - 400])
    covariances = np.tile(1e-4 * np.eye(2), (50, 1, 1)) if with_noise_model else None
    with pytest.raises(FitFailed, match="straight line"):
        fit_ellipse(points, pipe(0.0), covariances)
