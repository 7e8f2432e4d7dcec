"""Collection of views: images without a view and repeated ones, each with its reason."""

from lsvision.calibration.views import RejectedView, collect_views
from lsvision.errors import LsvisionError

IMAGES = ["a", "", "b", "a", "", "c", "b", "a"]


def find(image):
    if not image:
        raise LsvisionError("no board")
    return image.upper()


def test_images_without_a_view_and_repeated_ones_are_rejected_in_their_order():
    views, sources = collect_views(IMAGES, find, str.encode)
    assert views == ["A", "B", "C"]
    assert sources.indices == (0, 2, 5)
    assert sources.rejected == (
        RejectedView(1, "no board"),
        RejectedView(3, "the same photo as image 0"),
        RejectedView(4, "no board"),
        RejectedView(6, "the same photo as image 2"),
        RejectedView(7, "the same photo as image 0"),
    )


def test_views_that_differ_are_all_kept():
    views, sources = collect_views("abc", find, str.encode)
    assert (views, sources.indices, sources.rejected) == (["A", "B", "C"], (0, 1, 2), ())
