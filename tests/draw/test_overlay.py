"""What was found in an image, drawn into it where it lies."""

from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from lsvision.detection.arcs import Rejection
from lsvision.draw import draw_laser_line, draw_on_photo, draw_overlay, render_figure
from lsvision.draw.figures import show_photo
from lsvision.io.images import read_image
from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import Arc
from lsvision.results.palette import choose_cylinder_colour
from lsvision.sensors.light_section import LightSection
from tests.draw.borders import has_white_border

IMAGES = Path(__file__).parents[2] / "fixtures" / "images"
WITHIN = 1.0
"""px between a drawn ellipse and the bright line it was fitted to: their noise is 0.13 px."""
BLUE_BGR = (200, 30, 10)


@pytest.fixture(scope="module")
def pair():
    image, rig = read_image(IMAGES / "pair.png"), LightSection.load(IMAGES / "rig.json")
    profile = rig.profile(image)
    return image, rig, profile, measure_cylinders(profile)


@pytest.mark.filterwarnings("error")
def test_images_of_true_and_false_and_with_lost_pixels_are_shown():
    mask = np.zeros((4, 6), bool)
    mask[1] = True
    lost = np.where(mask, np.nan, 7.0)
    lost[0, 0] = np.inf
    for image, bright in ((mask, mask), (lost, np.isfinite(lost)), (np.full((4, 6), np.nan), None)):
        ax = Figure().add_subplot()
        show_photo(ax, image)
        shown = np.asarray(ax.images[0].get_array())
        np.testing.assert_array_equal(shown, 0 if bright is None else np.where(bright, 255, 0))


@pytest.fixture(scope="module")
def figure(pair):
    return draw_overlay(*pair, title="pair.png")


def outlines(figure, colour):
    return [
        line.get_xydata() for line in figure.axes[0].lines
        if line.get_color() == colour and line.get_linestyle() == "-"
    ]  # fmt: skip


@pytest.mark.parametrize("number", [1, 2])
def test_an_ellipse_is_drawn_over_the_light_it_was_found_by(pair, figure, number):
    image, *_, measurement = pair
    (outline,) = outlines(figure, choose_cylinder_colour(number))
    for index in measurement.cylinders[number - 1].indices[10:-10:10]:
        u = int(index)
        brightest = np.average(np.arange(len(image)), weights=(image[:, u] > 60) * image[:, u])
        assert np.hypot(*(outline - (u, brightest)).T).min() < WITHIN


def test_the_photo_is_whole_and_in_pixels(pair, figure):
    height, width = pair[0].shape
    assert figure.axes[0].axis() == (-0.5, width - 0.5, height - 0.5, -0.5)
    assert figure.axes[0].get_xlabel() == "u / px"
    assert "mm" in figure.axes[1].get_xlabel()


def test_letters_of_arcs_with_one_middle_do_not_cover_each_other(pair):
    image, rig, profile, _ = pair
    arcs = tuple(Rejection(Arc(300 - width, 300 + width), "short") for width in (10, 20, 30))
    photo = draw_overlay(image, rig, profile, Measurement((), arcs)).axes[0]
    letters = [text for text in photo.texts if text.get_text() in {"A", "B", "C"}]
    assert len(letters) == 3
    boxes = [text.get_window_extent() for text in letters]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_letters_of_arcs_beside_a_magnified_part_of_the_photo_are_left_out(pair):
    _, rig, profile, _ = pair
    axes = Figure().add_subplot()
    axes.axis((500.0, 600.0, 300.0, 200.0))
    draw_on_photo(axes, rig, profile, Measurement((), (Rejection(Arc(280, 320), "short"),)))
    assert not axes.texts


def test_many_cylinders_of_known_radius_stay_within_the_figure(pair):
    rig, image = pair[1], read_image(IMAGES / "single.png")
    profile = rig.profile(image)
    cylinders = measure_cylinders(profile, known_radius=25.0).cylinders
    assert "± 0.000025" in cylinders[0].estimates[0].text
    panel = draw_overlay(image, rig, profile, Measurement(cylinders * 5, ())).subfigs[1]
    panel.figure.canvas.draw()
    extents = [text.get_window_extent() for text in panel.texts if text.get_text()]
    assert max(extent.x1 for extent in extents) < panel.bbox.x1


def test_nothing_is_cut_at_the_edge(figure):
    assert has_white_border(figure)


def test_the_verdict_stands_above_and_the_numbers_beside(figure):
    assert figure.get_suptitle().startswith("pair.png: 2 cylinders")
    words = "\n".join(text.get_text() for part in figure.subfigs for text in part.texts)
    assert "r = 16." in words
    assert "Rejected arcs" in words


def test_an_image_without_a_cylinder_is_drawn_all_the_same(pair):
    image, rig, profile, _ = pair
    empty = draw_overlay(image, rig, profile, Measurement((), ()))
    assert empty.get_suptitle() == "no cylinder"
    assert render_figure(empty, "png").startswith(b"\x89PNG")


def test_colours_and_deep_images_are_shown_as_they_are(pair):
    image, *found = pair
    colour = np.empty((*image.shape, 3), np.uint8)
    colour[:] = BLUE_BGR
    shown = draw_overlay(colour, *found).axes[0].images[0].get_array()
    assert tuple(shown[0, 0]) == BLUE_BGR[::-1]
    deep = draw_overlay(image.astype(np.uint16) * 16, *found).axes[0].images[0].get_array()
    assert (deep.dtype, int(deep.max())) == (np.uint8, 255)


def test_inputs_are_left_alone(pair):
    image = pair[0].copy()
    draw_overlay(*pair)
    np.testing.assert_array_equal(pair[0], image)


def test_a_laser_line_is_drawn_on_its_image(pair):
    image, rig, *_ = pair
    line = rig.line(image)
    figure = draw_laser_line(image, line, title="pair.png")
    drawn = figure.axes[0].lines[0].get_xydata()
    np.testing.assert_array_equal(drawn, line.pixels)
    assert figure.get_suptitle().startswith("pair.png\n800 columns, 7 lost, std 0.13 px")
    assert [axes.get_ylabel().split(" /")[0] for axes in figure.axes[1:]] == [
        "std",
        "width",
        "brightness",
    ]


def test_curves_of_columns_stand_under_their_columns(pair):
    image, rig, *_ = pair
    photo, *curves = draw_laser_line(image, rig.line(image)).axes
    boxes = aligned_boxes(photo, curves)
    assert all(axes.get_xlim() == photo.get_xlim() for axes in curves)
    np.testing.assert_allclose([(box.x0, box.x1) for box in boxes], [boxes[0].intervalx] * 4)
    assert all(upper.y0 > lower.y1 for upper, lower in pairwise(boxes))


def test_a_float_image_is_as_bright_as_its_full_scale_is_small(pair):
    image, rig = pair[:2]
    line = rig.line(image)
    deep, dim = (draw_laser_line(image * factor, line).axes[0] for factor in (1.0, 1e-3))
    shown, expected = (axes.images[0].get_array() for axes in (dim, deep))
    assert expected.max() == 255
    np.testing.assert_allclose(shown.astype(int), expected.astype(int), atol=1)


def test_curves_of_rows_stand_beside_their_rows(pair):
    image, *_ = pair
    upright = np.ascontiguousarray(image.T)
    line = extract_laser_line(upright)
    assert line.direction == "rows"
    photo, *curves = draw_laser_line(upright, line).axes
    boxes = aligned_boxes(photo, curves)
    assert all(axes.get_ylim() == photo.get_ylim() for axes in curves)
    np.testing.assert_allclose([(box.y0, box.y1) for box in boxes], [boxes[0].intervaly] * 4)
    assert all(right.x0 > left.x1 for left, right in pairwise(boxes))
    assert [axes.get_xlabel().split(" /")[0] for axes in curves] == ["std", "width", "brightness"]


def aligned_boxes(photo, curves):
    photo.figure.canvas.draw()  # applies the photo's aspect
    return [axes.get_window_extent() for axes in (photo, *curves)]


@pytest.mark.parametrize("shape", [(60, 2000), (600, 800), (3000, 400)])
def test_a_picture_of_any_shape_holds_all_its_words(shape):
    rows = np.arange(shape[0])[:, None]
    image = 10 + 90 * np.exp(-0.5 * ((rows - 30.2) / 1.5) ** 2) * np.ones(shape[1])
    line = extract_laser_line(image.astype(np.uint8), LineSettings(direction="columns"))
    figure = draw_laser_line(image.astype(np.uint8), line, title="folder/" * 30 + "a.png")
    assert max(figure.get_size_inches()) < 18
    assert has_white_border(figure)


def test_photo_and_section_have_one_legend_and_one_set_of_colours(figure):
    photo, section = ({line.get_label(): line for line in axes.lines} for axes in figure.axes)
    names = [[text.get_text() for text in axes.get_legend().texts] for axes in figure.axes]
    assert names[0] == names[1] == [
        "measured points", "rejected arc", "points of a cylinder", "fitted ellipse",
        "major axis (direction θ)",
    ]  # fmt: skip
    for label in names[0]:
        assert same_color(photo[label].get_color(), section[label].get_color())
        assert photo[label].get_marker() == section[label].get_marker()
        assert photo[label].get_linestyle() == section[label].get_linestyle()
    (title,), *legends = [[figure._suptitle], *(axes.get_legend().texts for axes in figure.axes)]
    figure.canvas.draw()
    assert all(title.get_window_extent().y0 > text.get_window_extent().y1 for text in legends[0])
