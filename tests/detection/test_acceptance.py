"""Each reason has an arc that earns it, and the arc beside it that does not."""

import math
import re

import numpy as np
import pytest

from lsvision import Ellipse, PointNoise, Profile
from lsvision.detection.acceptance import (
    AcceptanceSettings,
    convergence_rejection_reason,
    coverage,
    neighbourhood_rejection_reason,
    radius_rejection_reason,
    rejection_reason,
)
from lsvision.detection.identification import IdentifiedArc
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.rejections import unassigned_run_reasons
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.profile import Arc
from tests.detection.scenes import bowl, dome, flat, line

RANGE = (5.0, 60.0)
STEEPEST = AcceptanceSettings().max_tilt_deg


def circle(radius, y=-440.0):
    return Ellipse((0.0, y), radius, radius, 0.0)


def arc_of(profile, ellipse, indices=None):
    indices = profile.valid_indices if indices is None else np.asarray(indices)
    return IdentifiedArc(Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse)


def against(points, ellipse, indices=None, noise_mm=0.02):
    profile = line(points, noise_mm=noise_mm)
    return rejection_reason(profile, arc_of(profile, ellipse, indices), RANGE)


def test_nothing_speaks_against_a_dome():
    assert against(dome(0, 20), circle(20)) is None


def needle(points=120):
    """A pipe tilted by 70 deg, its major axis along X."""
    ellipse = Ellipse((0.0, -440.0), 20 / math.cos(math.radians(70)), 20.0, 0.0)
    return ellipse.points_at(np.radians(np.linspace(170, 10, points))), ellipse


@pytest.mark.parametrize(
    ("points", "ellipse", "indices", "reason"),
    [
        pytest.param(dome(0, 20), circle(20), range(0, 60, 6),
                     "only 10 points on an ellipse, needs 12", id="few points"),
        pytest.param(bowl(0, 20, y=-440), circle(20), None, "concave towards the sensor",
                     id="concave"),
        pytest.param(dome(0, 80), circle(80), None, r"radius 80 mm outside 5 to 60 mm",
                     id="too large"),
        pytest.param(dome(0, 4.5, 85), circle(4.5), None, "radius 4.5 mm outside 5 to 60 mm",
                     id="too small"),
        pytest.param(*needle(), None, f"tilt 70 deg over {STEEPEST:.0f} deg", id="needle"),
        pytest.param(dome(0, 50, 15), circle(50), None, r"arc covers (29|30|31) deg, needs 38 deg",
                     id="short"),
        pytest.param(dome(0, 20), circle(20.3), None,
                     r"residual rms \d+\.\d times the noise, limit \d+\.\d", id="off"),
        pytest.param(dome(0, 20), circle(20), range(0, 64, 2),
                     r"only 32 of 63 points of the span lie on the ellipse", id="thin"),
    ],
)  # fmt: skip
def test_each_reason_has_an_arc_that_earns_it(points, ellipse, indices, reason):
    assert re.fullmatch(reason, against(points, ellipse, indices))


def test_a_dome_that_rises_less_than_its_noise_is_flat():
    points = dome(0, 11, 21) + 0.01 * np.sin(np.arange(14))[:, None]
    noise = PointNoise(np.tile(0.4**2 * np.eye(2), (len(points), 1, 1)))
    profile = prepare_profile(Profile(points), noise)
    found = rejection_reason(profile, arc_of(profile, circle(11)), RANGE)
    assert re.fullmatch(r"flat: rises 0\.7\d mm over its chord at 0\.(39|40) mm noise", found)


def test_an_unscreened_arc_may_scatter_more():
    profile = line(dome(0, 20))
    off = arc_of(profile, circle(20.12))
    assert "residual rms" in rejection_reason(profile, off, RANGE)
    assert rejection_reason(profile, off, RANGE, noise_factor_scale=10.0) is None


def test_coverage_is_the_fan_of_the_normals():
    turn = np.radians(np.linspace(30, 190, 50))
    assert coverage(np.exp(1j * turn)) == pytest.approx(math.radians(160))


def smooth_crest():
    """A dome of 2 x 30 deg that goes on along its tangents."""
    crest = dome(0, 20, 30)
    slope = math.tan(math.radians(30))
    right = flat(10, 30, y=crest[-1, 1], slope=-slope)
    left = right[::-1] * (-1, 1)
    return np.concatenate([left, crest, right]), len(left), len(left) + len(crest)


def test_the_crest_of_a_bent_sheet_goes_on_smoothly():
    points, start, stop = smooth_crest()
    profile = line(points)
    crest = arc_of(profile, circle(20), np.arange(start, stop))
    assert "goes on smoothly at both ends (turns " in neighbourhood_rejection_reason(profile, crest)


def test_a_pipe_on_a_plate_ends_in_a_kink():
    left, pipe = flat(-50, -20), dome(0, 20)
    profile = line(left, pipe, flat(20, 50))
    arc = arc_of(profile, circle(20), np.arange(len(left), len(left) + len(pipe)))
    assert neighbourhood_rejection_reason(profile, arc) is None


def test_a_pipe_alone_has_free_ends():
    profile = line(dome(0, 20))
    assert neighbourhood_rejection_reason(profile, arc_of(profile, circle(20))) is None


def test_a_rounded_edge_goes_on_smoothly_at_one_end():
    edge = dome(0, 5, 85)
    edge = edge[edge[:, 0] >= 0]
    profile = line(flat(-20, 0, y=-435), edge)
    start = len(flat(-20, 0))
    arc = arc_of(profile, circle(5), np.arange(start, start + len(edge)))
    assert neighbourhood_rejection_reason(profile, arc).startswith(
        f"rounded edge: {len(edge)} points"
    )


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        pytest.param(flat(0, 60), "flat: 0.0", id="bar"),
        pytest.param(flat(0, 60, slope=0.7), "flat: 0.0", id="sloping bar"),
        pytest.param(bowl(0, 20), "concave towards the sensor", id="bowl"),
        pytest.param(dome(0, 80, 40), "radius 80 mm outside 5 to 60 mm", id="large"),
        pytest.param(np.concatenate([flat(0, 20), flat(20, 40, y=-430), flat(40, 60)]),
                     "no ellipse: best circle leaves ", id="box"),
    ],
)  # fmt: skip
def test_leftovers_have_their_reason(points, reason, rng):
    noisy = points + 0.02 * rng.normal(size=points.shape)
    assert unassigned_run_reasons([noisy], 0.02, RANGE)[0].startswith(reason)


def test_points_at_one_place_are_left_over_without_breaking():
    profile = prepare_profile(Profile(np.zeros((9, 2))), None)
    (reason,) = unassigned_run_reasons([profile.points], profile.noise_std, RANGE)
    assert reason.startswith("flat: 0.00 mm")


@pytest.mark.parametrize(
    ("radius", "std", "match"),
    [(19.0, 21.0, "too short or too noisy"), (90.0, 40.0, "any gentle curve in a view of 200 mm")],
)
def test_a_radius_that_is_hardly_known_is_none(radius, std, match):
    x = np.linspace(-100, 100, 300)
    weighed = prepare_profile(Profile(np.column_stack([x, 0 * x - 400.0])), None)
    assert match in radius_rejection_reason(weighed, radius, std)
    assert radius_rejection_reason(weighed, radius, radius / 10) is None


def test_a_parabola_has_no_best_ellipse():
    """The nearer an ellipse comes to it the longer it is: no fit settles."""
    x = np.linspace(-20, 20, 60)
    points = np.column_stack([x, -400.0 - x**2 / 40])
    start = Ellipse((0.0, -420.0), 20.0, 20.0, 0.0)
    fit = fit_ellipse(points, start, settings=FittingSettings(max_evaluations=20))
    assert convergence_rejection_reason(fit).startswith(
        "no ellipse fits best: the thinner the better"
    )


def test_a_fit_that_reached_its_minimum_is_an_ellipse():
    truth = Ellipse((0.0, -420.0), 22.0, 19.0, 0.3)
    points = truth.points_at(np.linspace(0.3, 2.6, 60))
    start = Ellipse((0.0, -420.0), 20.0, 20.0, 0.0)
    assert convergence_rejection_reason(fit_ellipse(points, start)) is None
