"""``lsvision calibrate hand-eye``: pose of a sensor on the robot, from three kinds of target."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.calibrate_inputs import add_file_names_to_errors, find_image_files
from lsvision.cli.hand_eye_boards import find_boards
from lsvision.cli.hand_eye_command import (
    HandEyeOptions,
    HandEyeResultOptions,
    PosePlanOptions,
    calibrate_from_profiles,
    report_hand_eye,
)
from lsvision.cli.option_groups import build_command_group, expand_option_groups
from lsvision.cli.profile_options import ReadingOptions
from lsvision.cli.robot_options import RobotOptions, parse_convention, parse_pose_file
from lsvision.cli.target_options import TargetOptions
from lsvision.files.printable import escape_text

hand_eye = build_command_group(
    "hand-eye", "Pose of the sensor on the robot, from a sphere, a plane or a board."
)

Profiles = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE|DIR|GLOB", help="Profiles, one per pose, in the order of the poses."
    ),
]


@hand_eye.command()
@expand_option_groups
def sphere(
    *,
    profiles: Profiles,
    options: HandEyeOptions,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Radius of the sphere; without it, it is estimated: compare both."
        ),
    ] = None,
    plan: PosePlanOptions,
    reading: ReadingOptions,
) -> None:
    """Calibrate a profile sensor to the robot on a sphere; the best target for most.

    Take twelve poses: tilts of up to 35 deg about both axes, all rotations about the viewing
    direction, the sphere at the left and right and at near and far ranges, and the laser plane 0.3
    to 0.85 radii beside its centre on both sides.

    \b
    The shipped example:
      lsvision calibrate hand-eye sphere calibration/example/sphere --radius 20 \\
        --poses calibration/example/sphere_poses.csv --convention kuka --out hand_eye.json
    The next poses to measure:
      lsvision calibrate hand-eye sphere ... --out hand_eye.json --plan-poses 6 --plan-out next.csv
    """  # noqa: D301 - the backspace makes click keep the line breaks
    if radius is not None and not (math.isfinite(radius) and radius > 0):
        raise typer.BadParameter(f"expected --radius above 0 mm, got {radius:g}")
    from lsvision.calibration.hand_eye import calibrate_hand_eye_sphere

    calibration = partial(calibrate_hand_eye_sphere, radius=radius)
    calibrate_from_profiles(calibration, profiles, options, plan, reading)


@hand_eye.command()
@expand_option_groups
def plane(
    *, profiles: Profiles, options: HandEyeOptions, plan: PosePlanOptions, reading: ReadingOptions
) -> None:
    """Calibrate a profile sensor to the robot on a flat plate.

    Take twenty poses, tilted by ± 40 deg about two axes, at near and far ranges. The rotation is
    more accurate than with a sphere, but a point in the measuring range 2 to 3 times less accurate.

    \b
      lsvision calibrate hand-eye plane plate/ --poses poses.csv --convention ur --out hand_eye.json
    Eight poses by hand, and the next poses to measure; then once more with all of them:
      lsvision calibrate hand-eye plane plate/ --poses poses.csv --convention ur \\
        --out hand_eye.json --plan-poses 6 --plan-out next.csv
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.calibration.hand_eye import calibrate_hand_eye_plane

    calibrate_from_profiles(calibrate_hand_eye_plane, profiles, options, plan, reading)


@hand_eye.command()
@expand_option_groups
def board(
    *,
    images: Annotated[
        list[str],
        typer.Argument(metavar="FILE|DIR|GLOB", help="Images of the board, one per pose."),
    ],
    camera: Annotated[Path, typer.Option(metavar="F", help="From calibrate camera.")],
    options: HandEyeOptions,
    target_options: TargetOptions,
) -> None:
    """Calibrate a camera to the robot on a board.

    Gives flange_from_camera, or base_from_camera with --mounting eye-to-hand.

    \b
      lsvision calibrate hand-eye board shots/ --camera camera.json --poses poses.csv \\
        --convention fanuc --out hand_eye.json
    """  # noqa: D301 - the backspace makes click keep the line breaks
    target = target_options.parse()
    files = find_image_files(images)
    from lsvision.io.robot_poses import find_pose_files

    inputs = [*find_pose_files(options.poses), camera, *files]
    options.check_files(inputs)
    from lsvision.calibration.hand_eye import calibrate_hand_eye_board

    names = [escape_text(file.name) for file in files]
    flanges = options.read_flanges("image", names)
    boards = find_boards(files, target, camera)
    names, flanges = [names[k] for k in boards.indices], [flanges[k] for k in boards.indices]
    with add_file_names_to_errors(pose=names):
        boards = boards.number_from_one_end(target, flanges, options.placement)
        calibration = calibrate_hand_eye_board(
            boards.poses,
            flanges,
            covariances=boards.covariances,
            camera_modes=boards.camera_modes,
            mounting=options.placement,
            settings=options.settings,
        )
    report_hand_eye(
        calibration,
        flanges,
        names,
        options,
        inputs,
        boards.build_report_data(calibration, flanges, names),
    )


@hand_eye.command("poses")
@expand_option_groups
def target_poses(
    *,
    samples: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Samples of MoveIt or easy_handeye; with --poses: poses of the target alone.",
        ),
    ],
    options: HandEyeResultOptions,
    poses: Annotated[
        Path | None,
        typer.Option(metavar="F", help="Poses of the flange, if they are in another file."),
    ] = None,
    convention: Annotated[
        str | None, typer.Option(metavar="NAME", help="Convention of --poses; see sphere.")
    ] = None,
    target_convention: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Convention of FILE if --poses is given [that of --convention]."
        ),
    ] = None,
) -> None:
    """Calibrate a camera to the robot from poses of a target that were found elsewhere.

    Each sample is the pose of the target before the camera, and that of the flange. All errors
    are attributed to the robot, since the file does not hold those of the target's poses.

    \b
    Samples as MoveIt or easy_handeye store them:
      lsvision calibrate hand-eye poses samples.yaml --out hand_eye.json
    Two files of poses, one per row:
      lsvision calibrate hand-eye poses targets.csv --target-convention matrix \\
        --poses flanges.csv --convention kuka --out hand_eye.json
    """  # noqa: D301 - the backspace makes click keep the line breaks
    pose_file = parse_pose_file(RobotOptions(poses=poses, convention=convention))
    if pose_file is None and target_convention is not None:
        raise typer.BadParameter("expected --poses with --target-convention, got none")
    from lsvision.io.robot_poses import find_pose_files, read_robot_poses

    inputs = [samples]
    if pose_file is not None:
        inputs = [*find_pose_files(samples), *find_pose_files(pose_file.path)]
    options.check_files(inputs)
    from lsvision.calibration.hand_eye import calibrate_hand_eye_board

    if pose_file is None:
        from lsvision.io.hand_eye_file import read_hand_eye_samples

        flanges, targets = read_hand_eye_samples(samples, options.placement)
    else:
        target_convention = target_convention or pose_file.convention
        parse_convention(target_convention, "--target-convention")
        targets = read_robot_poses(samples, target_convention)
        flanges = pose_file.read(len(targets), "pose of the target")
    options = replace(options, frame_convention=options.frame_convention or convention)
    names = [f"sample {number}" for number in range(len(targets))]
    calibration = calibrate_hand_eye_board(
        targets, flanges, mounting=options.placement, settings=options.settings
    )
    report_hand_eye(calibration, flanges, names, options, inputs)
