"""Board views that are still missing for the calibration of a camera and a laser plane."""

from collections.abc import Sequence

import numpy as np

from lsvision.calibration.board_pose import guess_camera_from_board
from lsvision.calibration.camera_warnings import CELLS, covered_cells
from lsvision.calibration.target import TargetView
from lsvision.geometry import Pose
from lsvision.sensors.camera import Camera

REQUESTED_TILT = np.radians(20.0)
"""Requested tilt of a hand-held board towards each of its four sides. Units: rad."""
REQUESTED_DEPTH_RATIO = 1.15
"""Requested ratio of the farthest to the nearest distance of the board."""
FOCAL_GUESS = 1.2
"""Assumed focal length of a camera that is not calibrated yet, relative to the image's width: a
field of view of 45 deg. If it is 30 to 60 deg, a tilt of 20 deg is estimated as 13 to 27 deg."""
# Side of the board that is nearer, image axis along which its normal (z) is tilted, and sign.
_SIDES = (("right", 0, 1), ("left", 0, -1), ("lower", 1, 1), ("upper", 1, -1))
_ROWS, _COLUMNS = ("upper", "middle", "lower"), ("left", "middle", "right")


def missing_views(views: Sequence[TargetView], pairs: int) -> tuple[str, ...]:
    """Return instructions for the next views; empty if none are missing.

    Parameters
    ----------
    views : sequence of TargetView
        Views of one camera, which need not be calibrated.
    pairs : int
        Requested number of pairs of images, of the board and of the laser line on it.

    Returns
    -------
    tuple of str
        Missing pairs, parts of the image without corners, missing tilts and distances.
    """
    missing = []
    if len(views) < pairs:
        missing.append(f"{pairs - len(views)} more")
    if not views:
        return tuple(missing)
    if areas := _empty_areas(views):
        missing.append(f"board into the image's {', '.join(areas)}")
    poses = [_rough_pose(view) for view in views]
    sides = [
        name
        for name, axis, sign in _SIDES
        if max(sign * pose.rotation[axis, 2] for pose in poses) < np.sin(REQUESTED_TILT)
    ]
    if sides:
        missing.append(f"tilt with the {', '.join(sides)} side nearer")
    distances = [float(np.linalg.norm(pose.translation)) for pose in poses]
    if max(distances) < REQUESTED_DEPTH_RATIO * min(distances):
        missing.append("nearer and farther")
    return tuple(missing)


def rough_camera(size: tuple[int, int]) -> Camera:
    """Return an approximate camera without distortion, of focal length `FOCAL_GUESS`."""
    width, height = size
    focal = FOCAL_GUESS * width
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    return Camera(matrix, np.zeros(0), size)


def _empty_areas(views: Sequence[TargetView]) -> list[str]:
    """Return the corners, sides and the middle of the image without any corner of a board."""
    covered = covered_cells(views[0].size, views)
    # Blocks of cells along a side: the first cell, all between, and the last cell.
    blocks = np.array([0, *[1] * (CELLS - 2), 2])
    return [
        " ".join(dict.fromkeys((row_name, column_name)))
        for row, row_name in enumerate(_ROWS)
        for column, column_name in enumerate(_COLUMNS)
        if not covered[np.ix_(blocks == row, blocks == column)].any()
    ]


def _rough_pose(view: TargetView) -> Pose:
    """Return the approximate ``camera_from_board`` (mm), as seen by the `rough_camera`."""
    return guess_camera_from_board(view, rough_camera(view.size).rays(view.pixels))
