"""Verdicts as JSON, CSV and Parquet."""

import csv
import io
import json
import textwrap
from collections.abc import Iterator, Sequence
from typing import TextIO

from lsvision.errors import LsvisionError
from lsvision.files.printable import escape_cell
from lsvision.inspection.judged_measurements import JudgedMeasurement
from lsvision.results.quantities import Record

FILE_SCHEMA = "lsvision.verdicts/1"
"""Name and version of a JSON file of verdicts."""


class VerdictJsonFormat:
    """Format of a JSON document of verdicts; see `JudgedMeasurement.record`.

    It is a `lsvision.io.result_files.ResultFormat`. An instance writes one document: the separator
    before a verdict depends on the previous ones. The document ends with the list `not_judged`: why
    a file, or the rest of the files, is not; reasons may be added to it until the end is written.
    """

    head = f'{{\n  "schema": {json.dumps(FILE_SCHEMA)},\n  "verdicts": ['

    def __init__(self, not_judged: Sequence[str] = ()) -> None:
        self._separator, self._not_judged = "\n", not_judged

    @property
    def tail(self) -> str:
        """Return the end of the document, with the reasons that `not_judged` has by now."""
        reasons = json.dumps(list(self._not_judged), indent=2)
        return f'\n  ],\n  "not_judged": {textwrap.indent(reasons, "  ").lstrip()}\n}}\n'

    def prepare(self, judged: Sequence[JudgedMeasurement]) -> bool:  # noqa: ARG002 - any verdict fits
        """Return False, since no verdict changes the head."""
        return False

    def format_item(self, judged: JudgedMeasurement) -> str:
        """Return the text of the next verdict, indented."""
        separator, self._separator = self._separator, ",\n"
        text = json.dumps(judged.record, indent=2, allow_nan=False)
        return f"{separator}{textwrap.indent(text, '    ')}"

    def convert(self, text: TextIO, head: str) -> Iterator[str]:  # noqa: ARG002 - the head never changes
        """Yield the text of earlier verdicts, unchanged as the head is."""
        yield from text


class VerdictCsvFormat:
    """Format of a CSV table with one row per quantity; see `JudgedMeasurement.rows`.

    It is a `lsvision.io.result_files.ResultFormat`. Cells are empty where a number does not exist.
    The header is that of the first verdict; each has a row, also one without a part.
    """

    tail = ""

    def __init__(self) -> None:
        self._columns: list[str] = []

    @property
    def head(self) -> str:
        """Return the header line."""
        return _format_csv_line(self._columns)

    def prepare(self, judged: Sequence[JudgedMeasurement]) -> bool:
        """Take the columns of the first verdict; return False.

        The head is set before any row is written, so that no earlier row has another one.
        """
        if judged and not self._columns:
            self._columns = list(judged[0].rows[0])
        return False

    def format_item(self, judged: JudgedMeasurement) -> str:
        """Return the rows of the next verdict."""
        return "".join(
            _format_csv_line(
                [escape_cell(cell) if isinstance(cell, str) else cell for cell in row.values()]
            )
            for row in judged.rows
        )

    def convert(self, text: TextIO, head: str) -> Iterator[str]:  # noqa: ARG002 - all rows have the same columns
        """Yield the earlier rows unchanged, since all have the same columns."""
        yield from text


def _format_csv_line(cells: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def encode_verdicts_parquet(rows: Sequence[Record]) -> bytes:
    """Return the rows of the CSV table as a Parquet file.

    Raises
    ------
    LsvisionError
        If pyarrow is not installed.
    """
    require_parquet()
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(list(rows)), content)
    return content.getvalue()


def require_parquet() -> None:
    """Raise an LsvisionError if Parquet files cannot be written."""
    try:
        import pyarrow.parquet  # noqa: F401 - whether it can be imported
    except ImportError:
        raise LsvisionError(
            "--parquet needs pyarrow, which is not installed: pip install 'lsvision[batch]'"
        ) from None
