"""Initial guess of the laser plane from linear least squares, with rejection of outlying views."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from lsvision.calibration.board_pose import guess_board_pose
from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.target import TargetView
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.geometry import FloatArray, Plane, Points, Pose
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.camera import Camera

MIN_SINGULAR_VALUE_RATIO = 0.02
"""Smallest ratio of the second to the first singular value (root sums of squares across and along
the main direction) of points that determine a plane. Below it, the plane's tilt about the main
direction is more than 50 times less precise than its tilt about the other one."""

OUTLIER_DISTANCE_PX = 10.0
"""Distance (root mean square) of a view's line from the plane of the others, above which the view
may be an outlier; far larger than the noise of a laser line. Units: px."""

OUTLIER_FACTOR = 5.0
"""Ratio of a view's distance to the median one of all views, above which the view may be an
outlier: an inaccurate initial camera makes all distances large."""

MIN_VIEWS_FOR_REJECTION = 4
"""Smallest number of views of which any is rejected: of three, each two give a plane, and
none shows which view is wrong."""


def fit_plane(points: Points) -> Plane:
    """Return the least-squares plane of points (n, 3), n >= 2, in mm.

    Its normal points away from the origin.

    Raises
    ------
    DegenerateGeometry
        If the points lie on one line, within `MIN_SINGULAR_VALUE_RATIO`.

    Examples
    --------
    >>> fit_plane(np.array([[0, 0, 5.0], [9, 0, 5], [0, 9, 5], [9, 9, 5]])).distance
    5.0
    """
    centre = points.mean(axis=0)
    _, singular_values, axes = np.linalg.svd(points - centre, full_matrices=False)
    if not singular_values[1] > MIN_SINGULAR_VALUE_RATIO * singular_values[0]:
        width, length = singular_values[[1, 0]] / np.sqrt(len(points))
        raise DegenerateGeometry(
            f"the laser lines of all views lie on one line (rms width {width:.3g} mm, rms length "
            f"{length:.3g} mm), so that the plane may have any tilt about it: move the board "
            "nearer and farther and tilt it, so that the laser lines differ"
        )
    normal = axes[2]
    distance = float(normal @ centre)
    return Plane(normal * np.sign(distance), abs(distance)) if distance else Plane(normal, 0.0)


def guess_board_poses(camera: Camera, views: Sequence[LaserView]) -> tuple[Pose, ...]:
    """Return ``camera_from_board`` of each view (mm), from its corners, without iteration.

    CalibrationFailed if a corner or a point of the line has no ray, because the distortion is not
    invertible.
    """
    poses = []
    for view in views:
        rays = camera.rays(np.concatenate([view.pixels, view.line_pixels]))
        lost = int(np.isnan(rays[:, 0]).sum())
        if lost:
            raise CalibrationFailed(
                f"the camera's distortion is not invertible at {lost} of {len(rays)} corners and "
                "line points of a view: calibrate the camera with boards in every corner of the "
                "image, or with fewer radial terms"
            )
        board = TargetView(view.points, view.pixels, camera.size)
        poses.append(guess_board_pose(board, rays[: len(view.pixels)]))
    return tuple(poses)


def intersect_laser_rays_with_boards(
    camera: Camera, camera_from_boards: Sequence[Pose], views: Sequence[LaserView]
) -> tuple[Points, ...]:
    """Return the points (m, 3) of the laser line of each view in mm, camera frame, on its board.

    The points are those where the rays of the line's pixels meet the plane z = 0 of the board.
    """
    laser_points = []
    for view, pose in zip(views, camera_from_boards, strict=True):
        rays, board_normal = camera.rays(view.line_pixels), pose.rotation[:, 2]
        # Multiples of the rays at which they meet the board's plane.
        ranges = board_normal @ pose.translation / (rays @ board_normal)
        laser_points.append(rays * ranges[:, None])
    return tuple(laser_points)


def find_plane_inlier_views(
    laser_points: Sequence[Points], focal_length: float
) -> tuple[BoolArray, FloatArray]:
    """Return which views have laser lines in the plane of the majority, and all distances from it.

    The plane is the one of a pair of views from which the median distance of all views is smallest
    (least median of squares), so that almost half of the views may be outliers. The laser points
    (m, 3) of each view are in mm, camera frame, the focal length is in px.

    The mask (n,) is all True for fewer than `MIN_VIEWS_FOR_REJECTION` views. The distances (n,) are
    root mean squares for each view, as they appear in the image, in px; 0 for fewer views, infinite
    if no pair of views determines a plane.
    """
    count = len(laser_points)
    if count < MIN_VIEWS_FOR_REJECTION:
        return np.ones(count, dtype=bool), np.zeros(count)
    px_per_mm = [focal_length / float(points[:, 2].mean()) for points in laser_points]
    best_distances = np.full(count, np.inf)
    for pair in combinations(laser_points, 2):
        try:
            plane = fit_plane(np.concatenate(pair))
        except DegenerateGeometry:
            continue
        distances = np.array(
            [
                scale * float(np.sqrt(np.mean(plane.signed_distances(points) ** 2)))
                for scale, points in zip(px_per_mm, laser_points, strict=True)
            ]
        )
        if np.median(distances) < np.median(best_distances):
            best_distances = distances
    inliers: BoolArray = best_distances <= max(
        OUTLIER_DISTANCE_PX, OUTLIER_FACTOR * float(np.median(best_distances))
    )
    return inliers, best_distances
