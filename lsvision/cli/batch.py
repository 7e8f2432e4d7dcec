"""Many files, or a camera's frames, one after the other: a failure does not stop the rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lsvision.cli.image_sources import (
    ImageFile,
    ImagingOptions,
    LiveCamera,
    is_image,
    read_image_source,
)
from lsvision.cli.measure_options import range_warning
from lsvision.cli.messages import internal_error, print_error
from lsvision.cli.outputs import Pictures
from lsvision.cli.progress import Progress
from lsvision.cli.robot_frame import RobotFrame, robot_frame_table
from lsvision.cli.robot_poses import read_poses
from lsvision.cli.section_table import measurement_lines
from lsvision.cli.sources import read_source
from lsvision.errors import LsvisionError

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.io.results import Record
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
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
    plot : Path, optional
        Picture of each profile; see `Pictures`.
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
    plot: Path | None = None
    verbose: bool = False
    debug: bool = False


def measure_sources(
    sources: Sequence[Path | LiveCamera], batch: BatchOptions
) -> "tuple[list[Record], int]":
    """Measure files in their order, print what each holds, and draw it.

    Parameters
    ----------
    sources : sequence of Path or LiveCamera
        The files.
    batch : BatchOptions
        What is done with each.

    Returns
    -------
    records : list of dict
        One for each profile that was measured.
    failed : int
        How many files failed, each told on stderr.

    Raises
    ------
    LsvisionError
        If profiles go with a robot's poses and a file cannot be read, or their numbers differ:
        which pose belongs to which profile is then open.
    """
    ahead = _read_ahead(sources, batch)
    records: list[Record] = []
    pictures = None if batch.plot is None else Pictures(batch.plot, several=len(sources) > 1)
    progress, failed = Progress(len(sources)), 0
    for done, source in enumerate(sources):
        progress.show(done, str(source))
        try:
            show = partial(progress.show, done, str(source))
            sections = _sections(source, batch, show, ahead.get(done))
            lines = _lines(*sections, batch)
            if pictures:
                _draw(*sections, pictures, batch)
            records += _records(*sections)
        except LsvisionError as error:
            progress.clear()
            print_error(str(error), debug=batch.debug)
            failed += 1
        except Exception as error:  # noqa: BLE001 - a bug met by one file must not cost the batch
            progress.clear()
            print_error(f"{source}: {internal_error(error)}", debug=batch.debug)
            failed += 1
        else:
            progress.clear()
            typer.echo("\n".join(lines))
    return records, failed


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
    poses = iter(read_poses(batch.placing.rows, sum(len(file.profiles) for file in files)))
    return {
        number: (file, [next(poses) for _ in file.profiles]) for number, file in enumerate(files)
    }


def _sections(
    source: Path | LiveCamera,
    batch: BatchOptions,
    show: Callable[[int, int], None],
    ahead: "tuple[ProfileFile | ImageFile, list[Pose]] | None",
) -> "tuple[ProfileFile | ImageFile, list[_Section]]":
    """Read a file, unless that is done already, and measure its profiles."""
    file, flanges = ahead or (_read(source, batch), None)
    sections = []
    for number, profile in enumerate(file.profiles):
        show(number, len(file.profiles))
        if profile.lost == len(profile):
            continue
        try:
            measurement = batch.measuring(profile)
        except LsvisionError as error:
            raise LsvisionError(f"{source}, profile {number}: {error}") from error
        empty = not measurement.cylinders and not isinstance(file, ImageFile)
        upside_down = empty and _holds_cylinders_upside_down(profile, batch)
        placed = None
        if batch.placing is not None:
            flange = None if flanges is None else flanges[number]
            placed = batch.placing.place(measurement.cylinders, flange)
        sections.append(_Section(number, profile, measurement, upside_down, placed))
    return file, sections


def _read(source: Path | LiveCamera, batch: BatchOptions) -> "ProfileFile | ImageFile":
    height_map = batch.imaging is None and batch.reading.get("dx") is not None
    if isinstance(source, LiveCamera) or (is_image(source) and not height_map):
        return read_image_source(source, batch.imaging)
    return read_source(source, batch.reading)


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


def _records(file: "ProfileFile | ImageFile", sections: list[_Section]) -> "list[Record]":
    from lsvision.io.results import input_record, measurement_record

    return [
        measurement_record(
            section.measurement,
            source=str(file.path),
            profile=section.number,
            placed=section.placed,
            reading=None if isinstance(file, ImageFile) else input_record(file, section.number),
        )
        for section in sections
    ]


def _draw(
    file: "ProfileFile | ImageFile",
    sections: list[_Section],
    pictures: Pictures,
    batch: BatchOptions,
) -> None:
    from lsvision.draw import draw_measurement, draw_overlay, figure_bytes
    from lsvision.io.atomic_files import write_atomic

    parts = len(file.profiles)
    for section in sections:
        found = section.profile, section.measurement
        title = f"{file.path}, {_part(file)} {section.number}" if parts > 1 else str(file.path)
        if isinstance(file, ImageFile) and batch.imaging is not None:
            image, rig = file.images[section.number], batch.imaging.light_section
            figure = draw_overlay(image, rig, *found, title=title)
        else:
            figure = draw_measurement(*found, title=title)
        path = pictures.path_of(file.path, section.number, parts)
        write_atomic(path, figure_bytes(figure, path.suffix[1:].lower()))


def _part(file: "ProfileFile | ImageFile") -> str:
    return "frame" if isinstance(file, ImageFile) else "profile"
