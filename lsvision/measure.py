"""The paper on one page: one profile in, cylinders out (Figure 4).

Range image and candidates stand before the paper's steps, because rough identification alone
takes planes for huge ellipses. The paper's own chain, without them, is
`lsvision.studies.chen_liu_2016.measure_cylinders_paper`.
"""

from dataclasses import dataclass

from lsvision.detection.acceptance import (
    AcceptanceSettings,
    rejection_reason,
    suppress_overlapping,
)
from lsvision.detection.arcs import IdentifiedArc, Rejection
from lsvision.detection.candidates import CandidateSettings, find_candidates
from lsvision.detection.end_condition import tangential_end_reason
from lsvision.detection.identification import identify_arcs
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import (
    RangeImageSettings,
    connected_components,
    rasterise,
)
from lsvision.detection.rejections import complete_rejections
from lsvision.detection.screening import screen_arc
from lsvision.detection.search_range import search_range
from lsvision.ellipse.fit import FittingSettings
from lsvision.ellipse.homogenising import homogenise_arc
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from lsvision.ellipse.refinement import Priors, refine_arc
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import smooth_arc
from lsvision.errors import LsvisionError
from lsvision.geometry import IntArray
from lsvision.profile import Arc, NoiseModel, PreparedProfile, Profile


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """What a user may want to set, in the order of the steps.

    Parameters
    ----------
    range_image, candidates : settings
        Before rough identification.
    acceptance : AcceptanceSettings
        What counts as a cylinder.
    fitting : FittingSettings
        Geometric refinement, section 2.3.
    """

    range_image: RangeImageSettings = RangeImageSettings()
    candidates: CandidateSettings = CandidateSettings()
    acceptance: AcceptanceSettings = AcceptanceSettings()
    # Homogenised arcs start so near their fit that renewed weights change nothing, and each step
    # is a hundredth of the one before: after one of 1e-3 of chi^2, some 0.2 sigma, what is left
    # is 0.002 sigma. Pipes need 2 to 14 evaluations, and what needs more runs off to a needle.
    fitting: FittingSettings = FittingSettings(reweightings=0, max_evaluations=20, tolerance=1e-3)


@dataclass(frozen=True, slots=True)
class Measurement:
    """What one profile holds.

    Parameters
    ----------
    cylinders : tuple of CylinderSection
        Left to right by centre x.
    rejections : tuple of Rejection
        What else was looked at, and why it is no cylinder; in the order of the profile.
    """

    cylinders: tuple[CylinderSection, ...]
    rejections: tuple[Rejection, ...]


def measure_cylinders(
    profile: Profile,
    *,
    radius: float | tuple[float, float] | None = None,
    known_radius: float | tuple[float, float] | None = None,
    known_phi: float | tuple[float, float] | None = None,
    sensor: NoiseModel | None = None,
    settings: Settings = Settings(),
) -> Measurement:
    """Radius, orientation and position of every cylinder in a profile.

    Parameters
    ----------
    profile : Profile
        Points of one light section.
    radius : float or tuple of float, optional
        Search range (min, max), or a nominal radius that is searched within 20 %. Units: mm.
    known_radius : float or tuple of float, optional
        Radius, or (radius, std): a prior in the fit, and the search range where `radius` gives
        none. Units: mm.
    known_phi : float or tuple of float, optional
        Tilt of the axis from the laser plane's normal, or (tilt, std): a prior in the fit. 0
        makes circles of the sections, and so a radius of an arc too short for an ellipse; see
        `PhiPrior`. Units: rad.
    sensor : NoiseModel, optional
        Noise of the points; that of the profile without; where neither is given its size is
        estimated from the residuals, and its direction taken along Y within some 11 deg.
    settings : Settings
        One value for each step.

    Returns
    -------
    Measurement
        Same input and settings, same numbers out. A profile without cylinders has at least one
        rejection with its reason.

    Raises
    ------
    ValueError
        If a radius is not positive, its range is reversed, or a known phi is no tilt.
    TypeError
        If `sensor` knows no covariances, or a radius or tilt is no number.

    Notes
    -----
    One section leaves the sign of the tilt open (`CylinderSection.axis_twins`), and knows
    little of phi below 10 deg: look at ``interval("phi")``; two sections know both.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> section = random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = measure_cylinders(section.profile).cylinders
    >>> (truth,) = section.truth.tubes
    >>> abs(pipe.radius - truth.radius) < 4 * pipe.radius_std
    True
    """
    if not (sensor is None or isinstance(sensor, NoiseModel)):
        raise TypeError(f"expected a NoiseModel as sensor, got {type(sensor).__name__}")
    priors = Priors(radius_prior_from_value(known_radius), _phi_prior_from_value(known_phi))
    prepared = prepare_profile(profile, sensor or profile.noise)
    radius_range = search_range(radius, priors.radius, prepared)
    range_image = rasterise(prepared, settings.range_image)
    components = connected_components(range_image, settings.candidates.min_span_points)
    candidates = find_candidates(prepared, components, radius_range, settings.candidates)
    # Rough identification, section 3.2.1.
    arcs, rejections = identify_arcs(prepared, candidates, radius_range, settings.acceptance)
    results = [_measure_arc(prepared, arc, priors, radius_range, settings) for arc in arcs]
    cylinders = suppress_overlapping([r for r in results if isinstance(r, CylinderSection)])
    rejections += [result for result in results if isinstance(result, Rejection)]
    rejections = complete_rejections(
        prepared,
        components,
        cylinders,
        rejections,
        radius_range,
        settings.candidates.min_span_points,
    )
    return measurement_in_sensor_columns(cylinders, rejections, prepared)


def _measure_arc(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    priors: Priors,
    radius_range: tuple[float, float],
    settings: Settings,
) -> CylinderSection | Rejection:
    """The cylinder of an identified arc, or the reason why there is none."""
    # Accurate screening, section 3.2.2.
    screened = screen_arc(profile, arc)
    if screened is None:
        return Rejection(arc.arc, "no ellipse fits the middle part of the arc")
    noise_std = profile.noise_std * screened.variance_factor**0.5
    reason = tangential_end_reason(profile, arc, screened, noise_std)
    if reason is not None:
        return Rejection(arc.arc, reason)
    # Smoothing and homogenising, section 3.3.
    smoothed = smooth_arc(screened.points, screened.ellipse)
    homogenised = homogenise_arc(smoothed)
    # Ellipse fitting, section 2.3.
    points, indices = screened.points[smoothed.inliers], screened.indices[smoothed.inliers]
    estimated_std = profile.noise_std if profile.noise_is_estimated else None
    try:
        fit = refine_arc(points, homogenised.ellipse, priors, settings.fitting, estimated_std)
    except LsvisionError as failure:
        return Rejection(arc.arc, str(failure))
    section = CylinderSection(fit, Arc(int(indices[0]), int(indices[-1]) + 1), indices)
    reason = rejection_reason(profile, section, radius_range, settings.acceptance)
    return section if reason is None else Rejection(section.arc, reason)


def measurement_in_sensor_columns(
    cylinders: list[CylinderSection], rejections: list[Rejection], profile: PreparedProfile
) -> Measurement:
    """Return the result with the indices of the original profile, cylinders from left to right.

    Parameters
    ----------
    cylinders, rejections : list
        Their indices and arcs refer to the points of `profile`.
    profile : PreparedProfile
        Maps its points to the columns of the sensor.
    """

    def arc_of(indices: IntArray) -> Arc:
        return Arc(int(indices.min()), int(indices.max()) + 1)

    columns = profile.sensor_columns
    sections = [
        CylinderSection(cylinder.fit, arc_of(columns[cylinder.indices]), columns[cylinder.indices])
        for cylinder in cylinders
    ]
    rejected = [
        Rejection(arc_of(columns[rejection.arc.start : rejection.arc.stop]), rejection.reason)
        for rejection in rejections
    ]
    return Measurement(
        tuple(sorted(sections, key=lambda section: section.centre[0])), tuple(rejected)
    )


def radius_prior_from_value(known_radius: float | tuple[float, float] | None) -> RadiusPrior | None:
    """Prior of a known radius, or of (radius, std); None without one. Units: mm."""
    if known_radius is None:
        return None
    if isinstance(known_radius, tuple):
        return RadiusPrior(*known_radius)
    return RadiusPrior(float(known_radius))


def _phi_prior_from_value(known_phi: float | tuple[float, float] | None) -> PhiPrior | None:
    """Prior of a known tilt, or of (tilt, std); None without one. Units: rad."""
    if known_phi is None:
        return None
    if isinstance(known_phi, tuple):
        return PhiPrior(*known_phi)
    return PhiPrior(float(known_phi))
