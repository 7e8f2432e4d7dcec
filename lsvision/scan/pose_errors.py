"""What errors of the poses do to a cylinder: they do not show, or show only in part, in its fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.fitting.cylinder_evidence import CylinderFit, variance_factor
from lsvision.fitting.cylinder_problem import axis_distances, parameters_in, tangent_frame
from lsvision.scan.cloud import ScanCloud
from lsvision.shapes import FloatArray, IntArray, Pose


@dataclass(frozen=True, kw_only=True, slots=True)
class PoseErrors:
    """How well the poses of a scan are known.

    Parameters
    ----------
    pose_std : float
        One sigma of each section's position, per axis, independent. Units: mm.
    feed_std : float
        One sigma of the feed's direction (from the first profile's origin to the last's),
        about each of the two axes across it; all sections share the error. Units: rad.
    """

    pose_std: float = 0.0
    feed_std: float = 0.0

    def __post_init__(self) -> None:
        for what in ("pose_std", "feed_std"):
            value = getattr(self, what)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"want {what} >= 0, got {value}")


def carried_covariance(fit: CylinderFit, cloud: ScanCloud, errors: PoseErrors) -> FloatArray:
    """Covariance of a joint fit with the errors of the poses carried through it.

    Parameters
    ----------
    fit : CylinderFit
        Fit to the points of `cloud` that took the poses as they are.
    cloud : ScanCloud
        Its points.
    errors : PoseErrors
        How well the poses are known.

    Returns
    -------
    (5, 5) ndarray
        In the order of ``fit.covariance``, at ``fit.point``. Units: mm, rad.
    """
    if errors.pose_std == 0 and errors.feed_std == 0:
        return fit.covariance
    frame, stds = tangent_frame(fit.direction), fit.stds[:, None]
    parameters = parameters_in(frame, fit.cylinder)
    _, normals, _ = axis_distances(cloud.points @ frame.T, parameters)
    along = (cloud.points - fit.point) @ fit.direction
    gradients = np.vstack([normals[:2], along * normals[:2], np.ones(len(cloud))]).T
    model, factor = fit.covariance / fit.variance_factor, fit.variance_factor
    if errors.pose_std > 0:
        # What stray sections add to the residuals is carried below, not counted here again.
        factor = _factor_without_shifts(fit.normalised, normals[:2].T / stds, cloud.owners)
    columns = _pose_columns(normals.T @ frame, cloud, errors)
    response = model @ ((gradients / stds**2).T @ columns)
    covariance: FloatArray = model * factor + response @ response.T
    return covariance


def _factor_without_shifts(normalised: FloatArray, design: FloatArray, owners: IntArray) -> float:
    rest = normalised.copy()
    sections = np.unique(owners)
    for section in sections:
        mine = owners == section
        shift = np.linalg.lstsq(design[mine], normalised[mine], rcond=None)[0]
        rest[mine] -= design[mine] @ shift
    freedom = len(rest) - 5 - 2 * len(sections)
    return variance_factor(rest, freedom, known_noise=True)[0]


def _pose_columns(normals: FloatArray, cloud: ScanCloud, errors: PoseErrors) -> FloatArray:
    """Change of each point's distance by one sigma of each error of the poses."""
    columns = []
    if errors.pose_std > 0:
        mine = cloud.owners[:, None] == np.unique(cloud.owners)
        columns += [errors.pose_std * normals[:, [axis]] * mine for axis in range(3)]
    if errors.feed_std > 0:
        feed, steps = feed_of(cloud.poses)
        across = np.linalg.svd(feed[None])[2][1:]
        columns.append(errors.feed_std * steps[cloud.owners][:, None] * (normals @ across.T))
    return np.column_stack(columns)


def feed_of(base_from_sections: Sequence[Pose]) -> tuple[FloatArray, FloatArray]:
    """Unit vector from the first section's origin to the last's, and each one's place on it.

    Parameters
    ----------
    base_from_sections : sequence of Pose
        One or more.

    Returns
    -------
    feed : (3,) ndarray
        Zero where first and last origin are one point.
    steps : (k,) ndarray
        From the first. Units: mm.
    """
    origins = np.array([pose.translation for pose in base_from_sections])
    way = origins[-1] - origins[0]
    length = float(np.linalg.norm(way))
    feed = way / length if length > 0 else np.zeros(3)
    return feed, (origins - origins[0]) @ feed
