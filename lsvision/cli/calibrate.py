"""``lsvision calibrate``: a target to print, the camera, the laser plane, sensor to robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from lsvision.calibration.result_tables import format_camera_rows, format_laser_plane_rows
from lsvision.cli.calibrate_capture import capture
from lsvision.cli.calibrate_hand_eye import hand_eye
from lsvision.cli.calibrate_inputs import (
    LineOptions,
    Report,
    add_file_names_to_errors,
    find_image_files,
    format_value_lines,
    format_warning_lines,
    read_images,
)
from lsvision.cli.messages import print_lines
from lsvision.cli.option_groups import build_command_group, expand_option_groups
from lsvision.cli.outputs import check_outputs
from lsvision.cli.target_options import TargetOptions
from lsvision.errors import UnreadableFile
from lsvision.files.printable import escape_text

calibrate = build_command_group(
    "calibrate", "Camera, laser plane and sensor to robot; each with its uncertainty and a report."
)
calibrate.add_typer(hand_eye)
calibrate.command()(capture)


@calibrate.command()
@expand_option_groups
def target(
    *,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="F.svg|F.pdf", help="The page to print.")
    ],
    target_options: TargetOptions,
) -> None:
    """Draw a calibration target at true scale.

    Print it at 100 % ("actual size"), check the 100 mm bar with a ruler, measure ten squares
    with a caliper and give the true edge as --square later. Glue it onto glass or a thick plate,
    flat: with a bowed board, camera and plane become inaccurate.

    \b
    The default, a ChArUco board of 11 x 8 squares of 15 mm on A4:
      lsvision calibrate target --out board.pdf
    A chessboard of 9 x 6 inner corners:
      lsvision calibrate target --target chessboard --counts 9x6 --square 20 --out board.svg
    """  # noqa: D301 - the backspace makes click keep the line breaks
    if out.suffix.lower() not in (".svg", ".pdf"):
        raise typer.BadParameter(f"expected --out F.svg or F.pdf, got {out.name!r}")
    board = target_options.parse()
    check_outputs((out,), ())
    from lsvision.calibration.target_files import render_target_pdf, render_target_svg
    from lsvision.files.atomic_files import write_atomic

    try:
        page = (
            render_target_svg(board) if out.suffix.lower() == ".svg" else render_target_pdf(board)
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    write_atomic(out, page)
    typer.echo(f"{out}: {board}; print at 100 %, then check the bar of 100 mm with a ruler")


@calibrate.command()
@expand_option_groups
def camera(
    *,
    images: Annotated[
        list[str],
        typer.Argument(metavar="FILE|DIR|GLOB", help="Images of the target, best 15 to 20."),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="F.json", help="The camera.")],
    target_options: TargetOptions,
    radial_terms: Annotated[
        int, typer.Option(metavar="N", min=0, max=3, help="How many of k1, k2, k3 are free.")
    ] = 2,
    tilted: Annotated[
        bool,
        typer.Option(
            "--tilted", help="The image sensor is tilted relative to the lens (Scheimpflug)."
        ),
    ] = False,
    fixed_aspect: Annotated[
        bool, typer.Option("--fixed-aspect", help="fx = fy, as of square pixels.")
    ] = False,
    flat_board: Annotated[
        bool,
        typer.Option(
            "--flat-board", help="The board is flat, e.g. on glass: do not estimate its bow."
        ),
    ] = False,
    ros_yaml: Annotated[
        Path | None,
        typer.Option(metavar="F.yaml", help="Also write the camera as OpenCV and ROS do."),
    ] = None,
    report: Report = None,
) -> None:
    """Calibrate a camera from images of a flat target.

    \b
    The shipped example (the default target):
      lsvision calibrate camera calibration/example/boards --out camera.json
    A chessboard of 9 x 6 inner corners of 25 mm, with a page of pictures:
      lsvision calibrate camera 'shots/*.png' --target chessboard --counts 9x6 --square 25 \\
        --out camera.json --ros-yaml camera.yaml --report camera.html
    """  # noqa: D301 - the backspace makes click keep the line breaks
    board = target_options.parse()
    files = find_image_files(images)
    check_outputs((out, ros_yaml, report), files)
    from lsvision.calibration.intrinsics import CameraSettings, calibrate_camera
    from lsvision.io.calibration import build_provenance, write_calibration
    from lsvision.io.camera_file import write_camera_yaml

    names = [escape_text(file.name) for file in files]
    settings = CameraSettings(
        radial_terms=radial_terms,
        fixed_aspect=fixed_aspect,
        tilted=tilted,
        bent_board=not flat_board,
    )
    with add_file_names_to_errors(image=names):
        photos = read_images(files)
        calibration = calibrate_camera(photos, board, settings)
    rows = format_camera_rows(calibration)
    warnings = format_warning_lines(names, calibration)
    provenance = build_provenance(f"{len(calibration.views)} views of {board}", files)
    if report is not None:
        from lsvision.draw.calibration_report import ReportContent, render_camera_page
        from lsvision.files.atomic_files import write_atomic

        content = ReportContent(rows, warnings, names, provenance, photos)
        write_atomic(report, render_camera_page(calibration, content))
    write_calibration(out, calibration, provenance)
    if ros_yaml is not None:
        write_camera_yaml(ros_yaml, calibration.camera)
    width, height = calibration.camera.size
    source = f"{len(calibration.views)} of {len(files)} images"
    heading = f"{out}: camera of {width} x {height} px from {source}"
    print_lines([heading, *format_value_lines(rows), *warnings])


@calibrate.command("laser-plane")
@expand_option_groups
def laser_plane(
    *,
    boards: Annotated[
        list[str],
        typer.Option(
            metavar="DIR|GLOB", help="Images of the board, evenly lit; best 15, at least 2."
        ),
    ],
    lines: Annotated[
        list[str],
        typer.Option(
            metavar="DIR|GLOB",
            help="The laser line on the unmoved board, in the same order. May be the same images.",
        ),
    ],
    camera_file: Annotated[
        Path,
        typer.Option(
            "--camera", metavar="F", help="From calibrate camera, or OpenCV's or ROS's YAML."
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="F.json", help="The rig: camera and plane.")
    ],
    target_options: TargetOptions,
    line_options: LineOptions,
    details: Annotated[
        Path | None,
        typer.Option(metavar="F.json", help="Also write covariance and residuals of each view."),
    ] = None,
    report: Report = None,
) -> None:
    """Calibrate the plane of a laser line before a camera.

    \b
    The shipped example:
      lsvision calibrate laser-plane --camera camera.json --boards calibration/example/boards \\
        --lines calibration/example/lines --out rig.json --report rig.html
    A green laser in colour images that show board and line at once:
      lsvision calibrate laser-plane --camera camera.json --boards shots --lines shots \\
        --target chessboard --counts 6x8 --square 40 --laser green --out rig.json
    Raw images of a colour camera: of the line, only the pixels of the laser's colour are used:
      lsvision calibrate laser-plane --camera camera.json --boards boards --lines lines \\
        --laser red --bayer RGGB --out rig.json
    """  # noqa: D301 - the backspace makes click keep the line breaks
    board = target_options.parse()
    board_files, line_files = _find_image_pairs(boards, lines)
    files = [camera_file, *board_files, *line_files]
    check_outputs((out, details, report), files)
    from dataclasses import replace

    from lsvision.calibration.laser_plane import LaserPlaneSettings, calibrate_laser_plane
    from lsvision.draw.calibration_report import ReportContent, render_laser_plane_page
    from lsvision.draw.view_photos import combine_photos
    from lsvision.files.atomic_files import write_atomic
    from lsvision.io.calibration import build_provenance, write_calibration
    from lsvision.io.camera_file import read_camera, read_camera_covariance

    settings = LaserPlaneSettings(line=line_options.parse())
    names = [escape_text(file.name) for file in board_files]
    model, covariance = read_camera(camera_file), read_camera_covariance(camera_file)
    board_images, line_images = read_images(board_files), line_options.read(line_files)
    with add_file_names_to_errors(
        image=names, board_image=names, line_image=[escape_text(file.name) for file in line_files]
    ):
        calibration = calibrate_laser_plane(
            model, board, board_images, line_images, settings, covariance
        )
    provenance = build_provenance(
        f"laser line on {board} in {len(calibration.views)} poses", dict.fromkeys(files)
    )
    rows = format_laser_plane_rows(calibration)
    warnings = format_warning_lines(names, calibration)
    if report is not None:
        combined_photos = [
            combine_photos(*pair, line_options.pattern)
            for pair in zip(board_images, line_images, strict=True)
        ]
        content = ReportContent(rows, warnings, names, provenance, combined_photos)
        write_atomic(report, render_laser_plane_page(calibration, board.points, content))
    replace(calibration.light_section, provenance=provenance).save(out)
    if details is not None:
        write_calibration(details, calibration, provenance)
    source = f"{len(calibration.views)} of {len(names)} poses of the board"
    print_lines([f"{out}: laser plane from {source}", *format_value_lines(rows), *warnings])


def _find_image_pairs(
    board_names: Sequence[str], line_names: Sequence[str]
) -> tuple[list[Path], list[Path]]:
    """Return the files of board and line images; raise an error unless there is one for each."""
    boards, lines = find_image_files(board_names), find_image_files(line_names)
    if len(boards) != len(lines):
        raise UnreadableFile(
            f"expected a line image for each of {len(boards)} board images ({boards[0].name} to "
            f"{boards[-1].name}), got {len(lines)} ({lines[0].name} to {lines[-1].name}): leave "
            "out images without a counterpart"
        )
    return boards, lines
