"""Measure consecutive profiles of a file; return the text to print and the records to write."""

import contextlib
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
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
from lsvision.cli.messages import internal_error
from lsvision.cli.robot_frame import RobotFrame, robot_frame_table
from lsvision.cli.section_table import measurement_lines
from lsvision.cli.sources import iterate_source, read_source
from lsvision.errors import LsvisionError
from lsvision.files.limited_reading import STDIN
from lsvision.files.printable import printable, printable_name

if TYPE_CHECKING:
    from lsvision.batch.measure_group import MeasureFunction
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.results.quantities import Record
    from lsvision.sensors.profile_sensor import ProfileSensor


@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """Options for reading and measuring files; can be pickled for another process.

    Parameters
    ----------
    measuring : callable
        Function that measures profiles, with its options filled in.
    sensor : ProfileSensor, optional
        Sensor whose noise `measuring` uses.
    reading : ReadOptions
        Options of reading profile files.
    imaging : ImagingOptions, optional
        Rig and settings for converting images to profiles; without them an image is an error.
    placing : RobotFrame, optional
        Transformation of cylinders to the robot's frame; None leaves them in the section frame.
    verbose, debug : bool
        Whether to list the rejected arcs, too; whether to print tracebacks.
    """

    measuring: "MeasureFunction"
    sensor: "ProfileSensor | None" = None
    reading: "ReadOptions" = field(default_factory=dict)  # type: ignore[assignment] # no required key
    imaging: ImagingOptions | None = None
    placing: RobotFrame | None = None
    verbose: bool = False
    debug: bool = False


@dataclass(frozen=True, eq=False)
class FilePart:
    """Consecutive profiles of a file.

    Parameters
    ----------
    file : ProfileFile or ImageFile
        The file, with the profiles of this part only.
    first : int
        Index of this part's first profile in the whole file, from 0.
    several : bool
        Whether the whole file has several profiles.
    header : list of str
        Summary of the file, or of a part of a large one, and notes; printed before the results.
    flanges : list of Pose, optional
        ``base_from_flange`` of each profile.
    pictures : list of Path, optional
        File of each profile's picture; None draws none.
    """

    file: "ProfileFile | ImageFile"
    first: int = 0
    several: bool = False
    header: list[str] = field(default_factory=list)
    flanges: "list[Pose] | None" = None
    pictures: list[Path] | None = None

    def __len__(self) -> int:
        return len(self.file.profiles)

    def slices(self, count: int) -> "Iterator[FilePart]":
        """Yield consecutive smaller parts of at most `count` profiles; one without any if empty."""
        for start in range(0, max(len(self), 1), count):
            indices = slice(start, start + count)
            yield replace(
                self,
                file=_select_profiles(self.file, indices),
                first=self.first + start,
                header=[] if start else self.header,
                flanges=self.flanges and self.flanges[indices],
                pictures=self.pictures and self.pictures[indices],
            )


@dataclass(frozen=True)
class PartResult:
    """Results of a part; only `errors` if it cannot be measured, all three if drawing fails.

    Parameters
    ----------
    lines : list of str
        Text to print.
    records : list of dict
        Records of the profiles, for JSON and CSV.
    errors : list of str
        Messages of errors, one line each.
    """

    lines: list[str] = field(default_factory=list)
    records: "list[Record]" = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


def read_parts(source: Path | LiveCamera, options: PartOptions) -> Iterator[FilePart]:
    """Yield the profiles of a file in parts, so that a large one is not in memory as a whole.

    Raises
    ------
    LsvisionError
        If the file cannot be read.
    """
    if _holds_images(source, options):
        yield _read_images(source, options)
        return
    for part in iterate_source(Path(str(source)), options.reading):
        several = part.first > 0 or len(part.file.profiles) > 1
        header = _header(options, part.file, part.first)
        yield FilePart(part.file, part.first, several=several, header=header)


def read_whole(source: Path | LiveCamera, options: PartOptions) -> FilePart:
    """Return all profiles of a file as one part; see `read_parts`."""
    if _holds_images(source, options):
        return _read_images(source, options)
    file = read_source(Path(str(source)), options.reading)
    return FilePart(file, several=len(file.profiles) > 1, header=_header(options, file))


def _holds_images(source: Path | LiveCamera, options: PartOptions) -> bool:
    """Return whether a source is read as images, and not as profiles or a height map."""
    if isinstance(source, LiveCamera):
        return True
    if str(source) == STDIN:  # has no suffix: an image if there is a rig that converts it
        return options.imaging is not None
    is_height_map = options.imaging is None and options.reading.get("dx") is not None
    return is_image(source) and not is_height_map


def _read_images(source: Path | LiveCamera, options: PartOptions) -> FilePart:
    images = read_image_source(source, options.imaging)
    return FilePart(images, several=len(images.profiles) > 1, header=_header(options, images))


def measure_files(options: PartOptions, sources: Sequence[Path]) -> list[PartResult]:
    """Read small files, and measure the profiles of all of them at once; a result per file."""
    parts, errors = dict[Path, list[FilePart]](), dict[Path, str]()
    for source in sources:
        try:
            parts[source] = list(read_parts(source, options))
        except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
            errors[source] = error_text(source, error, options)
    all_parts = [part for file_parts in parts.values() for part in file_parts]
    results = iter(measure_parts(options, all_parts))
    return [
        PartResult(errors=[errors[source]])
        if source in errors
        else _join_results([next(results) for _ in parts[source]])
        for source in sources
    ]


def measure_parts(options: PartOptions, parts: Sequence[FilePart]) -> list[PartResult]:
    """Measure the profiles of several parts at once, and draw them.

    Parameters
    ----------
    options : PartOptions
        Options of measuring and drawing.
    parts : sequence of FilePart
        Parts with the profiles.

    Returns
    -------
    list of PartResult
        Result of each part; it has only an error if one of its profiles cannot be measured.
    """
    from lsvision.batch.measure_group import measure_group
    from lsvision.ellipse.section import compute_intervals

    profiles = [profile for part in parts for _, profile in _valid_profiles(part)]
    results = iter(measure_group(options.measuring, profiles))
    measured = [
        _complete_part(options, part, [next(results) for _ in _valid_profiles(part)])
        for part in parts
    ]
    measurements = [section.measurement for sections, _ in measured for section in sections]
    with contextlib.suppress(Exception):  # raised again in `_build_result` of its part
        compute_intervals(cylinder for m in measurements for cylinder in m.cylinders)
    return [
        failure or _build_result(options, part, sections)
        for part, (sections, failure) in zip(parts, measured, strict=True)
    ]


def _valid_profiles(part: FilePart) -> "list[tuple[int, Profile]]":
    """Return the profiles with points, and their indices in the part."""
    return [pair for pair in enumerate(part.file.profiles) if pair[1].lost < len(pair[1])]


def _complete_part(
    options: PartOptions, part: FilePart, results: "Sequence[Measurement | Exception]"
) -> "tuple[list[_Section], PartResult | None]":
    """Return the measured profiles of a part and None; if one failed, none and its error."""
    try:
        sections = [
            _complete_section(options, part, index, result)
            for (index, _), result in zip(_valid_profiles(part), results, strict=True)
        ]
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        return [], PartResult(errors=[error_text(part.file.path, error, options)])
    return sections, None


def _build_result(options: PartOptions, part: FilePart, sections: "list[_Section]") -> PartResult:
    """Return the lines, records and errors of a measured part, after drawing it."""
    try:
        lines = [*part.header]
        for section in sections:
            lines += _section_lines(options, part, section)
        records = _records(part, sections)
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        return PartResult(errors=[error_text(part.file.path, error, options)])
    return PartResult(lines, records, _draw(options, part, sections))


def _join_results(results: Sequence[PartResult]) -> PartResult:
    """Return the results of the parts of a file as one."""
    return PartResult(
        [line for result in results for line in result.lines],
        [record for result in results for record in result.records],
        [error for result in results for error in result.errors],
    )


def error_text(source: Path | LiveCamera, error: Exception, options: PartOptions) -> str:
    """Return the message of an exception that a file caused; with `debug`, print its traceback."""
    if options.debug:
        traceback.print_exception(error, file=sys.stderr)
    if isinstance(error, LsvisionError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"{source}: out of memory: split the file, or use a machine with more memory"
    return f"{source}: {internal_error(error)}"


@dataclass(frozen=True, eq=False)
class _Section:
    """Profile with valid points, its index in the part, and its measurement."""

    index: int
    profile: "Profile"
    measurement: "Measurement"
    upside_down: bool  # cylinders are found only if the heights are negated
    placed: "list[tuple[PlacedCylinder, PlacedCylinder]] | None"  # both possible cylinders


def _complete_section(
    options: PartOptions, part: FilePart, index: int, measurement: "Measurement | Exception"
) -> _Section:
    """Return a measured profile with its cylinders in the robot's frame.

    Raises
    ------
    Exception
        If `measurement` is an exception.
    """
    from lsvision.batch.measure_group import holds_cylinders_upside_down

    profile = part.file.profiles[index]
    if isinstance(measurement, LsvisionError):
        number = part.first + index
        raise LsvisionError(f"{part.file.path}, profile {number}: {measurement}") from measurement
    if isinstance(measurement, Exception):
        raise measurement
    check_flip = not measurement.cylinders and not isinstance(part.file, ImageFile)
    upside_down = check_flip and holds_cylinders_upside_down(options.measuring, profile)
    placed = None
    if options.placing is not None:
        flange = None if part.flanges is None else part.flanges[index]
        placed = options.placing.place(measurement.cylinders, flange)
    return _Section(index, profile, measurement, upside_down, placed)


def _header(options: PartOptions, file: "ProfileFile | ImageFile", first: int = 0) -> list[str]:
    """Return the lines above the results: a summary of the file or part, and notes."""
    valid = (profile for profile in file.profiles if profile.lost < len(profile))
    warnings = [range_warning(profile, options.sensor) for profile in valid]
    notes = [*file.notes, *dict.fromkeys(filter(None, warnings))]
    if options.verbose and not isinstance(file, ImageFile) and file.ignored:
        notes.append(f"columns not used: {', '.join(file.ignored)}")
    name = f"{file.path}, from profile {first} on" if first else str(file.path)
    return [f"{name}: {file.summary}", *(f"  note: {note}" for note in notes)]


def _section_lines(options: PartOptions, part: FilePart, section: _Section) -> list[str]:
    """Return the printed table of a profile, with its number if the file has several."""
    text_lines = measurement_lines(section.measurement, section.profile, verbose=options.verbose)
    if part.several:
        head = f"{_item_name(part.file)} {part.first + section.index}:"
        if section.measurement.cylinders:
            text_lines = [head, *text_lines]
        else:
            text_lines = [f"{head} {text_lines[0]}", *text_lines[1:]]
    lines = [f"  {line}" for line in (*text_lines, *robot_frame_table(section.placed or ()))]
    if section.upside_down:
        remedy = "towards it, use --no-flip" if part.file.flipped else "away from it, use --flip"
        lines.append(
            f"  cylinders are found with the sensor on the other side: if heights grow {remedy}"
        )
    return lines


def _records(part: FilePart, sections: Sequence[_Section]) -> "list[Record]":
    """Return records of all profiles, also of those without valid points."""
    from lsvision.io.results import input_record, measurement_record
    from lsvision.measure import Measurement

    section_by_index = {section.index: section for section in sections}
    name, records = printable_name(part.file.path), []
    for index in range(len(part)):
        section = section_by_index.get(index)
        measurement = Measurement((), ()) if section is None else section.measurement
        reading = None if isinstance(part.file, ImageFile) else input_record(part.file, index)
        records.append(
            measurement_record(
                measurement,
                source=name,
                profile=part.first + index,
                placed=None if section is None else section.placed,
                reading=reading,
                reason=measurement.reason,
            )
        )
    return records


def _draw(options: PartOptions, part: FilePart, sections: Sequence[_Section]) -> list[str]:
    """Draw all pictures of a part; return the errors of those that cannot be written."""
    errors: list[str] = []
    if part.pictures is None:
        return errors
    for section in sections:
        try:
            _draw_section(options, part, section, part.pictures[section.index])
        except Exception as error:  # noqa: BLE001 - the results are kept if a picture fails
            errors.append(error_text(part.file.path, error, options))
    return errors


def _draw_section(options: PartOptions, part: FilePart, section: _Section, path: Path) -> None:
    """Write a picture of a measured profile, drawn into its image if there is one."""
    from lsvision.draw import draw_measurement, draw_overlay, figure_bytes
    from lsvision.files.atomic_files import write_atomic

    title = printable(str(part.file.path))
    if part.several:
        title += f", {_item_name(part.file)} {part.first + section.index}"
    if isinstance(part.file, ImageFile) and options.imaging is not None:
        image, rig = part.file.images[section.index], options.imaging.light_section
        figure = draw_overlay(image, rig, section.profile, section.measurement, title=title)
    else:
        figure = draw_measurement(section.profile, section.measurement, title=title)
    write_atomic(path, figure_bytes(figure, path.suffix[1:].lower()))


def _item_name(file: "ProfileFile | ImageFile") -> str:
    return "frame" if isinstance(file, ImageFile) else "profile"


def _select_profiles(file: "ProfileFile | ImageFile", indices: slice) -> "ProfileFile | ImageFile":
    """Return a file with the profiles at some indices only."""
    if isinstance(file, ImageFile):
        return replace(file, profiles=file.profiles[indices], images=file.images[indices])
    return replace(file, profiles=file.profiles[indices], attributes=file.attributes[indices])
