"""Spacing and outline of a target, on its board and in an image."""

import numpy as np

from lsvision.calibration.target import Target, TargetView, fit_board_homography
from lsvision.errors import CalibrationFailed
from lsvision.geometry import BoolArray, FloatArray, Points
from lsvision.geometry.plane import apply_homography


def compute_target_pitch(target: Target) -> float:
    """Return the distance of neighbouring points of the target. Units: mm."""
    points = target.points[:, :2]
    return float(np.sort(np.hypot(*(points - points[0]).T))[1])


def target_bounds(target: Target) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest x and y of the target's points. Units: mm."""
    points = target.points[:, :2]
    return points.min(axis=0), points.max(axis=0)


def project_board_outline(view: TargetView, target: Target, margin: float) -> Points:
    """Return the corners (4, 2) of the board's flat part in the image. Units: px.

    CalibrationFailed if one of them is beyond the horizon of the board's plane, and has no image.
    """
    border = margin * compute_target_pitch(target)
    low, high = target_bounds(target)
    low, high = low - border, high + border
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    homography = fit_board_homography(view)
    # The third homogeneous coordinate changes its sign at the horizon.
    depths = np.vstack([corners, view.points[:, :2]]) @ homography[2, :2] + homography[2, 2]
    if np.ptp(np.sign(depths)) > 0:
        raise CalibrationFailed(
            f"a margin of {margin:g} squares (--margin) reaches beyond the horizon of the tilted "
            "board's plane: state the width of its white border"
        )
    return apply_homography(homography, corners)


def mask_inside_outline(pixels: Points, outline: Points) -> BoolArray:
    """Return the mask of pixels inside a convex quadrilateral."""
    edges = np.roll(outline, -1, axis=0) - outline
    cross_products = [
        edge[0] * (pixels - corner)[:, 1] - edge[1] * (pixels - corner)[:, 0]
        for edge, corner in zip(edges, outline, strict=True)
    ]
    same_side: BoolArray = np.ptp(np.sign(cross_products), axis=0) == 0
    return same_side
