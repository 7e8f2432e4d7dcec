"""The bound of a scan: five unknowns of a cylinder from points of several sections."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, FloatArray, Points, as_readonly_array
from lsvision.planning.information import UNIFORM_THETA, information, invert_information
from lsvision.planning.sensor_view import cylinder_normals


@dataclass(frozen=True, kw_only=True, slots=True)
class Feed:
    """How the sections of a scan follow each other, and how well that is known.

    Parameters
    ----------
    sections : int
        Their number.
    spacing : float
        Distance from one to the next. Units: mm.
    direction : tuple of float
        Direction of the motion in the section frame, any length but zero.
    pose_std : float
        One sigma of each section's position, along each axis, independent from section to
        section. Units: mm.
    feed_std : float
        One sigma of the feed direction, about each axis across it, common to all sections;
        goes nearly whole into the direction found, and hardly shows in the residuals. Units: rad.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    sections: int = 20
    spacing: float = 1.0
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    pose_std: float = 0.0
    feed_std: float = 0.0

    def __post_init__(self) -> None:
        if not self.sections >= 1:
            raise ValueError(f"want sections >= 1, got {self.sections}")
        if not (math.isfinite(self.spacing) and self.spacing > 0):
            raise ValueError(f"want a positive spacing in mm, got {self.spacing}")
        length = math.hypot(*self.direction)
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"want a feed direction with a length, got {self.direction}")
        for what in ("pose_std", "feed_std"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"want {what} >= 0, got {value}")

    @property
    def unit(self) -> FloatArray:
        """(3,) unit vector of the motion."""
        return np.array(self.direction) / math.hypot(*self.direction)

    @property
    def length(self) -> float:
        """From the first section to the last. Units: mm."""
        return (self.sections - 1) * self.spacing

    @property
    def shifts(self) -> FloatArray:
        """(sections, 3) positions of the sections, the middle of the scan at 0. Units: mm."""
        steps = (np.arange(self.sections) - (self.sections - 1) / 2) * self.spacing
        shifts: FloatArray = np.outer(steps, self.unit)
        return shifts


@dataclass(frozen=True, eq=False)
class ScanPrediction:
    """One-sigma errors to expect from a joint fit to all sections of a scan.

    Parameters
    ----------
    radius_std : float
        Units: mm.
    direction_std : float
        Root mean square angle between the direction found and the true one. Units: rad.
    theta_std, phi_std : float
        Of the direction's azimuth and its angle from Z, in the frame of the points. Theta at
        most 52 deg, the spread of an angle about which nothing is known. Units: rad.
    position_std : float
        Root mean square distance, across the axis, from the cylinder's `point` to the axis
        found. Units: mm.
    covariance : (5, 5) ndarray
        The bound: point along e_phi, point along e_theta (mm), direction along e_phi, along
        e_theta (rad), radius (mm), with e_phi the way of growing phi, e_theta = Z x direction.
    points, sections : int
        Numbers it rests on.
    length : float
        From the first section to the last. Units: mm.
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

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (5, 5), "covariance")
        )


def scan_bound(
    cylinder: Cylinder,
    points: Points,
    variances: FloatArray,
    *,
    known_radius_std: float | None = None,
    shared_errors: FloatArray | None = None,
) -> ScanPrediction:
    """Cramer-Rao bound of a cylinder from points anywhere on it.

    Parameters
    ----------
    cylinder : Cylinder
        The true one, in the frame of the points; its `point` is where the position's error is
        stated (smallest amid the points).
    points : (n, 3) ndarray
        Noise-free points on the surface. Units: mm.
    variances : (n,) ndarray
        Variance of each point's error along the surface's normal, n' Sigma n. Units: mm^2.
    known_radius_std : float, optional
        One sigma of a radius known beforehand; 0 = exactly. Units: mm.
    shared_errors : (n, k) ndarray, optional
        Change of each point's signed distance by one sigma of each of k errors that points
        share, such as those of a pose. They are carried through a fit that takes the poses as
        given, and added: what is reached then, no longer the bound. Units: mm.

    Returns
    -------
    ScanPrediction
        One sigma of each number; `sections` and `length` are left at one section.

    Raises
    ------
    TooFewPoints
        If there are fewer than two points.
    DegenerateGeometry
        If the points leave the cylinder undetermined.
    ValueError
        If shapes do not match or a variance is not positive.
    """
    points = as_readonly_array(points, ("n", 3), "points")
    variances = as_readonly_array(variances, (len(points),), "variances")
    axes = _tilt_axes(cylinder.direction)
    normals = cylinder_normals(cylinder, points)
    along = (points - cylinder.point) @ cylinder.direction
    across = normals @ axes.T
    gradients = np.column_stack([across, along[:, None] * across, np.ones(len(points))])
    known = None if known_radius_std is None else (4, known_radius_std)
    bound = invert_information(information(gradients, variances), known)
    if shared_errors is not None:
        bound = bound + _propagated_covariance(bound, gradients, variances, shared_errors)
    return _prediction(cylinder, bound, len(points))


def _tilt_axes(direction: FloatArray) -> FloatArray:
    """(2, 3) unit vectors across the axis: the way phi grows, and the way theta grows."""
    theta_way = np.array([-direction[1], direction[0], 0.0])
    length = np.linalg.norm(theta_way)
    theta_way = theta_way / length if length > 0 else np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(theta_way, direction), theta_way])


def _propagated_covariance(
    bound: FloatArray, gradients: FloatArray, variances: FloatArray, shared_errors: FloatArray
) -> FloatArray:
    """Covariance that errors common to many points add, through the fit's own linear response."""
    errors = as_readonly_array(shared_errors, (len(gradients), "k"), "shared_errors")
    response: FloatArray = bound @ ((gradients / variances[:, None]).T @ errors)
    return response @ response.T


def _prediction(cylinder: Cylinder, bound: FloatArray, points: int) -> ScanPrediction:
    variances = np.diag(bound)
    sin_phi = math.hypot(cylinder.direction[0], cylinder.direction[1])
    theta_std = math.sqrt(variances[3]) / sin_phi if sin_phi > 0 else math.inf
    return ScanPrediction(
        radius_std=math.sqrt(variances[4]),
        direction_std=math.sqrt(variances[2] + variances[3]),
        theta_std=min(theta_std, UNIFORM_THETA),
        phi_std=math.sqrt(variances[2]),
        position_std=math.sqrt(variances[0] + variances[1]),
        covariance=bound,
        points=points,
    )
