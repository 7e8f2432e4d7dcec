"""What makes a camera calibration weak, although its residuals look well."""

from collections.abc import Sequence

import numpy as np

from lsvision.calibration.target import TargetView
from lsvision.geometry import FloatArray, Pose
from lsvision.sensors.camera import Camera

RECOMMENDED_VIEWS = 10
"""Views of a good set."""

RECOMMENDED_TILT = np.radians(25.0)
"""Tilt from the mean board of a good set: at 15 deg errors double, at 5 deg they grow tenfold."""

CELLS = 5
"""The image is divided into this many cells each way, to see where corners were."""

RECOMMENDED_COVERAGE = 0.6
"""Share of the cells that a good set fills."""

PLAUSIBLE_DISTANCE = (20.0, 20_000.0)
"""mm; a board nearer or farther than this was given in another unit."""

PLAUSIBLE_ASPECT = 0.02
"""Departure of fx / fy from 1 that square pixels and a true print never show."""

RECOMMENDED_FOCAL_STD = 0.005
"""One sigma of the focal length of a good set, as a fraction of it."""


def check_camera(
    camera: Camera, std: FloatArray, seen: Sequence[TargetView], poses: Sequence[Pose]
) -> tuple[str, ...]:
    """Warnings about a calibrated camera, in words and numbers with the mend.

    Parameters
    ----------
    camera : Camera
        The result.
    std : (k,) ndarray
        One sigma of fx, fy, ... Units: px.
    seen : sequence of TargetView
        The views used.
    poses : sequence of Pose
        ``camera_from_board`` of each.

    Returns
    -------
    tuple of str
        Empty for a good set.
    """
    found = [
        *_views(len(seen), tilt_of(poses)),
        *_coverage(camera, seen),
        *_scale(camera, poses),
        *_model(camera, std),
    ]
    return tuple(found)


def tilt_of(poses: Sequence[Pose]) -> float:
    """Largest angle between a board and the mean board. Units: rad."""
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    return float(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)).max())


def _views(count: int, tilt: float) -> list[str]:
    found = []
    if count < RECOMMENDED_VIEWS:
        found.append(f"{count} views: take {RECOMMENDED_VIEWS} and more, best 15 to 20")
    if tilt < RECOMMENDED_TILT:
        found.append(
            f"boards tilted by {np.degrees(tilt):.0f} deg at most: the focal length is weakly "
            "determined; tilt by 25 deg and more to all sides"
        )
    return found


def _coverage(camera: Camera, seen: Sequence[TargetView]) -> list[str]:
    pixels = np.concatenate([view.pixels for view in seen])
    cells = np.floor(pixels / camera.size * CELLS).clip(0, CELLS - 1)
    covered = len(np.unique(cells, axis=0)) / CELLS**2
    if covered >= RECOMMENDED_COVERAGE:
        return []
    return [
        f"corners cover {100 * covered:.0f} % of the image: the lens is extrapolated elsewhere; "
        "hold the board into every corner of the image"
    ]


def _scale(camera: Camera, poses: Sequence[Pose]) -> list[str]:
    found = []
    distance = float(np.median([np.linalg.norm(pose.translation) for pose in poses]))
    near, far = PLAUSIBLE_DISTANCE
    if not near < distance < far:
        found.append(
            f"the boards stand {distance:.3g} mm from the camera, which is implausible: give the "
            "target's square in mm, as measured on the print"
        )
    aspect = camera.matrix[0, 0] / camera.matrix[1, 1]
    if abs(aspect - 1) > PLAUSIBLE_ASPECT:
        found.append(
            f"fx / fy is {aspect:.3f}: unless the pixels are no squares, the print is stretched; "
            "measure the board along both sides"
        )
    return found


def _model(camera: Camera, std: FloatArray) -> list[str]:
    found = []
    focal = camera.focal_length
    if std[0] > RECOMMENDED_FOCAL_STD * focal:
        found.append(
            f"the focal length is known to {100 * std[0] / focal:.1f} % only: add tilted views"
        )
    width, height = camera.size
    off = np.abs(camera.matrix[:2, 2] - (np.array([width, height]) - 1) / 2) / (width, height)
    if off.max() > 0.15:
        found.append(
            f"the principal point lies {100 * off.max():.0f} % of the image off its middle: "
            "cropped images, or too few tilted views"
        )
    u, v = np.meshgrid(np.linspace(0, width - 1, 15), np.linspace(0, height - 1, 15))
    lost = np.isnan(camera.rays(np.column_stack([u.ravel(), v.ravel()]))[:, 0]).mean()
    if lost:
        found.append(
            f"the distortion folds over {100 * lost:.0f} % of the image, where it was not seen: "
            "hold the board there, or free fewer radial terms"
        )
    return found
