"""Where a board stands, in closed form."""

import cv2
import numpy as np

from lsvision.calibration.target import TargetView
from lsvision.geometry import Points, Pose


def guess_camera_from_board(view: TargetView, rays: Points) -> Pose:
    """Pose of a board from the rays through its points, in closed form.

    Parameters
    ----------
    view : TargetView
        Points of the board, at least four, no three in a line.
    rays : (n, 3) ndarray
        Of the view's pixels, camera frame, z = 1.

    Returns
    -------
    Pose
        ``camera_from_board``: a start for a refinement in pixels.
    """
    plane = np.ascontiguousarray(view.points[:, :2])
    homography, _ = cv2.findHomography(plane, np.ascontiguousarray(rays[:, :2]))
    # Zhang 2000, section 3.1: H = [r1 r2 t] up to scale.
    scale = 2 / (np.linalg.norm(homography[:, 0]) + np.linalg.norm(homography[:, 1]))
    first, second, shift = (homography * (scale * np.sign(homography[2, 2]))).T
    left, _, right = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    return Pose(left @ right, shift)
