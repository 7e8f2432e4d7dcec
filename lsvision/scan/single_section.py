"""Cylinder of a scan from one section: one of two twins."""

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.robot_frame import twin_jacobian
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Cylinder, FloatArray, Points, Pose, build_tangent_frame


def fit_single_section(
    arc: CylinderSection, points: Points, pose: Pose
) -> tuple[CylinderFit, Cylinder]:
    """Return the cylinder of one arc, the first of its two twins, and the second one.

    The points (n, 3) of the arc and the results are in the base frame; `pose` is
    ``base_from_section``.
    """
    first, second = (twin.transformed(pose) for twin in Cylinder.twins(arc.ellipse))
    residuals = first.signed_distances(points)
    stds = np.full(len(residuals), max(arc.fit.rms, np.finfo(float).tiny))
    fit = CylinderFit(
        cylinder=first,
        covariance=_single_section_covariance(arc, first, pose),
        residuals=residuals,
        normalised=residuals / stds,
        stds=stds,
        inliers=np.ones(len(residuals), dtype=bool),
        variance_factor=arc.fit.variance_factor,
        degrees_of_freedom=arc.fit.degrees_of_freedom,
    )
    return fit, second


def _single_section_covariance(arc: CylinderSection, first: Cylinder, pose: Pose) -> FloatArray:
    """Return `CylinderFit.covariance` propagated from that of (centre_x, centre_y, a, b, theta)."""
    basis = build_tangent_frame(first.direction)[:2] @ pose.rotation
    by_ellipse = twin_jacobian(arc, 1.0)
    jacobian = np.vstack([basis @ by_ellipse[:3], basis @ by_ellipse[3:6], by_ellipse[6]])
    covariance: FloatArray = jacobian @ arc.covariance @ jacobian.T
    return covariance
