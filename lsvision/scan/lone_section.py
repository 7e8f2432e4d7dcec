"""What a scan of one section can say: the section's own measurement, with both twins."""

import math

import numpy as np

from lsvision.fitting.cylinder_evidence import CylinderFit
from lsvision.fitting.cylinder_problem import tangent_frame
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.settling import SettledCylinder
from lsvision.scan.tracks import Sighting
from lsvision.shapes import Cylinder, FloatArray, Pose

SMALLEST_SINE = 1e-6
"""Of phi: below, the direction's errors are limited by those that the section states."""


def settle_lone_section(cloud: ScanCloud, sighting: Sighting) -> SettledCylinder:
    """Cylinder of one arc, with its twin.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    sighting : Sighting
        The arc.

    Returns
    -------
    SettledCylinder
        The first of the section's twins; its covariance is that of either, about itself.
    """
    arc, pose = sighting.arc, cloud.poses[sighting.section]
    first, second = (twin.seen_from(pose) for twin in Cylinder.twins(arc.ellipse))
    mine = cloud.only(cloud.find(sighting.section, arc.indices))
    residuals = first.signed_distances(mine.points)
    stds = np.full(len(residuals), max(arc.fit.rms, np.finfo(float).tiny))
    fit = CylinderFit(
        cylinder=first,
        covariance=_covariance(sighting, first, pose),
        residuals=residuals,
        normalised=residuals / stds,
        stds=stds,
        inliers=np.ones(len(residuals), dtype=bool),
        variance_factor=arc.fit.variance_factor,
        degrees_of_freedom=arc.fit.degrees_of_freedom,
    )
    return SettledCylinder(fit, mine, 1.0, second)


def _covariance(sighting: Sighting, cylinder: Cylinder, pose: Pose) -> FloatArray:
    """From (centre_x, centre_y, a, b, theta) to point and direction across the axis, radius."""
    arc = sighting.arc
    a, b, phi, theta = arc.ellipse.semi_major, arc.ellipse.semi_minor, arc.phi, arc.theta
    sine = max(math.sin(phi), SMALLEST_SINE)
    phi_by = np.array([0.0, 0.0, b / a**2, -1 / a, 0.0]) / sine
    theta_by = np.array([0.0, 0.0, 0.0, 0.0, math.sin(phi)])
    # Near phi = 0 the linear errors grow without limit; the section knows better.
    phi_by *= _limited(arc.phi_std, phi_by, arc.covariance)
    theta_by *= _limited(math.sin(phi) * arc.theta_std, theta_by, arc.covariance)
    major = np.array([math.cos(theta), math.sin(theta), 0.0])
    phi_way = math.cos(phi) * major - math.sin(phi) * np.array([0.0, 0.0, 1.0])
    theta_way = np.array([-math.sin(theta), math.cos(theta), 0.0])
    direction = np.outer(phi_way, phi_by) + np.outer(theta_way, theta_by)
    across = tangent_frame(cylinder.direction)[:2] @ pose.rotation
    rows = np.vstack([across @ np.eye(3, 5), across @ direction, [0.0, 0.0, 0.0, 1.0, 0.0]])
    rows[:2, 2] = 0.0
    covariance: FloatArray = rows @ arc.covariance @ rows.T
    return covariance


def _limited(limit: float, gradient: FloatArray, covariance: FloatArray) -> float:
    linear = math.sqrt(float(gradient @ covariance @ gradient))
    return min(1.0, limit / linear) if linear > 0 else 1.0
