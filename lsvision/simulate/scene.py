"""Scene of a simulation: tubes, and other objects as clutter.

Frame: the base frame; for a single section that is the section frame (X along the laser line, Y
towards the sensor, Z the laser plane's normal). Objects are opaque and do not reflect. Objects are
intersected with rays in space, so that sections at any pose, ends of tubes and shadows towards a
camera outside the laser plane need no further code.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lsvision.geometry import Cylinder, IntArray, Pose
from lsvision.simulate.solids import Hits, Rays

CLUTTER = 0
"""Label of objects that are no tubes; the k-th tube of a scene has label k >= 1."""
NOTHING = -1
"""Label of a column without a valid point: lost, or displaced by a jump."""


@runtime_checkable
class Solid(Protocol):
    """Object of a scene."""

    def first_hits(self, rays: Rays) -> Hits:
        """Return where each ray first meets the solid."""
        ...


@runtime_checkable
class TubeSolid(Solid, Protocol):
    """Solid that is a tube: it should be measured, and has a truth in every section."""

    def local_cylinder(self, base_from_section: Pose) -> Cylinder | None:
        """Return the cylinder, base frame, along the tube's axis where the section cuts it."""
        ...


@dataclass(frozen=True)
class Scene:
    """Objects in the base frame.

    Parameters
    ----------
    objects : tuple of Solid
        Tubes are numbered 1, 2, ... in this order.

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
            raise ValueError("expected at least one object in a scene, got none")

    @property
    def tubes(self) -> tuple[TubeSolid, ...]:
        """Tubes, in the order of their labels."""
        return tuple(solid for solid in self.objects if isinstance(solid, TubeSolid))

    @property
    def labels(self) -> IntArray:
        """Label of each object: `CLUTTER`, or the number of the tube."""
        is_tube = np.array([isinstance(solid, TubeSolid) for solid in self.objects])
        return np.where(is_tube, np.cumsum(is_tube), CLUTTER).astype(np.int64)

    def first_hits(self, rays: Rays) -> tuple[Hits, IntArray]:
        """Return where each ray first meets an object, and the label of that object.

        Returns
        -------
        hits : Hits
            Nearest intersections of all objects.
        labels : (n,) ndarray
            `NOTHING` where the ray meets nothing.
        """
        hits = [solid.first_hits(rays) for solid in self.objects]
        distances = np.stack([hit.distances for hit in hits])
        nearest = distances.argmin(axis=0)
        ray = np.arange(distances.shape[1])
        normals = np.stack([hit.normals for hit in hits])[nearest, ray]
        first = distances[nearest, ray]
        labels = np.where(np.isfinite(first), self.labels[nearest], NOTHING)
        return Hits(first, normals), labels.astype(np.int64)
