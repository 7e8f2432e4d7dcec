"""Pose of a board in the camera frame from one image."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.rotations import (
    find_nearest_rotations,
    rotation_vector_jacobian,
    rotations_from_vectors,
    vectors_from_rotations,
)
from lsvision.calibration.target import TargetView
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Points, Pose, as_readonly_array
from lsvision.geometry.arrays import freeze_arrays
from lsvision.sensors.camera import Camera

MIN_CORNERS = 6
"""Smallest number of corners of a pose: three determine it, and the residuals of the others its
covariance."""

DEFAULT_FOCAL_RATIO = 1.2
"""Focal length, relative to the image's width, of a camera that is not calibrated: a field of view
of 45 deg. If it is 30 to 60 deg, a tilt of 20 deg is estimated as 13 to 27 deg."""

MIN_SPREAD_RATIO = 1e-3
"""Smallest ratio of the spread (singular value) of corners across their main direction to that
along it; below, they count as lying on one line, which does not determine a pose."""

STOPPING_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
"""Maximum number of iterations, and smallest relative change, of OpenCV's refinement of a pose. Its
own 20 iterations are too few for small boards, whose minimum is a curved valley."""

COVARIANCE_FLOOR = 1e-14
"""Variance (mm^2, rad^2) added to each component, so that the covariance of exact corners is
invertible."""


@dataclass(frozen=True, eq=False)
class BoardPoseEstimate:
    """Pose of a board in the camera frame, with covariance.

    Parameters
    ----------
    camera_from_board : Pose
        Estimated pose.
    covariance : (6, 6) array_like
        Covariance of the board's origin (mm) and of its left perturbation (rad), a vector w in
        R -> exp([w]x) R; both along the axes of the camera frame.
    """

    camera_from_board: Pose
    covariance: FloatArray

    def __post_init__(self) -> None:
        freeze_arrays(self, covariance=(6, 6))


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
        Least-squares estimate; the noise of the corners is estimated from their residuals. A board
        that is small in the image may look the same with the opposite tilt: the covariance includes
        that pose, weighted by its probability.

    Raises
    ------
    CalibrationFailed
        If there are fewer than 6 corners, or they lie on one line.
    ValueError
        If the shapes differ from the above, or a corner is not finite.
    """
    pixels = as_readonly_array(corners, ("n", 2), "corners")
    points = as_readonly_array(board_points, (len(pixels), 3), "board points")
    _require_spread(pixels, points)
    pixels, camera = _without_skew(pixels, camera)
    solution = _solve_pnp(pixels, points, camera)
    mirrored = _refine(pixels, points, camera, _mirror(solution.pose, points))
    best, other = sorted((solution, mirrored), key=lambda minimum: minimum.chi2)
    variance = best.chi2 / (2 * len(pixels) - 6)
    covariance = np.linalg.inv(best.jacobian.T @ best.jacobian) * variance
    covariance += COVARIANCE_FLOOR * np.eye(6)
    # Probability of the other pose by the ratio of the likelihoods.
    excess = (other.chi2 - best.chi2) / max(variance, COVARIANCE_FLOOR)
    probability = 1 / (1 + np.exp(min(excess / 2, 700.0)))
    shift = compute_pose_difference(other.pose, best.pose)
    return BoardPoseEstimate(best.pose, covariance + probability * np.outer(shift, shift))


@dataclass(frozen=True, eq=False)
class _Minimum:
    """Pose of a board with a minimum of the squared residuals.

    Parameters
    ----------
    pose : Pose
        ``camera_from_board``.
    chi2 : float
        Sum of squared residuals. Units: px^2.
    jacobian : (2n, 6) ndarray
        Derivatives of the projected corners by translation (mm) and left perturbation (rad).
    """

    pose: Pose
    chi2: float
    jacobian: FloatArray


def _require_spread(pixels: FloatArray, points: FloatArray) -> None:
    """Raise an error unless enough corners are given, all finite and not on one line."""
    if not (np.isfinite(pixels).all() and np.isfinite(points).all()):
        raise ValueError("expected finite corners: leave out those that were not found")
    if len(pixels) < MIN_CORNERS:
        raise CalibrationFailed(
            f"{len(pixels)} corners of the board were found and {MIN_CORNERS} are needed: show "
            "more of it"
        )
    for coordinates in (points, pixels):
        singular_values = np.linalg.svd(coordinates - coordinates.mean(axis=0), compute_uv=False)
        if not singular_values[1] > MIN_SPREAD_RATIO * singular_values[0]:
            raise CalibrationFailed(
                "the board's corners lie on one line: the rotation about it is not determined"
            )


def _without_skew(pixels: FloatArray, camera: Camera) -> tuple[FloatArray, Camera]:
    """Return the pixels (n, 2) in a camera without skew, which OpenCV ignores, and that camera."""
    (_, skew, _), (_, fy, cy), _ = camera.matrix
    matrix = camera.matrix.copy()
    matrix[0, 1] = 0.0
    shear = skew / fy * (pixels[:, 1] - cy)
    return pixels - np.column_stack([shear, np.zeros(len(pixels))]), replace(camera, matrix=matrix)


def _solve_pnp(pixels: FloatArray, points: FloatArray, camera: Camera) -> _Minimum:
    """Return the minimum that OpenCV finds without initial guess."""
    _, vector, translation = cv2.solvePnP(
        np.array(points), np.array(pixels), np.array(camera.matrix), np.array(camera.distortion)
    )
    guess = Pose(cv2.Rodrigues(vector)[0], np.reshape(translation, 3))
    return _refine(pixels, points, camera, guess)


def _refine(pixels: FloatArray, points: FloatArray, camera: Camera, guess: Pose) -> _Minimum:
    """Return the minimum of the squared residuals in pixels near an initial guess."""
    points, lens = np.array(points), (np.array(camera.matrix), np.array(camera.distortion))
    vector, translation = cv2.solvePnPRefineLM(
        points, np.array(pixels), *lens,
        cv2.Rodrigues(np.array(guess.rotation))[0], np.array(guess.translation)[:, None],
        STOPPING_CRITERIA,
    )  # fmt: skip
    vector = np.asarray(vector, np.float64).ravel()
    projected, jacobian = cv2.projectPoints(points, vector, translation, *lens)
    residuals = np.asarray(projected).reshape(-1, 2) - pixels
    rotation_jacobian = jacobian[:, :3] @ rotation_vector_jacobian(vector)
    return _Minimum(
        Pose(rotations_from_vectors(vector), np.reshape(translation, 3)),
        float((residuals**2).sum()),
        np.concatenate([jacobian[:, 3:6], rotation_jacobian], axis=1),
    )


def _mirror(camera_from_board: Pose, points: FloatArray) -> Pose:
    """Return the pose with the opposite tilt, which looks alike from far away.

    The flat board is mirrored at the plane through its middle that is perpendicular to the ray.
    """
    middle = points.mean(axis=0)
    in_camera = camera_from_board.apply_one(middle)
    ray = in_camera / np.linalg.norm(in_camera)
    reflection = np.eye(3) - 2 * np.outer(ray, ray)
    rotation = reflection @ camera_from_board.rotation @ np.diag([1.0, 1.0, -1.0])
    return Pose(rotation, in_camera - rotation @ middle)


def compute_pose_difference(pose: Pose, reference: Pose) -> FloatArray:
    """Return the difference (6,) of two poses: origin (mm) and left perturbation (rad)."""
    rotation = vectors_from_rotations((pose.rotation @ reference.rotation.T)[None])[0]
    return np.append(pose.translation - reference.translation, rotation)


def guess_board_pose(view: TargetView, rays: Points) -> Pose:
    """Return ``camera_from_board`` from the rays through a view's points, in closed form.

    An initial guess for a refinement in pixels. The rays (n, 3) are in the camera frame, with z =
    1; of four of the points no three may be collinear.
    """
    plane = np.ascontiguousarray(view.points[:, :2])
    homography, _ = cv2.findHomography(plane, np.ascontiguousarray(rays[:, :2]))
    # Zhang 2000, section 3.1: H = [r1 r2 t] up to scale and sign; the board is in front, t_z > 0.
    scale = 2 / (np.linalg.norm(homography[:, 0]) + np.linalg.norm(homography[:, 1]))
    first, second, translation = (homography * (scale * np.sign(homography[2, 2]))).T
    columns = np.column_stack([first, second, np.cross(first, second)])
    return Pose(find_nearest_rotations(columns), translation)
