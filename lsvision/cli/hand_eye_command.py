"""Hand-eye calibration: options, input files, output files and printed table."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.calibrate_inputs import (
    Report,
    add_file_names_to_errors,
    find_profile_files,
    format_value_lines,
    read_named_profiles,
)
from lsvision.cli.hand_eye_boards import ReportData
from lsvision.cli.messages import print_lines
from lsvision.cli.outputs import check_outputs
from lsvision.cli.profile_options import ReadingOptions
from lsvision.cli.robot_frame import PoseFile
from lsvision.cli.robot_options import parse_convention
from lsvision.results.tables import format_text_table

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye, HandEyeSettings
    from lsvision.calibration.observations import Mounting
    from lsvision.calibration.pose_planning import PosePlan
    from lsvision.geometry import Pose

PLACEMENTS: "dict[str, Mounting]" = {"eye-in-hand": "eye_in_hand", "eye-to-hand": "eye_to_hand"}
"""Name of the mounting in the library for each value of ``--mounting``."""
MIN_CANDIDATE_POSES, CANDIDATES_PER_POSE = 150, 10
"""Smallest number of random poses, and number for each requested one, of which the next best poses
are chosen."""
NO_REPORT_DATA = ReportData()
"""No photos, corners and warnings: for calibrations by profiles or samples."""
DEFAULT_FRAMES = "tool0:sensor"
"""Default names of the frames in an easy_handeye file."""


@dataclass(frozen=True, kw_only=True)
class HandEyeResultOptions:
    """Options of every hand-eye calibration: mounting of the sensor, limits, and outputs.

    Raises
    ------
    typer.BadParameter
        For an unknown mounting, or an invalid sigma, residual or pair of frames.
    """

    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="F.json", help="The calibration, for measure and scan."
        ),
    ]
    mounting: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="eye-in-hand: sensor on the flange, target fixed; eye-to-hand: the other way "
            "round.",
        ),
    ] = "eye-in-hand"
    robot_std: Annotated[
        str | None,
        typer.Option(
            metavar="MM:DEG",
            help="One sigma of the robot's pose per axis; else estimated from the residuals.",
        ),
    ] = None
    max_residual: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Largest residual, rms, that is accepted; else what the noise of robot and sensor "
            "explains.",
        ),
    ] = None
    easy_handeye: Annotated[
        Path | None,
        typer.Option(metavar="F.yaml", help="Also write it in the format of ROS easy_handeye."),
    ] = None
    frame_convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Convention in which the sensor's frame is printed [that of the poses; ros for "
            "samples].",
        ),
    ] = None
    frames: Annotated[
        str,
        typer.Option(metavar="ROBOT:SENSOR", help="Names of the frames in that easy_handeye file."),
    ] = DEFAULT_FRAMES
    report: Report = None

    def __post_init__(self) -> None:
        if not all(self.frame_names):
            raise typer.BadParameter(
                f"expected --frames ROBOT:SENSOR such as {DEFAULT_FRAMES}, got {self.frames!r}"
            )
        if self.frames != DEFAULT_FRAMES and self.easy_handeye is None:
            raise typer.BadParameter("expected --easy-handeye F.yaml with --frames, got none")
        if self.mounting not in PLACEMENTS:
            raise typer.BadParameter(
                f"expected --mounting {' or '.join(PLACEMENTS)}, got {self.mounting!r}"
            )
        if self.frame_convention is not None:
            parse_convention(self.frame_convention, "--frame-convention")
        _parse_robot_std(self.robot_std)
        if self.max_residual is not None and not 0 < self.max_residual < math.inf:
            raise typer.BadParameter(f"expected --max-residual above 0, got {self.max_residual:g}")

    @property
    def frame_names(self) -> tuple[str, str]:
        """Names of the robot's and of the sensor's frame."""
        robot, _, sensor = self.frames.partition(":")
        return robot, sensor

    @property
    def placement(self) -> "Mounting":
        """Mounting in the notation of the library."""
        return PLACEMENTS[self.mounting]

    @property
    def settings(self) -> "HandEyeSettings":
        """Settings of the calibration."""
        from lsvision.calibration.hand_eye_result import HandEyeSettings

        return HandEyeSettings(
            robot_std=_parse_robot_std(self.robot_std), max_residual_rms=self.max_residual
        )

    def check_files(self, inputs: Sequence[Path], *other_outputs: Path | None) -> None:
        """Raise an error if an output cannot be written; see `check_outputs`."""
        outputs = (self.out, self.easy_handeye, self.report, *other_outputs)
        check_outputs(outputs, inputs)


@dataclass(frozen=True, kw_only=True)
class HandEyeOptions(HandEyeResultOptions):
    """Options of a hand-eye calibration with a file of robot poses.

    Raises
    ------
    typer.BadParameter
        As `HandEyeResultOptions`, and for an unknown convention.
    """

    poses: Annotated[
        Path, typer.Option(metavar="F", help="Poses of the flange: CSV, text, JSON or YAML.")
    ]
    convention: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Convention of the poses, never guessed: ur, kuka, fanuc, yaskawa, mitsubishi, "
            "kawasaki, staubli, abb, ros, matrix.",
        ),
    ]

    def __post_init__(self) -> None:
        super().__post_init__()
        parse_convention(self.convention)

    def read_flanges(self, item: str, names: Sequence[str]) -> "list[Pose]":
        """Return ``base_from_flange`` of each named item, a "profile" or an "image".

        Raises
        ------
        UnreadableFile
            If the file cannot be read, or holds another number of poses.
        """
        return PoseFile(self.poses, self.convention).read(len(names), item, names)


@dataclass(frozen=True, kw_only=True)
class PosePlanOptions:
    """Options for the next best poses."""

    plan_poses: Annotated[
        int, typer.Option(min=0, metavar="N", help="Propose the N next best poses.")
    ] = 0
    plan_out: Annotated[
        Path | None,
        typer.Option(metavar="F.csv", help="Write these poses as 4x4 rows (--convention matrix)."),
    ] = None


def _parse_robot_std(text: str | None) -> tuple[float, float] | None:
    """Return the stds of position (mm) and rotation (rad) from ``MM:DEG``; None for None."""
    if text is None:
        return None
    try:
        position, rotation = (float(part) for part in text.split(":"))
    except ValueError:
        position = rotation = 0.0
    if not (1e-6 <= position <= 1000 and 1e-7 <= rotation <= 57):
        raise typer.BadParameter(
            "expected --robot-std MM:DEG above 0, such as 0.05:0.01, from 1e-6 to 1000 mm and 1e-7 "
            f"to 57 deg, got {text!r}"
        )
    return position, math.radians(rotation)


def calibrate_from_profiles(
    calibrate: "Callable[..., HandEye]",
    sources: Sequence[str],
    options: HandEyeOptions,
    plan: PosePlanOptions,
    reading: ReadingOptions,
) -> None:
    """Calibrate a profile sensor to the robot, write the files and print the result.

    `calibrate` is `calibrate_hand_eye_sphere`, with its radius filled in, or
    `calibrate_hand_eye_plane`; `sources` are files, folders and patterns of profiles, one for each
    pose.

    Raises
    ------
    typer.BadParameter
        For options that contradict each other.
    LsvisionError
        If a file cannot be read, or the profiles do not suffice.
    """
    _check_plan(options, plan)
    from lsvision.io.robot_poses import find_pose_files

    read_options = reading.parse()
    files = find_profile_files(sources, reading.dx)
    inputs = [*find_pose_files(options.poses), *files]
    options.check_files(inputs, plan.plan_out)
    profiles, names = read_named_profiles(files, read_options)
    flanges = options.read_flanges("profile", names)
    with add_file_names_to_errors(pose=names):
        hand_eye = calibrate(
            profiles, flanges, mounting=options.placement, settings=options.settings
        )
        planned = _plan_next_poses(hand_eye, flanges, plan.plan_poses) if plan.plan_poses else None
    report_hand_eye(hand_eye, flanges, names, options, inputs)
    if planned is not None:
        _report_pose_plan(planned, plan.plan_out)


def report_hand_eye(
    hand_eye: "HandEye", flanges: "Sequence[Pose]", names: Sequence[str],
    options: HandEyeResultOptions, inputs: Sequence[Path], report_data: ReportData = NO_REPORT_DATA,
) -> None:  # fmt: skip
    """Write the output files of a hand-eye calibration, and print the result.

    `flanges` are ``base_from_flange`` of each observation, `names` their names, `inputs` all files
    that were read, for the provenance.
    """
    from lsvision.calibration.result_tables import format_accuracy_rows
    from lsvision.io.calibration import build_provenance
    from lsvision.io.hand_eye_file import export_easy_handeye
    from lsvision.io.pose_numbers import format_frame_rows

    convention = options.convention if isinstance(options, HandEyeOptions) else None
    frame_convention = options.frame_convention or convention or "ros"
    rows = format_frame_rows(hand_eye, frame_convention) + format_accuracy_rows(hand_eye)
    warnings = [f"left out: {names[pose.index]}: {pose.reason}" for pose in hand_eye.rejected]
    warnings += [f"warning: {text}" for text in (*hand_eye.warnings, *report_data.warnings)]
    used = len(names) - len(hand_eye.rejected)
    origin = "samples" if convention is None else f"{convention} poses"
    method = f"{_find_target_kind(hand_eye)}, {options.mounting}, {origin}"
    provenance = build_provenance(method, dict.fromkeys(inputs))
    if options.report is not None:
        from lsvision.draw.calibration_report import ReportContent, render_hand_eye_page
        from lsvision.files.atomic_files import write_atomic

        page = ReportContent(rows, warnings, names, provenance, report_data.images)
        write_atomic(
            options.report, render_hand_eye_page(hand_eye, flanges, page, report_data.corners)
        )
    hand_eye.save(options.out, provenance)
    if options.easy_handeye is not None:
        robot, sensor = options.frame_names
        export_easy_handeye(hand_eye, options.easy_handeye, robot_frame=robot, sensor_frame=sensor)
    heading = f"{options.out}: sensor to robot from {used} of {len(names)} poses"
    table = format_text_table(
        [("pose", "residual mm", "leave-one-out mm", ""), *_list_pose_rows(hand_eye, names)], left=1
    )
    print_lines([heading, *format_value_lines(rows), "", *table, *warnings])


def _find_target_kind(hand_eye: "HandEye") -> str:
    """Return the kind of the calibration's target: sphere, plane or board."""
    from lsvision.geometry import Pose

    return "board" if isinstance(hand_eye.target, Pose) else type(hand_eye.target).__name__.lower()


def _check_plan(options: HandEyeOptions, plan: PosePlanOptions) -> None:
    """Raise a usage error if poses cannot be planned with these options."""
    if plan.plan_poses and options.placement == "eye_to_hand":
        raise typer.BadParameter(
            "expected --plan-poses with --mounting eye-in-hand, got eye-to-hand"
        )
    if plan.plan_out is not None and not plan.plan_poses:
        raise typer.BadParameter("expected --plan-poses N with --plan-out, got none")


def _plan_next_poses(hand_eye: "HandEye", flanges: "Sequence[Pose]", count: int) -> "PosePlan":
    """Return the poses that improve the calibration most, with the measured sphere or plate."""
    from lsvision.calibration import pose_planning as planning
    from lsvision.geometry import Plane

    left_out = {pose.index for pose in hand_eye.rejected}
    used = [pose for index, pose in enumerate(flanges) if index not in left_out]
    mount = hand_eye.mount_from_sensor
    settings = replace(
        planning.PLANE_DEFAULTS if isinstance(hand_eye.target, Plane) else planning.SPHERE_DEFAULTS,
        count=count,
        working_y=float(hand_eye.working_point[1]),
        robot_std=hand_eye.robot_std,
        candidates=max(MIN_CANDIDATE_POSES, CANDIDATES_PER_POSE * count),
    )
    if isinstance(hand_eye.target, Plane):
        points = [(pose @ mount).apply_one(hand_eye.working_point) for pose in used]
        middle = sum(points) / len(points)  # about the middle of the measured part of the plate
        return planning.plan_hand_eye_poses_plane(
            mount, hand_eye.target, middle, measured=used, settings=settings
        )
    sphere = hand_eye.sphere
    return planning.plan_hand_eye_poses(
        mount, sphere.centre, sphere.radius, measured=used, settings=settings
    )


def _report_pose_plan(plan: "PosePlan", out: Path | None) -> None:
    """Print the planned poses, and write them as 4x4 rows."""
    from lsvision.files.atomic_files import write_atomic

    header = ("next pose", "x mm", "y mm", "z mm", "std after it mm")
    typer.echo("\n".join(["", *format_text_table([header, *_plan_rows(plan)], left=1)]))
    if out is not None:
        rows = [
            ",".join(f"{value:.6f}" for value in pose.matrix.flat)
            for pose in plan.base_from_flanges
        ]
        write_atomic(out, "\n".join(rows) + "\n")
        typer.echo(f"{out}: base_from_flange as 4x4 rows, best first; check each for collisions")


def _list_pose_rows(hand_eye: "HandEye", names: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Return for each pose: name, residual and leave-one-out residual (mm), whether left out."""
    left_out = {pose.index for pose in hand_eye.rejected}
    return [
        (
            name,
            _format_mm(residual),
            _format_mm(leave_one_out),
            "left out" if index in left_out else "",
        )
        for index, (name, residual, leave_one_out) in enumerate(
            zip(names, hand_eye.residuals, hand_eye.leave_one_out_residuals, strict=True)
        )
    ]


def _plan_rows(plan: "PosePlan") -> list[tuple[str, ...]]:
    """Return for each planned pose: number from 1, position, and std predicted after it, in mm.

    The std is that of the target's mean position in the view.
    """
    return [
        (str(number), *(f"{value:.1f}" for value in pose.translation), f"{std:.4f}")
        for number, (pose, std) in enumerate(
            zip(plan.base_from_flanges, plan.predicted_std, strict=True), start=1
        )
    ]


def _format_mm(value: float) -> str:
    """Return a length in mm as text; "-" if the target was not found."""
    return f"{value:.3f}" if math.isfinite(value) else "-"
