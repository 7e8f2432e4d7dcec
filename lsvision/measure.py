"""Pipeline from one profile to its cylinders (the paper's Figure 4).

Range image and candidates precede the paper's steps, because rough identification alone mistakes
planes for huge ellipses. The paper's pipeline without them is
`lsvision.studies.chen_liu_2016.measure_cylinders_paper`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lsvision.detection.acceptance import (
    AcceptanceSettings,
    rejection_reason,
    suppress_overlapping,
)
from lsvision.detection.arcs import IdentifiedArc, Rejection
from lsvision.detection.candidates import CandidateSettings, find_candidates
from lsvision.detection.end_condition import tangential_end_reason
from lsvision.detection.identification import identify_arcs
from lsvision.detection.measurement import Measurement
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import (
    RangeImageSettings,
    build_range_image,
    connected_components,
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
from lsvision.geometry.arguments import as_known_phi, as_number_or_pair
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.profile import Arc, NoiseModel, PreparedProfile, Profile, as_profile
from lsvision.sensors.profile_sensor import as_noise_model

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Measurement", "Settings", "measure_cylinders"]


@dataclass(frozen=True, kw_only=True, repr=False)
class Settings(ShowsChanges):
    """Settings of a measurement, in the order of the steps.

    Parameters
    ----------
    range_image, candidates : settings
        Steps before rough identification.
    acceptance : AcceptanceSettings
        Limits for accepting a section as a cylinder.
    fitting : FittingSettings
        Geometric refinement (paper section 2.3).

    Examples
    --------
    >>> Settings(acceptance=AcceptanceSettings())
    Settings()
    """

    range_image: RangeImageSettings = RangeImageSettings()
    candidates: CandidateSettings = CandidateSettings()
    acceptance: AcceptanceSettings = AcceptanceSettings()
    # The initial guess from the homogenised arc is so near that reweighting changes nothing, and
    # each step is a hundredth of the one before: after a relative decrease of chi^2 of 1e-3, a step
    # of 0.2 sigma, 0.002 sigma remain. Pipes take 2 to 14 evaluations; more means divergence.
    fitting: FittingSettings = FittingSettings(reweightings=0, max_evaluations=20, tolerance=1e-3)


def measure_cylinders(
    profile: Profile | npt.ArrayLike,
    *,
    radius: float | Sequence[float] | None = None,
    known_radius: float | Sequence[float] | None = None,
    known_phi: float | Sequence[float] | None = None,
    sensor: NoiseModel | str | None = None,
    settings: Settings = Settings(),
) -> Measurement:
    """Measure radius, orientation and position of every cylinder in a profile.

    Parameters
    ----------
    profile : Profile, (n, 2) array_like or data frame
        Points of one light section, as `Profile` takes them: y increases towards the sensor, a
        NaN row is a lost point, a data frame has columns x and z (or y). Units: mm.
    radius : float or (float, float), optional
        Search range (min, max), or a nominal radius that is searched within 20 %. Units: mm.
    known_radius : float or (float, float), optional
        Radius, or (radius, std): a prior in the fit, and the centre of the search range if
        `radius` is not given. Units: mm.
    known_phi : float or (float, float), optional
        Tilt of the axis from the laser plane's normal, or (tilt, std): a prior in the fit. With
        0 circles are fitted, also to arcs too short for an ellipse; see `PhiPrior`.
        Units: rad.
    sensor : NoiseModel or str, optional
        Noise of the points, as a `ProfileSensor` or the name of a known one ("lps36",
        "lps36hi"). Default: the noise of the profile; if that has none, its size is
        estimated from the residuals, and its direction is assumed within 13 deg of Y.
    settings : Settings
        Settings of the steps.

    Returns
    -------
    Measurement
        Deterministic. A profile without cylinders has at least one rejection with its reason.

    Raises
    ------
    ValueError
        If a radius is not positive, its range is reversed, a known phi is not a tilt (as one in
        degrees), or a sensor's name is unknown.
    TypeError
        If an argument is of another kind.

    Warns
    -----
    UserWarning
        If the points seem to be in metres: they span less than 1 mm in x and y, with less than
        0.002 mm from one to the next. No profile sensor is as fine.

    Notes
    -----
    One section does not determine the sign of the tilt (`CylinderSection.axis_twins`), and hardly
    a phi below 10 deg (see ``interval("phi")``); two sections determine both.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> section = random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = measure_cylinders(section.profile).cylinders
    >>> (truth,) = section.truth.tubes
    >>> abs(pipe.radius - truth.radius) < 4 * pipe.radius_std
    True
    """
    priors = Priors(radius_prior_from_value(known_radius), _phi_prior_from_value(known_phi))
    search = as_number_or_pair(radius, "radius", "mm", "(min, max)")
    measured, noise = as_profile(profile), as_noise_model(sensor)
    return replace(_find_cylinders(measured, search, priors, noise, settings), profile=measured)


def _find_cylinders(
    profile: Profile,
    radius: float | tuple[float, float] | None,
    priors: Priors,
    sensor: NoiseModel | None,
    settings: Settings,
) -> Measurement:
    """Run the steps of the paper's Figure 4 on a profile."""
    prepared = prepare_profile(profile, sensor or profile.noise)
    radius_range = search_range(radius, priors.radius, prepared)
    range_image = build_range_image(prepared, settings.range_image)
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
    """Return the cylinder of an identified arc, or the rejection with its reason."""
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
        Results with indices and arcs that refer to the points of `profile`.
    profile : PreparedProfile
        Prepared profile, with the sensor column of each point.
    """

    def arc_of(indices: IntArray) -> Arc:
        return Arc(int(indices.min()), int(indices.max()) + 1)

    columns = profile.sensor_columns
    sections = [
        CylinderSection(cylinder.fit, arc_of(columns[cylinder.indices]), columns[cylinder.indices])
        for cylinder in cylinders
    ]
    rejected = [
        replace(rejection, arc=arc_of(columns[rejection.arc.start : rejection.arc.stop]))
        for rejection in rejections
    ]
    return Measurement(
        tuple(sorted(sections, key=lambda section: section.centre[0])), tuple(rejected)
    )


def radius_prior_from_value(known_radius: float | Sequence[float] | None) -> RadiusPrior | None:
    """Return the prior of a known radius or (radius, std), None for None. Units: mm."""
    known = as_number_or_pair(known_radius, "known_radius", "mm", "(radius, std)")
    if known is None:
        return None
    return RadiusPrior(*known) if isinstance(known, tuple) else RadiusPrior(known)


def _phi_prior_from_value(known_phi: float | Sequence[float] | None) -> PhiPrior | None:
    """Return the prior of a known tilt or (tilt, std), None for None. Units: rad."""
    known = as_known_phi(known_phi)
    if known is None:
        return None
    return PhiPrior(*known) if isinstance(known, tuple) else PhiPrior(known)
