"""Every drawing goes into axes of the caller's, and leaves the rest of the figure alone."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import lsvision as lsv
from lsvision.draw.laser_line import draw_laser_line
from lsvision.draw.scan import draw_scan
from lsvision.scan import ScanMeasurement

CAMERA = lsv.Camera([[600, 0, 32], [0, 600, 24], [0, 0, 1]], [], (64, 48))
RIG = lsv.LightSection(CAMERA, lsv.Plane((0.0, 0.866, 0.5), 150.0))
PROFILE = lsv.Profile(RIG.points_from_pixels([[10.0, 20.0], [50.0, 20.0]]))
ROWS = np.arange(64)[:, None]
PHOTO = (10 + 90 * np.exp(-0.5 * ((ROWS - 30.2) / 1.5) ** 2) * np.ones(99)).astype(np.uint8)
NOTHING = lsv.Measurement((), ())

DRAWINGS = {
    "measurement": lambda ax, t: lsv.draw_measurement(PROFILE, NOTHING, title=t, ax=ax),
    "overlay": lambda ax, t: lsv.draw_overlay(PHOTO, RIG, PROFILE, NOTHING, title=t, ax=ax),
    "line": lambda ax, t: draw_laser_line(PHOTO, lsv.extract_laser_line(PHOTO), title=t, ax=ax),
    "scan": lambda ax, t: draw_scan(ScanMeasurement((), (), ()), np.zeros((3, 3)), title=t, ax=ax),
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_it_is_drawn_into_the_callers_axes(name):
    figure = Figure()
    projection = "3d" if name == "scan" else None
    left, right = (figure.add_subplot(1, 2, k, projection=projection) for k in (1, 2))
    returned = DRAWINGS[name](left, "a title of $mine")
    assert returned is figure
    assert figure.axes == [left, right]
    assert left.get_title(loc="left") == "a title of $mine"
    assert left.lines or left.images
    assert not right.lines
    assert not right.images
    assert figure.get_suptitle() == ""


def test_a_title_beyond_the_font_warns_of_nothing():
    figure = Figure()
    ax = figure.add_subplot()
    DRAWINGS["measurement"](ax, "\u7ba1.csv")
    assert ax.get_title(loc="left") == "?.csv"
    figure.draw_without_rendering()


def test_axes_of_a_subfigure_give_the_whole_figure():
    figure = Figure()
    part, _ = figure.subfigures(1, 2)
    assert DRAWINGS["measurement"](part.add_subplot(), "") is figure


def test_flat_axes_are_no_place_for_a_scan():
    with pytest.raises(TypeError, match=r'expected 3D axes, got Axes: .*projection="3d"'):
        DRAWINGS["scan"](Figure().add_subplot(), "")
