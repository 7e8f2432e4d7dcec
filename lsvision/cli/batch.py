"""Many files, or a camera's frames, one after the other: a failure does not stop the rest."""

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
from lsvision.cli.section_table import measurement_lines, reason_without_cylinder
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
"""Points of a profile that are looked at upside down."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """What is done with each file.

    Parameters
    ----------
    measuring : callable
        Profile to Measurement.
    sensor : ProfileSensor, optional
        That `measuring` weighs the points by.
    reading : ReadOptions
        What the user says of the files.
    imaging : ImagingOptions, optional
        How images become profiles; without it they are refused.
    placing : RobotFrame, optional
        How cylinders come to the robot's frame; without it they stay in the section's.
    pictures : Pictures, optional
        Names of the pictures; without it none is drawn.
    results : ResultFiles, optional
        Files that take the results as they come.
    table_to_stderr : bool
        Print what each file holds on standard error, because results go to standard output.
    verbose : bool
        Also say what was refused.
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
    """Measure files in their order, print what each holds, keep its results, and draw it.

    Parameters
    ----------
    sources : sequence of Path or LiveCamera
        The files.
    batch : BatchOptions
        What is done with each.

    Returns
    -------
    int
        How many files failed, or have a picture that could not be written; each told on stderr.

    Raises
    ------
    LsvisionError
        If profiles go with a robot's poses and a file cannot be read, or their numbers differ:
        which pose belongs to which profile is then open.
    KeyboardInterrupt
        If the run is interrupted; told on stderr.
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
    """Measure a file; False if it fails, which is told on stderr."""
    try:
        sections = _sections(source, batch, show, ahead)
        lines = _lines(*sections, batch)
        records = _records(*sections, len(sections[0].profiles))
    except Exception as error:  # noqa: BLE001 - a bug met by one file must not cost the batch
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
    except Exception as error:  # noqa: BLE001 - a picture must not cost the numbers
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
    """A profile that holds points, its place in its file, and what it holds."""

    number: int
    profile: "Profile"
    measurement: "Measurement"
    upside_down: bool
    placed: "list[tuple[PlacedCylinder, PlacedCylinder]] | None"


def _read_ahead(
    sources: Sequence[Path | LiveCamera], batch: BatchOptions
) -> "dict[int, tuple[ProfileFile | ImageFile, list[Pose]]]":
    """Files by their number with the robot's pose of each profile; none without poses."""
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
    """Read a file, unless that is done already, and measure its profiles.

    If that is interrupted, the results of the profiles that were measured are kept.
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
    """Whether standard input holds an image: where there is a rig, nothing else does."""
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
    doubts = [range_warning(section.profile, batch.sensor) for section in sections]
    notes = [*file.notes, *dict.fromkeys(doubt for doubt in doubts if doubt)]
    if batch.verbose and not isinstance(file, ImageFile) and file.ignored:
        notes.append(f"columns not used: {', '.join(file.ignored)}")
    lines = [f"{file.path}: {file.summary}", *(f"  note: {note}" for note in notes)]
    turn = "--no-flip" if file.flipped else "--flip"
    for section in sections:
        verdict = measurement_lines(section.measurement, section.profile, verbose=batch.verbose)
        if len(file.profiles) > 1:
            head = f"{_part(file)} {section.number}:"
            found = bool(section.measurement.cylinders)
            verdict = [head, *verdict] if found else [f"{head} {verdict[0]}", *verdict[1:]]
        lines += [f"  {line}" for line in (*verdict, *robot_frame_table(section.placed or ()))]
        if section.upside_down:
            lines.append(f"  upside down it holds cylinders: do its heights grow the other way? "
                         f"then say {turn}")  # fmt: skip
    return lines


def _records(
    file: "ProfileFile | ImageFile", sections: list[_Section], count: int
) -> "list[Record]":
    """Records of a file's first `count` profiles, those without a point among them."""
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
            reason=reason_without_cylinder(section.measurement),
        )
    return list(records.values())


def _reading(file: "ProfileFile | ImageFile", number: int) -> "Record | None":
    """How a profile was read; None for a frame."""
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
