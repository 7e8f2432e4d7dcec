"""Extrema of five quantities over ellipsoids: the targets of a step towards the ends of intervals.

About parameters (centre_x, centre_y, m, p, q) the region {F <= min F + c} is an ellipsoid with
centre mu, radius rho and shape C. The quantities are not approximated: each is linear for a fixed
direction of d = (p, q), so its extremum is ``mu + rho C f / |f|_C``, with f the gradient for that
direction:

- centre: f is an axis;
- theta: f is normal to the tangent from the circle d = 0 to the ellipsoid;
- radius and phi: f = +/- (u . d - kappa m), with u the direction of d at the extremum itself, found
  by Newton's method on its angle, and kappa = 1 for the radius, h / m for phi.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, apply
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.parameters import PARAMETERS
from lsvision.geometry import BoolArray, FloatArray, IntArray

RADIUS_LOW, RADIUS_HIGH, PHI_LOW, PHI_HIGH, RADIUS_LOW_2, PHI_HIGH_2 = range(6)
X_LOW, X_HIGH, Y_LOW, Y_HIGH, THETA_LOW, THETA_HIGH, CIRCLE = range(6, 13)
DIRECTED, ROWS = 6, 13
"""Number of rows that have a direction u, which come first, and of all rows."""
SECOND_ROWS = {RADIUS_LOW: RADIUS_LOW_2, PHI_HIGH: PHI_HIGH_2}
"""The smallest radius and the largest phi may have two local extrema, with opposite d."""
OUTWARD = (1.0, -1.0, -1.0, 1.0, 1.0, 1.0)
"""+1 for the ends of largest h, -1 for those of smallest."""
IS_PHI = (False, False, True, True, False, True)
RIDGE_GRADIENTS = {
    RADIUS_HIGH: (0.0, 0.0, 1.0),
    X_LOW: (-1.0, 0.0, 0.0),
    X_HIGH: (1.0, 0.0, 0.0),
    Y_LOW: (0.0, -1.0, 0.0),
    Y_HIGH: (0.0, 1.0, 0.0),
}
"""Gradients by (x, y, m), on d = 0, of the quantities whose extremum may be a circle: radius, and
with a known radius those on the surface b = const."""
SIDES = {THETA_LOW: -1.0, THETA_HIGH: 1.0}

SEARCHED_ANGLES = 24
"""Number of initial directions of d for radius and phi, 15 deg apart."""
MAX_TURN = 0.7
"""Longest Newton step of the direction u. Units: rad."""
MAX_ROUNDS, DIRECTION_TOLERANCE = 4, 0.02
"""Largest number of Newton steps of the direction u, and last step of angle (rad) and kappa."""
CRITICAL_ROUNDS = 2
"""Number of updates of c of phi in an iteration."""
MAX_TANGENT = 0.98
"""Largest sine of half the angle that the ellipsoid subtends at the circle: a circle inside the
ellipsoid has no tangent to it."""
TINY = 1e-300


class Targets(NamedTuple):
    """Targets of a step: parameters (k, 5), angles, kappas and c (k,), and min F on d = 0."""

    parameters: FloatArray
    angles: FloatArray
    kappas: FloatArray
    critical: FloatArray
    circle_ratio: float

    def rows(self, chosen: BoolArray) -> "Targets":
        """Return the targets of some rows."""
        return Targets(*(field[chosen] for field in self[:4]), self.circle_ratio)


class Ellipsoid(NamedTuple):
    """Section (m, p, q) of an ellipsoid: centre, shape (3 rows), squared radius less c."""

    centre: Sequence[float]
    shape: Sequence[Sequence[float]]
    excess: float


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """Region {F <= min F + c} of a fit; `best` is the expansion at the estimate."""

    fit: EllipseFit
    ratios: CriticalRatios
    best: Expansion

    def find_targets(
        self, rows: IntArray, parameters: FloatArray, expansion: Expansion, last: Targets
    ) -> Targets:
        """Return the extrema over the ellipsoids of the expansion at each of k rows."""
        to_centre = apply(expansion.covariance, expansion.gradient)
        centres = parameters - to_centre
        excess = self.best.cost - expansion.cost + (expansion.gradient * to_centre).sum(axis=1)
        shapes = expansion.covariance[:, 2:, 2:].tolist()
        ellipsoids = [
            Ellipsoid(*each)
            for each in zip(centres[:, 2:].tolist(), shapes, excess.tolist(), strict=True)
        ]
        names = rows.tolist()
        angles, kappas, critical = self._find_directions(names, ellipsoids, last)
        f, rho, circle_ratio = [], [], last.circle_ratio
        for i, (row, ellipsoid) in enumerate(zip(names, ellipsoids, strict=True)):
            radius = math.sqrt(max(ellipsoid.excess + critical[i], 0.0))
            gradient: Sequence[float]
            if row < DIRECTED:
                gradient = (0.0, 0.0, *_directed_gradient(row, angles[i], kappas[i]))
            elif row in SIDES:
                normal, radius, contact = _find_tangent(ellipsoid, radius, SIDES[row])
                critical[i] = self.ratios.of_direction(contact)
                gradient = (0.0, 0.0, 0.0, *normal)
            elif row == CIRCLE:
                white = _whitened(ellipsoid)
                radius, gradient = abs(white), (0.0, 0.0, 0.0, *_unwhitened(ellipsoid, -white))
                circle_ratio = radius * radius - ellipsoid.excess
            else:
                gradient = (*RIDGE_GRADIENTS[row], 0.0, 0.0)
            f.append(gradient)
            rho.append(radius)
        gradients = np.array(f).reshape(-1, PARAMETERS)
        Cf = apply(expansion.covariance, gradients)
        scale = np.array(rho) / np.sqrt(np.maximum((gradients * Cf).sum(axis=1), TINY))
        targets = centres + scale[:, None] * Cf
        targets[rows == CIRCLE, 3:] = 0.0
        ridge_rows = RIDGE_GRADIENTS if self.fit.problem.known_radius else (RADIUS_HIGH,)
        for i, row in enumerate(names):
            if row not in ridge_rows:
                continue
            surplus = rho[i] ** 2 - abs(_whitened(ellipsoids[i])) ** 2
            if surplus > 0:
                end = _circle_extremum(row, ellipsoids[i], centres[i], expansion.rows(i), surplus)
                step = end - parameters[i]
                slope = expansion.information_of_points[i] @ step + expansion.gradient_of_points[i]
                # F of the points increases faster across the ridge than along m.
                if math.hypot(slope[3], slope[4]) <= slope[2]:
                    targets[i] = end
        return Targets(
            targets, np.array(angles), np.array(kappas), np.array(critical), circle_ratio
        )

    def search_directions(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and kappas (6,) near the extrema over the ellipsoid at the estimate."""
        _, _, m, p, q = self.fit.parameters.tolist()
        shape, sign = self.best.covariance[0, 2:, 2:], np.array(OUTWARD)[:, None]
        turns = np.arange(SEARCHED_ANGLES) * (2 * np.pi / SEARCHED_ANGLES)
        kappas = np.where(IS_PHI, math.hypot(p, q) / m, 1.0)
        f = np.empty((DIRECTED, SEARCHED_ANGLES, 3))
        f[:, :, 0], f[:, :, 1], f[:, :, 2] = -kappas[:, None], np.cos(turns), np.sin(turns)
        std = np.sqrt(self.ratios.one * ((f @ shape) * f).sum(axis=2))
        height = f @ (m, p, q) + sign * std
        chosen = height.argmax(axis=1)
        opposite = np.cos(turns - turns[chosen][:, None]) < 0
        second = list(SECOND_ROWS.values())
        chosen[second] = np.where(opposite, height, -np.inf)[second].argmax(axis=1)
        return turns[chosen], kappas

    def _find_directions(
        self, rows: Sequence[int], ellipsoids: Sequence[Ellipsoid], last: Targets
    ) -> tuple[list[float], list[float], list[float]]:
        """Return angles, kappas and c (k,); those of rows without a direction are the last ones."""
        angles, kappas, critical = (field.tolist() for field in last[1:4])
        directed = [i for i, row in enumerate(rows) if row < DIRECTED]
        phis = [i for i in directed if IS_PHI[rows[i]]]
        for _ in range(CRITICAL_ROUNDS):
            for i in directed:
                angles[i], kappas[i] = _find_direction(
                    rows[i], ellipsoids[i], angles[i], kappas[i], critical[i]
                )
            directed = phis
            new = self.ratios.of_flattening(np.array([kappas[i] for i in phis])).tolist()
            for i, c in zip(phis, new, strict=True):
                if c == critical[i]:
                    directed = [each for each in directed if each != i]
                critical[i] = c
            if not directed:
                break
        return angles, kappas, critical


def _directed_gradient(row: int, angle: float, kappa: float) -> tuple[float, float, float]:
    """Return the gradient of +/- (u . d - kappa m) by (m, p, q)."""
    sign = OUTWARD[row]
    return -sign * kappa, sign * math.cos(angle), sign * math.sin(angle)


def _find_direction(
    row: int, ellipsoid: Ellipsoid, angle: float, kappa: float, critical: float
) -> tuple[float, float]:
    """Return angle of u and kappa of the extremum, by Newton's method."""
    centre, (of_m, of_p, of_q), excess = ellipsoid
    radius = OUTWARD[row] * math.sqrt(max(excess + critical, 0.0))
    for _ in range(MAX_ROUNDS):
        cos, sin, last = math.cos(angle), math.sin(angle), kappa
        Cm = of_m[1] * cos + of_m[2] * sin - of_m[0] * kappa
        Cp = of_p[1] * cos + of_p[2] * sin - of_p[0] * kappa
        Cq = of_q[1] * cos + of_q[2] * sin - of_q[0] * kappa
        variance = max(cos * Cp + sin * Cq - kappa * Cm, TINY)
        scale = radius / math.sqrt(variance)
        m, p, q = centre[0] + scale * Cm, centre[1] + scale * Cp, centre[2] + scale * Cq
        # At the extremum d has the direction u: no component across it.
        along, across, C_across = cos * p + sin * q, cos * q - sin * p, cos * Cq - sin * Cp
        spread = sin * (sin * of_p[1] - 2 * cos * of_p[2]) + cos * cos * of_q[2]
        slope = along - scale * (spread - C_across * C_across / variance)
        turn = across / slope if slope > 0 else math.atan2(across, along)
        turn = max(min(turn, MAX_TURN), -MAX_TURN)
        angle += turn
        if IS_PHI[row]:
            kappa = max(min(along / max(m, TINY), 1.0), 0.0)
        if max(abs(turn), abs(kappa - last)) < DIRECTION_TOLERANCE:
            break
    return angle, kappa


def _find_tangent(
    ellipsoid: Ellipsoid, rho: float, side: float
) -> tuple[tuple[float, float], float, complex]:
    """Return normal, radius and point of contact of a tangent from d = 0 to the ellipse of d."""
    first, mixed, second = _root(ellipsoid)
    white = _whitened(ellipsoid)
    distance = max(abs(white), TINY)
    rho = min(rho, MAX_TANGENT * distance)
    sine = rho / distance
    step = sine * white * complex(-sine, side * math.sqrt(1 - sine * sine))
    contact = white + step
    d = complex(first * contact.real, mixed * contact.real + second * contact.imag)
    return _unwhitened(ellipsoid, step), rho, d


def _root(ellipsoid: Ellipsoid) -> tuple[float, float, float]:
    """Return the Cholesky factor (row by row) of the shape of (p, q)."""
    _, (_, pp, pq), (_, _, qq) = ellipsoid.shape
    first = math.sqrt(max(pp, TINY))
    mixed = pq / first
    return first, mixed, math.sqrt(max(qq - mixed * mixed, TINY))


def _whitened(ellipsoid: Ellipsoid) -> complex:
    """Return the centre d of an ellipsoid, as seen from d = 0 in sigmas."""
    first, mixed, second = _root(ellipsoid)
    p = ellipsoid.centre[1] / first
    return complex(p, (ellipsoid.centre[2] - mixed * p) / second)


def _unwhitened(ellipsoid: Ellipsoid, direction: complex) -> tuple[float, float]:
    """Return the gradient by (p, q) of a linear function with a gradient in sigmas."""
    first, mixed, second = _root(ellipsoid)
    by_q = direction.imag / second
    return (direction.real - mixed * by_q) / first, by_q


def _circle_extremum(
    row: int, ellipsoid: Ellipsoid, centre: FloatArray, expansion: Expansion, surplus: float
) -> FloatArray:
    """Return the extremum on d = 0, where b = m - |d| has a ridge, of radius or centre.

    `expansion` is that of this row alone, and `surplus` the squared radius of the section d = 0.
    """
    f = np.array(RIDGE_GRADIENTS[row])
    covariance = np.linalg.inv(expansion.information[:3, :3])
    end = centre + expansion.covariance[:, 3:] @ _unwhitened(ellipsoid, -_whitened(ellipsoid))
    end[:3] += math.sqrt(surplus / (f @ covariance @ f)) * covariance @ f
    end[3:] = 0.0
    return end
