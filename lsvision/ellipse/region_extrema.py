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
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, apply
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.parameters import PARAMETERS
from lsvision.geometry import FloatArray

RADIUS_LOW, RADIUS_HIGH, PHI_LOW, PHI_HIGH, RADIUS_LOW_2, PHI_HIGH_2 = range(6)
X_LOW, X_HIGH, Y_LOW, Y_HIGH, THETA_LOW, THETA_HIGH, CIRCLE = range(6, 13)
DIRECTED, ROWS = 6, 13
"""Number of rows that have a direction u, which come first, and of all rows."""
SECOND_ROWS = {RADIUS_LOW: RADIUS_LOW_2, PHI_HIGH: PHI_HIGH_2}
"""The smallest radius and the largest phi may have two local extrema, with opposite d."""
OUTWARD = np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
"""+1 for the ends of largest h, -1 for those of smallest."""
IS_PHI = np.array([False, False, True, True, False, True])
RIDGE_ROWS = {
    RADIUS_HIGH: np.array([0.0, 0.0, 1.0]),
    X_LOW: np.array([-1.0, 0.0, 0.0]),
    X_HIGH: np.array([1.0, 0.0, 0.0]),
    Y_LOW: np.array([0.0, -1.0, 0.0]),
    Y_HIGH: np.array([0.0, 1.0, 0.0]),
}
"""Rows whose end may be a circle, with their gradient by (x, y, m) there."""

SEARCHED_ANGLES, SEARCH_ROUNDS = 48, 3
"""Number of initial directions of d for radius and phi, 7.5 deg apart, and of updates of kappa."""
MAX_TURN = 0.7
"""Longest Newton step of the direction u. Units: rad."""
MAX_TANGENT = 0.98
"""Largest sine of half the angle that the ellipsoid subtends at the circle: a circle inside the
ellipsoid has no tangent to it."""
TINY = 1e-300


class Targets(NamedTuple):
    """Targets of a step: parameters (13, 5), angles and kappas (6,), c (13,), min F on d = 0."""

    parameters: FloatArray
    angles: FloatArray
    kappas: FloatArray
    critical: FloatArray
    circle_ratio: float


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """Region {F <= min F + c} of a fit; `best` is the expansion at the estimate."""

    fit: EllipseFit
    ratios: CriticalRatios
    best: Expansion

    def find_targets(
        self, parameters: FloatArray, expansion: Expansion, last: Targets, rounds: int
    ) -> Targets:
        """Return the extrema over the ellipsoids of the expansion at each row."""
        to_centre = apply(expansion.covariance, expansion.gradient)
        centres = parameters - to_centre
        # Squared radius of each ellipsoid less c.
        excess = self.best.cost - expansion.cost + (expansion.gradient * to_centre).sum(axis=1)
        directed = slice(0, DIRECTED)
        angles, kappas, critical = self._find_directions(
            centres[directed, 2:], expansion.covariance[directed, 2:, 2:], excess[directed], last,
            rounds,
        )  # fmt: skip
        critical = np.concatenate([critical, last.critical[DIRECTED:]])
        f = np.zeros((ROWS, PARAMETERS))
        f[:DIRECTED, 2:] = _directed_gradients(angles, kappas)
        f[[X_LOW, X_HIGH, Y_LOW, Y_HIGH], [0, 0, 1, 1]] = -1, 1, -1, 1
        rho = np.sqrt(np.maximum(excess + critical, 0.0))
        for row, side in ((THETA_LOW, -1.0), (THETA_HIGH, 1.0)):
            shape = expansion.covariance[row, 3:, 3:]
            f[row, 3:], rho[row], tangent = _find_tangent(centres[row, 3:], shape, rho[row], side)
            critical[row] = self.ratios.of_direction(tangent)
        Cf = apply(expansion.covariance, f)
        scale = rho / np.sqrt(np.maximum((f * Cf).sum(axis=1), TINY))
        targets = centres + scale[:, None] * Cf
        circle_ratio = self._put_on_circles(parameters, expansion, critical, targets)
        return Targets(targets, angles, kappas, critical, circle_ratio)

    def search_directions(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and kappas (6,) of the extrema over the ellipsoid at the estimate."""
        centre = (self.fit.parameters - apply(self.best.covariance, self.best.gradient)[0])[2:]
        shape, critical = self.best.covariance[0, 2:, 2:], self.ratios.one
        turns = np.linspace(0, 2 * np.pi, SEARCHED_ANGLES, endpoint=False)
        u = np.stack([np.ones(SEARCHED_ANGLES), np.cos(turns), np.sin(turns)], axis=1)
        rows, sign = np.arange(DIRECTED), OUTWARD[:, None]
        kappas = np.where(IS_PHI, math.hypot(*centre[1:]) / centre[0], 1.0)
        for _ in range(SEARCH_ROUNDS):
            f = u * np.stack([-kappas, np.ones(DIRECTED), np.ones(DIRECTED)], axis=1)[:, None]
            Cf = f @ shape
            std = np.sqrt(critical * (f * Cf).sum(axis=2))
            height = f @ centre + sign * std
            chosen = height.argmax(axis=1)
            ends = centre + (sign * critical / std[rows, chosen][:, None]) * Cf[rows, chosen]
            along = (u[chosen, 1:] * ends[:, 1:]).sum(axis=1)
            kappas = np.where(IS_PHI, np.clip(along / np.maximum(ends[:, 0], TINY), 0, 1), 1.0)
        opposite = np.cos(turns - turns[chosen][:, None]) < 0
        second = list(SECOND_ROWS.values())
        chosen[second] = np.where(opposite, height, -np.inf)[second].argmax(axis=1)
        return turns[chosen], kappas

    def _find_directions(
        self,
        centres: FloatArray,
        shapes: FloatArray,
        excess: FloatArray,
        last: Targets,
        rounds: int,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angles, kappas and c (6,) of the directed rows, from ellipsoids of (m, p, q)."""
        angles, kappas, critical = last.angles, last.kappas, last.critical[:DIRECTED].copy()
        for _ in range(rounds):
            cos, sin = np.cos(angles), np.sin(angles)
            f = _directed_gradients(angles, kappas)
            Cf = apply(shapes, f)
            variance = (f * Cf).sum(axis=1)
            scale = np.sqrt(np.maximum(excess + critical, 0.0) / variance)
            m, p, q = (centres + scale[:, None] * Cf).T
            # At the extremum d has the direction u: no component across it.
            along, across = cos * p + sin * q, cos * q - sin * p
            spread = sin * (sin * shapes[:, 1, 1] - 2 * cos * shapes[:, 1, 2])
            spread += cos * cos * shapes[:, 2, 2]
            spread -= (cos * Cf[:, 2] - sin * Cf[:, 1]) ** 2 / variance
            slope = along - OUTWARD * scale * spread
            turn = np.where(slope > 0, across / slope, np.arctan2(across, along))
            angles = angles + np.clip(turn, -MAX_TURN, MAX_TURN)
            kappas = np.where(IS_PHI, np.clip(along / np.maximum(m, TINY), 0.0, 1.0), 1.0)
            critical[IS_PHI] = self.ratios.of_flattening(kappas[IS_PHI])
        return angles, kappas, critical

    def _put_on_circles(
        self,
        parameters: FloatArray,
        expansion: Expansion,
        critical: FloatArray,
        targets: FloatArray,
    ) -> float:
        """Replace targets that are circles, and return the smallest F of circles, less min F.

        On d = 0 the radius b = m - |d| has a ridge. The largest radius, and with a known radius any
        extremum on the surface b = const, lies on the ridge if F of the points increases faster
        across it than along m.
        """
        level = self.best.cost[0] + critical
        for row, f in RIDGE_ROWS.items():
            if row != RADIUS_HIGH and self.fit.problem.known_radius is None:
                continue
            end, covariance, least = _circle_section(parameters, expansion, row)
            if least < level[row]:
                end[:3] += math.sqrt((level[row] - least) / (f @ covariance @ f)) * covariance @ f
                step = end - parameters[row]
                slope = expansion.information_of_points[row] @ step
                slope += expansion.gradient_of_points[row]
                if math.hypot(slope[3], slope[4]) <= slope[2]:
                    targets[row] = end
        if not self.ratios.may_be_circle:
            return math.inf
        targets[CIRCLE], _, least = _circle_section(parameters, expansion, CIRCLE)
        return least - float(self.best.cost[0])


def _directed_gradients(angles: FloatArray, kappas: FloatArray) -> FloatArray:
    """Return the gradients of +/- (u . d - kappa m) by (m, p, q), (6, 3)."""
    gradients: FloatArray = OUTWARD[:, None] * np.stack(
        [-kappas, np.cos(angles), np.sin(angles)], axis=1
    )
    return gradients


def _find_tangent(
    centre: FloatArray, shape: FloatArray, rho: float, side: float
) -> tuple[FloatArray, float, FloatArray]:
    """Return normal, radius and point of contact of a tangent from 0 to an ellipse in the plane."""
    first = math.sqrt(max(shape[0, 0], TINY))
    mixed = shape[1, 0] / first
    root = np.array([[first, 0.0], [mixed, math.sqrt(max(shape[1, 1] - mixed * mixed, TINY))]])
    white = np.linalg.solve(root, centre)
    distance = max(math.hypot(*white), TINY)
    rho = min(rho, MAX_TANGENT * distance)
    sine = rho / distance
    turned = side * np.array([-white[1], white[0]])
    step = sine * (math.sqrt(1 - sine * sine) * turned - sine * white)
    return np.linalg.solve(root.T, step), rho, root @ (white + step)


def _circle_section(
    parameters: FloatArray, expansion: Expansion, row: int
) -> tuple[FloatArray, FloatArray, float]:
    """Minimise the expansion at a row on d = 0; return parameters, covariance (x, y, m) and F."""
    A, b, d = expansion.information[row], expansion.gradient[row], -parameters[row, 3:]
    covariance = np.linalg.inv(A[:3, :3])
    slope = b[:3] + A[:3, 3:] @ d
    step = -covariance @ slope
    least = expansion.cost[row] + 2 * b[3:] @ d + d @ A[3:, 3:] @ d + slope @ step
    return np.append(parameters[row, :3] + step, [0.0, 0.0]), covariance, float(least)
