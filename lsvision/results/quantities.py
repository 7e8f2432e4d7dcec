"""Numbers of a result in the units of output, each with its uncertainty."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Literal

from lsvision.results.number_format import count_decimals, format_value

Record = dict[str, Any]
"""Keys and values of a result, ready for JSON."""
Unit = Literal["mm", "deg", "mm_per_m", "percent"]
"""Unit of a quantity, as at the end of keys and columns."""
LEVEL = 0.95
"""Level of confidence of the intervals in tables and files; the 95 in keys and columns."""
DEG_PER_RAD = math.degrees(1.0)
"""Factor from rad to deg."""


@dataclass(frozen=True)
class Quantity:
    """Name and unit of a number, from which its columns and keys are named.

    Parameters
    ----------
    name : str
        Name of the quantity, such as ``radius`` or ``centre_x``.
    unit : {"mm", "deg", "mm_per_m", "percent"}
        Unit in tables and files.

    Examples
    --------
    >>> Quantity("centre_x", "mm").heading
    'centre x mm'
    >>> Quantity("theta", "deg").columns
    ('theta_deg', 'theta_std_deg', 'theta_low_95_deg', 'theta_high_95_deg')
    """

    name: str
    unit: Unit

    @property
    def heading(self) -> str:
        """Heading of a column."""
        return f"{self.name.replace('_', ' ')} {self.unit_text}"

    @property
    def unit_text(self) -> str:
        """Printed form of the unit."""
        return {"mm_per_m": "mm/m", "percent": "%"}.get(self.unit, self.unit)

    @property
    def scale(self) -> float:
        """Factor that converts rad to deg; 1 for other units, in which numbers are given."""
        return DEG_PER_RAD if self.unit == "deg" else 1.0

    def convert_to_unit(self, interval: tuple[float, float]) -> tuple[float, float]:
        """Return an interval in the unit of the quantity; that of an angle is given in rad."""
        low, high = interval
        return low * self.scale, high * self.scale

    @property
    def keys(self) -> tuple[str, str, str]:
        """Keys of a record: value, standard uncertainty, interval."""
        name, unit = self.name, self.unit
        return f"{name}_{unit}", f"{name}_std_{unit}", f"{name}_interval_95_{unit}"

    @property
    def columns(self) -> tuple[str, str, str, str]:
        """Columns of a row: value, standard uncertainty, both ends of the interval."""
        value, std, _ = self.keys
        return value, std, f"{self.name}_low_95_{self.unit}", f"{self.name}_high_95_{self.unit}"


@dataclass(frozen=True)
class Estimate:
    """Number with its standard uncertainty and interval, in the unit of the quantity.

    Parameters
    ----------
    quantity : Quantity
        Name and unit of the number.
    value, std : float
        Number and its standard uncertainty.
    interval : tuple of float
        Interval at the level of confidence `LEVEL`; NaN if there is none.
    determined : bool
        False if the data do not determine the value; tables then state that.

    Examples
    --------
    >>> angle = Quantity("phi", "deg")
    >>> phi = Estimate(angle, 28.648, 0.573, angle.convert_to_unit((0.48, 0.52)))
    >>> phi.text, phi.interval_text
    ('28.65 ± 0.57', '27.50 .. 29.79')
    """

    quantity: Quantity
    value: float
    std: float
    interval: tuple[float, float]
    determined: bool = True

    @classmethod
    def of(
        cls, quantity: Quantity, value: float, std: float, determined: bool = True
    ) -> "Estimate":
        """Return an estimate without interval; angles are given in rad."""
        no_interval = (math.nan, math.nan)
        return cls(quantity, value * quantity.scale, std * quantity.scale, no_interval, determined)

    @property
    def text(self) -> str:
        """Number with its standard uncertainty."""
        return format_value(self.value, self.std) if self.determined else "not determinable"

    @property
    def interval_text(self) -> str:
        """Interval, with as many decimals as the number."""
        low, high = self.interval
        decimals = count_decimals(self.std)
        return f"{low:z.{decimals}f} .. {high:z.{decimals}f}"

    @property
    def record(self) -> Record:
        """Keys and numbers, ready for JSON."""
        numbers = (
            replace_nonfinite(self.value),
            replace_nonfinite(self.std),
            [replace_nonfinite(limit) for limit in self.interval],
        )
        return dict(zip(self.quantity.keys, numbers, strict=True))


def replace_nonfinite(value: float) -> float | None:
    """Return a number for JSON: None if it is infinite or NaN."""
    return float(value) if math.isfinite(value) else None


def convert_numbers_to_json(values: Iterable[float]) -> list[float | None]:
    """Return numbers as a list for JSON: None for infinite values and NaN."""
    return [replace_nonfinite(float(value)) for value in values]


def convert_to_plain(value: Any) -> Any:
    """Return a value ready for JSON: dataclasses and mappings as dicts, tuples as lists.

    NaN and infinity are None; a value of another kind is its text.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: convert_to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): convert_to_plain(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [convert_to_plain(member) for member in value]
    if isinstance(value, float):
        return replace_nonfinite(value)
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def flatten_record(record: Record, quantities: Sequence[Quantity] = ()) -> Record:
    """Return a record as one row of a table, without nested values.

    The ends of the intervals of `quantities` become ``*_low_95_*`` and ``*_high_95_*``; three
    coordinates ``*_x``, ``*_y``, ``*_z``, before the unit. Other lists, and records within the
    record, are left out.

    Examples
    --------
    >>> flatten_record({"point_mm": [1.0, 2.0, 3.0], "rms_mm": 0.1, "covariance": [[1.0]]})
    {'point_x_mm': 1.0, 'point_y_mm': 2.0, 'point_z_mm': 3.0, 'rms_mm': 0.1}
    """
    row: Record = {}
    interval_columns = {quantity.keys[2]: quantity.columns[2:] for quantity in quantities}
    for key, value in record.items():
        if key in interval_columns:
            row |= dict(zip(interval_columns[key], value, strict=True))
        elif isinstance(value, list) and len(value) == 3 and all(map(_is_float_or_none, value)):
            unit = next((unit for unit in ("_mm", "_deg") if key.endswith(unit)), "")
            stem = key.removesuffix(unit)
            row |= build_coordinate_columns(stem, value, unit)
        elif not isinstance(value, list | dict):
            row[key] = value
    return row


def _is_float_or_none(value: Any) -> bool:
    """Return whether a value is what `replace_nonfinite` returns."""
    return value is None or isinstance(value, float)


def build_coordinate_columns(stem: str, coordinates: Sequence[float], unit: str = "") -> Record:
    """Return three coordinates as columns ``stem_x``, ``stem_y``, ``stem_z``, then the unit."""
    return {f"{stem}_{axis}{unit}": n for axis, n in zip("xyz", coordinates, strict=True)}
