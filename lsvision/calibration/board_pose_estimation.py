"""Pose of a board before the camera, from one image's corners, with covariance."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.rotations import cross_matrices, rotations_of
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Pose, as_readonly_array
from lsvision.sensors.camera import Camera


@dataclass(frozen=True, eq=False)
class BoardPoseEstimate:
    """Pose of a board before the camera, from one image's corners.

    Parameters
    ----------
    camera_from_board : Pose
        Units: mm.
    covariance : (6, 6) array_like
        Of the board's origin in the camera frame (mm) and left-hand rotation (rad).
    residual_std : float
        Of the corners. Units: px.
    """

    camera_from_board: Pose
    covariance: FloatArray
    residual_std: float

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (6, 6), "covariance")
        )


def estimate_board_pose(
    corners: npt.ArrayLike, board_points: npt.ArrayLike, camera: Camera
) -> BoardPoseEstimate:
    """Pose of a board from its corners in one image, with covariance.

    Parameters
    ----------
    corners : (n, 2) array_like
        Units: px.
    board_points : (n, 3) array_like
        The same corners on the board. Units: mm.
    camera : Camera
        Intrinsics.

    Returns
    -------
    BoardPoseEstimate
        Least squares in pixels; the covariance rests on the corners' own residuals.

    Raises
    ------
    CalibrationFailed
        If there are fewer than 6 corners, or they lie on one line.
    ValueError
        If a corner is not finite.
    """
    import cv2

    pixels = as_readonly_array(corners, ("n", 2), "corners")
    points = as_readonly_array(board_points, (len(pixels), 3), "board points")
    _require_spread(pixels, points)
    turn, shift = _solved(pixels, points, camera)
    matrix, lens = np.array(camera.matrix), np.array(camera.distortion)
    projected, jacobian = cv2.projectPoints(np.array(points), turn, shift, matrix, lens)
    residuals = np.asarray(projected).reshape(-1, 2) - pixels
    variance = float((residuals**2).sum()) / (2 * len(pixels) - 6)
    by_turn, by_shift = jacobian[:, :3], jacobian[:, 3:6]
    rows = np.concatenate([by_shift, by_turn @ _by_left_turn(turn)], axis=1)
    covariance = np.linalg.inv(rows.T @ rows) * variance + 1e-14 * np.eye(6)
    return BoardPoseEstimate(Pose(rotations_of(turn), shift), covariance, variance**0.5)


def _require_spread(pixels: FloatArray, points: FloatArray) -> None:
    if not (np.isfinite(pixels).all() and np.isfinite(points).all()):
        raise ValueError("want finite corners: leave those out that were not found")
    if len(pixels) < 6:
        raise CalibrationFailed(f"board seen by {len(pixels)} corners and needs 6: show more of it")
    for what in (points, pixels):
        spread = np.linalg.svd(what - what.mean(axis=0), compute_uv=False)
        if not spread[1] > 1e-3 * spread[0]:
            raise CalibrationFailed(
                "the board's corners lie on one line: its turn about it is free"
            )


def _solved(
    pixels: FloatArray, points: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray]:
    """Rotation vector and translation of least squares in pixels."""
    import cv2

    seen = (
        np.array(points),
        np.array(pixels),
        np.array(camera.matrix),
        np.array(camera.distortion),
    )
    _, turn, shift = cv2.solvePnP(*seen)
    turn, shift = cv2.solvePnPRefineLM(*seen, turn, shift)
    return np.asarray(turn, np.float64).ravel(), np.asarray(shift, np.float64).ravel()


def _by_left_turn(vector: FloatArray) -> FloatArray:
    """Derivative of a rotation vector by a small left-hand turn (inverse left Jacobian)."""
    angle = float(np.linalg.norm(vector))
    cross = cross_matrices(vector)
    if angle < 1e-6:
        small: FloatArray = np.eye(3) - 0.5 * cross
        return small
    factor = 1 / angle**2 - 1 / (2 * angle * np.tan(angle / 2))
    inverse: FloatArray = np.eye(3) - 0.5 * cross + factor * cross @ cross
    return inverse
