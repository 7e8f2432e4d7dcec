"""Propagate the errors of the poses to the covariance of a jointly fitted cylinder.

Errors common to all sections do not appear in the residuals of the fit, and independent errors
of the sections only in part; both enter as the linear response of the fit to them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit, estimate_variance_factor
from lsvision.cylinder.problem import PARAMETERS, axis_distances, parameters_from_cylinder
from lsvision.cylinder.robot_frame import SectionMount, rigid_motion_jacobian
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry import FloatArray, IntArray, Pose, build_tangent_frame
from lsvision.scan.cloud import PosedPoints, ScanCloud

MAX_POSE_STD_MM = 1e3
"""Largest permissible standard uncertainty of a position: a metre. Units: mm."""
MAX_FEED_STD = 1.0
"""Largest standard uncertainty of the feed's direction for which small-angle approximations are
tolerable. Units: rad."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PoseErrors:
    """Uncertainty of the poses of a scan.

    Parameters
    ----------
    pose_std : float
        Standard uncertainty of each section's position, per axis, independent between sections;
        in addition to the robot's own, if a calibration is given. Units: mm.
    feed_std : float
        Standard uncertainty of the feed direction (from the first profile's origin to the
        last's) about each of the two axes perpendicular to it, common to all sections.
        Units: rad.
    calibration : HandEye, optional
        Calibration used for the poses, ``base_from_flange @ flange_from_section``. Its six
        errors are constant in the flange frame and so rotate with the flange; the robot's errors,
        ``robot_std``, are independent between sections.
    """

    pose_std: float = 0.0
    feed_std: float = 0.0
    calibration: SectionMount | None = None

    def __post_init__(self) -> None:
        limits = {"pose_std": (MAX_POSE_STD_MM, "mm"), "feed_std": (MAX_FEED_STD, "rad")}
        for name, (largest, unit) in limits.items():
            value = getattr(self, name)
            if not isinstance(value, int | float | np.number):
                raise TypeError(f"expected {name} as a number in {unit}, got {value!r}")
            if not 0 <= value <= largest:
                raise ValueError(f"expected {name} from 0 to {largest:g} {unit}, got {value}")
        if self.calibration is not None and not hasattr(self.calibration, "flange_from_section"):
            raise TypeError(
                "expected calibration as HandEye.load or lsv.calibrate_hand_eye_* returns it, got "
                f"{type(self.calibration).__name__}"
            )


def require_feed(base_from_sections: Sequence[Pose], errors: PoseErrors) -> None:
    """Raise an error if the direction of the feed is uncertain, and there is none.

    Raises
    ------
    ValueError
        If ``feed_std`` is above 0, and the first and the last of several sections have the same
        origin, as of a sensor that moves there and back.
    """
    if errors.feed_std > 0 and len(base_from_sections) > 1:
        feed, _ = measure_feed(base_from_sections)
        if not feed.any():
            raise ValueError(
                f"feed_std {errors.feed_std:g} rad without a feed: the first and the last section "
                "have the same origin; end the scan at another position, or state pose_std"
            )


@dataclass(frozen=True, eq=False, slots=True)
class PoseErrorResponse:
    """Changes of the parameters of a fit by pose errors of one standard deviation.

    Parameters
    ----------
    common : (5, k) ndarray
        By the errors common to all sections, in the columns of `common_error_jacobian` and the
        order of ``fit.covariance``. Units: mm, rad.
    sections : (s, 5, k) ndarray
        For each section with points, ascending, by its own errors, in the columns of
        `section_error_jacobian`.
    """

    common: FloatArray
    sections: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the fit by the errors of the poses alone, (5, 5)."""
        own = np.einsum("sik,sjk->ij", self.sections, self.sections)
        covariance: FloatArray = self.common @ self.common.T + own
        return covariance


def propagate_pose_errors(
    fit: CylinderFit,
    cloud: ScanCloud,
    errors: PoseErrors,
    known_radius: RadiusPrior | None,
) -> tuple[FloatArray, PoseErrorResponse]:
    """Return the covariance of a joint fit including the errors of the poses, and the response.

    The fit to the points of `cloud`, with the prior `known_radius`, takes the poses as exact. The
    covariance (5, 5) is at ``fit.point`` and in the order of ``fit.covariance``; that of the
    response, which is linear, is a part of it.
    """
    starts = np.unique(cloud.point_sections, return_index=True)[1]
    if errors == PoseErrors():
        no_response = np.zeros((PARAMETERS, 0)), np.zeros((len(starts), PARAMETERS, 3))
        return fit.covariance, PoseErrorResponse(*no_response)
    if len(starts) == 1:
        response = _compute_single_section_response(fit, cloud, errors)
        return fit.covariance + response.covariance, response
    # Outliers of a truncated fit have no weight.
    fit = replace(
        fit,
        stds=np.where(fit.inliers, fit.stds, np.inf),
        normalised=np.where(fit.inliers, fit.normalised, 0.0),
    )
    frame, stds = build_tangent_frame(fit.direction), fit.stds[:, None]
    parameters = parameters_from_cylinder(frame, fit.cylinder)
    _, normals, _ = axis_distances(cloud.points @ frame.T, parameters)
    along = (cloud.points - fit.point) @ fit.direction
    cylinder_jacobian = np.vstack([normals[:2], along * normals[:2], np.ones(len(cloud))]).T / stds
    base_normals = normals.T @ frame
    common_jacobian = common_error_jacobian(base_normals, cloud, errors) / stds
    section_jacobian = section_error_jacobian(base_normals, cloud, errors) / stds
    # (J'J)^-1 of the fit, which maps a change d of the normalised distances to (J'J)^-1 J'd.
    fit_covariance = fit.covariance / fit.variance_factor
    response = PoseErrorResponse(
        fit_covariance @ (cylinder_jacobian.T @ common_jacobian),
        fit_covariance
        @ np.add.reduceat(cylinder_jacobian[:, :, None] * section_jacobian[:, None, :], starts),
    )
    factor = _remaining_variance_factor(
        fit, cylinder_jacobian, common_jacobian, section_jacobian, cloud
    )
    covariance = fit_covariance * factor + response.covariance
    if known_radius is not None:
        # The fit weights the prior beside residuals with the pose errors: its own error remains.
        information = fit.variance_factor / known_radius.effective_std**2
        column = fit_covariance[:, 4]
        covariance += (fit.variance_factor - factor) * information * np.outer(column, column)
    return covariance, response


def common_error_jacobian(
    directions: FloatArray, cloud: PosedPoints, errors: PoseErrors
) -> FloatArray:
    """Return the displacement of each point along a direction by errors common to all sections.

    `directions` (n, 3) are unit vectors, one for each point, base frame. The displacements (n, k)
    are those by one standard deviation of each error: two of the feed direction, six of the
    calibration. Units: mm.
    """
    columns = [np.zeros((len(directions), 0))]
    if errors.feed_std > 0:
        feed, distances = measure_feed(cloud.poses)
        lateral = build_tangent_frame(feed)[:2]
        columns.append(
            errors.feed_std * distances[cloud.point_sections][:, None] * (directions @ lateral.T)
        )
    if errors.calibration is not None:
        flange_from_section = errors.calibration.flange_from_section
        rotations = np.array(
            [pose.rotation @ flange_from_section.rotation.T for pose in cloud.poses]
        )[cloud.point_sections]
        pivots = np.array([pose.translation for pose in cloud.poses])
        # From the base frame to the flange frame, in which the covariance is stated.
        in_flange = [
            np.einsum("ni,nij->nj", vectors, rotations)
            for vectors in _translation_and_rotation_jacobians(directions, cloud, pivots)
        ]
        columns.append(
            np.hstack(in_flange) @ _compute_covariance_root(errors.calibration.covariance)
        )
    return np.hstack(columns)


def section_error_jacobian(
    directions: FloatArray, cloud: PosedPoints, errors: PoseErrors
) -> FloatArray:
    """Return the displacement of each point along a direction by the errors of its own section.

    Parameters as for `common_error_jacobian`; the (n, k) result has 3 columns (translation along
    the axes of the base frame), with a calibration 6 (and rotation). Units: mm.
    """
    if errors.calibration is None:
        return errors.pose_std * directions
    pivots = np.array([_locate_flange(pose, errors.calibration) for pose in cloud.poses])
    jacobians = _translation_and_rotation_jacobians(directions, cloud, pivots)
    return np.hstack(jacobians) * _section_stds(errors, errors.calibration)


def _section_stds(errors: PoseErrors, calibration: SectionMount) -> FloatArray:
    """Return the stds of a section's own translations (mm) and rotations (rad), (6,)."""
    position_std, rotation_std = calibration.robot_std
    return np.repeat([np.hypot(position_std, errors.pose_std), rotation_std], 3)


def _translation_and_rotation_jacobians(
    directions: FloatArray, cloud: PosedPoints, pivots: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the (n, 3) changes along a direction by unit translations and rotations (rad).

    `pivots` are the points about which the sections rotate, (k, 3), base frame.
    """
    # d . (w x arm) = w . (arm x d)
    return directions, np.cross(cloud.points - pivots[cloud.point_sections], directions)


def _locate_flange(base_from_section: Pose, calibration: SectionMount) -> FloatArray:
    """Return the origin (3,) of the flange in the base frame, in mm."""
    return base_from_section.apply_one(calibration.flange_from_section.inverse().translation)


def _compute_covariance_root(covariance: FloatArray) -> FloatArray:
    """Return a matrix C with C C' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _compute_single_section_response(
    fit: CylinderFit, cloud: ScanCloud, errors: PoseErrors
) -> PoseErrorResponse:
    """Return the response of a cylinder that moves rigidly with its only section."""
    section = cloud.point_sections[0]
    pose, calibration = cloud.poses[section], errors.calibration
    # Rows: point (3), direction (3), radius.
    common, own = [np.zeros((7, 0))], errors.pose_std * np.eye(7, 3)
    if errors.feed_std > 0:
        feed, distances = measure_feed(cloud.poses)
        lateral = build_tangent_frame(feed)[:2].T
        common.append(errors.feed_std * distances[section] * np.eye(7, 3) @ lateral)
    if calibration is not None:
        axes = pose.rotation @ calibration.flange_from_section.rotation.T
        mount_jacobian = rigid_motion_jacobian(fit.cylinder, pose.translation, axes)
        common.append(mount_jacobian @ _compute_covariance_root(calibration.covariance))
        flange = _locate_flange(pose, calibration)
        own = rigid_motion_jacobian(fit.cylinder, flange, np.eye(3))
        own = own * _section_stds(errors, calibration)
    basis = np.zeros((PARAMETERS, 7))
    basis[:2, :3], basis[2:4, 3:6], basis[4, 6] = fit.tangent_basis, fit.tangent_basis, 1.0
    return PoseErrorResponse(basis @ np.hstack(common), (basis @ own)[None])


def _remaining_variance_factor(
    fit: CylinderFit,
    cylinder_jacobian: FloatArray,
    common_jacobian: FloatArray,
    section_jacobian: FloatArray,
    cloud: ScanCloud,
) -> float:
    """Return the variance factor of the residuals after removing the effect of the pose errors.

    Otherwise the part of the pose errors that appears in the residuals would be counted twice,
    here and in the response of the fit. All Jacobians are divided by the points' standard
    deviations; each pose error has a prior standard deviation of 1.
    """
    dof = int(fit.inliers.sum()) - PARAMETERS
    before = _scaled_variance_factor(fit.normalised, dof, cloud)
    residuals, absorbed_dof = remove_pose_errors(
        fit.normalised, cylinder_jacobian, common_jacobian, section_jacobian, cloud.point_sections
    )
    after = _scaled_variance_factor(residuals, round(dof - absorbed_dof), cloud)
    # As a ratio, which keeps the effect of a truncation on the factor of the fit.
    return fit.variance_factor * after / before


def remove_pose_errors(
    normalised: FloatArray,
    jacobian: FloatArray,
    common_jacobian: FloatArray,
    section_jacobian: FloatArray,
    point_sections: IntArray,
) -> tuple[FloatArray, float]:
    """Return the residuals of a fit without the effect of the pose errors.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals of the fit, divided by the standard deviations of the points as all Jacobians are.
    jacobian : (n, p) ndarray
        Derivatives by the parameters of the fit.
    common_jacobian, section_jacobian : (n, k) ndarray
        Displacements from `common_error_jacobian` and `section_error_jacobian`, by errors of one
        standard deviation.
    point_sections : (n,) int ndarray
        Section of each point.

    Returns
    -------
    residuals : (n,) ndarray
        Normalised.
    absorbed_dof : float
        Number of degrees of freedom that the errors of the sections absorb.
    """
    whitened = np.hstack([jacobian, common_jacobian])
    unwhitened, residuals, absorbed_dof = whitened.copy(), normalised.copy(), 0.0
    for section in np.unique(point_sections):
        rows = point_sections == section
        inverse = np.linalg.inv(
            np.eye(section_jacobian.shape[1]) + section_jacobian[rows].T @ section_jacobian[rows]
        )
        for values in (whitened, residuals):
            # (I + C C')^-1 v = v - C (I + C'C)^-1 C' v, with the section's Jacobian C
            values[rows] -= section_jacobian[rows] @ (
                inverse @ (section_jacobian[rows].T @ values[rows])
            )
        absorbed_dof += section_jacobian.shape[1] - float(np.trace(inverse))
    free, common = jacobian.shape[1], common_jacobian.shape[1]
    prior_information = np.diag(np.repeat([0.0, 1.0], [free, common]))
    residuals -= whitened @ np.linalg.solve(
        unwhitened.T @ whitened + prior_information, whitened.T @ normalised
    )
    return residuals, absorbed_dof


def _scaled_variance_factor(normalised: FloatArray, dof: int, cloud: ScanCloud) -> float:
    """Return the factor of normalised residuals on the covariance from the stds of the fit."""
    factor, _, std_scale = estimate_variance_factor(normalised, dof, known_noise=cloud.noise_known)
    return factor * std_scale**2


def measure_feed(base_from_sections: Sequence[Pose]) -> tuple[FloatArray, FloatArray]:
    """Return the feed direction (3,), and the position (k,) of each section along it in mm.

    The direction is the unit vector from the first section's origin to the last's, zero if they
    coincide; positions are counted from the first section.
    """
    origins = np.array([pose.translation for pose in base_from_sections])
    displacement = origins[-1] - origins[0]
    length = float(np.linalg.norm(displacement))
    feed = displacement / length if length > 0 else np.zeros(3)
    return feed, (origins - origins[0]) @ feed
