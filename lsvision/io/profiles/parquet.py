"""Profiles in Parquet: a point a row (x, z) or a profile a row (lists x and z)."""

import io
from typing import Any

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import current_size_limit
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_rows import floats_from
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.shapes import FloatArray

_BYTES_PER_VALUE = 8


def read_parquet(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Profiles of a Parquet file; columns are taken by their names.

    Raises
    ------
    UnreadableFile
        If pyarrow is missing, cannot read the file, or finds no column of heights.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise UnreadableFile(
            "reading Parquet takes pyarrow: pip install 'lsvision[batch]'"
        ) from None
    try:
        with pyarrow.parquet.ParquetFile(io.BytesIO(content)) as file:
            _check_size(file.metadata)
            table = file.read()
        columns = {name.lower(): _values(table[name]) for name in table.column_names}
    except (pyarrow.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        reason = " ".join(str(error).split())[:80]
        raise UnreadableFile(f"pyarrow cannot read it ({reason}): write it anew") from None
    known = {name: values for name, values in columns.items() if values is not None}
    return profiles_from_named(known, settings)


def _check_size(metadata: Any) -> None:
    """Refuse a file that unpacks to more than the limit: a value may take no byte in the file."""
    numbers = sum(
        max(metadata.row_group(group).column(column).num_values, 0)
        for group in range(metadata.num_row_groups)
        for column in range(metadata.num_columns)
    )
    if max(numbers, metadata.num_rows) * _BYTES_PER_VALUE > current_size_limit():
        raise ValueError(
            f"{max(numbers, metadata.num_rows):.3g} values, more than --max-size when unpacked"
        )


def _values(column: Any) -> FloatArray | list[FloatArray] | None:
    import pyarrow.types as kinds

    kind = column.type
    if kinds.is_list(kind) or kinds.is_large_list(kind) or kinds.is_fixed_size_list(kind):
        if not _is_number(kind.value_type):
            return None
        rows = (row.values for row in column)
        return [np.empty(0) if row is None else _floats(row) for row in rows]
    return _floats(column) if _is_number(kind) else None


def _is_number(kind: Any) -> bool:
    import pyarrow.types as kinds

    return bool(kinds.is_integer(kind) or kinds.is_floating(kind))


def _floats(array: Any) -> FloatArray:
    return floats_from(array.to_numpy(zero_copy_only=False))
