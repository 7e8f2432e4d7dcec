"""The numbers that prove the pitfalls in the paper's wording."""

import math

import numpy as np
import pytest

from lsvision.geometry import Ellipse, radial_residuals
from lsvision.studies.chen_liu_2016.paper_pitfalls import (
    check_pitfalls,
    evaluate_printed_equation_four,
)


def test_the_numbers_of_the_five_pitfalls():
    theta, distance, twins, division, which_way = (trap.checks for trap in check_pitfalls())
    assert [round(check.value, 9) for check in theta] == [1.777777778, 5.0, 1.0, 0.0]
    assert distance[2].value > 1.2 > distance[0].value
    assert twins[0].value == pytest.approx(40)
    assert twins[1].value < 1e-9
    assert math.isnan(division[0].value)
    assert division[1].value == pytest.approx(0, abs=1e-9)
    assert [check.value for check in which_way[:2]] == [1, 0]
    assert which_way[2].value > 19


def test_the_printed_residual_is_the_radial_one_with_theta_turned_by_90_deg():
    ellipse = Ellipse((3.0, -400.0), 22.0, 19.0, 0.4)
    points = np.random.default_rng(2).normal((3.0, -380.0), 5.0, (40, 2))
    printed = evaluate_printed_equation_four(points, ellipse, ellipse.theta - math.pi / 2)
    np.testing.assert_allclose(printed, np.abs(radial_residuals(points, ellipse)), atol=1e-9)
