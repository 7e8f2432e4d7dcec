"""Sensor-to-robot calibration on a sphere, a plane or a board.

No guess is asked for. What each pose shows is reduced to a few numbers with a covariance;
many starts and random selections of poses find the answer and the poses that are wrong; the
solution treats the robot's poses as noisy (`errors_in_variables`) and carries an honest covariance.
Data that cannot determine the answer are refused with the motion that is missing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_observations import BoardObservations
from lsvision.calibration.errors_in_variables import NOMINAL_ROBOT_STD
from lsvision.calibration.flange_poses import Mounting, stack_flange_poses
from lsvision.calibration.hand_eye_result import HandEye, RejectedPose, Sphere
from lsvision.calibration.hand_eye_solver import (
    HandEyeSettings,
    ResultContext,
    build_hand_eye,
    solve_hand_eye,
)
from lsvision.calibration.plane_line import PlaneLine, find_plane_line
from lsvision.calibration.plane_observations import PlaneObservations
from lsvision.calibration.sphere_arc import SphereArc, find_sphere_arc
from lsvision.calibration.sphere_observations import SphereObservations
from lsvision.errors import CalibrationFailed, DegenerateGeometry, TooFewPoints
from lsvision.geometry import FloatArray, Plane, Pose, as_readonly_array
from lsvision.profile import Profile

EXACT_RADIUS_STD = 1e-4
"""One sigma of a radius that is given. Units: mm."""
MIN_OFFSET = 0.15
"""Least root mean square distance of the cuts from the sphere's centre, in radii."""
MIN_SPREAD = 0.05
"""Least spread of the sphere's places in the view, in radii."""


DEFAULT = HandEyeSettings()


def calibrate_hand_eye_sphere(
    profiles: Sequence[Profile],
    base_from_flanges: Sequence[Pose],
    radius: float | None = None,
    *,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT,
) -> HandEye:
    """Profile sensor to robot, by profiles of one fixed sphere.

    Take 12 poses: tilts of up to 35 deg about both axes, spins all around, the sphere left and
    right, near and far in the view, and cut 0.3 to 0.85 radii away from its centre, on both
    sides. Cuts through the centre say nothing of the direction across the laser plane.

    Parameters
    ----------
    profiles : sequence of Profile
        One a pose; the sphere is found among other things, and its flanks are left out.
    base_from_flanges : sequence of Pose
        Where the flange stood.
    radius : float, optional
        Of the sphere, where it is to be believed; free otherwise, at little cost and as a
        check. Units: mm.
    mounting : {"eye_in_hand", "eye_to_hand"}
        Sensor on the flange and sphere fixed, or sensor fixed and sphere on the flange.
    settings : HandEyeSettings
        See there.

    Returns
    -------
    HandEye
        `flange_from_section` (or `base_from_section`), covariance, residuals, rejected poses,
        and `height_scale`, which tells a sensor whose heights are too long or too short.

    Raises
    ------
    ValueError
        Profiles and poses of different number, a radius that is not positive.
    CalibrationFailed
        Too few poses with a sphere, poses that do not belong to the profiles, a sphere that
        moved.
    DegenerateGeometry
        Poses that leave a direction free; the missing motion is named.

    Examples
    --------
    >>> from lsvision.simulate.hand_eye import SectionView, TargetMotion
    >>> from lsvision.simulate.hand_eye import section_poses_about, sphere_profile
    >>> rng, ball = np.random.default_rng(0), np.array([800.0, 0.0, 300.0])
    >>> sections = section_poses_about(ball, 12, TargetMotion(standoff=-150.0), rng)
    >>> mount = Pose(translation=(0.0, 80.0, 120.0))
    >>> seen = [pose.inverse().apply_one(ball) for pose in sections]
    >>> profiles = [sphere_profile(centre, 20.0, SectionView(), rng) for centre in seen]
    >>> flanges = [pose @ mount.inverse() for pose in sections]
    >>> found = calibrate_hand_eye_sphere(profiles, flanges)
    >>> found.flange_from_section.translation.round(0) + 0.0
    array([  0.,  80., 120.])
    >>> found.rejected, found.working_point_std < 0.02
    ((), True)
    """
    _require_pairs(len(profiles), len(base_from_flanges), "profiles")
    if radius is not None and not radius > 0:
        raise ValueError(f"want a positive radius in mm, got {radius}")
    arcs, lost = {}, []
    for index, profile in enumerate(profiles):
        try:
            arcs[index] = find_sphere_arc(profile, radius, settings.arc)
        except TooFewPoints as error:
            lost.append(RejectedPose(index, f"no sphere found: {error}"))
    seen = sorted(arcs)
    need = 5 if radius is not None else 6
    _require_count(len(seen), need, "a sphere in its profile", lost)
    poses = [base_from_flanges[index] for index in seen]
    largest = max(float(arcs[index].circle[2]) for index in seen)
    sightings = SphereObservations(
        np.array([arcs[index].circle for index in seen]),
        _covariances([arcs[index] for index in seen]),
        _common_height_scale_gradients([arcs[index] for index in seen]),
        stack_flange_poses(poses, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        (largest, np.inf) if radius is None else (radius, EXACT_RADIUS_STD),
        np.zeros(len(seen), dtype=np.int64),
    )
    _require_distinct_cuts(sightings.circles, radius)
    doubted = solve_hand_eye(sightings, poses, need, settings)
    state = doubted.fit.states
    radius_std, height_std = np.sqrt(np.diag(doubted.fit.covariance)[9:11]).tolist()
    *centre, found, stretch = state.targets[0, 0].tolist()
    target = Sphere(np.array(centre), found, radius_std if radius is None else 0.0)
    working = np.append(sightings.circles[:, :2].mean(axis=0), 0.0)
    story = ResultContext(seen, lost, working, mounting, "section", settings)
    result = build_hand_eye(sightings, doubted, target, story)
    return replace(result, height_scale=(1 + stretch, height_std))


def calibrate_hand_eye_plane(
    profiles: Sequence[Profile],
    base_from_flanges: Sequence[Pose],
    *,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT,
) -> HandEye:
    """Profile sensor to robot, by profiles of one fixed plane.

    Better than a sphere in rotation, about three times worse at the working point: take 20
    poses, tilted by 40 deg both ways about two axes, at near and far ranges.

    Parameters
    ----------
    profiles : sequence of Profile
        One a pose; the longest straight line in each is taken.
    base_from_flanges : sequence of Pose
        Where the flange stood.
    mounting, settings
        As in `calibrate_hand_eye_sphere`.

    Returns
    -------
    HandEye
        `target` is the plane.

    Raises
    ------
    ValueError, CalibrationFailed, DegenerateGeometry
        As in `calibrate_hand_eye_sphere`.
    """
    _require_pairs(len(profiles), len(base_from_flanges), "profiles")
    lines, lost = {}, []
    for index, profile in enumerate(profiles):
        try:
            lines[index] = find_plane_line(profile)
        except TooFewPoints as error:
            lost.append(RejectedPose(index, f"no line found: {error}"))
    seen = sorted(lines)
    _require_count(len(seen), 8, "a straight line in its profile", lost)
    poses = [base_from_flanges[index] for index in seen]
    sightings = PlaneObservations(
        np.array([lines[index].midpoint for index in seen]),
        np.array([lines[index].direction for index in seen]),
        np.array([lines[index].half_length for index in seen]),
        _covariances([lines[index] for index in seen]),
        stack_flange_poses(poses, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        np.zeros(len(seen), dtype=np.int64),
    )
    doubted = solve_hand_eye(sightings, poses, 6, settings)
    normal_distance = doubted.fit.states.targets[0, 0]
    target = Plane(normal_distance[:3], float(normal_distance[3]))
    working = sightings.midpoints.mean(axis=0)
    return build_hand_eye(
        sightings,
        doubted,
        target,
        ResultContext(seen, lost, working, mounting, "section", settings),
    )


def calibrate_hand_eye_board(
    camera_from_boards: Sequence[Pose],
    base_from_flanges: Sequence[Pose],
    *,
    covariances: npt.ArrayLike | None = None,
    mounting: Mounting = "eye_in_hand",
    settings: HandEyeSettings = DEFAULT,
) -> HandEye:
    """Camera to robot, by views of one fixed board (``A X = Z B`` with noisy robot poses).

    Parameters
    ----------
    camera_from_boards : sequence of Pose
        The board in each image; `estimate_board_pose` gives it from corners.
    base_from_flanges : sequence of Pose
        Where the flange stood.
    covariances : (n, 6, 6) array_like, optional
        Of the boards' origins (mm) and left-hand rotations (rad), from
        `estimate_board_pose`. Without them all errors are put down to the robot.
    mounting, settings
        As in `calibrate_hand_eye_sphere`.

    Returns
    -------
    HandEye
        `flange_from_camera`; `target` is ``base_from_board``.

    Raises
    ------
    ValueError, CalibrationFailed, DegenerateGeometry
        As in `calibrate_hand_eye_sphere`.
    """
    count = len(camera_from_boards)
    _require_pairs(count, len(base_from_flanges), "boards")
    _require_count(count, 4, "a board in its image", [])
    given = np.full((count, 6, 6), 1e-12) * np.eye(6) if covariances is None else covariances
    sightings = BoardObservations(
        np.array([pose.rotation for pose in camera_from_boards]),
        np.array([pose.translation for pose in camera_from_boards]),
        as_readonly_array(given, (count, 6, 6), "covariances"),
        stack_flange_poses(base_from_flanges, mounting, settings.robot_std or NOMINAL_ROBOT_STD),
        np.zeros(count, dtype=np.int64),
    )
    doubted = solve_hand_eye(sightings, base_from_flanges, 3, settings)
    board = doubted.fit.states.targets[0, 0]
    target = Pose(board[3:].reshape(3, 3), board[:3])
    working = sightings.origins.mean(axis=0)
    story = ResultContext(list(range(count)), [], working, mounting, "camera", settings)
    return build_hand_eye(sightings, doubted, target, story)


def _covariances(found: Sequence[SphereArc] | Sequence[PlaneLine]) -> FloatArray:
    """Of circles or lines, neighbours erring as much alike as they do over all profiles."""
    likeness = float(np.mean([each.autocorrelation_time for each in found]))
    return likeness * np.array([each.covariance for each in found])


def _common_height_scale_gradients(arcs: Sequence[SphereArc]) -> FloatArray:
    """Changes of the circles with heights that grow about the mean height of all."""
    stretches = np.array([arc.height_scale_gradient for arc in arcs])
    heights = np.array([arc.circle[1] for arc in arcs])
    stretches[:, 0, 1] += heights - heights.mean()
    return stretches


def _require_pairs(sightings: int, poses: int, what: str) -> None:
    if sightings != poses:
        raise ValueError(
            f"want one pose for each of the {what}, got {sightings} {what} and {poses} poses: "
            "a pair is missing, and then all that follow it may be wrong"
        )


def _require_count(got: int, need: int, what: str, lost: list[RejectedPose]) -> None:
    if got < need:
        first = f" (pose {lost[0].index}: {lost[0].reason})" if lost else ""
        raise CalibrationFailed(
            f"{got} poses with {what} and need {need}, better 12: take more{first}"
        )


def _require_distinct_cuts(circles: FloatArray, radius: float | None) -> None:
    """Refuse cuts that are all alike: through the centre, or at one place of the view."""
    largest = radius if radius is not None else float(circles[:, 2].max())
    drop = float(np.sqrt(np.mean(np.clip(1 - (circles[:, 2] / largest) ** 2, 0, None))))
    if drop < MIN_OFFSET:
        raise DegenerateGeometry(
            f"all cuts pass within {drop:.2f} radii of the sphere's centre: the sensor's pose "
            "across its laser plane cannot be found; add poses that cut the sphere 0.3 to 0.85 "
            "radii beside its centre, on both sides"
        )
    spread = float(np.linalg.norm(np.ptp(circles[:, :2], axis=0)))
    if spread < MIN_SPREAD * largest:
        raise DegenerateGeometry(
            f"the sphere always stood at the same place of the profile (to {spread:.2g} mm): "
            "the sensor's rotation hangs on its cuts alone; add poses with the sphere left, "
            "right, near and far in the view"
        )
