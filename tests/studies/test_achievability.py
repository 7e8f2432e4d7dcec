"""What one section can give, and how many sections can."""

import math

import pytest

from lsvision.planning import Feed, SensorView, plan_scan
from lsvision.studies.chen_liu_2016.achievability import compare_with_bound
from lsvision.studies.chen_liu_2016.cases import build_paper_sensor

NOISE = 0.1  # mm

pytestmark = pytest.mark.paper


def test_the_printed_angles_cannot_come_from_one_section(reaches):
    """As `tests/paper/test_findings.py` has it, pipe by pipe."""
    angles = [reach for reach in reaches if reach.quantity.endswith("_deg")]
    assert len(angles) == 8
    assert all(reach.chance < 0.002 and not reach.reachable for reach in angles)


def test_the_printed_radii_of_single_pipes_can(reaches):
    radii = [reach for reach in reaches if reach.quantity == "radius_mm" and reach.table < 4]
    assert all(reach.reachable and 0.05 < reach.chance < 0.95 for reach in radii)


def test_the_sections_needed_reach_the_printed_error_and_one_fewer_does_not(reaches, bounds):
    reach = next(r for r in reaches if (r.table, r.quantity) == (2, "phi_deg"))
    view = SensorView(sensor=build_paper_sensor(NOISE), pitch=0.6, incidence_limit=math.radians(70))

    def worst(sections):
        pipes = {row.printed.radius_mm for row in bounds if row.printed.table == 2}
        angles, feed = (math.radians(20), math.radians(20)), Feed(sections=sections)
        plans = [plan_scan(radius, *angles, view=view, feed=feed) for radius in pipes]
        return 2 * math.degrees(max(plan.phi_std for plan in plans))

    assert worst(reach.sections_needed) <= reach.largest_printed
    assert worst(reach.sections_needed - 1) > reach.largest_printed


def test_the_noise_needed_makes_the_printed_errors_reachable(bounds, reaches):
    needed = min(reach.noise_needed_mm for reach in reaches)
    assert needed < NOISE / 100  # of theta at phi 10 deg


def test_probabilities_grow_as_the_bound_decreases(bounds, reaches):
    """The same rows judged with the bounds of many sections: everything can be had."""
    from dataclasses import replace

    rows = [
        replace(row, spreads={**row.spreads, "section": row.spreads["twenty"]}) for row in bounds
    ]
    many = compare_with_bound(rows, noise_mm=NOISE)
    assert all(a.chance > b.chance for a, b in zip(many, reaches, strict=True))
    assert sum(reach.reachable for reach in many) >= 11
