"""Scans as JSON; each key names its unit, angles are in degrees."""

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.files.atomic_files import write_atomic
from lsvision.results.quantities import Record

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, TubeShape

SCAN_SCHEMA = "lsvision.scan/1"
"""Name and version of the file."""


def scan_record(
    scan: "ScanMeasurement",
    shapes: "Sequence[TubeShape | None]",
    sources: Sequence[str] = (),
    inputs: Sequence[Record] = (),
) -> Record:
    """Return the record of a scan, ready for JSON.

    Parameters
    ----------
    scan : ScanMeasurement
        Cylinders and rejections.
    shapes : sequence of TubeShape or None
        Shape of each cylinder; None if it has too few sections.
    sources : sequence of str
        Name of each profile's file.
    inputs : sequence of dict
        How each profile was read, from `lsvision.io.results.input_record`.

    Returns
    -------
    dict
        Base frame; lengths in ``*_mm``, angles in ``*_deg``; a number that does not exist (the
        radius of a bow that is none) is None.
    """
    found = scan.to_dict()
    for record, shape in zip(found["cylinders"], shapes, strict=True):
        record["shape"] = None if shape is None else shape.to_dict()
    head = {"schema": SCAN_SCHEMA, "frame": found["frame"], "sources": list(sources)}
    return head | ({"inputs": list(inputs)} if inputs else {}) | found


def write_scan_json(path: str | os.PathLike[str], record: Record) -> None:
    """Write a scan's record, whole or not at all.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    write_atomic(path, scan_json(record))


def scan_json(record: Record) -> str:
    """Return a scan's record as JSON text."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"
