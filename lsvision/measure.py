"""Pipeline from profiles to their cylinders (the paper's Figure 4).

Range image and candidates precede the paper's steps, because rough identification alone finds huge
ellipses on planes. The pipeline exactly as published is
`lsvision.studies.chen_liu_2016.measure_cylinders_paper`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from lsvision.detection.acceptance import (
    AcceptanceSettings,
    find_rejection_reason,
    suppress_overlapping,
)
from lsvision.detection.arcs import IdentifiedArc, Rejection, ScreenedArc, arc_from_indices
from lsvision.detection.candidates import CandidateSettings, find_candidates
from lsvision.detection.end_condition import find_tangential_end_reason
from lsvision.detection.identification import identify_arcs
from lsvision.detection.measurement import Measurement, build_measurement
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.radius_range import find_radius_range
from lsvision.detection.range_image import (
    RangeImageSettings,
    build_range_image,
    find_connected_components,
)
from lsvision.detection.rejections import complete_rejections
from lsvision.detection.screening import screen_arcs
from lsvision.ellipse.fit import FittingSettings
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.homogenising import homogenise_arcs
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import Priors
from lsvision.ellipse.refinement import refine_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import smooth_arcs
from lsvision.errors import LsvisionError
from lsvision.geometry import IntArray
from lsvision.geometry.arguments import as_number_or_pair
from lsvision.geometry.arrays import apply_in_groups
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.profile import (
    Arc,
    NoiseModel,
    PreparedProfile,
    Profile,
    as_profile,
    require_several,
)
from lsvision.sensors.profile_sensor import as_noise_model

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Measurement", "Settings", "measure_cylinders", "measure_profiles"]

POINTS_AT_ONCE = 20_000
"""Largest number of points that each step processes together: 53 profiles of 376 points. Larger
groups need more memory and are hardly faster."""
PROFILES_AT_ONCE = 32
"""Number of profiles in each task of a parallel process; tasks twice as large are hardly faster."""
_NumberOrPair = float | Sequence[float] | None
"""A number, a pair such as (mean, std), or None."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Settings(ShowsChanges):
    """Settings of a measurement, in the order of the steps.

    Parameters
    ----------
    range_image : RangeImageSettings
        Division of a profile into connected components.
    candidates : CandidateSettings
        Selection of the point sequences to which ellipses are fitted in rough identification.
    acceptance : AcceptanceSettings
        Limits for accepting a section as a cylinder.
    fitting : FittingSettings
        Geometric refinement (paper section 2.3), by default without reweighting, since the initial
        guess is near the minimum. An estimated noise is always scaled by the residuals.

    Examples
    --------
    >>> Settings(acceptance=AcceptanceSettings())
    Settings()
    """

    range_image: RangeImageSettings = RangeImageSettings()
    candidates: CandidateSettings = CandidateSettings()
    acceptance: AcceptanceSettings = AcceptanceSettings()
    # The initial guess from the homogenised arc is near the minimum: reweighting changes nothing,
    # and each step is a hundredth of the one before. A step that decreases chi^2 by a fraction of
    # 1e-3 has a length of 0.2 sigma (40 points); the error after it is 0.002 sigma. The fits of
    # pipes need 2 to 20 evaluations, those of arcs under 80 deg the most: with a limit of 10, one
    # in 15 of these would be lost. A fit that needs more than 20 diverges.
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
        Search range (min, max), or a nominal radius whose search range is +/- 20 %. By default
        the range follows from extent and pitch of the profile. Units: mm.
    known_radius : float or (float, float), optional
        Radius, or (radius, std): a prior in the fit, and the centre of the search range if
        `radius` is not given. Units: mm.
    known_phi : float or (float, float), optional
        Tilt of the axis from the laser plane's normal, or (tilt, std): a prior in the fit. With
        0, circles are fitted, also to arcs that are too short for an ellipse; see `PhiPrior`.
        Units: rad.
    sensor : NoiseModel or str, optional
        Noise of the points, such as a `ProfileSensor`, or the name of a known sensor ("lps36",
        "lps36hi"). Default: the noise of the profile; if the profile has none, the size of the
        noise is estimated from the residuals, and its direction is assumed within 13 deg of Y.
    settings : Settings
        Settings of the steps.

    Returns
    -------
    Measurement
        Cylinders and rejected arcs; the same for the same arguments. Without cylinders,
        `Measurement.reason` states why, and a profile with points has at least one rejection.

    Raises
    ------
    ValueError
        If a radius is not positive, its range is reversed, a known phi is not in [0, pi / 2)
        (for example because it is in degrees), or the name of a sensor is unknown.
    TypeError
        If an argument has another type.

    Warns
    -----
    UserWarning
        If the points seem to be in metres: they span less than 1 mm in x and y, with less than
        0.002 mm from one point to the next, which is less than the pitch of any profile sensor. If
        they seem to be in micrometres: a coordinate exceeds 100 m. If points that are not a
        `Profile` contain a marker of lost points.

    Notes
    -----
    One section does not determine the sign of the tilt (`CylinderSection.axis_twins`), and a tilt
    phi below 10 deg only roughly (see ``interval("phi")``); two sections determine both.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> section = random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = measure_cylinders(section.profile).cylinders
    >>> (truth,) = section.truth.tubes
    >>> abs(pipe.radius - truth.radius) < 4 * pipe.radius_std
    True
    """
    values = radius, known_radius, known_phi
    (measurement,) = _measure([as_profile(profile)], values, as_noise_model(sensor), settings)
    return measurement


def measure_profiles(
    profiles: Sequence[Profile | npt.ArrayLike],
    *,
    radius: float | Sequence[float] | None = None,
    known_radius: float | Sequence[float] | None = None,
    known_phi: float | Sequence[float] | None = None,
    sensor: NoiseModel | str | None = None,
    settings: Settings = Settings(),
) -> list[Measurement]:
    """Measure many profiles at once, two to three times as fast as one by one.

    Each step processes up to `POINTS_AT_ONCE` points of several profiles together.
    `lsvision.measure_many` does the same in several processes, with profiles that are read lazily.

    Parameters
    ----------
    profiles : sequence of Profile, (n, 2) array_like or data frame
        Profiles, as `measure_cylinders` takes them; there may be none.
    radius, known_radius, known_phi, sensor, settings
        As for `measure_cylinders`, the same for all profiles.

    Returns
    -------
    list of Measurement
        In the order of the profiles; the same as those of `measure_cylinders`, up to rounding.

    Raises
    ------
    ValueError, TypeError
        As `measure_cylinders`, and if `profiles` is a single profile.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> profiles = [random_section("single", seed).profile for seed in (7, 8)]
    >>> [len(measurement.cylinders) for measurement in measure_profiles(profiles)]
    [1, 1]
    """
    require_several(profiles)
    checked = list(map(as_profile, profiles))
    options = (radius, known_radius, known_phi), as_noise_model(sensor), settings
    sizes = list(map(len, checked))
    return apply_in_groups(lambda group: _measure(group, *options), checked, sizes, POINTS_AT_ONCE)


class _Search(NamedTuple):
    """Profile, as given and prepared, with the radii (mm) and the components that are searched.

    The components are indices (n,) of points of the prepared profile.
    """

    profile: Profile
    prepared: PreparedProfile
    radius_range: tuple[float, float]
    components: list[IntArray]


def _measure(
    profiles: Sequence[Profile],
    radii_and_tilt: tuple[_NumberOrPair, _NumberOrPair, _NumberOrPair],
    sensor: NoiseModel | None,
    settings: Settings,
) -> list[Measurement]:
    """Run the steps of the paper's Figure 4 on several profiles together.

    `radii_and_tilt` are `radius`, `known_radius` and `known_phi` of `measure_cylinders`.
    """
    radius, known_radius, known_phi = radii_and_tilt
    priors = Priors.from_values(known_radius, known_phi)
    search_radius = as_number_or_pair(radius, "radius", "mm", "(min, max)")
    # Range image and candidates, which precede the steps of the paper.
    prepared = [prepare_profile(profile, sensor or profile.noise) for profile in profiles]
    ranges = [find_radius_range(search_radius, priors.radius, profile) for profile in prepared]
    images = [build_range_image(profile, settings.range_image) for profile in prepared]
    min_points = settings.candidates.min_span_points
    components = [find_connected_components(image, min_points) for image in images]
    candidates = find_candidates(prepared, components, ranges, settings.candidates)
    # Rough identification, section 3.2.1.
    identified = identify_arcs(prepared, candidates, ranges, settings.acceptance)
    # Arrays of arcs of similar size have little padding: these are processed together.
    searches = list(map(_Search, profiles, prepared, ranges, components))
    by_profile = list(zip(searches, identified, strict=True))
    arcs = [(search, arc) for search, (profile_arcs, _) in by_profile for arc in profile_arcs]
    sizes = [len(arc.indices) for _, arc in arcs]
    results = iter(
        apply_in_groups(
            lambda group: _measure_arcs(group, priors, settings), arcs, sizes, POINTS_AT_ONCE
        )
    )
    return [
        _build_complete_measurement(
            search, [*rejections, *(next(results) for _ in profile_arcs)], settings
        )
        for search, (profile_arcs, rejections) in by_profile
    ]


def _measure_arcs(
    arcs: Sequence[tuple[_Search, IdentifiedArc]], priors: Priors, settings: Settings
) -> list[CylinderSection | Rejection]:
    """Return the cylinder of each identified arc, or the rejection with its reason."""
    # Accurate screening, section 3.2.2.
    screened = screen_arcs([search.prepared for search, _ in arcs], [arc for _, arc in arcs])
    checked = [
        _check_screened(search, identified, arc)
        for (search, identified), arc in zip(arcs, screened, strict=True)
    ]
    passed = [
        (search, identified.arc, arc)
        for (search, identified), arc in zip(arcs, checked, strict=True)
        if isinstance(arc, ScreenedArc)
    ]
    sections = iter(_fit_sections(passed, priors, settings))
    return [arc if isinstance(arc, Rejection) else next(sections) for arc in checked]


def _check_screened(
    search: _Search, arc: IdentifiedArc, screened: ScreenedArc | None
) -> ScreenedArc | Rejection:
    """Return the screened arc, or a rejection if it has no ellipse or continues tangentially."""
    if screened is None:
        return Rejection(arc.arc, "no ellipse fits the points of the arc")
    reason = find_tangential_end_reason(search.prepared, arc, screened)
    return screened if reason is None else Rejection(arc.arc, reason)


def _fit_sections(
    arcs: Sequence[tuple[_Search, Arc, ScreenedArc]], priors: Priors, settings: Settings
) -> list[CylinderSection | Rejection]:
    """Return the cylinder of each screened arc, or a rejection.

    The arcs are given with their profile and their span before screening.
    """
    # Smoothing, which also detects jumps, and homogenising (resampling at equal arc length),
    # section 3.3.
    points = [arc.points for _, _, arc in arcs]
    smoothed = smooth_arcs(points, [arc.ellipse for _, _, arc in arcs])
    homogenised = homogenise_arcs(smoothed)
    # Ellipse fitting, section 2.3; its iteration ends at an ellipse too flat to be accepted.
    min_axis_ratio = max(settings.fitting.min_axis_ratio, settings.acceptance.min_fitted_axis_ratio)
    fits = refine_arcs(
        [noisy[smooth.inliers] for noisy, smooth in zip(points, smoothed, strict=True)],
        [arc.ellipse for arc in homogenised],
        priors,
        replace(settings.fitting, min_axis_ratio=min_axis_ratio),
        [search.prepared.estimated_std for search, _, _ in arcs],
    )
    return [
        Rejection(span, str(fit))
        if isinstance(fit, LsvisionError)
        else _check_section(search, arc.indices[smooth.inliers], fit, priors.phi, settings)
        for (search, span, arc), smooth, fit in zip(arcs, smoothed, fits, strict=True)
    ]


def _check_section(
    search: _Search,
    indices: IntArray,
    fit: EllipseFit,
    known_phi: PhiPrior | None,
    settings: Settings,
) -> CylinderSection | Rejection:
    """Return the cylinder fitted to the points at `indices` if it is accepted, else a rejection."""
    section = CylinderSection(fit, arc_from_indices(indices), indices)
    reason = find_rejection_reason(
        search.prepared, section, search.radius_range, settings.acceptance, known_phi
    )
    return section if reason is None else Rejection(section.arc, reason)


def _build_complete_measurement(
    search: _Search, results: Sequence[CylinderSection | Rejection], settings: Settings
) -> Measurement:
    """Return the measurement of a profile: cylinders, and a rejection for each other segment."""
    cylinders = suppress_overlapping([r for r in results if isinstance(r, CylinderSection)])
    rejections = complete_rejections(
        search.prepared,
        search.components,
        cylinders,
        [result for result in results if isinstance(result, Rejection)],
        search.radius_range,
        settings.candidates.min_span_points,
    )
    return build_measurement(cylinders, rejections, search.prepared, search.profile)
