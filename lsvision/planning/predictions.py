"""Predicted standard uncertainties of a section and of a scan, and their table."""

import math
from dataclasses import dataclass

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import freeze_arrays
from lsvision.results.number_format import format_std
from lsvision.results.quantities import Record
from lsvision.results.result import Result

ANGLE_NAMES = ("direction_std", "theta_std", "phi_std")
"""Attributes that are angles; other numbers that are not counts are lengths."""


class _Prediction(Result):
    """Standard uncertainties as a result: a line or a table of the numbers of `to_dict`."""

    covariance: FloatArray

    def __post_init__(self) -> None:
        freeze_arrays(self, covariance=(5, 5))

    def to_dict(self) -> Record:
        """Return the predicted standard uncertainties, ready for JSON.

        Returns
        -------
        dict
            Standard uncertainties; lengths in ``*_mm``, angles in ``*_deg``.
        """
        record: Record = {}
        for name, value in vars(self).items():
            if name in ANGLE_NAMES:
                record[f"{name}_deg"] = math.degrees(value)
            elif name != "covariance":
                record[name if isinstance(value, int) else f"{name}_mm"] = value
        return record

    def _summarise(self) -> str:
        return summarise_stds(self.to_dict())

    def _list_cells(self) -> list[tuple[str, ...]]:
        return build_std_cells(self.to_dict())


@dataclass(frozen=True, eq=False, repr=False)
class SectionPrediction(_Prediction):
    """Standard uncertainties that an efficient fit to one section reaches.

    Parameters
    ----------
    radius_std : float
        Standard uncertainty of the radius. Units: mm.
    theta_std : float
        Standard uncertainty of theta; at most 52 deg, that of a uniform angle. Units: rad.
    phi_std : float
        Standard uncertainty of phi; at most sqrt(2 sd(b/a)). Near phi = 0, phi = arccos(b/a)
        behaves like a square root and the linear bound sd(b/a) / sin(phi) diverges, while the
        actual standard deviation does not. The limit applies where sin(phi) < sqrt(sd(b/a) / 2);
        it is an order of magnitude, not a bound. Units: rad.
    centre_x_std, centre_y_std : float
        Standard uncertainty of the centre. Units: mm.
    covariance : (5, 5) ndarray
        Covariance: linear bound without these limits; order centre_x, centre_y, semi_major,
        semi_minor, theta (mm, rad). For a circle the last variance is inf, its covariances 0.
    points : int
        Number of points.
    """

    radius_std: float
    theta_std: float
    phi_std: float
    centre_x_std: float
    centre_y_std: float
    covariance: FloatArray
    points: int


@dataclass(frozen=True, eq=False, repr=False)
class ScanPrediction(_Prediction):
    """Standard uncertainties that a joint fit to all sections of a scan reaches.

    Parameters
    ----------
    radius_std : float
        Standard uncertainty of the radius. Units: mm.
    direction_std : float
        Root mean square angle between estimated and true direction. Units: rad.
    theta_std, phi_std : float
        Standard uncertainty of the direction's azimuth and of its angle from Z, in the frame of
        the points. theta_std is at most 52 deg, the value of a uniform angle. Units: rad.
    position_std : float
        Root mean square distance of the cylinder's `point` from the estimated axis. Units: mm.
    covariance : (5, 5) ndarray
        Covariance of point along e_phi and e_theta (mm), direction along e_phi and e_theta (rad),
        radius (mm); for e_phi and e_theta see `build_tangent_frame`.
    points, sections : int
        Number of points and of sections.
    length : float
        Distance from the first section to the last. Units: mm.
    """

    radius_std: float
    direction_std: float
    theta_std: float
    phi_std: float
    position_std: float
    covariance: FloatArray
    points: int
    sections: int = 1
    length: float = 0.0


def build_std_cells(record: Record) -> list[tuple[str, ...]]:
    """Return the cells of a table: a header and one row.

    Examples
    --------
    >>> build_std_cells({"radius_std_mm": 0.3912, "points": 56})
    [('± radius mm', 'points'), ('0.39', '56')]
    """
    columns = [(_format_heading(key), _format_number(key, value)) for key, value in record.items()]
    header, row = zip(*columns, strict=True)
    return [tuple(header), tuple(row)]


def summarise_stds(record: Record) -> str:
    """Return all standard uncertainties in one line.

    Examples
    --------
    >>> summarise_stds({"radius_std_mm": 0.3912, "points": 56})
    'one sigma: radius 0.39 mm, points 56'
    """
    texts = []
    for key, value in record.items():
        unit = next((unit for unit in ("mm", "deg") if key.endswith(f"_{unit}")), "")
        name = _format_heading(key).removeprefix("± ").removesuffix(f" {unit}")
        texts.append(f"{name} {_format_number(key, value)} {unit}".rstrip())
    return f"one sigma: {', '.join(texts)}"


def _format_heading(key: str) -> str:
    """Return the heading of a key, such as ``± radius mm`` for ``radius_std_mm``."""
    name = key.replace("_std_", "_").replace("_", " ")
    return f"± {name}" if "_std_" in key else name


def _format_number(key: str, value: float) -> str:
    """Return a number as text, with two digits if it is a standard uncertainty."""
    return format_std(value) if "_std_" in key else f"{value:g}"
