"""One pipe, one cylinder: where both halves of an arc reached all of it, the larger stays."""

from collections.abc import Sequence
from typing import TypeVar

from lsvision.detection.rejections import HasIndices

MAX_OVERLAP = 0.3
"""A cylinder with a larger share of its points in another is the same one."""

Detection = TypeVar("Detection", bound=HasIndices)


def suppress_overlapping(cylinders: Sequence[Detection]) -> list[Detection]:
    """Those that are no part of a cylinder with more points.

    Parameters
    ----------
    cylinders : sequence
        What was found, in any order.

    Returns
    -------
    list
        By falling number of points.
    """
    taken: set[int] = set()
    whole: list[Detection] = []
    for cylinder in sorted(cylinders, key=lambda cylinder: -len(cylinder.indices)):
        own = set(cylinder.indices.tolist())
        if len(own & taken) <= MAX_OVERLAP * len(own):
            whole.append(cylinder)
            taken |= own
    return whole
