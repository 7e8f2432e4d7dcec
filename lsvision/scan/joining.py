"""All tracks of a scan, each to its cylinder; a point belongs to one cylinder only."""

from collections.abc import Sequence

import numpy as np

from lsvision.fitting.ellipse_problem import KnownRadius
from lsvision.scan.cloud import ScanCloud
from lsvision.scan.lone_section import settle_lone_section
from lsvision.scan.scanned import ScanRejection
from lsvision.scan.settling import SettledCylinder, SettlingSettings, settle_track
from lsvision.scan.tracks import Sighting, Track


def settle_tracks(
    cloud: ScanCloud,
    tracks: Sequence[Track],
    known_radius: KnownRadius | None,
    settings: SettlingSettings,
) -> tuple[list[SettledCylinder], list[ScanRejection]]:
    """One cylinder a track, the track of most points first; a point belongs to one cylinder.

    Tracks whose points an earlier cylinder has taken are that cylinder's, and vanish.
    """
    lone = len(np.unique(cloud.owners)) == 1
    found: list[SettledCylinder] = []
    rejections: list[ScanRejection] = []
    for track in sorted(tracks, key=_point_count, reverse=True):
        free = tuple(s for s in track if _mostly_in(cloud, s))
        if not free:
            continue
        if lone:
            found.append(settle_lone_section(cloud, free[0]))
            continue
        settled = settle_track(cloud, free, known_radius, settings)
        if isinstance(settled, SettledCylinder):
            settled = _unless_rarely_recognised(settled, tracks, settings)
        if isinstance(settled, ScanRejection):
            rejections.append(settled)
        else:
            found.append(settled)
            cloud = cloud.without(settled.cloud)
    return found, rejections


def _point_count(track: Track) -> int:
    return sum(len(sighting.arc.indices) for sighting in track)


def _mostly_in(cloud: ScanCloud, sighting: Sighting) -> bool:
    indices = sighting.arc.indices
    return 2 * len(cloud.find(sighting.section, indices)) > len(indices)


def _unless_rarely_recognised(
    settled: SettledCylinder, tracks: Sequence[Track], settings: SettlingSettings
) -> SettledCylinder | ScanRejection:
    """The cylinder, if recognition saw it in enough of the sections that show its points."""
    recognised = {
        sighting.section
        for track in tracks
        for sighting in track
        if _mostly_in(settled.cloud, sighting)
    }
    shown = len(np.unique(settled.cloud.owners))
    if len(recognised) >= settings.least_recognised * shown:
        return settled
    return ScanRejection(
        tuple(sorted(recognised)),
        f"recognised in {len(recognised)} of {shown} sections that have points there, needs "
        f"{settings.least_recognised:.0%}",
    )
