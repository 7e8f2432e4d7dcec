"""From a track of arcs to one cylinder: choose the twin, gather the points, fit them jointly."""

import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.errors import LsvisionError
from lsvision.fitting.cylinder_evidence import CylinderFit
from lsvision.fitting.cylinder_fit import CylinderFittingSettings, fit_cylinder
from lsvision.fitting.ellipse_problem import KnownRadius
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.gathering import GatheringSettings, centre_line, rows_near
from lsvision.scan.scanned import ScanRejection
from lsvision.scan.tracks import Track
from lsvision.shapes import Cylinder, IntArray


@dataclass(frozen=True, kw_only=True, slots=True)
class SettlingSettings:
    """Joint fit of a track.

    Parameters
    ----------
    gathering : GatheringSettings
        Which points count.
    fitting : CylinderFittingSettings
        The fit to them.
    rounds : int
        How often points are gathered and fitted.
    trial_sections : int
        Number of sections that choose the twin.
    straight : float
        Chi^2 over its freedom, of the sections' lateral shifts, below which a pipe is
        straight; above, points are gathered about each section's own centre.
    largest_misfit : float
        Rms of the points' distances from it over the noise, each section shifted.
    largest_radius_error : float
        One sigma over the radius.
    least_recognised : float
        Share of the sections with its points in which recognition must have seen its arc;
        clutter passes for a pipe's arc here and there, a pipe nearly everywhere.
    """

    gathering: GatheringSettings = GatheringSettings()
    fitting: CylinderFittingSettings = CylinderFittingSettings()
    rounds: int = 5
    trial_sections: int = 8
    straight: float = 3.0
    largest_misfit: float = 4.0
    largest_radius_error: float = 0.1
    least_recognised: float = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class SettledCylinder:
    """A joint fit and the points it rests on.

    Parameters
    ----------
    fit : CylinderFit
        Base frame.
    cloud : ScanCloud
        The points of the fit.
    misfit : float
        Rms of the distances over the noise, each section shifted to where it fits best.
    twin : Cylinder or None
        The other cylinder that fits the points of a lone section.
    """

    fit: CylinderFit
    cloud: ScanCloud
    misfit: float
    twin: Cylinder | None = None


def settle_track(
    cloud: ScanCloud,
    track: Track,
    known_radius: KnownRadius | None = None,
    settings: SettlingSettings = SettlingSettings(),
) -> SettledCylinder | ScanRejection:
    """Fit one cylinder to all points of the scan that belong to a track's.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    track : Track
        Arcs of two or more sections.
    known_radius : KnownRadius, optional
        A prior.
    settings : SettlingSettings
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
        cylinder = choose_twin(cloud, track, known_radius, settings)
        rows = np.concatenate([cloud.find(s.section, s.arc.indices) for s in track])
        settled = _gather_and_fit(cloud, cylinder, np.sort(rows), known_radius, settings)
    except LsvisionError as failure:
        return ScanRejection(sections, str(failure))
    reason = _reason_against(settled, settings)
    return settled if reason is None else ScanRejection(sections, reason)


def choose_twin(
    cloud: ScanCloud,
    track: Track,
    known_radius: KnownRadius | None,
    settings: SettlingSettings = SettlingSettings(),
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
    rows = np.concatenate([cloud.find(s.section, s.arc.indices) for s in few])
    fits = []
    failure: LsvisionError | None = None
    for start in _starts(track):
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


def _starts(track: Track) -> list[Cylinder]:
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
    known_radius: KnownRadius | None,
    settings: SettlingSettings,
) -> CylinderFit:
    return fit_cylinder(
        cloud.points[rows],
        cloud.covariances[rows] if cloud.noise_is_known else None,
        start=start,
        known_radius=known_radius,
        settings=settings.fitting,
    )


def _gather_and_fit(
    cloud: ScanCloud,
    cylinder: Cylinder,
    rows: IntArray,
    known_radius: KnownRadius | None,
    settings: SettlingSettings,
) -> SettledCylinder:
    for _ in range(settings.rounds):
        line = centre_line(cloud, cylinder, rows, free_radius=False)
        stray, gathering = np.zeros((len(cloud.poses), 2)), settings.gathering
        if line.surprise > settings.straight:
            line = centre_line(cloud, cylinder, rows, free_radius=True)
            stray = line.at(len(cloud.poses))
            # What a bent tube's sections miss is no sign of a weld at their ends.
            gathering = replace(gathering, most_trimmed=0)
        near = rows_near(cloud, line.cylinder, stray, line.noise_excess, gathering)
        fit = _fit(cloud, near, cylinder, known_radius, settings)
        cylinder, before, rows = fit.cylinder, rows, near
        if np.array_equal(near, before):
            break
    line = centre_line(cloud, cylinder, rows, free_radius=True)
    return SettledCylinder(fit, cloud.only(rows), line.misfit)


def _reason_against(settled: SettledCylinder, settings: SettlingSettings) -> str | None:
    fit = settled.fit
    if settled.misfit > settings.largest_misfit:
        return (
            f"residual rms {settled.misfit:.1f} times the noise, limit "
            f"{settings.largest_misfit:.1f}"
        )
    if fit.radius_std > settings.largest_radius_error * fit.radius:
        return f"radius {fit.radius:.3g} mm with an error of {fit.radius_std:.2g} mm"
    return None
