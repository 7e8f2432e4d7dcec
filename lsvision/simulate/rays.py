"""Rays in space and what they meet."""

import math
from dataclasses import dataclass

from lsvision.geometry import FloatArray, Points, Pose, as_readonly_array

NO_HIT = math.inf
"""Distance of a ray that meets nothing."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays in space.

    Parameters
    ----------
    origins : (n, 3) array_like
        Units: mm.
    directions : (n, 3) array_like
        Of any length; a distance along the ray counts in multiples of it.
    """

    origins: Points
    directions: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "origins", as_readonly_array(self.origins, ("n", 3), "origins"))
        shape = self.origins.shape
        object.__setattr__(
            self, "directions", as_readonly_array(self.directions, shape, "directions")
        )

    def seen_from(self, a_from_b: Pose) -> "Rays":
        """The same rays of frame b in the coordinates of frame a."""
        return Rays(a_from_b.apply(self.origins), self.directions @ a_from_b.rotation.T)


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays first meet a surface.

    Parameters
    ----------
    distances : (n,) ndarray
        Along each ray, in lengths of its direction; `NO_HIT` where it meets nothing.
    normals : (n, 3) ndarray
        Unit normals towards the ray's origin; anything where nothing is met.
    """

    distances: FloatArray
    normals: FloatArray
