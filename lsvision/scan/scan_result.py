"""Result of a scan: cylinders in the base frame, and rejected arcs."""

from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.geometry import Cylinder, FloatArray, IntArray, Points
from lsvision.measure import Measurement


@dataclass(frozen=True, eq=False, slots=True)
class ScannedCylinder:
    """Cylinder measured jointly from the sections of a scan.

    Parameters
    ----------
    fit : CylinderFit
        The joint fit in the base frame. Its point is the axis point nearest to the first
        section's origin, its direction is positive along the feed (from the first profile's
        origin to the last's; if the feed is zero or perpendicular to the axis, along the first
        section's Z). Its covariance includes the errors of the poses and of the hand-eye
        calibration, if given.
    sections : tuple of int
        Indices of the profiles with points of the cylinder.
    points : (n, 3) ndarray
        The points used, base frame. Units: mm.
    point_sections, indices : (n,) int ndarray
        Index of each point's profile, and index of the point in that profile.
    axial_range : tuple of float
        Positions along the axis, from `point` along `direction`, of the first and the last
        point; the tube may extend beyond the scan. Units: mm.
    axial_range_std : tuple of float
        Standard uncertainty of `axial_range`. Units: mm.
    twin : Cylinder or None
        The other cylinder that fits equally well, if only one section was measured.
    includes_calibration : bool
        Whether the covariance includes the errors of a hand-eye calibration; otherwise the
        sensor mount is taken as exact.
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
        """Cylinder in the base frame."""
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
        """Radius. Units: mm."""
        return self.fit.radius

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm."""
        return self.fit.radius_std

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction. Units: rad."""
        return self.fit.direction_std

    @property
    def position_std(self) -> float:
        """Root mean square distance of `point` from the true axis. Units: mm."""
        return self.fit.position_std

    @property
    def covariance(self) -> FloatArray:
        """(5, 5): point (mm) and direction (rad), each along e_phi and e_theta, radius (mm).

        e_phi and e_theta are the rows of ``fit.tangent_basis``.
        """
        return self.fit.covariance

    @property
    def ambiguous(self) -> bool:
        """Whether the `twin` fits equally well: only one section was measured."""
        return self.twin is not None

    @property
    def section_residuals(self) -> FloatArray:
        """(k, 2) mean and rms of the residuals of each of `sections`. Units: mm."""
        residuals = [self.fit.residuals[self.point_sections == s] for s in self.sections]
        return np.array([[r.mean(), np.sqrt(np.mean(r * r))] for r in residuals])


@dataclass(frozen=True, slots=True)
class ScanRejection:
    """Arcs of a scan that were rejected, with the reason.

    Parameters
    ----------
    sections : tuple of int
        Indices of the profiles with the arcs.
    reason : str
        Quantity and limit that it exceeds, or error of the fit.
    """

    sections: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class ScanMeasurement:
    """Result of `measure_scan`.

    Parameters
    ----------
    cylinders : tuple of ScannedCylinder
        In the order of the first section that shows them, then by ascending x in it.
    rejections : tuple of ScanRejection
        Arcs that were detected in a profile and rejected by the joint fit.
    measurements : tuple of Measurement
        Measurement of each profile by itself, in the order of the profiles.
    """

    cylinders: tuple[ScannedCylinder, ...]
    rejections: tuple[ScanRejection, ...]
    measurements: tuple[Measurement, ...]
