"""A sensor-to-robot calibration from its options to its files and its printed table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from lsvision.calibration.result_tables import hand_eye_rows
from lsvision.cli.calibrate_inputs import (
    profile_files,
    read_flanges,
    read_images,
    read_named_profiles,
)
from lsvision.cli.calibrate_tables import aligned, plan_rows, pose_rows, value_lines
from lsvision.cli.messages import print_lines
from lsvision.cli.outputs import check_outputs

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
    from lsvision.calibration.pose_planning import PosePlan
    from lsvision.calibration.target import Target
    from lsvision.geometry import FloatArray, Pose
    from lsvision.io.profiles import ReadOptions
    from lsvision.profile import Profile

FRAMES = "tool0:sensor"
"""Names of the frames in an easy_handeye file."""


@dataclass(frozen=True, kw_only=True)
class HandEyeOptions:
    """Options that all targets share."""

    poses: Path
    convention: str
    mounting: 'Literal["eye_in_hand", "eye_to_hand"]'
    settings: "HandEyeSettings"
    out: Path
    easy_handeye: Path | None
    frames: tuple[str, str]
    report: Path | None


def parse_hand_eye_options(
    poses: Path,
    convention: str,
    mounting: str,
    robot_std: str | None,
    out: Path,
    extras: tuple[Path | None, str, Path | None],
) -> HandEyeOptions:
    """The options that all targets share, checked.

    Parameters
    ----------
    poses, convention, mounting, robot_std, out
        As typed.
    extras : tuple
        ``--easy-handeye``, ``--frames`` and ``--report``.

    Raises
    ------
    typer.BadParameter
        For a mounting, sigma or frames that are none.
    """
    from lsvision.calibration.hand_eye_result import HandEyeSettings

    easy_handeye, frames, report = extras
    robot, _, sensor = frames.partition(":")
    if not (robot and sensor):
        raise typer.BadParameter(f"want --frames ROBOT:SENSOR, as {FRAMES}, got {frames!r}")
    if mounting not in ("eye-in-hand", "eye-to-hand"):
        raise typer.BadParameter(f"want --mounting eye-in-hand or eye-to-hand, got {mounting!r}")
    return HandEyeOptions(
        poses=poses,
        convention=convention,
        mounting="eye_in_hand" if mounting == "eye-in-hand" else "eye_to_hand",
        settings=HandEyeSettings(robot_std=_robot_std(robot_std)),
        out=out,
        easy_handeye=easy_handeye,
        frames=(robot, sensor),
        report=report,
    )


def _robot_std(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        position, rotation = (float(part) for part in text.split(":"))
    except ValueError:
        position = rotation = 0.0
    if not (0 < position < math.inf and 0 < rotation < math.inf):
        raise typer.BadParameter(f"want --robot-std MM:DEG above 0, as 0.05:0.01, got {text!r}")
    return position, math.radians(rotation)


def check_files(job: HandEyeOptions, inputs: Sequence[Path], *more: Path | None) -> None:
    """Refuse outputs that could not be written; see `check_outputs`."""
    check_outputs((job.out, job.easy_handeye, job.report, *more), [job.poses, *inputs])


@dataclass(frozen=True)
class TargetProfiles:
    """Profiles of a target with the files they are from, a name and a flange pose for each."""

    files: list[Path]
    profiles: "list[Profile]"
    names: list[str]
    flanges: "list[Pose]"


def read_target_profiles(
    job: HandEyeOptions, words: Sequence[str], reading: "ReadOptions", *more: Path | None
) -> TargetProfiles:
    """What the words of a command name, once its outputs (and `more` of them) can be written.

    Raises
    ------
    LsvisionError
        Names the file and the mend.
    """
    files = profile_files(words, reading.get("dx"))
    check_files(job, files, *more)
    profiles, names = read_named_profiles(files, reading)
    return TargetProfiles(files, profiles, names, read_flanges(job.poses, job.convention, names))


def estimate_board_poses(
    files: Sequence[Path], target: "Target", camera_file: Path
) -> "tuple[list[Pose], list[FloatArray]]":
    """The board before the camera in each image, with covariances (6, 6); all must show it.

    Raises
    ------
    LsvisionError
        Names the image that does not.
    """
    from lsvision.calibration.board_pose import estimate_board_pose
    from lsvision.calibration.target import find_target
    from lsvision.calibration.views import require_size
    from lsvision.errors import LsvisionError
    from lsvision.io.camera_file import read_camera

    camera = read_camera(camera_file)
    poses, covariances = [], []
    for file, image in zip(files, read_images(files), strict=True):
        require_size(camera, image, str(file))
        try:
            seen = find_target(image, target)
            sighting = estimate_board_pose(seen.pixels, seen.points, camera)
        except LsvisionError as error:
            raise LsvisionError(f"{file}: {error}; or leave out this image and its pose") from error
        poses.append(sighting.camera_from_board)
        covariances.append(sighting.covariance)
    return poses, covariances


def report_hand_eye(
    found: "HandEye", flanges: "Sequence[Pose]", names: Sequence[str], job: HandEyeOptions,
    inputs: Sequence[Path],
) -> None:  # fmt: skip
    """Write the files and print the result."""
    from lsvision.io.calibration import provenance_of
    from lsvision.io.hand_eye_file import export_easy_handeye, save_hand_eye
    from lsvision.io.robot_poses import pose_files

    rows = hand_eye_rows(found)
    doubts = [f"left out: {names[pose.index]}: {pose.reason}" for pose in found.rejected]
    doubts += [f"warning: {text}" for text in found.warnings]
    believed = len(names) - len(found.rejected)
    method = f"{type(found.target).__name__.lower()}, {job.mounting}, {job.convention} poses"
    provenance = provenance_of(method, dict.fromkeys([*pose_files(job.poses), *inputs]))
    if job.report is not None:
        from lsvision.draw.calibration_report import ReportContent, hand_eye_page
        from lsvision.files.atomic_files import write_atomic

        page = ReportContent(rows, doubts, names, provenance)
        write_atomic(job.report, hand_eye_page(found, flanges, page))
    save_hand_eye(found, job.out, provenance)
    if job.easy_handeye is not None:
        robot, sensor = job.frames
        export_easy_handeye(found, job.easy_handeye, robot_frame=robot, sensor_frame=sensor)
    head = f"{job.out}: sensor to robot from {believed} of {len(names)} poses"
    table = aligned([("pose", "residual mm", "held out mm", ""), *pose_rows(found, names)])
    print_lines([head, *value_lines(rows), "", *table, *doubts])


def check_plan(job: HandEyeOptions, count: int, out: Path | None) -> None:
    """Refuse a plan that cannot be made or was not asked for.

    Raises
    ------
    typer.BadParameter
        ``--plan-poses`` for a sensor that stands still, ``--plan-out`` alone.
    """
    if count and job.mounting == "eye_to_hand":
        raise typer.BadParameter("want --plan-poses with --mounting eye-in-hand only")
    if out is not None and not count:
        raise typer.BadParameter("want --plan-poses N beside --plan-out")


def plan_next_poses(found: "HandEye", flanges: "Sequence[Pose]", count: int) -> "PosePlan":
    """The next best poses before the sphere or plate that was found."""
    from lsvision.calibration import pose_planning as planning
    from lsvision.geometry import Plane

    left_out = {pose.index for pose in found.rejected}
    believed = [pose for index, pose in enumerate(flanges) if index not in left_out]
    mount = found.mount_from_sensor
    settings = replace(
        planning.PLANE_DEFAULTS if isinstance(found.target, Plane) else planning.SPHERE_DEFAULTS,
        count=count,
        standoff=float(found.working_point[1]),
        robot_std=found.robot_std,
        candidates=max(150, 10 * count),
    )
    if isinstance(found.target, Plane):
        seen_at = [(pose @ mount).apply_one(found.working_point) for pose in believed]
        middle = sum(seen_at) / len(seen_at)
        return planning.plan_hand_eye_poses_plane(
            mount, found.target, middle, measured=believed, settings=settings
        )
    ball = found.sphere
    return planning.plan_hand_eye_poses(
        mount, ball.centre, ball.radius, measured=believed, settings=settings
    )


def report_pose_plan(plan: "PosePlan", out: Path | None) -> None:
    """Print the next best poses, and write them as 4x4 rows."""
    from lsvision.files.atomic_files import write_atomic

    head = ("next pose", "x mm", "y mm", "z mm", "predicted mm")
    typer.echo("\n".join(["", *aligned([head, *plan_rows(plan)])]))
    if out is not None:
        rows = [
            ",".join(f"{value:.6f}" for value in pose.matrix.flat)
            for pose in plan.base_from_flanges
        ]
        write_atomic(out, "\n".join(rows) + "\n")
        typer.echo(f"{out}: base_from_flange as 4x4 rows, best first; check each for collisions")
