"""Extrema of five quantities over ellipsoids: the targets of a step towards the ends of intervals.

About parameters (centre_x, centre_y, m, p, q) the region {F <= min F + c} is an ellipsoid with
centre mu, radius rho and shape C. The quantities are not approximated: each is linear for a fixed
direction of d = (p, q), so its extremum is ``mu + rho C f / |f|_C``, with f the gradient for that
direction:

- centre: f is an axis;
- theta: f is normal to the tangent from the circle d = 0 to the ellipsoid;
- radius and phi: f = +/- (u . d - kappa m), with u the direction of d at the extremum itself, found
  by Newton's method on its angle, and kappa = 1 for the radius, h / m for phi;
- best circle: f leads from the centre to the nearest point with d = 0.

Everything by row is computed in plain floats, which for so few numbers is faster than arrays.
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
PHI_ROWS = (PHI_LOW, PHI_HIGH, PHI_HIGH_2)
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
"""Sense of rotation from the estimate to the tangent of each end of theta."""

SEARCHED_ANGLES = np.radians(np.arange(0.0, 360.0, 15.0))
"""Initial directions of d for radius and phi. Units: rad."""
SEARCHED = np.stack([0 * SEARCHED_ANGLES, np.cos(SEARCHED_ANGLES), np.sin(SEARCHED_ANGLES)], axis=1)
"""The same as gradients by (m, p, q)."""
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


Gradient = tuple[float, float]


class Targets(NamedTuple):
    """Targets of a step: parameters (k, 5), angles, kappas and c (k,), and min F on d = 0."""

    parameters: FloatArray
    angles: FloatArray
    kappas: FloatArray
    critical: FloatArray
    circle_ratio: float

    def rows(self, chosen: BoolArray) -> "Targets":
        """Return the targets of some rows."""
        first, angles, kappas, critical = (field[chosen] for field in self[:4])
        return Targets(first, angles, kappas, critical, self.circle_ratio)


class Ellipsoid(NamedTuple):
    """Section (m, p, q) of an ellipsoid: centre, shape (3 rows), squared radius less c."""

    centre: Sequence[float]
    shape: Sequence[Sequence[float]]
    excess: float

    def to_circle(self) -> tuple[Gradient, float]:
        """Return the gradient by (p, q) whose extremum is a circle, and its distance in sigmas."""
        white = self._root_and_centre()[1]
        return self._gradient(-white), abs(white)

    def find_tangent(self, rho: float, side: float) -> tuple[Gradient, float, complex]:
        """Return normal, radius and point of contact of a tangent from d = 0 to the ellipse."""
        (first, mixed, second), white = self._root_and_centre()
        distance = max(abs(white), TINY)
        rho = min(rho, MAX_TANGENT * distance)
        sine = rho / distance
        step = sine * white * complex(-sine, side * math.sqrt(1 - sine * sine))
        contact = white + step
        d = complex(first * contact.real, mixed * contact.real + second * contact.imag)
        return self._gradient(step), rho, d

    def _root_and_centre(self) -> tuple[tuple[float, float, float], complex]:
        """Return the Cholesky factor of the shape of d by rows, and d of the centre in sigmas."""
        (_, p, q), (_, (_, pp, pq), (_, _, qq)), _ = self
        first = math.sqrt(max(pp, TINY))
        mixed = pq / first
        second = math.sqrt(max(qq - mixed * mixed, TINY))
        return (first, mixed, second), complex(p / first, (q - mixed * p / first) / second)

    def _gradient(self, direction: complex) -> Gradient:
        """Return the gradient by (p, q) of a linear function from that in sigmas."""
        first, mixed, second = self._root_and_centre()[0]
        by_q = direction.imag / second
        return (direction.real - mixed * by_q) / first, by_q


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
        f, rho = np.zeros((len(names), PARAMETERS)), [0.0] * len(names)
        for i, (row, ellipsoid) in enumerate(zip(names, ellipsoids, strict=True)):
            rho[i] = math.sqrt(max(ellipsoid.excess + critical[i], 0.0))
            if row < DIRECTED:
                f[i, 2:] = -kappas[i], math.cos(angles[i]), math.sin(angles[i])
                f[i] *= OUTWARD[row]
            elif row in RIDGE_GRADIENTS:
                f[i, :3] = RIDGE_GRADIENTS[row]
            elif row == CIRCLE:
                f[i, 3:], rho[i] = ellipsoid.to_circle()
            else:
                f[i, 3:], rho[i], contact = ellipsoid.find_tangent(rho[i], SIDES[row])
                critical[i] = self.ratios.of_direction(contact)
        Cf = apply(expansion.covariance, f)
        scale = np.array(rho) / np.sqrt(np.maximum((f * Cf).sum(axis=1), TINY))
        ends = centres + scale[:, None] * Cf
        circle_ratio = last.circle_ratio
        if CIRCLE in names:
            i = names.index(CIRCLE)
            ends[i, 3:], circle_ratio = 0.0, rho[i] ** 2 - ellipsoids[i].excess
        sections = list(zip(ellipsoids, rho, strict=True))
        self._put_on_circles(names, ends, parameters, expansion, sections)
        return Targets(ends, np.array(angles), np.array(kappas), np.array(critical), circle_ratio)

    def _put_on_circles(
        self,
        rows: Sequence[int],
        ends: FloatArray,
        parameters: FloatArray,
        expansion: Expansion,
        sections: Sequence[tuple[Ellipsoid, float]],
    ) -> None:
        """Replace ends that are circles.

        On d = 0 the radius b = m - |d| has a ridge. The largest radius, and with a known radius any
        extremum on the surface b = const, lies on the ridge if F of the points increases faster
        across it than along m.
        """
        ridge_rows = RIDGE_GRADIENTS if self.fit.problem.known_radius else (RADIUS_HIGH,)
        for i, (row, (ellipsoid, rho)) in enumerate(zip(rows, sections, strict=True)):
            if row not in ridge_rows:
                continue
            to_circle, distance = ellipsoid.to_circle()
            if rho > distance:
                f, covariance = (
                    RIDGE_GRADIENTS[row],
                    np.linalg.inv(expansion.information[i, :3, :3]),
                )
                Cf = covariance @ f
                end = parameters[i] - expansion.covariance[i] @ expansion.gradient[i]
                end += expansion.covariance[i, :, 3:] @ to_circle
                end[:3] += math.sqrt((rho * rho - distance * distance) / (f @ Cf)) * Cf
                end[3:] = 0.0
                slope = expansion.information_of_points[i] @ (end - parameters[i])
                slope += expansion.gradient_of_points[i]
                if math.hypot(slope[3], slope[4]) <= slope[2]:
                    ends[i] = end

    def search_directions(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and kappas (6,) near the extrema over the ellipsoid at the estimate."""
        _, _, m, p, q = self.fit.parameters.tolist()
        shape, sign = self.best.covariance[0, 2:, 2:], np.array(OUTWARD)[:, None]
        kappas = np.ones(DIRECTED)
        kappas[list(PHI_ROWS)] = math.hypot(p, q) / m
        f = np.repeat(SEARCHED[None], DIRECTED, axis=0)
        f[:, :, 0] = -kappas[:, None]
        std = np.sqrt(self.ratios.one * ((f @ shape) * f).sum(axis=2))
        height = f @ (m, p, q) + sign * std
        chosen = height.argmax(axis=1)
        opposite = np.cos(SEARCHED_ANGLES - SEARCHED_ANGLES[chosen][:, None]) < 0
        second = list(SECOND_ROWS.values())
        chosen[second] = np.where(opposite, height, -np.inf)[second].argmax(axis=1)
        return SEARCHED_ANGLES[chosen], kappas

    def _find_directions(
        self, rows: Sequence[int], ellipsoids: Sequence[Ellipsoid], last: Targets
    ) -> tuple[list[float], list[float], list[float]]:
        """Return angles, kappas and c (k,); those of rows without a direction are the last ones."""
        angles, kappas, critical = (field.tolist() for field in last[1:4])
        directed = [i for i, row in enumerate(rows) if row < DIRECTED]
        phis = [i for i in directed if rows[i] in PHI_ROWS]
        for _ in range(CRITICAL_ROUNDS):
            for i in directed:
                angles[i], kappas[i] = _find_direction(
                    rows[i], ellipsoids[i], angles[i], kappas[i], critical[i]
                )
            directed = phis
            new = self.ratios.of_flattening([kappas[i] for i in phis])
            for i, c in zip(phis, new, strict=True):
                if c == critical[i]:
                    directed = [each for each in directed if each != i]
                critical[i] = c
            if not directed:
                break
        return angles, kappas, critical


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
        if row in PHI_ROWS:
            kappa = max(min(along / max(m, TINY), 1.0), 0.0)
        if max(abs(turn), abs(kappa - last)) < DIRECTION_TOLERANCE:
            break
    return angle, kappa
