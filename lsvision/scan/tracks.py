"""Associate the arcs of different sections: a track contains the arcs of one cylinder.

Sections are processed in order. Each track predicts where the next section cuts its cylinder:
along the line through its arc centres, or along both twins while the centres are too close
together to determine a direction. Solid cylinders do not penetrate each other, so a gate of a third
of the radius separates even welded neighbours and still admits a bent cylinder.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray, Pose
from lsvision.statistics.robust import median

DIRECTION_SIGMAS = 2.0
"""Number of standard deviations taken as the uncertainty of a predicted direction."""
MIN_LENGTH_MM = 1e-12
"""Smallest length of a line through centres as a divisor: coinciding centres have no direction.
Units: mm."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TrackSettings:
    """Gates for the association of arcs across sections.

    Parameters
    ----------
    gate, max_gate : float
        Largest distance of an arc centre from the predicted axis, without and with the
        uncertainty of both added. Units: radii.
    radius_gate : float
        Largest difference of the radii beyond their uncertainty. Units: radii.
    sigmas : float
        Number of standard deviations taken as the uncertainty of centres and radii; that of the
        predicted direction is `DIRECTION_SIGMAS`.
    window : int
        Number of the most recent arcs used for the prediction.

    Notes
    -----
    Measured on 400 simulated scans of 657 pipes. Of 60 bent ones (bend of 0.3 to 5 m over 150 mm)
    54 yield a cylinder whose radius is right within 5 %, 5 of them in two parts. A larger gate or a
    smaller window follows the bend, to a cylinder of a wrong radius: with a `gate` of 0.42 51 are
    right, with a `window` of 7 50; with a `gate` of 0.21 56 are, 7 of them in two parts. With a
    `max_gate` of 0.42 4 pipes in three or four sections 30 mm apart are lost; without it none more
    is found. `sigmas` of 2.8 and 5.6 change one pipe. A `radius_gate` from 0.03 to none changes
    nothing there; it divides pipes of one axis whose radius changes in a step: of both parts of 8
    such pipes 13 of 16 are found at a step of 15 % and 8 at 10 %; with 0.084 16 and 10, with 0.168
    8 and 8.
    """

    gate: float = 0.3
    max_gate: float = 0.6
    radius_gate: float = 0.12
    sigmas: float = 4.0
    window: int = 10

    def __post_init__(self) -> None:
        if self.window < 1:
            raise ValueError(f"expected a window of at least one arc, got {self.window}")


@dataclass(frozen=True, eq=False, slots=True)
class ArcObservation:
    """One arc of one section, in the base frame.

    Parameters
    ----------
    section : int
        Index of the profile.
    arc : CylinderSection
        The measured arc, section frame.
    centre : (3,) ndarray
        Centre of the ellipse, base frame. Units: mm.
    centre_std : float
        Root mean square error of the centre, both coordinates together. Units: mm.
    radius_std : float
        Standard uncertainty of the radius. Units: mm.
    twins : (2, 3) ndarray
        Unit vectors along both possible axes, base frame.
    twins_std : float
        Root mean square angle between the true axis and the twin next to it. Units: rad.
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
        """Radius of the cylinder. Units: mm."""
        return self.arc.radius


Track = tuple[ArcObservation, ...]
"""Arcs of one cylinder in different sections, in the order of the sections."""


def transform_arc_to_base(section: int, arc: CylinderSection, pose: Pose) -> ArcObservation:
    """Return the arc of a profile with its centre and both possible axes in the base frame."""
    covariance = arc.covariance
    return ArcObservation(
        section=section,
        arc=arc,
        centre=pose.apply_one([*arc.centre, 0.0]),
        centre_std=math.sqrt(covariance[0, 0] + covariance[1, 1]),
        radius_std=math.sqrt(covariance[3, 3]),
        twins=arc.axis_twins @ pose.rotation.T,
        twins_std=math.hypot(arc.phi_std, math.sin(arc.phi) * arc.theta_std),
    )


def associate_arcs(
    observations: Sequence[ArcObservation], settings: TrackSettings
) -> tuple[Track, ...]:
    """Return the tracks: arcs of different sections, grouped by cylinder.

    The arcs may be in any order. A track has at most one arc of each section; tracks are in the
    order of their first arcs. A cylinder with two arcs in one section yields two tracks here; the
    joint fit unites them.
    """
    tracks: list[list[ArcObservation]] = []
    for section in sorted({observation.section for observation in observations}):
        arcs = [observation for observation in observations if observation.section == section]
        predictions = [_predict(track[-settings.window :]) for track in tracks]
        candidates = sorted(
            (distance, track_index, arc_index)
            for track_index, prediction in enumerate(predictions)
            for arc_index, arc in enumerate(arcs)
            if (distance := _compute_gate_ratio(prediction, arc, settings)) < 1
        )
        extended_tracks: set[int] = set()
        assigned_arcs: set[int] = set()
        for _, track_index, arc_index in candidates:
            if track_index not in extended_tracks and arc_index not in assigned_arcs:
                tracks[track_index].append(arcs[arc_index])
                extended_tracks.add(track_index)
                assigned_arcs.add(arc_index)
        tracks.extend([arc] for index, arc in enumerate(arcs) if index not in assigned_arcs)
    return tuple(tuple(track) for track in tracks)


@dataclass(frozen=True, eq=False, slots=True)
class _Prediction:
    """Radius (mm) of a cylinder from the last arcs of its track, and its axis.

    A point (3,) of the axis in mm; the direction of the line through the centres (1, 3), or both
    twins of one arc (2, 3) if their standard uncertainty is smaller; that uncertainty in rad.
    """

    radius: float
    radius_std: float
    point: FloatArray
    directions: FloatArray
    direction_std: float


def _predict(recent: Sequence[ArcObservation]) -> _Prediction:
    """Predict radius and axis of a cylinder from the most recent arcs of its track."""
    radius = median(np.array([observation.radius for observation in recent]))
    radius_std = min(observation.radius_std for observation in recent)
    centres = np.array([observation.centre for observation in recent])
    mean_centre = centres.mean(axis=0)
    best = min(recent, key=lambda observation: observation.twins_std)
    if len(recent) > 1:
        _, lengths, directions = np.linalg.svd(centres - mean_centre, full_matrices=False)
        centre_std = median(np.array([observation.centre_std for observation in recent]))
        line_std = centre_std / max(float(lengths[0]), MIN_LENGTH_MM)
        if line_std < best.twins_std:
            return _Prediction(radius, radius_std, mean_centre, directions[:1], line_std)
    return _Prediction(radius, radius_std, best.centre, best.twins, best.twins_std)


def _compute_gate_ratio(
    prediction: _Prediction, arc: ArcObservation, settings: TrackSettings
) -> float:
    """Return the distance of an arc's centre from the predicted axis, divided by the gate."""
    radius, directions = prediction.radius, prediction.directions
    radius_uncertainty = settings.sigmas * math.hypot(prediction.radius_std, arc.radius_std)
    if abs(arc.radius - radius) > radius_uncertainty + settings.radius_gate * radius:
        return math.inf
    offset = arc.centre - prediction.point
    distances = np.linalg.norm(offset - (directions @ offset)[:, None] * directions, axis=1)
    direction_uncertainty = (
        DIRECTION_SIGMAS * prediction.direction_std * float(np.linalg.norm(offset))
    )
    uncertainty = settings.sigmas * arc.centre_std + direction_uncertainty
    gate = min(settings.gate * radius + uncertainty, settings.max_gate * radius)
    return float(distances.min()) / gate
