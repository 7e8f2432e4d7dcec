"""A light section from one photo of a board that stands in the laser plane.

For simple rigs: the board is slid into the plane until the line runs over all of its face.
Nothing needs to be known of the camera; what is measured holds within the laser plane.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_pose_estimation import estimate_board_pose
from lsvision.calibration.board_pose_initial_guess import guess_camera_from_board
from lsvision.calibration.target import Target, TargetView, find_target
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

USUAL_FOCAL = 1.2
"""Focal length in image widths that is taken where the photo does not tell it."""


@dataclass(frozen=True, eq=False)
class BoardInPlane:
    """A light section from one board, with its evidence.

    Parameters
    ----------
    light_section : LightSection
        The result.
    residuals : (n, 2) ndarray
        Of the board's points, projected minus seen. Units: px.
    """

    light_section: LightSection
    residuals: FloatArray

    @property
    def rms_px(self) -> float:
        """Root mean square of the points' distances. Units: px."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))


def calibrate_board_in_plane(
    image: npt.ArrayLike, target: Target, camera: Camera | None = None
) -> BoardInPlane:
    """Calibrate a light section from one photo of a board standing in the laser plane.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        The board fills the part of the plane that is measured later.
    target : Target
        The board; its face lies in the laser plane.
    camera : Camera, optional
        If None, the camera in the result is a stand-in: a pinhole that sees the plane
        exactly as the photo does. Points in the laser plane are right; lens distortion is not
        known, and the pose of the camera is a guess.

    Returns
    -------
    BoardInPlane
        The light section with the residuals of the board.

    Raises
    ------
    TargetNotFound
        If the board is not seen.
    DegenerateGeometry
        If the camera looks along the plane.
    """
    seen = find_target(image, target)
    if camera is None:
        camera, pose = _equivalent_pinhole_camera(seen)
        method = "board in the laser plane; camera unknown, a stand-in"
    else:
        pose = estimate_board_pose(seen.pixels, seen.points, camera).camera_from_board
        method = "board in the laser plane; camera given"
    normal = pose.rotation[:, 2]
    plane = Plane(normal, float(normal @ pose.translation))
    residuals = camera.project(pose.apply(seen.points)) - seen.pixels
    return BoardInPlane(LightSection(camera, plane, {"method": method}), residuals)


def _equivalent_pinhole_camera(seen: TargetView) -> tuple[Camera, Pose]:
    """A pinhole camera and board pose that together are the photo's homography."""
    homography, _ = cv2.findHomography(
        np.ascontiguousarray(seen.points[:, :2]), np.ascontiguousarray(seen.pixels)
    )
    centre = _camera_centre(homography, seen)
    a, b, h = centre
    if not abs(h) > 1e-6:
        raise DegenerateGeometry(
            "the camera looks along the board in the laser plane: look at it at an angle"
        )
    # A board point X seen along d = X - centre is (X, Y, 1) = B d, hence pixel ~ H B d = K R d.
    B = np.array([[1, 0, -a / h], [0, 1, -b / h], [0, 0, -1 / h]])
    K, R = _upper_times_rotation(homography @ B)
    return Camera(K, np.empty(0), seen.size), Pose(R, -R @ centre)


def _camera_centre(homography: FloatArray, seen: TargetView) -> FloatArray:
    """Where a camera with square pixels and centred axis would stand, board frame. Units: mm."""
    width, height = seen.size
    to_middle = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, 1]])
    H = to_middle @ homography
    (a1, b1, c1), (a2, b2, c2) = H[:, 0] / H[2, 2], H[:, 1] / H[2, 2]
    # Zhang 2000, Eqs. (3) and (4), linear in 1 / f^2.
    A = np.array([a1 * a2 + b1 * b2, a1**2 + b1**2 - a2**2 - b2**2])
    C = np.array([c1 * c2, c1**2 - c2**2])
    inverse_square = -float(A @ C) / max(float(A @ A), 1e-300)
    focal = USUAL_FOCAL * width
    if inverse_square > 0:
        focal = float(np.clip(inverse_square**-0.5, focal / 4, focal * 4))
    middle = (seen.pixels - (np.array([width, height]) - 1) / 2) / focal
    pose = guess_camera_from_board(seen, np.column_stack([middle, np.ones(len(middle))]))
    return pose.inverse().translation


def _upper_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """RQ decomposition with a positive diagonal, the triangle scaled to end in 1."""
    matrix = matrix * np.sign(np.linalg.det(matrix))
    flip = np.eye(3)[::-1]
    Q, U = np.linalg.qr((flip @ matrix).T)
    K, R = flip @ U.T @ flip, flip @ Q.T
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    return K / K[2, 2], R
