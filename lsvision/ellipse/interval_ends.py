"""Ends of intervals: the extrema of five quantities over {F <= min F + c}, computed together.

Each end is a row of parameters (centre_x, centre_y, m, p, q). An iteration expands F to second
order at every row, so that the region is an ellipsoid, and moves the row to the extremum of its
quantity over that ellipsoid (`lsvision.ellipse.region_extrema`). Convergence is quadratic. One more
row is the best circle, the minimum of F on d = 0.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, apply, expand_cost, flattening
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.region_extrema import (
    CIRCLE,
    DIRECTED,
    IS_PHI,
    PHI_LOW,
    ROWS,
    SECOND_ROWS,
    THETA_HIGH,
    THETA_LOW,
    TINY,
    Region,
    Targets,
)
from lsvision.geometry import BoolArray, FloatArray
from lsvision.geometry.noisy_points import ComplexArray

FIRST_ROUNDS, ROUNDS = 4, 2
"""Numbers of Newton steps of the direction u, at the start and in each iteration."""
SAME_DIRECTION = 0.99
"""Cosine of the angle between two directions above which both lead to the same extremum."""
MAX_EVALUATIONS = 20
"""Largest number of iterations. One to three suffice on an arc over 90 deg; where 20 do not, the
end of the region is too far away to be of use."""
MAX_RESTARTS = 2
"""Largest number of restarts of rows from a point further out that another row found."""
STEP_TOLERANCE, RATIO_TOLERANCE, CRITICAL_TOLERANCE = 0.15, 0.06, 0.005
"""Limits of convergence: length of the last step in radii of the region; difference of F - min F
from c, and of c from its last value, as fractions of c. The error of the end is quadratic in them,
about 0.3 % of the width."""
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
CRITICAL_SLACK, SURPASSING_SHARE = 1.001, 0.02
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


class _State(NamedTuple):
    """State of the iteration: parameters (13, 5), expansion, targets, step factors, flags (13,)."""

    parameters: FloatArray
    expansion: Expansion
    targets: Targets
    reduction: FloatArray
    wanted: BoolArray
    active: BoolArray


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
        region = Region(fit, ratios, expand_cost(fit, fit.parameters[None]))
        state = _start(region, wanted)
        for _ in range(1 + MAX_RESTARTS):
            for _ in range(MAX_EVALUATIONS):
                if not state.active.any():
                    break
                state = _advance(region, state)
            state = _restart_surpassed(region, state)
            if not state.active.any():
                break
    reliable = not state.active.any()
    return EndPoints(state.parameters, state.wanted, state.targets.circle_ratio, reliable)


def _start(region: Region, wanted: BoolArray) -> _State:
    """Return the initial state: all rows at the estimate, with targets from its expansion."""
    parameters = np.repeat(region.fit.parameters[None], ROWS, axis=0)
    expansion = Expansion(*(np.repeat(field, ROWS, axis=0) for field in region.best))
    angles, kappas = region.search_directions()
    critical = np.full(ROWS, region.ratios.one)
    targets = Targets(parameters, angles, kappas, critical, math.inf)
    rounds = FIRST_ROUNDS if wanted[:DIRECTED].any() else 0
    targets = region.find_targets(parameters, expansion, targets, rounds)
    targets.parameters[CIRCLE] = _fit_circle(region.fit)
    active = wanted.copy()
    active[CIRCLE] &= region.ratios.may_be_circle
    for first, second in SECOND_ROWS.items():
        angle, d = targets.angles[second], targets.parameters[second, 3:]
        same = math.cos(angle - targets.angles[first]) > SAME_DIRECTION
        active[second] &= not same and math.cos(angle) * d[0] + math.sin(angle) * d[1] > 0
    return _State(parameters, expansion, targets, np.ones(ROWS), active, active.copy())


def _fit_circle(fit: EllipseFit) -> FloatArray:
    """Return the parameters (5,) of the algebraic circle of the points."""
    points, weights = fit.problem.points, 1 / fit.problem.stds
    origin = points.mean(axis=0)
    centred = points - origin
    rows = np.column_stack([2 * centred, np.ones(len(centred))]) * weights[:, None]
    x, y, power = np.linalg.lstsq(rows, (centred**2).sum(axis=1) * weights)[0]
    return np.array([origin[0] + x, origin[1] + y, math.sqrt(power + x * x + y * y), 0.0, 0.0])


def _advance(region: Region, state: _State) -> _State:
    """Move the active rows, expand F where they are, and find their next targets."""
    parameters, expansion, targets, reduction, wanted, active = state
    previous = targets.critical
    trial = _move(region.fit, parameters, targets.parameters, reduction * _step_shares(state))
    valid = np.hypot(trial[:, 3], trial[:, 4]) < MAX_FLATTENING * trial[:, 2]
    rows = np.flatnonzero(active & valid)
    moved = np.zeros(ROWS, dtype=bool)
    if rows.size:
        new = expand_cost(region.fit, trial[rows])
        limit = np.where(rows == CIRCLE, np.inf, MAX_RATIO * targets.critical[rows])
        near = new.cost_of_points - region.best.cost_of_points[0] < limit
        moved[rows[near]] = True
        expansion = expansion.replaced(rows, new, near)
        parameters = np.where(moved[:, None], trial, parameters)
    factor = np.where(moved, STEP_GROWTH, STEP_REDUCTION)
    reduction = np.minimum(factor * reduction, 1.0)
    rounds = ROUNDS if active[:DIRECTED].any() else 0
    targets = region.find_targets(parameters, expansion, targets, rounds)
    state = _State(parameters, expansion, targets, reduction, wanted.copy(), active)
    done = active & moved & _is_last_step(region, state, previous)
    if done[CIRCLE]:
        state.wanted[PHI_LOW] &= targets.circle_ratio > region.ratios.of_circle
        state.wanted[[THETA_LOW, THETA_HIGH]] &= not region.ratios.leaves_theta_open(
            targets.circle_ratio
        )
    final = _move(region.fit, parameters, targets.parameters, np.ones(ROWS))
    return state._replace(
        parameters=np.where(done[:, None], final, parameters),
        active=active & state.wanted & ~done,
    )


def _step_lengths(state: _State) -> FloatArray:
    """Return the steps to the targets in radii of the region, sqrt(delta' A delta / c)."""
    steps = state.targets.parameters - state.parameters
    squares = (apply(state.expansion.information, steps) * steps).sum(axis=1)
    lengths: FloatArray = np.sqrt(np.maximum(squares, 0.0) / state.targets.critical)
    return lengths


def _step_shares(state: _State) -> FloatArray:
    shares: FloatArray = np.minimum(1.0, MAX_STEP / np.maximum(_step_lengths(state), TINY))
    shares[CIRCLE] = 1.0
    return shares


def _is_last_step(region: Region, state: _State, previous: FloatArray) -> BoolArray:
    """Return whether the next step is the last of each row; `previous` is c (13,) one step ago."""
    critical, ratio = state.targets.critical, state.expansion.cost - region.best.cost
    last: BoolArray = _step_lengths(state) < STEP_TOLERANCE
    last &= np.abs(critical - previous) < CRITICAL_TOLERANCE * critical
    last[:CIRCLE] &= (np.abs(ratio - critical) < RATIO_TOLERANCE * critical)[:CIRCLE]
    least = state.targets.circle_ratio
    far = least > FAR_CIRCLE * region.ratios.of_circle
    last[CIRCLE] |= far and ratio[CIRCLE] < CIRCLE_PRECISION * least
    return last


def _move(
    fit: EllipseFit, parameters: FloatArray, targets: FloatArray, shares: FloatArray
) -> FloatArray:
    """Return the rows moved by a fraction of the step to the targets, in coordinates of an arc.

    The coordinates are the middle point of the arc, log m and d / m, in which the region of a short
    arc is more nearly an ellipsoid. A known radius or phi is a coordinate, too: steps preserve it.
    """
    steps = shares[:, None] * (targets - parameters)
    m, d, dm, dd = parameters[:, 2], flattening(parameters), steps[:, 2], flattening(steps)
    bent = _bend(fit, d / m, (dd - d * dm / m) / m)
    bent[~targets[:, 3:].any(axis=1) & (shares == 1)] = 0.0
    new_m = m * np.exp(np.clip(dm / m, -MAX_LOG_STEP, MAX_LOG_STEP))
    if fit.problem.known_radius is not None:
        u = np.where(d == 0, 1.0, d / np.abs(d))
        new_m = (m - np.abs(d) + dm - (dd * u.conj()).real) / (1 - np.abs(bent))
    w = _arc_middle(fit)
    new_d = new_m * bent
    centre = (parameters[:, :2] + steps[:, :2]) @ (1, 1j)
    centre += (m + dm - new_m) * w + (d + dd - new_d) * w.conjugate()
    return np.stack([centre.real, centre.imag, new_m, new_d.real, new_d.imag], axis=1)


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


def _restart_surpassed(region: Region, state: _State) -> _State:
    """Restart rows that have not converged, or for which another row found a more extreme value.

    Every end, and the estimate, lies in the regions of all rows whose c is not smaller: such a row
    restarts from the most extreme of these points.
    """
    estimate = region.fit.parameters
    candidates = np.vstack([state.parameters, estimate])
    critical = np.append(state.targets.critical, 0.0)
    sources = np.append(state.wanted & ~state.active, True)
    sources[CIRCLE] = False
    inside = sources[:, None] & (critical[:, None] < CRITICAL_SLACK * critical[:-1])
    heights = _heights(candidates, estimate)
    reached = np.where(inside, heights, -np.inf)
    ends, of_estimate = heights.diagonal().copy(), heights[ROWS]
    for first, second in SECOND_ROWS.items():
        if sources[second]:
            ends[[first, second]] = ends[[first, second]].max()
    surpassed = reached.max(axis=0) > ends + SURPASSING_SHARE * np.abs(ends - of_estimate)
    again = state.wanted & (state.active | surpassed)
    again[CIRCLE] = state.active[CIRCLE]
    return _restart(region, state, again, candidates[reached.argmax(axis=0)])


def _restart(region: Region, state: _State, again: BoolArray, starts: FloatArray) -> _State:
    """Return the state with some rows at new parameters (13, 5); only those are active."""
    rows = np.flatnonzero(again)
    if not rows.size:
        return state
    parameters = np.where(again[:, None], starts, state.parameters)
    new = expand_cost(region.fit, parameters[rows])
    expansion = state.expansion.replaced(rows, new, np.ones(rows.size, dtype=bool))
    d, directed = flattening(parameters[:DIRECTED]), again[:DIRECTED]
    kappas = np.abs(d) / parameters[:DIRECTED, 2]
    last = state.targets._replace(
        angles=np.where(directed, np.angle(d), state.targets.angles),
        kappas=np.where(directed & IS_PHI, kappas, state.targets.kappas),
    )
    targets = region.find_targets(parameters, expansion, last, ROUNDS)
    return _State(parameters, expansion, targets, np.ones(ROWS), state.wanted, again)


def _heights(parameters: FloatArray, estimate: FloatArray) -> FloatArray:
    """Return the quantity that each row maximises, (k, 13), for parameters (k, 5)."""
    x, y, m = parameters[:, :3].T
    d = flattening(parameters)
    h = np.abs(d)
    turn = np.angle(d * complex(*estimate[3:].tolist()).conjugate())
    b, kappa = m - h, h / m
    return np.stack([-b, b, -kappa, kappa, -b, kappa, -x, x, -y, y, -turn, turn, 0 * m], axis=1)


def _arc_middle(fit: EllipseFit) -> complex:
    """Return the unit vector w of the point in the middle of the arc."""
    x, y, m, p, q = fit.parameters.tolist()
    points = fit.problem.points
    offset = complex(*points[len(points) // 2].tolist()) - complex(x, y)
    w: complex = m * offset - complex(p, q) * offset.conjugate()
    return w / max(abs(w), TINY)
