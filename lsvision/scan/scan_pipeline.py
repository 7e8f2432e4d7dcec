"""Several sections, one cylinder: many profiles with their poses in, cylinders in space out."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from lsvision.cylinder.robot_frame import SectionMount
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry import Pose
from lsvision.geometry.arrays import require_coordinates
from lsvision.measure import Measurement, Settings, measure_cylinders
from lsvision.profile import NoiseModel, Profile
from lsvision.scan.cloud import build_cloud, require_noncoplanar_sections
from lsvision.scan.joint_fit import JointFitSettings
from lsvision.scan.pose_errors import PoseErrors
from lsvision.scan.result_assembly import build_scanned_cylinder, sort_cylinders
from lsvision.scan.scan_result import ScanMeasurement
from lsvision.scan.track_fitting import fit_tracks
from lsvision.scan.tracks import TrackSettings, associate_arcs, transform_arc_to_base
from lsvision.statistics.numerical_failures import refuse_numerical_failure, require_finite

MIN_POINTS = 6
"""Profiles with fewer points are passed over: a lost section."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ScanSettings:
    """One settings value for each step, in the order of the steps.

    Parameters
    ----------
    section : Settings
        Measuring each profile by itself.
    tracks : TrackSettings
        Association of arcs across sections.
    joint_fit : JointFitSettings
        Gathering of points and the joint fit.
    """

    section: Settings = field(default_factory=Settings)
    tracks: TrackSettings = TrackSettings()
    joint_fit: JointFitSettings = JointFitSettings()


def measure_scan(  # noqa: PLR0913 - what `measure_cylinders` asks, and the poses with their errors
    profiles: Sequence[Profile],
    base_from_sections: Sequence[Pose],
    *,
    radius: float | tuple[float, float] | None = None,
    known_radius: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: ScanSettings = ScanSettings(),
    pose_std: float = 0.0,
    feed_std: float = 0.0,
    calibration: SectionMount | None = None,
) -> ScanMeasurement:
    """Measure cylinders from several light sections jointly.

    Two sections 10 mm apart give radius and direction 10 to 25 times better than one, and settle
    which of the twins it is; more give more. Each profile is measured by itself, arcs are
    chained across the sections, and one cylinder is fitted to all points of a chain, also to
    those of sections where detection missed the arc.

    Parameters
    ----------
    profiles : sequence of Profile
        In the order of the feed. Profiles without points are passed over.
    base_from_sections : sequence of Pose
        One a profile; ``Pose.along(direction, distance)`` for an encoder axis.
    radius : float or (float, float), optional
        Nominal radius or range to search, as for `measure_cylinders`. Units: mm.
    known_radius : float or (float, float), optional
        Radius, or radius and its one sigma, known beforehand. Units: mm.
    sensor : NoiseModel, optional
        None: each profile's own, or equal noise estimated from the residuals.
    settings : ScanSettings
        Every step's.
    pose_std : float
        One sigma of each section's position, per axis. It enters the covariance; the poses
        are taken as given. Units: mm.
    feed_std : float
        One sigma of the feed's direction about each axis across it, shared by all sections.
        It enters the covariance. Units: rad.
    calibration : HandEye, optional
        With which the poses were made, ``base_from_flange @ calibration.flange_from_section``.
        Its covariance enters the cylinders' as one error that all sections share, its
        ``robot_std`` as one that each section has for itself.

    Returns
    -------
    ScanMeasurement
        A cylinder that only one section can show (a scan of one profile) comes with its
        `twin`; it is then one of the two, and nothing tells which.

    Raises
    ------
    ValueError
        If there are not as many poses as profiles, or none; if one is farther than 1e9 mm.
    DegenerateGeometry
        If all sections lie in one plane: identical poses, or a feed along the laser plane.
    FitFailed
        If numbers overflow: poses, standard uncertainties or points of impossible size.

    Notes
    -----
    **What the fit cannot see.** A feed direction 0.5 deg off the one given turns the axis by
    0.45 deg and costs 0.1 mm of radius (R = 25 mm, tilt 20 deg) without any change in the
    residuals; a feed 1 % too long, 0.2 deg and 0.03 mm. Calibrate the feed, or say by
    `feed_std` how well it is known.

    Examples
    --------
    >>> import numpy as np
    >>> from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan
    >>> scene = Scene((Tube.of(19.0, 0.3, 0.35, (0.0, -400.0)),))
    >>> poses = [Pose.along((0, 0, 1), 10.0 * k) for k in range(2)]
    >>> rng = np.random.default_rng(1)
    >>> seen = simulate_scan(scene, poses, SCENE_SENSOR, SectionSettings(), rng=rng)
    >>> scan = measure_scan([section.profile for section in seen], poses)
    >>> [f"{pipe.radius:.1f} mm" for pipe in scan.cylinders]
    ['19.0 mm']
    """
    poses = validate_poses(profiles, base_from_sections)
    measurements = [
        measure_section(
            profile, radius=radius, known_radius=known_radius, sensor=sensor,
            settings=settings.section,
        )
        for profile in profiles
    ]  # fmt: skip
    return fit_sections_jointly(
        profiles,
        poses,
        measurements,
        known_radius=known_radius,
        sensor=sensor,
        settings=settings,
        pose_errors=PoseErrors(pose_std=pose_std, feed_std=feed_std, calibration=calibration),
    )


def measure_section(
    profile: Profile,
    *,
    radius: float | tuple[float, float] | None = None,
    known_radius: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: Settings | None = None,
) -> Measurement:
    """Measure one profile of a scan; one that is lost whole holds nothing.

    Parameters are those of `measure_cylinders`.
    """
    if len(profile) - profile.lost < MIN_POINTS:
        return Measurement((), ())
    return measure_cylinders(
        profile,
        radius=radius,
        known_radius=known_radius,
        sensor=sensor,
        settings=settings or Settings(),
    )


def fit_sections_jointly(  # noqa: PLR0913 - the profiles, what each holds, and what `measure_scan` asks
    profiles: Sequence[Profile],
    base_from_sections: Sequence[Pose],
    measurements: Sequence[Measurement],
    *,
    known_radius: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: ScanSettings | None = None,
    pose_errors: PoseErrors = PoseErrors(),
) -> ScanMeasurement:
    """Make cylinders in space of sections that are measured one by one.

    Parameters
    ----------
    profiles, base_from_sections, known_radius, sensor, settings
        As in `measure_scan`.
    measurements : sequence of Measurement
        Of each profile, by `measure_section`.
    pose_errors : PoseErrors
        How well the poses are known.

    Raises
    ------
    ValueError, TypeError, DegenerateGeometry
        As `measure_scan`.
    """
    settings = settings or ScanSettings()
    poses = validate_poses(profiles, base_from_sections)
    sightings = [
        transform_arc_to_base(section, arc, poses[section])
        for section, measurement in enumerate(measurements)
        for arc in measurement.cylinders
    ]
    prior = _prior(known_radius)
    with refuse_numerical_failure("a cylinder"):
        tracks = associate_arcs(sightings, settings.tracks)
        cloud = build_cloud(profiles, poses, sensor)
        found, rejections = fit_tracks(cloud, tracks, prior, settings.joint_fit)
        cylinders = [build_scanned_cylinder(settled, pose_errors) for settled in found]
    for cylinder in cylinders:
        require_finite("a cylinder", cylinder.point, cylinder.radius, cylinder.covariance)
    return ScanMeasurement(sort_cylinders(cylinders, poses), tuple(rejections), tuple(measurements))


def validate_poses(
    profiles: Sequence[Profile], base_from_sections: Sequence[Pose]
) -> tuple[Pose, ...]:
    """Poses that go with the profiles.

    Raises
    ------
    TypeError, ValueError
        If they are no poses, not as many, or none.
    DegenerateGeometry
        If the sections all lie in one plane.
    """
    poses = tuple(base_from_sections)
    if len(poses) != len(profiles) or not poses:
        raise ValueError(
            f"want one pose a profile and at least one, got {len(profiles)} profiles and "
            f"{len(poses)} poses"
        )
    for pose in poses:
        if not isinstance(pose, Pose):
            raise TypeError(f"want a Pose for each profile, got {type(pose).__name__}")
        require_coordinates(pose.translation)
    require_noncoplanar_sections(poses)
    return poses


def _prior(known_radius: float | tuple[float, float] | None) -> RadiusPrior | None:
    if known_radius is None or isinstance(known_radius, tuple):
        return known_radius and RadiusPrior(*known_radius)
    return RadiusPrior(known_radius)
