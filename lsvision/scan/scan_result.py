"""What a scan yields: cylinders in the base frame, each with its evidence."""

from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.geometry import Cylinder, FloatArray, IntArray, Points
from lsvision.measure import Measurement


@dataclass(frozen=True, eq=False, slots=True)
class ScannedCylinder:
    """A cylinder measured from the sections of a scan together.

    Parameters
    ----------
    fit : CylinderFit
        The joint fit in the base frame, its point the axis point nearest to the first
        section's origin, its direction positive along the feed (from the first profile's
        origin to the last's; where that is square to the axis or nothing, along the first
        section's Z). Its covariance includes the errors of the poses and of the hand-eye
        calibration, if given.
    sections : tuple of int
        Indices of the profiles that show it.
    points : (n, 3) ndarray
        The points used, base frame. Units: mm.
    point_sections, indices : (n,) int ndarray
        Index of each point's profile, and of the point in it.
    axial_range : tuple of float
        Places along the axis, from `point` along `direction`, of the farthest points seen; the
        pipe may go on where the scan does not. Units: mm.
    axial_range_std : tuple of float
        One sigma of those places. Units: mm.
    twin : Cylinder or None
        The other cylinder that fits as well, where only one section was seen.
    includes_calibration : bool
        Whether the covariance holds a hand-eye calibration's errors; else the poses' sensor
        mount is taken as exact.
    """

    fit: CylinderFit
    sections: tuple[int, ...]
    points: Points
    point_sections: IntArray
    indices: IntArray
    axial_range: tuple[float, float]
    axial_range_std: tuple[float, float]
    twin: Cylinder | None = None
    includes_calibration: bool = False

    @property
    def cylinder(self) -> Cylinder:
        """Base frame."""
        return self.fit.cylinder

    @property
    def point(self) -> FloatArray:
        """(3,) axis point nearest to the first section's origin, base frame. Units: mm."""
        return self.fit.point

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector along the axis, positive along the feed, base frame."""
        return self.fit.direction

    @property
    def radius(self) -> float:
        """Units: mm."""
        return self.fit.radius

    @property
    def radius_std(self) -> float:
        """One sigma of the radius. Units: mm."""
        return self.fit.radius_std

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction, both ways together. Units: rad."""
        return self.fit.direction_std

    @property
    def position_std(self) -> float:
        """Root mean square distance of `point` from the true axis. Units: mm."""
        return self.fit.position_std

    @property
    def covariance(self) -> FloatArray:
        """(5, 5): point along e_phi, e_theta (mm), direction along them (rad), radius (mm).

        e_phi and e_theta are the rows of ``fit.tangent_basis``.
        """
        return self.fit.covariance

    @property
    def ambiguous(self) -> bool:
        """Whether its `twin` fits as well: it was seen in one section only."""
        return self.twin is not None

    @property
    def section_residuals(self) -> FloatArray:
        """(k, 2) mean and rms of the residuals of each of `sections`. Units: mm."""
        mine = [self.fit.residuals[self.point_sections == section] for section in self.sections]
        return np.array([[r.mean(), np.sqrt(np.mean(r * r))] for r in mine])


@dataclass(frozen=True, slots=True)
class ScanRejection:
    """Arcs of a scan that are no cylinder, and why.

    Parameters
    ----------
    sections : tuple of int
        Indices of the profiles that show them.
    reason : str
        In words and numbers.
    """

    sections: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class ScanMeasurement:
    """What a scan holds.

    Parameters
    ----------
    cylinders : tuple of ScannedCylinder
        In the order of the first section that shows them, then left to right in it.
    rejections : tuple of ScanRejection
        Arcs that detection took for a cylinder's and the joint fit did not.
    measurements : tuple of Measurement
        What each profile holds by itself, in their order.
    """

    cylinders: tuple[ScannedCylinder, ...]
    rejections: tuple[ScanRejection, ...]
    measurements: tuple[Measurement, ...]
