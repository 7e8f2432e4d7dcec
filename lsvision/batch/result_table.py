"""Results of a batch as a Parquet table: one cylinder per row."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lsvision.ellipse.section_table import SECTION_COLUMNS, build_section_row
from lsvision.io.profiles.column_roles import identifies_profiles
from lsvision.io.profiles.streaming import ProfileChunk

if TYPE_CHECKING:
    import pyarrow as pa

    from lsvision.inspection.job import Job
    from lsvision.measure import Measurement

LOCATION_COLUMNS = ("source", "profile", "cylinder")
"""Columns that state which cylinder a row is, before those with its quantities."""
INTEGER_COLUMNS, FLAG_COLUMNS = ("profile", "cylinder", "points"), ("theta_determined",)
"""Columns of integers, and columns of true or false. Of the other columns of `LOCATION_COLUMNS` and
`SECTION_COLUMNS`, `source` is text and the rest are numbers."""


def build_result_table(
    source: str,
    chunk: ProfileChunk,
    measurements: Sequence["Measurement | None"],
    inspection: "Job | None" = None,
) -> "pa.Table":
    """Return the results of consecutive profiles as a table of one row for each cylinder.

    The columns are ``source``, ``profile`` and ``cylinder`` (both from 0), those of ``lsvision
    measure --csv``, the other columns of the file with their types, ``decision`` with an inspection
    job (OK, NG or undecided), ``reason`` and ``rejections``. A column of the file that has the name
    of one of these gets the suffix ``_in_file``. A profile without cylinders, also one without a
    valid point, whose measurement is None, is one row with the reason and no numbers; the
    rejections of a profile are in its first row.
    """
    import pyarrow as pa

    indices: list[int] = []
    rows: list[dict[str, Any]] = []
    for index, measurement in enumerate(measurements):
        for row in _list_rows(measurement):
            rows.append(row | {"source": source, "profile": chunk.first + index})
            indices.append(index)
    columns = {
        name: pa.array([row.get(name) for row in rows], type=_select_type(name))
        for name in (*LOCATION_COLUMNS, *SECTION_COLUMNS)
    }
    repeated = _build_file_table(chunk).take(pa.array(indices, type=pa.int64()))
    names = name_file_columns(chunk, judged=inspection is not None)
    columns |= {names[name]: repeated[name] for name in repeated.column_names}
    if inspection is not None:
        decisions = [_decide(measurement, inspection) for measurement in measurements]
        columns["decision"] = pa.array([decisions[index] for index in indices], type=pa.string())
    columns["reason"] = pa.array([row["reason"] for row in rows], type=pa.string())
    columns["rejections"] = pa.array(
        [row["rejections"] for row in rows], type=_build_rejections_type()
    )
    return pa.table(columns)


def _decide(measurement: "Measurement | None", job: "Job") -> str:
    """Return the decision on a profile: OK, NG or undecided."""
    from lsvision.inspection.judge import judge
    from lsvision.measure import Measurement

    return str(judge(measurement or Measurement((), ()), job).decision.value)


def _list_rows(measurement: "Measurement | None") -> Iterator[dict[str, Any]]:
    """Yield the rows of a profile: one per cylinder, or one with the reason why there is none."""
    if measurement is None:
        yield {"reason": "no valid point", "rejections": []}
        return
    rejections = [rejection.to_dict() for rejection in measurement.rejections]
    if not measurement.cylinders:
        yield {"reason": measurement.reason, "rejections": rejections}
    for number, cylinder in enumerate(measurement.cylinders):
        row = build_section_row(cylinder.to_dict())
        yield row | {"cylinder": number, "reason": None, "rejections": [] if number else rejections}


def name_file_columns(chunk: ProfileChunk, *, judged: bool) -> dict[str, str]:
    """Return the names in the results of the other columns of a file, by their names in the file.

    That of a column of the results gets the suffix ``_in_file``, twice if the file has a column of
    that name, too. `judged` is whether the results have the column of decisions.
    """
    taken = {*LOCATION_COLUMNS, *SECTION_COLUMNS, "reason", "rejections"}
    taken |= {"decision"} if judged else set()
    names = dict.fromkeys(_build_file_table(chunk).column_names, "")
    for name in names:
        new_name = name
        while new_name in taken or (new_name != name and new_name in names):
            new_name += "_in_file"
        names[name] = new_name
    return names


def _build_file_table(chunk: ProfileChunk) -> "pa.Table":
    """Return the other columns of a file, one row per profile."""
    return _build_attribute_table(chunk.file.attributes) if chunk.columns is None else chunk.columns


def _build_attribute_table(attributes: Sequence[Mapping[str, Any]]) -> "pa.Table":
    """Return the attributes of profiles as a table; values of different types become text.

    Whole numbers that identify profiles or parts, read as floats, are integers again.
    """
    import pyarrow as pa

    columns = {}
    for name in dict.fromkeys(name for profile in attributes for name in profile):
        values = [profile.get(name) for profile in attributes]
        if identifies_profiles(name) and all(map(_is_whole, values)):
            values = [None if value is None else int(value) for value in values]
        try:
            columns[name] = pa.array(values)
        except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):  # also integers above 64 bit
            columns[name] = pa.array([None if value is None else str(value) for value in values])
    return pa.table(columns)


def _is_whole(value: Any) -> bool:
    """Return whether a value is a whole number, or missing."""
    return (
        value is None or isinstance(value, int) or (isinstance(value, float) and value.is_integer())
    )


def _select_type(name: str) -> "pa.DataType":
    """Return the type of a column of `LOCATION_COLUMNS` or `SECTION_COLUMNS`."""
    import pyarrow as pa

    if name == "source":
        return pa.string()
    if name in INTEGER_COLUMNS:
        return pa.int64()
    return pa.bool_() if name in FLAG_COLUMNS else pa.float64()


def _build_rejections_type() -> "pa.DataType":
    """Return the type of the column of rejections: a list of start, stop and reason in each row."""
    import pyarrow as pa

    fields = [("start", pa.int64()), ("stop", pa.int64()), ("reason", pa.string())]
    return pa.list_(pa.struct(fields))
