"""Rejected arcs as they are drawn: each has a letter, by which the panel lists its reason."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import IntArray, Points
from lsvision.measure import Measurement
from lsvision.results.palette import REJECTED


@dataclass(frozen=True, eq=False, slots=True)
class RejectedArc:
    """A rejected arc in a picture.

    Parameters
    ----------
    letter : str
        Label in the picture: A to Z, then A1 to Z1, and so on.
    indices : (k,) int ndarray
        Valid points of the arc that belong to no cylinder; at least one.
    reason : str
        Reason of the rejection.
    colour : str
        Colour in the picture, for matplotlib.
    """

    letter: str
    indices: IntArray
    reason: str
    colour: str


def rejected_arcs(points: Points, measurement: Measurement) -> tuple[RejectedArc, ...]:
    """Return the rejected arcs in the order of the profile; of several with one span the first.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of the profile. Units: mm.
    measurement : Measurement
        Cylinders and rejections. A rejection whose points all belong to cylinders is omitted.
    """
    unassigned = np.isfinite(points[:, 0])
    for cylinder in measurement.cylinders:
        unassigned[cylinder.indices] = False
    reasons: dict[tuple[int, int], str] = {}
    for rejection in measurement.rejections:
        reasons.setdefault((rejection.arc.start, rejection.arc.stop), rejection.reason)
    arcs: list[RejectedArc] = []
    for (start, stop), reason in sorted(reasons.items()):
        indices = start + np.flatnonzero(unassigned[start:stop])
        if len(indices):
            colour = REJECTED[len(arcs) % len(REJECTED)]
            arcs.append(RejectedArc(_letter(len(arcs)), indices, reason, colour))
    return tuple(arcs)


def _letter(number: int) -> str:
    """Return A to Z for 0 to 25, then A1 to Z1, A2 to Z2, ..."""
    suffix, letter = divmod(number, 26)
    return chr(ord("A") + letter) + (str(suffix) if suffix else "")
