"""Linear start of the laser plane, from the views that agree on one."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from lsvision.calibration.board_pose_initial_guess import guess_camera_from_board
from lsvision.calibration.bundle_adjustment_state import LaserView
from lsvision.calibration.target import TargetView
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, Plane, Points, Pose
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.camera import Camera

MIN_SPREAD = 0.02
"""Second to first singular value of the laser points, below which they are one line."""

OUTLIER_DISTANCE_PX = 10.0
"""A view's laser line that lies farther from the others' plane is no matter of noise."""

OUTLIER_FACTOR = 5.0
"""And this many times farther than the median view's, for cameras that start far off."""

MIN_VIEWS_FOR_REJECTION = 4
"""Views from which on one can be outvoted."""


def fit_plane(points: Points) -> Plane:
    """Plane of least squares through points, at a positive distance from the origin.

    Parameters
    ----------
    points : (n, 3) ndarray
        Units: mm.

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
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    if not spread[1] > MIN_SPREAD * spread[0]:
        raise DegenerateGeometry(
            f"the laser lines of all views lie on one line (spread {spread[1]:.3g} of "
            f"{spread[0]:.3g} mm), through which any plane may pass: move the board nearer and "
            "farther and tilt it, so that the line lands elsewhere"
        )
    normal = axes[2]
    distance = float(normal @ centre)
    return Plane(normal * np.sign(distance), abs(distance)) if distance else Plane(normal, 0.0)


def guess_board_poses(camera: Camera, views: Sequence[LaserView]) -> tuple[Pose, ...]:
    """``camera_from_board`` of each view, in closed form."""
    boards = [TargetView(view.points, view.pixels, camera.size) for view in views]
    return tuple(guess_camera_from_board(board, camera.rays(board.pixels)) for board in boards)


def laser_points_on_boards(
    camera: Camera, camera_from_boards: Sequence[Pose], views: Sequence[LaserView]
) -> tuple[Points, ...]:
    """Where the rays of each view's laser line meet its board, taken as flat.

    Parameters
    ----------
    camera : Camera
        For the rays.
    camera_from_boards : sequence of Pose
        Where the boards stand.
    views : sequence of LaserView
        What was seen.

    Returns
    -------
    tuple of (m, 3) ndarray
        Camera frame. Units: mm.
    """
    lit = []
    for view, pose in zip(views, camera_from_boards, strict=True):
        rays, normal = camera.rays(view.line_pixels), pose.rotation[:, 2]
        lit.append(rays * (normal @ pose.translation / (rays @ normal))[:, None])
    return tuple(lit)


def plane_inlier_views(lit: Sequence[Points], focal_length: float) -> tuple[BoolArray, FloatArray]:
    """Which views' laser lines lie in the plane that most agree on.

    Each pair of views proposes its plane; the one with the smallest median misfit of all views
    wins, which stands up to almost half of them being wrong.

    Parameters
    ----------
    lit : sequence of (m, 3) ndarray
        Laser points of each view, camera frame. Units: mm.
    focal_length : float
        Units: px.

    Returns
    -------
    agree : (n,) ndarray of bool
        All, where there are fewer than four.
    misfits : (n,) ndarray
        Root mean square distance from that plane, seen from the camera. Units: px.
    """
    scales = [focal_length / float(points[:, 2].mean()) for points in lit]
    best = np.zeros(len(lit))
    if len(lit) < MIN_VIEWS_FOR_REJECTION:
        return best == 0, best
    best = best + np.inf
    for first, second in combinations(range(len(lit)), 2):
        try:
            plane = fit_plane(np.concatenate([lit[first], lit[second]]))
        except DegenerateGeometry:
            continue
        misfits = np.array(
            [
                scale * float(np.sqrt(np.mean(plane.signed_distances(points) ** 2)))
                for scale, points in zip(scales, lit, strict=True)
            ]
        )
        if np.median(misfits) < np.median(best):
            best = misfits
    agree: BoolArray = best <= max(OUTLIER_DISTANCE_PX, OUTLIER_FACTOR * float(np.median(best)))
    return agree, best
