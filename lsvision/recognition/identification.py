"""Rough identification: the arc that belongs to each candidate (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and asks whether all r_j
lie below the sensor error. Here the windows start at a candidate and walk outwards from it, the
ellipse fitted anew after each step, until points beyond the sensor error follow one another;
single lost lines and jumps inside do not end an arc.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.fitting.ellipse_parameters import ellipse_of, parameters_of
from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.candidates import Candidate, seed_ellipse
from lsvision.recognition.growing import IdentificationSettings, WeighedSpan, grow_arc
from lsvision.shapes import Ellipse, IntArray


@dataclass(frozen=True, eq=False, slots=True)
class IdentifiedArc:
    """An arc, the points on it, and the ellipse that holds them together.

    Parameters
    ----------
    arc : Arc
        The span.
    indices : (k,) int ndarray
        The points of the span that lie on the ellipse; jumps and lost ones are missing.
    ellipse : Ellipse
        Units: mm, rad.
    """

    arc: Arc
    indices: IntArray
    ellipse: Ellipse


def identify_arc(
    profile: WeighedProfile,
    candidate: Candidate,
    free: IntArray,
    settings: IdentificationSettings = IdentificationSettings(),
) -> IdentifiedArc | None:
    """Grow a candidate to the whole arc around it.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    candidate : Candidate
        Where to begin.
    free : (k,) int ndarray
        Indices of the points that may belong to it, ordered.
    settings : IdentificationSettings
        Sensor error and steps.

    Returns
    -------
    IdentifiedArc or None
        None where the growth breaks down: the points around the seed are no ellipse.
    """
    seeded = np.zeros(len(profile.points), dtype=bool)
    seeded[candidate.indices] = True
    inside = seeded[free].nonzero()[0]
    if len(inside) < settings.fewest_points:
        return None
    around = WeighedSpan(
        profile.noisy[free],
        profile.largest_misfit(candidate.radius),
        candidate.radius,
    )
    grown = grow_arc(around, inside, parameters_of(seed_ellipse(profile, candidate)), settings)
    if grown is None:
        return None
    indices, parameters = free[grown[0]], grown[1]
    return IdentifiedArc(
        Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse_of(parameters)
    )
