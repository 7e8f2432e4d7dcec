"""What the user may say about a profile file, and what a reader hands back before units."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

from lsvision.geometry import FloatArray

MM_PER_UNIT = {
    "nm": 1e-6,
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "m": 1e3,
    "mil": 0.0254,
    "in": 25.4,
}
"""The units a profile may come in, each in mm."""

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
)
"""Names that `format` and ``--format`` take."""


class ReadOptions(TypedDict, total=False):
    """The keywords of `read_profile`; each is a field of `ReadSettings`."""

    format: str | None
    columns: str | Sequence[int | str] | None
    units: str | None
    flip: bool | None
    x0: float | None
    dx: float | None
    x_start: float | None
    x_pitch: float | None
    z_unit: float | None


@dataclass(frozen=True, kw_only=True)
class ReadSettings:
    """What the user says of a file; None leaves it to the file.

    Parameters
    ----------
    format : str, optional
        One of `FORMATS`.
    columns : str or sequence, optional
        Columns of x and height, or of x, travel and height: indices from 0 or names, as
        ``(0, 2)`` or ``"x,z"``.
    units : str, optional
        Unit of all coordinates, one of `MM_PER_UNIT`.
    flip : bool, optional
        True where heights grow away from the sensor (ranges), False where they grow towards it.
    x0, dx : float, optional
        For rows of heights without x: x of the first column, spacing of columns. Units: mm.
    x_start, x_pitch, z_unit : float, optional
        For raw Keyence counts: XStart, XPitch and ZUnit as the controller states them.
        Units: 0.01 um.

    Raises
    ------
    ValueError
        For an unknown format or unit, a spacing of 0, or columns that are not two or three.

    Examples
    --------
    >>> ReadSettings(columns="0, 2").columns
    (0, 2)
    """

    format: str | None = None
    columns: str | Sequence[int | str] | None = None
    units: str | None = None
    flip: bool | None = None
    x0: float | None = None
    dx: float | None = None
    x_start: float | None = None
    x_pitch: float | None = None
    z_unit: float | None = None

    def __post_init__(self) -> None:
        _check_choice("format", self.format, FORMATS)
        _check_choice("units", self.units, tuple(MM_PER_UNIT))
        for name in ("dx", "x_pitch", "z_unit"):
            if getattr(self, name) == 0:
                raise ValueError(f"want {name} other than 0, got 0")
        if self.columns is not None:
            object.__setattr__(self, "columns", _checked_columns(self.columns))


@dataclass(frozen=True, eq=False, kw_only=True)
class RawProfiles:
    """What a file holds, in its own units and its own direction.

    Parameters
    ----------
    sections : sequence of (n, 2) ndarray
        x and height of each profile, NaN where lost, order of the file.
    units : tuple of str or None
        Units of x and of height as the file states them; None where it does not.
    away : bool
        True where heights grow away from the sensor.
    positions : tuple of float, optional
        Where along the travel each profile was taken, in the units of x.
    notes : tuple of str
        What was guessed or left out, for people.
    x_in_mm : bool
        True where the user gave x in mm, whatever the unit of the heights.
    """

    sections: Sequence[FloatArray]
    units: tuple[str | None, str | None] = (None, None)
    away: bool = False
    positions: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()
    x_in_mm: bool = False


def _check_choice(name: str, value: str | None, choices: tuple[str, ...]) -> None:
    if value is not None and value not in choices:
        raise ValueError(f"want {name} among {', '.join(choices)}, got {value!r}")


def _checked_columns(columns: str | Sequence[int | str]) -> tuple[int | str, ...]:
    cells = columns.split(",") if isinstance(columns, str) else columns
    words = [cell.strip() if isinstance(cell, str) else int(cell) for cell in cells]
    chosen = tuple(int(w) if isinstance(w, str) and w.isdecimal() else w for w in words)
    if len(chosen) not in (2, 3) or any(isinstance(c, int) and c < 0 for c in chosen):
        raise ValueError(
            f"want columns of x and height (or x, travel and height) from 0, got {columns!r}"
        )
    return chosen
