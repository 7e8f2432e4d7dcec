"""Scans as JSON; each key names its unit, angles are in degrees."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.results.quantities import Record

if TYPE_CHECKING:
    from lsvision.scan import ScanMeasurement, TubeShape

SCAN_SCHEMA = "lsvision.scan/1"
"""Name and version of the file's format."""


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
        bow radius of a straight tube) is None.
    """
    scan_dict = scan.to_dict()
    for record, shape in zip(scan_dict["cylinders"], shapes, strict=True):
        record["shape"] = None if shape is None else shape.to_dict()
    head = {"schema": SCAN_SCHEMA, "frame": scan_dict["frame"], "sources": list(sources)}
    return head | ({"inputs": list(inputs)} if inputs else {}) | scan_dict


def scan_json(record: Record) -> str:
    """Return a scan's record as JSON text."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"
