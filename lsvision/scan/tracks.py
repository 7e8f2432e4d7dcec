"""Which arcs of different sections belong to one cylinder.

Sections are taken in their order. Each cylinder seen so far predicts where the next section
should cut it: along the line of its centres, or, while those are too close together to tell,
along both twins. Solid pipes cannot run into each other, so that a gate of a third of the
radius keeps even welded neighbours apart, and leaves room for a bent pipe.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray, Pose


@dataclass(frozen=True, kw_only=True, slots=True)
class TrackSettings:
    """Association of arcs across sections.

    Parameters
    ----------
    gate, max_gate : float
        Largest distance of a centre from the predicted axis, without and with all
        uncertainty. Units: radii.
    radius_gate : float
        Largest difference of radii beyond their errors. Units: radii.
    sigmas : float
        Errors count so many standard deviations.
    window : int
        Number of last sections that make the prediction.
    """

    gate: float = 0.3
    max_gate: float = 0.6
    radius_gate: float = 0.12
    sigmas: float = 4.0
    window: int = 10


@dataclass(frozen=True, eq=False, slots=True)
class ArcObservation:
    """One arc of one section, in the base frame.

    Parameters
    ----------
    section : int
        Index of the profile.
    arc : CylinderSection
        In its section's frame.
    centre : (3,) ndarray
        Of the ellipse, base frame. Units: mm.
    centre_std : float
        Root mean square error across both ways. Units: mm.
    radius_std : float
        Units: mm.
    twins : (2, 3) ndarray
        Both axes, base frame.
    twins_std : float
        Error of the true one of the two. Units: rad.
    """

    section: int
    arc: CylinderSection
    centre: FloatArray
    centre_std: float
    radius_std: float
    twins: FloatArray
    twins_std: float

    @property
    def radius(self) -> float:
        """Units: mm."""
        return self.arc.radius


Track = tuple[ArcObservation, ...]


def transform_arc_to_base(section: int, arc: CylinderSection, pose: Pose) -> ArcObservation:
    """Bring an arc to the base frame.

    Parameters
    ----------
    section : int
        Index of the profile.
    arc : CylinderSection
        Section frame.
    pose : Pose
        ``base_from_section``.
    """
    covariance = arc.covariance
    sideways = math.sin(arc.phi) * arc.theta_std
    return ArcObservation(
        section=section,
        arc=arc,
        centre=pose.apply_one([*arc.centre, 0.0]),
        centre_std=math.sqrt(covariance[0, 0] + covariance[1, 1]),
        radius_std=math.sqrt(covariance[3, 3]),
        twins=arc.axis_twins @ pose.rotation.T,
        twins_std=math.hypot(arc.phi_std, sideways),
    )


def associate_arcs(
    sightings: Sequence[ArcObservation], settings: TrackSettings = TrackSettings()
) -> tuple[Track, ...]:
    """Chain arcs of different sections to tracks, one a cylinder.

    Parameters
    ----------
    sightings : sequence of ArcObservation
        In the order of the sections.
    settings : TrackSettings
        Gates.

    Returns
    -------
    tuple of Track
        Each holds at most one arc a section; in order of their first. A pipe of which one
        section shows two arcs leaves two tracks here; they meet again at the joint fit.
    """
    tracks: list[list[ArcObservation]] = []
    for section in sorted({sighting.section for sighting in sightings}):
        here = [sighting for sighting in sightings if sighting.section == section]
        pairs = sorted(
            (score, t, s)
            for t, track in enumerate(tracks)
            for s, sighting in enumerate(here)
            if (score := _normalised_gate_distance(track[-settings.window :], sighting, settings))
            < 1
        )
        taken_tracks: set[int] = set()
        taken: set[int] = set()
        for _, t, s in pairs:
            if t not in taken_tracks and s not in taken:
                tracks[t].append(here[s])
                taken_tracks.add(t)
                taken.add(s)
        tracks.extend([here[s]] for s in range(len(here)) if s not in taken)
    return tuple(tuple(track) for track in tracks)


def _normalised_gate_distance(
    recent: Sequence[ArcObservation], new: ArcObservation, settings: TrackSettings
) -> float:
    """Distance of a centre from where a track predicts it, in gates; 1 and more is outside."""
    radius = float(np.median([sighting.radius for sighting in recent]))
    radius_std = min(sighting.radius_std for sighting in recent)
    allowed = settings.sigmas * math.hypot(radius_std, new.radius_std)
    if abs(new.radius - radius) > allowed + settings.radius_gate * radius:
        return math.inf
    start, directions, direction_std = predict_axes(recent)
    ahead = new.centre - start
    gaps = np.linalg.norm(ahead - (directions @ ahead)[:, None] * directions, axis=1)
    loose = settings.sigmas * new.centre_std + 2 * direction_std * float(np.linalg.norm(ahead))
    gate = min(settings.gate * radius + loose, settings.max_gate * radius)
    return float(gaps.min()) / gate


def predict_axes(recent: Sequence[ArcObservation]) -> tuple[FloatArray, FloatArray, float]:
    """Where the axis of a few sightings runs.

    Parameters
    ----------
    recent : sequence of ArcObservation
        One or more.

    Returns
    -------
    start : (3,) ndarray
        A point of it. Units: mm.
    directions : (1, 3) or (2, 3) ndarray
        The line of centres, or both twins where they know better.
    std : float
        Error of the directions. Units: rad.
    """
    centres = np.array([sighting.centre for sighting in recent])
    middle = centres.mean(axis=0)
    best = min(recent, key=lambda sighting: sighting.twins_std)
    if len(recent) > 1:
        _, lengths, ways = np.linalg.svd(centres - middle)
        typical = float(np.median([sighting.centre_std for sighting in recent]))
        line_std = typical / max(float(lengths[0]), 1e-12)
        if line_std < best.twins_std:
            return middle, ways[:1], line_std
    return best.centre, best.twins, best.twins_std
