"""Scenes that a light section cuts: solid tubes, and prisms for all that is no tube.

Frame: the base frame; for a single section that is the section frame itself (X along the laser
line, Y towards the sensor, Z the laser plane's normal). Assumptions: tubes are solid (what lies
inside is never seen), a prism's outline is seen from both sides, nothing reflects or shines
through. Every intersection is in closed form with rays in space, so that a section at any pose,
an end of a tube and a shadow towards a camera outside the plane need no further code.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lsvision.geometry import Cylinder, IntArray, Pose
from lsvision.simulate.rays import Hits, Rays

CLUTTER = 0
"""Label of what is no tube; the k-th tube of a scene has label k >= 1."""
NOTHING = -1
"""Label of a column that carries no surface: lost, or displaced by a jump."""


@runtime_checkable
class Solid(Protocol):
    """What a scene is made of."""

    def first_hits(self, rays: Rays) -> Hits:
        """Where each ray first meets the solid."""
        ...


@runtime_checkable
class TubeSolid(Solid, Protocol):
    """A solid that counts as a tube: it is to be found, and has a truth in every section."""

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """Cylinder, in the base frame, that touches the tube where the section cuts its axis."""
        ...


@dataclass(frozen=True)
class Scene:
    """Solids in the base frame.

    Parameters
    ----------
    objects : tuple of Solid
        Tubes are numbered 1, 2, ... in the order in which they stand here.

    Examples
    --------
    >>> from lsvision.simulate import Prism, Tube
    >>> tube = Tube.of(radius=10.0, theta=0.0, phi=0.0, centre=(0.0, -400.0))
    >>> floor = Prism([[-100.0, -410.0], [100.0, -410.0]])
    >>> Scene((floor, tube)).labels
    array([0, 1])
    """

    objects: tuple[Solid, ...]

    def __post_init__(self) -> None:
        if not self.objects:
            raise ValueError("want one object or more in a scene, got none")

    @property
    def tubes(self) -> tuple[TubeSolid, ...]:
        """The tubes, in the order of their labels."""
        return tuple(solid for solid in self.objects if isinstance(solid, TubeSolid))

    @property
    def labels(self) -> IntArray:
        """Label of each object: `CLUTTER`, or the number of the tube."""
        is_tube = np.array([isinstance(solid, TubeSolid) for solid in self.objects])
        return np.where(is_tube, np.cumsum(is_tube), CLUTTER).astype(np.int64)

    def first_hits(self, rays: Rays) -> tuple[Hits, IntArray]:
        """Where each ray first meets anything, and the label of what it meets.

        Returns
        -------
        hits : Hits
            Nearest over all objects.
        labels : (n,) ndarray
            `NOTHING` where the ray meets nothing.
        """
        every = [solid.first_hits(rays) for solid in self.objects]
        distances = np.stack([hits.distances for hits in every])
        nearest = distances.argmin(axis=0)
        column = np.arange(distances.shape[1])
        normals = np.stack([hits.normals for hits in every])[nearest, column]
        first = distances[nearest, column]
        labels = np.where(np.isfinite(first), self.labels[nearest], NOTHING)
        return Hits(first, normals), labels.astype(np.int64)
