"""Against published examples, all printed digits; coverage of intervals by simulation."""

import math

import numpy as np
import pytest
from scipy import stats

from lsvision.errors import LsvisionError, TooFewPoints
from lsvision.inspection.capability import binomial_interval, estimate_capability
from lsvision.inspection.gauge_study import study_gauge
from lsvision.inspection.repeat_study import study_repeats
from lsvision.inspection.variance_intervals import mean_square_interval

# AIAG, Measurement Systems Analysis, 4th edition: a part a row; three trials of A, of B, of C.
AIAG = """
0.29 0.41 0.64 0.08 0.25 0.07 0.04 -0.11 -0.15
-0.56 -0.68 -0.58 -0.47 -1.22 -0.68 -1.38 -1.13 -0.96
1.34 1.17 1.27 1.19 0.94 1.34 0.88 1.09 0.67
0.47 0.50 0.64 0.01 1.03 0.20 0.14 0.20 0.11
-0.80 -0.92 -0.84 -0.56 -1.20 -1.28 -1.46 -1.07 -1.45
0.02 -0.11 -0.21 -0.20 0.22 0.06 -0.29 -0.67 -0.49
0.59 0.75 0.66 0.47 0.55 0.83 0.02 0.01 0.21
-0.31 -0.20 -0.17 -0.63 0.08 -0.34 -0.46 -0.56 -0.49
2.26 1.99 2.01 1.80 2.12 2.19 1.77 1.45 1.87
-1.36 -1.25 -1.31 -1.68 -1.62 -1.50 -1.49 -1.77 -2.16
"""
TABLE = np.array(AIAG.split(), dtype=float).reshape(10, 3, 3)


def sample(count, mean, std):
    """Values with exactly this mean and standard deviation."""
    raw = np.linspace(-1, 1, count)
    return mean + std * (raw - raw.mean()) / raw.std(ddof=1)


def test_the_analysis_of_variance_of_the_aiag_example():
    rows = {row.source: row for row in study_gauge(TABLE).rows}
    printed = {
        "parts": (9, 88.3619, 9.81799),
        "operators": (2, 3.1673, 1.58363),
        "interaction": (18, 0.3590, 0.01994),
        "repeatability": (60, 2.7589, 0.04598),
    }
    for name, (dof, square, mean) in printed.items():
        row = rows[name]
        found = (row.degrees_of_freedom, round(row.sum_of_squares, 4), round(row.mean_square, 5))
        assert found == (dof, square, mean), name
    assert round(rows["parts"].f, 3) == 492.291
    assert round(rows["operators"].f, 3) == 79.406
    assert (round(rows["interaction"].f, 3), round(rows["interaction"].p, 3)) == (0.434, 0.974)


def test_the_components_of_the_aiag_example():
    study = study_gauge(TABLE)
    assert study.pooled
    # As Minitab prints them; AIAG prints 0.302373 of the gauge, out of rounded components.
    printed = {  # variance, standard deviation, % of the total
        "repeatability": (0.03997, 0.19993, 18.42),
        "reproducibility": (0.05146, 0.22684, 20.90),
        "gauge": (0.09143, 0.30237, 27.86),
        "parts": (1.08645, 1.04233, 96.04),
    }
    for name, (variance, std, percent) in printed.items():
        found = study.get_component(name)
        assert round(found.variance, 5) == variance, name
        assert round(found.std, 5) == std, name
        assert round(100 * study.compute_fraction_of_total(name), 2) == percent, name
    assert study.distinct_categories == 4


def test_percent_of_tolerance_is_six_sigmas_over_it():
    study = study_gauge(TABLE, tolerance=8.0)
    assert round(100 * study.compute_fraction_of_tolerance("gauge"), 2) == round(
        100 * 6 * 0.302373 / 8, 2
    )
    assert math.isnan(study_gauge(TABLE).compute_fraction_of_tolerance("gauge"))
    text = str(study)
    assert "ISO 22514-7 is not claimed" in text
    assert "pooled with repeatability" in text


@pytest.mark.parametrize("value", [1.0, 0.1])  # the mean of three times 0.1 is not 0.1
def test_a_study_of_equal_values_has_no_fractions_of_the_total(value):
    study = study_gauge(np.full((3, 3, 3), value), tolerance=1.0)
    assert math.isnan(study.compute_fraction_of_total("gauge"))
    assert study.to_dict()["components"]["gauge"]["percent_of_total"] is None
    assert study.distinct_categories is None
    assert study.to_dict()["distinct_categories"] is None
    assert "ndc not determinable (repeated values are equal" in str(study)


def test_values_that_differ_between_parts_only_leave_no_rounding_errors_to_the_gauge():
    parts = 19 + 0.1 * np.arange(5)
    study = study_gauge(np.broadcast_to(parts[:, None, None], (5, 3, 2)))
    assert study.get_component("gauge").std == 0
    assert study.distinct_categories is None
    operators = parts[:, None, None] + 0.3 * np.arange(3)[None, :, None]
    rows = study_gauge(np.broadcast_to(operators, (5, 3, 2))).rows
    assert [row.sum_of_squares == 0 for row in rows] == [False, False, True, True]


def test_equal_values_have_no_spread():
    with pytest.raises(ValueError, match="got 3 without spread"):
        estimate_capability([0.1] * 3, (0.0, 1.0))
    study = study_repeats([0.1] * 3, 0.05, tolerance=1.0)
    assert (study.mean, study.std) == (0.1, 0.0)
    assert "nan" not in str(study)


def test_a_value_that_is_not_finite_is_rejected():
    with pytest.raises(LsvisionError, match="got 1 of 3 that are not: measure them again"):
        study_repeats([1.0, math.nan, 1.1], 1.0)
    values = np.ones((2, 2, 2))
    values[0, 0, 0] = math.inf
    with pytest.raises(LsvisionError, match="got 1 of 8 that are not"):
        study_gauge(values)


@pytest.mark.parametrize("level", [95, 0.0, math.nan])
def test_a_level_that_is_no_probability_is_rejected(level):
    for study in (
        lambda: study_repeats([1.0, 1.1], 1.0, level=level),
        lambda: study_gauge(TABLE, level=level),
        lambda: estimate_capability([1.0, 1.1], (0.0, 2.0), level=level),
        lambda: binomial_interval(1, 2, level),
    ):
        with pytest.raises(ValueError, match=f"expected a level between 0 and 1, got {level}"):
            study()


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan, math.inf])
def test_a_tolerance_that_is_not_above_zero_is_rejected(tolerance):
    for study in (
        lambda: study_repeats([1.0, 1.1], 1.0, tolerance=tolerance),
        lambda: study_gauge(TABLE, tolerance=tolerance),
    ):
        with pytest.raises(ValueError, match=f"finite tolerance above 0, got {tolerance}"):
            study()


def test_arguments_of_studies_that_give_no_number_are_rejected():
    with pytest.raises(ValueError, match="finite reference and finite stds, got nan"):
        study_repeats([1.0, 1.1], math.nan)
    with pytest.raises(ValueError, match="expected finite values, got some"):
        estimate_capability([1.0, math.nan], (0.0, 2.0))
    for limits in ((2.0, 0.0), (-math.inf, math.inf)):
        with pytest.raises(ValueError, match=r"limits \(lower, upper\), one or both finite, got"):
            estimate_capability([1.0, 1.1], limits)
    with pytest.raises(ValueError, match="expected hits from 0 to 2, got 3"):
        binomial_interval(3, 2)


def test_the_frame_of_a_study_has_the_ends_of_its_intervals():
    study = study_repeats([1.0, 1.2, 1.1], 1.0)
    (row,) = study.to_dataframe().to_dict("records")
    assert (row["bias_low"], row["bias_high"]) == study.bias_interval
    assert (row["std_low"], row["std_high"]) == study.std_interval
    gauge = study_gauge(np.arange(8.0).reshape(2, 2, 2))
    frame = gauge.to_dataframe()
    assert list(frame["component"]) == [component.name for component in gauge.components]
    assert list(frame["std_high"]) == [component.interval[1] for component in gauge.components]


def test_a_study_of_another_shape_is_rejected():
    with pytest.raises(ValueError, match=r"shape \(parts, operators, trials\), got \(5, 3\)"):
        study_gauge(np.zeros((5, 3)))


def test_the_interval_of_one_mean_square_is_that_of_chi_squared():
    low, high = mean_square_interval([1.0], [0.04], [60], level=0.9)
    assert low == pytest.approx(0.04 * 60 / stats.chi2.ppf(0.95, 60))
    assert high == pytest.approx(0.04 * 60 / stats.chi2.ppf(0.05, 60))


@pytest.mark.parametrize("interaction", [0.0, 0.5])
def test_the_intervals_of_a_gauge_study_hold_the_truth(interaction, rng):
    draws, true = 250, {"repeatability": 1.0, "parts": 3.0}
    true["gauge"] = math.sqrt(1.0 + 0.7**2 + interaction**2)
    misses = dict.fromkeys(true, 0)
    for _ in range(draws):
        table = rng.normal(0, 3.0, (10, 1, 1)) + rng.normal(0, 0.7, (1, 4, 1))
        table = table + rng.normal(0, interaction, (10, 4, 1)) + rng.normal(0, 1.0, (10, 4, 3))
        study = study_gauge(table)
        for name, std in true.items():
            low, high = study.get_component(name).interval
            misses[name] += not low <= std <= high
    # With the interaction pooled where it is not significant, repeatability is biased a little.
    limit = 0.05 if interaction == 0 else 0.12
    for name, count in misses.items():
        assert count <= stats.binom.ppf(0.9999, draws, limit), name


def test_a_study_without_variation_between_operators_has_no_negative_variance(rng):
    study = study_gauge(rng.normal(0, 1, (5, 3, 2)))
    assert all(each.variance >= 0 and each.interval[0] >= 0 for each in study.components)
    with pytest.raises(TooFewPoints, match="a gauge study by trials has 1 point and needs 2"):
        study_gauge(np.zeros((5, 3, 1)))


def test_cp_and_cpk_of_the_nist_handbook():
    # NIST/SEMATECH e-Handbook 7.1.6: limits 8 and 20, mean 16, s 2: Cp 1.0, Cpk 0.6667.
    found = estimate_capability(sample(50, 16.0, 2.0), (8.0, 20.0))
    assert (round(found.cp, 4), round(found.cpk, 4)) == (1.0, 0.6667)


def test_the_interval_of_cp_of_montgomery():
    # Introduction to Statistical Quality Control, example 8.4: n 20, Cp rounded to 2.29.
    found = estimate_capability(sample(20, 50.0, 24 / (6 * 2.29)), (38.0, 62.0))
    assert round(found.cp, 2) == 2.29
    assert tuple(round(end, 2) for end in found.cp_interval) == (1.57, 3.01)


def test_the_interval_of_cpk_of_the_sas_example():
    # SAS/QC User's Guide, amplification of 75 amplifiers: at 90 % from 0.328 to 0.496.
    decibels = """
        4.54 4.87 4.66 4.90 4.68 5.22 4.43 5.14 3.07 4.22 5.09 3.41 5.75 5.16 3.96 5.37 5.70 4.11
        4.83 4.51 4.57 4.16 5.73 3.64 5.48 4.95 4.57 4.46 4.75 5.38 5.19 4.35 4.98 4.87 3.53 4.46
        4.57 4.69 5.27 4.67 5.03 4.50 5.35 4.55 4.05 6.63 5.32 5.24 5.73 5.08 5.07 5.42 5.05 5.70
        4.79 4.34 5.06 4.64 4.82 3.24 4.79 4.46 3.84 5.05 5.46 4.64 6.13 4.31 4.81 4.98 4.95 5.57
        4.11 4.15 5.95
    """
    found = estimate_capability(list(map(float, decibels.split())), (4.0, 6.0), level=0.90)
    assert tuple(round(end, 3) for end in found.cpk_interval) == (0.328, 0.496)


def test_the_intervals_of_cp_and_cpk_hold_the_truth(rng):
    draws, misses = 800, np.zeros(2)
    for _ in range(draws):
        found = estimate_capability(rng.normal(0.0, 1.0, 30), (-4.0, 5.0))
        pairs = ((found.cp_interval, 1.5), (found.cpk_interval, 4 / 3))
        misses += [not low <= true <= high for (low, high), true in pairs]
    assert misses[0] <= stats.binom.ppf(0.9999, draws, 0.05)
    assert misses[1] <= stats.binom.ppf(0.9999, draws, 0.06)  # an approximation


def test_one_limit_gives_cpk_alone_and_the_measurements_fraction_is_reported():
    found = estimate_capability(sample(30, 1.0, 0.1), (-math.inf, 1.3), stds=[0.05] * 30)
    assert math.isnan(found.cp)
    assert found.cpk == pytest.approx(1.0)
    assert found.measurement_fraction == pytest.approx(0.25)
    with pytest.raises(ValueError, match="expected two values or more that differ, got 3"):
        estimate_capability([1.0, 1.0, 1.0], (0.0, 2.0))


def test_the_interval_of_a_share_is_that_of_clopper_and_pearson():
    for hits, count in ((0, 30), (3, 30), (30, 30)):
        expected = stats.binomtest(hits, count).proportion_ci(0.95, "exact")
        assert binomial_interval(hits, count) == pytest.approx((expected.low, expected.high))


def test_mean_and_standard_deviation_of_the_nist_reference_data():
    # NIST StRD: NumAcc1, mean 10000002, s 1; NumAcc3, mean 1000000.2, s 0.1 (1001 values).
    first = study_repeats([10000001, 10000003, 10000002], 10000000.0)
    assert (first.mean, first.std) == (10000002.0, 1.0)
    values = [1000000.2] + [1000000.1, 1000000.3] * 500
    third = study_repeats(values, 1000000.2)
    assert third.mean == pytest.approx(1000000.2, abs=1e-8)
    assert third.std == pytest.approx(0.1, abs=1e-9)


def test_bias_and_its_interval_are_those_of_a_t_test(rng):
    values = rng.normal(19.02, 0.05, 25)
    study = study_repeats(values, 19.0, tolerance=1.0)
    expected = stats.ttest_1samp(values, 19.0)
    assert study.p_value == pytest.approx(expected.pvalue)
    ends = expected.confidence_interval(0.95)
    assert study.bias_interval == pytest.approx((ends.low - 19.0, ends.high - 19.0))
    assert study.cg == pytest.approx(0.2 / (6 * values.std(ddof=1)))
    assert study.cgk == pytest.approx((0.1 - abs(values.mean() - 19)) / (3 * values.std(ddof=1)))
    assert "Cg" in str(study)
    with pytest.raises(TooFewPoints, match="a study of repeats has 1 point and needs 2"):
        study_repeats([1.0], 1.0)
