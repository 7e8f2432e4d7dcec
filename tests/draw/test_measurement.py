"""Pictures of a measurement: everything that the numbers say is in the picture."""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.colors import same_color

from lsvision.detection.arcs import Rejection
from lsvision.draw import draw_measurement, render_figure
from lsvision.draw.measurement import MIN_LABEL_GAP_PX
from lsvision.draw.panel import MAX_LINES, find_rejected_arcs
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import Arc, Profile
from tests.draw.borders import has_white_border
from tests.scripts import output_of_python

PIXEL_PER_MM = 1e-6
"""Relative difference of the two scales: rounding."""


def section(radius, phi, theta, centre, count=150):
    """Points of the upper half of a tilted pipe's section, left to right, 0.02 mm noise."""
    anomaly = np.linspace(0, 2 * math.pi, 4 * count)
    own = np.column_stack([radius / math.cos(phi) * np.cos(anomaly), radius * np.sin(anomaly)])
    turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
    points = own @ turn.T
    upper = points[points[:, 1] > 0.25 * radius]
    upper = upper[np.argsort(upper[:, 0])]
    return upper + centre + np.random.default_rng(3).normal(0, 0.02, upper.shape)


@pytest.fixture(scope="module")
def scene():
    """A tilted pipe, an upright one, and a bar between them with two rejected arcs on it."""
    tilted = section(20.0, 0.6, 0.5, (-60.0, -420.0))
    bar = np.column_stack([np.linspace(-20, 20, 60), np.full(60, -440.0)])
    bar[:, 1] += np.random.default_rng(5).normal(0, 0.02, 60)
    upright = section(15.0, 0.0, 0.0, (50.0, -430.0))
    profile = Profile(np.vstack([tilted, bar, upright]))
    cylinders = measure_cylinders(profile).cylinders
    assert len(cylinders) == 2
    start = len(tilted)
    rejections = (
        Rejection(Arc(start + 30, start + 60), "flat: rises 0.01 mm over its chord"),
        Rejection(Arc(start, start + 30), "tilt 80 deg over 65 deg"),
        Rejection(Arc(start, start + 30), "tried once more"),
        Rejection(Arc(60, 110), "grew into a cylinder in the end"),
    )
    return profile, Measurement(cylinders, rejections)


@pytest.fixture(scope="module")
def figure(scene):
    return draw_measurement(*scene, title="scene.csv")


def words(figure):
    return "\n".join(text.get_text() for text in figure.texts)


def lines(figure, style):
    return [line for line in figure.axes[0].lines if line.get_linestyle() == style]


def test_both_axes_have_the_same_scale(figure):
    figure.canvas.draw()
    across, up = np.diff(
        figure.axes[0].transData.transform([[0, 0], [1, 0], [0, 0], [0, 1]]), axis=0
    )[[0, 2]]
    assert across[0] == pytest.approx(up[1], rel=PIXEL_PER_MM)
    assert "mm" in figure.axes[0].get_xlabel()
    assert "towards the sensor" in figure.axes[0].get_ylabel()


def test_nothing_is_cut_at_the_edge(figure):
    assert has_white_border(figure)


def test_everything_measured_lies_within_the_drawing(scene, figure):
    figure.canvas.draw()
    (left, right), (bottom, top) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert (scene[0].points > (left, bottom)).all()
    assert (scene[0].points < (right, top)).all()


def test_ellipses_and_dashed_major_axis_are_those_measured(scene, figure):
    tilted, upright = scene[1].cylinders
    outlines = [line for line in lines(figure, "-") if len(line.get_xdata()) > 2]
    for outline, cylinder in zip(outlines, (tilted, upright), strict=True):
        own = cylinder.ellipse.to_ellipse_frame(outline.get_xydata())
        scaled = own / (cylinder.ellipse.semi_major, cylinder.ellipse.semi_minor)
        np.testing.assert_allclose(np.hypot(*scaled.T), 1.0, rtol=1e-9)
    (axis,) = lines(figure, "--")
    along = np.subtract(*axis.get_xydata())
    assert math.atan2(along[1], along[0]) % math.pi == pytest.approx(tilted.theta)
    assert np.hypot(*along) == pytest.approx(2 * tilted.ellipse.semi_major)


def test_panel_tells_numbers_with_sigma_and_what_is_not_determinable(scene, figure):
    tilted, _ = scene[1].cylinders
    assert f"r = {tilted.radius:.3f} ± {tilted.radius_std:.3f} mm" in words(figure)
    assert "± one sigma" in words(figure)
    assert words(figure).count("θ not determinable") == 1
    assert words(figure).count("θ = ") == 1
    assert figure.get_suptitle() == "scene.csv: 2 cylinders, 2 arcs rejected"


def test_rejected_arcs_have_letters_reasons_and_one_colour_each(figure):
    letters = [text for text in figure.axes[0].texts if text.get_text() in {"A", "B"}]
    assert len(letters) == 2
    for letter in letters:
        (message,) = [t for t in figure.texts if t.get_text().startswith(f"{letter.get_text()}  ")]
        assert same_color(message.get_color(), letter.get_bbox_patch().get_facecolor())
    assert "A   tilt 80 deg over 65 deg" in words(figure)
    assert "B   flat: rises 0.01 mm over its chord" in words(figure)


def test_rejected_arcs_go_left_to_right_without_repetition_or_points_of_cylinders(scene):
    profile, measurement = scene
    arcs = find_rejected_arcs(profile.points, measurement)
    assert [arc.letter for arc in arcs] == ["A", "B"]
    assert [arc.reason[:4] for arc in arcs] == ["tilt", "flat"]
    taken = np.concatenate([cylinder.indices for cylinder in measurement.cylinders])
    assert not np.isin(np.concatenate([arc.indices for arc in arcs]), taken).any()


def test_letters_of_crowded_arcs_keep_clear_of_each_other():
    points = np.column_stack([np.linspace(0, 100, 400), np.full(400, -400.0)])
    spans = [Arc(start, start + 40) for start in range(0, 330, 7)]
    crowd = Measurement((), tuple(Rejection(span, "no ellipse " * 9) for span in spans))
    figure = draw_measurement(Profile(points), crowd)
    axes = figure.axes[0]
    labels = [text for text in axes.texts if text.get_text()]
    spots = axes.transData.transform([label.get_position() for label in labels])
    gaps = np.hypot(*(spots[:, None] - spots[None]).transpose(2, 0, 1))
    assert len(spots) == len(spans)
    assert gaps[np.triu_indices(len(spots), 1)].min() >= MIN_LABEL_GAP_PX * (1 - PIXEL_PER_MM)
    panel = [text for text in figure.texts if text.get_family() == ["monospace"]]
    assert len(panel) == MAX_LINES
    assert "more lines: see lsvision measure -v" in panel[-1].get_text()


def extents_of_texts(figure):
    """Extents, in px, of the texts of a figure outside of its axes."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    return [text.get_window_extent(renderer) for text in figure.texts if text.get_text()]


def test_lines_of_the_panel_stay_within_the_figure():
    points = Profile(np.column_stack([np.linspace(0, 100, 50), np.full(50, -400.0)]))
    long = Measurement((), (Rejection(Arc(0, 50), "W" * 30 + " " + "many long words " * 20),))
    figure = draw_measurement(points, long)
    extents = extents_of_texts(figure)
    assert max(extent.x1 for extent in extents) < figure.bbox.x1
    panel = [
        e for e, t in zip(extents, figure.texts, strict=False) if t.get_family() == ["monospace"]
    ]
    assert all(low.y1 <= high.y0 + 3 for high, low in pairwise(panel))


@pytest.mark.parametrize("points", [np.full((5, 2), np.nan), np.empty((0, 2)), [[1.0, -400.0]]])
def test_profile_without_points_can_be_drawn(points):
    figure = draw_measurement(Profile(points), Measurement((), ()), title="nothing")
    assert render_figure(figure, "png").startswith(b"\x89PNG")
    assert "No cylinder found" in words(figure)


def test_title_is_shown_as_it_is_or_with_question_marks():
    empty = Measurement((), ())
    for title, shown in (("a$b$_^.csv", "a$b$_^.csv"), ("管.csv\n", "?.csv?"), ("\udcff", "?")):
        figure = draw_measurement(Profile([[0.0, 0.0]]), empty, title=title)
        assert figure.get_suptitle() == f"{shown}: no cylinder"
        assert render_figure(figure, "svg")


def test_same_scene_gives_the_same_bytes_also_from_threads(scene):
    def pictures(_):
        return [render_figure(draw_measurement(*scene), kind) for kind in ("png", "svg")]

    alone = pictures(0)
    assert ET.fromstring(alone[1]).tag.endswith("svg")
    with ThreadPoolExecutor(3) as pool:
        assert all(other == alone for other in pool.map(pictures, range(3)))


def test_other_formats_are_rejected(figure):
    with pytest.raises(ValueError, match="expected a format among png, svg, got 'pdf'"):
        render_figure(figure, "pdf")


def test_pyplot_is_never_imported():
    code = (
        "import sys; from lsvision.draw import draw_measurement, render_figure\n"
        "from lsvision.measure import Measurement; from lsvision.profile import Profile\n"
        "print('matplotlib' in sys.modules)\n"
        "render_figure(draw_measurement(Profile([[0, 0]]), Measurement((), ())), 'svg')\n"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    assert output_of_python(code).split() == ["False", "False"]


def test_panel_of_many_cylinders_stays_within_the_figure(scene):
    profile, measurement = scene
    figure = draw_measurement(profile, Measurement(measurement.cylinders * 4, ()))
    assert max(extent.x1 for extent in extents_of_texts(figure)) < figure.bbox.x1
    assert words(figure).count("φ = ") == words(figure).count("r = ") == 8
