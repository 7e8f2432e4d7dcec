"""Profiles in Parquet: one point per row (x, z) or one profile per row (lists x and z)."""

import io
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import get_size_limit
from lsvision.geometry import FloatArray
from lsvision.io.profiles.column_roles import find_role, is_coordinate
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_table import floats_from
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.spelled_cells import MAX_EXACT_NUMBER
from lsvision.io.profiles.unit_statements import UnitStatement, find_unit_statements
from lsvision.io.profiles.units import split_label

if TYPE_CHECKING:
    import pyarrow as pa

PARQUET_MAGIC = b"PAR1"
"""First and last bytes of a Parquet file."""
_BYTES_PER_VALUE = 8  # of an unpacked number


def read_parquet(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a Parquet file; columns are assigned by their names.

    Raises
    ------
    UnreadableFile
        If pyarrow is missing, cannot read the file, or finds no column of heights.
    """
    (table,) = _iterate_tables(io.BytesIO(content), None)
    return profiles_from_table(table, settings)


def iterate_tables(path: Path, rows: int) -> "Iterator[pa.Table]":
    """Yield a Parquet file in tables of at most `rows` profiles.

    A file with one point per row is one table, since the points of a profile may be anywhere in it.

    Raises
    ------
    UnreadableFile
        As `read_parquet`.
    """
    with path.open("rb") as file:
        yield from _iterate_tables(file, rows)


def profiles_from_table(table: "pa.Table", settings: ReadSettings) -> RawProfiles:
    """Return the profiles of an Arrow table; see `read_parquet`."""
    pyarrow = _import_pyarrow()
    try:
        columns = {
            name: None if _is_large_number(table, name) else _read_values(table[name])
            for name in table.column_names
        }
        texts = {
            name: _read_texts(table[name]) for name in table.column_names if columns[name] is None
        }
        stated = [
            *_list_unit_statements(table.schema.metadata),
            *_list_field_statements(table.schema),
        ]
    except (pyarrow.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        raise _build_unreadable_error(error) from None
    numbers_by_name = {name: values for name, values in columns.items() if values is not None}
    texts_by_name = {name: cells for name, cells in texts.items() if cells is not None}
    return profiles_from_named(numbers_by_name, settings, tuple(stated), texts_by_name)


def _is_large_number(table: "pa.Table", name: str) -> bool:
    """Return whether a column, of no coordinate, has whole numbers that floats would round.

    It is read as text.
    """
    from pyarrow import compute, types

    column = table[name]
    if not types.is_integer(column.type) or is_coordinate(split_label(name)[0]):
        return False
    limits = compute.min_max(column).as_py()
    return any(abs(limit) >= MAX_EXACT_NUMBER for limit in limits.values() if limit is not None)


def holds_lists(column: "pa.ChunkedArray", lengths: Sequence[int]) -> bool:
    """Return whether a column holds lists of numbers of these lengths, or null, not only null."""
    from pyarrow import compute

    if not (_is_list(column.type) and _is_number(column.type.value_type)):
        return False
    found = compute.list_value_length(column).to_pylist()
    return any(count is not None for count in found) and all(
        count in (None, length) for count, length in zip(found, lengths, strict=True)
    )


def _import_pyarrow() -> Any:
    """Return the imported pyarrow; an error names the extra that installs it."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise UnreadableFile(
            "reading Parquet needs pyarrow: pip install 'lsvision[batch]'"
        ) from None
    return pyarrow


def _build_unreadable_error(error: Exception) -> UnreadableFile:
    reason = " ".join(str(error).split())[:80]
    return UnreadableFile(f"pyarrow cannot read it ({reason}): write it again")


def _iterate_tables(file: BinaryIO, rows: int | None) -> "Iterator[pa.Table]":
    """Yield the batches of a file; all in one table if a row is a point or `rows` is None.

    A file without rows is an error.
    """
    pyarrow = _import_pyarrow()
    try:
        with pyarrow.parquet.ParquetFile(file) as source:
            schema = source.schema_arrow
            _check_table(source)
            if rows is None or not any(map(_is_list, schema.types)):
                yield _read_limited_table(source)
                return
            for batch in source.iter_batches(batch_size=rows):
                yield pyarrow.Table.from_batches([batch], schema=schema)
    except (pyarrow.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        raise _build_unreadable_error(error) from None


def _check_table(file: Any) -> None:
    """Raise UnreadableFile if a table has no row, or two columns of one name."""
    if not file.metadata.num_rows:
        raise UnreadableFile("the table has no row, so no profile: export it again")
    names = file.schema_arrow.names
    repeated = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise UnreadableFile(
            f"expected different names of the columns, got several {', '.join(map(repr, repeated))}"
            ": rename them"
        )


def _read_texts(column: Any) -> list[str] | None:
    """Return the cells of a column of text, dates or booleans; None for nested columns."""
    from pyarrow import string, types

    if types.is_nested(column.type):
        return None
    try:
        cells = column.to_pylist()
    except OverflowError:  # a time that Python cannot represent, such as one in the year 10000
        cells = column.cast(string()).to_pylist()
    return ["" if cell is None else str(cell) for cell in cells]


def _list_unit_statements(metadata: Any, axis: str = "") -> tuple[UnitStatement, ...]:
    """Return the units in the metadata of a table, such as ``unit: um``."""
    lines = [
        f"unit {axis}: {value.decode('utf-8', 'replace')}"
        for key, value in (metadata or {}).items()
        if key.lower() in (b"unit", b"units")
    ]
    return find_unit_statements(lines)


def _list_field_statements(schema: Any) -> list[UnitStatement]:
    """Return the units in the metadata of the columns of x and height."""
    statements: list[UnitStatement] = []
    for field in schema:
        role = find_role(split_label(field.name)[0])
        if role in ("x", "height", "range"):
            statements += _list_unit_statements(field.metadata, role)
    return statements


def _read_limited_table(file: Any) -> Any:
    """Return the table of a file, rejected as soon as it unpacks to more than the limit.

    Because of compression, the size of the file does not limit that of the table. The sizes in the
    metadata of its column chunks are not read: invalid ones crash the process (pyarrow 26).
    """
    import pyarrow

    limit, rows = get_size_limit(), file.metadata.num_rows
    if rows * max(file.metadata.num_columns, 1) * _BYTES_PER_VALUE > limit:
        raise ValueError(f"{rows} rows, more than --max-size when unpacked")
    batches, size = [], 0
    for batch in file.iter_batches():
        batches.append(batch)
        size += batch.nbytes
        if size > limit:
            raise ValueError(f"{size / 1e9:.3g} GB and more when unpacked, above --max-size")
    return pyarrow.Table.from_batches(batches, schema=file.schema_arrow)


def _read_values(column: Any) -> FloatArray | list[FloatArray] | None:
    """Return the numbers of a column, an array per row for lists; None for other columns."""
    kind = column.type
    if _is_list(kind):
        return _read_rows(column) if _is_number(kind.value_type) else None
    return _read_floats(column) if _is_number(kind) else None


def _read_rows(column: Any) -> list[FloatArray]:
    """Return the numbers of each list; an empty array for a null."""
    import pyarrow as pa

    lists = column.combine_chunks().cast(pa.large_list(pa.float64()))
    ends, values = np.from_dlpack(lists.offsets).tolist(), _read_floats(lists.values)
    rows = [values[start:end] for start, end in pairwise(ends)]
    if lists.null_count:
        nulls = lists.is_null().to_pylist()
        rows = [values[:0] if null else row for row, null in zip(rows, nulls, strict=True)]
    return rows


def _is_list(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def _read_floats(array: Any) -> FloatArray:
    """Return numbers, NaN for null; from the buffers, because `to_numpy` imports pandas."""
    import pyarrow as pa

    if isinstance(array, pa.ChunkedArray):
        array = array.combine_chunks()
    numbers = array.cast(pa.float64(), safe=False)
    validity, data = numbers.buffers()
    window = slice(numbers.offset, numbers.offset + len(numbers))
    values = floats_from(np.frombuffer(data or b"", np.float64)[window])
    if validity is not None:
        bits = np.unpackbits(np.frombuffer(validity, np.uint8), bitorder="little")
        values[bits[window] == 0] = np.nan
    return values
