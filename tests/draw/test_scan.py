"""Views of a scan: the picture and the coloured clouds show every cylinder."""

import numpy as np
import pytest

from lsvision.draw.figure_files import figure_bytes
from lsvision.draw.scan import draw_scan
from lsvision.draw.scan_ply import GREY, coloured_points, coloured_surfaces, rgb_of
from lsvision.geometry import Points, Pose
from lsvision.scan import ScanMeasurement, measure_scan
from lsvision.scan.surface import tube_surface
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan

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
    assert figure_bytes(figure, "png").startswith(b"\x89PNG")


def test_a_scan_without_cylinders_is_drawn() -> None:
    figure = draw_scan(ScanMeasurement((), (), ()), np.zeros((3, 3)))
    assert figure.get_suptitle() == "no cylinder"


def test_each_point_is_in_the_cloud_once(seen) -> None:
    scan, points = seen
    cloud, colours = coloured_points(scan, points)
    assert sorted(map(tuple, cloud.tolist())) == sorted(map(tuple, points.tolist()))
    for number, tube in enumerate(scan.cylinders, 1):
        assert (colours == rgb_of(number)).all(axis=1).sum() == len(tube.points)
    assert (colours == GREY).all(axis=1).sum() == len(points) - sum(
        len(tube.points) for tube in scan.cylinders
    )


def test_the_surface_lies_on_the_cylinder_and_faces_outwards(seen) -> None:
    tube = seen[0].cylinders[0]
    corners, triangles = tube_surface(tube)
    assert np.abs(tube.cylinder.signed_distances(corners)).max() < SINGLE
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    middle = (a + b + c) / 3 - tube.point
    middle -= np.outer(middle @ tube.direction, tube.direction)
    assert ((outward * middle).sum(axis=1) > 0).all()


def test_surfaces_of_all_cylinders_are_one_mesh(seen) -> None:
    corners, colours, triangles = coloured_surfaces(seen[0])
    assert len(np.unique(triangles)) == len(corners) == len(colours)
    assert len(np.unique(colours, axis=0)) == 2
