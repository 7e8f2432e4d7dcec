"""Distance, angle, gap and flush of two cylinders in space, and the seam between them.

Gap is the distance between the surfaces; flush is the height of the second cylinder's crest over
the first one's along a given direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.geometry import FloatArray, build_tangent_frame
from lsvision.inspection.relation import Relation, Seam
from lsvision.inspection.uncertain import Gap, Length, Scalar, Uncertain
from lsvision.results.quantities import LEVEL

DERIVATIVE_STEP = 1e-6
"""Step of the central differences by the parameters. Units: mm or rad."""
PARALLEL_SINE = 1e-9
"""Sine of the angle below which two directions count as parallel."""
MAX_ANGLE_SIDE_BY_SIDE = math.radians(70)
"""Angle of the axes above which they are always compared at their common perpendicular: there is no
common length, and their mean direction changes abruptly at a right angle. Units: rad."""
MIN_UP_SINE = 0.1
"""Smallest sine of the angle between an axis and the direction of flush: along its axis a cylinder
has no crest."""

OFFSET, ANGLE, GAP, FLUSH, POINT, DIRECTION = slice(2), slice(2, 4), 4, 5, slice(6, 9), slice(9, 12)
"""Indices of the quantities that `_Pair.evaluate` returns."""

Range = tuple[float, float]
"""First and last position along an axis. Units: mm."""
Positions = tuple[float, float]
"""Position on each of two axes, from the point of the fit along its direction. Units: mm."""


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
    """Return distance, angle, gap and flush of two cylinders in the same frame, and their seam.

    They are compared at the common perpendicular of the axes if it lies within the observed length
    of both, or the angle of the axes exceeds `MAX_ANGLE_SIDE_BY_SIDE`; else in the middle of the
    length along which both were observed. Covariances, of independent errors, are propagated to
    first order: a common perpendicular moves with the axes, positions in the middle of the length
    are kept fixed. Flush is measured along the unit vector `up`, (3,), if it is given.

    Raises
    ------
    ValueError
        If `up` is nearly along an axis; see `MIN_UP_SINE`.
    """
    if up is not None:
        _require_across(up, (first.fit, second.fit))
    pair = _Pair.of(first, second)
    values, covariance = pair.propagate(up)
    # The smaller number: Student's t is then not too narrow for either fit.
    dof = min(first.fit.degrees_of_freedom, second.fit.degrees_of_freedom)
    gap_std, flush_std = np.sqrt(np.maximum(covariance.diagonal()[[GAP, FLUSH]], 0.0)).tolist()
    radii_std = math.hypot(first.fit.radius_std, second.fit.radius_std)
    radii = Scalar(first.fit.radius + second.fit.radius, radii_std, dof)
    distance = Length(values[OFFSET], covariance[OFFSET, OFFSET], dof)
    angle = Length(values[ANGLE], covariance[ANGLE, ANGLE], dof, math.pi / 2)
    quantities: dict[str, Uncertain] = {
        "distance": distance,
        "angle": angle,
        "gap": Gap(distance, radii, gap_std),
    }
    if up is not None:
        quantities["flush"] = Scalar(float(values[FLUSH]), flush_std, dof)
    seam = _build_seam(pair, values, covariance)
    if distance.interval(LEVEL)[0] == 0:
        # The direction from one axis to the other, along which the point lies, may be any.
        difference, basis = first.fit.radius - second.fit.radius, pair.offset_basis
        point_covariance = seam.point_covariance + difference**2 / 2 * basis.T @ basis
        seam = replace(seam, point_covariance=point_covariance)
    if angle.interval(LEVEL)[1] == math.pi / 2:
        # The other bisector of perpendicular axes may be the right one.
        seam = replace(seam, direction_std=math.pi / 2)
    return Relation(quantities, seam)


def _require_across(up: FloatArray, fits: tuple[CylinderFit, CylinderFit]) -> None:
    """Raise ValueError if a unit vector is nearly along the axis of one of two cylinders."""
    if min(np.linalg.norm(np.cross(up, fit.direction)) for fit in fits) < MIN_UP_SINE:
        raise ValueError(
            "expected up across both axes, got a direction along one: a cylinder has no crest "
            "along its axis; leave up and flush out"
        )


def _build_seam(pair: _Pair, values: FloatArray, covariance: FloatArray) -> Seam:
    """Return the seam of a pair from its values and their covariance (12, 12), to first order."""
    projector = np.eye(3)
    if not pair.crossing:
        # The seam point may lie anywhere along the mean direction: only its errors perpendicular to
        # that count.
        projector -= np.outer(pair.mean_direction, pair.mean_direction)
    return Seam(
        points=pair.find_foot_points(np.zeros(10)),
        point=values[POINT],
        point_covariance=projector @ covariance[POINT, POINT] @ projector,
        direction=values[DIRECTION],
        direction_std=math.sqrt(max(float(np.trace(covariance[DIRECTION, DIRECTION])), 0.0)),
        crossing=pair.crossing,
    )


def angle_between(fit: CylinderFit, direction: FloatArray) -> Length:
    """Return the angle between an axis, in either sense, and an exact direction, (3,).

    The vector is the tilt from the axis to the direction along both rows of ``fit.tangent_basis``;
    its length is the angle, at most 90 deg. Units: rad.
    """
    unit = direction / np.abs(direction).max()  # so that its norm does not overflow
    unit = unit / np.linalg.norm(unit)
    unit = unit if unit @ fit.direction >= 0 else -unit
    perpendicular = unit - (unit @ fit.direction) * fit.direction
    sine = float(np.linalg.norm(perpendicular))
    # In the basis of the covariance of the direction.
    tilt = fit.tangent_basis @ perpendicular
    angle = math.atan2(sine, float(unit @ fit.direction))
    vector = tilt * (angle / sine) if sine > PARALLEL_SINE else tilt
    return Length(vector, fit.covariance[2:4, 2:4], fit.degrees_of_freedom, math.pi / 2)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two cylinders, and the positions along their axes at which they are compared.

    `sign` is 1 if the angle between both directions is at most 90 deg, else -1; `along` the
    position on each axis from ``point`` along ``direction``, in mm. The rows of `offset_basis`, (2,
    3), are vectors along which the offset of the axes is resolved: an orthonormal basis
    perpendicular to the mean direction; for axes compared at the common perpendicular (`crossing`),
    their common unit normal and a row of zeros.
    """

    first: CylinderFit
    second: CylinderFit
    sign: float
    along: Positions
    offset_basis: FloatArray
    crossing: bool

    @classmethod
    def of(cls, first: ObservedCylinder, second: ObservedCylinder) -> _Pair:
        """Return the pair, with its positions at the common perpendicular or the common middle."""
        a, b = first.fit, second.fit
        cosine = float(a.direction @ b.direction)
        sign = 1.0 if cosine >= 0 else -1.0
        along = _find_nearest_approach((a.point, a.direction), (b.point, b.direction))
        ranges = first.axial_range, second.axial_range
        if along is not None and (
            abs(cosine) < math.cos(MAX_ANGLE_SIDE_BY_SIDE)
            or all(low <= s <= high for s, (low, high) in zip(along, ranges, strict=True))
        ):
            normal = np.cross(a.direction, b.direction)
            basis = np.stack([normal / np.linalg.norm(normal), np.zeros(3)])
            return cls(a, b, sign, along, basis, crossing=True)
        mean = _compute_mean_direction(a.direction, sign * b.direction)
        along = _find_common_middle(first, second, mean)
        return cls(a, b, sign, along, build_tangent_frame(mean)[:2], crossing=False)

    def propagate(self, up: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return values (12,) and their covariance (12, 12), to first order."""
        covariance = np.zeros((10, 10))
        covariance[:5, :5], covariance[5:, 5:] = self.first.covariance, self.second.covariance
        changes = [
            self.evaluate(step, up) - self.evaluate(-step, up)
            for step in DERIVATIVE_STEP * np.eye(10)
        ]
        jacobian = np.array(changes).T / (2 * DERIVATIVE_STEP)
        return self.evaluate(np.zeros(10), up), jacobian @ covariance @ jacobian.T

    @property
    def mean_direction(self) -> FloatArray:
        """Unit vector midway between both directions, (3,)."""
        return _compute_mean_direction(self.first.direction, self.sign * self.second.direction)

    def _perturb(self, step: FloatArray) -> list[tuple[FloatArray, FloatArray, float]]:
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

    def find_foot_points(self, step: FloatArray) -> FloatArray:
        """Return a point of each axis, (2, 3). Units: mm.

        They are the ends of the common perpendicular if the axes cross, else the points at `along`.
        """
        axes, along = self._perturb(step), self.along
        if self.crossing:
            along = _find_nearest_approach(axes[0][:2], axes[1][:2]) or along
        return np.array(
            [point + s * direction for (point, direction, _), s in zip(axes, along, strict=True)]
        )

    def evaluate(self, step: FloatArray, up: FloatArray | None) -> FloatArray:
        """Return all quantities after adding `step` to the parameters, (12,).

        Offset along `offset_basis` (2, mm), angle as a rotation vector (2, rad), gap and flush
        (mm; flush is 0 without `up`), seam point (3, mm) and seam direction (3).
        """
        (_, u, radius), (_, v, other_radius) = self._perturb(step)
        v = self.sign * v
        foot, other_foot = self.find_foot_points(step)
        basis = self.offset_basis
        offset = basis @ (other_foot - foot)
        distance = math.hypot(*offset)
        unit = basis.T @ offset / distance if distance > 0 else basis[0]
        flush = 0.0
        if up is not None:
            crests = _compute_crest_height(v, other_radius, up) - _compute_crest_height(
                u, radius, up
            )
            flush = float((other_foot - foot) @ up) + crests
        gap = distance - radius - other_radius
        seam = (foot + other_foot + (radius - other_radius) * unit) / 2
        return np.concatenate(
            [offset, self._angle(u, v), [gap, flush], seam, _compute_mean_direction(u, v)]
        )

    def _angle(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the rotation vector from direction `u` to `v`, (2,). Units: rad.

        It is perpendicular to both, and so to their mean: two components are enough.
        """
        cross = np.cross(u, v)
        sine = float(np.linalg.norm(cross))
        angle = math.atan2(sine, float(u @ v))
        rotation = cross * (angle / sine) if sine > PARALLEL_SINE else cross
        components: FloatArray = build_tangent_frame(self.mean_direction)[:2] @ rotation
        return components


def _compute_mean_direction(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the unit vector midway between two unit vectors that are not opposite, (3,)."""
    unit: FloatArray = (u + v) / np.linalg.norm(u + v)
    return unit


def _compute_crest_height(direction: FloatArray, radius: float, up: FloatArray) -> float:
    """Return the height of a cylinder's crest over its axis along `up`."""
    return radius * math.sqrt(max(1 - float(direction @ up) ** 2, 0.0))


def _find_nearest_approach(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]
) -> Positions | None:
    """Return the positions of the common perpendicular on both axes; None if parallel.

    Each axis is a point and a unit vector.
    """
    (point, u), (other_point, v) = first, second
    # By cross products: with 1 - (u @ v)^2 rounding errors exceed the squared sine of small angles.
    normal = np.cross(u, v)
    squared_sine = float(normal @ normal)
    if squared_sine < PARALLEL_SINE**2:
        return None
    offset = other_point - point
    return (
        float(np.cross(offset, v) @ normal) / squared_sine,
        float(np.cross(offset, u) @ normal) / squared_sine,
    )


def _find_common_middle(
    first: ObservedCylinder, second: ObservedCylinder, mean: FloatArray
) -> Positions:
    """Return the positions on both axes in the middle of their common observed length.

    The length is measured along the mean direction. If the observed lengths do not overlap, it is
    the middle of the space between them.
    """
    ends = [
        sorted(
            float((observed.fit.point + s * observed.fit.direction) @ mean)
            for s in observed.axial_range
        )
        for observed in (first, second)
    ]
    middle = (max(low for low, _ in ends) + min(high for _, high in ends)) / 2
    along, other_along = (
        (middle - float(fit.point @ mean)) / float(fit.direction @ mean)
        for fit in (first.fit, second.fit)
    )
    return along, other_along
