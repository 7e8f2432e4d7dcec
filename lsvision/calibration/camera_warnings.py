"""Warnings about a calibrated camera: views, coverage, scale and lens model."""

from collections.abc import Sequence

import numpy as np

from lsvision.calibration.target import TargetView
from lsvision.calibration.views import RECOMMENDED_TILT, RECOMMENDED_VIEWS, compute_max_tilt
from lsvision.geometry import BoolArray, FloatArray, Pose
from lsvision.sensors.camera import Camera

CELLS_PER_SIDE = 5
"""Number of cells along each side of the image, by which the coverage by corners is measured."""
RECOMMENDED_COVERAGE = 0.6
"""Fraction of the cells with corners below which a warning is given."""
PLAUSIBLE_DISTANCE_MM = (20.0, 20_000.0)
"""Range of plausible board distances; outside it the target's size was probably not given in mm.
Units: mm."""
MAX_ASPECT_DEVIATION = 0.02
"""Deviation of fx / fy from 1 above which a warning is given: with square pixels and a print at
true scale it is smaller."""
MAX_PRINCIPAL_POINT_OFFSET = 0.15
"""Distance of the principal point from the image's centre above which a warning is given, as a
fraction of the image's width or height."""
RECOMMENDED_FOCAL_STD = 0.005
"""Relative standard deviation of the focal length above which a warning is given."""


def check_camera(
    camera: Camera, std: FloatArray, views: Sequence[TargetView], poses: Sequence[Pose]
) -> tuple[str, ...]:
    """Return warnings about a calibrated camera, with numbers and remedy; empty if there are none.

    `std` (4 + k,) are the standard deviations of fx, fy, cx, cy in px and of the k coefficients;
    `poses` are ``camera_from_board`` of each view.
    """
    warnings = [
        *_check_views(len(views), compute_max_tilt(poses)),
        *_check_coverage(camera, views),
        *_check_scale(camera, poses),
        *_check_model(camera, std),
    ]
    return tuple(warnings)


def _check_views(count: int, tilt: float) -> list[str]:
    """Return warnings about the number of views and their tilt."""
    warnings = []
    if count < RECOMMENDED_VIEWS:
        warnings.append(f"{count} views: take {RECOMMENDED_VIEWS} and more, best 15 to 20")
    if tilt < RECOMMENDED_TILT:
        warnings.append(
            f"boards tilted by {np.degrees(tilt):.0f} deg at most: the focal length is poorly "
            f"determined; tilt by {np.degrees(RECOMMENDED_TILT):.0f} deg and more to all sides"
        )
    return warnings


def find_covered_cells(size: tuple[int, int], views: Sequence[TargetView]) -> BoolArray:
    """Return the mask of the image's cells that contain a corner, top row first.

    Its shape is (CELLS_PER_SIDE, CELLS_PER_SIDE).
    """
    pixels = np.concatenate([view.pixels for view in views])
    u, v = np.floor(pixels / size * CELLS_PER_SIDE).clip(0, CELLS_PER_SIDE - 1).astype(int).T
    covered = np.zeros((CELLS_PER_SIDE, CELLS_PER_SIDE), dtype=bool)
    covered[v, u] = True
    return covered


def _check_coverage(camera: Camera, views: Sequence[TargetView]) -> list[str]:
    """Return a warning if the corners cover too little of the image."""
    covered = float(find_covered_cells(camera.size, views).mean())
    if covered >= RECOMMENDED_COVERAGE:
        return []
    return [
        f"corners cover {100 * covered:.0f} % of the image: the lens is extrapolated elsewhere; "
        "hold the board into every corner of the image"
    ]


def _check_scale(camera: Camera, poses: Sequence[Pose]) -> list[str]:
    """Return warnings about implausible distance or aspect ratio."""
    warnings = []
    distance = float(np.median([np.linalg.norm(pose.translation) for pose in poses]))
    near, far = PLAUSIBLE_DISTANCE_MM
    if not near < distance < far:
        warnings.append(
            f"the boards are {distance:.3g} mm from the camera, which is implausible: give the "
            "target's square in mm, as measured on the print"
        )
    aspect = camera.matrix[0, 0] / camera.matrix[1, 1]
    if abs(aspect - 1) > MAX_ASPECT_DEVIATION:
        warnings.append(
            f"fx / fy is {aspect:.3f}: unless the pixels are not square, the print is stretched; "
            "measure the board along both sides"
        )
    return warnings


def _check_model(camera: Camera, std: FloatArray) -> list[str]:
    """Return warnings about focal length, principal point and distortion."""
    warnings = []
    focal = camera.focal_length
    if std[0] > RECOMMENDED_FOCAL_STD * focal:
        warnings.append(
            f"the focal length is determined to {100 * std[0] / focal:.1f} % only: add tilted views"
        )
    width, height = camera.size
    offset = np.abs(camera.matrix[:2, 2] - (np.array([width, height]) - 1) / 2) / (width, height)
    if offset.max() > MAX_PRINCIPAL_POINT_OFFSET:
        warnings.append(
            f"the principal point lies {100 * offset.max():.0f} % of the image off its middle: "
            "cropped images, or too few tilted views"
        )
    u, v = np.meshgrid(np.linspace(0, width - 1, 15), np.linspace(0, height - 1, 15))
    not_invertible = np.isnan(camera.rays(np.column_stack([u.ravel(), v.ravel()]))[:, 0]).mean()
    if not_invertible:
        warnings.append(
            f"the distortion is not invertible in {100 * not_invertible:.2g} % of the image, where "
            "there were no corners: hold the board there, or estimate fewer radial terms"
        )
    return warnings
