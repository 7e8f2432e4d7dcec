"""Rough identification: the arc that belongs to each candidate (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and asks whether all r_j
lie below the sensor error. Here the windows start at a candidate and walk outwards from it, the
ellipse fitted anew after each step, until points beyond the sensor error follow one another;
single lost lines and jumps inside do not end an arc.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.detection.arc_growing import ArcNeighbourhood, IdentificationSettings, grow_arc
from lsvision.detection.candidates import Candidate, seed_ellipse
from lsvision.ellipse.parameters import ellipse_from_parameters, parameters_from_ellipse
from lsvision.profile import Arc, PreparedProfile
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
    profile: PreparedProfile,
    candidate: Candidate,
    free: IntArray,
    settings: IdentificationSettings = IdentificationSettings(),
) -> IdentifiedArc | None:
    """Grow a candidate to the whole arc around it.

    Parameters
    ----------
    profile : PreparedProfile
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
    if len(inside) < settings.min_points:
        return None
    around = ArcNeighbourhood(
        profile.noisy_points[free],
        profile.max_noise_factor(candidate.radius),
        candidate.radius,
    )
    grown = grow_arc(
        around, inside, parameters_from_ellipse(seed_ellipse(profile, candidate)), settings
    )
    if grown is None:
        return None
    indices, parameters = free[grown[0]], grown[1]
    return IdentifiedArc(
        Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse_from_parameters(parameters)
    )
