"""Ends of intervals: the extrema of five quantities over {F <= min F + c}, computed together.

Each end is a row of parameters (centre_x, centre_y, m, p, q). An iteration expands F to second
order at every row, so that the region is an ellipsoid, and moves the row to the extremum of its
quantity over that ellipsoid (`lsvision.ellipse.region_extrema`). Convergence is quadratic. One more
row is the best circle, the minimum of F on d = 0.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, apply, centre_of, expand_cost, flattening
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.region_extrema import (
    CIRCLE,
    DIRECTED,
    PHI_LOW,
    PHI_ROWS,
    ROWS,
    SECOND_ROWS,
    THETA_HIGH,
    THETA_LOW,
    TINY,
    Region,
    Targets,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray

SAME_DIRECTION = 0.99
"""Cosine of the angle between two directions above which both lead to the same extremum."""
MAX_EVALUATIONS = 20, 4, 4
"""Largest numbers of iterations: from the estimate, and after each restart of rows from a point
further out that another row found. One or two suffice on an arc over 90 deg; where all these do
not, the end of the region is too far away to be of use."""
STEP_TOLERANCE, RATIO_TOLERANCE, CRITICAL_TOLERANCE = 0.25, 0.2, 0.007
"""Limits of convergence: length of the last step in radii of the region; difference of F - min F
from c, and of c from its last value, as fractions of c. The error of the end is quadratic in them,
at limit 1 % of the width."""
MAX_STEP = 2.5
"""Longest step, in radii of the region."""
MAX_LOG_STEP = 2.0
"""Largest change of log m in a step."""
MAX_RATIO = 6.0
"""Largest F - min F of the points over c after a step; a step beyond it is rejected."""
STEP_REDUCTION, STEP_GROWTH = 0.35, 1.5
"""Factors on the fraction of a step after a rejected (also: no ellipse) and an accepted step."""
MAX_FLATTENING = 0.998
"""Largest h / m of a step: an axis ratio of 1 to 1000."""
FAR_CIRCLE, CIRCLE_PRECISION = 2.0, 20.0
"""The search for the best circle ends, and a circle is excluded, if its predicted ratio exceeds the
critical one by the first factor, and the present ratio the predicted one by under the second."""
CRITICAL_SLACK, SURPASSING_FRACTION = 1.001, 0.02
"""Tolerance for rounding in the comparison of two c, and distance by which an end must be further
out than another one to replace it, as a fraction of half the width."""


class EndPoints(NamedTuple):
    """Extrema of all quantities.

    parameters (13, 5); wanted (13,): false for rows not needed; circle_ratio: F of the best circle
    less min F, or a value above all critical ones; reliable: false if a wanted row has not
    converged, or another row has a more extreme value of its quantity.
    """

    parameters: FloatArray
    wanted: BoolArray
    circle_ratio: float
    reliable: bool


def find_end_points(fit: EllipseFit, ratios: CriticalRatios, wanted: BoolArray) -> EndPoints:
    """Find the extrema of radius, centre, phi and theta over {F <= min F + c}, and the best circle.

    Parameters
    ----------
    fit : EllipseFit
        The fit.
    ratios : CriticalRatios
        Critical ratios c of the quantities.
    wanted : (13,) bool ndarray
        Rows to find.
    """
    with np.errstate(all="ignore"):  # steps to parameters without finite cost are rejected
        search = _Search.start(Region(fit, ratios, expand_cost(fit, fit.parameters[None])), wanted)
        for limit in MAX_EVALUATIONS:
            for _ in range(limit):
                if not search.rows.size:
                    break
                search.advance()
            search.restart_surpassed()
            if not search.rows.size:
                break
    reliable = not search.rows.size
    return EndPoints(search.ends, search.wanted, search.targets.circle_ratio, reliable)


@dataclass(slots=True)
class _Search:
    """Search for the ends.

    ends (13, 5), critical (13,), wanted (13,): what is found, its c, and whether it is needed;
    rows (k,): the rows that have not converged, with their parameters (k, 5), expansion, targets,
    lengths of the next step (k,), in radii of the region, and factors on them (k,).
    """

    region: Region
    ends: FloatArray
    critical: FloatArray
    wanted: BoolArray
    rows: IntArray
    parameters: FloatArray
    expansion: Expansion
    targets: Targets
    lengths: FloatArray
    reduction: FloatArray

    @classmethod
    def start(cls, region: Region, wanted: BoolArray) -> "_Search":
        """Start all rows at the estimate, with targets from its expansion."""
        wanted = wanted.copy()
        wanted[CIRCLE] &= region.ratios.may_be_circle
        rows = np.flatnonzero(wanted)
        ends = np.repeat(region.fit.parameters[None], ROWS, axis=0)
        critical = np.full(ROWS, region.ratios.one)
        angles, kappas = np.zeros((2, ROWS))
        if wanted[:DIRECTED].any():
            angles[:DIRECTED], kappas[:DIRECTED] = region.search_directions()
        last = Targets(ends, angles, kappas, critical, math.inf)
        search = cls(
            region, ends, critical, wanted, rows, ends[rows], region.best.rows(0 * rows),
            last.rows(wanted), critical[rows], np.ones(rows.size),
        )  # fmt: skip
        search._find_targets()
        search._drop_second_rows()
        return search

    def advance(self) -> None:
        """Move the rows, expand F where they are, find their next targets, drop the converged."""
        region, previous = self.region, self.targets.critical
        fractions = np.minimum(1.0, MAX_STEP / np.maximum(self.lengths, TINY))
        fractions[self.rows == CIRCLE] = 1.0
        fit, targets = region.fit, self.targets.parameters
        moved = self._accept(_move(fit, self.parameters, targets, self.reduction * fractions))
        factor = np.where(moved, STEP_GROWTH, STEP_REDUCTION)
        self.reduction = np.minimum(factor * self.reduction, 1.0)
        self._find_targets()
        done = moved & self._is_last_step(previous)
        if done.any():
            rows, targets = self.rows[done], self.targets.parameters[done]
            self.ends[rows] = _move(fit, self.parameters[done], targets, np.ones(len(rows)))
            self.critical[rows] = self.targets.critical[done]
            if CIRCLE in rows:
                self._decide_by_circle()
            self._keep(~done & self.wanted[self.rows])

    def restart_surpassed(self) -> None:
        """Restart rows that have not converged, or where another row has a more extreme value.

        Every end, and the estimate, lies in the regions of all rows whose c is not smaller: such a
        row restarts from the limit extreme of these points.
        """
        estimate = self.region.fit.parameters
        active = np.zeros(ROWS, dtype=bool)
        active[self.rows] = True
        self.critical[self.rows] = self.targets.critical
        candidates = np.concatenate([self.ends, estimate[None]])
        critical = np.append(self.critical, 0.0)
        sources = np.append(self.wanted & ~active, True)
        sources[CIRCLE] = False
        inside = sources[:, None] & (critical[:, None] < CRITICAL_SLACK * critical[:-1])
        heights = _heights(candidates, estimate)
        reached = np.where(inside, heights, -np.inf)
        ends, of_estimate = heights.diagonal().copy(), heights[ROWS]
        for first, second in SECOND_ROWS.items():
            if sources[second]:
                ends[[first, second]] = ends[[first, second]].max()
        surpassed = reached.max(axis=0) > ends + SURPASSING_FRACTION * np.abs(ends - of_estimate)
        again = self.wanted & (active | surpassed)
        again[CIRCLE] = active[CIRCLE]
        if again.any():
            self.rows = np.flatnonzero(again)
            self.parameters = candidates[reached.argmax(axis=0)[again]]
            self.expansion = expand_cost(self.region.fit, self.parameters)
            self.reduction = np.ones(self.rows.size)
            d, m = flattening(self.parameters), self.parameters[:, 2]
            kappas = np.where(np.isin(self.rows, PHI_ROWS), np.abs(d) / m, 1.0)
            self.targets = self.targets._replace(
                angles=np.angle(d), kappas=kappas, critical=self.critical[again]
            )
            self._find_targets()

    def _find_targets(self) -> None:
        self.targets = self.region.find_targets(
            self.rows, self.parameters, self.expansion, self.targets
        )
        steps = self.targets.parameters - self.parameters
        squares = (apply(self.expansion.information, steps) * steps).sum(axis=1)
        self.lengths = np.sqrt(np.maximum(squares, 0.0) / self.targets.critical)

    def _drop_second_rows(self) -> None:
        """Drop second rows that start in the first's direction, or with d opposite to theirs."""
        positions = {row: i for i, row in enumerate(self.rows.tolist())}
        for first, second in SECOND_ROWS.items():
            if self.wanted[second]:
                i, angles = positions[second], self.targets.angles
                cos, sin = math.cos(angles[i]), math.sin(angles[i])
                _, _, _, p, q = self.targets.parameters[i].tolist()
                same = math.cos(angles[i] - angles[positions[first]]) > SAME_DIRECTION
                self.wanted[second] = not same and cos * p + sin * q > 0
        self._keep(self.wanted[self.rows])

    def _accept(self, trial: FloatArray) -> BoolArray:
        """Move to trial parameters (k, 5) where F is not too large; return which rows moved."""
        moved = np.hypot(trial[:, 3], trial[:, 4]) < MAX_FLATTENING * trial[:, 2]
        if moved.any():
            new = expand_cost(self.region.fit, trial[moved])
            ratio = new.cost_of_points - self.region.best.cost_of_points[0]
            near = ratio < MAX_RATIO * self.targets.critical[moved]
            near |= self.rows[moved] == CIRCLE
            moved[moved] = near
            if moved.all():
                self.parameters, self.expansion = trial, new
                return moved
            self.parameters[moved] = trial[moved]
            for field, values in zip(self.expansion, new, strict=True):
                field[moved] = values[near]
        return moved

    def _is_last_step(self, previous: FloatArray) -> BoolArray:
        """Return whether the next step of each row is its last; `previous` is c one step ago."""
        critical, circle_ratio = self.targets.critical, self.targets.circle_ratio
        ratio = self.expansion.cost - self.region.best.cost
        circle = self.rows == CIRCLE
        last: BoolArray = self.lengths < STEP_TOLERANCE
        last &= np.abs(critical - previous) < CRITICAL_TOLERANCE * critical
        last &= circle | (np.abs(ratio - critical) < RATIO_TOLERANCE * critical)
        if circle_ratio > FAR_CIRCLE * self.region.ratios.of_circle:
            last |= circle & (ratio < CIRCLE_PRECISION * circle_ratio)
        return last

    def _decide_by_circle(self) -> None:
        """Drop the rows whose interval is decided by the ratio of the best circle."""
        ratios, circle_ratio = self.region.ratios, self.targets.circle_ratio
        self.wanted[PHI_LOW] &= circle_ratio > ratios.of_circle
        self.wanted[[THETA_LOW, THETA_HIGH]] &= not ratios.leaves_theta_open(circle_ratio)

    def _keep(self, chosen: BoolArray) -> None:
        """Keep only some of the active rows."""
        if not chosen.all():
            self.rows, self.parameters = self.rows[chosen], self.parameters[chosen]
            self.expansion, self.targets = self.expansion.rows(chosen), self.targets.rows(chosen)
            self.lengths, self.reduction = self.lengths[chosen], self.reduction[chosen]


def _move(
    fit: EllipseFit, parameters: FloatArray, targets: FloatArray, fractions: FloatArray
) -> FloatArray:
    """Return the rows moved by a fraction of the step to the targets, in coordinates of an arc.

    The coordinates are the middle point of the arc, log m and d / m, in which the region of a short
    arc is more nearly an ellipsoid. A known radius or phi is a coordinate, too: steps preserve it.
    """
    steps = fractions[:, None] * (targets - parameters)
    m, d, dm, dd = parameters[:, 2], flattening(parameters), steps[:, 2], flattening(steps)
    bent = _bend(fit, d / m, (dd - d * dm / m) / m)
    bent[~targets[:, 3:].any(axis=1) & (fractions == 1)] = 0.0
    new_m = m * np.exp(np.minimum(np.maximum(dm / m, -MAX_LOG_STEP), MAX_LOG_STEP))
    if fit.problem.known_radius is not None:
        u = np.where(d == 0, 1.0, d / np.abs(d))
        new_m = (m - np.abs(d) + dm - (dd * u.conj()).real) / (1 - np.abs(bent))
    w = _arc_middle(fit)
    new_d = new_m * bent
    moved = parameters + steps
    centre_of(moved)[:] += (m + dm - new_m) * w + (d + dd - new_d) * w.conjugate()
    moved[:, 2], flattening(moved)[:] = new_m, new_d
    return moved


def _bend(fit: EllipseFit, delta: ComplexArray, step: ComplexArray) -> ComplexArray:
    """Return d / m after a step, linear in phi if a prior on phi excludes a circle."""
    known, bent = fit.problem.known_phi, delta + step
    if known is None or known.includes_circle:
        return bent
    kappa = np.abs(delta)
    root = np.sqrt(kappa)
    phi = 2 * np.arctan(root) + (step * delta.conj()).real / (kappa * root * (1 + kappa))
    kept: ComplexArray = np.tan(np.clip(phi, 0.0, np.pi / 2) / 2) ** 2 * bent / np.abs(bent)
    return kept


def _heights(parameters: FloatArray, estimate: FloatArray) -> FloatArray:
    """Return the quantity that each row maximises, (k, 13), for parameters (k, 5)."""
    x, y, m = parameters[:, :3].T
    d = flattening(parameters)
    h = np.abs(d)
    turn = np.angle(d * complex(*estimate[3:].tolist()).conjugate())
    b, kappa = m - h, h / m
    return np.array([-b, b, -kappa, kappa, -b, kappa, -x, x, -y, y, -turn, turn, 0 * m]).T


def _arc_middle(fit: EllipseFit) -> complex:
    """Return the unit vector w of the point in the middle of the arc."""
    x, y, m, p, q = fit.parameters.tolist()
    points = fit.problem.points
    offset = complex(*points[len(points) // 2].tolist()) - complex(x, y)
    w: complex = m * offset - complex(p, q) * offset.conjugate()
    return w / max(abs(w), TINY)
