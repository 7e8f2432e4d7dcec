"""Uncertainty of a calibrated camera, and its effect on results that assume the camera to be exact.

The errors of the intrinsics are common to all views: more views do not average them out. They are
taken along the principal axes of their covariance, one standard deviation each, and the result is
computed again with each of these cameras.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np

from lsvision.calibration.board_pose import compute_pose_difference, estimate_board_pose
from lsvision.calibration.covariance_check import check_covariance
from lsvision.calibration.target import TargetView
from lsvision.geometry import BoolArray, FloatArray, Pose
from lsvision.sensors.camera import Camera
from lsvision.statistics.normal_matrix import invert_normal_matrix

MIN_VARIANCE_RATIO = 1e-8
"""Fraction of the largest eigenvalue of the correlation matrix below which a principal axis is left
out."""


def intrinsics_covariance(
    camera: Camera, views: Sequence[TargetView], poses: Sequence[Pose], free: BoolArray
) -> FloatArray:
    """Return the covariance (4 + k, 4 + k) of fx, fy, cx, cy (px) and the distortion coefficients.

    Least squares over all views with their poses eliminated, scaled by the residuals; zero where a
    parameter is not `free` (4 + k,). If fy is free and fx is not, fx is a fixed multiple of fy.
    Camera and poses (``camera_from_board``) are those calibrated from the views.
    """
    free_jacobian = free_intrinsics_jacobian(camera, free)
    information, chi2 = np.zeros((len(free), len(free))), 0.0
    for view, pose in zip(views, poses, strict=True):
        projected, jacobian = cv2.projectPoints(
            np.array(view.points), cv2.Rodrigues(np.array(pose.rotation))[0],
            np.array(pose.translation), np.array(camera.matrix), np.array(camera.distortion),
        )  # fmt: skip
        pose_jacobian, intrinsics_jacobians = jacobian[:, :6], jacobian[:, 6 : 6 + len(free)]
        information += intrinsics_jacobians.T @ intrinsics_jacobians
        cross = pose_jacobian.T @ intrinsics_jacobians
        information -= cross.T @ np.linalg.solve(pose_jacobian.T @ pose_jacobian, cross)
        chi2 += float(((np.asarray(projected).reshape(-1, 2) - view.pixels) ** 2).sum())
    reduced = free_jacobian.T @ information @ free_jacobian
    inverse = invert_normal_matrix(reduced)
    dof = 2 * sum(len(view.points) for view in views) - 6 * len(views) - len(reduced)
    return free_jacobian @ inverse @ free_jacobian.T * (chi2 / max(dof, 1))


def free_intrinsics_jacobian(camera: Camera, free: BoolArray) -> FloatArray:
    """Return the Jacobian (4 + k, m) of all intrinsics by the m free intrinsics.

    If fy is free and fx is not, fx is a fixed multiple of fy.
    """
    jacobian: FloatArray = np.eye(len(free))[:, free]
    if free[1] and not free[0]:
        jacobian[0, 0] = camera.matrix[0, 0] / camera.matrix[1, 1]
    return jacobian


def compute_camera_modes(camera: Camera, covariance: FloatArray) -> list[Camera]:
    """Return cameras, each changed by one standard deviation along a principal axis.

    The axes are those of the correlation matrix of the intrinsics; the sum over the cameras of the
    squared changes is the covariance (4 + k, 4 + k). Raises the ValueError
    of `check_intrinsics_covariance`.
    """
    check_intrinsics_covariance(camera, covariance)
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    variances, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    cameras = []
    for variance, axis in zip(variances, axes.T, strict=True):
        if variance > MIN_VARIANCE_RATIO * variances[-1]:
            change = np.sqrt(variance) * axis * scale
            matrix = camera.matrix.copy()
            matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
            distortion = camera.distortion + change[4:]
            cameras.append(replace(camera, matrix=matrix, distortion=distortion))
    return cameras


def check_intrinsics_covariance(camera: Camera, covariance: FloatArray) -> None:
    """Raise ValueError for a matrix that is not a covariance of the camera's intrinsics.

    It must be of their number, finite, symmetric and positive semi-definite.
    """
    if covariance.shape != (4 + len(camera.distortion),) * 2:
        raise ValueError(
            f"expected a covariance of {4 + len(camera.distortion)} intrinsics, got shape "
            f"{covariance.shape}"
        )
    check_covariance(covariance)


def compute_board_pose_modes(
    views: Sequence[TargetView], camera: Camera, covariance: FloatArray
) -> FloatArray:
    """Return the shift (m, n, 6) of the poses of n boards by m independent errors of the camera.

    One standard deviation each: shift of the origin (mm), and vector w (rad) of the rotation R ->
    exp([w]x) R. `covariance` (4 + k, 4 + k) is that of fx, fy, cx, cy (px) and the k coefficients,
    from `CameraCalibration`.
    """
    modes = compute_camera_modes(camera, covariance)
    shifts = np.zeros((len(modes), len(views), 6))
    for index, view in enumerate(views):
        pose = estimate_board_pose(view.pixels, view.points, camera).camera_from_board
        for mode, changed_camera in enumerate(modes):
            changed_pose = estimate_board_pose(
                view.pixels, view.points, changed_camera
            ).camera_from_board
            shifts[mode, index] = compute_pose_difference(changed_pose, pose)
    return shifts


def covariance_by_camera(
    solve: Callable[[Camera], FloatArray], camera: Camera, covariance: FloatArray
) -> FloatArray:
    """Return the covariance (p, p) of a result due to the uncertainty of the camera.

    `solve` returns the result (p,) for a camera; `covariance` is that of the intrinsics.
    """
    nominal = solve(camera)
    cameras = compute_camera_modes(camera, covariance)
    differences = np.array([solve(changed) - nominal for changed in cameras]).reshape(
        -1, len(nominal)
    )
    camera_covariance: FloatArray = differences.T @ differences
    return camera_covariance
