"""From a track of arcs to one cylinder: choose the twin, gather the points, fit them jointly."""

import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.cylinder.fit import CylinderFittingSettings, fit_cylinder
from lsvision.cylinder.fit_result import CylinderFit
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import LsvisionError
from lsvision.geometry import Cylinder, IntArray
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.point_assignment import (
    PointAssignmentSettings,
    assign_points,
    fit_section_shifts,
)
from lsvision.scan.scan_result import ScanRejection
from lsvision.scan.tracks import Track


@dataclass(frozen=True, kw_only=True, slots=True)
class JointFitSettings:
    """Joint fit of a track.

    Parameters
    ----------
    point_assignment : PointAssignmentSettings
        Which points count.
    fitting : CylinderFittingSettings
        The fit to them.
    max_iterations : int
        How often points are gathered and fitted.
    trial_sections : int
        Number of sections that choose the twin.
    max_straight_reduced_chi2 : float
        Chi^2 over its freedom, of the sections' lateral shifts, below which a pipe is
        straight; above, points are gathered about each section's own centre.
    max_normalised_rms : float
        Rms of the points' distances from it over the noise, each section shifted.
    max_relative_radius_std : float
        One sigma over the radius.
    min_recognised_fraction : float
        Share of the sections with its points in which detection must have found its arc;
        clutter passes for a pipe's arc here and there, a pipe nearly everywhere.
    """

    point_assignment: PointAssignmentSettings = PointAssignmentSettings()
    fitting: CylinderFittingSettings = CylinderFittingSettings()
    max_iterations: int = 5
    trial_sections: int = 8
    max_straight_reduced_chi2: float = 3.0
    max_normalised_rms: float = 4.0
    max_relative_radius_std: float = 0.1
    min_recognised_fraction: float = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class JointFit:
    """A joint fit and the points it rests on.

    Parameters
    ----------
    fit : CylinderFit
        Base frame.
    cloud : ScanCloud
        The points of the fit.
    normalised_rms : float
        Rms of the distances over the noise, each section shifted to where it fits best.
    twin : Cylinder or None
        The other cylinder that fits the points of a lone section.
    """

    fit: CylinderFit
    cloud: ScanCloud
    normalised_rms: float
    twin: Cylinder | None = None


def fit_track(
    cloud: ScanCloud,
    track: Track,
    known_radius: RadiusPrior | None = None,
    settings: JointFitSettings = JointFitSettings(),
) -> JointFit | ScanRejection:
    """Fit one cylinder to all points of the scan that belong to a track's.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    track : Track
        Arcs of two or more sections.
    known_radius : RadiusPrior, optional
        A prior.
    settings : JointFitSettings
        Limits.
    """
    sections = tuple(sighting.section for sighting in track)
    if len(sections) < 2:
        return ScanRejection(
            sections,
            f"an arc in section {sections[0]} alone, radius {track[0].radius:.3g} mm: its "
            "measurement has both twins; no other section shows it",
        )
    try:
        cylinder = select_twin(cloud, track, known_radius, settings)
        rows = np.concatenate([cloud.rows_of(s.section, s.arc.indices) for s in track])
        settled = _gather_and_fit(cloud, cylinder, np.sort(rows), known_radius, settings)
    except LsvisionError as failure:
        return ScanRejection(sections, str(failure))
    reason = _rejection_reason(settled, settings)
    return settled if reason is None else ScanRejection(sections, reason)


def select_twin(
    cloud: ScanCloud,
    track: Track,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings = JointFitSettings(),
) -> Cylinder:
    """Cylinder that fits a track's points best, from every start that the track offers.

    Starts are the line through the centres, and the twins of the best arc.

    Raises
    ------
    FitFailed, DegenerateGeometry
        If no start leads to a cylinder.
    """
    spread = np.linspace(0, len(track) - 1, min(len(track), settings.trial_sections))
    few = [track[place] for place in np.unique(spread.astype(int))]
    rows = np.concatenate([cloud.rows_of(s.section, s.arc.indices) for s in few])
    fits = []
    failure: LsvisionError | None = None
    for start in _initial_guesses(track):
        try:
            fits.append(_fit(cloud, rows, start, known_radius, settings))
        except LsvisionError as error:
            failure = error
    if failure is not None and not fits:
        raise failure
    return min(fits, key=_cost).cylinder


def _cost(fit: CylinderFit) -> float:
    # Without a noise model the normalised residuals are all of mean square 1.
    unknown = math.isfinite(fit.degrees_of_freedom)
    return float(np.mean((fit.residuals if unknown else fit.normalised) ** 2))


def _initial_guesses(track: Track) -> list[Cylinder]:
    best = min(track, key=lambda sighting: sighting.twins_std)
    radius = float(np.median([sighting.radius for sighting in track]))
    centres = np.array([sighting.centre for sighting in track])
    middle = centres.mean(axis=0)
    starts = [Cylinder(best.centre, twin, radius) for twin in best.twins]
    way = np.linalg.svd(centres - middle)[2][0]
    if np.ptp(centres @ way) > 0:
        starts.insert(0, Cylinder(middle, way, radius))
    return starts


def _fit(
    cloud: ScanCloud,
    rows: IntArray,
    start: Cylinder,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> CylinderFit:
    return fit_cylinder(
        cloud.points[rows],
        cloud.covariances[rows] if cloud.noise_known else None,
        initial_guess=start,
        known_radius=known_radius,
        settings=settings.fitting,
    )


def _gather_and_fit(
    cloud: ScanCloud,
    cylinder: Cylinder,
    rows: IntArray,
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> JointFit:
    for _ in range(settings.max_iterations):
        line = fit_section_shifts(cloud, cylinder, rows, free_radius=False)
        stray, gathering = np.zeros((len(cloud.poses), 2)), settings.point_assignment
        if line.reduced_chi2 > settings.max_straight_reduced_chi2:
            line = fit_section_shifts(cloud, cylinder, rows, free_radius=True)
            stray = line.interpolated(len(cloud.poses))
            # What a bent tube's sections miss is no sign of a weld at their ends.
            gathering = replace(gathering, max_trimmed_points=0)
        near = assign_points(cloud, line.cylinder, stray, line.noise_factor, gathering)
        fit = _fit(cloud, near, cylinder, known_radius, settings)
        cylinder, before, rows = fit.cylinder, rows, near
        if np.array_equal(near, before):
            break
    line = fit_section_shifts(cloud, cylinder, rows, free_radius=True)
    return JointFit(fit, cloud.subset(rows), line.normalised_rms)


def _rejection_reason(settled: JointFit, settings: JointFitSettings) -> str | None:
    fit = settled.fit
    if settled.normalised_rms > settings.max_normalised_rms:
        return (
            f"residual rms {settled.normalised_rms:.1f} times the noise, limit "
            f"{settings.max_normalised_rms:.1f}"
        )
    if fit.radius_std > settings.max_relative_radius_std * fit.radius:
        return f"radius {fit.radius:.3g} mm with an error of {fit.radius_std:.2g} mm"
    return None
