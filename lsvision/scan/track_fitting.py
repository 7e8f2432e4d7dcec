"""All tracks of a scan, each to its cylinder; a point belongs to one cylinder only."""

from collections.abc import Sequence

import numpy as np

from lsvision.ellipse.problem import RadiusPrior
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.joint_fit import JointFit, JointFitSettings, fit_track
from lsvision.scan.scan_result import ScanRejection
from lsvision.scan.single_section import cylinder_from_single_section
from lsvision.scan.tracks import ArcObservation, Track


def fit_tracks(
    cloud: ScanCloud,
    tracks: Sequence[Track],
    known_radius: RadiusPrior | None,
    settings: JointFitSettings,
) -> tuple[list[JointFit], list[ScanRejection]]:
    """One cylinder a track, the track of most points first; a point belongs to one cylinder.

    Tracks whose points an earlier cylinder has taken are that cylinder's, and vanish.
    """
    lone = len(np.unique(cloud.point_sections)) == 1
    found: list[JointFit] = []
    rejections: list[ScanRejection] = []
    for track in sorted(tracks, key=_point_count, reverse=True):
        free = tuple(s for s in track if _mostly_in(cloud, s))
        if not free:
            continue
        if lone:
            found.append(cylinder_from_single_section(cloud, free[0]))
            continue
        settled = fit_track(cloud, free, known_radius, settings)
        if isinstance(settled, JointFit):
            settled = _check_recognised_fraction(settled, tracks, settings)
        if isinstance(settled, ScanRejection):
            rejections.append(settled)
        else:
            found.append(settled)
            cloud = cloud.excluding(settled.cloud)
    return found, rejections


def _point_count(track: Track) -> int:
    return sum(len(sighting.arc.indices) for sighting in track)


def _mostly_in(cloud: ScanCloud, sighting: ArcObservation) -> bool:
    indices = sighting.arc.indices
    return 2 * len(cloud.rows_of(sighting.section, indices)) > len(indices)


def _check_recognised_fraction(
    settled: JointFit, tracks: Sequence[Track], settings: JointFitSettings
) -> JointFit | ScanRejection:
    """The cylinder, if detection found it in enough of the sections that show its points."""
    recognised = {
        sighting.section
        for track in tracks
        for sighting in track
        if _mostly_in(settled.cloud, sighting)
    }
    shown = len(np.unique(settled.cloud.point_sections))
    if len(recognised) >= settings.min_recognised_fraction * shown:
        return settled
    return ScanRejection(
        tuple(sorted(recognised)),
        f"recognised in {len(recognised)} of {shown} sections that have points there, needs "
        f"{settings.min_recognised_fraction:.0%}",
    )
