"""Camera and board poses from views of a board that may be bent.

A board that is bowed or twisted by a few tenths of a millimetre biases the focal length by several
per cent, which hardly shows in the residuals. Its shape is common to all views.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lsvision.calibration.board_shape import SHAPE_TERMS, BoardShape
from lsvision.calibration.camera_uncertainty import intrinsics_by_free_ones
from lsvision.calibration.target import TargetView
from lsvision.geometry import BoolArray, FloatArray, Pose
from lsvision.sensors.camera import Camera
from lsvision.statistics.normal_matrix import invert_normal_matrix

MIN_F_RATIO = 10.0
"""Smallest F ratio of the three parameters of the shape; noise alone exceeds it in one of 10^6 sets
of views."""
MAX_STEPS = 30
"""Maximum number of Gauss-Newton steps; about six are needed."""
RELATIVE_TOLERANCE = 1e-10
"""Relative decrease of the sum of squares below which the iteration stops."""


@dataclass(frozen=True, eq=False)
class BentBoardFit:
    """Camera, poses and shape of the board, with standard deviations.

    Parameters
    ----------
    camera : Camera
        Refined.
    poses : list of Pose
        ``camera_from_board`` of each view.
    covariance : (4 + k, 4 + k) ndarray
        Of fx, fy, cx, cy (px) and the k coefficients; zero for fixed ones.
    shape : BoardShape
        Of the corners of all views.
    bow, bow_std : (3,) ndarray
        Parameters of the shape with one sigma. Units: mm.
    """

    camera: Camera
    poses: list[Pose]
    covariance: FloatArray
    shape: BoardShape
    bow: FloatArray
    bow_std: FloatArray


def fit_bent_board(
    camera: Camera, views: Sequence[TargetView], poses: Sequence[Pose], free: BoolArray
) -> BentBoardFit | None:
    """Refine a camera together with the shape of its board, if the board is significantly bent.

    Parameters
    ----------
    camera : Camera
        Calibrated with a flat board.
    views : sequence of TargetView
        From which it was calibrated.
    poses : sequence of Pose
        ``camera_from_board`` of each.
    free : (4 + k,) ndarray of bool
        Which of fx, fy, cx, cy and the coefficients are estimated. Where only fy is free of the
        two, fx is a fixed multiple of it.

    Returns
    -------
    BentBoardFit or None
        None if a flat board explains the corners equally well.
    """
    shape = BoardShape.of(np.concatenate([view.points for view in views]))
    start = _State.of(camera, poses)
    transfer = intrinsics_by_free_ones(camera, free)
    flat, flat_normal = _minimise(_Problem(views, shape, transfer, 0), start)
    problem = _Problem(views, shape, transfer, SHAPE_TERMS)
    bent, normal = _minimise(problem, flat)
    dof = 2 * sum(len(view.points) for view in views) - 6 * len(views) - len(normal.reduced)
    variance = normal.chi2 / max(dof, 1)
    if not flat_normal.chi2 - normal.chi2 > MIN_F_RATIO * SHAPE_TERMS * variance:
        return None
    covariance = variance * normal.inverse
    shared = transfer.shape[1]
    return BentBoardFit(
        bent.camera(camera),
        bent.board_poses(),
        transfer @ covariance[:shared, :shared] @ transfer.T,
        shape,
        bent.bow,
        np.sqrt(covariance.diagonal()[shared:]),
    )


@dataclass(frozen=True, eq=False)
class _State:
    """Intrinsics (4 + k,), rotation vectors and translations (v, 6), and shape (3,)."""

    intrinsics: FloatArray
    poses: FloatArray
    bow: FloatArray

    @classmethod
    def of(cls, camera: Camera, poses: Sequence[Pose]) -> "_State":
        matrix = camera.matrix
        numbers = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *camera.distortion]
        vectors = [
            np.append(cv2.Rodrigues(np.array(pose.rotation))[0].ravel(), pose.translation)
            for pose in poses
        ]
        return cls(np.array(numbers), np.array(vectors), np.zeros(SHAPE_TERMS))

    def camera(self, like: Camera) -> Camera:
        matrix = like.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] = self.intrinsics[:4]
        return replace(like, matrix=matrix, distortion=self.intrinsics[4:])

    def board_poses(self) -> list[Pose]:
        return [Pose(cv2.Rodrigues(vector[:3])[0], vector[3:]) for vector in self.poses]


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Normal equations of the common parameters (poses eliminated), and those of each pose."""

    reduced: FloatArray
    gradient: FloatArray
    of_poses: list[tuple[FloatArray, FloatArray, FloatArray]]
    chi2: float

    @property
    def scaled(self) -> tuple[FloatArray, FloatArray]:
        scale = 1 / np.sqrt(np.diag(self.reduced))
        return self.reduced * np.outer(scale, scale), scale

    @property
    def inverse(self) -> FloatArray:
        return invert_normal_matrix(self.reduced)

    def step(self) -> tuple[FloatArray, FloatArray]:
        """Return the step of the common parameters, and of the poses (v, 6)."""
        matrix, scale = self.scaled
        shared = scale * np.linalg.solve(matrix, scale * self.gradient)
        poses = [
            np.linalg.solve(information, gradient - cross @ shared)
            for information, cross, gradient in self.of_poses
        ]
        return shared, np.array(poses)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares in pixels, of the first `terms` parameters of the shape."""

    views: Sequence[TargetView]
    shape: BoardShape
    transfer: FloatArray
    terms: int

    def linearise(self, state: _State) -> _NormalEquations:
        size = self.transfer.shape[1] + self.terms
        reduced, gradient, of_poses, chi2 = np.zeros((size, size)), np.zeros(size), [], 0.0
        for view, vector in zip(self.views, state.poses, strict=True):
            by_pose, by_shared, error = self._view(state, view, vector)
            information, cross = by_pose.T @ by_pose, by_pose.T @ by_shared
            pose_gradient = by_pose.T @ error
            eliminated = np.linalg.solve(information, np.column_stack([cross, pose_gradient]))
            reduced += by_shared.T @ by_shared - cross.T @ eliminated[:, :-1]
            gradient += by_shared.T @ error - cross.T @ eliminated[:, -1]
            of_poses.append((information, cross, pose_gradient))
            chi2 += float(error @ error)
        return _NormalEquations(reduced, gradient, of_poses, chi2)

    def _view(
        self, state: _State, view: TargetView, vector: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the Jacobians by pose and common parameters, and observed minus projected."""
        fx, fy, cx, cy = state.intrinsics[:4]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        points = self.shape.bent(view.points, state.bow)
        projected, jacobian = cv2.projectPoints(
            points, vector[:3], vector[3:], matrix, state.intrinsics[4:]
        )
        by_height = jacobian[:, 3:6] @ cv2.Rodrigues(vector[:3])[0][:, 2]
        terms = np.repeat(self.shape.terms(view.points[:, :2]), 2, axis=0)[:, : self.terms]
        by_intrinsics = jacobian[:, 6 : 6 + len(state.intrinsics)] @ self.transfer
        by_shared = np.column_stack([by_intrinsics, by_height[:, None] * terms])
        error = view.pixels.ravel() - np.asarray(projected).ravel()
        return jacobian[:, :6], by_shared, error

    def moved(self, state: _State, step: tuple[FloatArray, FloatArray]) -> _State:
        shared, poses = step
        known = self.transfer.shape[1]
        bow = state.bow.copy()
        bow[: self.terms] += shared[known:]
        return _State(state.intrinsics + self.transfer @ shared[:known], state.poses + poses, bow)


def _minimise(problem: _Problem, state: _State) -> tuple[_State, _NormalEquations]:
    """Return the minimum by Gauss-Newton steps, halved if they increase the cost."""
    normal = problem.linearise(state)
    for _ in range(MAX_STEPS):
        shared, poses = normal.step()
        trial = problem.moved(state, (shared, poses))
        tried = problem.linearise(trial)
        while tried.chi2 > normal.chi2 and np.abs(shared).max() > RELATIVE_TOLERANCE:
            shared, poses = shared / 2, poses / 2
            trial = problem.moved(state, (shared, poses))
            tried = problem.linearise(trial)
        if not tried.chi2 < normal.chi2:
            break
        decrease, state, normal = normal.chi2 - tried.chi2, trial, tried
        if decrease < RELATIVE_TOLERANCE * normal.chi2:
            break
    return state, normal
