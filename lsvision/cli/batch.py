"""Measure files and camera frames one by one; an error in one does not stop the others."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.image_sources import (
    ImageFile,
    ImagingOptions,
    LiveCamera,
    is_image,
    read_image_source,
)
from lsvision.cli.measure_options import range_warning
from lsvision.cli.messages import internal_error, print_error, print_lines
from lsvision.cli.outputs import Pictures
from lsvision.cli.progress import Progress
from lsvision.cli.robot_frame import RobotFrame, robot_frame_table
from lsvision.cli.section_table import measurement_lines
from lsvision.cli.sources import read_source
from lsvision.errors import LsvisionError
from lsvision.files.limited_reading import STDIN
from lsvision.files.printable import printable, printable_name

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.io.result_files import ResultFiles
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.results.quantities import Record
    from lsvision.sensors.profile_sensor import ProfileSensor

MAX_FLIP_CHECK_POINTS = 20_000
"""Largest number of points of a profile that is measured upside down."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """How each file is measured, and what is written.

    Parameters
    ----------
    measuring : callable
        Function from `Profile` to `Measurement`.
    sensor : ProfileSensor, optional
        Noise model that `measuring` uses.
    reading : ReadOptions
        Reading options for the files.
    imaging : ImagingOptions, optional
        Conversion of images to profiles; without it images are refused.
    placing : RobotFrame, optional
        Transformation of cylinders to the robot's frame; by default they stay in the section's.
    pictures : Pictures, optional
        Names of the pictures; by default none is drawn.
    results : ResultFiles, optional
        Files to which each result is written at once.
    table_to_stderr : bool
        Print the tables on standard error, because results go to standard output.
    verbose : bool
        Also list the refused arcs.
    debug : bool
        Show tracebacks.
    """

    measuring: "Callable[[Profile], Measurement]"
    sensor: "ProfileSensor | None" = None
    reading: "ReadOptions" = field(default_factory=dict)  # type: ignore[assignment] # all optional
    imaging: ImagingOptions | None = None
    placing: RobotFrame | None = None
    pictures: Pictures | None = None
    results: "ResultFiles | None" = None
    table_to_stderr: bool = False
    verbose: bool = False
    debug: bool = False


def measure_sources(sources: Sequence[Path | LiveCamera], batch: BatchOptions) -> int:
    """Measure files in order; print, write and draw the results of each.

    Parameters
    ----------
    sources : sequence of Path or LiveCamera
        The files.
    batch : BatchOptions
        How they are measured, and what is written.

    Returns
    -------
    int
        Number of files that could not be measured or drawn; each is reported on stderr.

    Raises
    ------
    LsvisionError
        With poses of a robot: if a file cannot be read, or there are not as many poses as profiles,
        so that poses and profiles cannot be paired.
    KeyboardInterrupt
        If the run is interrupted; reported on stderr.
    """
    progress, failed = Progress(len(sources)), 0
    done = 0
    try:
        ahead = _read_ahead(sources, batch)
        for done, source in enumerate(sources):
            progress.show(done, str(source))
            show = partial(progress.show, done, str(source))
            failed += not _measure_source(source, batch, progress, show, ahead.get(done))
    except KeyboardInterrupt:
        progress.clear()
        print_error(f"interrupted: {done} of {len(sources)} were measured")
        raise
    return failed


def _measure_source(
    source: Path | LiveCamera,
    batch: BatchOptions,
    progress: Progress,
    show: Callable[[int, int], None],
    ahead: "tuple[ProfileFile | ImageFile, list[Pose]] | None",
) -> bool:
    """Measure a file; return False if that fails, which is reported on stderr."""
    try:
        sections = _sections(source, batch, show, ahead)
        lines = _lines(*sections, batch)
        records = _records(*sections, len(sections[0].profiles))
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the batch
        progress.clear()
        _print_failure(source, error, batch)
        return False
    progress.clear()
    if batch.results is not None:
        batch.results.add(records)
    print_lines(lines, err=batch.table_to_stderr)
    try:
        if batch.pictures is not None:
            _draw(*sections, batch.pictures, batch)
    except Exception as error:  # noqa: BLE001 - a picture must not cost the results
        _print_failure(source, error, batch)
        return False
    return True


def _print_failure(source: Path | LiveCamera, error: Exception, batch: BatchOptions) -> None:
    if isinstance(error, LsvisionError):
        message = str(error)
    elif isinstance(error, MemoryError):
        message = f"{source}: out of memory: measure a part of it, or on a larger machine"
    else:
        message = f"{source}: {internal_error(error)}"
    print_error(message, debug=batch.debug)


@dataclass(frozen=True, eq=False)
class _Section:
    """Profile with valid points, its number in the file, and its measurement."""

    number: int
    profile: "Profile"
    measurement: "Measurement"
    upside_down: bool
    placed: "list[tuple[PlacedCylinder, PlacedCylinder]] | None"


def _read_ahead(
    sources: Sequence[Path | LiveCamera], batch: BatchOptions
) -> "dict[int, tuple[ProfileFile | ImageFile, list[Pose]]]":
    """Return the files by number, with the poses of their profiles; empty without poses."""
    if batch.placing is None or batch.placing.rows is None:
        return {}
    files = [_read(source, batch) for source in sources]
    count = sum(len(file.profiles) for file in files)
    poses = iter(batch.placing.rows.read(count))
    return {
        number: (file, [next(poses) for _ in file.profiles]) for number, file in enumerate(files)
    }


def _sections(
    source: Path | LiveCamera,
    batch: BatchOptions,
    show: Callable[[int, int], None],
    ahead: "tuple[ProfileFile | ImageFile, list[Pose]] | None",
) -> "tuple[ProfileFile | ImageFile, list[_Section]]":
    """Read a file, unless it was read ahead, and measure its profiles.

    After an interruption the results of the profiles measured so far are written.
    """
    file, flanges = ahead or (_read(source, batch), None)
    sections: list[_Section] = []
    number = 0
    try:
        for number, profile in enumerate(file.profiles):
            show(number, len(file.profiles))
            if profile.lost < len(profile):
                flange = None if flanges is None else flanges[number]
                sections.append(_measured_section(file, number, batch, flange))
    except KeyboardInterrupt:
        if batch.results is not None:
            batch.results.add(_records(file, sections, number))
        raise
    return file, sections


def _measured_section(
    file: "ProfileFile | ImageFile", number: int, batch: BatchOptions, flange: "Pose | None"
) -> _Section:
    profile = file.profiles[number]
    try:
        measurement = batch.measuring(profile)
    except LsvisionError as error:
        raise LsvisionError(f"{file.path}, profile {number}: {error}") from error
    empty = not measurement.cylinders and not isinstance(file, ImageFile)
    upside_down = empty and _holds_cylinders_upside_down(profile, batch)
    placed = None
    if batch.placing is not None:
        placed = batch.placing.place(measurement.cylinders, flange)
    return _Section(number, profile, measurement, upside_down, placed)


def _read(source: Path | LiveCamera, batch: BatchOptions) -> "ProfileFile | ImageFile":
    height_map = batch.imaging is None and batch.reading.get("dx") is not None
    if (
        isinstance(source, LiveCamera)
        or (is_image(source) and not height_map)
        or _is_image_stream(source, batch)
    ):
        return read_image_source(source, batch.imaging)
    return read_source(source, batch.reading)


def _is_image_stream(source: Path, batch: BatchOptions) -> bool:
    """Return whether a source is an image on standard input: with a rig, it always is."""
    return str(source) == STDIN and batch.imaging is not None


def _holds_cylinders_upside_down(profile: "Profile", batch: BatchOptions) -> bool:
    from lsvision.profile import Profile

    step = 1 + len(profile) // MAX_FLIP_CHECK_POINTS
    mirrored = Profile(profile.points[::step] * (1.0, -1.0), lost=())
    try:
        return bool(batch.measuring(mirrored).cylinders)
    except LsvisionError:
        return False


def _lines(
    file: "ProfileFile | ImageFile", sections: list[_Section], batch: BatchOptions
) -> list[str]:
    warnings = [range_warning(section.profile, batch.sensor) for section in sections]
    notes = [*file.notes, *dict.fromkeys(filter(None, warnings))]
    if batch.verbose and not isinstance(file, ImageFile) and file.ignored:
        notes.append(f"columns not used: {', '.join(file.ignored)}")
    lines = [f"{file.path}: {file.summary}", *(f"  note: {note}" for note in notes)]
    turn = "--no-flip" if file.flipped else "--flip"
    for section in sections:
        text_lines = measurement_lines(section.measurement, section.profile, verbose=batch.verbose)
        if len(file.profiles) > 1:
            head = f"{_part(file)} {section.number}:"
            found = bool(section.measurement.cylinders)
            text_lines = (
                [head, *text_lines] if found else [f"{head} {text_lines[0]}", *text_lines[1:]]
            )
        lines += [f"  {line}" for line in (*text_lines, *robot_frame_table(section.placed or ()))]
        if section.upside_down:
            lines.append(f"  upside down it holds cylinders: do its heights grow the other way? "
                         f"then say {turn}")  # fmt: skip
    return lines


def _records(
    file: "ProfileFile | ImageFile", sections: list[_Section], count: int
) -> "list[Record]":
    """Return records of a file's first `count` profiles, also of those without valid points."""
    from lsvision.io.results import measurement_record
    from lsvision.measure import Measurement

    name = printable_name(file.path)
    records = {
        number: measurement_record(
            Measurement((), ()),
            source=name,
            profile=number,
            reading=_reading(file, number),
            reason="no valid point",
        )
        for number in range(count)
    }
    for section in sections:
        records[section.number] = measurement_record(
            section.measurement,
            source=name,
            profile=section.number,
            placed=section.placed,
            reading=_reading(file, section.number),
            reason=section.measurement.reason,
        )
    return list(records.values())


def _reading(file: "ProfileFile | ImageFile", number: int) -> "Record | None":
    """Return how a profile was read; None for an image."""
    from lsvision.io.results import input_record

    return None if isinstance(file, ImageFile) else input_record(file, number)


def _draw(
    file: "ProfileFile | ImageFile",
    sections: list[_Section],
    pictures: Pictures,
    batch: BatchOptions,
) -> None:
    from lsvision.draw import draw_measurement, draw_overlay, figure_bytes
    from lsvision.files.atomic_files import write_atomic

    parts = len(file.profiles)
    for section in sections:
        found = section.profile, section.measurement
        title = printable(str(file.path))
        title += f", {_part(file)} {section.number}" if parts > 1 else ""
        if isinstance(file, ImageFile) and batch.imaging is not None:
            image, rig = file.images[section.number], batch.imaging.light_section
            figure = draw_overlay(image, rig, *found, title=title)
        else:
            figure = draw_measurement(*found, title=title)
        path = pictures.path_of(file.path, section.number, parts)
        write_atomic(path, figure_bytes(figure, path.suffix[1:].lower()))


def _part(file: "ProfileFile | ImageFile") -> str:
    return "frame" if isinstance(file, ImageFile) else "profile"
