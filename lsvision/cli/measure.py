"""``lsvision measure``: profiles and images in, cylinders with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from lsvision.cli.file_chunk import FileOptions, is_image_source
from lsvision.cli.image_options import (
    BayerPattern,
    Laser,
    LaserOff,
    LightSectionFile,
    Method,
    parse_imaging,
    reject_reading_of_images,
)
from lsvision.cli.image_sources import LiveCamera, is_video
from lsvision.cli.measure_files import RunOptions, measure_sources
from lsvision.cli.measure_options import build_measure_function
from lsvision.cli.messages import FAILED, print_error
from lsvision.cli.option_groups import expand_option_groups
from lsvision.cli.outputs import Pictures, check_outputs, check_picture
from lsvision.cli.profile_options import (
    CsvFile,
    Jobs,
    JsonFile,
    KnownPhi,
    KnownRadius,
    Radius,
    ReadingOptions,
    SensorOptions,
    Verbose,
)
from lsvision.cli.robot_options import RobotOptions, parse_robot_frame
from lsvision.cli.sources import MEASURED_SUFFIXES, find_sources, list_suffixes_of_profiles
from lsvision.errors import LsvisionError
from lsvision.files.file_kinds import STDOUT
from lsvision.files.limited_reading import get_size_limit


@expand_option_groups
def measure(
    *,
    ctx: typer.Context,
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE|DIR|GLOB", help="Any number of files of profiles, images or videos."
        ),
    ] = None,
    radius: Radius = None,
    known_radius: KnownRadius = None,
    known_phi_deg: KnownPhi = None,
    sensor: SensorOptions,
    paper: Annotated[
        bool, typer.Option("--paper", help="The paper's pipeline as published, for comparison.")
    ] = False,
    light_section: LightSectionFile = None,
    laser: Laser = "grey",
    bayer: BayerPattern = None,
    method: Method = "derivative",
    laser_off: LaserOff = None,
    surface_std: Annotated[
        float,
        typer.Option(
            min=0, max=1000, metavar="MM", help="For images: roughness of the surface, one sigma."
        ),
    ] = 0.0,
    camera: Annotated[
        int | None,
        typer.Option(min=0, metavar="INDEX", help="Also take images from this connected camera."),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Frames of a video [all] or of the camera [1]."),
    ] = None,
    robot: RobotOptions,
    json_file: JsonFile = None,
    csv_file: CsvFile = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png|F.svg",
            help="Draw the cylinders into the profile or the image; of several files F-NAME.png "
            "each, of several profiles or frames in a file F-NAME-K.png.",
        ),
    ] = None,
    reading: ReadingOptions,
    jobs: Jobs = None,
    verbose: Verbose = False,
) -> None:
    """Measure radius and orientation of every cylinder in profiles or images of a laser line.

    For each cylinder: radius, theta (direction of the section's major axis, from X towards Y),
    phi (tilt of the axis from the laser plane's normal) and centre, each with one sigma, and
    below them the 95 % intervals. Text files hold x and height in mm, one point per line, unless
    their header or an option says otherwise. Images need the rig that took them.

    \b
    Every pipe in a profile, with a picture:
      lsvision measure fixtures/welded_pair.csv --plot pair.png
    Pipes of 10 to 40 mm under an LPS 36 HI, and why the rest was rejected:
      lsvision measure fixtures/welded_complex.csv --radius 10:40 --sensor lps36hi -v
    A pipe turned to 25 +/- 0.05 mm:
      lsvision measure fixtures/single.csv --known-radius 25:0.05
    A pipe perpendicular to the laser plane, ± 5 deg:
      lsvision measure fixtures/planar.csv --known-phi-deg 0:5
    A folder, all results in two files and a picture of each:
      lsvision measure fixtures --json all.json --csv all.csv --plot all.png
    Ranges (away from the sensor) in metres, columns 1 and 3 of a table:
      lsvision measure 'logs/**/*.txt' --flip --units m --columns 0,2
    A camera's image of the line (--plot draws the ellipses into it):
      lsvision measure fixtures/images/pair.png --light-section fixtures/images/rig.json
    Ten frames of the first camera that is connected, a red laser:
      lsvision measure --camera 0 --frames 10 --light-section rig.json --laser red
    On a robot, in its base frame (without poses: its flange's), with the hand-eye file that
    lsvision calibrate hand-eye wrote:
      lsvision measure calibration/example/pipe --flange-from-section hand_eye.json \\
        --poses calibration/example/pipe_poses.csv --convention kuka --known-radius 15:0.02
    """  # noqa: D301 - the backspace makes click keep the line breaks
    if not files and camera is None:
        raise typer.BadParameter("expected files, folders or --camera INDEX, got none")
    check_picture(plot)
    noise = sensor.parse()
    measure_function = build_measure_function(
        radius, known_radius, known_phi_deg, noise, paper=paper
    )
    if surface_std and (paper or noise is not None):
        _reject_surface_std()
    read_options = reading.parse()
    suffixes = list_suffixes_of_profiles(reading.dx) if light_section is None else MEASURED_SUFFIXES
    paths, missing = find_sources(files or (), suffixes)
    inputs = [*paths, *robot.files, *filter(None, (light_section, laser_off))]
    taken = check_outputs((plot,), inputs, streams=(json_file, csv_file))
    robot_frame = parse_robot_frame(robot)
    sources: list[Path | LiveCamera] = [*paths]
    if camera is not None:
        sources.append(LiveCamera(camera, frames or 1))
    options = FileOptions(
        measure_function=measure_function,
        sensor=noise,
        reading=read_options,
        imaging=parse_imaging(
            light_section, laser, method, bayer, laser_off,
            surface_std=surface_std, frames=frames, keep_images=plot is not None,
        ),
        robot_frame=robot_frame,
        verbose=verbose,
        debug=ctx.find_root().params.get("debug", False),
        max_size=get_size_limit(),
    )  # fmt: skip
    _reject_options_without_files(sources, options)
    pictures = (
        None if plot is None else Pictures(plot, several=len(sources) > 1, command_files=taken)
    )
    to_stderr = STDOUT in (json_file, csv_file)
    run = RunOptions(options=options, pictures=pictures, jobs=jobs, table_to_stderr=to_stderr)
    _report_missing(missing, robot.poses)
    failed = _measure_all(sources, run, json_file, csv_file) + len(missing)
    _report_failed(failed, len(sources) + len(missing), plot)


def _reject_surface_std() -> NoReturn:
    """Raise the error of a roughness beside options with which it would have no effect."""
    raise typer.BadParameter(
        "expected --surface-std, or --paper, --sensor or --range-std, got both: it adds to the "
        "noise predicted from the pixels, which is not used with these options"
    )


def _reject_options_without_files(
    sources: Sequence[Path | LiveCamera], options: FileOptions
) -> None:
    """Raise an error for options of images, videos or profiles if there is no file of the kind."""
    if options.imaging is None or not sources:
        return
    are_images = [is_image_source(source, options) for source in sources]
    if not any(are_images):
        raise typer.BadParameter("expected images with --light-section, got profiles only")
    reject_reading_of_images(options.reading, are_images)
    if options.imaging.frames is not None and not any(
        isinstance(source, LiveCamera) or is_video(source) for source in sources
    ):
        raise typer.BadParameter("expected a video or --camera with --frames, got none")


def _report_missing(missing: Sequence[LsvisionError], poses: Path | None) -> None:
    """Report names without files; exit if there are poses, which then cannot be paired."""
    for failure in missing:
        print_error(str(failure))
    if missing and poses is not None:
        raise typer.Exit(FAILED)


def _report_failed(failed: int, total: int, plot: Path | None) -> None:
    """Report how many files failed; exit with code 1 if any did."""
    if failed and total > 1:
        what = "measured" if plot is None else "measured or drawn"
        print_error(f"{failed} of {total} could not be {what}")
    if failed:
        raise typer.Exit(FAILED)


def _measure_all(
    sources: list[Path | LiveCamera],
    run: RunOptions,
    json_file: Path | None,
    csv_file: Path | None,
) -> int:
    """Measure the sources; return how many failed.

    After an interruption the files contain the results so far.
    """
    from lsvision.io.result_files import ResultFiles

    frame = None
    if run.options.robot_frame is not None:
        frame = "flange" if run.options.robot_frame.pose_file is None else "base"
    results = ResultFiles(json_file, csv_file, frame)
    try:
        return measure_sources(sources, replace(run, results=results))
    finally:
        results.finish()
