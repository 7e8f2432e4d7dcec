"""Uncertainty of a calibrated camera, and its effect on results that assume the camera to be exact.

The errors of the intrinsics are common to all views: more views do not average them out. They are
taken along the principal axes of their covariance, one standard deviation each, and the result is
computed again with each of these cameras.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from lsvision.calibration.board_pose import estimate_board_pose
from lsvision.calibration.rotations import vectors_from_rotations
from lsvision.calibration.target import TargetView
from lsvision.geometry import BoolArray, FloatArray, Pose
from lsvision.sensors.camera import Camera
from lsvision.statistics.normal_matrix import invert_normal_matrix

NEGLIGIBLE = 1e-8
"""Fraction of the largest variance below which a principal axis is left out."""


def intrinsics_covariance(
    camera: Camera, views: Sequence[TargetView], poses: Sequence[Pose], free: BoolArray
) -> FloatArray:
    """Return the covariance of fx, fy, cx, cy (px) and the distortion coefficients.

    Least squares over all views with their poses eliminated, scaled by the residuals; zero where a
    parameter is not free. Where only fy is free of the two, fx is a fixed multiple of it.

    Parameters
    ----------
    camera : Camera
        Calibrated.
    views : sequence of TargetView
        Views from which the camera was calibrated.
    poses : sequence of Pose
        ``camera_from_board`` of each.
    free : (4 + k,) ndarray of bool
        Mask of the parameters that were estimated.

    Returns
    -------
    (4 + k, 4 + k) ndarray
        Positive semidefinite.
    """
    transfer = intrinsics_by_free_ones(camera, free)
    information, chi2 = np.zeros((len(free), len(free))), 0.0
    for view, pose in zip(views, poses, strict=True):
        projected, jacobian = cv2.projectPoints(
            np.array(view.points), cv2.Rodrigues(np.array(pose.rotation))[0],
            np.array(pose.translation), np.array(camera.matrix), np.array(camera.distortion),
        )  # fmt: skip
        of_pose, of_camera = jacobian[:, :6], jacobian[:, 6 : 6 + len(free)]
        information += of_camera.T @ of_camera
        cross = of_pose.T @ of_camera
        information -= cross.T @ np.linalg.solve(of_pose.T @ of_pose, cross)
        chi2 += float(((np.asarray(projected).reshape(-1, 2) - view.pixels) ** 2).sum())
    reduced = transfer.T @ information @ transfer
    inverse = invert_normal_matrix(reduced)
    dof = 2 * sum(len(view.points) for view in views) - 6 * len(views) - len(reduced)
    covariance: FloatArray = transfer @ inverse @ transfer.T * (chi2 / max(dof, 1))
    return covariance


def intrinsics_by_free_ones(camera: Camera, free: BoolArray) -> FloatArray:
    """Return the Jacobian (4 + k, m) of all intrinsics by the m free ones.

    Where only fy is free of the two focal lengths, fx is a fixed multiple of it.
    """
    jacobian: FloatArray = np.eye(len(free))[:, free]
    if free[1] and not free[0]:
        jacobian[0, 0] = camera.matrix[0, 0] / camera.matrix[1, 1]
    return jacobian


def camera_modes(camera: Camera, covariance: FloatArray) -> list[Camera]:
    """Return the camera with one standard deviation of each of its independent errors."""
    if covariance.shape != (4 + len(camera.distortion),) * 2:
        raise ValueError(
            f"expected a covariance of {4 + len(camera.distortion)} intrinsics, got shape "
            f"{covariance.shape}"
        )
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    variances, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    cameras = []
    for variance, axis in zip(variances, axes.T, strict=True):
        if variance > NEGLIGIBLE * variances[-1]:
            change = np.sqrt(variance) * axis * scale
            matrix = camera.matrix.copy()
            matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
            distortion = camera.distortion + change[4:]
            cameras.append(replace(camera, matrix=matrix, distortion=distortion))
    return cameras


def board_pose_modes(
    views: Sequence[TargetView], camera: Camera, covariance: FloatArray
) -> FloatArray:
    """Return the shift of each board's pose by each independent error of the camera.

    Parameters
    ----------
    views : sequence of TargetView
        Points of the board in each image.
    camera : Camera
        Calibrated.
    covariance : (4 + k, 4 + k) ndarray
        Covariance of the intrinsics, from `CameraCalibration`.

    Returns
    -------
    (m, n, 6) ndarray
        Shift of the origin (mm) and left-hand rotation (rad), for m errors and n views.
    """
    modes = camera_modes(camera, covariance)
    shifts = np.zeros((len(modes), len(views), 6))
    for index, view in enumerate(views):
        pose = estimate_board_pose(view.pixels, view.points, camera).camera_from_board
        for mode, wrong in enumerate(modes):
            moved = estimate_board_pose(view.pixels, view.points, wrong).camera_from_board
            rotation = vectors_from_rotations((moved.rotation @ pose.rotation.T)[None])[0]
            shifts[mode, index] = np.append(moved.translation - pose.translation, rotation)
    return shifts


def covariance_by_camera(
    solve: Callable[[Camera], FloatArray], camera: Camera, covariance: FloatArray
) -> FloatArray:
    """Return the part of a result's covariance that the camera causes.

    `solve` gives the result (p,) for a camera.
    """
    nominal = solve(camera)
    part = np.zeros((len(nominal), len(nominal)))
    for wrong in camera_modes(camera, covariance):
        difference = solve(wrong) - nominal
        part += np.outer(difference, difference)
    return part
