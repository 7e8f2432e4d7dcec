"""Pipeline from profiles to their cylinders (the paper's Figure 4).

Range image and candidates precede the paper's steps, because rough identification alone mistakes
planes for huge ellipses. The paper's pipeline without them is
`lsvision.studies.chen_liu_2016.measure_cylinders_paper`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

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
from lsvision.detection.screening import ScreenedArc, screen_arcs
from lsvision.detection.search_range import search_range
from lsvision.ellipse.fit import EllipseFit, FittingSettings
from lsvision.ellipse.homogenising import homogenise_arcs
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.ellipse.refinement import refine_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import smooth_arcs
from lsvision.errors import LsvisionError
from lsvision.geometry import IntArray
from lsvision.geometry.arguments import as_known_phi, as_number_or_pair
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
"""Largest number of points that each step handles together: 53 profiles of 376 points. More need
more memory and are hardly faster."""
PROFILES_AT_ONCE = 32
"""Number of profiles in a task of a process: twice as many are hardly faster."""
_Number = float | Sequence[float] | None
"""A number, or a pair, such as (mean, std)."""


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
    measured = as_profile(profile)
    (measurement,) = _measure(
        [measured], (radius, known_radius, known_phi), as_noise_model(sensor), settings
    )
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
    """Measure many profiles at once, several times as fast as one by one.

    Each step handles up to `POINTS_AT_ONCE` points of several profiles together.
    `lsvision.measure_many` does the same in several processes, with profiles that are read lazily.

    Parameters
    ----------
    profiles : sequence of Profile, (n, 2) array_like or data frame
        The profiles.
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
    measured = list(map(as_profile, profiles))
    options = (radius, known_radius, known_phi), as_noise_model(sensor), settings
    sizes = list(map(len, measured))
    return apply_in_groups(lambda some: _measure(some, *options), measured, sizes, POINTS_AT_ONCE)


def _measure(
    profiles: Sequence[Profile],
    radii_and_tilt: tuple[_Number, _Number, _Number],
    sensor: NoiseModel | None,
    settings: Settings,
) -> list[Measurement]:
    """Measure profiles with the values of `radius`, `known_radius` and `known_phi`."""
    radius, known_radius, known_phi = radii_and_tilt
    priors = Priors(radius_prior_from_value(known_radius), _phi_prior_from_value(known_phi))
    search = as_number_or_pair(radius, "radius", "mm", "(min, max)")
    found = _find_cylinders(profiles, search, priors, sensor, settings)
    return [replace(one, profile=profile) for one, profile in zip(found, profiles, strict=True)]


class _Search(NamedTuple):
    """A prepared profile with the radii that are searched, in mm, and its connected components."""

    profile: PreparedProfile
    radius_range: tuple[float, float]
    components: list[IntArray]


def _find_cylinders(
    profiles: Sequence[Profile],
    radius: float | tuple[float, float] | None,
    priors: Priors,
    sensor: NoiseModel | None,
    settings: Settings,
) -> list[Measurement]:
    """Run the steps of the paper's Figure 4 on several profiles at once."""
    prepared = [prepare_profile(profile, sensor or profile.noise) for profile in profiles]
    ranges = [search_range(radius, priors.radius, profile) for profile in prepared]
    images = [build_range_image(profile, settings.range_image) for profile in prepared]
    min_points = settings.candidates.min_span_points
    components = [connected_components(image, min_points) for image in images]
    candidates = find_candidates(prepared, components, ranges, settings.candidates)
    # Rough identification, section 3.2.1.
    identified = identify_arcs(prepared, candidates, ranges, settings.acceptance)
    searches = [_Search(*search) for search in zip(prepared, ranges, components, strict=True)]
    found = list(zip(searches, identified, strict=True))
    arcs = [(search, arc) for search, (arcs, _) in found for arc in arcs]
    sizes = [len(arc.indices) for _, arc in arcs]
    results = iter(
        apply_in_groups(
            lambda some: _measure_arcs(some, priors, settings), arcs, sizes, POINTS_AT_ONCE
        )
    )
    return [
        _complete(search, [next(results) for _ in arcs], rejections, settings)
        for search, (arcs, rejections) in found
    ]


def _measure_arcs(
    arcs: Sequence[tuple[_Search, IdentifiedArc]], priors: Priors, settings: Settings
) -> list[CylinderSection | Rejection]:
    """Return the cylinder of each identified arc, or the rejection with its reason."""
    results, kept = dict[int, CylinderSection | Rejection](), dict[int, ScreenedArc]()
    # Accurate screening, section 3.2.2.
    screened = screen_arcs([search.profile for search, _ in arcs], [arc for _, arc in arcs])
    for i, (arc, inliers) in enumerate(zip(arcs, screened, strict=True)):
        checked = _check_screened(*arc, inliers)
        if isinstance(checked, Rejection):
            results[i] = checked
        else:
            kept[i] = checked
    # Smoothing and homogenising, section 3.3.
    points = [arc.points for arc in kept.values()]
    smoothed = smooth_arcs(points, [arc.ellipse for arc in kept.values()])
    homogenised = homogenise_arcs(smoothed)
    # Ellipse fitting, section 2.3.
    fits = refine_arcs(
        [some[smooth.inliers] for some, smooth in zip(points, smoothed, strict=True)],
        [arc.ellipse for arc in homogenised],
        priors,
        settings.fitting,
        [arcs[i][0].profile.estimated_std for i in kept],
    )
    for (i, screened_arc), smooth, fit in zip(kept.items(), smoothed, fits, strict=True):
        results[i] = _accept(*arcs[i], screened_arc.indices[smooth.inliers], fit, settings)
    return [results[i] for i in range(len(arcs))]


def _check_screened(
    search: _Search, arc: IdentifiedArc, screened: ScreenedArc | None
) -> ScreenedArc | Rejection:
    """Return a screened arc, or its rejection."""
    if screened is None:
        return Rejection(arc.arc, "no ellipse fits the middle part of the arc")
    noise_std = search.profile.noise_std * screened.variance_factor**0.5
    reason = tangential_end_reason(search.profile, arc, screened, noise_std)
    return screened if reason is None else Rejection(arc.arc, reason)


def _accept(
    search: _Search,
    arc: IdentifiedArc,
    indices: IntArray,
    fit: EllipseFit | LsvisionError,
    settings: Settings,
) -> CylinderSection | Rejection:
    """Return the cylinder of an arc, fitted to the points at `indices`, or the rejection."""
    if isinstance(fit, LsvisionError):
        return Rejection(arc.arc, str(fit))
    section = CylinderSection(fit, Arc(int(indices[0]), int(indices[-1]) + 1), indices)
    reason = rejection_reason(search.profile, section, search.radius_range, settings.acceptance)
    return section if reason is None else Rejection(section.arc, reason)


def _complete(
    search: _Search,
    results: Sequence[CylinderSection | Rejection],
    rejections: list[Rejection],
    settings: Settings,
) -> Measurement:
    """Return the result of a profile: its cylinders, and a reason for each other segment."""
    cylinders = suppress_overlapping([r for r in results if isinstance(r, CylinderSection)])
    rejections = complete_rejections(
        search.profile,
        search.components,
        cylinders,
        rejections + [result for result in results if isinstance(result, Rejection)],
        search.radius_range,
        settings.candidates.min_span_points,
    )
    return measurement_in_sensor_columns(cylinders, rejections, search.profile)


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
