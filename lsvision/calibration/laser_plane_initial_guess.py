"""Linear initial guess of the laser plane, with rejection of outlying views."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from lsvision.calibration.board_pose import guess_camera_from_board
from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.target import TargetView
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, Plane, Points, Pose
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.camera import Camera

MIN_SINGULAR_VALUE_RATIO = 0.02
"""Smallest ratio of the second to the first singular value of points that determine a plane."""

OUTLIER_DISTANCE_PX = 10.0
"""Smallest distance of an outlying view's line from the plane of the others; noise is far
smaller."""

OUTLIER_FACTOR = 5.0
"""Smallest ratio of that distance to the median one, since the initial camera may be inaccurate."""

MIN_VIEWS_FOR_REJECTION = 4
"""Smallest number of views of which one can be rejected."""


def fit_plane(points: Points) -> Plane:
    """Return the least-squares plane of points, at a positive distance from the origin.

    Parameters
    ----------
    points : (n, 3) ndarray
        Points in space. Units: mm.

    Returns
    -------
    Plane
        Plane in the frame of the points. Units: mm.

    Raises
    ------
    DegenerateGeometry
        If the points lie on one line.

    Examples
    --------
    >>> fit_plane(np.array([[0, 0, 5.0], [9, 0, 5], [0, 9, 5], [9, 9, 5]])).distance
    5.0
    """
    centre = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - centre, full_matrices=False)
    if not extents[1] > MIN_SINGULAR_VALUE_RATIO * extents[0]:
        raise DegenerateGeometry(
            f"the laser lines of all views lie on one line (spread {extents[1]:.3g} of "
            f"{extents[0]:.3g} mm), through which any plane may pass: move the board nearer and "
            "farther and tilt it, so that the line lands elsewhere"
        )
    normal = axes[2]
    distance = float(normal @ centre)
    return Plane(normal * np.sign(distance), abs(distance)) if distance else Plane(normal, 0.0)


def guess_board_poses(camera: Camera, views: Sequence[LaserView]) -> tuple[Pose, ...]:
    """Return ``camera_from_board`` of each view, in closed form."""
    boards = [TargetView(view.points, view.pixels, camera.size) for view in views]
    return tuple(guess_camera_from_board(board, camera.rays(board.pixels)) for board in boards)


def laser_points_on_boards(
    camera: Camera, camera_from_boards: Sequence[Pose], views: Sequence[LaserView]
) -> tuple[Points, ...]:
    """Return the points in which the rays of each view's laser line meet its board, taken as flat.

    One array (m, 3) for each view, in the camera frame. Units: mm.
    """
    laser_points = []
    for view, pose in zip(views, camera_from_boards, strict=True):
        rays, normal = camera.rays(view.line_pixels), pose.rotation[:, 2]
        laser_points.append(rays * (normal @ pose.translation / (rays @ normal))[:, None])
    return tuple(laser_points)


def plane_inlier_views(
    laser_points: Sequence[Points], focal_length: float
) -> tuple[BoolArray, FloatArray]:
    """Return the mask of views whose lines lie in the plane of the majority (least median).

    Each pair of views gives a plane; the one with the smallest median distance of all views is
    used, so that almost half of the views may be outliers.

    Parameters
    ----------
    laser_points : sequence of (m, 3) ndarray
        Laser points of each view, camera frame. Units: mm.
    focal_length : float
        Focal length of the camera. Units: px.

    Returns
    -------
    inliers : (n,) ndarray of bool
        Mask of the inlier views; all True for fewer than four views.
    distances : (n,) ndarray
        Root mean square distance from that plane in the image. Units: px.
    """
    scales = [focal_length / float(points[:, 2].mean()) for points in laser_points]
    best_distances = np.zeros(len(laser_points))
    if len(laser_points) < MIN_VIEWS_FOR_REJECTION:
        return best_distances == 0, best_distances
    best_distances = best_distances + np.inf
    for first, second in combinations(range(len(laser_points)), 2):
        try:
            plane = fit_plane(np.concatenate([laser_points[first], laser_points[second]]))
        except DegenerateGeometry:
            continue
        distances = np.array(
            [
                scale * float(np.sqrt(np.mean(plane.signed_distances(points) ** 2)))
                for scale, points in zip(scales, laser_points, strict=True)
            ]
        )
        if np.median(distances) < np.median(best_distances):
            best_distances = distances
    inliers: BoolArray = best_distances <= max(
        OUTLIER_DISTANCE_PX, OUTLIER_FACTOR * float(np.median(best_distances))
    )
    return inliers, best_distances
