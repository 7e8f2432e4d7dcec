"""Distance, angle, gap and flush of two cylinders that one light section shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray, build_tangent_frame
from lsvision.inspection.relation import Relation
from lsvision.inspection.uncertain import Length, Scalar

DIRECTION_COUNT = 720
"""Equally spaced directions among which the largest separation is searched first."""
PARABOLA_STEPS = 4
"""Number of refinements of the direction: to the vertex of a parabola through three neighbours."""
STEP_REDUCTION = 8
"""Divisor of the angle between these neighbours after each refinement."""
UP = np.array([0.0, 1.0])
"""Towards the sensor: the direction of flush."""


def relate_sections(first: CylinderSection, second: CylinderSection) -> Relation:
    """Return distance, angle, gap and flush of two cylinders in the plane of their section.

    Distance of the centres; gap of the ellipses in the plane, negative where they overlap; flush,
    the height of the second's crest over the first's along Y; angle of the axes. The covariances of
    both fits, which share no points, are propagated to first order.
    """
    offset = np.subtract(second.centre, first.centre)
    dof = _select_smaller_dof(first, second)
    covariance, other_covariance = (
        section.fit.parameter_covariance[:2, :2] for section in (first, second)
    )
    return Relation(
        {
            "distance": Length(offset, covariance + other_covariance, dof),
            "angle": _AngleOfSections(first, second),
            "gap": _find_separation(first, second, _find_direction_of_gap(first, second)),
            "flush": _compute_crest_height(first, second),
        }
    )


@dataclass(frozen=True)
class _AngleOfSections:
    """Angle between two axes, of which one section does not determine the signs of the tilts.

    Parameters
    ----------
    first, second : CylinderSection
        Both cylinders.
    """

    first: CylinderSection
    second: CylinderSection

    @property
    def value(self) -> float:
        """The smallest angle between a candidate of one axis and one of the other. Units: rad."""
        u, v = self._nearest_candidates
        return 2 * math.asin(min(float(np.linalg.norm(v - u)) / 2, 1.0))

    @property
    def std(self) -> float:
        """Standard uncertainty of the angle between these candidates. Units: rad.

        The largest one over all directions if the angle is 0.
        """
        u, v = self._nearest_candidates
        frame = build_tangent_frame((u + v) / np.linalg.norm(u + v))[:2]
        covariance = _direction_covariance(self.first, u) + _direction_covariance(self.second, v)
        difference = Length(frame @ (v - u), frame @ covariance @ frame.T)
        # The difference of the unit vectors is 2 sin(angle / 2).
        return difference.std / math.cos(self.value / 2)

    @property
    def _nearest_candidates(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors along both axes, (3,) each: the candidates with the smallest angle.

        The other candidates are their mirror images at the laser plane, and have the same angle.
        """
        u = self.first.axis_candidates[0]
        candidates = self.second.axis_candidates
        cosines = candidates @ u
        nearest = int(np.abs(cosines).argmax())
        return u, math.copysign(1.0, cosines[nearest]) * candidates[nearest]

    def interval(self, level: float) -> tuple[float, float]:
        """Return the smallest and largest angle that the intervals of both tilts allow.

        |phi_1 - phi_2| <= angle <= phi_1 + phi_2, whatever both directions are. Each tilt has
        an interval at (1 + level) / 2, so that both contain the true tilts with a probability of
        `level` at least.
        """
        pairs = [section.interval("phi", (1 + level) / 2) for section in (self.first, self.second)]
        (low_1, high_1), (low_2, high_2) = pairs
        min_angle = max(0.0, low_1 - high_2, low_2 - high_1)
        return min_angle, min(high_1 + high_2, math.pi / 2)


def _direction_covariance(section: CylinderSection, direction: FloatArray) -> FloatArray:
    """Return the (3, 3) covariance of a unit vector along one of the candidates of the axis.

    Along the first two axes of `build_tangent_frame`, where phi and theta increase; both are taken
    as independent.
    """
    stds = np.array([section.phi_std, math.sin(section.phi) * section.theta_std])
    tilts = build_tangent_frame(direction)[:2].T * stds
    covariance: FloatArray = tilts @ tilts.T
    return covariance


def _select_smaller_dof(first: CylinderSection, second: CylinderSection) -> float:
    """Return the smaller number of degrees of freedom: Student's t is then not too narrow."""
    return min(first.fit.degrees_of_freedom, second.fit.degrees_of_freedom)


def _compute_support(section: CylinderSection, direction: FloatArray) -> tuple[float, FloatArray]:
    """Return the extent of an ellipse from its centre along a unit vector, in mm.

    That is its support function: the largest component of the points of the ellipse. The ellipse is
    c + E w with unit vectors w and the symmetric E = [[m + p, q], [q, m - p]], so that it is |E n|
    along n. Also return its derivatives (3,) by m, p, q.
    """
    m, p, q = section.fit.parameters[2:].tolist()
    x, y = direction.tolist()
    image = np.array([(m + p) * x + q * y, q * x + (m - p) * y])
    support = math.hypot(*image)
    gradient = np.array([image @ (x, y), image @ (x, -y), image @ (y, x)]) / support
    return support, gradient


def _find_separation(
    first: CylinderSection, second: CylinderSection, direction: FloatArray
) -> Scalar:
    """Return the separation of both ellipses along a direction, that in which it is largest.

    At this maximum the separation does not depend on the direction to first order: the error of the
    direction is not propagated.
    """
    support_1, gradient_1 = _compute_support(first, direction)
    support_2, gradient_2 = _compute_support(second, direction)
    offset = float(np.subtract(second.centre, first.centre) @ direction)
    gradients = np.concatenate([-direction, -gradient_1]), np.concatenate([direction, -gradient_2])
    std = _propagate_std(gradients, (first, second))
    return Scalar(offset - support_1 - support_2, std, _select_smaller_dof(first, second))


def _compute_crest_height(first: CylinderSection, second: CylinderSection) -> Scalar:
    """Return the height of the crest of the second ellipse over that of the first."""
    (support_1, gradient_1), (support_2, gradient_2) = (
        _compute_support(first, UP),
        _compute_support(second, UP),
    )
    gradients = np.concatenate([-UP, -gradient_1]), np.concatenate([UP, gradient_2])
    height = second.centre[1] + support_2 - first.centre[1] - support_1
    std = _propagate_std(gradients, (first, second))
    return Scalar(height, std, _select_smaller_dof(first, second))


def _propagate_std(
    gradients: tuple[FloatArray, FloatArray], sections: tuple[CylinderSection, CylinderSection]
) -> float:
    """Return the std of a quantity from its gradients by the parameters of both fits."""
    variance = sum(
        float(gradient @ section.fit.parameter_covariance @ gradient)
        for gradient, section in zip(gradients, sections, strict=True)
    )
    return math.sqrt(variance)


def _find_direction_of_gap(first: CylinderSection, second: CylinderSection) -> FloatArray:
    """Return the unit vector along which the separation of both ellipses is largest.

    The distance of two convex outlines is their largest separation over all directions. For
    ellipses that overlap this is the direction of the shortest displacement that separates them.
    """
    angles = np.linspace(0, 2 * math.pi, DIRECTION_COUNT, endpoint=False)
    angle = float(angles[np.argmax(_compute_separations(first, second, angles))])
    step = 2 * math.pi / DIRECTION_COUNT
    for _ in range(PARABOLA_STEPS):
        before, middle, after = _compute_separations(
            first, second, angle + step * np.array([-1.0, 0.0, 1.0])
        )
        curvature = before - 2 * middle + after
        if curvature < 0:
            angle += step * float(np.clip((before - after) / (2 * curvature), -1, 1))
        step /= STEP_REDUCTION
    return np.array([math.cos(angle), math.sin(angle)])


def _compute_separations(
    first: CylinderSection, second: CylinderSection, angles: FloatArray
) -> FloatArray:
    """Return the separation of both ellipses along directions at angles (rad) from X. Units: mm.

    The offset of the centres minus both support functions (see `_compute_support`); negative if the
    projections of the ellipses overlap.
    """
    directions = np.stack([np.cos(angles), np.sin(angles)])
    separations: FloatArray = np.subtract(second.centre, first.centre) @ directions
    for section in (first, second):
        m, p, q = section.fit.parameters[2:].tolist()
        separations = separations - np.linalg.norm(
            np.array([[m + p, q], [q, m - p]]) @ directions, axis=0
        )
    return separations
