"""Truth of a simulated section: labels and noise-free points of the columns, and the tubes."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, Ellipse, FloatArray, IntArray, Points, Pose
from lsvision.simulate.scene import NOTHING, Scene

MAX_GAP_COLUMNS = 8
"""Largest number of consecutive lost columns or jumps that does not end a tube's visible arc."""
VISIBLE_ARC = math.radians(60.0)
"""Smallest angle about the axis of an uninterrupted arc of a visible tube. Units: rad."""
VISIBLE_POINTS = 15
"""Smallest number of points on that arc."""


@dataclass(frozen=True, eq=False)
class TubeTruth:
    """True parameters of a tube in one section.

    Parameters
    ----------
    label : int
        Number of the tube in the scene, from 1; the label of its points.
    cylinder : Cylinder
        Section frame; for a bent tube, the cylinder along the tangent of its axis.
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
    def radius(self) -> float:
        """Radius of the tube. Units: mm."""
        return self.cylinder.radius

    @property
    def theta(self) -> float:
        """Direction of the major axis. Units: rad."""
        return self.ellipse.theta

    @property
    def phi(self) -> float:
        """Angle between the axis and the normal of the laser plane. Units: rad."""
        return self.ellipse.phi

    @property
    def centre(self) -> tuple[float, float]:
        """Intersection of the axis with the laser plane. Units: mm."""
        return self.ellipse.centre

    @property
    def visible(self) -> bool:
        """Whether the arc (60 deg, 15 points) is large enough to expect a detection."""
        return self.arc >= VISIBLE_ARC and self.arc_points >= VISIBLE_POINTS


@dataclass(frozen=True, eq=False)
class SectionTruth:
    """Truth of one section.

    Parameters
    ----------
    labels : (n,) ndarray
        -1 lost or displaced by a jump, 0 clutter, k the k-th tube.
    points : (n, 2) ndarray
        Noise-free points, section frame, also under a jump; NaN where lost. Units: mm.
    tubes : tuple of TubeTruth
        Every tube whose axis the section cuts, in the order of the labels.
    """

    labels: IntArray
    points: Points
    tubes: tuple[TubeTruth, ...]


def tube_truths(
    scene: Scene, base_from_section: Pose, labels: IntArray, points: Points
) -> tuple[TubeTruth, ...]:
    """Return the truth of each tube of a scene in one section.

    Parameters
    ----------
    scene : Scene
        Base frame.
    base_from_section : Pose
        Pose of the section.
    labels : (n,) ndarray
        Label of each column.
    points : (n, 2) ndarray
        Noise-free points, section frame. Units: mm.
    """
    truths = []
    for label, tube in enumerate(scene.tubes, start=1):
        cylinder = tube.local_cylinder(base_from_section)
        if cylinder is None:
            continue
        cylinder = cylinder.transformed(base_from_section.inverse())
        ellipse = cylinder.section()
        run = longest_run(labels, label)
        arc = _angular_coverage(points[run], ellipse)
        count = int((labels == label).sum())
        truths.append(TubeTruth(label, cylinder, ellipse, count, len(run), arc))
    return tuple(truths)


def longest_run(labels: IntArray, label: int) -> IntArray:
    """Return the columns of a tube's longest arc without points of other objects in between.

    Parameters
    ----------
    labels : (n,) ndarray
        Label of each column.
    label : int
        Label of the tube.
    """
    columns = np.flatnonzero(labels == label)
    if len(columns) == 0:
        return columns
    others = np.cumsum((labels != label) & (labels != NOTHING))
    interrupted = (np.diff(columns) > MAX_GAP_COLUMNS) | (np.diff(others[columns]) > 0)
    return max(np.split(columns, np.flatnonzero(interrupted) + 1), key=len)


def _angular_coverage(points: Points, ellipse: Ellipse) -> float:
    """Return the angle about the cylinder's axis from the first point to the last. Units: rad."""
    if len(points) < 2:
        return 0.0
    u, v = ellipse.to_ellipse_frame(points).T
    # The eccentric anomaly is the angle about the axis, along which the section is a circle.
    anomaly: FloatArray = np.unwrap(np.arctan2(v / ellipse.semi_minor, u / ellipse.semi_major))
    return float(np.ptp(anomaly))
