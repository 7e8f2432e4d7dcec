"""What errors of the poses do to a cylinder: they do not show, or show only in part, in its fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit, variance_factor
from lsvision.cylinder.problem import (
    PARAMETERS,
    axis_distances,
    parameters_from_cylinder,
    tangent_frame,
)
from lsvision.cylinder.robot_frame import SectionMount, rigid_motion_jacobian, robot_covariance
from lsvision.geometry import FloatArray, Pose
from lsvision.scan.cloud import ScanCloud

MAX_POSE_STD_MM = 1e3
"""Largest standard uncertainty of a pose: beyond a metre it says nothing. Units: mm."""
MAX_FEED_STD = 1.0
"""Largest standard uncertainty of the feed's direction, for which small angles still hold some.
Units: rad."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PoseErrors:
    """How well the poses of a scan are known.

    Parameters
    ----------
    pose_std : float
        One sigma of each section's position, per axis, independent; beside the robot's own, if
        there is a calibration. Units: mm.
    feed_std : float
        One sigma of the feed's direction (from the first profile's origin to the last's),
        about each of the two axes across it; all sections share the error. Units: rad.
    calibration : HandEye, optional
        That the poses rest on, ``base_from_flange @ flange_from_section``. Its six errors are
        the same on the flange for all sections and turn with it; the robot's own, its
        ``robot_std``, are each section's.
    """

    pose_std: float = 0.0
    feed_std: float = 0.0
    calibration: SectionMount | None = None

    def __post_init__(self) -> None:
        for what, largest in (("pose_std", MAX_POSE_STD_MM), ("feed_std", MAX_FEED_STD)):
            value = getattr(self, what)
            if not 0 <= value <= largest:
                raise ValueError(f"want {what} from 0 to {largest:g}, got {value}")

    @property
    def is_zero(self) -> bool:
        """Whether the poses are taken as exact."""
        return self.pose_std == 0 and self.feed_std == 0 and self.calibration is None


def propagate_pose_errors(fit: CylinderFit, cloud: ScanCloud, errors: PoseErrors) -> FloatArray:
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
    if errors.is_zero:
        return fit.covariance
    if len(np.unique(cloud.point_sections)) == 1:
        moved = _single_section_jacobian(fit, cloud.poses[cloud.point_sections[0]], errors)
        alone: FloatArray = fit.covariance + moved @ moved.T
        return alone
    frame, stds = tangent_frame(fit.direction), fit.stds[:, None]
    parameters = parameters_from_cylinder(frame, fit.cylinder)
    _, normals, _ = axis_distances(cloud.points @ frame.T, parameters)
    along = (cloud.points - fit.point) @ fit.direction
    design = np.vstack([normals[:2], along * normals[:2], np.ones(len(cloud))]).T / stds
    shared, own = (
        columns(normals.T @ frame, cloud, errors) / stds
        for columns in (common_error_jacobian, section_error_jacobian)
    )
    model = fit.covariance / fit.variance_factor
    # Least squares answers columns of changes of the distances by these of the parameters.
    response = model @ (design.T @ shared)
    starts = np.unique(cloud.point_sections, return_index=True)[1]
    own_response = model @ np.add.reduceat(design[:, :, None] * own[:, None, :], starts)
    covariance: FloatArray = (
        model * _remaining_variance_factor(fit, design, shared, own, cloud)
        + response @ response.T
        + np.einsum("sik,sjk->ij", own_response, own_response)
    )
    return covariance


def common_error_jacobian(
    directions: FloatArray, cloud: ScanCloud, errors: PoseErrors
) -> FloatArray:
    """Change of each point along a direction by one sigma of each error that sections share.

    Parameters
    ----------
    directions : (n, 3) ndarray
        Unit vectors, one a point, base frame.
    cloud : ScanCloud
        The points, with their sections' poses.
    errors : PoseErrors
        How well the poses are known.

    Returns
    -------
    (n, k) ndarray
        Two columns of the feed, six of the calibration. Units: mm.
    """
    columns = [np.zeros((len(cloud), 0))]
    if errors.feed_std > 0:
        feed, steps = feed_direction(cloud.poses)
        across = np.linalg.svd(feed[None])[2][1:]
        columns.append(
            errors.feed_std * steps[cloud.point_sections][:, None] * (directions @ across.T)
        )
    if errors.calibration is not None:
        flange_from_section = errors.calibration.flange_from_section
        axes = np.array([p.rotation @ flange_from_section.rotation.T for p in cloud.poses])
        pivots = np.array([pose.translation for pose in cloud.poses])
        turned = axes[cloud.point_sections]
        shifts, turns = _shifts_and_turns(directions, cloud, pivots)
        both = [np.einsum("ni,nij->nj", vectors, turned) for vectors in (shifts, turns)]
        columns.append(np.hstack(both) @ _covariance_root(errors.calibration.covariance))
    return np.hstack(columns)


def section_error_jacobian(
    directions: FloatArray, cloud: ScanCloud, errors: PoseErrors
) -> FloatArray:
    """The same by one sigma of each error that each section has for itself: (n, 0, 3 or 6)."""
    if errors.calibration is None:
        return errors.pose_std * directions[:, : 3 * (errors.pose_std > 0)]
    pivots = np.array([_flange_origin(pose, errors.calibration) for pose in cloud.poses])
    shifts, turns = _shifts_and_turns(directions, cloud, pivots)
    position, rotation = errors.calibration.robot_std
    return np.hstack([np.hypot(position, errors.pose_std) * shifts, rotation * turns])


def _shifts_and_turns(
    directions: FloatArray, cloud: ScanCloud, pivots: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Change along a direction by shifts along the base's axes, and turns about a pivot."""
    # d . (w x arm) = w . (arm x d)
    return directions, np.cross(cloud.points - pivots[cloud.point_sections], directions)


def _flange_origin(base_from_section: Pose, calibration: SectionMount) -> FloatArray:
    return base_from_section.apply_one(calibration.flange_from_section.inverse().translation)


def _covariance_root(covariance: FloatArray) -> FloatArray:
    """Columns of independent errors that make the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _single_section_jacobian(fit: CylinderFit, pose: Pose, errors: PoseErrors) -> FloatArray:
    """(5, k) change of a cylinder that one section alone shows: it moves with the section."""
    columns = [errors.pose_std * np.eye(7, 3)]
    calibration = errors.calibration
    if calibration is not None:
        axes = pose.rotation @ calibration.flange_from_section.rotation.T
        by_mount = rigid_motion_jacobian(fit.cylinder, pose.translation, axes)
        pivot = _flange_origin(pose, calibration)
        by_robot = rigid_motion_jacobian(fit.cylinder, pivot, np.eye(3))
        columns.append(by_mount @ _covariance_root(calibration.covariance))
        columns.append(by_robot @ _covariance_root(robot_covariance(calibration)))
    moved = np.hstack(columns)
    return np.vstack([fit.tangent_basis @ moved[:3], fit.tangent_basis @ moved[3:6], moved[6]])


def _remaining_variance_factor(
    fit: CylinderFit, design: FloatArray, shared: FloatArray, own: FloatArray, cloud: ScanCloud
) -> float:
    """Variance factor of what the errors of the poses leave unexplained of the residuals.

    Without that, what they add to the residuals would be counted twice: here and as response.
    All columns are over the points' standard deviations; an error's prior is of sigma 1.
    """
    if shared.shape[1] + own.shape[1] == 0:
        return fit.variance_factor
    both = np.hstack([design, shared])
    lighter, rest, explained = both.copy(), fit.normalised.copy(), 0.0
    for section in np.unique(cloud.point_sections):
        mine = cloud.point_sections == section
        inner = np.linalg.inv(np.eye(own.shape[1]) + own[mine].T @ own[mine])
        for values in (lighter, rest):
            # (I + C C')^-1 v = v - C (I + C'C)^-1 C' v
            values[mine] -= own[mine] @ (inner @ (own[mine].T @ values[mine]))
        explained += own.shape[1] - float(np.trace(inner))
    known = np.repeat([0.0, 1.0], [PARAMETERS, shared.shape[1]])
    rest -= lighter @ np.linalg.solve(both.T @ lighter + np.diag(known), lighter.T @ fit.normalised)
    freedom = round(len(rest) - PARAMETERS - explained)
    factor, _, spread = variance_factor(rest, freedom, known_noise=cloud.noise_known)
    return factor * spread**2


def feed_direction(base_from_sections: Sequence[Pose]) -> tuple[FloatArray, FloatArray]:
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
