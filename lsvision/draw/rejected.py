"""Refused arcs of a picture: each has a letter, which the panel explains."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import IntArray, Points
from lsvision.measure import Measurement
from lsvision.results.palette import REJECTED


@dataclass(frozen=True, eq=False, slots=True)
class RejectedArc:
    """A refused arc in a picture.

    Parameters
    ----------
    letter : str
        Label in the picture.
    indices : (k,) int ndarray
        Its points that are there and belong to no cylinder; never empty.
    reason : str
        Reason of the rejection.
    colour : str
        As matplotlib takes it.
    """

    letter: str
    indices: IntArray
    reason: str
    colour: str


def rejected_arcs(points: Points, measurement: Measurement) -> tuple[RejectedArc, ...]:
    """Return the refused arcs from left to right, each span once.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of the profile. Units: mm.
    measurement : Measurement
        Its cylinders and rejections. A rejection whose points all went to cylinders in the end
        says nothing about the picture and is left out.
    """
    free = np.isfinite(points[:, 0])
    for cylinder in measurement.cylinders:
        free[cylinder.indices] = False
    reasons: dict[tuple[int, int], str] = {}
    for rejection in measurement.rejections:
        reasons.setdefault((rejection.arc.start, rejection.arc.stop), rejection.reason)
    arcs: list[RejectedArc] = []
    for (start, stop), reason in sorted(reasons.items()):
        own = start + np.flatnonzero(free[start:stop])
        if len(own):
            colour = REJECTED[len(arcs) % len(REJECTED)]
            arcs.append(RejectedArc(_letter(len(arcs)), own, reason, colour))
    return tuple(arcs)


def _letter(place: int) -> str:
    """Return A to Z, then A1 to Z1."""
    turn, letter = divmod(place, 26)
    return chr(ord("A") + letter) + (str(turn) if turn else "")
