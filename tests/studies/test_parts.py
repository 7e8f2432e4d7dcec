"""Repeatability, ablation, traps, pictured scenes, and how matches are counted."""

import math

import numpy as np
import pytest

from lsvision.geometry import Ellipse, radial_residuals
from lsvision.measure import Measurement, Settings, measure_cylinders
from lsvision.simulate import random_section
from lsvision.studies.chen_liu_2016.paper_pitfalls import printed_equation_four
from lsvision.studies.chen_liu_2016.repeatability import expected_range, phi_std_of_axes
from lsvision.studies.chen_liu_2016.timing import TUBES, count_matches
from tests.tolerances import spread_of_rms


@pytest.mark.parametrize(("count", "mean"), [(2, 1.128), (5, 2.326), (10, 3.078), (100, 5.015)])
def test_the_expected_range_is_that_of_the_tables_of_statistics(count, mean):
    assert expected_range(count) == pytest.approx(mean, abs=5e-4)


def test_the_spread_of_repeated_measurements_is_the_bound(report):
    repeated = report.repeatability
    ratios = np.array(repeated.stds_mm) / repeated.bound_stds_mm
    assert (np.abs(ratios - 1) < spread_of_rms(len(repeated.ellipses))).all()


def test_the_centres_do_not_fit_into_the_papers_box(report):
    assert report.repeatability.box_mm[1] > 1.0  # mm; the paper's is 0.6 mm high
    assert report.repeatability.noise_of_printed_box_mm < 0.06


def test_axes_that_vary_by_a_quarter_mm_mean_degrees_of_phi():
    """By simulation: a and b drawn independently about a pipe of phi = 30 deg."""
    a, b = 19.0 / math.cos(math.radians(30)), 19.0
    draws = np.random.default_rng(1).normal(0, 0.125, (20_000, 2))
    phi = np.degrees(np.arccos((b + draws[:, 1]) / (a + draws[:, 0])))
    assert phi_std_of_axes(0.125, 19.0, 30.0) == pytest.approx(phi.std(), rel=0.03)


def test_the_whole_chain_is_near_the_ideal_and_literal_smoothing_is_not(report):
    costs = {cost.name: cost for cost in report.costs}
    whole = costs["every step, as lsvision does it"]
    literal = costs["smoothing y over x"]
    assert whole.failed == 0
    assert max(whole.typical) < 2  # a dozen pipes: a median right to 40 %
    assert literal.typical[0] > 3  # radius
    assert all(bad > good for bad, good in zip(literal.typical, whole.typical, strict=True))


def test_smoothing_finds_the_jumps_inside_an_arc(report):
    """One point in twenty jumps: left in, they spoil the fit; smoothing leaves them out."""
    costs = {cost.name: cost for cost in report.costs}
    whole = costs["every step, as lsvision does it"]
    found = costs["sensor error of rough identification inside the arc"]
    left_in = costs["that sensor error and smoothing"]
    assert found.failed == 0
    assert max(found.typical) < 1.3 * max(whole.typical)
    assert min(left_in.worst) > 3 * max(found.worst)


def test_a_good_initial_guess_saves_evaluations(report):
    costs = {cost.name: cost for cost in report.costs}
    whole = costs["every step, as lsvision does it"]
    assert 2 < whole.evaluations < costs["homogenising"].evaluations + 0.2  # a dozen pipes
    assert costs["iterative fit: a direct algebraic one instead"].evaluations == 0


def test_the_five_traps_are_sprung(report):
    theta, distance, twins, division, which_way = (trap.checks for trap in report.traps)
    assert [round(check.value, 9) for check in theta] == [1.777777778, 5.0, 1.0, 0.0]
    assert distance[2].value > 1.2 > distance[0].value
    assert twins[0].value == pytest.approx(40)
    assert twins[1].value < 1e-9
    assert math.isnan(division[0].value)
    assert division[1].value == pytest.approx(0, abs=1e-9)
    assert [check.value for check in which_way[:2]] == [1, 0]
    assert which_way[2].value > 19


def test_the_printed_residual_is_ours_turned_by_90_deg():
    ellipse = Ellipse((3.0, -400.0), 22.0, 19.0, 0.4)
    points = np.random.default_rng(2).normal((3.0, -380.0), 5.0, (40, 2))
    printed = printed_equation_four(points, ellipse, ellipse.theta - math.pi / 2)
    np.testing.assert_allclose(printed, np.abs(radial_residuals(points, ellipse)), atol=1e-9)


def test_every_pictured_pipe_is_found_within_what_it_says(report):
    pipes = [pipe for scene in report.scenes for pipe in scene.pipes]
    assert len(pipes) == 6
    for pipe in pipes:
        value, std = pipe.radius_mm
        assert abs(value - pipe.true_radius_mm) < 5 * std
    assert sum(scene.false for scene in report.scenes) == 0


def test_a_result_counts_as_a_pipe_by_its_points():
    section = random_section("welded_pair", 0, noise_mm=0.05, tubes=TUBES)
    found = measure_cylinders(section.profile, radius=(10.0, 40.0))
    assert count_matches(found, section.truth) == (2, 0)
    twice = Measurement((*found.cylinders, found.cylinders[0]), ())
    assert count_matches(twice, section.truth) == (2, 1)
    assert count_matches(Measurement((), ()), section.truth) == (0, 0)


@pytest.mark.paper
def test_the_papers_chain_reports_flat_things():
    section = random_section("planar", 0, noise_mm=0.1, tubes=TUBES)
    literal = measure_cylinders(section.profile, radius=(10.0, 40.0), settings=Settings.paper())
    assert count_matches(literal, section.truth)[1] >= 1
    ours = measure_cylinders(section.profile, radius=(10.0, 40.0))
    assert count_matches(ours, section.truth) == (1, 0)
