"""Points that are visible in a planned view."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lsvision.errors import TooFewPoints
from lsvision.geometry import Cylinder
from lsvision.planning import SensorView, plan_section
from lsvision.planning.sensor_view import cylinder_normals, find_visible_points
from lsvision.sensors.profile_sensor import LPS36HI
from tests.planning.views import ROUNDING, VIEW, pipe_and_points, rays_to


def test_visible_points_lie_on_the_side_of_the_sensor():
    _, pipe, points = pipe_and_points(19.0, 20, 20)
    surface = np.column_stack([points, np.zeros(len(points))])
    np.testing.assert_allclose(pipe.signed_distances(surface), 0.0, atol=ROUNDING)
    incidence = -np.sum(cylinder_normals(pipe, points)[:, :2] * rays_to(points)[0], axis=1)
    assert (incidence >= math.cos(VIEW.incidence_limit)).all()


def test_columns_of_the_sensor_have_its_pitch():
    pitch = np.diff(
        find_visible_points(Cylinder((0, -600, 0), (0, 0, 1), 30.0), SensorView())[:, 0]
    )
    # 140 mm in 239 steps at 600 mm; the pipe's face is 5 % nearer.
    assert 0.90 < pitch.mean() / (140 / 239) < 1.0


def test_incidence_limit_shortens_the_arc():
    narrow = replace(VIEW, incidence_limit=math.radians(45))
    wide, short = (len(pipe_and_points(19.0, 20, 20, view)[2]) for view in (VIEW, narrow))
    assert short / wide == pytest.approx(
        math.sin(math.pi / 4) / math.sin(math.radians(70)), abs=0.1
    )


@pytest.mark.parametrize("origin_y", [-400.0, -450.0])
def test_a_tube_beside_or_behind_the_sensor_has_no_points(origin_y):
    view = SensorView(sensor=replace(LPS36HI, origin=(0.0, origin_y)), pitch=0.6)
    assert len(view.rays) == 0
    with pytest.raises(TooFewPoints, match="check standoff"):
        plan_section(19.0, 0.3, 0.3, view=view)


def test_the_measuring_range_is_along_y_over_the_whole_width():
    sensor = replace(LPS36HI, max_range=600.0, width_at_max_range=600.0)
    # The nearest point is 580 mm deep, but more than 600 mm away along its ray.
    points = find_visible_points(
        Cylinder((250.0, -600.0, 0.0), (0, 0, 1), 20.0), SensorView(sensor=sensor)
    )
    assert len(points) > 5
    assert np.hypot(*points.T).min() > 600
    assert points[:, 1].min() >= -600


def test_preset_is_the_default_view():
    assert SensorView().sensor is LPS36HI
