"""Measurements as JSON and CSV; each key names its unit, angles are in degrees."""

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TextIO

from lsvision.ellipse.section_table import SECTION_COLUMNS, build_section_row
from lsvision.files.printable import escape_cell
from lsvision.results.quantities import Record, build_coordinate_columns, replace_nonfinite

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.io.profiles import ProfileFile
    from lsvision.measure import Measurement

RECORD_SCHEMA = "lsvision.measurement/1"
"""Name and version of one record."""
FILE_SCHEMA = "lsvision.measurements/1"
"""Name and version of a JSON file of records."""

MAX_CELL_LENGTH = 2**31 - 1
"""Largest length of a cell that the CSV module reads back: a text of a file may be of any length,
and a C long has 32 bits on Windows. Units: characters."""

FRAMES = ("base", "flange")
"""Frames of a robot in which cylinders are placed."""


def build_measurement_record(
    measurement: "Measurement",
    *,
    source: str = "",
    profile: int = 0,
    placed: "Sequence[tuple[PlacedCylinder, PlacedCylinder]] | None" = None,
    reading: Record | None = None,
    reason: str | None = None,
) -> Record:
    """Return the record of a profile's measurement, ready for JSON.

    Lengths are in ``*_mm``, angles in ``*_deg``; ``*_interval_95_*`` is ``[low, high]``; a number
    that does not exist (the sigma of an angle that is not determined) is None.

    Parameters
    ----------
    measurement : Measurement
        Cylinders and rejections.
    source, profile
        Name of the file, and index of the profile in it, from 0.
    placed : sequence of pairs of PlacedCylinder, optional
        The two cylinders that fit each section equally well, in the robot's frame; they become
        ``base_frame`` or ``flange_frame`` of its record.
    reading : dict, optional
        How the profile was read, from `build_input_record`; it becomes ``input`` of the record.
    reason : str, optional
        Reason why the profile has no cylinder; left out if it has one.
    """
    values = measurement.to_dict()
    if placed is not None:
        for record, twins in zip(values["cylinders"], placed, strict=True):
            record[f"{twins[0].frame}_frame"] = _build_placed_record(twins)
    record = {
        "schema": RECORD_SCHEMA,
        "source": source,
        "profile": profile,
        **({} if reading is None else {"input": reading}),
        **values,
    }
    if not values["cylinders"] and reason is not None:
        record["reason"] = reason
    return record


def build_input_record(file: "ProfileFile", profile: int) -> Record:
    """Return how a profile of a file was read: reader, units, lost points, attributes."""
    record: Record = {
        "reader": file.reader,
        "units": file.units,
        "units_assumed": file.units_assumed,
        "heights_turned": file.flipped,
        "lost_points": file.profiles[profile].lost,
        "lost_markers": [
            {"value": marker.text, "points_of_file": marker.count, "guessed": marker.guessed}
            for marker in file.markers
        ],
    }
    if file.attributes:
        record["attributes"] = {
            name: replace_nonfinite(value) if isinstance(value, float) else value
            for name, value in file.attributes[profile].items()
        }
    return record


class JsonFormat:
    """Format of a JSON document of records, each record on a line.

    An instance writes one document: the separator before a record depends on the previous ones.
    """

    head = f'{{\n  "schema": {json.dumps(FILE_SCHEMA)},\n  "measurements": ['
    tail = "\n  ]\n}\n"

    def __init__(self) -> None:
        self._separator = "\n"

    def prepare(self, records: Sequence[Record]) -> bool:  # noqa: ARG002 - any record fits
        """Return False: the head never changes."""
        return False

    def format_item(self, record: Record) -> str:
        """Return the text of the next record on one line; indented text takes ten times as long."""
        separator, self._separator = self._separator, ",\n"
        return f"{separator}    {json.dumps(record, allow_nan=False)}"

    def convert(self, text: TextIO, head: str) -> Iterator[str]:  # noqa: ARG002 - the head never changes
        """Yield the text of records unchanged."""
        yield from text


CSV_COLUMNS = ("source", "profile", "cylinder", *SECTION_COLUMNS)
"""First columns; those of the robot's frame, attributes of the file and the reason follow."""


class CsvFormat:
    """Format of a CSV table of records.

    A cylinder is a row; a profile without one is a row with the reason and empty numbers.
    Intervals are two columns, ``*_low_*`` and ``*_high_*``; in the robot's frame the point and
    both directions have theirs. Attributes of a profile in the file come before the
    reason. Rejections, covariances and the indices of points are left to JSON.

    Parameters
    ----------
    frame : {"base", "flange"}, optional
        Frame of the robot in which cylinders are placed.
    """

    tail = ""

    def __init__(self, frame: str | None = None) -> None:
        self._fixed = [*CSV_COLUMNS, *([] if frame is None else _list_placed_columns(frame))]
        self._attributes: dict[str, str] = {}

    @property
    def head(self) -> str:
        """Return the header line."""
        return self._format_lines([dict(zip(self._columns, self._columns, strict=True))])

    def prepare(self, records: Sequence[Record]) -> bool:
        """Add a column for each new attribute of the records; return whether there is one.

        Attributes without a column are left out of the rows.
        """
        previous_count = len(self._attributes)
        for record in records:
            for name in _collect_attributes(record):
                if name not in self._attributes:
                    column = escape_cell(name)
                    while column in self._columns:
                        column = f"{column}_in_file"
                    self._attributes[name] = column
        return len(self._attributes) > previous_count

    def format_item(self, record: Record) -> str:
        """Return the rows of the next record."""
        rows = [
            _build_csv_row(record, k, cylinder) for k, cylinder in enumerate(record["cylinders"])
        ]
        if not rows:
            source = {"source": record["source"], "profile": record["profile"]}
            rows = [source | {"reason": record.get("reason", "")}]
        attributes = {
            self._attributes[name]: value
            for name, value in _collect_attributes(record).items()
            if name in self._attributes
        }
        return self._format_lines([row | attributes for row in rows])

    def convert(self, text: TextIO, head: str) -> Iterator[str]:
        """Yield rows written under another header with the columns of the present one."""
        limit = csv.field_size_limit(MAX_CELL_LENGTH)
        try:
            (columns,) = csv.reader([head])
            for row in csv.DictReader(text, columns):
                yield self._format_lines([row])
        finally:
            csv.field_size_limit(limit)

    @property
    def _columns(self) -> list[str]:
        return [*self._fixed, *self._attributes.values(), "reason"]

    def _format_lines(self, rows: Sequence[Record]) -> str:
        text = io.StringIO()
        csv.DictWriter(text, self._columns, lineterminator="\n").writerows(rows)
        return text.getvalue()


def _build_placed_record(twins: "tuple[PlacedCylinder, PlacedCylinder]") -> Record:
    """Return the record of a cylinder in the robot's frame, with both possible directions."""
    from lsvision.cylinder.robot_frame import PLACED_COVARIANCE_ORDER

    first, _ = twins
    return {
        "point_mm": first.point.tolist(),
        "point_std_mm": first.point_std.tolist(),
        "includes_calibration": first.includes_calibration,
        "covariance_order": PLACED_COVARIANCE_ORDER,
        "twins": [twin.direction_record for twin in twins],
    }


def _build_csv_row(record: Record, number: int, cylinder: Record) -> Record:
    row: Record = {"source": record["source"], "profile": record["profile"], "cylinder": number}
    row |= build_section_row(cylinder)
    for frame in FRAMES:
        if f"{frame}_frame" in cylinder:
            row |= _build_placed_row(frame, cylinder[f"{frame}_frame"])
    return row


def _collect_attributes(record: Record) -> dict[str, Any]:
    """Return the attributes of a profile; a spreadsheet must not evaluate the texts as formulas."""
    attributes: dict[str, Any] = record.get("input", {}).get("attributes", {})
    return {
        name: escape_cell(value) if isinstance(value, str) else value
        for name, value in attributes.items()
    }


def _list_placed_columns(frame: str) -> list[str]:
    """Return the names of the columns of a cylinder in the robot's frame."""
    numbers = [0.0, 0.0, 0.0]
    twin = {"direction": numbers, "direction_std_deg": 0.0}
    empty = {
        "point_mm": numbers,
        "point_std_mm": numbers,
        "twins": [twin, twin],
        "includes_calibration": False,
    }
    return list(_build_placed_row(frame, empty))


def _build_placed_row(frame: str, placed: Mapping[str, Any]) -> Record:
    """Return the columns of a record from `_build_placed_record`."""
    row: Record = {}
    for name, numbers in (("point", placed["point_mm"]), ("point_std", placed["point_std_mm"])):
        row |= build_coordinate_columns(f"{frame}_{name}", numbers, "_mm")
    for sign, twin in zip(("plus", "minus"), placed["twins"], strict=True):
        name = f"{frame}_direction_{sign}"
        row |= build_coordinate_columns(name, twin["direction"])
        row[f"{name}_std_deg"] = twin["direction_std_deg"]
    row["includes_calibration"] = placed["includes_calibration"]
    return row
