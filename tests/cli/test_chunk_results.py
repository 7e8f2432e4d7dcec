"""The one reason given for a profile without a cylinder."""

import numpy as np
import pytest

from lsvision import Profile, Rejection, measure_cylinders
from lsvision.cli.chunk_results import format_measurement_lines
from lsvision.measure import Measurement
from lsvision.profile import Arc

FLAT = Rejection(Arc(0, 90), "flat: 0.03 mm rms from a straight line", convex=False)
STEP = Rejection(Arc(90, 120), "no arc: 3 mm rms from a straight line", convex=False)
CORNER = Rejection(Arc(120, 140), "continues tangentially at one end")
FILLET = Rejection(Arc(140, 180), "concave towards the sensor", convex=False)


@pytest.mark.parametrize(
    ("rejections", "message"),
    [
        ((), "no valid point"),
        ((STEP, FLAT), FLAT.reason),
        ((FLAT, CORNER, FILLET), CORNER.reason),
        ((FILLET, FLAT), FLAT.reason),
    ],
)
def test_the_longest_arc_is_reported_before_flat_and_concave_stretches(rejections, message) -> None:
    assert Measurement((), rejections).reason == message


@pytest.mark.parametrize("seed", range(3))
def test_a_bar_with_rounded_corners_is_recognised_by_them(seed) -> None:
    """A table, and a bar of 60 mm on it whose corners have a radius of 15 mm."""
    x = np.arange(-80, 80, 0.25)
    inside = np.clip(np.abs(x) - 15, 0, 15)
    y = np.where(np.abs(x) < 30, -260 - 15 + np.sqrt(15**2 - inside**2), -300.0)
    rng = np.random.default_rng(seed)
    profile = Profile(np.column_stack([x, y + rng.normal(0, 0.02, len(x))]))
    measurement = measure_cylinders(profile)
    assert not measurement.cylinders
    (line,) = format_measurement_lines(measurement, profile, verbose=False)
    assert "flat" not in line
    assert "arcs rejected: -v lists them" in line


def test_a_flat_plate_is_reported_as_flat() -> None:
    x = np.arange(-60, 60, 0.4)
    y = -300 + 0.1 * x + np.random.default_rng(4).normal(0, 0.05, len(x))
    assert measure_cylinders(np.c_[x, y]).reason.startswith("flat: ")
