"""Measure cylinders from several profiles with poses: the steps of `measure_scan`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.robot_frame import SectionMount
from lsvision.ellipse.problem import Priors
from lsvision.geometry import FloatArray, Pose
from lsvision.geometry.arguments import as_number_or_pair
from lsvision.geometry.arrays import require_coordinates
from lsvision.geometry.pose import as_poses
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.measure import Measurement, Settings, measure_profiles
from lsvision.profile import NoiseModel, Profile, as_profile, require_several
from lsvision.scan.cloud import (
    ScanCloud,
    build_cloud,
    has_enough_points,
    require_noncoplanar_sections,
)
from lsvision.scan.joint_fit import JointFit, JointFitSettings, fit_tracks
from lsvision.scan.pose_errors import (
    PoseErrorResponse,
    PoseErrors,
    common_error_jacobian,
    measure_feed,
    propagate_pose_errors,
    require_feed,
    section_error_jacobian,
)
from lsvision.scan.scan_result import ScanMeasurement, ScannedCylinder
from lsvision.scan.tracks import TrackSettings, associate_arcs, transform_arc_to_base
from lsvision.sensors.profile_sensor import as_noise_model
from lsvision.statistics.numerical_failures import report_numerical_failure, require_finite

if TYPE_CHECKING:
    import numpy.typing as npt

MIN_FEED_COSINE = 1e-6
"""Smallest cosine between feed and axis at which the feed gives the direction its sign."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ScanSettings(ShowsChanges):
    """Settings of the measurement of a scan, one value for each step.

    Parameters
    ----------
    section : Settings
        Settings of the measurement of each profile by itself.
    tracks : TrackSettings
        Settings of the association of arcs across sections.
    joint_fit : JointFitSettings
        Settings of the assignment of points and of the joint fit.

    Examples
    --------
    >>> from lsvision.detection.candidates import CandidateSettings
    >>> ScanSettings(section=Settings(candidates=CandidateSettings(min_span_points=20)))
    ScanSettings(section=Settings(candidates=CandidateSettings(min_span_points=20)))
    """

    section: Settings = field(default_factory=Settings)
    tracks: TrackSettings = TrackSettings()
    joint_fit: JointFitSettings = JointFitSettings()


def measure_scan(  # noqa: PLR0913 - the options of `measure_cylinders`, the poses and their errors
    profiles: Sequence[Profile | npt.ArrayLike],
    base_from_sections: Sequence[Pose | npt.ArrayLike],
    *,
    radius: float | Sequence[float] | None = None,
    known_radius: float | Sequence[float] | None = None,
    sensor: NoiseModel | str | None = None,
    settings: ScanSettings = ScanSettings(),
    pose_std: float = 0.0,
    feed_std: float = 0.0,
    calibration: SectionMount | None = None,
) -> ScanMeasurement:
    """Measure cylinders from several light sections jointly.

    Two sections 10 mm apart determine radius and direction 5 to 30 times better than one (radii of
    10 to 40 mm), and which of the two twins is the axis; more sections improve both. Each profile
    is measured by itself, arcs are associated across the sections, and one cylinder is fitted to
    all points of a track, including points of sections where detection missed the arc.

    Parameters
    ----------
    profiles : sequence of Profile or (n, 2) array_like
        In the order of the feed, each as `measure_cylinders` takes it. Profiles with fewer than six
        points are skipped.
    base_from_sections : sequence of Pose or (4, 4) array_like
        One for each profile; ``Pose.along(direction, distance)`` for an encoder axis. Units: mm.
    radius : float or (float, float), optional
        Nominal radius or range to search, as for `measure_cylinders`. Units: mm.
    known_radius : float or (float, float), optional
        Prior radius, or prior radius and its standard uncertainty; a cylinder whose points
        contradict it is rejected. Units: mm.
    sensor : NoiseModel or str, optional
        Noise model of all profiles, as for `measure_cylinders`. None: the model of each profile,
        or equal noise estimated from the residuals.
    settings : ScanSettings
        Settings of every step.
    pose_std : float
        Standard uncertainty of each section's position, per axis. It enters the covariance only;
        the fit takes the poses as exact. Units: mm.
    feed_std : float
        Standard uncertainty of the feed direction about each axis perpendicular to it, common to
        all sections. It enters the covariance only. Units: rad.
    calibration : HandEye, optional
        Calibration used for the poses, ``base_from_flange @ calibration.flange_from_section``.
        Its covariance enters the cylinders' covariance as an error common to all sections, its
        ``robot_std`` as an independent error of each section.

    Returns
    -------
    ScanMeasurement
        If only one profile has points, the cylinders have a `twin`: either of the two may be the
        axis.

    Raises
    ------
    ValueError
        If the numbers of poses and profiles differ, or are zero, a matrix is not a rigid motion, a
        pose is farther than 1e9 mm, a standard uncertainty is out of its range, or `feed_std` is
        given and the last of several sections has the origin of the first.
    TypeError
        If an element of `profiles` is not a profile, one of `base_from_sections` not a pose, a
        standard uncertainty not a number, or `settings` or `calibration` something else.
    DegenerateGeometry
        If all sections lie in one plane: identical poses, or a feed along the laser plane.
    FitFailed
        If numbers overflow because poses, standard uncertainties or points are extremely large.

    Notes
    -----
    **Systematic errors that the residuals do not show.** A feed direction wrong by 0.5 deg turns
    the axis by 0.45 deg and changes the radius by 0.1 mm (R = 25 mm, tilt 20 deg) without any
    effect on the residuals; a feed 1 % too long turns the axis by 0.2 deg and changes the radius by
    0.03 mm. Calibrate the feed, or state its uncertainty as `feed_std`.

    Examples
    --------
    >>> import numpy as np
    >>> from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan
    >>> scene = Scene((Tube.of(19.0, 0.3, 0.35, (0.0, -400.0)),))
    >>> poses = [Pose.along((0, 0, 1), 10.0 * k) for k in range(2)]
    >>> rng = np.random.default_rng(1)
    >>> sections = simulate_scan(scene, poses, SCENE_SENSOR, SectionSettings(), rng=rng)
    >>> scan = measure_scan([section.profile for section in sections], poses)
    >>> [f"{pipe.radius:.1f} mm" for pipe in scan.cylinders]
    ['19.0 mm']
    """
    require_several(profiles)
    if not isinstance(settings, ScanSettings):
        raise TypeError(
            f"expected ScanSettings, got {type(settings).__name__}: those of the single profiles "
            "are ScanSettings(section=...)"
        )
    checked_profiles, noise = [as_profile(profile) for profile in profiles], as_noise_model(sensor)
    poses = validate_poses(checked_profiles, base_from_sections)
    radius_prior = as_number_or_pair(known_radius, "known_radius", "mm", "(radius, std)")
    pose_errors = PoseErrors(pose_std=pose_std, feed_std=feed_std, calibration=calibration)
    measurements = measure_sections(
        checked_profiles,
        radius=radius,
        known_radius=radius_prior,
        sensor=noise,
        settings=settings.section,
    )
    return fit_sections_jointly(
        checked_profiles,
        poses,
        measurements,
        known_radius=radius_prior,
        sensor=noise,
        settings=settings,
        pose_errors=pose_errors,
    )


def measure_sections(
    profiles: Sequence[Profile],
    *,
    radius: float | Sequence[float] | None = None,
    known_radius: float | Sequence[float] | None = None,
    sensor: NoiseModel | None = None,
    settings: Settings | None = None,
) -> list[Measurement]:
    """Measure the profiles of a scan; one without enough points has an empty measurement.

    Parameters are those of `measure_profiles`.
    """
    measurable = [has_enough_points(profile) for profile in profiles]
    measured = measure_profiles(
        list(compress(profiles, measurable)),
        radius=radius,
        known_radius=known_radius,
        sensor=sensor,
        settings=settings or Settings(),
    )
    remaining = iter(measured)
    return [next(remaining) if valid else Measurement((), ()) for valid in measurable]


def fit_sections_jointly(  # noqa: PLR0913 - the measurements and the options of `measure_scan`
    profiles: Sequence[Profile],
    base_from_sections: Sequence[Pose],
    measurements: Sequence[Measurement],
    *,
    known_radius: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: ScanSettings | None = None,
    pose_errors: PoseErrors = PoseErrors(),
) -> ScanMeasurement:
    """Fit cylinders jointly to profiles that have been measured one by one by `measure_sections`.

    Other parameters, and the errors, are those of `measure_scan`.
    """
    settings = settings or ScanSettings()
    poses = validate_poses(profiles, base_from_sections)
    require_feed(poses, pose_errors)
    observations = [
        transform_arc_to_base(section, arc, poses[section])
        for section, measurement in enumerate(measurements)
        for arc in measurement.cylinders
    ]
    prior = Priors.from_values(known_radius, None).radius
    with report_numerical_failure("a cylinder"):
        tracks = associate_arcs(observations, settings.tracks)
        cloud = build_cloud(profiles, poses, sensor)
        joint_fits, rejections = fit_tracks(cloud, tracks, prior, settings.joint_fit)
        cylinders = [build_scanned_cylinder(joint_fit, pose_errors) for joint_fit in joint_fits]
    for cylinder in cylinders:
        require_finite("a cylinder", cylinder.point, cylinder.radius, cylinder.covariance)
    return ScanMeasurement(sort_cylinders(cylinders, poses), tuple(rejections), tuple(measurements))


def validate_poses(
    profiles: Sequence[Profile], base_from_sections: Sequence[Pose | npt.ArrayLike]
) -> tuple[Pose, ...]:
    """Return the poses as a tuple after checking their type, number and arrangement.

    TypeError or ValueError if an element is not a pose or is too far away, or their number is not
    that of the profiles, or is zero; DegenerateGeometry if the sections all lie in one plane.
    """
    poses = as_poses(base_from_sections)
    if len(poses) != len(profiles) or not poses:
        raise ValueError(
            f"expected one pose for each profile, at least one, got {len(profiles)} profiles and "
            f"{len(poses)} poses"
        )
    for pose in poses:
        require_coordinates(pose.translation)
    require_noncoplanar_sections(poses)
    return poses


def build_scanned_cylinder(joint_fit: JointFit, errors: PoseErrors) -> ScannedCylinder:
    """Return the result of a joint fit: reference point, sign, covariance and axial range."""
    fit, cloud = joint_fit.fit, joint_fit.cloud
    if _is_against_feed(fit.direction, cloud.poses):
        fit = fit.with_reversed_direction()
    covariance, response = propagate_pose_errors(fit, cloud, errors, joint_fit.known_radius)
    fit = replace(fit, covariance=covariance).with_reference_point(cloud.poses[0].translation)
    axial_range, range_covariance = _measure_axial_range(fit, cloud, errors, response)
    first_std, last_std = np.sqrt(range_covariance.diagonal()).tolist()
    return ScannedCylinder(
        fit=fit,
        sections=tuple(int(section) for section in np.unique(cloud.point_sections)),
        points=cloud.points,
        point_sections=cloud.point_sections,
        indices=cloud.indices,
        axial_range=axial_range,
        axial_range_std=(first_std, last_std),
        twin=joint_fit.twin,
        includes_calibration=errors.calibration is not None,
        axial_range_covariance=float(range_covariance[0, 1]),
        poses=cloud.poses,
        pose_errors=errors,
    )


def _is_against_feed(direction: FloatArray, base_from_sections: Sequence[Pose]) -> bool:
    """Return whether a direction is against the feed; see `ScannedCylinder`."""
    feed, _ = measure_feed(base_from_sections)
    cosine = float(feed @ direction)
    if abs(cosine) < MIN_FEED_COSINE:
        cosine = float(base_from_sections[0].rotation[:, 2] @ direction)
    return cosine < 0


def _measure_axial_range(
    fit: CylinderFit, cloud: ScanCloud, errors: PoseErrors, response: PoseErrorResponse
) -> tuple[tuple[float, float], FloatArray]:
    """Return ``axial_range`` of a `ScannedCylinder` and the covariance (2, 2) of both ends.

    The ends are those of the first and the last point p along the axis: (p - o) d, with the origin
    o of the first section. An error of a pose displaces p and, by the response of the fit, turns d;
    the noise of p and of d counts as independent. Units: mm, mm^2.
    """
    along = (cloud.points - fit.point) @ fit.direction
    rows = np.array([along.argmin(), along.argmax()])
    end_points, axes = cloud.select_rows(rows), np.tile(fit.direction, (2, 1))
    by_direction = (end_points.points - cloud.poses[0].translation) @ fit.tangent_basis.T
    common = common_error_jacobian(axes, end_points, errors) + by_direction @ response.common[2:4]
    noise_covariance = (fit.covariance - response.covariance)[2:4, 2:4]
    covariance = np.diag(fit.direction @ end_points.covariances @ fit.direction)
    covariance = covariance + common @ common.T + by_direction @ noise_covariance @ by_direction.T
    own_errors = section_error_jacobian(axes, end_points, errors)
    sections = np.unique(cloud.point_sections)
    for section, section_response in zip(sections, response.sections, strict=True):
        displaced = (end_points.point_sections == section)[:, None]
        own = displaced * own_errors + by_direction @ section_response[2:4]
        covariance += own @ own.T
    return (float(along[rows[0]]), float(along[rows[1]])), covariance


def sort_cylinders(
    cylinders: Sequence[ScannedCylinder], poses: Sequence[Pose]
) -> tuple[ScannedCylinder, ...]:
    """Return the cylinders sorted by their first section, then by their mean x in it."""

    def sort_key(cylinder: ScannedCylinder) -> tuple[int, float]:
        first_section = cylinder.sections[0]
        points = cylinder.points[cylinder.point_sections == first_section]
        return first_section, float(poses[first_section].inverse().apply(points)[:, 0].mean())

    return tuple(sorted(cylinders, key=sort_key))
