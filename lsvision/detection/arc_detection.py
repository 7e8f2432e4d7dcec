"""All arcs of a profile: each candidate grown, judged, and its points taken."""

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, Rejection, rejection_reason
from lsvision.detection.arc_growing import IdentificationSettings
from lsvision.detection.candidates import Candidate
from lsvision.detection.identification import IdentifiedArc, identify_arc
from lsvision.profile import PreparedProfile
from lsvision.shapes import FloatArray

UNSCREENED_NOISE_FACTOR = 2.0
"""An arc still has its neighbours' first points at its ends, and may scatter so much more."""
MAX_ASSIGNED_FRACTION = 0.3
"""A candidate with a larger share of points in an arc already found is that arc's."""
MAX_FAILURES = 2
"""Points that so many failed arcs held seed no other."""


def identify_arcs(
    profile: PreparedProfile,
    candidates: list[Candidate],
    radius_range: tuple[float, float],
    settings: IdentificationSettings = IdentificationSettings(),
    verdict: AcceptanceSettings = AcceptanceSettings(),
) -> tuple[list[IdentifiedArc], list[Rejection]]:
    """Grow candidates to arcs, the most telling first; each point belongs to one arc.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    candidates : list of Candidate
        In the order of trying.
    radius_range : tuple of float
        Units: mm.
    settings : IdentificationSettings
        Growth.
    verdict : AcceptanceSettings
        What an arc must be.

    Returns
    -------
    arcs : list of IdentifiedArc
        Unscreened.
    rejections : list of Rejection
        Arcs that grew, and are no cylinder.
    """
    taken = np.zeros(len(profile.points), dtype=bool)
    failures: FloatArray = np.zeros(len(profile.points))
    arcs: list[IdentifiedArc] = []
    rejections: list[Rejection] = []
    free = profile.valid_indices
    for candidate in candidates:
        span = candidate.indices
        most_taken, most_failures = MAX_ASSIGNED_FRACTION * len(span), MAX_FAILURES * len(span)
        if taken[span].sum() > most_taken or failures[span].sum() >= most_failures:
            continue
        arc = identify_arc(profile, candidate, free, settings)
        if arc is None:
            failures[span] += 1
            continue
        reason = rejection_reason(
            profile, arc, radius_range, verdict, noise_factor_scale=UNSCREENED_NOISE_FACTOR
        )
        if reason is not None:
            rejections.append(Rejection(arc.arc, reason))
            failures[span] += 1
            failures[arc.indices] += 1
            continue
        arcs.append(arc)
        taken[arc.arc.start : arc.arc.stop] = True
        free = free[~taken[free]]
    return arcs, rejections
