"""The extruded outline: all that is no tube."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Points, as_readonly_array
from lsvision.simulate.rays import NO_HIT, Hits, Rays


@dataclass(frozen=True, eq=False)
class Prism:
    """Outline drawn in the plane z = 0 and extruded without end.

    Parameters
    ----------
    outline : (k, 2) array_like
        Corners of a line of straight pieces; repeat the first corner to close it. Units: mm.
    along : tuple of float
        Direction of extrusion; (0, 0, 1) by default. Must cross the plane z = 0.

    Examples
    --------
    >>> plate = Prism([[-50.0, -400.0], [50.0, -400.0]])
    >>> down = Rays([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]], [[0.0, -1.0, 0.0]] * 2)
    >>> plate.first_hits(down).distances
    array([400.,  inf])
    """

    outline: Points
    along: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", as_readonly_array(self.outline, ("n", 2), "outline"))
        if len(self.outline) < 2 or not np.isfinite(self.outline).all():
            raise ValueError(f"want two finite corners or more, got {self.outline.tolist()}")
        if abs(self.along[2]) < 1e-6 * math.hypot(*self.along):
            raise ValueError(f"want an extrusion that crosses z = 0, got {self.along}")

    def first_hits(self, rays: Rays) -> Hits:
        """Where each ray first meets the outline's surface, from either side."""
        # Seen along the extrusion the prism is its outline and a ray stays a straight line.
        shear = np.array([self.along[0], self.along[1]]) / self.along[2]
        start = rays.origins[:, :2] - rays.origins[:, 2:] * shear
        ray = rays.directions[:, :2] - rays.directions[:, 2:] * shear
        distances, pieces = _first_piece(start, ray, self.outline)
        dx, dy = np.diff(self.outline, axis=0)[pieces].T
        # Gradient of the side function along the sheared plane, hence the third component.
        normals = np.column_stack([-dy, dx, dy * shear[0] - dx * shear[1]])
        length = np.linalg.norm(normals, axis=1)
        normals /= np.where(length > 0, length, 1.0)[:, None]
        turned = np.einsum("ij,ij->i", normals, rays.directions) > 0
        normals[turned] *= -1
        return Hits(distances, normals)


def _first_piece(start: Points, ray: FloatArray, outline: Points) -> tuple[FloatArray, IntArray]:
    """Distance along each ray to the outline, and the straight piece that it meets."""
    piece = np.diff(outline, axis=0)
    across = ray[:, 0, None] * piece[:, 1] - ray[:, 1, None] * piece[:, 0]
    safe = np.where(across == 0, 1.0, across)
    to_x = outline[:-1, 0] - start[:, 0, None]
    to_y = outline[:-1, 1] - start[:, 1, None]
    distance = (to_x * piece[:, 1] - to_y * piece[:, 0]) / safe
    share = (to_x * ray[:, 1, None] - to_y * ray[:, 0, None]) / safe
    met = (across != 0) & (share >= 0) & (share <= 1) & (distance > 0)
    distances = np.where(met, distance, NO_HIT)
    pieces = distances.argmin(axis=1)
    return distances[np.arange(len(start)), pieces], pieces.astype(np.int64)
