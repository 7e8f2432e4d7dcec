"""ROS LaserScan: angles and ranges to points, also from the CSV of ``rostopic echo -p``.

Definition (sensor_msgs/LaserScan): ranges in m at ``angle_min + k angle_increment`` in rad, counted
from the x axis (forwards) towards y (left). Ranges below ``range_min`` are lost, and those of
``range_max`` and above: scanners state ``range_max`` where no echo returns. In the section frame X
is the scanner's y and Y the opposite of its x.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_table import numbers_from_cells
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text

SCAN_KEYS = ("angle_min", "angle_increment", "angle_max", "range_min", "range_max")
"""Fields of a LaserScan other than its ranges from which points are computed."""
MAX_SPAN_RAD = 2 * math.pi * 1.01
"""Largest span of the angles of a scan, a revolution and some beams. Units: rad."""
_RANGE_COLUMN = re.compile(r"ranges[\[_.]?[0-9]+\]?")
"""Name of the column of one beam: ``field.ranges0`` without its prefix as ``rostopic echo -p``
writes it, and ``ranges_0``, ``ranges[0]`` or ``ranges.0`` of tables made of messages."""


def is_laser_scan(document: Any) -> bool:
    """Return whether a value is a mapping with the fields of a LaserScan."""
    return (
        isinstance(document, Mapping)
        and isinstance(document.get("ranges"), Sequence)
        and not document.keys().isdisjoint(("angle_min", "angle_increment", "angle_max"))
    )


def profiles_from_scans(scans: Sequence[Mapping[str, Any]]) -> RawProfiles:
    """Return the profiles of LaserScan messages.

    Raises
    ------
    UnreadableFile
        If angles are missing, not numbers, or span more than a revolution, as if in degrees.
    """
    sections = [_compute_section_points(scan) for scan in scans]
    return RawProfiles(
        sections=sections,
        units=("m", "m"),
        notes=("LaserScan: X is the scanner's left, Y the opposite of its forward direction",),
    )


def read_laser_scan(content: bytes, _: ReadSettings) -> RawProfiles:
    """Return the profiles of the CSV that ``rostopic echo -p`` writes, one message a row.

    Raises
    ------
    UnreadableFile
        If there is no column of ranges, no row, or a row is truncated.
    """
    try:
        rows = [row for row in csv.reader(decode_text(content).splitlines()) if row]
    except csv.Error as error:
        raise UnreadableFile(f"an invalid LaserScan table ({error}): record it again") from None
    if not rows:
        raise UnreadableFile("a LaserScan table without a row: record it again")
    names = [name.strip().removeprefix("%").removeprefix("field.") for name in rows[0]]
    range_columns = [k for k, name in enumerate(names) if _RANGE_COLUMN.fullmatch(name)]
    if not range_columns or len(rows) < 2:
        raise UnreadableFile("a LaserScan table without ranges or without a row: record it again")
    scans: list[dict[str, Any]] = []
    for number, row in enumerate(rows[1:], 2):
        if len(row) < len(names):
            raise UnreadableFile(
                f"row {number} has {len(row)} cells, expected {len(names)}: export it again"
            )
        scan: dict[str, Any] = {name: row[k] for k, name in enumerate(names) if name in SCAN_KEYS}
        scan["ranges"] = [row[k] for k in range_columns]
        scans.append(scan)
    return profiles_from_scans(scans)


def _compute_section_points(scan: Mapping[str, Any]) -> FloatArray:
    """Return the (n, 2) points of a scan in the section frame, NaN where lost. Units: m."""
    ranges = np.array([_parse_number(value) for value in scan["ranges"]], dtype=np.float64)
    start, step, stop = (
        _parse_number(scan.get(f"angle_{key}")) for key in ("min", "increment", "max")
    )
    if math.isnan(step) and not math.isnan(stop) and len(ranges) > 1:
        step = (stop - start) / (len(ranges) - 1)
    if not (math.isfinite(start) and math.isfinite(step)) or step == 0 or ranges.size == 0:
        raise UnreadableFile(
            "expected angle_min, angle_increment and ranges of a LaserScan, got only some of them: "
            "export the whole message"
        )
    if abs(step) * (len(ranges) - 1) > MAX_SPAN_RAD:
        raise UnreadableFile(
            f"angles of a LaserScan from {start:g} to {start + step * (len(ranges) - 1):g}, more "
            "than a revolution in rad: convert degrees to rad"
        )
    # A range_max of 0 is a field that was not set: 0 is the default in a message.
    low, high = _parse_number(scan.get("range_min")), _parse_number(scan.get("range_max"))
    with np.errstate(invalid="ignore"):
        lost = ~np.isfinite(ranges) | (ranges <= 0)
        lost |= (ranges < low) if math.isfinite(low) else False
        lost |= (ranges >= high) if math.isfinite(high) and high > 0 else False
    ranges[lost] = np.nan
    angles = start + step * np.arange(len(ranges))
    return np.column_stack([ranges * np.sin(angles), -ranges * np.cos(angles)])


def _parse_number(value: Any) -> float:
    """Return a number or the number in a text; NaN for None and for a word for lost points."""
    if value is None:
        return math.nan
    if isinstance(value, int | float):
        return float(value)
    return float(numbers_from_cells([str(value)])[0])
