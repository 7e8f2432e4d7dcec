"""One cylinder for each track of arcs, fitted jointly to the points of all its sections.

One section fits two cylinders equally well, the twins, whose axes are tilted to opposite sides of
the section's normal; so do two at right angles that cross on the axis, and short arcs on opposite
sides, in two planes. The twin is selected on a few sections of the track; then assignment of points
and fit of the cylinder alternate. The track with the most points comes first; each point belongs to
one cylinder only.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.cylinder.alternatives import (
    CylinderComparison,
    find_equivalent,
    keep_equivalent,
    select_distinct_cylinders,
    sort_by_chi2,
)
from lsvision.cylinder.fit import CylinderFittingSettings, fit_cylinder
from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.other_minima import find_other_minima
from lsvision.detection.acceptance import UNDETERMINABLE
from lsvision.ellipse.prior_check import CONTRADICTION_FRACTION, CONTRADICTION_SIGMAS
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import LsvisionError
from lsvision.geometry import BoolArray, Cylinder, IntArray
from lsvision.results.number_format import format_value
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.point_assignment import (
    PointAssignmentSettings,
    assign_points,
    fit_section_shifts,
    measure_point_distances,
)
from lsvision.scan.scan_result import ScanRejection
from lsvision.scan.single_section import fit_single_section
from lsvision.scan.tracks import ArcObservation, Track
from lsvision.statistics.robust import median


@dataclass(frozen=True, kw_only=True, slots=True)
class JointFitSettings:
    """Settings of the joint fit of a track.

    Parameters
    ----------
    point_assignment : PointAssignmentSettings
        Limits for the points of the cylinder.
    fitting : CylinderFittingSettings
        Fit to these points.
    max_iterations : int
        Maximum number of rounds of point assignment and fit.
    trial_sections : int
        Number of sections on which the twin is selected.
    max_straight_reduced_chi2 : float
        Largest reduced chi^2 of the sections' lateral shifts at which the cylinder counts as
        straight; above it, points are assigned about each section's own centre.
    max_normalised_rms : float
        Largest rms of the normalised residuals after a lateral shift of each section is fitted.
    max_relative_radius_std : float
        Largest radius_std / radius.
    min_recognised_fraction : float
        Smallest fraction of the sections with points of the cylinder in which detection found
        its arc. Clutter resembles an arc in some sections, a cylinder is detected in nearly all.
    """

    point_assignment: PointAssignmentSettings = PointAssignmentSettings()
    fitting: CylinderFittingSettings = CylinderFittingSettings()
    max_iterations: int = 5
    trial_sections: int = 8
    max_straight_reduced_chi2: float = 3.0
    max_normalised_rms: float = 4.0
    max_relative_radius_std: float = 0.1
    min_recognised_fraction: float = 0.5

    def __post_init__(self) -> None:
        if min(self.max_iterations, self.trial_sections) < 1:
            raise ValueError(f"expected at least one iteration and one trial section, got {self}")


@dataclass(frozen=True, eq=False, slots=True)
class JointFit:
    """Cylinder fitted to several sections, with the points used.

    Parameters
    ----------
    fit : CylinderFit
        Base frame.
    cloud : ScanCloud
        Points to which the cylinder was fitted.
    normalised_rms : float
        Rms of the normalised residuals after a lateral shift of each section is fitted; 1 for a
        single section.
    twin : Cylinder or None
        The other cylinder that fits equally well, of one section, of two that cross in the
        cylinder, or of short arcs on opposite sides.
    known_radius : RadiusPrior or None
        Prior with which several sections were fitted.
    """

    fit: CylinderFit
    cloud: ScanCloud
    normalised_rms: float
    twin: Cylinder | None = None
    known_radius: RadiusPrior | None = None


def fit_tracks(
    cloud: ScanCloud,
    tracks: Sequence[Track],
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> tuple[list[JointFit], list[ScanRejection]]:
    """Fit one cylinder to each track, in decreasing order of the tracks' point counts.

    Arcs of which half or more points already belong to an earlier cylinder are left out; a track of
    which no arc remains is dropped without a rejection: both tracks are parts of one cylinder. The
    accepted cylinders have no common points; the other tracks are rejections.
    """
    has_one_section = len(np.unique(cloud.point_sections)) == 1
    fits: list[JointFit] = []
    rejections: list[ScanRejection] = []
    for track in sorted(tracks, key=lambda arcs: -sum(len(arc.arc.indices) for arc in arcs)):
        unassigned = tuple(itertools.compress(track, _are_mostly_in(cloud, track)))
        if not unassigned:
            continue
        if has_one_section:
            fits.append(_build_single_section_fit(cloud, unassigned[0]))
            continue
        result = fit_track(cloud, unassigned, known_radius, settings)
        if isinstance(result, JointFit):
            result = _check_recognised_fraction(result, tracks, settings)
        if isinstance(result, ScanRejection):
            rejections.append(result)
        else:
            fits.append(result)
            fitted = result.cloud.contains(cloud.point_sections, cloud.indices)
            cloud = cloud.select_rows(np.flatnonzero(~fitted))
    return fits, rejections


def _build_single_section_fit(cloud: ScanCloud, observation: ArcObservation) -> JointFit:
    """Return one of the two twins of an arc, with the other one."""
    arc, section = observation.arc, observation.section
    arc_points = cloud.select_rows(cloud.find_rows(section, arc.indices))
    fit, twin = fit_single_section(arc, arc_points.points, cloud.poses[section])
    return JointFit(fit, arc_points, 1.0, twin)


def _are_mostly_in(cloud: ScanCloud, observations: Sequence[ArcObservation]) -> BoolArray:
    """Return whether the cloud contains more than half of each arc's points (n,)."""
    counts = np.array([len(observation.arc.indices) for observation in observations])
    sections = np.repeat([observation.section for observation in observations], counts)
    indices = np.concatenate([observation.arc.indices for observation in observations])
    starts = np.cumsum(counts) - counts
    contained = np.add.reduceat(cloud.contains(sections, indices), starts, dtype=np.int64)
    return 2 * contained > counts


def _check_recognised_fraction(
    joint_fit: JointFit, tracks: Sequence[Track], settings: JointFitSettings
) -> JointFit | ScanRejection:
    """Return the fit, or a rejection if detection found too few of its sections' arcs."""
    observations = list(itertools.chain.from_iterable(tracks))
    is_fitted = _are_mostly_in(joint_fit.cloud, observations)
    recognised = {arc.section for arc in itertools.compress(observations, is_fitted)}
    section_count = len(np.unique(joint_fit.cloud.point_sections))
    if len(recognised) >= settings.min_recognised_fraction * section_count:
        return joint_fit
    return ScanRejection(
        tuple(sorted(recognised)),
        f"recognised in {len(recognised)} of {section_count} sections with points on the cylinder, "
        f"expected at least {settings.min_recognised_fraction:.0%}",
    )


def fit_track(
    cloud: ScanCloud,
    track: Track,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> JointFit | ScanRejection:
    """Fit one cylinder to all points of the cloud that lie on the cylinder of a track.

    The cloud holds the points that are not assigned to a cylinder yet. A track of one arc is
    rejected.
    """
    sections = tuple(observation.section for observation in track)
    if len(sections) < 2:
        return ScanRejection(
            sections,
            f"an arc in section {sections[0]} alone, radius {track[0].radius:.3g} mm: one "
            "section allows two directions, and no other section shows the arc",
        )
    try:
        best, *others = fit_twins(cloud, track, known_radius, settings)
        rows = np.sort(_find_arc_rows(cloud, track))
        joint_fit = _assign_and_fit(cloud, best.cylinder, rows, known_radius, settings)
    except LsvisionError as failure:
        return ScanRejection(sections, str(failure))
    reason = _find_rejection_reason(joint_fit, settings)
    if reason is not None:
        return ScanRejection(sections, reason)
    return replace(joint_fit, twin=_find_twin(joint_fit, others, settings))


def _find_twin(
    joint_fit: JointFit, others: Sequence[CylinderFit], settings: JointFitSettings
) -> Cylinder | None:
    """Return the first of other cylinders that fits all points as well as the fit; None without."""
    cloud, known_radius = joint_fit.cloud, joint_fit.known_radius
    rows = np.arange(len(cloud))
    fits, _ = _fit_all(cloud, rows, [fit.cylinder for fit in others], known_radius, settings)
    comparison = _build_comparison(cloud, rows, known_radius, settings)
    return find_equivalent(joint_fit.fit, [fit.cylinder for fit in fits], comparison)


def fit_twins(
    cloud: ScanCloud,
    track: Track,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> list[CylinderFit]:
    """Return the cylinder fitted to arcs of a track, and then the others that fit as well.

    The initial guesses are the line through the arcs' centres, both twins of the arc with the best
    determined axis, and the other minima near the best cylinder. The best one is selected on a few
    arcs, and if others fit these as well on all arcs.

    Raises
    ------
    FitFailed, DegenerateGeometry
        If the fit fails from every initial guess.
    """
    trial_indices = np.linspace(0, len(track) - 1, min(len(track), settings.trial_sections))
    rows = _find_arc_rows(cloud, [track[index] for index in np.unique(trial_indices.astype(int))])
    fits, failure = _fit_all(cloud, rows, _guess_cylinders(track), known_radius, settings)
    if failure is not None and not fits:
        raise failure
    fits = select_distinct_cylinders(fits)
    comparison = _build_comparison(cloud, rows, known_radius, settings)
    best = sort_by_chi2(fits, comparison)[0].cylinder
    minima = find_other_minima(comparison.points, best, known_radius)
    fits += _fit_all(cloud, rows, minima, known_radius, settings)[0]
    best_fit, *others = keep_equivalent(fits, comparison)
    if not others or len(track) <= settings.trial_sections:
        return [best_fit, *others]
    rows = _find_arc_rows(cloud, track)
    cylinders = [fit.cylinder for fit in (best_fit, *others)]
    all_fits, _ = _fit_all(cloud, rows, cylinders, known_radius, settings)
    comparison = _build_comparison(cloud, rows, known_radius, settings)
    return keep_equivalent(all_fits or [best_fit], comparison)


def _fit_all(
    cloud: ScanCloud,
    rows: IntArray,
    initial_guesses: Sequence[Cylinder],
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> tuple[list[CylinderFit], LsvisionError | None]:
    """Return the fits from several initial guesses, and the last error."""
    fits, failure = list[CylinderFit](), None
    for initial_guess in initial_guesses:
        try:
            fits.append(_fit(cloud, rows, initial_guess, known_radius, settings))
        except LsvisionError as error:
            failure = error
    return fits, failure


def _build_comparison(
    cloud: ScanCloud,
    rows: IntArray,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> CylinderComparison:
    """Return the comparison of cylinders by the points of a cloud at some rows."""
    return CylinderComparison(
        cloud.points[rows],
        cloud.covariances[rows],
        cloud.noise_known,
        known_radius,
        settings.fitting.truncation or math.inf,
    )


def _find_arc_rows(cloud: ScanCloud, track: Sequence[ArcObservation]) -> IntArray:
    return np.concatenate(
        [cloud.find_rows(observation.section, observation.arc.indices) for observation in track]
    )


def _guess_cylinders(track: Track) -> list[Cylinder]:
    """Return the line through the arcs' centres, if they differ, and both twins of the best arc."""
    best = min(track, key=lambda observation: observation.twins_std)
    radius = median(np.array([observation.radius for observation in track]))
    centres = np.array([observation.centre for observation in track])
    mean_centre = centres.mean(axis=0)
    guesses = [Cylinder(best.centre, twin, radius) for twin in best.twins]
    direction = np.linalg.svd(centres - mean_centre, full_matrices=False)[2][0]
    if np.ptp(centres @ direction) > 0:
        guesses.insert(0, Cylinder(mean_centre, direction, radius))
    return guesses


def _fit(
    cloud: ScanCloud,
    rows: IntArray,
    initial_guess: Cylinder,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> CylinderFit:
    """Return the cylinder fitted to the points of a cloud at some rows."""
    return fit_cylinder(
        cloud.points[rows],
        cloud.covariances[rows] if cloud.noise_known else None,
        initial_guess=initial_guess,
        known_radius=known_radius,
        settings=settings.fitting,
    )


def _assign_and_fit(
    cloud: ScanCloud,
    cylinder: Cylinder,
    rows: IntArray,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> JointFit:
    """Assign points and fit in turn until the set of points no longer changes.

    `rows` are the points of the cloud with which the first shifts of the sections are estimated.
    """
    for iteration in range(settings.max_iterations):
        distances = measure_point_distances(cloud, cylinder, rows)
        section_fit = fit_section_shifts(distances, free_radius=False)
        shifts, assignment = np.zeros((len(cloud.poses), 2)), settings.point_assignment
        if section_fit.reduced_chi2 > settings.max_straight_reduced_chi2:
            section_fit = fit_section_shifts(distances, free_radius=True)
            shifts = section_fit.interpolate(len(cloud.poses))
            # On a bent cylinder, residuals at the arc ends come from the bend and not from a weld.
            assignment = replace(assignment, max_trimmed_points=0)
        previous_rows = rows
        rows = assign_points(
            cloud, section_fit.cylinder, shifts, section_fit.noise_factor, assignment
        )
        is_unchanged = np.array_equal(rows, previous_rows)
        if iteration == 0 or not is_unchanged:
            fit = _fit(cloud, rows, cylinder, known_radius, settings)
            cylinder = fit.cylinder
        if is_unchanged:
            break
    distances = measure_point_distances(cloud, cylinder, rows)
    section_fit = fit_section_shifts(distances, free_radius=True)
    return JointFit(
        fit, cloud.select_rows(rows), section_fit.normalised_rms, known_radius=known_radius
    )


def _find_rejection_reason(joint_fit: JointFit, settings: JointFitSettings) -> str | None:
    """Return why a joint fit is rejected; None if it is accepted."""
    fit, rms, max_rms = joint_fit.fit, joint_fit.normalised_rms, settings.max_normalised_rms
    if rms > max_rms:
        return f"residual rms {rms:.1f} times the noise, limit {max_rms:.1f}"
    max_std = settings.max_relative_radius_std * fit.radius
    if fit.radius_std > max_std:
        return (
            f"{UNDETERMINABLE}: {fit.radius:.3g} mm with a standard uncertainty of "
            f"{fit.radius_std:.2g} mm, limit {max_std:.2g} mm"
        )
    return _find_contradiction(joint_fit, settings)


def _find_contradiction(joint_fit: JointFit, settings: JointFitSettings) -> str | None:
    """Return the reason why the points contradict a known radius; None if they do not.

    The limits are those of a single section, whose points often determine no radius that could
    contradict it.
    """
    known, cloud = joint_fit.known_radius, joint_fit.cloud
    if known is None:
        return None
    try:
        free = _fit(cloud, np.arange(len(cloud)), joint_fit.fit.cylinder, None, settings)
    except LsvisionError:  # without the known radius the points do not determine a cylinder
        return None
    uncertainty = CONTRADICTION_SIGMAS * math.hypot(free.radius_std, known.std)
    if abs(free.radius - known.radius) <= max(uncertainty, CONTRADICTION_FRACTION * known.radius):
        return None
    found = format_value(free.radius, free.radius_std)
    return f"the known radius of {known.radius:g} mm contradicts the points: they give {found} mm"
