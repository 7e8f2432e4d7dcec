"""Results of the detection steps: an identified or a screened arc, or a rejection."""

from dataclasses import dataclass
from typing import NamedTuple

from lsvision.geometry import Ellipse, IntArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import Arc
from lsvision.results.quantities import Record
from lsvision.results.result import Result

MAX_OVERLAP = 0.5
"""Largest intersection over union of two windows, and largest fraction of the points of a
candidate, rejection or section that may lie in arcs accepted before; with a larger overlap the
later one is left out."""
MIN_POINTS = 8
"""Smallest number of points to which an ellipse is fitted: three more than its parameters."""
INTERRUPTING_RUN = 3
"""Smallest number of consecutive points beyond the sensor error that interrupt an arc: one more
than `MAX_ADJACENT_JUMPS` of a range image. With 2 or 4 the same pipes of 1345 are found."""
MIN_NORMAL_Y = -0.5
"""Smallest y, -sin(30 deg), of the outward unit normals that a sensor with a fan of +/- 30 deg can
see."""


def arc_from_indices(indices: IntArray) -> Arc:
    """Return the span from the first to the last of one or more ascending indices."""
    return Arc(int(indices[0]), int(indices[-1]) + 1)


class IdentifiedArc(NamedTuple):
    """Arc found by rough identification, before screening.

    Parameters
    ----------
    indices : (n,) int ndarray
        Ascending indices of the inliers in the prepared profile, at least one.
    ellipse : Ellipse
        Ellipse of the inliers. Units: mm, rad.
    """

    indices: IntArray
    ellipse: Ellipse

    @property
    def arc(self) -> Arc:
        """Span from the first to the last inlier."""
        return arc_from_indices(self.indices)


class ScreenedArc(NamedTuple):
    """Arc after accurate screening of its ends.

    Parameters
    ----------
    indices : (n,) int ndarray
        Ascending indices of the inliers in the prepared profile.
    points : NoisyPoints
        The inliers (n,). Their noise is that of a sensor that smooths along the line if
        neighbouring errors are correlated.
    ellipse : Ellipse
        Ellipse of the inliers. Units: mm, rad.
    variance_factor : float
        Ratio of the variance of the residuals to that of the noise of `points`.
    mixed_points : int
        Number of points near an edge in which a sensor that smooths along the line mixes the
        surfaces on both sides of the edge.
    """

    indices: IntArray
    points: NoisyPoints
    ellipse: Ellipse
    variance_factor: float
    mixed_points: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class Rejection(Result):
    """Arc that is not accepted as a cylinder, with the reason.

    Parameters
    ----------
    arc : Arc
        Index span of the profile.
    reason : str
        Why the arc is not accepted, with the measured value and its limit.
    convex : bool
        Whether the points are curved as those of a cylinder: convex towards the sensor, and better
        fitted by a circle than by a straight line.

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

    def _summarise(self) -> str:
        return f"points {self.arc.start} to {self.arc.stop - 1}: {self.reason}"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return []

    def _list_notes(self) -> list[str]:
        return [self._summarise()]
