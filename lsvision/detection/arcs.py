"""What detection passes from step to step: an arc with its points and ellipse, or a rejection."""

from dataclasses import dataclass
from typing import Self

from lsvision.geometry import Ellipse, IntArray
from lsvision.profile import Arc


@dataclass(frozen=True, eq=False, slots=True)
class IdentifiedArc:
    """An arc, the points on it, and their ellipse.

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

    @classmethod
    def of(cls, indices: IntArray, ellipse: Ellipse) -> Self:
        """The arc from the first to the last of rising indices."""
        return cls(Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse)


@dataclass(frozen=True, slots=True)
class Rejection:
    """An arc that is no cylinder, and why.

    Parameters
    ----------
    arc : Arc
        The span.
    reason : str
        In words and numbers.
    """

    arc: Arc
    reason: str
