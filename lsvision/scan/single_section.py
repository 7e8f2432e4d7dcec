"""What a scan of one section can say: the section's own measurement, with both twins."""

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.problem import tangent_frame
from lsvision.cylinder.robot_frame import twin_jacobian
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Cylinder, FloatArray, Pose
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.joint_fit import JointFit
from lsvision.scan.tracks import ArcObservation


def cylinder_from_single_section(cloud: ScanCloud, sighting: ArcObservation) -> JointFit:
    """Cylinder of one arc, with its twin.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    sighting : ArcObservation
        The arc.

    Returns
    -------
    JointFit
        The first of the section's twins; its covariance is that of either, about itself.
    """
    arc, pose = sighting.arc, cloud.poses[sighting.section]
    first, second = (twin.transformed(pose) for twin in Cylinder.twins(arc.ellipse))
    mine = cloud.subset(cloud.rows_of(sighting.section, arc.indices))
    residuals = first.signed_distances(mine.points)
    stds = np.full(len(residuals), max(arc.fit.rms, np.finfo(float).tiny))
    fit = CylinderFit(
        cylinder=first,
        covariance=_covariance(arc, first, pose),
        residuals=residuals,
        normalised=residuals / stds,
        stds=stds,
        inliers=np.ones(len(residuals), dtype=bool),
        variance_factor=arc.fit.variance_factor,
        degrees_of_freedom=arc.fit.degrees_of_freedom,
    )
    return JointFit(fit, mine, 1.0, second)


def _covariance(section: CylinderSection, cylinder: Cylinder, pose: Pose) -> FloatArray:
    """From (centre_x, centre_y, a, b, theta) to point and direction across the axis, radius."""
    across = tangent_frame(cylinder.direction)[:2] @ pose.rotation
    by_fit = twin_jacobian(section, 1.0)
    rows = np.vstack([across @ by_fit[:3], across @ by_fit[3:6], by_fit[6]])
    covariance: FloatArray = rows @ section.covariance @ rows.T
    return covariance
