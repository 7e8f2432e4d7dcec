"""Reading options of a profile file, and the raw profiles that a reader returns."""

import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

from lsvision.geometry import FloatArray
from lsvision.io.profiles.units import MM_PER_UNIT, find_mm_per_unit, parse_unit

MM_PER_KEYENCE_STEP = 1e-5
"""Unit in which controllers of Keyence state their scales, 0.01 um. Units: mm."""

FORMATS = (
    "text",
    "matrix",
    "gocator",
    "gocator-points",
    "keyence",
    "keyence-raw",
    "npy",
    "npz",
    "ply",
    "pcd",
    "opencv",
    "parquet",
    "json",
    "yaml",
    "laserscan",
    "height-map",
    "rosbag",
)
"""Values of `format` and ``--format``."""
PLANES = ("fit",)
"""Values of `plane` and ``--plane``."""


class ReadOptions(TypedDict, total=False):
    """The keywords of `read_profile`; each is a field of `ReadSettings`."""

    format: str | None
    columns: str | Sequence[int | str] | None
    units: str | None
    flip: bool | None
    lost: float | str | Sequence[float | str] | None
    transpose: bool
    x0: float | None
    dx: float | None
    x_start: float | None
    x_pitch: float | None
    z_unit: float | str | None
    topic: str | None
    plane: str | None


@dataclass(frozen=True, kw_only=True)
class ReadSettings:
    """Reading options for a file; None uses what the file states.

    Parameters
    ----------
    format : str, optional
        Name of the file's format, one of `FORMATS`; by default recognised from the content.
    columns : str or sequence, optional
        Columns of x and height, or of x, travel and height: indices from 0 or names, as
        ``(0, 2)`` or ``"x,z"``.
    units : str, optional
        Unit of all coordinates, one of `MM_PER_UNIT`, or with a scale, such as ``"0.1mm"``.
    flip : bool, optional
        True where heights grow away from the sensor (ranges), False where they grow towards it.
    lost : float, str or sequence, optional
        Height that marks a lost point, in the units of the file, such as ``-9999`` or
        ``"-9999,ERR"``; ``"none"`` if every number is a height. By default values that repeat far
        from the rest are read as lost points, with a note.
    transpose : bool
        True if each column of the matrix is a profile.
    x0, dx : float, optional
        For rows, or one column, of heights without x: x of the first height, and spacing. Units:
        mm.
    x_start, x_pitch : float, optional
        For raw Keyence counts: XStart and XPitch as the controller states them. Units: 0.01 um.
    z_unit : float or str, optional
        Size of one count of the heights: a number in 0.01 um, the unit of ZUnit in Keyence
        controllers, or a length such as ``"0.5um"``. Overrides `units` and the file for heights.
    topic : str, optional
        Topic of a ROS bag in which several hold profiles, such as ``"/scan"``.
    plane : str, optional
        ``"fit"`` if the points are x, y, z of a tilted plane, such as in the frame of a camera: the
        plane is fitted, and the section lies in it. Three `columns` are then x, y and z.

    Raises
    ------
    ValueError
        For an unknown format, unit or plane, a spacing of 0, an `x0` without `dx`, a count that is
        not above 0, a number that is not finite, or columns that are not two or three, below 0 or
        stated twice.
    TypeError
        For a column that is neither a whole number nor a name.

    Examples
    --------
    >>> ReadSettings(columns="0, 2").columns
    (0, 2)
    """

    format: str | None = None
    columns: str | Sequence[int | str] | None = None
    units: str | None = None
    flip: bool | None = None
    lost: float | str | Sequence[float | str] | None = None
    transpose: bool = False
    x0: float | None = None
    dx: float | None = None
    x_start: float | None = None
    x_pitch: float | None = None
    z_unit: float | str | None = None
    topic: str | None = None
    plane: str | None = None

    def __post_init__(self) -> None:
        _check_choice("format", self.format, FORMATS)
        _check_choice("plane", self.plane, PLANES)
        if self.units is not None:
            object.__setattr__(self, "units", _parse_units(self.units))
        if self.z_unit is not None:
            object.__setattr__(self, "z_unit", _parse_count_size(self.z_unit))
        for name in ("dx", "x_pitch"):
            if getattr(self, name) == 0:
                raise ValueError(f"expected {name} other than 0, got 0")
        if self.x0 is not None and self.dx is None:
            raise ValueError("expected dx beside x0, which is x of heights without x")
        if self.z_unit is not None and float(self.z_unit) <= 0:
            raise ValueError(f"expected z_unit above 0, got {self.z_unit:g}")
        for name in ("x0", "dx", "x_start", "x_pitch", "z_unit"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"expected a finite {name}, got {value}")
        if self.lost is not None:
            object.__setattr__(self, "lost", _parse_markers(self.lost))
        if self.columns is not None:
            object.__setattr__(self, "columns", _parse_columns(self.columns))

    @property
    def lost_values(self) -> tuple[float, ...] | None:
        """Numbers among the markers that the user states; None without markers."""
        if self.lost is None:
            return None
        return tuple(marker for marker in self._markers if isinstance(marker, float))

    @property
    def lost_words(self) -> frozenset[str]:
        """Words among the markers that the user states, in lower case."""
        return frozenset(marker.lower() for marker in self._markers if isinstance(marker, str))

    @property
    def height_scale(self) -> float | None:
        """Height of one count; None if it is not given. Units: mm."""
        return None if self.z_unit is None else float(self.z_unit) * MM_PER_KEYENCE_STEP

    @property
    def count_unit(self) -> str | None:
        """Height of one count as a unit of length, ``"0.5 um"``; None if it is not given."""
        return None if self.z_unit is None else f"{float(self.z_unit) / 100:.12g} um"

    @property
    def _markers(self) -> tuple[float | str, ...]:
        return self.lost if isinstance(self.lost, tuple) else ()


@dataclass(frozen=True, eq=False, kw_only=True)
class RawProfiles:
    """Profiles of a file in its own units and direction.

    Parameters
    ----------
    sections : sequence of (n, 2) ndarray
        x and height of each profile, NaN where lost, order of the file; (n, 3) x, y, z of points
        whose plane is to be fitted.
    units : tuple of str or None
        Units of x and of height as the file states them; None where it does not.
    away : bool
        True where heights grow away from the sensor.
    positions : tuple of float, optional
        Position of each profile along the travel.
    position_unit : str, optional
        Unit of `positions`; None if it is that of x.
    notes : tuple of str
        Guesses and omissions, as text for users.
    x_in_mm : bool
        True if the user gave x in mm, independent of the unit of the heights.
    lost : tuple of float
        Markers of lost points that the file states, in its own units.
    limits : tuple of float
        Limits of the data type in which the heights were stored.
    attributes : tuple of mapping
        Data of the file on each profile other than its points; empty if there are none.
    ignored : tuple of str
        Columns that were not used.
    row_coordinates : tuple of str
        Columns of x, if there is one, and height, if each row of a table is a profile; else empty.
    """

    sections: Sequence[FloatArray]
    units: tuple[str | None, str | None] = (None, None)
    away: bool = False
    positions: tuple[float, ...] | None = None
    position_unit: str | None = None
    notes: tuple[str, ...] = ()
    x_in_mm: bool = False
    lost: tuple[float, ...] = ()
    limits: tuple[float, ...] = ()
    attributes: tuple[Mapping[str, float | str], ...] = ()
    ignored: tuple[str, ...] = ()
    row_coordinates: tuple[str, ...] = ()


def _check_choice(name: str, value: str | None, choices: tuple[str, ...]) -> None:
    if value is not None and value not in choices:
        raise ValueError(f"expected {name} among {', '.join(choices)}, got {value!r}")


def _parse_units(text: str) -> str:
    unit = parse_unit(text) if isinstance(text, str) else None
    if unit is None:
        raise ValueError(
            f"expected units among {', '.join(MM_PER_UNIT)}, or with a scale as 0.1mm, got {text!r}"
        )
    return unit


def _parse_count_size(z_unit: float | str) -> float:
    """Return the height of one count from a number or a length. Units: 0.01 um."""
    try:
        return float(z_unit)
    except ValueError:
        unit = parse_unit(str(z_unit))
    if unit is None:
        raise ValueError(
            f"expected z_unit as a number of 0.01 um or as a length, 0.5um, got {z_unit!r}"
        )
    return find_mm_per_unit(unit) / MM_PER_KEYENCE_STEP


def _parse_markers(lost: float | str | Sequence[float | str]) -> tuple[float | str, ...]:
    """Return the markers of lost points as numbers and words; NaN and infinity always are lost.

    A hexadecimal number is both: a text may contain the word itself, or its value as a decimal.
    """
    if isinstance(lost, str):
        cells: Sequence[float | str] = lost.split(",")
    else:
        cells = list(lost) if isinstance(lost, Iterable) else [lost]
    markers: list[float | str] = []
    for cell in cells:
        word = str(cell).strip()
        is_hexadecimal = word.lower().startswith("0x")
        try:
            number = float(int(word, 16)) if is_hexadecimal else float(word)
        except (ValueError, OverflowError):
            if word.lower() != "none":
                markers.append(word)
            continue
        if math.isfinite(number):
            markers.append(number)
        if is_hexadecimal:
            markers.append(word)
    return tuple(markers)


def _parse_columns(columns: str | Sequence[int | str]) -> tuple[int | str, ...]:
    """Return two or three columns: indices from 0, or names."""
    cells = columns.split(",") if isinstance(columns, str) else columns
    parsed = tuple(map(_parse_column, cells))
    if (
        len(parsed) not in (2, 3)
        or len(set(parsed)) < len(parsed)
        or any(isinstance(column, int) and column < 0 for column in parsed)
    ):
        raise ValueError(
            "expected columns of x and height (or x, travel and height), all different, from 0, "
            f"got {columns!r}"
        )
    return parsed


def _parse_column(cell: int | str) -> int | str:
    """Return the index of a column, as a number or a text such as ``-1``, or its name."""
    if not isinstance(cell, str):
        return operator.index(cell)
    word = cell.strip()
    return int(word) if word.removeprefix("-").isdecimal() else word
