"""Hand-eye calibration: sensor to robot, on a sphere, a plane or a board.

The data of each pose are reduced to a few numbers with a covariance. The solution and the outlying
poses are found from many initial guesses and random selections of poses, so that the caller need
not give an initial guess. Robot poses are treated as noisy (`errors_in_variables`), so that the
covariance is valid. Data that do not determine the solution raise an error with the missing motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_observations import BoardObservations
from lsvision.calibration.covariance_check import check_covariance
from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit
from lsvision.calibration.hand_eye_checks import estimate_board_scale
from lsvision.calibration.hand_eye_pairs import (
    find_repeated_pairs,
    find_shapes,
    reject_repeated_pose,
    require_pairs,
    require_pose_count,
)
from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
from lsvision.calibration.hand_eye_solver import ResultContext, build_hand_eye, solve_hand_eye
from lsvision.calibration.observations import Mounting, Sphere, stack_flange_poses
from lsvision.calibration.plane_line import PlaneLine, find_plane_line
from lsvision.calibration.plane_observations import PlaneObservations
from lsvision.calibration.robot_std import NOMINAL_ROBOT_STD
from lsvision.calibration.sphere_arc import SphereArc, find_sphere_arc
from lsvision.calibration.sphere_observations import SphereObservations, require_distinct_cuts
from lsvision.geometry import FloatArray, Plane, Pose, as_readonly_array
from lsvision.geometry.pose import as_poses
from lsvision.profile import Profile, require_several

EXACT_RADIUS_STD = 1e-4
"""Standard deviation of a given radius. Units: mm."""
EXACT_BOARD_VARIANCE = 1e-12
"""Variance (mm^2, rad^2) of boards without stated covariances: the robot's is far larger."""
MIN_SPHERE_POSES, MIN_KNOWN_SPHERE_POSES = 6, 5
"""Smallest number of poses that show a sphere of unknown and of known radius, and of inliers among
them. Each gives a circle, three numbers; the sensor and the sphere have 11 or 10 unknowns."""
MIN_PLANE_POSES, MIN_PLANE_INLIERS = 8, 6
"""Smallest number of poses that show a plane, and of inliers among them: each gives two numbers."""
MIN_BOARD_POSES, MIN_BOARD_INLIERS = 4, 3
"""Smallest number of poses that show a board, and of inliers among them."""

DEFAULT_SETTINGS = HandEyeSettings()


def calibrate_hand_eye_sphere(
    profiles: Sequence[Profile | npt.ArrayLike],
    base_from_flanges: Sequence[Pose | npt.ArrayLike],
    radius: float | None = None,
    *,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT_SETTINGS,
) -> HandEye:
    """Calibrate a profile sensor to a robot by profiles of one fixed sphere.

    Take 12 poses: tilts of up to 35 deg about both axes, all rotations about the viewing direction,
    the sphere left and right, near and far in the view, and the laser plane 0.3 to 0.85 radii away
    from its centre, on both sides. Cuts through the centre do not determine the position across the
    laser plane.

    Parameters
    ----------
    profiles : sequence of Profile or (n, 2) array_like
        Profile at each pose; the sphere may be among other objects, and its flanks are not used.
    base_from_flanges : sequence of Pose or (4, 4) array_like
        Flange pose at each observation. Units: mm.
    radius : float, optional
        Radius of the sphere, where it is known accurately; otherwise it is estimated, with little
        loss of accuracy and as a check. Units: mm.
    mounting : {"eye_in_hand", "eye_to_hand"}
        Sensor on the flange and sphere fixed, or sensor fixed and sphere on the flange.
    settings : HandEyeSettings
        Robot and limits for acceptance.

    Returns
    -------
    HandEye
        `flange_from_section` (or `base_from_section`), covariance, residuals, rejected poses,
        and `height_scale`, which shows a sensor whose heights are scaled wrong.

    Raises
    ------
    ValueError
        If the numbers of profiles and poses differ, the radius is not positive and finite, or the
        mounting is another string.
    CalibrationFailed
        If too few poses show a sphere, poses do not belong to the profiles, or the sphere moved.
    DegenerateGeometry
        If the poses leave a direction undetermined; the missing motion is named.

    Examples
    --------
    >>> from lsvision.simulate.hand_eye import SectionView, TargetMotion
    >>> from lsvision.simulate.hand_eye import draw_section_poses_about, simulate_sphere_profile
    >>> rng, ball = np.random.default_rng(0), np.array([800.0, 0.0, 300.0])
    >>> sections = draw_section_poses_about(ball, 12, TargetMotion(working_y=-150.0), rng)
    >>> mount = Pose(translation=(0.0, 80.0, 120.0))
    >>> centres = [pose.inverse().apply_one(ball) for pose in sections]
    >>> profiles = [simulate_sphere_profile(centre, 20.0, SectionView(), rng) for centre in centres]
    >>> flanges = [pose @ mount.inverse() for pose in sections]
    >>> calibration = calibrate_hand_eye_sphere(profiles, flanges)
    >>> calibration.flange_from_section.translation.round(0) + 0.0
    array([  0.,  80., 120.])
    >>> calibration.rejected, calibration.working_point_std < 0.02
    ((), True)
    """
    require_several(profiles)
    flanges = as_poses(base_from_flanges)
    require_pairs(len(profiles), len(flanges), "profiles")
    if radius is not None and not 0 < radius < np.inf:
        raise ValueError(f"expected a positive, finite radius in mm, got {radius}")
    arcs, observed, unobserved = find_shapes(
        profiles, flanges, lambda profile: find_sphere_arc(profile, radius, settings.arc), "sphere"
    )
    min_poses = MIN_SPHERE_POSES if radius is None else MIN_KNOWN_SPHERE_POSES
    require_pose_count(len(observed), min_poses, "a sphere in the profile", unobserved)
    poses = [flanges[index] for index in observed]
    largest = max(float(arc.circle[2]) for arc in arcs)
    observations = SphereObservations(
        np.array([arc.circle for arc in arcs]),
        _covariances(arcs),
        _common_height_scale_gradients(arcs),
        stack_flange_poses(poses, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        (largest, np.inf) if radius is None else (radius, EXACT_RADIUS_STD),
        np.zeros(len(observed), dtype=np.int64),
    )
    require_distinct_cuts(observations.circles, radius)
    fit = solve_hand_eye(observations, poses, observed, min_poses, settings)
    *centre, fitted_radius, height_scale_error = fit.states.targets[0, 0].tolist()
    target_std = np.sqrt(np.diag(fit.covariance)[6:])
    *_, radius_std, height_scale_std = target_std.tolist()
    size = (fitted_radius, radius_std) if radius is None else (radius, 0.0)
    target = Sphere(np.array(centre), *size)
    working_point = np.append(observations.circles[:, :2].mean(axis=0), 0.0)
    context = ResultContext(observed, unobserved, working_point, mounting, "section", settings)
    result = build_hand_eye(observations, fit, target, context)
    return replace(result, height_scale=(1 + height_scale_error, height_scale_std))


def calibrate_hand_eye_plane(
    profiles: Sequence[Profile | npt.ArrayLike],
    base_from_flanges: Sequence[Pose | npt.ArrayLike],
    *,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT_SETTINGS,
) -> HandEye:
    """Calibrate a profile sensor to a robot by profiles of one fixed plane.

    A plane is more accurate than a sphere in rotation, but two to three times less accurate at the
    working point. Take 20 poses, tilted by ± 40 deg about two axes, at near and far ranges.

    Parameters
    ----------
    profiles : sequence of Profile or (n, 2) array_like
        Profile at each pose; the straight line on which most of its points lie is used.
    base_from_flanges : sequence of Pose or (4, 4) array_like
        Flange pose at each observation.
    mounting, settings
        As in `calibrate_hand_eye_sphere`.

    Returns
    -------
    HandEye
        Calibration whose `target` is the plane.

    Raises
    ------
    ValueError, CalibrationFailed, DegenerateGeometry
        As in `calibrate_hand_eye_sphere`.

    Examples
    --------
    >>> from lsvision.simulate.hand_eye import SectionView, TargetMotion
    >>> from lsvision.simulate.hand_eye import draw_section_poses_about, simulate_plane_profile
    >>> rng, position = np.random.default_rng(0), np.array([800.0, 0.0, 300.0])
    >>> motion = TargetMotion(working_y=-150.0, tilt=np.radians(40.0), offset=0.0)
    >>> sections = draw_section_poses_about(position, 10, motion, rng)
    >>> mount, plane = Pose(translation=(0.0, 80.0, 120.0)), Plane((0, 0, 1), 300.0)
    >>> planes = [plane.transformed(pose.inverse()) for pose in sections]
    >>> profiles = [simulate_plane_profile(seen, SectionView(), rng) for seen in planes]
    >>> flanges = [pose @ mount.inverse() for pose in sections]
    >>> calibration = calibrate_hand_eye_plane(profiles, flanges)
    >>> calibration.flange_from_section.translation.round(0) + 0.0
    array([  0.,  80., 120.])
    """
    require_several(profiles)
    flanges = as_poses(base_from_flanges)
    require_pairs(len(profiles), len(flanges), "profiles")
    lines, observed, unobserved = find_shapes(profiles, flanges, find_plane_line, "line")
    require_pose_count(len(observed), MIN_PLANE_POSES, "a straight line in the profile", unobserved)
    poses = [flanges[index] for index in observed]
    observations = PlaneObservations(
        np.array([line.midpoint for line in lines]),
        np.array([line.direction for line in lines]),
        np.array([line.rms_length for line in lines]),
        _covariances(lines),
        stack_flange_poses(poses, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        np.zeros(len(observed), dtype=np.int64),
    )
    fit = solve_hand_eye(observations, poses, observed, MIN_PLANE_INLIERS, settings)
    normal_distance = fit.states.targets[0, 0]
    target = Plane(normal_distance[:3], float(normal_distance[3]))
    working_point = observations.midpoints.mean(axis=0)
    context = ResultContext(observed, unobserved, working_point, mounting, "section", settings)
    return build_hand_eye(observations, fit, target, context)


def calibrate_hand_eye_board(
    camera_from_boards: Sequence[Pose | npt.ArrayLike],
    base_from_flanges: Sequence[Pose | npt.ArrayLike],
    *,
    covariances: npt.ArrayLike | None = None,
    camera_modes: npt.ArrayLike | None = None,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT_SETTINGS,
) -> HandEye:
    """Calibrate a camera to a robot by views of one fixed board (``A X = Z B``).

    Parameters
    ----------
    camera_from_boards : sequence of Pose or (4, 4) array_like
        Pose of the board in each image; `estimate_board_pose` computes it from corners.
    base_from_flanges : sequence of Pose or (4, 4) array_like
        Flange pose at each observation.
    covariances : (n, 6, 6) array_like, optional
        Covariances of the boards' origins (mm) and left perturbations (rad; vectors w in
        R -> exp([w]x) R) in the camera frame, from `estimate_board_pose`. Without them all errors
        are attributed to the robot.
    camera_modes : (m, n, 6) array_like, optional
        Shifts of the boards' origins (mm) and left perturbations (rad) by each of m independent
        errors of the camera, one standard deviation each, from `compute_board_pose_modes`. Without
        them the camera is taken as exact.
    mounting, settings
        As in `calibrate_hand_eye_sphere`.

    Returns
    -------
    HandEye
        `flange_from_camera` (or `base_from_camera`), and `target_scale`, which shows a board whose
        size was stated wrong.

    Raises
    ------
    ValueError, CalibrationFailed, DegenerateGeometry
        As in `calibrate_hand_eye_sphere`; ValueError also for an invalid covariance or mode.

    Examples
    --------
    >>> from lsvision.simulate.hand_eye import TargetMotion, draw_section_poses_about
    >>> rng, position = np.random.default_rng(0), np.array([800.0, 0.0, 300.0])
    >>> motion = TargetMotion(working_y=-150.0)
    >>> base_from_cameras = draw_section_poses_about(position, 8, motion, rng)
    >>> mount, base_from_board = Pose(translation=(0.0, 80.0, 120.0)), Pose(translation=position)
    >>> boards = [pose.inverse() @ base_from_board for pose in base_from_cameras]
    >>> flanges = [pose @ mount.inverse() for pose in base_from_cameras]
    >>> calibration = calibrate_hand_eye_board(boards, flanges)
    >>> calibration.flange_from_camera.translation.round(3) + 0.0
    array([  0.,  80., 120.])
    """
    boards, flanges = as_poses(camera_from_boards), as_poses(base_from_flanges)
    count = len(boards)
    require_pairs(count, len(flanges), "boards")
    repeated = find_repeated_pairs([pose.matrix for pose in boards], flanges)
    observed = [index for index in range(count) if index not in repeated]
    unobserved = [reject_repeated_pose(*pair, "board") for pair in repeated.items()]
    require_pose_count(len(observed), MIN_BOARD_POSES, "a board in the image", unobserved)
    shifts = np.zeros((0, count, 6)) if camera_modes is None else camera_modes
    shifts = as_readonly_array(shifts, ("m", count, 6), "camera_modes")[:, observed]
    if not np.isfinite(shifts).all():
        raise ValueError("expected finite camera_modes, got NaN or infinity")
    poses = [flanges[index] for index in observed]
    observations = BoardObservations(
        np.array([boards[index].rotation for index in observed]),
        np.array([boards[index].translation for index in observed]),
        _board_covariances(covariances, count)[observed],
        stack_flange_poses(poses, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        np.zeros(len(observed), dtype=np.int64),
    )
    fit = solve_hand_eye(observations, poses, observed, MIN_BOARD_INLIERS, settings)
    board = fit.states.targets[0, 0]
    target = Pose(board[3:].reshape(3, 3), board[:3])
    working_point = observations.origins.mean(axis=0)
    context = ResultContext(observed, unobserved, working_point, mounting, "camera", settings)
    hand_eye = build_hand_eye(observations, fit, target, context)
    return _with_camera_and_board_errors(hand_eye, fit, observations, shifts, settings)


def _board_covariances(covariances: npt.ArrayLike | None, count: int) -> FloatArray:
    """Return the covariances (n, 6, 6) of `count` boards, nearly zero if none are given."""
    if covariances is None:
        return np.tile(EXACT_BOARD_VARIANCE * np.eye(6), (count, 1, 1))
    checked = as_readonly_array(covariances, (count, 6, 6), "covariances")
    for covariance in checked:
        check_covariance(covariance)
    return checked


def _with_camera_and_board_errors(
    hand_eye: HandEye,
    fit: ErrorsInVariablesFit,
    observations: BoardObservations,
    camera_modes: FloatArray,
    settings: HandEyeSettings,
) -> HandEye:
    """Return the calibration with the board's scale.

    Its covariance includes the errors of the camera, and of a board whose size was stated wrong.
    """
    residuals = observations.linearise(fit.states).residuals[0]
    scale = estimate_board_scale(
        fit,
        observations.origins - residuals[:, :3],
        camera_modes,
        robot_is_stated=settings.robot_std is not None,
    )
    errors = fit.propagate_shifts(camera_modes)[:, :6]
    if scale is not None:
        scale.require_plausible()
        if scale.significant:
            errors = np.concatenate([errors, scale.step[None]])
    return replace(
        hand_eye,
        covariance=hand_eye.covariance + errors.T @ errors,
        target_scale=None if scale is None else (scale.factor, scale.std),
    )


def _covariances(shapes: Sequence[SphereArc] | Sequence[PlaneLine]) -> FloatArray:
    """Return the covariances of arcs or lines, scaled by the mean autocorrelation time."""
    autocorrelation_time = float(np.mean([shape.autocorrelation_time for shape in shapes]))
    return autocorrelation_time * np.array([shape.covariance for shape in shapes])


def _common_height_scale_gradients(arcs: Sequence[SphereArc]) -> FloatArray:
    """Return the height-scale gradients (n, 2, 3), in mm, about the mean height of all circles."""
    gradients = np.array([arc.height_scale_gradient for arc in arcs])
    heights = np.array([arc.circle[1] for arc in arcs])
    gradients[:, 0, 1] += heights - heights.mean()
    return gradients
