import math

import pytest

from lsvision.inspection.decision import (
    Decision,
    decide,
    judge_quantity,
    select_worst_decision,
    widen_interval,
)
from lsvision.inspection.limits import quantity_from_key
from lsvision.results.quantities import Estimate

OPEN = -math.inf


@pytest.mark.parametrize(
    ("interval", "limits", "decision"),
    [
        ((18.95, 19.05), (18.9, 19.1), "OK"),
        ((18.9, 19.1), (18.9, 19.1), "OK"),
        ((18.85, 19.05), (18.9, 19.1), "undecided"),
        ((18.95, 19.15), (18.9, 19.1), "undecided"),
        ((18.0, 20.0), (18.9, 19.1), "undecided"),
        ((19.11, 19.2), (18.9, 19.1), "NG"),
        ((18.0, 18.89), (18.9, 19.1), "NG"),
        ((19.1, 19.2), (18.9, 19.1), "undecided"),
        ((0.0, 1.9), (OPEN, 2.0), "OK"),
        ((2.1, 2.2), (OPEN, 2.0), "NG"),
        ((OPEN, 1.0), (OPEN, 2.0), "OK"),
    ],
)
def test_an_interval_decides(interval, limits, decision):
    assert decide(interval, limits) == decision


def test_the_worst_of_several_is_reported():
    ok, ng, undecided = Decision.OK, Decision.NG, Decision.UNDECIDED
    assert select_worst_decision([ok, undecided, ng]) == "NG"
    assert select_worst_decision([ok, undecided]) == "undecided"
    assert select_worst_decision([ok, ok]) == "OK"
    assert select_worst_decision([]) == "OK"


def test_an_extra_uncertainty_is_added_in_quadrature_to_each_half_width():
    low, high = widen_interval(10.0, (9.97, 10.04), 0.04 / 1.959964, 0.95)
    assert (10 - low, high - 10) == pytest.approx((0.05, math.hypot(0.04, 0.04)), abs=1e-7)
    assert widen_interval(10.0, (9.97, 10.04), 0.0, 0.95) == pytest.approx((9.97, 10.04), abs=1e-12)


def test_limits_far_from_the_origin_are_written_with_their_decimals():
    estimate = Estimate(quantity_from_key("point_x_mm"), 10000.05, 0.01, (10000.03, 10000.07))
    verdict = judge_quantity(estimate, (10000.06, 10000.16), 0.95)
    assert verdict.limits_text == "10000.06 .. 10000.16"
    assert verdict.reason.endswith("contains the limit 10000.06")
