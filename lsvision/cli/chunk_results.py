"""Tasks of ``lsvision measure``: files, or profiles of a file, in; printed text and records out.

Neither this module nor those that it imports import typer, so that a process starts faster.
"""

import contextlib
import math
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.file_chunk import FileChunk, FileOptions, read_chunks
from lsvision.cli.image_sources import ImageFile, LiveCamera
from lsvision.cli.messages import describe_internal_error
from lsvision.cli.robot_frame import format_robot_frame_table
from lsvision.errors import LsvisionError
from lsvision.files.limited_reading import limit_file_size
from lsvision.files.printable import escape_name, escape_text

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.detection.arcs import Rejection
    from lsvision.ellipse.section import CylinderSection
    from lsvision.io.profiles import ProfileFile
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.results.quantities import Record


@dataclass(frozen=True)
class ChunkResult:
    """Lines to print, and records of the profiles for JSON and CSV, of a chunk.

    It has only errors, a line each, if it cannot be measured; a picture may fail alone.
    """

    lines: list[str] = field(default_factory=list)
    records: "list[Record]" = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


def measure_files(options: FileOptions, sources: Sequence[Path]) -> list[ChunkResult]:
    """Read files, and measure the profiles of all of them at once; return a result for each file.

    All their profiles are in memory together: for small files.
    """
    chunks, errors = dict[Path, list[FileChunk]](), dict[Path, str]()
    for source in sources:
        try:
            chunks[source] = list(read_chunks(source, options))
        except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
            errors[source] = format_error(source, error, options)
    all_chunks = [chunk for file_chunks in chunks.values() for chunk in file_chunks]
    results = iter(_measure_chunks(options, all_chunks))
    return [
        ChunkResult(errors=[errors[source]])
        if source in errors
        else _join_results([next(results) for _ in chunks[source]])
        for source in sources
    ]


def _measure_chunks(options: FileOptions, chunks: Sequence[FileChunk]) -> list[ChunkResult]:
    """Measure the profiles of several chunks at once, and draw them; return a result for each.

    It has only an error if one of the chunk's profiles cannot be measured.
    """
    from lsvision.batch.measure_group import measure_group
    from lsvision.ellipse.section import precompute_intervals

    profiles = [profile for chunk in chunks for _, profile in _select_valid_profiles(chunk)]
    results = iter(measure_group(options.measure_function, profiles))
    measured = [
        _complete_chunk(options, chunk, [next(results) for _ in _select_valid_profiles(chunk)])
        for chunk in chunks
    ]
    measurements = [section.measurement for sections, _ in measured for section in sections]
    # All intervals at once are faster; `_build_result` raises an exception of its chunk again.
    with contextlib.suppress(Exception):
        precompute_intervals(cylinder for m in measurements for cylinder in m.cylinders)
    return [
        failure or _build_result(options, chunk, sections)
        for chunk, (sections, failure) in zip(chunks, measured, strict=True)
    ]


def _select_valid_profiles(chunk: FileChunk) -> "list[tuple[int, Profile]]":
    """Return the indices in the chunk of the profiles with a valid point, and these profiles."""
    return [pair for pair in enumerate(chunk.file.profiles) if pair[1].lost < len(pair[1])]


def _complete_chunk(
    options: FileOptions, chunk: FileChunk, results: "Sequence[Measurement | Exception]"
) -> "tuple[list[_Section], ChunkResult | None]":
    """Return the measured profiles of a chunk and None; if one failed, no profile and its error."""
    try:
        sections = [
            _complete_section(options, chunk, index, result)
            for (index, _), result in zip(_select_valid_profiles(chunk), results, strict=True)
        ]
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        return [], ChunkResult(errors=[format_error(chunk.file.path, error, options)])
    return sections, None


def _build_result(
    options: FileOptions, chunk: FileChunk, sections: "list[_Section]"
) -> ChunkResult:
    """Return the lines, records and errors of a measured chunk, after drawing it."""
    try:
        lines = [*chunk.header]
        for section in sections:
            lines += _format_section_lines(options, chunk, section)
        records = _build_records(chunk, sections)
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        return ChunkResult(errors=[format_error(chunk.file.path, error, options)])
    return ChunkResult(lines, records, _draw(options, chunk, sections))


def _join_results(results: Sequence[ChunkResult]) -> ChunkResult:
    """Return the results of the chunks of a file as one."""
    return ChunkResult(
        [line for result in results for line in result.lines],
        [record for result in results for record in result.records],
        [error for result in results for error in result.errors],
    )


def format_error(source: Path | LiveCamera, error: Exception, options: FileOptions) -> str:
    """Return the message of an exception that a file caused, after printing its traceback.

    The traceback is printed with ``--debug`` only.
    """
    if options.debug:
        traceback.print_exception(error, file=sys.stderr)
    if isinstance(error, LsvisionError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"{source}: out of memory: split the file, or use a machine with more memory"
    return f"{source}: {describe_internal_error(error)}"


@dataclass(frozen=True, eq=False)
class _Section:
    """Profile with valid points, its index in the chunk, and its measurement."""

    index: int
    profile: "Profile"
    measurement: "Measurement"
    flip_hint: str  # if cylinders are found only after the heights are negated
    placed: "list[tuple[PlacedCylinder, PlacedCylinder]] | None"  # both possible ones of each


def _complete_section(
    options: FileOptions, chunk: FileChunk, index: int, result: "Measurement | Exception"
) -> _Section:
    """Return a measured profile with its cylinders in the robot's frame.

    Raises
    ------
    Exception
        If `result` is an exception.
    """
    from lsvision.batch.measure_group import holds_cylinders_upside_down, require_measurement

    profile = chunk.file.profiles[index]
    measurement = require_measurement(result, chunk.file.path, chunk.first + index)
    placed, flip_hint = None, ""
    if (
        not measurement.cylinders
        and not isinstance(chunk.file, ImageFile)
        and holds_cylinders_upside_down(options.measure_function, profile)
    ):
        direction, option = (
            ("towards", "--no-flip") if chunk.file.flipped else ("away from", "--flip")
        )
        flip_hint = (
            "cylinders are found with the sensor on the other side: if heights grow "
            f"{direction} the sensor, use {option}"
        )
    if options.robot_frame is not None:
        flange = None if chunk.flanges is None else chunk.flanges[index]
        placed = options.robot_frame.place(measurement.cylinders, flange)
    return _Section(index, profile, measurement, flip_hint, placed)


def _format_section_lines(options: FileOptions, chunk: FileChunk, section: _Section) -> list[str]:
    """Return the printed table of a profile, with its number if the file has several."""
    text_lines = format_measurement_lines(
        section.measurement, section.profile, verbose=options.verbose
    )
    if chunk.several:
        head = f"{_name_item(chunk.file)} {chunk.first + section.index}:"
        if section.measurement.cylinders:
            text_lines = [head, *text_lines]
        else:
            text_lines = [f"{head} {text_lines[0]}", *text_lines[1:]]
    lines = [f"  {line}" for line in (*text_lines, *format_robot_frame_table(section.placed or ()))]
    return [*lines, f"  {section.flip_hint}"] if section.flip_hint else lines


def _build_records(chunk: FileChunk, sections: Sequence[_Section]) -> "list[Record]":
    """Return records of all profiles, also of those without valid points."""
    from lsvision.io.results import build_input_record, build_measurement_record
    from lsvision.measure import Measurement

    section_by_index = {section.index: section for section in sections}
    name, records = escape_name(chunk.file.path), []
    for index in range(len(chunk)):
        section = section_by_index.get(index)
        measurement = Measurement((), ()) if section is None else section.measurement
        reading = (
            None if isinstance(chunk.file, ImageFile) else build_input_record(chunk.file, index)
        )
        records.append(
            build_measurement_record(
                measurement,
                source=name,
                profile=chunk.first + index,
                placed=None if section is None else section.placed,
                reading=reading,
                reason=measurement.reason,
            )
        )
    return records


def _draw(options: FileOptions, chunk: FileChunk, sections: Sequence[_Section]) -> list[str]:
    """Draw all pictures of a chunk; return the errors of those that cannot be written."""
    errors: list[str] = []
    if chunk.pictures is None:
        return errors
    for section in sections:
        try:
            _draw_section(options, chunk, section, chunk.pictures[section.index])
        except Exception as error:  # noqa: BLE001 - the results are kept if a picture fails
            errors.append(format_error(chunk.file.path, error, options))
    return errors


def _draw_section(options: FileOptions, chunk: FileChunk, section: _Section, path: Path) -> None:
    """Write a picture of a measured profile, drawn into its image if there is one."""
    from lsvision.draw import draw_measurement, draw_overlay
    from lsvision.draw.figures import write_figure

    title = escape_text(str(chunk.file.path))
    if chunk.several:
        title += f", {_name_item(chunk.file)} {chunk.first + section.index}"
    if isinstance(chunk.file, ImageFile) and options.imaging is not None:
        image, rig = chunk.file.images[section.index], options.imaging.light_section
        figure = draw_overlay(image, rig, section.profile, section.measurement, title=title)
    else:
        figure = draw_measurement(section.profile, section.measurement, title=title)
    write_figure(path, figure)


def _name_item(file: "ProfileFile | ImageFile") -> str:
    """Return what an item of a file is called in the output."""
    return "frame" if isinstance(file, ImageFile) else "profile"


def format_measurement_lines(
    measurement: "Measurement", profile: "Profile", *, verbose: bool
) -> list[str]:
    """Return the lines of a profile's table, or why there is no cylinder, and the rejected arcs.

    The rejected arcs, in the order of the profile, and notes on correlated residuals are added if
    `verbose`.
    """
    from lsvision.ellipse.section_table import format_section_cells
    from lsvision.results.summaries import format_count
    from lsvision.results.tables import format_text_table

    rejections = sorted(measurement.rejections, key=lambda r: (r.arc.start, r.arc.stop))
    rejected = f"{format_count(len(rejections), 'arc')} rejected"
    lines = format_text_table(format_section_cells(measurement.cylinders))
    if not measurement.cylinders:
        reason = measurement.reason
        more = f" ({rejected}: -v lists them)" if len(rejections) > 1 and not verbose else ""
        lines = [f"no cylinder found: {reason}{more}"]
    if verbose:
        lines += _list_correlation_notes(measurement.cylinders)
    if verbose and rejections:
        lines += [
            f"{rejected}:",
            *(_format_rejection_line(rejection, profile) for rejection in rejections),
        ]
    return lines


def _list_correlation_notes(cylinders: Sequence["CylinderSection"]) -> list[str]:
    """Return a note for each cylinder whose intervals are wider for correlated residuals."""
    return [
        f"  {number}: residuals correlated over {cylinder.residual_correlation:.1f} points along "
        "the line: intervals widened (the sensor smooths, or the cylinder is not exact)"
        for number, cylinder in enumerate(cylinders, 1)
        if cylinder.residual_correlation > 1
    ]


def _format_rejection_line(rejection: "Rejection", profile: "Profile") -> str:
    """Return the indices of a rejected arc's points, its range of x and the reason as one line."""
    arc = rejection.arc
    x = arc.of(profile)[:, 0]
    finite = [value for value in x.tolist() if math.isfinite(value)]
    where = f", x {min(finite):.1f} to {max(finite):.1f} mm" if finite else ""
    return f"  points {arc.start} to {arc.stop - 1}{where}: {rejection.reason}"


@dataclass(frozen=True, eq=False)
class MeasureTask:
    """Small files, read in the task, or a chunk of a larger one, or the error of reading it.

    `first` is the number of the first file, from 0. `profiles_read` is the number of profiles of
    the larger file that have been read so far.
    """

    first: int
    sources: tuple[Path | LiveCamera, ...]
    chunk: FileChunk | None = None
    profiles_read: int = 0
    error: str = ""


def measure_task(options: FileOptions, task: MeasureTask) -> list[ChunkResult]:
    """Return the results of a task: one for each small file, or one for the chunk or the error."""
    if task.error:
        return [ChunkResult(errors=[task.error])]
    if task.chunk is not None:
        return _measure_chunks(options, [task.chunk])
    with limit_file_size(options.max_size):
        return measure_files(options, [Path(str(source)) for source in task.sources])
