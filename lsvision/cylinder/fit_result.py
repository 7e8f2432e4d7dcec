"""Result of a cylinder fit: covariance, residuals and their variance factor, cells and record."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from lsvision.cylinder.problem import PARAMETERS
from lsvision.geometry import BoolArray, Cylinder, FloatArray, build_tangent_frame
from lsvision.geometry.arrays import rms
from lsvision.geometry.cylinder import WithCylinder
from lsvision.results.number_format import count_decimals, format_std, format_value
from lsvision.results.quantities import Record, convert_numbers_to_json
from lsvision.results.result import Result
from lsvision.statistics.correlation import autocorrelation_time
from lsvision.statistics.coverage import coverage_factor
from lsvision.statistics.robust import estimate_excess_variance

AxisQuantity = Literal[
    "radius", "point_x", "point_y", "point_z", "direction_x", "direction_y", "direction_z"
]
"""Quantities that have an interval: lengths in mm, and components of a unit vector."""
AXIS_QUANTITIES: tuple[AxisQuantity, ...] = get_args(AxisQuantity)

AXIS_HEADER = ("radius mm", "direction x y z", "± deg", "point x y z mm", "± mm")
"""Header of `format_axis_cells`."""
COVARIANCE_ORDER = "point along e_phi, e_theta (mm), direction along them (rad), radius (mm)"
"""Order of `CylinderFit.covariance`, as results state it."""


@dataclass(frozen=True, eq=False, repr=False)
class CylinderFit(WithCylinder, Result):
    """Cylinder fitted to points, with covariance and residuals.

    Parameters
    ----------
    cylinder : Cylinder
        Fitted cylinder; its point is the point of the axis nearest to the centroid of the points
        (see `with_reference_point`).
    covariance : (5, 5) ndarray
        Order: point along e_phi, point along e_theta (mm), direction along e_phi, direction
        along e_theta (rad), radius (mm); with `tangent_basis` = (e_phi, e_theta). The same order
        as ``ScanPrediction.covariance``.
    residuals : (n,) ndarray
        Signed distance of every point from the surface, positive outside. Units: mm.
    normalised : (n,) ndarray
        Residuals minus their bias, divided by `stds`; the fit minimises the sum of squares of
        those of the inliers.
    stds : (n,) ndarray
        Predicted standard deviation of the residuals. Without a noise model: the root of their
        sum of squares over n - 5, with truncation the robust one (MAD). Units: mm.
    inliers : (n,) ndarray of bool
        Mask of the points to which the cylinder was fitted; all without truncation.
    variance_factor : float
        Factor by which the covariance exceeds that from `stds` alone: 1 if the stds explain the
        residuals, more if the residuals are larger, correlated along the line, or truncated.
    degrees_of_freedom : float
        Degrees of freedom of the noise estimate; infinite with a noise model.

    Examples
    --------
    >>> import lsvision as lsv
    >>> angle, height = np.meshgrid(np.linspace(0, 2, 30), [0.0, 10.0])
    >>> pipe = np.stack([19 * np.cos(angle), 19 * np.sin(angle), height], axis=-1).reshape(-1, 3)
    >>> fit = lsv.fit_cylinder(pipe + np.random.default_rng(1).normal(0, 0.01, pipe.shape))
    >>> fit  # doctest: +ELLIPSIS
    <CylinderFit: radius 19.0... mm, direction (...) ± 0.030 deg, 60 points>
    >>> low, high = fit.interval("radius")
    >>> low < fit.to_dict()["radius_mm"] < high
    True
    >>> bool(1.96 < fit.coverage_factor() < 2.1 < fit.coverage_factor(quantities=2) < 2.7)
    True
    """

    cylinder: Cylinder
    covariance: FloatArray
    residuals: FloatArray
    normalised: FloatArray
    stds: FloatArray
    inliers: BoolArray
    variance_factor: float
    degrees_of_freedom: float

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm."""
        return math.sqrt(max(self.covariance[4, 4], 0.0))

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction. Units: rad."""
        return math.sqrt(max(self.covariance[2, 2] + self.covariance[3, 3], 0.0))

    @property
    def position_std(self) -> float:
        """Root mean square distance of `point` from the true axis. Units: mm."""
        # Of exact points the variances may be negative by rounding.
        return math.sqrt(max(self.covariance[0, 0] + self.covariance[1, 1], 0.0))

    @property
    def rms(self) -> float:
        """Root mean square residual of the inliers. Units: mm."""
        return rms(self.residuals[self.inliers])

    def interval(self, quantity: AxisQuantity, level: float = 0.95) -> tuple[float, float]:
        """Return the interval that contains the true value with probability `level`.

        Parameters
        ----------
        quantity : {"radius", "point_x", ..., "point_z", "direction_x", ..., "direction_z"}
            Coordinate in mm, or component of the unit vector. The interval of a coordinate of the
            point contains only the uncertainty perpendicular to the axis, because any point of the
            axis may be the reference.
        level : float
            Level of confidence, between 0 and 1.

        Returns
        -------
        low, high : float
            The value minus and plus a multiple of its standard deviation, from Student's t for
            the degrees of freedom of the fit.

        Raises
        ------
        ValueError
            If the quantity is unknown, or the level is not between 0 and 1.
        """
        if quantity not in AXIS_QUANTITIES:
            raise ValueError(
                f"expected a quantity among {', '.join(AXIS_QUANTITIES)}, got {quantity!r}"
            )
        factor = self.coverage_factor(level)
        name, _, axis = quantity.partition("_")
        if name == "radius":
            value, std = self.radius, self.radius_std
        else:
            vector, row = (self.point, 0) if name == "point" else (self.direction, 2)
            index = "xyz".index(axis)
            gradient = self.tangent_basis[:, index]
            covariance = self.covariance[row : row + 2, row : row + 2]
            value = float(vector[index])
            std = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        return value - factor * std, value + factor * std

    def coverage_factor(self, level: float = 0.95, quantities: int = 1) -> float:
        """Return the half width of an interval, or of a joint region, in standard uncertainties.

        Parameters
        ----------
        level : float
            Level of confidence, between 0 and 1.
        quantities : int
            Number of quantities of the joint region: 2 for a direction.

        Returns
        -------
        float
            Root of `quantities` times the quantile of F for `quantities` and the degrees of freedom
            of the fit; for one quantity that of Student's t.

        Raises
        ------
        ValueError
            If the level is not between 0 and 1.
        """
        return coverage_factor(quantities, self.degrees_of_freedom, level)

    def to_dict(self) -> Record:
        """Return axis, radius, covariance and rms residual as plain numbers, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``, angles in ``*_deg``.
        """
        points = {"points": int(self.inliers.sum()), "rms_mm": self.rms}
        return build_axis_record(self) | points

    def _summarise(self) -> str:
        radius, direction, angle, *_ = format_axis_cells(self)
        points = int(self.inliers.sum())
        return f"radius {radius} mm, direction ({direction}) ± {angle} deg, {points} points"

    def _list_cells(self) -> list[tuple[str, ...]]:
        points = str(int(self.inliers.sum()))
        return [(*AXIS_HEADER, "points"), (*format_axis_cells(self), points)]

    def _list_rows(self) -> list[Record]:
        record = self.to_dict()
        return [
            build_axis_row(record, self.interval("radius"))
            | {"points": record["points"], "rms_mm": record["rms_mm"]}
        ]

    def with_reference_point(self, near: npt.ArrayLike) -> "CylinderFit":
        """Return the fit with `point` at the axis point nearest to a position (3,) in mm."""
        shift = float((np.asarray(near, dtype=np.float64) - self.point) @ self.direction)
        cylinder = Cylinder(self.point + shift * self.direction, self.direction, self.radius)
        jacobian = np.eye(PARAMETERS)
        jacobian[0, 2] = jacobian[1, 3] = shift
        return replace(self, cylinder=cylinder, covariance=jacobian @ self.covariance @ jacobian.T)

    def with_reversed_direction(self) -> "CylinderFit":
        """Return the fit with the opposite direction."""
        cylinder = Cylinder(self.point, -self.direction, self.radius)
        # In the tangent basis of the new direction; errors of the direction also change their sign.
        change_of_basis = build_tangent_frame(-self.direction)[:2] @ self.tangent_basis.T
        jacobian = np.eye(PARAMETERS)
        jacobian[:2, :2], jacobian[2:4, 2:4] = change_of_basis, -change_of_basis
        return replace(self, cylinder=cylinder, covariance=jacobian @ self.covariance @ jacobian.T)


def estimate_variance_factor(
    normalised: FloatArray, degrees_of_freedom: int, *, known_noise: bool
) -> tuple[float, float, float]:
    """Return the factors by which residuals increase covariance and standard deviations.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals divided by their predicted standard deviations, in order along the line.
    degrees_of_freedom : int
        Number of residuals minus number of parameters.
    known_noise : bool
        Whether the standard deviations come from a noise model; otherwise only their ratios
        are used.

    Returns
    -------
    factor : float
        Factor on the covariance: the autocorrelation time of the residuals; with known noise,
        multiplied by their reduced chi^2 if that is significantly above 1.
    dof : float
        Degrees of freedom of the noise estimate; infinite with known noise.
    std_scale : float
        Factor on the standard deviations, which also applies to the covariance; 1 with known
        noise.
    """
    degrees_of_freedom = max(degrees_of_freedom, 1)
    reduced_chi2 = float(normalised @ normalised) / degrees_of_freedom
    correlation_time = autocorrelation_time(normalised)
    if known_noise:
        factor = estimate_excess_variance(reduced_chi2, degrees_of_freedom) * correlation_time
        return factor, math.inf, 1.0
    reduced_chi2 = max(reduced_chi2, float(np.finfo(float).tiny))
    return (
        correlation_time,
        max(degrees_of_freedom / correlation_time, 1.0),
        math.sqrt(reduced_chi2),
    )


def format_axis_cells(fit: CylinderFit) -> tuple[str, ...]:
    """Return the cells of a cylinder in the columns of `AXIS_HEADER`; `±` is one sigma."""
    direction_decimals = count_decimals(fit.direction_std)
    point_decimals = count_decimals(fit.position_std)
    return (
        format_value(fit.radius, fit.radius_std),
        " ".join(f"{component:+z.{direction_decimals}f}" for component in fit.direction),
        format_std(math.degrees(fit.direction_std)),
        " ".join(f"{coordinate:z.{point_decimals}f}" for coordinate in fit.point),
        format_std(fit.position_std),
    )


def build_axis_record(fit: CylinderFit) -> Record:
    """Return axis, radius and covariance, ready for JSON: lengths in mm, angles in deg.

    Only the covariance of the direction is in rad, as its order states.
    """
    return {
        "point_mm": convert_numbers_to_json(fit.point),
        "position_std_mm": fit.position_std,
        "direction": convert_numbers_to_json(fit.direction),
        "direction_std_deg": math.degrees(fit.direction_std),
        "radius_mm": fit.radius,
        "radius_std_mm": fit.radius_std,
        "covariance_order": COVARIANCE_ORDER,
        "covariance": [convert_numbers_to_json(row) for row in fit.covariance],
    }


def build_axis_row(record: Record, interval: Sequence[float]) -> Record:
    """Return the columns of a data frame from the record of a cylinder.

    `interval` is the 95 % interval of the radius. Units: mm.
    """
    x, y, z = record["point_mm"]
    u, v, w = record["direction"]
    low, high = interval
    return {
        "radius_mm": record["radius_mm"],
        "radius_std_mm": record["radius_std_mm"],
        "radius_low_95_mm": low,
        "radius_high_95_mm": high,
        "point_x_mm": x,
        "point_y_mm": y,
        "point_z_mm": z,
        "position_std_mm": record["position_std_mm"],
        "direction_x": u,
        "direction_y": v,
        "direction_z": w,
        "direction_std_deg": record["direction_std_deg"],
    }
