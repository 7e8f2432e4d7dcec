"""Pages of calibrations: whole in themselves, safe with any text, and telling what was left out."""

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from lsvision.calibration.hand_eye import calibrate_hand_eye_board
from lsvision.calibration.observations import RejectedPose
from lsvision.draw.calibration_figures import _find_plane_corners, draw_bars, draw_poses
from lsvision.draw.calibration_report import ReportContent, render_hand_eye_page
from lsvision.geometry import Plane, Pose
from lsvision.results.palette import OUTLIER
from lsvision.simulate.hand_eye import rotation_from_vector
from tests.draw.borders import has_white_border

VOID = {"meta", "br"}
MOUNT = Pose(rotation_from_vector(np.array([0.2, -0.1, 1.0])), (20.0, 30.0, 120.0))
BOARD = Pose(rotation_from_vector(np.array([0.1, 0.2, 0.3])), (700.0, 50.0, 200.0))


class Balance(HTMLParser):
    """Fails where a tag closes that was not the last to open."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def solved():
    rng = np.random.default_rng(5)
    seen = [
        Pose(rotation_from_vector(rng.uniform(-0.6, 0.6, 3)), (*rng.uniform(-40, 40, 2), 350.0))
        for _ in range(8)
    ]
    flanges = [BOARD @ pose.inverse() @ MOUNT.inverse() for pose in seen]
    found = calibrate_hand_eye_board(seen, flanges)
    return replace(found, rejected=(RejectedPose(2, "off"),)), flanges


def test_page_is_whole_and_well_formed(solved):
    names = [f"shot_{number}<&>.png" for number in range(8)]
    page = ReportContent([("x", "1.0 ± 0.1", "mm")], ["left out: <b>"], names, {"method": "a & b"})
    text = render_hand_eye_page(*solved, page)
    reader = Balance()
    reader.feed(text)
    assert reader.open == []
    assert text.count("<svg") == 2
    assert "left out: &lt;b&gt;" in text
    assert "1.0 ± 0.1" in text


def test_page_without_warnings_says_so(solved):
    text = render_hand_eye_page(*solved, ReportContent([], [], ["p"] * 8, {}))
    assert "No outliers, no warnings." in text


def test_bars_mark_the_bad_ones_and_only_these():
    figure = draw_bars(["a", "b", "c"], [("rms", [0.1, 0.5, 0.2])], [1], "px")
    (axes,) = figure.axes
    colours = [bar.get_facecolor() for bar in axes.patches]
    assert colours[0] == colours[2] != colours[1]
    assert [bar.get_height() for bar in axes.patches] == [0.1, 0.5, 0.2]


@pytest.mark.parametrize(("count", "named"), [(24, 24), (25, 13), (100, 20)])
def test_names_of_many_bars_are_thinned(count, named):
    names = [str(number) for number in range(count)]
    figure = draw_bars(names, [("rms", [1.0] * count)], [], "px")
    assert len(figure.axes[0].get_xticks()) == named


def test_a_laser_plane_perpendicular_to_x_has_corners():
    points = np.array([[3.0, 1.0, 5.0], [-2.0, 0.0, 9.0], [1.0, 4.0, 6.0]])
    corners = _find_plane_corners(Plane((1.0, 0.0, 0.0), 50.0), points)
    np.testing.assert_allclose(corners[:, 0], 50.0)
    np.testing.assert_allclose(np.ptp(corners[:, 1:], axis=0), [4.0, 4.0])


def test_view_shows_the_board_where_the_camera_saw_it(solved):
    found, flanges = solved
    figure = draw_poses(found, flanges)
    _, view, _ = figure.axes
    offsets = np.asarray(view.collections[0].get_offsets())
    sensors = [flange @ MOUNT for flange in flanges]
    expected = [pose.inverse().apply_one(BOARD.translation)[:2] for pose in sensors]
    np.testing.assert_allclose(offsets, expected, atol=1e-3)
    assert [text.get_color() for text in view.texts].count(OUTLIER) == 1
    assert has_white_border(figure)
    space = next(axes for axes in figure.axes if axes.name == "3d")
    assert len(space.get_xticks()) <= 8


def test_text_is_escaped_everywhere(solved):
    page = ReportContent([("<n>", "<v>", "<u>")], ["<w>"], ["p"] * 8, {"<k>": "<s>"})
    text = render_hand_eye_page(*solved, page)
    assert not [raw for raw in ("<n>", "<v>", "<u>", "<w>", "<k>", "<s>") if raw in text]
    assert '<p class="warning">&lt;w&gt;</p>' in text
