import math

import numpy as np
import pytest
from scipy.stats import t as student

from lsvision import Arc, CylinderSection
from lsvision.ellipse.fit import FittingSettings, fit_noisy_points
from lsvision.ellipse.outcomes import unwrap
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.ellipse.refinement import refine_arcs
from lsvision.errors import LsvisionError, TooFewPoints
from lsvision.geometry.noisy_points import NoisyPoints
from tests.alike import assert_same_ellipse
from tests.ellipse.arcs import SENSOR, about, measured, pipe, upper_arc
from tests.tolerances import spread_of_share

TRUTH = pipe(25.0)
FREE = Priors(None, None)
SETTINGS = FittingSettings(reweightings=1)
STD = 0.05
RUNS = 200


def isotropic(points, std=STD):
    return NoisyPoints.of(points, np.tile(std**2 * np.eye(2), (len(points), 1, 1)))


def averaged(exact, columns, rng):
    """Return points with errors along Y that are averages over a number of columns."""
    kernel = np.ones(columns) / math.sqrt(columns)
    errors = np.convolve(rng.normal(size=len(exact) + columns - 1), kernel, mode="valid")
    return exact + STD * errors[:, None] * [0.0, 1.0]


def growing(exact, rng):
    """Isotropic errors whose variance grows with the incidence as on real spheres."""
    u, v = TRUTH.to_ellipse_frame(exact).T
    gradient = np.column_stack([u / TRUTH.semi_major**2, v / TRUTH.semi_minor**2])
    normals = TRUTH.from_ellipse_frame(gradient) - TRUTH.centre
    incidence_deg = np.degrees(np.arccos(normals[:, 1] / np.hypot(*normals.T)))
    factors = np.minimum(np.sqrt(1 + (incidence_deg / 45) ** 8), 4.0)
    return exact + STD * factors[:, None] * rng.normal(size=exact.shape)


def refined(points, estimated_std=STD, priors=FREE):
    return refine_arc(points, TRUTH, priors, SETTINGS, estimated_std)


def refine_arc(points, start, priors, settings, estimated_std):
    """Refinement of one arc."""
    (outcome,) = refine_arcs([points], [start], priors, settings, [estimated_std])
    return unwrap(outcome)


def section_of(fit):
    count = len(fit.problem.points)
    return CylinderSection(fit, Arc(0, count), np.arange(count))


def covers(fit, level=0.95):
    """Whether the radius lies within its standard uncertainty times Student's quantile."""
    quantile = student.ppf((1 + level) / 2, min(fit.degrees_of_freedom, 1e6))
    section = section_of(fit)
    return abs(section.radius - TRUTH.radius) < quantile * section.radius_std


def test_a_given_noise_model_is_fitted_once_and_accepted(rng):
    points = measured(upper_arc(TRUTH), rng)
    noisy = NoisyPoints.of(points, SENSOR.covariances(points))
    fit = refine_arc(noisy, TRUTH, FREE, SETTINGS, None)
    (wanted,) = fit_noisy_points([(noisy, TRUTH)], settings=SETTINGS)
    np.testing.assert_array_equal(fit.parameters, wanted.parameters)
    np.testing.assert_array_equal(fit.problem.stds, wanted.problem.stds)


def test_independent_isotropic_errors_keep_equal_weights(rng):
    fits = [
        refined(isotropic(upper_arc(TRUTH) + STD * rng.normal(size=(70, 2)))) for _ in range(RUNS)
    ]
    equal = np.mean([np.ptp(fit.problem.stds) < 1e-9 for fit in fits])
    # Two in a hundred seem to grow with incidence, one in 4000 to be correlated.
    assert abs(equal - 0.98) < spread_of_share(0.02, RUNS)


@pytest.mark.parametrize("assumed", [0.01, 0.05, 0.25])
def test_the_size_of_the_noise_comes_from_the_residuals(assumed, rng):
    points = upper_arc(TRUTH, count=400) + STD * rng.normal(size=(400, 2))
    fit = refined(isotropic(points, assumed), assumed)
    time = fit.correlation.autocorrelation_time
    stds = fit.problem.stds * math.sqrt(fit.variance_factor / time)
    assert np.median(stds) == pytest.approx(STD, rel=0.15)


def test_correlated_errors_are_fitted_again_with_errors_that_grow_with_incidence(rng):
    exact = upper_arc(TRUTH, count=200)
    fit = refined(isotropic(averaged(exact, 5, rng)))
    assert fit.correlation.neighbours_correlated
    incidence = np.arccos(fit.normals.imag)
    square_on, steep = incidence < math.radians(20), incidence > math.radians(66)
    assert steep.sum() > 5
    np.testing.assert_allclose(fit.problem.stds[square_on], STD, rtol=0.01)
    np.testing.assert_allclose(fit.problem.stds[steep], 4 * STD, rtol=0.01)


def test_independent_errors_that_grow_with_incidence_are_fitted_so(rng):
    fit = refined(isotropic(growing(upper_arc(TRUTH, count=200), rng)))
    assert fit.problem.stds.max() > 3 * fit.problem.stds.min()


def test_knowing_that_errors_grow_makes_the_radius_more_accurate():
    rng, errors = np.random.default_rng(11), []
    for _ in range(RUNS):
        noisy = isotropic(growing(upper_arc(TRUTH, 150.0, 120), rng))
        estimated = FittingSettings(variance="estimated")
        (equal,) = fit_noisy_points([(noisy, TRUTH)], settings=estimated)
        errors.append([fit.ellipse.radius - TRUTH.radius for fit in (refined(noisy), equal)])
    ours, plain = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ours < 0.8 * plain


@pytest.mark.parametrize("columns", [1, 3, 5])
def test_the_stated_uncertainty_covers_the_radius_of_smoothed_data(columns):
    rng = np.random.default_rng(12)
    exact = upper_arc(TRUTH, count=150)
    covered = np.mean(
        [covers(refined(isotropic(averaged(exact, columns, rng)))) for _ in range(RUNS)]
    )
    assert covered > 0.95 - spread_of_share(0.95, RUNS)


def test_growing_errors_are_covered_too():
    rng = np.random.default_rng(13)
    exact = upper_arc(TRUTH, count=100)
    covered = np.mean([covers(refined(isotropic(growing(exact, rng)))) for _ in range(RUNS)])
    assert abs(covered - 0.95) < spread_of_share(0.95, RUNS)


@pytest.mark.parametrize("columns", [1, 5])
@pytest.mark.parametrize("assumed", [0.005, 0.05, 0.5])
def test_an_exactly_known_radius_is_kept_whatever_the_noise_is_assumed_to_be(assumed, columns, rng):
    points = averaged(upper_arc(TRUTH, count=150), columns, rng)
    known = Priors(RadiusPrior(TRUTH.radius), None)
    fit, free = (refined(isotropic(points, assumed), assumed, p) for p in (known, FREE))
    assert fit.ellipse.radius == pytest.approx(TRUTH.radius, abs=1e-4)
    assert abs(fit.ellipse.phi - TRUTH.phi) < abs(free.ellipse.phi - TRUTH.phi) + math.radians(1)
    assert section_of(fit).phi_std < section_of(free).phi_std


@pytest.mark.parametrize("assumed", [0.005, 0.5])
def test_a_vaguely_known_radius_changes_nothing_whatever_the_assumed_noise(assumed, rng):
    points = isotropic(averaged(upper_arc(TRUTH, count=150), 1, rng), assumed)
    vague = refined(points, assumed, Priors(RadiusPrior(25.0, 1e4), None))
    assert_same_ellipse(vague.ellipse, refined(points, assumed).ellipse, atol=1e-4)


@pytest.mark.parametrize("assumed", [0.005, 0.5])
def test_a_tilt_of_zero_makes_a_circle_whatever_the_assumed_noise(assumed, rng):
    circle = pipe(0.0)
    points = isotropic(upper_arc(circle, 70.0) + STD * rng.normal(size=(70, 2)), assumed)
    fit = refine_arc(points, about(circle), Priors(None, PhiPrior(0.0)), SETTINGS, assumed)
    assert fit.ellipse.phi < math.radians(0.2)
    assert abs(fit.ellipse.radius - 19.0) < 5 * section_of(fit).radius_std < 1.0


def test_too_few_points_are_rejected():
    with pytest.raises(TooFewPoints, match="an arc has 5 points and needs 6"):
        refined(isotropic(upper_arc(TRUTH)[:5]))


def arcs_of_all_kinds(rng):
    """Arcs of many sizes: independent, averaged and growing errors, a short one and a line."""
    exact = [upper_arc(TRUTH, 80.0 + 10 * i, 60 + 25 * i) for i in range(8)]
    arcs = [isotropic(each + STD * rng.normal(size=each.shape)) for each in exact[:3]]
    arcs += [isotropic(averaged(each, 5, rng)) for each in exact[3:5]]
    arcs += [isotropic(growing(each, rng)) for each in exact[5:]]
    x = np.linspace(-20.0, 20.0, 40)
    line = isotropic(np.column_stack([x, 0.1 * x - 400.0]))
    return [*arcs, arcs[0][:4], line, arcs[1]], [STD] * 10 + [None]


@pytest.mark.parametrize("order", ["as they are", "reverse"])
@pytest.mark.parametrize(
    "priors",
    [
        FREE,
        Priors(RadiusPrior(TRUTH.radius), None),
        Priors(None, PhiPrior(TRUTH.phi, 0.01)),
        Priors(RadiusPrior(TRUTH.radius, 0.1), PhiPrior(0.0, 0.4)),
    ],
    ids=["free", "radius", "phi", "both"],
)
def test_arcs_in_a_stack_are_fitted_as_alone_and_a_failure_stops_no_other(priors, order, rng):
    points, stds = arcs_of_all_kinds(rng)
    if order == "reverse":
        points, stds = points[::-1], stds[::-1]
    fits = refine_arcs(points, [TRUTH] * len(points), priors, SETTINGS, stds)
    failures = 0
    for fit, arc, std in zip(fits, points, stds, strict=True):
        (alone,) = refine_arcs([arc], [TRUTH], priors, SETTINGS, [std])
        if isinstance(alone, LsvisionError):
            assert type(fit) is type(alone)
            failures += 1
            continue
        np.testing.assert_allclose(fit.parameters, alone.parameters, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            fit.parameter_covariance, alone.parameter_covariance, rtol=1e-6, atol=1e-12
        )
        np.testing.assert_allclose(fit.normalised, alone.normalised, atol=1e-6)
        assert fit.degrees_of_freedom == pytest.approx(alone.degrees_of_freedom)
        assert (fit.correlation.neighbours_correlated, fit.converged) == (
            alone.correlation.neighbours_correlated, alone.converged,
        )  # fmt: skip
    assert failures >= 1


def test_no_arcs_are_refined_to_none():
    assert refine_arcs([], [], FREE, SETTINGS, []) == []
