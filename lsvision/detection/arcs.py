"""Results of the detection steps: an identified arc with its ellipse, or a rejection."""

from dataclasses import dataclass
from typing import Self

from lsvision.geometry import Ellipse, IntArray
from lsvision.profile import Arc
from lsvision.results.quantities import Record
from lsvision.results.result import Result

MAX_OVERLAP = 0.5
"""Largest intersection over union of two windows, and largest fraction of the points of a
candidate, rejection or section that may lie in arcs before it; beyond it, it is left out."""
MIN_POINTS = 8
"""Smallest number of points to which an ellipse is fitted: three more than its parameters."""


@dataclass(frozen=True, eq=False, slots=True)
class IdentifiedArc:
    """Arc with the ascending indices of its inliers, and their ellipse in mm and rad."""

    arc: Arc
    indices: IntArray
    ellipse: Ellipse

    @classmethod
    def of(cls, indices: IntArray, ellipse: Ellipse) -> Self:
        """Return the arc from the first to the last of ascending indices."""
        return cls(Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse)


@dataclass(frozen=True, eq=False, repr=False)
class Rejection(Result):
    """Arc that is not accepted as a cylinder, with the reason.

    Parameters
    ----------
    arc : Arc
        Index span of the profile.
    reason : str
        What is wrong, with the measured value and its limit.
    convex : bool
        True where the points bend as those of a cylinder do: towards the sensor, and better fitted
        by a circle than by a straight line.

    Examples
    --------
    >>> Rejection(Arc(412, 447), "radius not determinable: 12 to 698 mm")
    <Rejection: points 412 to 446: radius not determinable: 12 to 698 mm>
    """

    arc: Arc
    reason: str
    convex: bool = True

    def to_dict(self) -> Record:
        """Return span and reason, ready for JSON.

        Returns
        -------
        dict
            ``start``, ``stop`` (half open) and ``reason``.

        Examples
        --------
        >>> Rejection(Arc(4, 9), "too short").to_dict()
        {'start': 4, 'stop': 9, 'reason': 'too short'}
        """
        return {"start": self.arc.start, "stop": self.arc.stop, "reason": self.reason}

    def _summary(self) -> str:
        return f"points {self.arc.start} to {self.arc.stop - 1}: {self.reason}"

    def _cells(self) -> list[tuple[str, ...]]:
        return []

    def _notes(self) -> list[str]:
        return [self._summary()]
