"""The refused arcs as a picture shows them: a letter each, keyed to its reason."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import IntArray, Points
from lsvision.measure import Measurement

COLOURS = ("#D55E00", "#9A6A00")
"""Vermilion and dark yellow: unlike all colours of cylinders, also to the colour-blind;
neighbours take turns."""


@dataclass(frozen=True, eq=False, slots=True)
class RejectedArc:
    """A refused arc in a picture.

    Parameters
    ----------
    letter : str
        Its name in the picture.
    indices : (k,) int ndarray
        Its points that are there and belong to no cylinder; never empty.
    reason : str
        Why it is no cylinder.
    colour : str
        As matplotlib takes it.
    """

    letter: str
    indices: IntArray
    reason: str
    colour: str


def rejected_arcs(points: Points, measurement: Measurement) -> tuple[RejectedArc, ...]:
    """Refused arcs from left to right, each span once.

    Parameters
    ----------
    points : (n, 2) ndarray
        Of the profile. Units: mm.
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
            colour = COLOURS[len(arcs) % len(COLOURS)]
            arcs.append(RejectedArc(_letter(len(arcs)), own, reason, colour))
    return tuple(arcs)


def _letter(place: int) -> str:
    """A to Z, then A1 to Z1."""
    turn, letter = divmod(place, 26)
    return chr(ord("A") + letter) + (str(turn) if turn else "")
