"""``lsvision scan``: profiles with their poses in, cylinders in space out."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.measure_options import parse_known_radius, parse_search_range
from lsvision.cli.messages import Progress, end_on_failures, print_lines
from lsvision.cli.option_groups import expand_option_groups
from lsvision.cli.outputs import check_outputs, check_picture, write_output
from lsvision.cli.profile_options import (
    CsvFile,
    JsonFile,
    KnownRadius,
    Radius,
    ReadingOptions,
    SensorOptions,
    Verbose,
)
from lsvision.cli.robot_options import (
    EncoderMotion,
    RobotMotion,
    RobotOptions,
    build_scan_poses,
    format_motion_uncertainty_caption,
    parse_motion,
)
from lsvision.cli.sources import (
    find_sources,
    list_suffixes_of_profiles,
    name_profiles,
    read_sources,
    require_points_of_scan,
)
from lsvision.errors import DegenerateGeometry
from lsvision.files.file_kinds import STDOUT
from lsvision.files.printable import escape_name, escape_text

if TYPE_CHECKING:
    from lsvision.geometry import Points, Pose
    from lsvision.io.profiles import ReadOptions
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.results.quantities import Record
    from lsvision.scan import CylinderShape, PoseErrors, ScanMeasurement, ScannedCylinder
    from lsvision.sensors.profile_sensor import ProfileSensor

MAX_POSE_STD_MM, MAX_FEED_STD_DEG = 1000, 57
"""Largest --pose-std and --feed-std-deg, as of `lsvision.scan.PoseErrors` (1 rad is 57.3 deg)."""


@expand_option_groups
def scan(
    *,
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE|DIR|GLOB", help="Profiles in the order of the feed."),
    ],
    feed: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Direction of the section's motion, in the section frame: 0,0,1 is along the "
            "laser plane's normal. If the part moves, the opposite of its motion.",
        ),
    ] = None,
    step: Annotated[
        float | None, typer.Option(metavar="MM", help="Feed from one profile to the next.")
    ] = None,
    robot: RobotOptions,
    radius: Radius = None,
    known_radius: KnownRadius = None,
    sensor: SensorOptions,
    pose_std: Annotated[
        float,
        typer.Option(
            metavar="MM",
            min=0,
            max=MAX_POSE_STD_MM,
            help="One sigma of each pose per axis, in addition to the hand-eye file's.",
        ),
    ] = 0.0,
    feed_std_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG", min=0, max=MAX_FEED_STD_DEG, help="One sigma of the feed's direction."
        ),
    ] = 0.0,
    json_file: JsonFile = None,
    csv_file: CsvFile = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="F.png|F.svg", help="Draw points and cylinders in 3D.")
    ] = None,
    points_ply: Annotated[
        Path | None,
        typer.Option("--points", metavar="F.ply", help="Write all points, coloured by cylinder."),
    ] = None,
    surfaces_ply: Annotated[
        Path | None,
        typer.Option("--surfaces", metavar="F.ply", help="Write the cylinders' surfaces."),
    ] = None,
    reading: ReadingOptions,
    verbose: Verbose = False,
) -> None:
    """Measure cylinders in space from several sections of known pose, jointly.

    Two sections 10 mm apart determine radius and direction 5 to 30 times better than one, and
    more sections better still. For each cylinder: radius, direction, a point of the axis, each with
    one sigma; with three or more sections also bow, taper and ovality.

    \b
    Twenty sections, 1 mm apart along the laser plane's normal:
      lsvision scan fixtures/scan_welded_pair --feed 0,0,1 --step 1 --plot pair.png
    A bent pipe, its points and surface for MeshLab:
      lsvision scan fixtures/scan_bent_pipe --feed 0,0,1 --step 4 --points p.ply --surfaces s.ply
    A robot carries the sensor; hand_eye.json is what lsvision calibrate hand-eye wrote:
      lsvision scan calibration/example/pipe --poses calibration/example/pipe_poses.csv \\
        --convention kuka --flange-from-section hand_eye.json --radius 15

    A wrong feed does not show in the residuals: an error of 0.5 deg in its direction changes the
    direction of the axis by 0.45 deg and the radius by 0.1 mm. --feed-std-deg includes that in the
    errors.
    """  # noqa: D301 - the backspace makes click keep the line breaks
    check_picture(plot)
    options = reading.parse()
    noise = sensor.parse()
    search, known = parse_search_range(radius), parse_known_radius(known_radius)
    sources, missing = find_sources(files, list_suffixes_of_profiles(reading.dx))
    outputs = (plot, points_ply, surfaces_ply)
    check_outputs(outputs, [*sources, *robot.files], streams=(json_file, csv_file))
    motion = parse_motion(feed, step, robot)
    end_on_failures(missing)

    from lsvision.scan import fit_sections_jointly

    profiles, names, records = _read_all(sources, options)
    base_from_sections = build_scan_poses(motion, len(profiles))
    pose_errors = _build_pose_errors(pose_std, feed_std_deg, motion, base_from_sections)
    measurements = _measure_all(profiles, names, search, known, noise)
    scan_result = fit_sections_jointly(
        profiles, base_from_sections, measurements, known_radius=known, sensor=noise,
        pose_errors=pose_errors,
    )  # fmt: skip
    shapes = _measure_shapes(scan_result)
    _write_tables(scan_result, shapes, (names, records), base_from_sections, (json_file, csv_file))
    lines = _format_scan_lines(
        scan_result, shapes, format_motion_uncertainty_caption(motion), verbose=verbose
    )
    print_lines(lines, err=STDOUT in (json_file, csv_file))
    points = _transform_points_to_base(profiles, base_from_sections)
    if plot is not None:
        _draw(
            plot,
            scan_result,
            points,
            title=" ".join(files),
            of_robot=isinstance(motion, RobotMotion),
        )
    _write_clouds(scan_result, points, points_ply, surfaces_ply)


def _build_pose_errors(
    pose_std: float,
    feed_std_deg: float,
    motion: EncoderMotion | RobotMotion,
    base_from_sections: "Sequence[Pose]",
) -> "PoseErrors":
    """Return the errors of the poses, from the options (mm, deg) and the hand-eye file."""
    from lsvision.scan import PoseErrors
    from lsvision.scan.pose_errors import require_feed

    errors = PoseErrors(
        pose_std=pose_std,
        feed_std=math.radians(feed_std_deg),
        calibration=motion.calibration if isinstance(motion, RobotMotion) else None,
    )
    try:
        require_feed(base_from_sections, errors)
    except ValueError:
        raise typer.BadParameter(
            "expected --feed-std-deg with a feed, got a first and a last pose with the same "
            "origin: end the scan at another position, or state --pose-std"
        ) from None
    return errors


def _read_all(
    sources: Sequence[Path], reading: "ReadOptions"
) -> "tuple[list[Profile], list[str], list[Record]]":
    """Return all profiles in the order of their files, a name for each, and how each was read."""
    from lsvision.io.results import build_input_record

    files = read_sources(sources, reading, may_be_lost=True)
    profiles = [profile for file in files for profile in file.profiles]
    require_points_of_scan(profiles, sources)
    names = [name for file in files for name in name_profiles(file, str(file.path))]
    records = [build_input_record(file, k) for file in files for k in range(len(file.profiles))]
    return profiles, names, records


def _measure_all(
    profiles: "Sequence[Profile]",
    names: Sequence[str],
    radius: float | tuple[float, float] | None,
    known_radius: float | tuple[float, float] | None,
    sensor: "ProfileSensor | None",
) -> "list[Measurement]":
    """Return the measurement of each profile by itself; show their number while it grows."""
    from lsvision.measure import PROFILES_AT_ONCE
    from lsvision.scan import measure_sections

    progress, measurements = Progress(len(profiles)), []
    for done in range(0, len(profiles), PROFILES_AT_ONCE):
        progress.show(done, names[done])
        measurements += measure_sections(
            profiles[done : done + PROFILES_AT_ONCE],
            radius=radius,
            known_radius=known_radius,
            sensor=sensor,
        )
    progress.clear()
    return measurements


def _measure_shapes(scan_result: "ScanMeasurement") -> "list[CylinderShape | None]":
    """Return the shape of each cylinder; None where its sections are too few or too close."""
    from lsvision.scan import measure_shape

    shapes: list[CylinderShape | None] = []
    for cylinder in scan_result.cylinders:
        try:
            shapes.append(measure_shape(cylinder))
        except DegenerateGeometry:
            shapes.append(None)
    return shapes


def _transform_points_to_base(
    profiles: "Sequence[Profile]", base_from_sections: "Sequence[Pose]"
) -> "Points":
    """Return all measured points in the base frame, without lost ones. Units: mm."""
    import numpy as np

    points = np.concatenate(
        [
            base_from_section.apply(profile.points)
            for profile, base_from_section in zip(profiles, base_from_sections, strict=True)
        ]
    )
    measured_points: Points = points[np.isfinite(points[:, 0])]
    return measured_points


def _write_tables(
    scan_result: "ScanMeasurement",
    shapes: "Sequence[CylinderShape | None]",
    inputs: "tuple[list[str], list[Record]]",
    base_from_sections: "Sequence[Pose]",
    outputs: tuple[Path | None, Path | None],
) -> None:
    """Write the JSON and the CSV file, if `outputs` has them.

    `inputs` has the name of each profile, and the record of how it was read.
    """
    json_file, csv_file = outputs
    names, records = inputs
    if json_file is not None:
        from lsvision.io.scan_results import build_scan_record, format_scan_json

        sources = [escape_name(name) for name in names]
        write_output(
            json_file, format_scan_json(build_scan_record(scan_result, shapes, sources, records))
        )
    if csv_file is not None:
        from lsvision.io.scan_results import format_scan_csv

        write_output(csv_file, format_scan_csv(scan_result, base_from_sections))


def _draw(
    plot: Path, scan_result: "ScanMeasurement", points: "Points", *, title: str, of_robot: bool
) -> None:
    """Write the picture: Z upwards in a robot's base frame, else Y, towards the sensor."""
    from lsvision.draw.figures import write_figure
    from lsvision.draw.scan import draw_scan

    figure = draw_scan(
        scan_result, points, title=escape_text(title), vertical="z" if of_robot else "y"
    )
    write_figure(plot, figure)


def _write_clouds(
    scan_result: "ScanMeasurement",
    points: "Points",
    points_ply: Path | None,
    surfaces_ply: Path | None,
) -> None:
    """Write the PLY files that the options name."""
    if points_ply is None and surfaces_ply is None:
        return
    from lsvision.io.ply import colour_points, colour_surfaces, write_ply

    if points_ply is not None:
        write_ply(points_ply, *colour_points(scan_result, points))
    if surfaces_ply is not None:
        write_ply(surfaces_ply, *colour_surfaces(scan_result))


def _format_scan_lines(
    scan: "ScanMeasurement",
    shapes: "Sequence[CylinderShape | None]",
    caption: str,
    *,
    verbose: bool,
) -> list[str]:
    """Return the lines of a scan's table, with remarks on each cylinder below.

    A shape is None where there are too few sections; the caption, from
    `format_motion_uncertainty_caption`, states which errors the standard deviations include.
    `verbose` adds the rejected tracks.
    """
    from lsvision.results.summaries import format_count
    from lsvision.results.tables import format_text_table
    from lsvision.scan.scan_result import format_cylinder_cells

    profiles = format_count(len(scan.measurements), "profile")
    rejected = [f"  {rejection}" for rejection in scan.rejections]
    if scan.cylinders:
        lines = [
            f"{profiles}, base frame, {caption}",
            *format_text_table(format_cylinder_cells(scan.cylinders)),
        ]
        for number, (cylinder, shape) in enumerate(zip(scan.cylinders, shapes, strict=True), 1):
            lines += [f"  {number}: {line}" for line in _format_remarks(cylinder, shape)]
    else:
        lines = [f"{profiles}: no cylinder found: {scan.reason}"]
        if len(rejected) > 1 and not verbose:
            lines[0] += f" ({len(rejected)} tracks rejected: -v lists them)"
    if verbose and rejected:
        lines += [f"rejected: {len(rejected)}", *rejected]
    return lines


def _format_remarks(cylinder: "ScannedCylinder", shape: "CylinderShape | None") -> list[str]:
    """Return the lines below the table on a cylinder: its axial range, twin and shape."""
    from lsvision.scan.scan_result import describe_twin
    from lsvision.scan.shape_result import format_shape_lines

    low, high = cylinder.axial_range
    remarks = [f"measured from {low:z.1f} to {high:z.1f} mm along the axis from its point"]
    if cylinder.twin is not None:
        remarks.append(describe_twin(cylinder, cylinder.twin))
    if shape is not None:
        remarks += format_shape_lines(shape)
    return remarks
