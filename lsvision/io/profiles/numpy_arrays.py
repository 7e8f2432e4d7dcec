"""Profiles in NumPy's NPY and NPZ; pickled objects are never loaded."""

import io
import math
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Container, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import get_size_limit
from lsvision.io.profiles.column_roles import has_known_role, names_section
from lsvision.io.profiles.columns import profiles_from_rows_of_points, profiles_from_table
from lsvision.io.profiles.matrix import MIN_COLUMNS, are_heights, profiles_from_matrix
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_table import NumberTable, floats_from
from lsvision.io.profiles.pose_documents import reject_pose_arrays
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_units import add_units
from lsvision.io.profiles.unit_statements import (
    UnitStatement,
    find_lost_values,
    find_unit_statements,
)

# What `np.load`, its parser of headers, and zipfile raise for damaged files.
_NUMPY_ERRORS = (
    ValueError,
    TypeError,
    KeyError,
    EOFError,
    OSError,
    MemoryError,
    OverflowError,
    SyntaxError,
    RecursionError,
    NotImplementedError,
    RuntimeError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
NPY_MAGIC = b"\x93NUMPY"
"""First bytes of an NPY file."""
_KEYS = ("points", "profile", "profiles", "arr_0")  # of the array with the points, best first


def read_npy(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of an array of points or of heights.

    Shapes: (n, 2) x and height; (n, 3) or (k, n, 3) x, y, z; (2, n) or (3, n) the same in rows if n
    is at least `MIN_COLUMNS`; (k, n, 2) k profiles; (n,) or (k, n) rows of heights with ``dx``, or
    below a row of x. A structured array has named columns.

    Raises
    ------
    UnreadableFile
        If NumPy cannot read it, it holds no numbers, or it has another shape.
    """
    arrays = _load(content)
    if "" not in arrays:
        raise UnreadableFile("a zip archive instead of an array: leave --format npy out")
    return profiles_from_array(arrays[""], settings)


def read_npz(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of arrays ``x`` and ``z`` (or ``range``), or of one as `read_npy`.

    A scalar states a unit or a marker of lost points under a name such as ``unit`` or ``nodata``.

    Raises
    ------
    UnreadableFile
        As `read_npy`.
    """
    loaded = _load(content)
    scalars = {
        name: _format_scalar(array)
        for name, array in loaded.items()
        if _is_text(array) or (_is_number(array) and not has_known_role(name))
    }
    lines = [f"{name}: {text}" for name, text in scalars.items()]
    profiles = _profiles_from_arrays(loaded, scalars, settings, find_unit_statements(lines))
    return replace(profiles, lost=profiles.lost + find_lost_values(lines))


def _profiles_from_arrays(
    loaded: Mapping[str, npt.NDArray[np.generic]],
    scalars: Container[str],
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...],
) -> RawProfiles:
    """Return the profiles of the arrays that are not scalars."""
    arrays = {name: array for name, array in loaded.items() if name not in scalars}
    key = next((key for key in _KEYS if key in arrays), None)
    if key is None and len(arrays) == 1:
        key = next(iter(arrays))
    if key is not None:
        raw = profiles_from_array(arrays[key], settings, statements, key)
        return replace(raw, ignored=raw.ignored + tuple(name for name in arrays if name != key))
    if not names_section(arrays):
        reject_pose_arrays(arrays)
    # Without scalars; if all are scalars, the error names them.
    rows = {name: array for name, array in arrays.items() if array.ndim} or arrays
    return profiles_from_named(
        {name: _as_floats(array, name) for name, array in rows.items()}, settings, statements
    )


def _load(content: bytes) -> Mapping[str, npt.NDArray[np.generic]]:
    """Return the arrays of an NPZ file by name, or that of an NPY file under an empty name."""
    try:
        if content.startswith(NPY_MAGIC):
            return {"": _parse_npy(content)}
        return _unpack(content)
    except _NUMPY_ERRORS as error:
        raise _build_unreadable_error(error) from None


def _build_unreadable_error(error: BaseException) -> UnreadableFile:
    reason = " ".join(str(error).split())[:80]
    return UnreadableFile(
        f"NumPy cannot read it ({reason}): save plain arrays of numbers with np.save"
    )


def _is_text(array: npt.NDArray[np.generic]) -> bool:
    return array.dtype.kind in "US" and array.size == 1


def _format_scalar(array: npt.NDArray[np.generic]) -> str:
    value = array.item()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _is_number(array: npt.NDArray[np.generic]) -> bool:
    return array.dtype.kind in "iuf" and array.ndim == 0


def _unpack(content: bytes) -> dict[str, npt.NDArray[np.generic]]:
    """Return the arrays of a zip archive; their sizes are checked before they are unpacked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(member.file_size for member in archive.infolist())
        if size > get_size_limit():
            raise ValueError(f"{size / 1e9:.3g} GB when unpacked, above --max-size")
        arrays = {}
        for member in archive.infolist():
            if not member.is_dir():
                array = _parse_npy(archive.read(member))
                arrays[member.filename.removesuffix(".npy").lower()] = array
    return arrays


def _parse_npy(content: bytes) -> npt.NDArray[np.generic]:
    """Return the array of an NPY file; its size is first checked against its header."""
    if not content.startswith(NPY_MAGIC):
        raise ValueError(f"not an NPY array, but {content[:8]!r}")
    _check_size(io.BytesIO(content), len(content))
    return _load_quietly(io.BytesIO(content))


def open_npy(path: Path) -> npt.NDArray[np.generic]:
    """Return the array of an NPY file, mapped into memory: only what is used is read.

    Raises
    ------
    UnreadableFile
        If NumPy cannot read it.
    """
    try:
        with path.open("rb") as file:
            _check_size(file, path.stat().st_size)
        return _load_quietly(path, mmap_mode="r")
    except _NUMPY_ERRORS as error:
        raise _build_unreadable_error(error) from None


def _load_quietly(
    file: BinaryIO | Path, mmap_mode: Literal["r"] | None = None
) -> npt.NDArray[np.generic]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about odd headers, as of Python 2
        array: npt.NDArray[np.generic] = np.load(file, mmap_mode=mmap_mode, allow_pickle=False)
    return array


def _check_size(stream: BinaryIO, size: int) -> None:
    """Raise ValueError if an NPY file is smaller than its header states."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python's parser warns about odd headers
        version = np.lib.format.read_magic(stream)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
        else:
            shape, _, dtype = np.lib.format.read_array_header_2_0(stream)
        needed, available = math.prod(shape) * dtype.itemsize, size - stream.tell()
        if min(shape, default=0) < 0 or needed > available:
            raise ValueError(f"an array of shape {shape} needs {needed} bytes, got {available}")


def _as_floats(array: npt.NDArray[np.generic], name: str = "") -> npt.NDArray[np.float64]:
    if array.dtype.kind not in "iufb":
        raise UnreadableFile(
            f"an array{name and f' {name!r}'} of {array.dtype}: expected numbers: save it as float"
        )
    return floats_from(array)


def profiles_from_array(
    array: npt.NDArray[np.generic],
    settings: ReadSettings,
    statements: tuple[UnitStatement, ...] = (),
    label: str = "",
) -> RawProfiles:
    """Return the profiles of one array, whose label may state its unit; see `read_npy`."""
    if array.dtype.names:
        records: Any = array
        return profiles_from_named(
            {name: _as_floats(records[name], name) for name in array.dtype.names},
            settings,
            statements,
        )
    values = _as_floats(array)
    if values.ndim == 3 and values.shape[2] in (2, 3) and values.size:
        if values.shape[2] == 2 and settings.columns is None:
            return add_units(RawProfiles(sections=list(values)), statements, settings)
        points = NumberTable.of_points(values.reshape(-1, values.shape[2]), statements)
        return profiles_from_rows_of_points(points, len(values), settings)
    if values.ndim == 1:
        values = values.reshape(1, -1)
    if values.ndim != 2 or values.size == 0:
        reject_pose_arrays({"": values})
        raise UnreadableFile(f"an array of shape {array.shape}: expected points of shape (n, 2)")
    is_row_per_axis = values.shape[0] in (2, 3) and values.shape[1] >= MIN_COLUMNS
    if is_row_per_axis and settings.dx is None and not settings.transpose:
        values = values.T
    table = NumberTable(values, statements=statements, limits=_find_type_limits(array.dtype))
    is_matrix = settings.transpose or are_heights(values.shape[1], settings) or len(values) == 1
    if settings.columns is None and is_matrix:
        labelled = NumberTable.of_heights(values, label, statements)
        return profiles_from_matrix(replace(labelled, limits=table.limits), settings)
    return profiles_from_table(table, settings)


def _find_type_limits(kind: np.dtype[np.generic]) -> tuple[float, ...]:
    """Return the limits of an integer type, which mark lost points if far from other values.

    None of an 8-bit type: they may be heights.
    """
    if kind.kind not in "iu" or kind.itemsize < 2:
        return ()
    limits = np.iinfo(kind)  # type: ignore[type-var] # an integer by its kind
    return float(limits.min), float(limits.max)
