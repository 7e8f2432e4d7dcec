"""What is true of a simulated section, column by column and tube by tube."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Cylinder, Ellipse, FloatArray, IntArray, Points, Pose
from lsvision.simulate.scene import NOTHING, Scene

BRIDGED_COLUMNS = 8
"""Longest stretch of lost columns or jumps that does not end a tube's visible arc."""
VISIBLE_ARC = math.radians(60.0)
"""Least angle about the axis of which a tube must show an unbroken arc to count as visible."""
VISIBLE_POINTS = 15
"""Least number of points on that arc."""


@dataclass(frozen=True, eq=False)
class TubeTruth:
    """A tube where the section cuts it.

    Parameters
    ----------
    label : int
        Number of the tube in the scene, from 1; the label of its points.
    cylinder : Cylinder
        Section frame; of a bent tube the one that touches it here.
    ellipse : Ellipse
        Its section.
    points : int
        Number of points that carry the label.
    arc_points : int
        Number of points on its longest unbroken arc.
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
        """Units: mm."""
        return self.cylinder.radius

    @property
    def theta(self) -> float:
        """Direction of the major axis. Units: rad."""
        return self.ellipse.theta

    @property
    def phi(self) -> float:
        """Tilt of the axis from the plane's normal. Units: rad."""
        return self.ellipse.phi

    @property
    def centre(self) -> tuple[float, float]:
        """Where the axis meets the plane. Units: mm."""
        return self.ellipse.centre

    @property
    def visible(self) -> bool:
        """Whether enough is seen of it (60 deg, 15 points) for a finder to be blamed."""
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
        Every tube whose axis the section cuts, by label.
    """

    labels: IntArray
    points: Points
    tubes: tuple[TubeTruth, ...]


def tube_truths(
    scene: Scene, base_from_section: Pose, labels: IntArray, points: Points
) -> tuple[TubeTruth, ...]:
    """Truth of each tube of a scene in one section.

    Parameters
    ----------
    scene : Scene
        Base frame.
    base_from_section : Pose
        Where the section is.
    labels : (n,) ndarray
        Of the columns.
    points : (n, 2) ndarray
        Noise-free, section frame. Units: mm.
    """
    truths = []
    for label, tube in enumerate(scene.tubes, start=1):
        cylinder = tube.local_cylinder(base_from_section)
        if cylinder is None:
            continue
        cylinder = cylinder.transformed(base_from_section.inverse())
        ellipse = cylinder.section()
        run = longest_run(labels, label)
        arc = _covered(points[run], ellipse)
        count = int((labels == label).sum())
        truths.append(TubeTruth(label, cylinder, ellipse, count, len(run), arc))
    return tuple(truths)


def longest_run(labels: IntArray, label: int) -> IntArray:
    """Columns of a tube's longest arc that nothing else interrupts.

    Parameters
    ----------
    labels : (n,) ndarray
        Of the columns.
    label : int
        The tube's.
    """
    mine = np.flatnonzero(labels == label)
    if len(mine) == 0:
        return mine
    others = np.cumsum((labels != label) & (labels != NOTHING))
    broken = (np.diff(mine) > BRIDGED_COLUMNS) | (np.diff(others[mine]) > 0)
    return max(np.split(mine, np.flatnonzero(broken) + 1), key=len)


def _covered(points: Points, ellipse: Ellipse) -> float:
    """Angle about the cylinder's axis from the first point to the last. Units: rad."""
    if len(points) < 2:
        return 0.0
    own = ellipse.to_ellipse_frame(points)
    # The eccentric anomaly is the angle about the axis: the section seen along it is a circle.
    anomaly: FloatArray = np.unwrap(
        np.arctan2(own[:, 1] / ellipse.semi_minor, own[:, 0] / ellipse.semi_major)
    )
    return float(np.ptp(anomaly))
