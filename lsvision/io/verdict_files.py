"""Verdicts as JSON, CSV and Parquet."""

import csv
import io
import json
from collections.abc import Sequence

from lsvision.errors import LsvisionError
from lsvision.files.printable import printable_cell
from lsvision.results.quantities import Record

FILE_SCHEMA = "lsvision.verdicts/1"
"""Name and version of a JSON file of verdicts."""


def verdicts_json(records: Sequence[Record]) -> str:
    """Return a JSON document of all verdicts; see `JudgedMeasurement.record`."""
    document = {"schema": FILE_SCHEMA, "verdicts": list(records)}
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def verdicts_csv(rows: Sequence[Record]) -> str:
    """Return a table with one row per quantity; empty cells where a number does not exist.

    All rows have the same keys.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(list(rows[0]) if rows else [])
    for row in rows:
        writer.writerow(
            [printable_cell(cell) if isinstance(cell, str) else cell for cell in row.values()]
        )
    return text.getvalue()


def verdicts_parquet(rows: Sequence[Record]) -> bytes:
    """Return the table of `verdicts_csv` as a Parquet file.

    Raises
    ------
    LsvisionError
        If pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise LsvisionError(
            "--parquet needs pyarrow, which is not installed: pip install 'lsvision[batch]'"
        ) from None
    content = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(list(rows)), content)
    return content.getvalue()
