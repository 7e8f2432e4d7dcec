"""Camera and board poses from views of a board that may be bent.

A board that is bowed or twisted by a few tenths of a millimetre biases the focal length by several
per cent, which hardly shows in the residuals. Its shape is common to all views.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lsvision.calibration.board_shape import SHAPE_TERMS, BoardShape
from lsvision.calibration.camera_uncertainty import free_intrinsics_jacobian
from lsvision.calibration.target import TargetView
from lsvision.geometry import BoolArray, FloatArray, Pose
from lsvision.sensors.camera import Camera
from lsvision.statistics.normal_matrix import invert_normal_matrix

MAX_STEPS = 300
"""Maximum number of steps; about six are needed, and up to 200 with a tilted sensor."""
MIN_DAMPING, MAX_DAMPING, DAMPING_FACTOR = 1e-8, 1e2, 3.0
"""Damping added to the diagonal of the normal equations, which is scaled to 1: its value after the
first step that increased the cost, the value at which the iteration stops, and the factor by which
it changes from step to step. With a factor of 10, half of the simulated sets of views with a tilted
sensor do not reach the minimum."""
RELATIVE_TOLERANCE = 1e-10
"""Relative decrease of the sum of squares below which the iteration stops."""


@dataclass(frozen=True, eq=False)
class BentBoardFit:
    """Camera, poses and shape of the board, flat for a bow of zeros, with uncertainties.

    Parameters
    ----------
    camera : Camera
        Refined camera.
    poses : list of Pose
        ``camera_from_board`` of each view.
    covariance : (4 + k, 4 + k) ndarray
        Covariance of fx, fy, cx, cy (px) and the k distortion coefficients; zero for fixed ones.
    shape : BoardShape
        Shape functions over the extent of the corners of all views.
    bow, bow_std : (3,) ndarray
        Parameters of the shape and their standard deviations. Units: mm.
    """

    camera: Camera
    poses: list[Pose]
    covariance: FloatArray
    shape: BoardShape
    bow: FloatArray
    bow_std: FloatArray


def fit_bent_board(
    camera: Camera, views: Sequence[TargetView], poses: Sequence[Pose], free: BoolArray
) -> BentBoardFit:
    """Return camera, poses and shape of the board, refined together by least squares.

    The shape is fitted to a flat board, too. It increases the standard deviation of the focal
    length by a sixth at most (6 to 15 views of 30 deg), and a bow that is too small to be
    significant would bias it by twice its standard deviation.

    Camera and poses (``camera_from_board`` of each view) are those of a calibration with a flat
    board. `free` (4 + k,) masks the parameters fx, fy, cx, cy and distortion coefficients that are
    estimated. If fy is free and fx is not, fx is a fixed multiple of fy. The noise is estimated
    from the residuals.
    """
    shape = BoardShape.of(np.concatenate([view.points for view in views]))
    free_jacobian = free_intrinsics_jacobian(camera, free)
    problem = _Problem(views, shape, free_jacobian)
    state, normal = _minimise(problem, _State.of(camera, poses))
    dof = 2 * sum(len(view.points) for view in views) - 6 * len(views) - len(normal.reduced)
    covariance = invert_normal_matrix(normal.reduced) * (normal.chi2 / max(dof, 1))
    free_intrinsics = free_jacobian.shape[1]
    return BentBoardFit(
        state.build_camera(camera),
        [Pose(cv2.Rodrigues(vector[:3])[0], vector[3:]) for vector in state.poses],
        free_jacobian @ covariance[:free_intrinsics, :free_intrinsics] @ free_jacobian.T,
        shape,
        state.bow,
        np.sqrt(covariance.diagonal()[free_intrinsics:]),
    )


@dataclass(frozen=True, eq=False)
class _State:
    """Intrinsics (4 + k,), rotation vectors (rad) and translations (mm) (v, 6), and shape (3,)."""

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

    def build_camera(self, like: Camera) -> Camera:
        """Return a camera with these intrinsics and the image size of another one."""
        matrix = like.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] = self.intrinsics[:4]
        return replace(like, matrix=matrix, distortion=self.intrinsics[4:])


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Normal equations of the common parameters (poses eliminated), and those of each pose.

    Parameters
    ----------
    reduced, gradient : (p, p) and (p,) ndarray
        Matrix and right-hand side of the p common parameters: free intrinsics and shape.
    pose_equations : list of tuple of ndarray
        Matrix (6, 6) of each pose, its block (6, p) with the common parameters, and right-hand side
        (6,).
    chi2 : float
        Sum of squared residuals. Units: px^2.
    """

    reduced: FloatArray
    gradient: FloatArray
    pose_equations: list[tuple[FloatArray, FloatArray, FloatArray]]
    chi2: float

    def solve_step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the step of the common parameters, and of the poses (v, 6)."""
        scale = 1 / np.sqrt(np.diag(self.reduced))  # to a unit diagonal
        damped = self.reduced * np.outer(scale, scale) + damping * np.eye(len(scale))
        common_step = scale * np.linalg.solve(damped, scale * self.gradient)
        pose_steps = [
            np.linalg.solve(information, gradient - cross @ common_step)
            for information, cross, gradient in self.pose_equations
        ]
        return common_step, np.array(pose_steps)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least-squares problem in pixels.

    `free_jacobian` is the Jacobian (4 + k, m) of all intrinsics by the m free ones.
    """

    views: Sequence[TargetView]
    shape: BoardShape
    free_jacobian: FloatArray

    def linearise(self, state: _State) -> _NormalEquations:
        """Return the normal equations at a state."""
        size = self.free_jacobian.shape[1] + SHAPE_TERMS
        reduced, gradient, pose_equations, chi2 = np.zeros((size, size)), np.zeros(size), [], 0.0
        for view, vector in zip(self.views, state.poses, strict=True):
            pose_jacobian, common_jacobian, error = self._linearise_view(state, view, vector)
            information, cross = pose_jacobian.T @ pose_jacobian, pose_jacobian.T @ common_jacobian
            pose_gradient = pose_jacobian.T @ error
            eliminated = np.linalg.solve(information, np.column_stack([cross, pose_gradient]))
            reduced += common_jacobian.T @ common_jacobian - cross.T @ eliminated[:, :-1]
            gradient += common_jacobian.T @ error - cross.T @ eliminated[:, -1]
            pose_equations.append((information, cross, pose_gradient))
            chi2 += float(error @ error)
        return _NormalEquations(reduced, gradient, pose_equations, chi2)

    def _linearise_view(
        self, state: _State, view: TargetView, vector: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the Jacobians by pose and common parameters, and observed minus projected."""
        fx, fy, cx, cy = state.intrinsics[:4]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        points = self.shape.bend(view.points, state.bow)
        projected, jacobian = cv2.projectPoints(
            points, vector[:3], vector[3:], matrix, state.intrinsics[4:]
        )
        height_jacobian = jacobian[:, 3:6] @ cv2.Rodrigues(vector[:3])[0][:, 2]
        terms = np.repeat(self.shape.evaluate_terms(view.points[:, :2]), 2, axis=0)
        intrinsics_jacobian = jacobian[:, 6 : 6 + len(state.intrinsics)] @ self.free_jacobian
        common_jacobian = np.column_stack([intrinsics_jacobian, height_jacobian[:, None] * terms])
        error = view.pixels.ravel() - np.asarray(projected).ravel()
        return jacobian[:, :6], common_jacobian, error

    def apply_step(self, state: _State, step: tuple[FloatArray, FloatArray]) -> _State:
        """Return the state after a step of the common parameters and of the poses (v, 6)."""
        common_step, pose_steps = step
        free_intrinsics = self.free_jacobian.shape[1]
        intrinsics = state.intrinsics + self.free_jacobian @ common_step[:free_intrinsics]
        bow = state.bow + common_step[free_intrinsics:]
        return _State(intrinsics, state.poses + pose_steps, bow)


def _minimise(problem: _Problem, state: _State) -> tuple[_State, _NormalEquations]:
    """Return the minimum and the normal equations there.

    Gauss-Newton steps are damped where they increase the cost: the tilt of a sensor and the
    principal point have nearly the same effect, and undamped steps lead out of their curved valley.
    """
    normal, damping = problem.linearise(state), 0.0
    for _ in range(MAX_STEPS):
        trial = problem.apply_step(state, normal.solve_step(damping))
        trial_normal = problem.linearise(trial)
        if trial_normal.chi2 < normal.chi2:
            decrease, state, normal = normal.chi2 - trial_normal.chi2, trial, trial_normal
            damping = damping / DAMPING_FACTOR if damping > MIN_DAMPING else 0.0
            if decrease < RELATIVE_TOLERANCE * normal.chi2:
                break
        elif damping < MAX_DAMPING:
            damping = max(damping * DAMPING_FACTOR, MIN_DAMPING)
        else:
            break
    return state, normal
