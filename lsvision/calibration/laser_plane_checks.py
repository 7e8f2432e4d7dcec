"""Checks of a laser-plane calibration: one plane, outlying views, and warnings."""

from collections.abc import Sequence

import cv2
import numpy as np

from lsvision.calibration.board_shape import list_bow_warnings
from lsvision.calibration.bundle_adjustment import BundleAdjustmentResult
from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.laser_plane_initial_guess import OUTLIER_DISTANCE_PX
from lsvision.calibration.laser_plane_result import CalibratedLaserView
from lsvision.calibration.views import (
    RECOMMENDED_TILT,
    RECOMMENDED_VIEWS,
    RejectedView,
    find_outlier_views,
    rms_distance,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry.arrays import rms

MIN_ON_PATTERN_FRACTION = 0.4
"""Smallest fraction of line points within the outline of the corners with which the board's bow is
fitted: beyond the outline its shape is extrapolated. Of 75 simulated sets of boards that are flat,
stepped, or bowed differently than the model, the plane's error (geometric mean) with and without
the bow is 0.34 and 0.25 mm at fractions of 0.20 to 0.28, 0.31 and 0.34 mm at 0.28 to 0.4, 0.29 and
0.50 mm at 0.4 to 0.6."""

MIN_CROSSING_FRACTION = 0.2
"""Smallest fraction of line points within the outline of the corners of lines that cross the
pattern; with fewer they lie in the margin beside it. Lines across a pattern of 6 x 5 squares have
0.39 with a margin of 3 squares, 0.26 with 5 and 0.20 with 8, those beside it 0. If the surface
beyond the pattern is 0.15 to 0.6 mm off, the plane's error (median of 4 simulated sets each) is 2.2
standard deviations at a fraction of 0.05, 1.6 at 0.15, 1.3 at 0.26 and 0.8 at 0.4."""

TWO_VIEWS_STD_FACTOR = 3.0
"""Factor on the standard deviations of a plane from two views, none of which reveals an error of
the other."""

OUTLIER_FACTOR = 3.0
"""Smallest ratio of an outlier view's rms residual to the median."""


def require_one_plane(views: Sequence[CalibratedLaserView]) -> None:
    """Require laser lines that lie in one plane."""
    median_rms = float(np.median([rms(view.line_residuals) for view in views]))
    if median_rms > OUTLIER_DISTANCE_PX:
        raise CalibrationFailed(
            f"the laser lines of {len(views)} views do not lie in one plane, but "
            f"{median_rms:.0f} px off the best: check the order of board and line images, and that "
            "neither the laser on the camera nor the board between its two images has moved"
        )


def find_outliers(views: Sequence[CalibratedLaserView]) -> tuple[RejectedView, ...]:
    """Return the views with outlying residuals of line or corners."""
    indices = [view.index for view in views]
    remedy = "look at the image, and leave it out if it is blurred or shows glare"
    outliers = [
        outlier
        for name, rms_values in (
            ("laser line", [rms(view.line_residuals) for view in views]),
            ("corners", [rms_distance(view.corner_residuals) for view in views]),
        )
        for outlier in find_outlier_views(
            indices, rms_values, OUTLIER_FACTOR, prefix=f"{name} off by ", remedy=remedy
        )
    ]
    return tuple(sorted(outliers, key=lambda view: view.index))


def list_warnings(solution: BundleAdjustmentResult, count: int, tilt: float) -> list[str]:
    """Return warnings about the set of views, with numbers and remedy."""
    warnings = []
    if count == 2:
        warnings.append(
            "two views cannot check each other, a wrong line or a moved board is not noticed: the "
            f"standard deviations are multiplied by {TWO_VIEWS_STD_FACTOR:g}; add poses"
        )
    elif count < RECOMMENDED_VIEWS:
        warnings.append(f"{count} views: add poses, the error of 15 views is half that of 4")
    if tilt < RECOMMENDED_TILT:
        warnings.append(
            f"boards tilted by {np.degrees(tilt):.0f} deg at most, expected "
            f"{np.degrees(RECOMMENDED_TILT):.0f} deg and more: "
            "camera and distance are poorly determined"
        )
    if solution.line_inconsistent:
        warnings.append(
            "the laser line is inconsistent with the boards and was not used for them: let it "
            "fall on the flat pattern, not saturated, and keep the board still between images"
        )
    return warnings + list_bow_warnings(solution.state.bow, solution.bow_std)


def list_outside_warnings(views: Sequence[LaserView], margin: float) -> list[str]:
    """Return the warning about lines beside the pattern, in a list; empty if they cross it.

    None is given for a margin of up to one square.

    A surface 1 mm off the pattern's plane moves the laser plane by 1 mm, at line residuals of
    0.1 px (8 boards tilted by 30 deg). Within one square of the corners lie the pattern's own
    outermost squares.
    """
    if margin <= 1 or measure_pattern_fraction(views) > MIN_CROSSING_FRACTION:
        return []
    return [
        f"the laser line lies beside the pattern, within the margin of {margin:g} squares: a board "
        "that is not in one plane with its pattern there moves the laser plane by as much, and no "
        "residual shows it; let the line cross the pattern"
    ]


def measure_pattern_fraction(views: Sequence[LaserView]) -> float:
    """Return the fraction of line points within the outline (convex hull) of the corners."""
    on_pattern = []
    for view in views:
        hull = cv2.convexHull(view.pixels.astype(np.float32))
        for u, v in view.line_pixels:
            on_pattern.append(cv2.pointPolygonTest(hull, (float(u), float(v)), False) >= 0)
    return float(np.mean(on_pattern))
