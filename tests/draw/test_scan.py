"""Views of a scan: the picture and the coloured clouds show every cylinder."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from mpl_toolkits.mplot3d.proj3d import proj_transform

from lsvision.draw.figures import render_figure
from lsvision.draw.scan import MAX_POINTS, MIN_FACING_COSINE, draw_scan
from lsvision.geometry import FloatArray, Points, Pose
from lsvision.io.ply import UNASSIGNED_RGB, colour_points, colour_surfaces, convert_cylinder_colour
from lsvision.scan import ScanMeasurement, measure_scan
from lsvision.scan.shape import triangulate_cylinder
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan
from tests.draw.borders import has_white_border

SINGLE = 1e-9  # mm: a mesh is computed in closed form


@pytest.fixture(scope="module")
def seen() -> tuple[ScanMeasurement, Points]:
    poses = [Pose.along((0, 0, 1), 5.0 * k) for k in range(3)]
    scene = Scene((Tube.of(19.0, 0.5, 0.3, (-30, -400)), Tube.of(12.0, 0.1, 0.2, (40, -420))))
    rng = np.random.default_rng(1)
    sections = simulate_scan(scene, poses, SCENE_SENSOR, SectionSettings(), rng=rng)
    profiles = [section.profile for section in sections]
    points = np.concatenate([pose.apply(p.points) for p, pose in zip(profiles, poses, strict=True)])
    return measure_scan(profiles, poses), points[np.isfinite(points[:, 0])]


def test_the_picture_names_every_cylinder(seen) -> None:
    scan, points = seen
    figure = draw_scan(scan, points, title="two tubes")
    words = "\n".join(text.get_text() for text in figure.texts)
    assert figure.get_suptitle() == "two tubes: 2 cylinders"
    assert words.count("radius") == 2
    assert render_figure(figure, "png").startswith(b"\x89PNG")


@pytest.mark.parametrize("count", [MAX_POINTS - 1, MAX_POINTS + 1, 2 * MAX_POINTS - 1])
def test_the_number_of_points_drawn_is_limited(count) -> None:
    axes = draw_scan(ScanMeasurement((), (), ()), np.ones((count, 3))).axes[0]
    drawn = len(axes.lines[0].get_data_3d()[0])
    assert MAX_POINTS / 2 <= drawn <= MAX_POINTS


def screen(figure: Figure, point: tuple[float, float, float]) -> FloatArray:
    axes = figure.axes[0]
    across, up, _ = proj_transform(*point, axes.get_proj())
    spot: FloatArray = axes.transData.transform((across, up))
    return spot


@pytest.mark.parametrize("vertical", ["y", "z"])
def test_the_axis_that_is_asked_for_points_upwards(seen, vertical) -> None:
    figure = draw_scan(*seen, vertical=vertical)
    middle = np.array([np.mean(getattr(figure.axes[0], f"get_{name}lim")()) for name in "xyz"])
    unit = 10.0 * np.eye(3)["xyz".index(vertical)]
    across, up = screen(figure, middle + unit) - screen(figure, middle)
    assert up > 10 * abs(across)


@pytest.mark.parametrize("vertical", ["y", "z"])
@pytest.mark.parametrize("stretch", [(1, 1, 1), (20, 1, 1), (1, 1, 20)], ids=str)
def test_nothing_is_cut_at_the_edge_of_the_figure(seen, vertical, stretch) -> None:
    figure = draw_scan(ScanMeasurement((), (), ()), seen[1] * stretch, vertical=vertical)
    assert has_white_border(figure)


@pytest.mark.parametrize("vertical", ["y", "z"])
def test_all_axes_have_the_same_scale(seen, vertical) -> None:
    figure = draw_scan(*seen, vertical=vertical)
    figure.axes[0].set_proj_type("ortho")
    figure.draw_without_rendering()  # makes the place of the axes square
    unit = np.array([screen(figure, end) - screen(figure, (0, 0, 0)) for end in np.eye(3)]).T
    scaled = unit @ unit.T  # of a rotation seen from anywhere: a multiple of the unit matrix
    np.testing.assert_allclose(scaled / scaled[0, 0], np.eye(2), atol=SINGLE)


def test_negative_numbers_have_a_minus_sign(seen) -> None:
    figure = draw_scan(*seen)
    texts = [text.get_text() for text in figure.findobj(Text)]
    assert any("\N{MINUS SIGN}4" in text for text in texts)
    assert not any(re.search(r"-\d", text) for text in texts)


@pytest.mark.parametrize("count", [4, 5, 30])
def test_the_panel_stays_within_the_figure(seen, count) -> None:
    scan, points = seen
    many = ScanMeasurement((scan.cylinders * count)[:count], (), ())
    figure = draw_scan(many, points)
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.texts]
    assert min(box.y0 for box in boxes) > 0
    assert max(box.x1 for box in boxes) < figure.bbox.x1
    assert ("see the table" in figure.texts[-1].get_text()) == (count > 9)


@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
def test_the_measured_side_is_seen(turn_deg) -> None:
    """The sensor looks along a horizontal direction of the base: at the tube's side."""
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    base = Pose(rotation=np.array([[0, cos, sin], [0, sin, -cos], [-1, 0, 0]]).round(15))
    poses = [Pose.along((0, 0, 1), 5.0 * k) for k in range(3)]
    scene = Scene((Tube.of(19.0, 0.5, 0.3, (0, -400)),))
    sections = simulate_scan(
        scene, poses, SCENE_SENSOR, SectionSettings(), rng=np.random.default_rng(2)
    )
    scan = measure_scan([section.profile for section in sections], [base @ pose for pose in poses])
    (tube,) = scan.cylinders
    axes = draw_scan(scan, tube.points, vertical="z").axes[0]
    turn = np.radians(axes.azim)
    towards_sensor = base.rotation[:, 1]
    assert towards_sensor @ (np.cos(turn), np.sin(turn), 0.0) > MIN_FACING_COSINE


def test_a_scan_without_cylinders_is_drawn() -> None:
    figure = draw_scan(ScanMeasurement((), (), ()), np.zeros((3, 3)))
    assert figure.get_suptitle() == "no cylinder"


def test_each_point_is_in_the_cloud_once(seen) -> None:
    scan, points = seen
    cloud, colours = colour_points(scan, points)
    assert sorted(map(tuple, cloud.tolist())) == sorted(map(tuple, points.tolist()))
    for number, tube in enumerate(scan.cylinders, 1):
        assert (colours == convert_cylinder_colour(number)).all(axis=1).sum() == len(tube.points)
    assert (colours == UNASSIGNED_RGB).all(axis=1).sum() == len(points) - sum(
        len(tube.points) for tube in scan.cylinders
    )


def test_the_surface_lies_on_the_cylinder_and_faces_outwards(seen) -> None:
    tube = seen[0].cylinders[0]
    corners, triangles = triangulate_cylinder(tube)
    assert np.abs(tube.cylinder.signed_distances(corners)).max() < SINGLE
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    middle = (a + b + c) / 3 - tube.point
    middle -= np.outer(middle @ tube.direction, tube.direction)
    assert ((outward * middle).sum(axis=1) > 0).all()


def test_surfaces_of_all_cylinders_are_one_mesh(seen) -> None:
    corners, colours, triangles = colour_surfaces(seen[0])
    assert len(np.unique(triangles)) == len(corners) == len(colours)
    assert len(np.unique(colours, axis=0)) == 2
