"""Scene of a simulation (tubes, and other objects as clutter), and its truth in a section.

Frame: the base frame; for a single section that is the section frame (X along the laser line, Y
towards the sensor, Z the laser plane's normal). Objects are opaque and do not reflect. Objects are
intersected with rays in space, so that sections at any pose, ends of tubes and shadows towards a
camera outside the laser plane need no further code.
"""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lsvision.geometry import Cylinder, Ellipse, FloatArray, IntArray, Points, Pose
from lsvision.geometry.ellipse import WithEllipse
from lsvision.simulate.solids import Hits, Rays

CLUTTER = 0
"""Label of objects that are not tubes; the k-th tube of a scene has label k >= 1."""
NOTHING = -1
"""Label of a column without a valid point: lost, or displaced by a jump."""
MAX_COLUMN_STEP = 8
"""Largest step between consecutive points of an uninterrupted arc, over lost columns or jumps in
between. Units: columns."""
MIN_VISIBLE_ARC = math.radians(60.0)
"""Smallest angle about the axis of an uninterrupted arc of a visible tube. Units: rad."""
MIN_VISIBLE_POINTS = 15
"""Smallest number of points on that arc."""


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
        Solids; tubes are numbered 1, 2, ... in this order.

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
        """Return where each ray first meets an object, and the label (n,) of that object.

        The label is `NOTHING` for a ray that meets none.
        """
        hits = [solid.first_hits(rays) for solid in self.objects]
        distances = np.stack([hit.distances for hit in hits])
        nearest = distances.argmin(axis=0)
        ray = np.arange(distances.shape[1])
        normals = np.stack([hit.normals for hit in hits])[nearest, ray]
        nearest_distances = distances[nearest, ray]
        labels = np.where(np.isfinite(nearest_distances), self.labels[nearest], NOTHING)
        return Hits(nearest_distances, normals), labels.astype(np.int64)


@dataclass(frozen=True, eq=False)
class TubeTruth(WithEllipse):
    """True parameters of a tube in one section.

    Parameters
    ----------
    label : int
        Number of the tube in the scene, from 1; the label of its points.
    cylinder : Cylinder
        Cylinder in the section frame; for a bent tube, along the tangent of its axis.
    ellipse : Ellipse
        Section of the cylinder.
    points : int
        Number of points with the label.
    arc_points : int
        Number of points on the longest uninterrupted arc.
    arc : float
        Angle about the axis that this arc covers. Units: rad.
    """

    label: int
    cylinder: Cylinder
    ellipse: Ellipse
    points: int
    arc_points: int
    arc: float

    @property
    def visible(self) -> bool:
        """Whether the arc (60 deg, 15 points) is large enough to expect a detection."""
        return self.arc >= MIN_VISIBLE_ARC and self.arc_points >= MIN_VISIBLE_POINTS


@dataclass(frozen=True, eq=False)
class SectionTruth:
    """Truth of one section.

    Parameters
    ----------
    labels : (n,) ndarray
        Label of each column: -1 lost or displaced by a jump, 0 clutter, k the k-th tube.
    points : (n, 2) ndarray
        Noise-free points, section frame, also where a jump displaces the measured point; NaN where
        lost. Units: mm.
    tubes : tuple of TubeTruth
        Truth of every tube whose axis the section cuts, in the order of the labels.
    """

    labels: IntArray
    points: Points
    tubes: tuple[TubeTruth, ...]


def list_tube_truths(
    scene: Scene, base_from_section: Pose, labels: IntArray, points: Points
) -> tuple[TubeTruth, ...]:
    """Return the truth of each tube of a scene (base frame) whose axis a section cuts.

    `labels` (n,) are those of the columns, `points` (n, 2) the noise-free ones in mm, section
    frame.
    """
    truths = []
    for label, tube in enumerate(scene.tubes, start=1):
        cylinder = tube.local_cylinder(base_from_section)
        if cylinder is None:
            continue
        cylinder = cylinder.transformed(base_from_section.inverse())
        ellipse = cylinder.section()
        run = find_longest_run(labels, label)
        arc = _measure_angular_coverage(points[run], ellipse)
        count = int((labels == label).sum())
        truths.append(TubeTruth(label, cylinder, ellipse, count, len(run), arc))
    return tuple(truths)


def find_longest_run(labels: IntArray, label: int) -> IntArray:
    """Return the columns of a tube's longest arc, without large steps or other objects in between.

    `labels` (n,) are those of all columns.
    """
    columns = np.flatnonzero(labels == label)
    if len(columns) == 0:
        return columns
    others = np.cumsum((labels != label) & (labels != NOTHING))
    interrupted = (np.diff(columns) > MAX_COLUMN_STEP) | (np.diff(others[columns]) > 0)
    return max(np.split(columns, np.flatnonzero(interrupted) + 1), key=len)


def _measure_angular_coverage(points: Points, ellipse: Ellipse) -> float:
    """Return the angle about the cylinder's axis that the points of an arc cover. Units: rad."""
    if len(points) < 2:
        return 0.0
    u, v = ellipse.to_ellipse_frame(points).T
    # The eccentric anomaly is the angle about the axis, along which the section is a circle.
    anomaly: FloatArray = np.unwrap(np.arctan2(v / ellipse.semi_minor, u / ellipse.semi_major))
    return float(np.ptp(anomaly))
