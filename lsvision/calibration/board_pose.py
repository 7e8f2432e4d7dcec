"""Pose of a board in the camera frame from one image."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.rotations import cross_matrices, rotations_from_vectors
from lsvision.calibration.target import TargetView
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points, Pose, as_readonly_array
from lsvision.sensors.camera import Camera


@dataclass(frozen=True, eq=False)
class BoardPoseEstimate:
    """Pose of a board in the camera frame, with covariance.

    Parameters
    ----------
    camera_from_board : Pose
        Estimated pose.
    covariance : (6, 6) array_like
        Covariance of the board's origin in the camera frame (mm) and the left-hand rotation (rad).
    """

    camera_from_board: Pose
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (6, 6), "covariance")
        )


def estimate_board_pose(
    corners: npt.ArrayLike, board_points: npt.ArrayLike, camera: Camera
) -> BoardPoseEstimate:
    """Estimate the pose of a board from its corners in one image, with covariance.

    Parameters
    ----------
    corners : (n, 2) array_like
        Corners in the image. Units: px.
    board_points : (n, 3) array_like
        Corners in the board frame, in the same order. Units: mm.
    camera : Camera
        Intrinsics.

    Returns
    -------
    BoardPoseEstimate
        Least squares in pixels; the covariance is scaled by the residuals of the corners.

    Raises
    ------
    CalibrationFailed
        If there are fewer than 6 corners, or they lie on one line.
    ValueError
        If a corner is not finite.
    """
    pixels = as_readonly_array(corners, ("n", 2), "corners")
    points = as_readonly_array(board_points, (len(pixels), 3), "board points")
    _require_spread(pixels, points)
    vector, translation = _solve_pnp(pixels, points, camera)
    matrix, distortion = np.array(camera.matrix), np.array(camera.distortion)
    projected, jacobian = cv2.projectPoints(
        np.array(points), vector, translation, matrix, distortion
    )
    residuals = np.asarray(projected).reshape(-1, 2) - pixels
    variance = float((residuals**2).sum()) / (2 * len(pixels) - 6)
    vector_jacobian, translation_jacobian = jacobian[:, :3], jacobian[:, 3:6]
    pose_jacobian = np.concatenate(
        [translation_jacobian, vector_jacobian @ _inverse_left_jacobian(vector)], axis=1
    )
    covariance = np.linalg.inv(pose_jacobian.T @ pose_jacobian) * variance + 1e-14 * np.eye(6)
    return BoardPoseEstimate(Pose(rotations_from_vectors(vector), translation), covariance)


def _require_spread(pixels: FloatArray, points: FloatArray) -> None:
    """Raise an error unless there are at least 6 finite corners that do not lie on one line."""
    if not (np.isfinite(pixels).all() and np.isfinite(points).all()):
        raise ValueError("expected finite corners: leave out those that were not found")
    if len(pixels) < 6:
        raise CalibrationFailed(
            f"{len(pixels)} corners of the board were found and 6 are needed: show more of it"
        )
    for coordinates in (points, pixels):
        singular_values = np.linalg.svd(coordinates - coordinates.mean(axis=0), compute_uv=False)
        if not singular_values[1] > 1e-3 * singular_values[0]:
            raise CalibrationFailed(
                "the board's corners lie on one line: the rotation about it is not determined"
            )


def _solve_pnp(
    pixels: FloatArray, points: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray]:
    """Return rotation vector and translation by least squares in pixels."""
    arguments = (
        np.array(points),
        np.array(pixels),
        np.array(camera.matrix),
        np.array(camera.distortion),
    )
    _, vector, translation = cv2.solvePnP(*arguments)
    vector, translation = cv2.solvePnPRefineLM(*arguments, vector, translation)
    return np.asarray(vector, np.float64).ravel(), np.asarray(translation, np.float64).ravel()


def _inverse_left_jacobian(vector: FloatArray) -> FloatArray:
    """Return the derivative (3, 3) of a rotation vector by a left-hand rotation."""
    angle = float(np.linalg.norm(vector))
    cross = cross_matrices(vector)
    if angle < 1e-6:
        small: FloatArray = np.eye(3) - 0.5 * cross
        return small
    factor = 1 / angle**2 - 1 / (2 * angle * np.tan(angle / 2))
    inverse: FloatArray = np.eye(3) - 0.5 * cross + factor * cross @ cross
    return inverse


def guess_camera_from_board(view: TargetView, rays: Points) -> Pose:
    """Return the pose of a board from the rays through its points, in closed form.

    Parameters
    ----------
    view : TargetView
        Points of the board, at least four, no three collinear.
    rays : (n, 3) ndarray
        Rays through the view's pixels, camera frame, z = 1.

    Returns
    -------
    Pose
        ``camera_from_board``, an initial guess for a refinement in pixels.
    """
    plane = np.ascontiguousarray(view.points[:, :2])
    homography, _ = cv2.findHomography(plane, np.ascontiguousarray(rays[:, :2]))
    # Zhang 2000, section 3.1: H = [r1 r2 t] up to scale.
    scale = 2 / (np.linalg.norm(homography[:, 0]) + np.linalg.norm(homography[:, 1]))
    first, second, translation = (homography * (scale * np.sign(homography[2, 2]))).T
    # Nearest rotation to the two columns and their cross product.
    U, _, Vt = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    return Pose(U @ Vt, translation)
