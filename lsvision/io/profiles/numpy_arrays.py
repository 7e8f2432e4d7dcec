"""Profiles in NumPy's NPY and NPZ; nothing is ever unpickled."""

import io
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.matrix import MIN_COLUMNS, profiles_from_matrix
from lsvision.io.profiles.named_columns import profiles_from_named
from lsvision.io.profiles.number_rows import floats_from
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import TextTable

_BROKEN = (
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
_KEYS = ("points", "profile", "profiles", "arr_0")


def read_npy(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Profiles of one array: points (n, 2 or 3), (k, n, 2), or rows of heights with ``dx``."""
    return _profiles_from_array(_loaded(content)[""], settings)


def read_npz(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Profiles of arrays ``x`` and ``z`` (or ``range``), or of one array as in `read_npy`."""
    arrays = _loaded(content)
    key = next((key for key in _KEYS if key in arrays), None)
    if key is None and len(arrays) == 1:
        key = next(iter(arrays))
    if key is not None:
        return _profiles_from_array(arrays[key], settings)
    return profiles_from_named(
        {name: _as_floats(array) for name, array in arrays.items()}, settings
    )


def _loaded(content: bytes) -> Mapping[str, npt.NDArray[np.generic]]:
    try:
        loaded = np.load(io.BytesIO(content), allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return {"": loaded}
        with loaded:
            return {key.lower(): loaded[key] for key in loaded.files}
    except _BROKEN as error:
        raise UnreadableFile(
            f"NumPy cannot read it ({str(error)[:80]}): save plain arrays of numbers with np.save"
        ) from None


def _as_floats(array: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    if array.dtype.kind not in "iufb":
        raise UnreadableFile(f"an array of {array.dtype}: want numbers")
    return floats_from(array)


def _profiles_from_array(array: npt.NDArray[np.generic], settings: ReadSettings) -> RawProfiles:
    if array.dtype.names:
        records: Any = array
        return profiles_from_named(
            {name: _as_floats(records[name]) for name in array.dtype.names}, settings
        )
    values = _as_floats(array)
    if values.ndim == 3 and values.shape[2] == 2 and len(values):
        return RawProfiles(sections=list(values))
    if values.ndim == 1:
        values = values.reshape(1, -1)
    if values.ndim != 2 or values.size == 0:
        raise UnreadableFile(f"an array of shape {array.shape}: want points of shape (n, 2)")
    if values.shape[0] in (2, 3) and values.shape[1] >= MIN_COLUMNS and settings.dx is None:
        values = values.T
    table = TextTable(values)
    if values.shape[1] >= MIN_COLUMNS or len(values) == 1:
        return profiles_from_matrix(table, settings)
    return profiles_from_table(table, settings)
