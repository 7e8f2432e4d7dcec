"""One pipe, one cylinder: where both halves of an arc reached all of it, the larger stays."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from lsvision.recognition.leftovers import Accepted

LARGEST_PART = 0.3
"""A cylinder with a larger share of its points in another is the same one."""

Found = TypeVar("Found", bound=Accepted)


def without_parts(cylinders: Sequence[Found]) -> list[Found]:
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
    taken = np.empty(0, dtype=np.int64)
    whole: list[Found] = []
    for cylinder in sorted(cylinders, key=lambda cylinder: -len(cylinder.indices)):
        if np.isin(cylinder.indices, taken).sum() <= LARGEST_PART * len(cylinder.indices):
            whole.append(cylinder)
            taken = np.concatenate([taken, cylinder.indices])
    return whole
