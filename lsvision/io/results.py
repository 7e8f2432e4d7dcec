"""Measurements as JSON and CSV; each key names its unit, angles are in degrees."""

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lsvision.cylinder.robot_frame import PLACED_COVARIANCE_ORDER
from lsvision.ellipse.section_table import SECTION_COLUMNS, section_row
from lsvision.io.atomic_files import write_atomic
from lsvision.results.quantities import Record

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import PlacedCylinder
    from lsvision.measure import Measurement

RECORD_SCHEMA = "lsvision.measurement/1"
"""Name and version of one record."""
FILE_SCHEMA = "lsvision.measurements/1"
"""Name and version of a JSON file of records."""


def measurement_record(
    measurement: "Measurement",
    *,
    source: str = "",
    profile: int = 0,
    placed: "Sequence[tuple[PlacedCylinder, PlacedCylinder]] | None" = None,
) -> Record:
    """Record of one profile's measurement, ready for JSON.

    Parameters
    ----------
    measurement : Measurement
        Cylinders and rejections.
    source : str
        Name of the file that the profile came from.
    profile : int
        Place of the profile in its file, from 0.
    placed : sequence of pairs of PlacedCylinder, optional
        Both cylinders of each section in the robot's frame; they become ``base_frame`` or
        ``flange_frame`` of its record.

    Returns
    -------
    dict
        Lengths in ``*_mm``, angles in ``*_deg``; ``interval_95`` are ``[low, high]``; a number
        that does not exist (the sigma of an angle that is not determined) is None.
    """
    found = measurement.to_dict()
    if placed is not None:
        for record, twins in zip(found["cylinders"], placed, strict=True):
            record[f"{twins[0].frame}_frame"] = _placed_record(twins)
    return {"schema": RECORD_SCHEMA, "source": source, "profile": profile, **found}


def write_json(path: str | os.PathLike[str], records: Sequence[Record]) -> None:
    """Write records to one JSON file, whole or not at all.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    document = {"schema": FILE_SCHEMA, "measurements": list(records)}
    write_atomic(path, json.dumps(document, indent=2, allow_nan=False) + "\n")


def write_csv(path: str | os.PathLike[str], records: Sequence[Record]) -> None:
    """Write the cylinders of records to one CSV file, a cylinder a row, whole or not at all.

    Intervals become two columns, ``*_low_*`` and ``*_high_*``; in the robot's frame the point and
    both directions have theirs. Rejections, covariances and the indices of points are left to
    JSON; a profile without a cylinder has no row.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    text = io.StringIO()
    rows = [
        _csv_row(record, place, cylinder)
        for record in records
        for place, cylinder in enumerate(record["cylinders"])
    ]
    columns = rows[0] if rows else ("source", "profile", "cylinder", *SECTION_COLUMNS)
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(path, text.getvalue())


def _placed_record(twins: "tuple[PlacedCylinder, PlacedCylinder]") -> Record:
    first, _ = twins
    return {
        "point_mm": first.point.tolist(),
        "point_std_mm": first.point_std.tolist(),
        "includes_calibration": first.includes_calibration,
        "covariance_order": PLACED_COVARIANCE_ORDER,
        "twins": [twin.direction_record for twin in twins],
    }


def _csv_row(record: Record, place: int, cylinder: Record) -> Record:
    row: Record = {"source": record["source"], "profile": record["profile"], "cylinder": place}
    row |= section_row(cylinder)
    for frame in ("base", "flange"):
        if f"{frame}_frame" in cylinder:
            row |= _placed_row(frame, cylinder[f"{frame}_frame"])
    return row


def _placed_row(frame: str, placed: Mapping[str, Any]) -> Record:
    row: Record = {}
    for name, numbers in (("point", placed["point_mm"]), ("point_std", placed["point_std_mm"])):
        row |= {f"{frame}_{name}_{axis}_mm": n for axis, n in zip("xyz", numbers, strict=True)}
    for sign, twin in zip(("plus", "minus"), placed["twins"], strict=True):
        name = f"{frame}_direction_{sign}"
        row |= {f"{name}_{axis}": n for axis, n in zip("xyz", twin["direction"], strict=True)}
        row[f"{name}_std_deg"] = twin["direction_std_deg"]
    row["includes_calibration"] = placed["includes_calibration"]
    return row
