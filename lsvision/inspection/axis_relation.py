"""Distance, angle, gap and flush of two cylinders in space, and the seam between them.

Gap is the distance between the surfaces; flush is the height of the second cylinder's crest over
the first one's along a given direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.geometry import FloatArray
from lsvision.inspection.relation import Relation, Seam
from lsvision.inspection.uncertain import Length, Scalar

DERIVATIVE_STEP = 1e-6
"""Step of the numerical derivatives by the parameters. Units: mm or rad."""
PARALLEL_SINE = 1e-9
"""Sine of the angle below which two axes are parallel."""

Range = tuple[float, float]
"""Two positions along axes: (first, last) of one axis, or one on each of two axes. Units: mm."""


@dataclass(frozen=True, eq=False)
class ObservedCylinder:
    """A cylinder in space, and the part of its length that was observed.

    Parameters
    ----------
    fit : CylinderFit
        Axis and radius with their covariance.
    axial_range : (float, float)
        Range of the observed points along ``fit.direction``, from ``fit.point``. Units: mm.
    """

    fit: CylinderFit
    axial_range: Range


def relate_axes(
    first: ObservedCylinder, second: ObservedCylinder, up: FloatArray | None = None
) -> Relation:
    """Return distance, angle, gap and flush of two cylinders in space.

    Parameters
    ----------
    first, second : ObservedCylinder
        Two cylinders in the same frame; their errors are taken as independent.
    up : (3,) ndarray, optional
        Unit vector along which flush is measured; without it flush is not measured.

    Returns
    -------
    Relation
        At the common perpendicular of the axes if it lies within the observed length of both, else
        in the middle of the length along which both were observed: distance of the axes, gap of the
        surfaces, flush, angle and seam. Covariances are propagated to first order, with the
        positions along both axes kept fixed.
    """
    pair = _Pair.of(first, second)
    values = pair.values(np.zeros(10), up)
    steps = DERIVATIVE_STEP * np.eye(10)
    jacobian = np.array(
        [(pair.values(step, up) - pair.values(-step, up)) / (2 * DERIVATIVE_STEP) for step in steps]
    ).T
    covariance = jacobian @ pair.covariance @ jacobian.T
    dof = min(first.fit.degrees_of_freedom, second.fit.degrees_of_freedom)

    def scalar(row: int) -> Scalar:
        return Scalar(float(values[row]), math.sqrt(max(covariance[row, row], 0.0)), dof)

    quantities: dict[str, Length | Scalar] = {
        "distance": Length(values[:2], covariance[:2, :2], dof),
        "angle": Length(values[2:4], covariance[2:4, 2:4], dof),
        "gap": scalar(4),
    }
    if up is not None:
        quantities["flush"] = scalar(5)
    # For parallel axes any point along the line is valid: only errors perpendicular to it count.
    projector = (
        np.eye(3)
        if pair.crossing
        else np.eye(3) - np.outer(pair.mean_direction, pair.mean_direction)
    )
    seam = Seam(
        points=pair.foot_points(np.zeros(10)),
        point=values[6:9],
        point_covariance=projector @ covariance[6:9, 6:9] @ projector,
        direction=values[9:12],
        direction_std=math.sqrt(max(float(np.trace(covariance[9:12, 9:12])), 0.0)),
        crossing=pair.crossing,
    )
    return Relation(quantities, seam)


def angle_between(fit: CylinderFit, direction: FloatArray) -> Length:
    """Return the angle between an axis, in either sense, and an exact direction. Units: rad."""
    unit = direction / np.linalg.norm(direction)
    unit = unit if unit @ fit.direction >= 0 else -unit
    perpendicular = unit - (unit @ fit.direction) * fit.direction
    sine = float(np.linalg.norm(perpendicular))
    # The rotation from the axis to the direction, in the basis of the axis' errors.
    rotation = fit.tangent_basis @ perpendicular
    angle = math.atan2(sine, float(unit @ fit.direction))
    vector = rotation * (angle / sine) if sine > PARALLEL_SINE else rotation
    return Length(vector, fit.covariance[2:4, 2:4], fit.degrees_of_freedom)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two cylinders, and the positions along their axes at which they are compared.

    Parameters
    ----------
    first, second : CylinderFit
        The cylinders.
    sign : float
        1 if the angle between both directions is at most 90 deg, else -1.
    along : (float, float)
        Position on each axis, from ``point`` along ``direction``. Units: mm.
    frame : (2, 3) ndarray
        Orthonormal vectors along which the offset of the axes is resolved; for crossing axes, their
        common normal and a row of zeros.
    crossing : bool
        Whether the common perpendicular lies within the observed length of both.
    """

    first: CylinderFit
    second: CylinderFit
    sign: float
    along: Range
    frame: FloatArray
    crossing: bool

    @classmethod
    def of(cls, first: ObservedCylinder, second: ObservedCylinder) -> _Pair:
        """Return a pair with the points of both axes that are compared."""
        a, b = first.fit, second.fit
        sign = 1.0 if a.direction @ b.direction >= 0 else -1.0
        along = _nearest_approach((a.point, a.direction), (b.point, b.direction))
        ranges = first.axial_range, second.axial_range
        if along is not None and all(
            low <= s <= high for s, (low, high) in zip(along, ranges, strict=True)
        ):
            normal = np.cross(a.direction, b.direction)
            frame = np.stack([normal / np.linalg.norm(normal), np.zeros(3)])
            return cls(a, b, sign, along, frame, crossing=True)
        along = _common_middle(first, second, sign)
        mean = a.direction + sign * b.direction
        frame = _perpendicular_basis(mean / np.linalg.norm(mean))
        return cls(a, b, sign, along, frame, crossing=False)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the parameters of both cylinders, (10, 10)."""
        covariance = np.zeros((10, 10))
        covariance[:5, :5], covariance[5:, 5:] = self.first.covariance, self.second.covariance
        return covariance

    @property
    def mean_direction(self) -> FloatArray:
        """Unit vector midway between both directions, (3,)."""
        mean = self.first.direction + self.sign * self.second.direction
        unit: FloatArray = mean / np.linalg.norm(mean)
        return unit

    def _perturbed(self, step: FloatArray) -> list[tuple[FloatArray, FloatArray, float]]:
        """Return point, direction and radius of both cylinders after adding `step`, (10,).

        For each cylinder: two offsets of the point and two tilts of the axis along its tangent
        basis, and the change of the radius. Units: mm, rad.
        """
        perturbed = []
        for fit, change in ((self.first, step[:5]), (self.second, step[5:])):
            basis = fit.tangent_basis
            direction = fit.direction + change[2:4] @ basis
            direction = direction / np.linalg.norm(direction)
            perturbed.append(
                (fit.point + change[:2] @ basis, direction, fit.radius + float(change[4]))
            )
        return perturbed

    def foot_points(self, step: FloatArray) -> FloatArray:
        """Return a point of each axis, (2, 3). Units: mm.

        They are the ends of the common perpendicular if the axes cross, else the points at `along`.
        """
        axes, along = self._perturbed(step), self.along
        if self.crossing:
            along = _nearest_approach(axes[0][:2], axes[1][:2]) or along
        return np.array(
            [point + s * direction for (point, direction, _), s in zip(axes, along, strict=True)]
        )

    def values(self, step: FloatArray, up: FloatArray | None) -> FloatArray:
        """Return (12,): offset (2), angle (2), gap, flush, seam point (3) and direction (3)."""
        (_, u, r), (_, v, t) = self._perturbed(step)
        v = self.sign * v
        foot, other_foot = self.foot_points(step)
        offset = self.frame @ (other_foot - foot)
        distance = math.hypot(*offset)
        unit = self.frame.T @ offset / distance if distance > 0 else self.frame[0]
        flush = 0.0
        if up is not None:
            flush = float((other_foot - foot) @ up) + _crest(v, t, up) - _crest(u, r, up)
        seam = (foot + other_foot + (r - t) * unit) / 2
        mean = (u + v) / np.linalg.norm(u + v)
        return np.concatenate([offset, self._angle(u, v), [distance - r - t, flush], seam, mean])

    def _angle(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the (2,) rotation from the first axis to the second, normal to both."""
        cross = np.cross(u, v)
        sine = float(np.linalg.norm(cross))
        angle = math.atan2(sine, float(u @ v))
        rotation = cross * (angle / sine) if sine > PARALLEL_SINE else cross
        rotated: FloatArray = _perpendicular_basis(self.mean_direction) @ rotation
        return rotated


def _perpendicular_basis(direction: FloatArray) -> FloatArray:
    """Return two unit vectors perpendicular to a direction, (2, 3)."""
    rows: FloatArray = np.linalg.svd(direction[None])[2][1:]
    return rows


def _crest(direction: FloatArray, radius: float, up: FloatArray) -> float:
    """Return the height of a cylinder's crest over its axis along `up`."""
    return radius * math.sqrt(max(1 - float(direction @ up) ** 2, 0.0))


def _nearest_approach(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]
) -> Range | None:
    """Return the positions of the common perpendicular on both axes; None if parallel."""
    (point, u), (other_point, v) = first, second
    cosine = float(u @ v)
    squared_sine = 1 - cosine**2
    if squared_sine < PARALLEL_SINE**2:
        return None
    offset = other_point - point
    along_u, along_v = float(offset @ u), float(offset @ v)
    return (along_u - cosine * along_v) / squared_sine, (cosine * along_u - along_v) / squared_sine


def _common_middle(first: ObservedCylinder, second: ObservedCylinder, sign: float) -> Range:
    """Return the positions on both axes in the middle of their common observed length.

    If their observed lengths do not overlap, it is the middle of the distance between them.
    """
    a, b = first.fit, second.fit
    mean = a.direction + sign * b.direction
    mean = mean / np.linalg.norm(mean)
    ends = [
        sorted(float((fit.point + s * fit.direction) @ mean) for s in axial_range)
        for fit, axial_range in ((a, first.axial_range), (b, second.axial_range))
    ]
    middle = (max(low for low, _ in ends) + min(high for _, high in ends)) / 2
    along_a, along_b = (
        (middle - float(fit.point @ mean)) / float(fit.direction @ mean) for fit in (a, b)
    )
    return along_a, along_b
