"""``lsvision calibrate hand-eye``: where a sensor sits on the robot, from three targets."""

import math
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.calibrate_inputs import Report, image_files, prefix_file_names, read_flanges
from lsvision.cli.hand_eye_command import (
    FRAMES,
    check_files,
    check_plan,
    estimate_board_poses,
    parse_hand_eye_options,
    plan_next_poses,
    read_target_profiles,
    report_hand_eye,
    report_pose_plan,
)
from lsvision.cli.measure_options import parse_read_options
from lsvision.cli.profile_options import (
    Columns,
    CountUnit,
    FileFormat,
    FirstX,
    Flip,
    Lost,
    Spacing,
    Topic,
    Transpose,
    Units,
)
from lsvision.cli.target_options import (
    Counts,
    Dictionary,
    Marker,
    Square,
    TargetName,
    parse_target,
)
from lsvision.files.printable import printable

hand_eye = typer.Typer(
    name="hand-eye",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Where the sensor sits on the robot: from a sphere, a plane or a board.",
)

Profiles = Annotated[
    list[str],
    typer.Argument(metavar="FILE|DIR|GLOB", help="Profiles, one a pose, in the poses' order."),
]
Poses = Annotated[
    Path, typer.Option(metavar="F", help="Poses of the flange: CSV, text, JSON or YAML.")
]
Convention = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="How the poses are written, never guessed: ur, kuka, fanuc, yaskawa, mitsubishi, "
        "kawasaki, staubli, abb, ros, matrix.",
    ),
]
Out = Annotated[
    Path, typer.Option("--out", "-o", metavar="F.json", help="The calibration, for scan.")
]
MountingOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="eye-in-hand: sensor on the flange, target fixed; eye-to-hand: the other way round.",
    ),
]
RobotStd = Annotated[
    str | None,
    typer.Option(
        metavar="MM:DEG", help="One sigma of the robot's pose per axis; else from residuals."
    ),
]
PlanPoses = Annotated[int, typer.Option(min=0, metavar="N", help="Propose the N next best poses.")]
PlanOut = Annotated[
    Path | None,
    typer.Option(metavar="F.csv", help="Write them as 4x4 rows (--convention matrix)."),
]
EasyHandeye = Annotated[
    Path | None, typer.Option(metavar="F.yaml", help="Also write it as ROS easy_handeye reads it.")
]
Frames = Annotated[
    str,
    typer.Option(metavar="ROBOT:SENSOR", help="Names of the frames in that file."),
]


@hand_eye.command()
def sphere(
    profiles: Profiles,
    poses: Poses,
    convention: Convention,
    out: Out,
    radius: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Of the sphere; found too if not given, as a check."),
    ] = None,
    mounting: MountingOption = "eye-in-hand",
    robot_std: RobotStd = None,
    plan_poses: PlanPoses = 0,
    plan_out: PlanOut = None,
    easy_handeye: EasyHandeye = None,
    frames: Frames = FRAMES,
    report: Report = None,
    file_format: FileFormat = None,
    columns: Columns = None,
    units: Units = None,
    flip: Flip = None,
    lost: Lost = None,
    transpose: Transpose = False,
    x0: FirstX = None,
    dx: Spacing = None,
    z_unit: CountUnit = None,
    topic: Topic = None,
) -> None:
    """Calibrate a profile sensor to the robot on a sphere; the best target for most.

    Twelve poses: tilts of up to 35 deg about both axes, turned all around, the sphere left and
    right, near and far, and cut 0.3 to 0.85 radii beside its centre on both sides.

    \b
    The shipped example:
      lsvision calibrate hand-eye sphere calibration/example/sphere --radius 20 \\
        --poses calibration/example/sphere_poses.csv --convention kuka --out hand_eye.json
    Where to drive next:
      lsvision calibrate hand-eye sphere ... --out hand_eye.json --plan-poses 6 --plan-out next.csv
    """  # noqa: D301 - the backspace tells click to leave the lines as they are
    job = parse_hand_eye_options(
        poses, convention, mounting, robot_std, out, (easy_handeye, frames, report)
    )
    if radius is not None and not (math.isfinite(radius) and radius > 0):
        raise typer.BadParameter(f"want --radius above 0 mm, got {radius:g}")
    check_plan(job, plan_poses, plan_out)
    reading = parse_read_options(
        format=file_format, columns=columns, units=units, flip=flip, lost=lost,
        transpose=transpose, x0=x0, dx=dx, z_unit=z_unit, topic=topic,
    )  # fmt: skip
    seen = read_target_profiles(job, profiles, reading, plan_out)
    from lsvision.calibration.hand_eye import calibrate_hand_eye_sphere

    with prefix_file_names(pose=seen.names):
        found = calibrate_hand_eye_sphere(
            seen.profiles, seen.flanges, radius, mounting=job.mounting, settings=job.settings
        )
        plan = plan_next_poses(found, seen.flanges, plan_poses) if plan_poses else None
    report_hand_eye(found, seen.flanges, seen.names, job, seen.files)
    if plan is not None:
        report_pose_plan(plan, plan_out)


@hand_eye.command()
def plane(
    profiles: Profiles,
    poses: Poses,
    convention: Convention,
    out: Out,
    mounting: MountingOption = "eye-in-hand",
    robot_std: RobotStd = None,
    plan_poses: PlanPoses = 0,
    plan_out: PlanOut = None,
    easy_handeye: EasyHandeye = None,
    frames: Frames = FRAMES,
    report: Report = None,
    file_format: FileFormat = None,
    columns: Columns = None,
    units: Units = None,
    flip: Flip = None,
    lost: Lost = None,
    transpose: Transpose = False,
    x0: FirstX = None,
    dx: Spacing = None,
    z_unit: CountUnit = None,
    topic: Topic = None,
) -> None:
    """Calibrate a profile sensor to the robot on a flat plate.

    Twenty poses, tilted by 40 deg both ways about two axes, at near and far ranges. Better than
    a sphere in rotation, about three times worse where it measures.

    \b
      lsvision calibrate hand-eye plane plate/ --poses poses.csv --convention ur --out hand_eye.json
    Eight poses by hand, and where to drive next; then once more with all of them:
      lsvision calibrate hand-eye plane plate/ --poses poses.csv --convention ur \\
        --out hand_eye.json --plan-poses 6 --plan-out next.csv
    """  # noqa: D301 - the backspace tells click to leave the lines as they are
    job = parse_hand_eye_options(
        poses, convention, mounting, robot_std, out, (easy_handeye, frames, report)
    )
    check_plan(job, plan_poses, plan_out)
    reading = parse_read_options(
        format=file_format, columns=columns, units=units, flip=flip, lost=lost,
        transpose=transpose, x0=x0, dx=dx, z_unit=z_unit, topic=topic,
    )  # fmt: skip
    seen = read_target_profiles(job, profiles, reading, plan_out)
    from lsvision.calibration.hand_eye import calibrate_hand_eye_plane

    with prefix_file_names(pose=seen.names):
        found = calibrate_hand_eye_plane(
            seen.profiles, seen.flanges, mounting=job.mounting, settings=job.settings
        )
        plan = plan_next_poses(found, seen.flanges, plan_poses) if plan_poses else None
    report_hand_eye(found, seen.flanges, seen.names, job, seen.files)
    if plan is not None:
        report_pose_plan(plan, plan_out)


@hand_eye.command()
def board(
    images: Annotated[
        list[str],
        typer.Argument(metavar="FILE|DIR|GLOB", help="Images of the board, one a pose."),
    ],
    camera: Annotated[Path, typer.Option(metavar="F", help="From calibrate camera.")],
    poses: Poses,
    convention: Convention,
    out: Out,
    target_name: TargetName = "charuco",
    counts: Counts = None,
    square: Square = None,
    marker: Marker = None,
    dictionary: Dictionary = "DICT_4X4_100",
    mounting: MountingOption = "eye-in-hand",
    robot_std: RobotStd = None,
    easy_handeye: EasyHandeye = None,
    frames: Frames = FRAMES,
    report: Report = None,
) -> None:
    """Calibrate a camera to the robot on a board; gives flange_from_camera.

    \b
      lsvision calibrate hand-eye board shots/ --camera camera.json --poses poses.csv \\
        --convention fanuc --out hand_eye.json
    """  # noqa: D301 - the backspace tells click to leave the lines as they are
    job = parse_hand_eye_options(
        poses, convention, mounting, robot_std, out, (easy_handeye, frames, report)
    )
    pattern = parse_target(target_name, counts, square, marker, dictionary)
    files = image_files(images)
    check_files(job, [*files, camera])
    from lsvision.calibration.hand_eye import calibrate_hand_eye_board

    names = [printable(file.name) for file in files]
    flanges = read_flanges(poses, convention, names)
    boards, covariances = estimate_board_poses(files, pattern, camera)
    with prefix_file_names(pose=names):
        found = calibrate_hand_eye_board(
            boards, flanges, covariances=covariances, mounting=job.mounting, settings=job.settings
        )
    report_hand_eye(found, flanges, names, job, [camera, *files])
