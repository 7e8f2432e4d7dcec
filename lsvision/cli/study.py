"""``lsvision study``: bias and repeatability, or repeatability and reproducibility (gauge R&R)."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.messages import end_on_failures, print_error, print_lines
from lsvision.cli.option_groups import build_command_group, expand_option_groups
from lsvision.cli.outputs import check_outputs, write_output
from lsvision.cli.profile_options import (
    JsonFile,
    KnownRadius,
    Radius,
    ReadingOptions,
    SensorOptions,
)
from lsvision.cli.sources import find_sources, list_suffixes_of_profiles, read_sources
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import STDOUT
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from lsvision.geometry import FloatArray
    from lsvision.io.profiles import ProfileFile
    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.results.result import Result

study = build_command_group(
    "study", "Studies of the measurement: bias, repeatability and reproducibility."
)

Tolerance = Annotated[
    float | None, typer.Option(metavar="WIDTH", help="Width of the tolerance, above 0.")
]
Level = Annotated[float, typer.Option(metavar="P", help="Confidence level of the intervals.")]
MAX_NAMES = 6
"""Largest number of parts, and of operators, that a message names."""
QUANTITIES = ("radius", "theta", "phi", "centre-x", "centre-y")
"""Values of --quantity, in the order of `CylinderSection.estimates`."""


@study.command()
@expand_option_groups
def repeat(
    *,
    files: Annotated[
        list[str], typer.Argument(metavar="FILE|DIR|GLOB", help="Repeated profiles of one part.")
    ],
    reference: Annotated[
        float, typer.Option(metavar="VALUE", help="Reference value of the part, mm or deg.")
    ],
    quantity: Annotated[
        str, typer.Option(metavar="NAME", help=f"One of {', '.join(QUANTITIES)}.")
    ] = "radius",
    tolerance: Tolerance = None,
    level: Level = 0.95,
    radius: Radius = None,
    known_radius: KnownRadius = None,
    sensor: SensorOptions,
    json_file: JsonFile = None,
    reading: ReadingOptions,
) -> None:
    """Bias and repeatability of one part measured many times: a type-1 study.

    Of several cylinders in a profile, the one whose quantity is nearest to the reference is
    evaluated.

    \b
      lsvision study repeat 'repeats/*.csv' --reference 19.0 --tolerance 0.4
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.cli.measure_options import parse_known_radius, parse_search_range
    from lsvision.inspection.repeat_study import study_repeats
    from lsvision.measure import measure_cylinders

    if quantity not in QUANTITIES:
        raise typer.BadParameter(
            f"expected --quantity among {', '.join(QUANTITIES)}, got {quantity!r}"
        )
    if quantity == "radius" and known_radius is not None:
        raise typer.BadParameter(
            "expected --known-radius with another --quantity than radius: its values would be the "
            "known radius"
        )
    _check_limits(tolerance, level)
    if not math.isfinite(reference):
        raise typer.BadParameter(f"expected a finite --reference, got {reference:g}")
    measure_function = partial(
        measure_cylinders,
        radius=parse_search_range(radius),
        known_radius=parse_known_radius(known_radius),
        sensor=sensor.parse(),
    )
    options = reading.parse()
    sources, missing = find_sources(files, list_suffixes_of_profiles(reading.dx))
    check_outputs((), sources, streams=(json_file,))
    end_on_failures(missing)
    profiles = read_sources(sources, options)
    values, stds = _measure_quantity(profiles, quantity, reference, measure_function)
    result = study_repeats(values, reference, stds=stds, tolerance=tolerance, level=level)
    unit = "deg" if quantity in ("theta", "phi") else "mm"
    _print_result(result, json_file, f"{quantity} in {unit}:")


@study.command()
def grr(
    table: Annotated[
        Path, typer.Argument(metavar="TABLE.csv", help="One measurement per row, with a header.")
    ],
    value: Annotated[str, typer.Option(metavar="COLUMN", help="Measured value.")] = "value",
    part: Annotated[str, typer.Option(metavar="COLUMN", help="Part.")] = "part",
    operator: Annotated[str, typer.Option(metavar="COLUMN", help="Operator.")] = "operator",
    tolerance: Tolerance = None,
    level: Level = 0.95,
    json_file: JsonFile = None,
) -> None:
    """Repeatability and reproducibility of a crossed study, by analysis of variance.

    Every operator measures every part the same number of times. An interaction with p above 0.25 is
    pooled with the repeatability (AIAG MSA).

    \b
      lsvision study grr table.csv --tolerance 4
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.inspection.gauge_study import study_gauge

    _check_limits(tolerance, level)
    check_outputs((), [table], streams=(json_file,))
    result = study_gauge(_read_crossed(table, value, part, operator), tolerance, level)
    _print_result(result, json_file)


def _check_limits(tolerance: float | None, level: float) -> None:
    """Raise a usage error unless the tolerance is positive and the level is in (0, 1)."""
    if tolerance is not None and not 0 < tolerance < math.inf:
        raise typer.BadParameter(f"expected --tolerance above 0, got {tolerance:g}")
    if not 0 < level < 1:
        raise typer.BadParameter(f"expected --level between 0 and 1, got {level:g}")


def _print_result(result: "Result", json_file: Path | None, *head: str) -> None:
    """Print a result below the lines `head`, and write its JSON to a file if there is one.

    If the JSON goes to stdout, the lines are printed on stderr.
    """
    print_lines([*head, *str(result).splitlines()], err=json_file == STDOUT)
    if json_file is not None:
        write_output(json_file, result.to_json(indent=2) + "\n")


def _measure_quantity(
    files: "Sequence[ProfileFile]",
    quantity: str,
    reference: float,
    measure_function: "Callable[[Profile], Measurement]",
) -> tuple[list[float], list[float]]:
    """Return the value and standard uncertainty of each profile with a cylinder, in mm or deg.

    The quantity is one of `QUANTITIES`; of several cylinders the one nearest to the reference is
    taken. A theta is stated within 90 deg of the reference, since theta + 180 deg is the same
    direction: 179.9 deg is -0.1 deg beside a reference of 0. A cylinder of another size than most
    is reported.
    """
    index = QUANTITIES.index(quantity)
    values, stds = [], []
    radii: dict[str, float] = {}
    for file in files:
        for number, profile in enumerate(file.profiles):
            measurement = measure_function(profile)
            estimates = [cylinder.estimates[index] for cylinder in measurement.cylinders]
            if not estimates:
                print_error(f"{file.path}, profile {number}: no cylinder, left out")
                continue
            pairs = [(estimate.value, estimate.std) for estimate in estimates]
            if quantity == "theta":
                pairs = [(reference + (v - reference + 90) % 180 - 90, std) for v, std in pairs]
            nearest = min(range(len(pairs)), key=lambda k: abs(pairs[k][0] - reference))
            values.append(pairs[nearest][0])
            stds.append(pairs[nearest][1])
            radii[f"{file.path}, profile {number}"] = measurement.cylinders[nearest].radius
    _report_other_cylinders(radii)
    return values, stds


def _report_other_cylinders(radii: dict[str, float]) -> None:
    """Print a note on each profile whose cylinder has another size than most, by its name."""
    from statistics import median

    from lsvision.inspection.matching import MAX_RADIUS_DEVIATION

    for name, radius in radii.items():
        usual = median(radii.values())
        if abs(radius / usual - 1) > MAX_RADIUS_DEVIATION:
            print_error(
                f"{name}: its cylinder of radius {radius:.4g} mm counts, most have {usual:.4g} mm: "
                "another part? Leave the profile out, or limit the search by --radius"
            )


def _read_crossed(path: Path, value: str, part: str, operator: str) -> "FloatArray":
    """Return the values of a balanced study, (parts, operators, trials).

    `value`, `part` and `operator` are the names of their columns.

    Raises
    ------
    LsvisionError
        If the file cannot be read, or an operator has not measured each part equally often.
    """
    import numpy as np

    try:
        trials = _read_trials(path, value, part, operator)
    except csv.Error as error:  # a cell of more than 128 KiB
        raise UnreadableFile(f"{path}: {error}: close each quote") from None
    parts = list(dict.fromkeys(part_name for part_name, _ in trials))
    operators = list(dict.fromkeys(operator_name for _, operator_name in trials))
    counts = {len(values) for values in trials.values()}
    if not trials:
        raise LsvisionError(
            f"{path}: expected rows with values, got none below the header: add them"
        )
    if len(trials) != len(parts) * len(operators) or len(counts) != 1:
        raise LsvisionError(
            f"{path}: expected every operator to measure every part equally often, got "
            f"{len(trials)} of {len(parts) * len(operators)} pairs with {min(counts)} to "
            f"{max(counts)} trials ({_format_names(parts, operators)}): add the missing rows"
        )
    if min(len(parts), len(operators), *counts) < 2:
        raise LsvisionError(
            f"{path}: expected two or more parts, operators and trials of each pair, got "
            f"{_format_names(parts, operators)}; {format_count(min(counts), 'trial')}: measure "
            "more, or write each name in one way"
        )
    return np.array([[trials[part_name, name] for name in operators] for part_name in parts])


def _format_names(parts: Sequence[str], operators: Sequence[str]) -> str:
    """Return the names of parts and operators, so that one spelled in two ways is noticed."""
    return f"parts {_format_first_names(parts)}; operators {_format_first_names(operators)}"


def _format_first_names(names: Sequence[str]) -> str:
    """Return at most `MAX_NAMES` names."""
    more = ", ..." if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more


def _read_trials(
    path: Path, value: str, part: str, operator: str
) -> dict[tuple[str, str], list[float]]:
    """Return the values of each pair of part and operator, in the order of the file."""
    from lsvision.files.limited_reading import read_text

    stream = io.StringIO(read_text(path), newline=None)  # lines may end in a carriage return
    separator = max(",;\t", key=stream.readline().count)
    stream.seek(0)
    rows = csv.DictReader(stream, delimiter=separator)
    names = [name.strip() for name in rows.fieldnames or ()]
    _check_columns(path, names, (value, part, operator))
    trials: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        location = f"{path}, line {rows.line_num}"
        # A short row has None in place of a cell, a long one has a list of further cells at None.
        if any(cell.strip() for cell in row.get(None, ())):
            raise UnreadableFile(
                f"{location}: expected {len(names)} cells, got more: separate columns by ; if "
                "numbers have a decimal comma"
            )
        cells = {str(name).strip(): str(cell or "").strip() for name, cell in row.items()}
        if not any(cells.values()):  # below the table of a spreadsheet
            continue
        # A comma that does not separate columns is a decimal comma.
        number = cells[value] if separator == "," else cells[value].replace(",", ".")
        trial, names_of_pair = _parse_number(number), (cells[part], cells[operator])
        if trial is None:
            raise UnreadableFile(
                f"{location}: expected a number in {value!r}, got {cells[value]!r}: write it, or "
                "leave the row out"
            )
        if not all(names_of_pair):
            raise UnreadableFile(
                f"{location}: expected a name in {part!r} and in {operator!r}, got an empty cell: "
                "write it"
            )
        trials.setdefault(names_of_pair, []).append(trial)
    return trials


def _check_columns(path: Path, names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise UnreadableFile unless a table has one column of each of the `needed` names."""
    for column in needed:
        if names.count(column) > 1:
            raise UnreadableFile(
                f"{path}: expected one column {column!r}, got several: rename the others"
            )
        if column not in names:
            raise UnreadableFile(
                f"{path}: expected a column {column!r}, got {', '.join(names) or 'none'}: name it "
                "with --value, --part or --operator"
            )


def _parse_number(text: str) -> float | None:
    """Return a finite number; None if the text is none."""
    if "_" in text:  # which separates digits in Python only
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
