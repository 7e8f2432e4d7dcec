import numpy as np
import pytest

from lsvision import Profile, ProfileSensor
from lsvision.detection.end_extension import EndExtensionSettings
from lsvision.detection.end_extension import extend_ends as reach_out_with
from lsvision.detection.identification import IdentifiedArc
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import refine_ellipse
from lsvision.profile import Arc
from lsvision.shapes import Ellipse
from tests.detection.scenes import PITCH, flat

SENSOR = ProfileSensor(range_std=0.05)
PIPE = Ellipse((0.0, -440.0), 20.0, 20.0, 0.0)
LAST = 5
"""Points at the end that growth stopped before."""


def upper_arc(half_deg=78.0):
    reach = 20 * np.sin(np.radians(half_deg))
    x = np.arange(-reach, reach, PITCH)
    return np.column_stack([x, -440 + np.sqrt(400 - x * x)])


def seen(points, rng):
    """Points with noise along their rays, as the sensor sees them."""
    rays = points / np.hypot(*points.T)[:, None]
    along = np.sqrt(np.einsum("ni,nij,nj->n", rays, SENSOR.covariances(points), rays))
    return points + (along * rng.normal(size=len(points)))[:, None] * rays


def grown(points, stop, start=0):
    """The profile of the points, and its arc [start, stop) as growth left it."""
    profile = prepare_profile(Profile(points), SENSOR)
    indices = profile.valid_indices[
        (profile.valid_indices >= start) & (profile.valid_indices < stop)
    ]
    return profile, IdentifiedArc(Arc(int(indices[0]), int(indices[-1]) + 1), indices, PIPE)


def reach_out(profile, arc, settings=EndExtensionSettings()):
    """With the covariance of an ellipse of the arc's middle three quarters."""
    eighth = len(arc.indices) // 8
    middle = profile.noisy_points[arc.indices[eighth:-eighth]]
    _, covariance = refine_ellipse(middle, parameters_from_ellipse(arc.ellipse), 1)
    return reach_out_with(profile, arc, covariance, settings)


def test_a_single_point_behind_a_gap_is_reached(rng):
    points = seen(upper_arc(), rng)
    points[-LAST:-1] = np.nan
    profile, arc = grown(points, len(points) - LAST)
    reached = reach_out(profile, arc)
    assert reached.indices[-1] == len(points) - 1
    assert reached.arc.stop == len(points)


def test_at_the_start_as_well(rng):
    points = seen(upper_arc(70.0), rng)
    points[1:LAST] = np.nan
    profile, arc = grown(points, len(points), start=LAST)
    assert reach_out(profile, arc).indices[0] == 0


def test_one_point_after_the_other_is_reached(rng):
    points = seen(upper_arc(), rng)
    points[-11:-1:2] = np.nan
    profile, arc = grown(points, len(points) - 11)
    assert reach_out(profile, arc).indices[-1] == len(points) - 1
    one_round = reach_out(profile, arc, EndExtensionSettings(search_columns=3, max_iterations=1))
    assert len(arc.indices) < len(one_round.indices) < len(reach_out(profile, arc).indices)


@pytest.mark.parametrize("jump_mm", [-6.0, -2.0, 2.0, 6.0])
def test_a_jump_is_left_where_it_is(jump_mm, rng):
    points = seen(upper_arc(60.0), rng)
    points[-LAST:-1] = np.nan
    points[-1] *= 1 + jump_mm / np.hypot(*points[-1])
    profile, arc = grown(points, len(points) - LAST)
    assert reach_out(profile, arc) is arc


def test_a_point_on_the_dark_side_of_the_pipe_is_none_of_its_points(rng):
    """It lies on the very ellipse, but no sensor sees a surface that turns away from it."""
    points = upper_arc(60.0)
    lit, dark = (PIPE.points_at(np.array([np.radians(90 - turn)])) for turn in (78, 97))
    arcs = []
    for last in (lit, dark):
        profile, arc = grown(seen(np.concatenate([points, last]), rng), len(points))
        arcs.append((arc, reach_out(profile, arc)))
    assert len(arcs[0][1].indices) == len(points) + 1
    assert arcs[1][1] is arcs[1][0]


def test_where_the_line_goes_on_into_something_else_the_arc_ends(rng):
    tube = upper_arc(50.0)
    plate = flat(tube[-1, 0] + PITCH, tube[-1, 0] + 20, y=tube[-1, 1])
    profile, arc = grown(seen(np.concatenate([tube, plate]), rng), len(tube))
    assert reach_out(profile, arc) is arc


def test_an_arc_that_is_whole_stays_itself(rng):
    points = seen(upper_arc(), rng)
    profile, arc = grown(points, len(points))
    assert reach_out(profile, arc) is arc


def test_where_another_line_only_begins_on_the_ellipse_it_is_no_last_point(rng):
    tube = upper_arc(60.0)
    first = len(tube) - 1
    plate = flat(tube[-1, 0] + PITCH, tube[-1, 0] + 20, y=tube[-1, 1])
    points = seen(np.concatenate([tube, plate]), rng)
    points[first - 1] = np.nan
    alone = points.copy()
    alone[first + 1 :] = np.nan
    assert reach_out(*grown(alone, first - 1)).indices[-1] == first
    profile, arc = grown(points, first - 1)
    assert reach_out(profile, arc) is arc
