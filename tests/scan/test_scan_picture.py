"""The picture of a scan in a notebook: one view for all scans, Z up, axes in mm."""

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.results.picture import draw_space_svg
from lsvision.scan import measure_scan
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan
from lsvision.simulate.hand_eye import rotation_from_vector

ROUNDING_PX = 0.12  # pixels are written with one decimal, in two coordinates
BASES = {
    "section frame": Pose(),
    "robot": Pose(rotation_from_vector(np.array([1.4, 0.3, -0.4])), (790.0, 36.0, 236.0)),
    "upside down": Pose(rotation_from_vector(np.array([0.0, 3.0, 0.2])), (-1200.0, 5.0, -400.0)),
}


def scan_in(base, seed=1):
    """Two tubes, few points, in a base frame."""
    poses = [Pose.along((0, 0, 1), 10.0 * k) for k in range(3)]
    scene = Scene((Tube.of(19.0, 0.5, 0.3, (-30, -400)), Tube.of(12.0, 0.1, 0.01, (40, -420))))
    rng = np.random.default_rng(seed)
    seen = simulate_scan(scene, poses, SCENE_SENSOR, SectionSettings(), rng=rng)
    return measure_scan([each.profile for each in seen], [base @ pose for pose in poses])


@pytest.fixture(params=BASES)
def scan(request):
    return scan_in(BASES[request.param])


def svg_of(result):
    view = ET.fromstring(f"<div>{result._repr_html_()}</div>")
    return next(child for child in view if child.tag.endswith("svg"))


def dots_of(svg):
    """Return the pixels of each cylinder's points, in their order."""
    paths = [path.get("d") for path in svg if path.get("stroke-linecap") == "round"]
    return [np.array(re.findall(r"M(-?[\d.]+),(-?[\d.]+)", path), float) for path in paths]


def texts_of(svg):
    """Return each text and its place, in their order."""
    texts = [text for text in svg if text.tag.endswith("text")]
    places = [np.array([float(text.get("x")), float(text.get("y"))]) for text in texts]
    plain = [text.text.replace("\N{MINUS SIGN}", "-") for text in texts]
    return list(zip(plain, places, strict=True))


def view_of(scan):
    """Return the (2, 3) matrix that maps mm of the base frame to pixels, from the dots."""
    points = np.concatenate([tube.points for tube in scan.cylinders])
    pixels = np.concatenate(dots_of(svg_of(scan)))
    assert len(points) == len(pixels)
    known = np.column_stack([points, np.ones(len(points))])
    solved, *_ = np.linalg.lstsq(known, pixels, rcond=None)
    assert np.abs(known @ solved - pixels).max() < ROUNDING_PX
    return solved[:3].T


def test_z_is_drawn_upwards_and_all_directions_have_one_scale(scan):
    view = view_of(scan)
    scale = np.sqrt(np.trace(view @ view.T) / 2)
    np.testing.assert_allclose(view @ view.T / scale**2, np.eye(2), atol=0.01)
    across, down = view[:, 2] / scale
    assert abs(across) < 0.01
    assert down < -0.5
    right, down = view
    assert np.cross(right, -down)[2] > 0  # seen from above, not mirrored


def test_the_view_is_the_same_for_every_scan():
    views = [view_of(scan_in(base, seed)) for base in BASES.values() for seed in (1, 2)]
    turned = [view / np.sqrt(np.trace(view @ view.T) / 2) for view in views]
    for each in turned[1:]:
        np.testing.assert_allclose(each, turned[0], atol=0.01)


@pytest.mark.parametrize("axis", range(3))
def test_an_axis_has_its_name_with_unit_and_the_ends_of_what_is_shown(scan, axis):
    texts, view = texts_of(svg_of(scan)), view_of(scan)
    name = next(k for k, (text, _) in enumerate(texts) if text == f"{'XYZ'[axis]} mm")
    (low, start), (high, stop) = texts[name - 2 : name]
    shown = np.concatenate([tube.points[:, axis] for tube in scan.cylinders])
    assert float(low) <= shown.min() + 0.5
    assert float(high) >= shown.max() - 0.5
    # Both numbers have the same distance from the ends of their edge; they are rounded to 1 mm.
    scale = np.linalg.norm(view[:, axis])
    assert np.abs(stop - start - view[:, axis] * (float(high) - float(low))).max() < scale + 0.2


def test_the_picture_says_what_it_shows(scan):
    assert svg_of(scan).get("aria-label") == "2 cylinders in the base frame, Z up; X, Y, Z in mm"
    assert "base frame, Z up" in [text for text, _ in texts_of(svg_of(scan))]


def test_everything_lies_within_the_picture(scan):
    svg = svg_of(scan)
    width, height = float(svg.get("width")), float(svg.get("height"))
    assert width <= 420
    assert height <= 320
    for pixels in dots_of(svg):
        assert (pixels > 0).all()
        assert (pixels < (width, height)).all()
    for _, (x, y) in texts_of(svg):
        assert 0 < x < width
        assert 0 < y < height


def test_one_cylinder_is_drawn_in_the_same_view(scan):
    tube = scan.cylinders[0]
    svg = svg_of(tube)
    (pixels,) = dots_of(svg)
    assert len(pixels) == len(tube.points)
    assert {"X mm", "Y mm", "Z mm", "1"} <= {text for text, _ in texts_of(svg)}
    assert svg.get("aria-label").startswith("1 cylinder in the base frame, Z up")


def test_the_ends_of_an_axis_are_never_minus_zero_or_alike():
    rod = np.array([[-0.004, -0.3, 1e4], [12.0, 0.1, 1e4 + 0.3]])
    svg = ET.fromstring(draw_space_svg([(rod, [], rod)], "rod"))
    texts = [text for text, _ in texts_of(svg)]
    assert texts[1:3] == ["0", "12"]
    assert texts[4:6] == ["-0.30", "0.10"]
    assert texts[7:9] == ["10000.00", "10000.30"]


def test_points_of_one_height_are_drawn():
    ring = np.array([[0.0, 0.0, 5.0], [9.0, 0.0, 5.0], [9.0, 9.0, 5.0]])
    svg = ET.fromstring(draw_space_svg([(ring, [ring], ring[:2])], "a section"))
    assert [text for text, _ in texts_of(svg)][7:9] == ["5.000", "5.000"]
