"""Surfaces of scanned cylinders as triangles, to look at."""

import numpy as np

from lsvision.geometry import IntArray, Points
from lsvision.scan.scan_result import ScannedCylinder

FACETS = 96
"""Round the tube; the flats stay within r / 1900 of it."""


def tube_surface(tube: ScannedCylinder, facets: int = FACETS) -> tuple[Points, IntArray]:
    """Open tube over the stretch that was seen.

    Parameters
    ----------
    tube : ScannedCylinder
        The cylinder and its ends.
    facets : int
        Number of flats round it.

    Returns
    -------
    points : (2 * facets, 3) ndarray
        The ring at the first end, then that at the second; base frame. Units: mm.
    triangles : (2 * facets, 3) ndarray of int
        Rows of `points`, counter-clockwise seen from outside.
    """
    first, second = tube.fit.tangent_basis
    turns = np.linspace(0.0, 2 * np.pi, facets, endpoint=False)
    ring = tube.radius * (np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second))
    rings = [tube.point + end * tube.direction + ring for end in tube.axial_range]
    here = np.arange(facets)
    onward = (here + 1) % facets
    lower = np.column_stack([here, onward, onward + facets])
    upper = np.column_stack([here, onward + facets, here + facets])
    return np.concatenate(rings), np.concatenate([lower, upper])
