"""Series whose spectrum is set wave by wave: what of it counts as correlation is then exact."""

import math

import numpy as np
import pytest
from scipy.fft import dct, idct
from scipy.stats import chi2, norm

from lsvision.ellipse.parameters import PARAMETERS
from lsvision.statistics import correlation
from lsvision.statistics.correlation import (
    FIT_PARAMETERS,
    autocorrelation_time,
    debiased_autocorrelation_time,
    estimate_correlation,
    neighbour_correlation,
)
from tests.tolerances import ROUNDING, spread_of_share

COUNT = 400
RUNS = 60
ROUGHLY = 0.15  # of the mean over 60 runs; a single one is off by a third


def series(powers, seed=0):
    """A series with the given power of each half wave, and no other regularity."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(powers))
    return idct(np.sqrt(powers) * signs, norm="ortho")


def raised(where, power, count=COUNT):
    """A flat spectrum but for some waves."""
    powers = np.ones(count)
    powers[where] = power
    return powers


def power_for(ratio, waves=4, count=COUNT):
    """Power of so many waves that makes their share `ratio` times that of independent errors."""
    return ratio * (count - waves) / (count - waves * ratio)


def lag_one_sigmas(values):
    """Correlation of neighbours in its standard errors."""
    centred = values - values.mean()
    rho = np.correlate(centred[1:], centred[:-1])[0] / np.sum(centred**2)
    return float(rho) * math.sqrt(len(values))


def smoothed_by(share, seed=4, count=COUNT):
    """White noise with a share of the neighbour's value added."""
    white = np.random.default_rng(seed).normal(size=count + 1)
    return white[1:] + share * white[:-1]


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_the_autocorrelation_time_is_that_of_a_first_order_process(rho, rng):
    values = np.zeros(4000)
    for i in range(1, len(values)):
        values[i] = rho * values[i - 1] + rng.normal()
    # The cut at insignificant lags leaves a little out.
    assert autocorrelation_time(values) == pytest.approx((1 + rho) / (1 - rho), rel=0.2)


@pytest.mark.parametrize(
    "values", [np.zeros(50), np.ones(50), np.array([1.0, -1.0] * 20), np.arange(7.0)],
    ids=["zero", "constant", "alternating", "short"],
)  # fmt: skip
def test_series_without_positive_correlation_count_in_full(values):
    assert autocorrelation_time(values) == 1.0


def test_chance_passes_for_correlation_as_often_as_three_sigma_allow():
    runs = 8000
    values = np.random.default_rng(1).normal(size=(runs, 1000))
    share = np.mean([autocorrelation_time(row) > 1 for row in values])
    assert abs(share - norm.sf(3)) < spread_of_share(norm.sf(3), runs)


def after_a_fit(values):
    """The residuals of a polynomial with five coefficients."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, len(values)), 5))
    return values - basis @ (basis.T @ values)


@pytest.mark.parametrize(("count", "smallest"), [(20, 0.1), (33, 0.65)])
def test_the_correlation_that_a_fit_of_few_points_has_absorbed_counts(count, smallest):
    """Without the correction for five parameters, 0 and 46 % of the means over 5 are found."""
    rng, runs = np.random.default_rng(2), 2000
    white = rng.normal(size=(runs, count + 4))
    found = [
        np.mean([estimate_correlation(after_a_fit(row)).neighbours_correlated for row in rows])
        for rows in (
            white[:, 4:],
            np.array([np.convolve(row, np.ones(5), "valid") for row in white]),
        )
    ]
    print(f"{count} points: {found[0]:.2%} of white noise, {found[1]:.0%} of means over 5")
    assert found[0] < norm.sf(3) + spread_of_share(norm.sf(3), runs)
    assert found[1] > smallest


def test_independent_errors_count_in_full():
    found = estimate_correlation(series(np.ones(COUNT)))
    assert found.degrees_of_freedom == math.inf
    assert not found.neighbours_correlated
    assert found.autocorrelation_time == 1.0


@pytest.mark.parametrize(("wave", "counts"), [(3, False), (4, True), (7, True), (8, False)])
def test_the_four_lowest_waves_that_five_parameters_leave_are_looked_at(wave, counts):
    found = estimate_correlation(series(raised(wave, 20.0)))
    assert found.degrees_of_freedom == (4 if counts else math.inf)


@pytest.mark.parametrize("factor", [0.8, 0.97, 1.03, 1.2])
def test_low_waves_stand_out_where_chance_would_do_it_once_in_40(factor):
    ratio = factor * chi2.isf(1 / 40, 4) / 4
    found = estimate_correlation(series(raised(slice(4, 8), power_for(ratio))))
    assert found.degrees_of_freedom == (4 if factor > 1 else math.inf)


def test_one_arc_in_40_of_independent_errors_is_called_correlated():
    runs = 4000
    values = np.random.default_rng(2).normal(size=(runs, 120))
    share = np.mean([estimate_correlation(row).degrees_of_freedom == 4 for row in values])
    assert abs(share - 1 / 40) < spread_of_share(1 / 40, runs)


@pytest.mark.parametrize(("waves", "power"), [(slice(4, 6), 16.0), (slice(6, 8), 8.5)])
def test_a_form_error_in_the_lowest_two_waves_counts_with_its_own_power(waves, power):
    """An arc of two radii shows there; spread over four waves its error would be too small."""
    powers = raised(waves, 16.0)
    found = estimate_correlation(series(powers))
    low = power / powers.mean()
    rise = low / (powers[12:34].mean() / powers.mean())
    assert not found.neighbours_correlated
    assert found.autocorrelation_time == pytest.approx(low * rise, rel=ROUNDING)


def test_the_rise_towards_low_waves_is_extrapolated():
    powers = raised(slice(4, 8), 6.0)
    powers[12:34] = np.linspace(0.2, 0.9, 22)
    powers[[8, 9, 10, 11, *range(34, 44)]] = 3.0  # between the bands and beyond: not compared
    found = estimate_correlation(series(powers))
    low = 6.0 / powers.mean()
    assert not found.neighbours_correlated
    assert found.autocorrelation_time == pytest.approx(
        low * 6.0 / powers[12:34].mean(), rel=ROUNDING
    )


def test_low_waves_below_the_reference_are_not_extrapolated_downwards():
    powers = raised(slice(4, 8), 6.0)
    powers[12:34] = 9.0
    found = estimate_correlation(series(powers))
    assert found.autocorrelation_time == pytest.approx(9.0 / powers.mean(), rel=ROUNDING)


def test_the_rise_counts_one_and_a_half_times_at_most_where_the_sensor_smooths():
    powers = np.where(np.arange(COUNT) < COUNT // 3, 1.0, 0.2)
    powers[4:8] = 8.0
    values = series(powers)
    found = estimate_correlation(values)
    waves = dct(values, norm="ortho") ** 2
    assert found.neighbours_correlated
    assert found.degrees_of_freedom == 4
    assert waves[4:8].mean() > 4 * waves[12:34].mean()
    assert found.autocorrelation_time == pytest.approx(1.5 * waves[4:8].mean() / waves.mean())


@pytest.mark.parametrize(("count", "has_bands"), [(33, False), (34, True)])
def test_34_points_have_a_reference_band(count, has_bands):
    values = series(raised(slice(4, 8), power_for(3.0, count=count), count))
    found = estimate_correlation(values)
    assert not found.neighbours_correlated
    assert (found.degrees_of_freedom < math.inf) is has_bands


def test_below_34_points_neighbours_decide_alone():
    blocks = np.repeat([1.0, -1.0, 1.0, -1.0], 8)
    found = estimate_correlation(blocks)
    assert found.neighbours_correlated
    assert found.degrees_of_freedom == 4
    assert found.autocorrelation_time == autocorrelation_time(blocks) > 3


def test_neighbours_are_correlated_where_chance_would_do_it_once_in_1000():
    limit = norm.isf(1.35e-3) - 5 / math.sqrt(COUNT)  # 3 sigma above the mean after a fit
    every = [smoothed_by(share) for share in np.linspace(0.05, 0.3, 60)]
    sigmas = np.array([lag_one_sigmas(values) for values in every])
    assert sigmas.min() < limit - 1 < limit + 1 < sigmas.max()
    clear = np.abs(sigmas - limit) > 0.1
    found = np.array([estimate_correlation(values).neighbours_correlated for values in every])
    np.testing.assert_array_equal(found[clear], sigmas[clear] > limit)


def test_correlation_is_the_same_from_either_end():
    values = smoothed_by(0.8)
    there, back = estimate_correlation(values), estimate_correlation(values[::-1])
    assert there.autocorrelation_time == pytest.approx(back.autocorrelation_time, rel=ROUNDING)
    assert (there.degrees_of_freedom, there.neighbours_correlated) == (4, True)
    assert (back.degrees_of_freedom, back.neighbours_correlated) == (4, True)


def residuals_of_decaying_noise(length, seed):
    """Decaying noise of unit variance, a parabola taken out as a fit would."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-1 / length) if length else 0.0
    noise, last = np.empty(COUNT), rng.normal()
    for index, step in enumerate(rng.normal(size=COUNT)):
        last = keep * last + np.sqrt(1 - keep**2) * step
        noise[index] = last
    x = np.linspace(-1, 1, COUNT)
    return noise - np.polyval(np.polyfit(x, noise, 2), x)


@pytest.mark.parametrize("length", [0, 2, 5])
def test_debiased_time_of_fitted_decaying_noise_agrees_with_its_theory(length):
    keep = np.exp(-1 / length) if length else 0.0
    truth = (1 + keep) / (1 - keep)
    times = [
        debiased_autocorrelation_time(residuals_of_decaying_noise(length, seed), 3)
        for seed in range(RUNS)
    ]
    assert np.mean(times) == pytest.approx(truth, rel=ROUGHLY)


def test_debiased_time_of_exact_and_of_alternating_residuals_is_one():
    assert debiased_autocorrelation_time(np.zeros(50), 3) == 1.0
    assert debiased_autocorrelation_time(np.tile([1.0, -1.0], 40), 3) == 1.0


@pytest.mark.parametrize("count", [34, 77, 200])
def test_powers_of_the_bands_are_those_of_a_fourier_transform(count, rng):
    """Of the residuals and their mirror image."""
    residuals = rng.normal(size=count)
    transform = np.fft.rfft(np.concatenate([residuals, residuals[::-1]]))
    powers = np.abs(transform) ** 2 / (2 * residuals @ residuals)
    wanted = [powers[4:8].mean(), powers[4:6].mean(), powers[12:34].mean()]
    np.testing.assert_allclose(correlation._compute_band_powers(residuals), wanted, rtol=1e-9)


@pytest.mark.parametrize(("count", "is_correlated"), [(7, False), (8, True), (9, True)])
def test_a_ramp_of_eight_points_is_correlated_and_one_of_seven_too_short(count, is_correlated):
    time, correlated = neighbour_correlation(np.arange(float(count)), 5)
    assert correlated is is_correlated
    assert (time > 1) is is_correlated


def test_the_fit_of_an_ellipse_has_five_parameters():
    assert FIT_PARAMETERS == PARAMETERS == 5
