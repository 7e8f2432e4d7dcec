"""Pictures of inspections: what is drawn is named in the legend, in one set of colours."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color

from lsvision.draw.calibration_figures import draw_bars
from lsvision.draw.figures import render_figure
from lsvision.draw.inspection_page import draw_judged_profile, draw_series
from lsvision.inspection.job import Job
from lsvision.inspection.judge import judge
from lsvision.inspection.judged_measurements import JudgedMeasurement, collect_series
from lsvision.io.profiles import read_profile
from lsvision.measure import measure_cylinders
from lsvision.results.palette import LIMITS

FIXTURES = Path(__file__).parents[2] / "fixtures"
ROUND = 1e-6  # mm: matplotlib keeps what it is given
LIMITED = """
name = "tubes"
[[part]]
name = "left"
order = 1
radius_mm = { min = 14, max = 16 }
[[part]]
name = "right"
order = 2
radius_mm = { max = 20 }
"""
UNLIMITED = LIMITED.replace("radius_mm", "phi_deg")


def judged(job_text):
    measurement = measure_cylinders(read_profile(FIXTURES / "welded_pair.csv"))
    return measurement, judge(measurement, Job.from_text(job_text))


def legend_of(axes):
    """Return the artist of each name in the legend that is shown."""
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    handles, labels = axes.get_legend_handles_labels()
    assert sorted(shown) == sorted(labels)
    return dict(zip(labels, handles, strict=True))


def test_limits_of_the_radius_are_in_the_legend_once_in_their_colour():
    measurement, verdict = judged(LIMITED)
    (axes,) = draw_judged_profile(measurement, verdict).axes
    dashed = [line for line in axes.lines if same_color(line.get_color(), LIMITS)]
    assert len(dashed) == 3
    assert {line.get_linestyle() for line in dashed} == {"--"}
    assert legend_of(axes)["limits of the radius"] in dashed
    left = measurement.cylinders[0].ellipse
    drawn = [np.ptp(line.get_xydata(), axis=0).min() for line in dashed[:2]]
    aspect = np.ptp(left.points_at(np.linspace(0, 2 * np.pi, 721)), axis=0).min() / left.semi_minor
    np.testing.assert_allclose(drawn, [14 * aspect, 16 * aspect], rtol=1e-3)


def test_limits_of_the_diameter_are_drawn_like_those_of_the_radius():
    of_radius, of_diameter = (
        [line.get_xydata() for line in draw_judged_profile(*judged(text)).axes[0].lines]
        for text in (LIMITED, LIMITED.replace("radius_mm = { max = 20", "diameter_mm = { max = 40"))
    )
    for expected, drawn in zip(of_radius, of_diameter, strict=True):
        np.testing.assert_allclose(drawn, expected)


def test_every_line_of_the_plot_is_named():
    (axes,) = draw_judged_profile(*judged(LIMITED)).axes
    named = [(handle.get_color(), handle.get_linestyle(), handle.get_marker())
             for handle in legend_of(axes).values()]  # fmt: skip
    kinds = {(style, marker) for _, style, marker in named}
    assert {(line.get_linestyle(), line.get_marker()) for line in axes.lines} == kinds


def test_without_limits_of_the_radius_the_legend_names_none():
    (axes,) = draw_judged_profile(*judged(UNLIMITED)).axes
    assert "limits of the radius" not in legend_of(axes)
    assert not [line for line in axes.lines if same_color(line.get_color(), LIMITS)]


@pytest.mark.parametrize("name", ["$\\\\frac$", "管"])
def test_a_part_with_any_name_is_drawn(name):
    """Without an error of mathematical notation, or a warning of a missing glyph."""
    figure = draw_judged_profile(*judged(LIMITED.replace('"left"', f'"{name}"')))
    assert render_figure(figure, "png")


@pytest.mark.parametrize("name", ["$\\frac$", "管"])
def test_a_pose_with_any_name_is_drawn(name):
    assert render_figure(draw_bars([name], [("residual", [1.0])], [], "mm"), "png")


@pytest.mark.parametrize(("limits", "count"), [("min = 14, max = 16", 2), ("max = 16", 1)])
def test_limits_of_a_series_are_in_its_legend(limits, count):
    measurement, verdict = judged(LIMITED.replace("min = 14, max = 16", limits))
    parts = [JudgedMeasurement(f"{k}.csv", 0, measurement, verdict) for k in range(3)]
    series = next(each for each in collect_series(parts) if each.item == "left")
    trend, histogram = draw_series(series).axes
    limit = legend_of(trend)["limits" if count == 2 else "limit"]
    assert same_color(limit.get_color(), LIMITS)
    for axes in (trend, histogram):
        dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
        assert len(dashed) == count
        assert all(tick == round(tick) for tick in axes.get_xticks())


def test_the_legend_of_a_series_hides_no_value():
    """Inside the axes it covered intervals of the last measurements."""
    measurement, verdict = judged(LIMITED)
    parts = [JudgedMeasurement(f"{k}.csv", 0, measurement, verdict) for k in range(30)]
    series = next(each for each in collect_series(parts) if each.item == "left")
    figure = draw_series(series)
    figure.draw_without_rendering()
    trend = figure.axes[0]
    legend, inside = (artist.get_window_extent() for artist in (trend.get_legend(), trend))
    assert legend.y0 >= inside.y1
    assert legend.y1 <= figure.bbox.y1


def test_the_counts_below_the_histogram_are_apart():
    measurement, verdict = judged(LIMITED)
    series = collect_series([JudgedMeasurement("a.csv", 0, measurement, verdict)] * 45)[0]
    figure = draw_series(series)
    figure.canvas.draw()
    _, histogram = figure.axes
    boxes = [label.get_window_extent() for label in histogram.get_xticklabels() if label.get_text()]
    assert len(boxes) > 1
    digit = boxes[0].width  # the first count is 0
    assert all(right.x0 - left.x1 > digit for left, right in itertools.pairwise(boxes))
