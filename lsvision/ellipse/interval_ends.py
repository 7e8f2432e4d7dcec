"""Ends of intervals: the extrema of five quantities over {F <= min F + c}, computed together.

Each end of each fit is a row of parameters (centre_x, centre_y, m, p, q); F, c and d = (p, q) are
those of `lsvision.ellipse.critical_ratio`. An iteration expands F to second order at every row, so
that the region is an ellipsoid, and moves the row to the extremum of its quantity over that
ellipsoid (`lsvision.ellipse.region_extrema`). Convergence is quadratic. One more row of a fit is
its best circle, the minimum of F on d = 0. The rows of all fits are moved at once: for the few
numbers of one fit, the calls of numpy would take most of the time.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, expand_cost, multiply_vectors
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import deviators_from_parameters
from lsvision.ellipse.region_extrema import (
    CIRCLE,
    DIRECTED,
    ENDS,
    IS_PHI,
    PHI_LOW,
    SECOND_ENDS,
    THETA_HIGH,
    THETA_LOW,
    Regions,
    Rows,
    Targets,
)
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, select_rows
from lsvision.geometry.noisy_points import ComplexArray, as_vectors

SAME_DIRECTION = 0.99
"""Cosine of the angle between two directions above which both lead to the same extremum."""
MAX_EVALUATIONS = 20, 4, 4
"""Largest numbers of iterations, each with one evaluation of F: from the estimate, and after each
restart of rows from a point further out that another row found. On an arc of more than 90 deg one
or two suffice; if all these are not enough, the end of the region is too far away to be useful."""
STEP_TOLERANCE, RATIO_TOLERANCE, CRITICAL_TOLERANCE = 0.25, 0.2, 0.007
"""Limits of convergence: length of the last step in radii of the region; difference of F - min F
from c, and of c from its last value, as fractions of c. The error of the end is quadratic in them;
at these limits it is 1 % of the width."""
MAX_STEP = 2.5
"""Longest step, in radii of the region."""
CROSSING_FRACTION, MIN_CROSSING_FRACTION = 0.7, 0.3
"""With a known radius: length of d in a step across the circle over |d|, and smallest fraction of
such a step. Without these limits one fit in ten of untilted pipes has intervals without ends."""
MAX_RATIO = 6.0
"""Largest F - min F over c after a step, without the priors or with them; a step beyond it is
rejected."""
STEP_REDUCTION, STEP_GROWTH = 0.35, 1.5
"""Factors on the fraction of a step: after a rejected step (which includes one that leads to no
ellipse), and after an accepted step."""
FIRST, SECOND = list(SECOND_ENDS), list(SECOND_ENDS.values())
"""Columns of the ends that may have two local extrema, and columns of their second extrema."""
MAX_FLATTENING = 0.998
"""Largest h / m of a step: an axis ratio of 1 to 1000."""
FAR_CIRCLE, CIRCLE_PRECISION = 2.0, 20.0
"""The search for the best circle ends, and a circle is excluded, if the predicted ratio is above
the first factor times the critical one, and the present ratio below the second factor times the
predicted one."""
CRITICAL_SLACK, SURPASSING_FRACTION = 1.001, 0.02
"""Tolerance for rounding in the comparison of two c, and distance by which an end must be further
out than another one to replace it, as a fraction of half the width."""


class IntervalEnds(NamedTuple):
    """Extrema of all quantities of s fits.

    Parameters
    ----------
    parameters : (s, 13, 5) ndarray
        Parameters (centre_x, centre_y, m, p, q) at each end. Units: mm.
    wanted : (s, 13) bool ndarray
        False for ends that are not needed.
    circle_ratios : (s,) ndarray
        F of the best circle less min F, or a value above all critical ones.
    reliable : (s, 13) bool ndarray
        False for an end whose quantity is more extreme at another end; for all ends of a fit if one
        of them has not converged.
    """

    parameters: FloatArray
    wanted: BoolArray
    circle_ratios: FloatArray
    reliable: BoolArray


def find_interval_ends(stack: FitStack, ratios: CriticalRatios, wanted: BoolArray) -> IntervalEnds:
    """Find the extrema of radius, centre, phi and theta over {F <= min F + c}, and best circles.

    Parameters
    ----------
    stack : FitStack
        The fits.
    ratios : CriticalRatios
        Critical ratios c of the quantities.
    wanted : (s, 13) bool ndarray
        Ends to find.

    Returns
    -------
    IntervalEnds
    """
    all_fits = np.arange(len(stack.fits))
    with np.errstate(all="ignore"):  # steps to parameters without finite cost are rejected
        best = expand_cost(stack, all_fits, stack.parameters)
        search = _Search.start(Regions(stack, ratios, best), wanted)
        for limit in MAX_EVALUATIONS:
            for _ in range(limit):
                if not search.rows.ends.size:
                    break
                search.advance()
            not_converged = search.rows.owners
            search.restart_surpassed()
            if not search.rows.ends.size:
                break
    reliable = np.ones(wanted.shape, dtype=bool)
    reliable[search.rows] = reliable[not_converged] = False
    return IntervalEnds(search.ends, search.wanted, search.targets.circle_ratios, reliable)


@dataclass(slots=True)
class _Search:
    """Search for the ends of s fits, of which k ends (rows) have not converged yet.

    Parameters
    ----------
    regions : Regions
        Regions {F <= min F + c} of the fits.
    ends : (s, 13, 5) ndarray
        Parameters at the converged ends; the estimates at others. Units: mm.
    critical : (s, 13) ndarray
        Critical ratio c at each end.
    wanted : (s, 13) bool ndarray
        Whether an end is needed.
    rows : Rows
        The k ends that have not converged.
    parameters : (k, 5) ndarray
        Their present parameters. Units: mm.
    expansion, targets : Expansion, Targets
        F about these parameters, and the extrema to which the next step leads.
    lengths : (k,) ndarray
        Length of the next step, in radii of the region.
    reduction : (k,) ndarray
        Factor on the next step: below 1 after rejected steps.
    """

    regions: Regions
    ends: FloatArray
    critical: FloatArray
    wanted: BoolArray
    rows: Rows
    parameters: FloatArray
    expansion: Expansion
    targets: Targets
    lengths: FloatArray
    reduction: FloatArray

    @classmethod
    def start(cls, regions: Regions, wanted: BoolArray) -> "_Search":
        """Start all rows at the estimates, with targets from their expansion."""
        wanted = wanted.copy()
        wanted[:, CIRCLE] &= regions.ratios.may_be_circle
        rows = Rows(*np.nonzero(wanted))
        ends = np.repeat(regions.stack.parameters[:, None], ENDS, axis=1)
        critical = np.repeat(regions.ratios.one_dof[:, None], ENDS, axis=1)
        angles, kappas = np.zeros((2, len(ends), ENDS))
        if wanted[:, :DIRECTED].any():
            angles[:, :DIRECTED], kappas[:, :DIRECTED] = regions.search_directions()
        circle_ratios = np.full(len(ends), math.inf)
        last = Targets(ends[rows], angles[rows], kappas[rows], critical[rows], circle_ratios)
        search = cls(
            regions, ends, critical, wanted, rows, ends[rows],
            select_rows(regions.best, rows.owners), last, critical[rows], np.ones(rows.ends.size),
        )  # fmt: skip
        search._find_targets()
        search._drop_second_ends()
        return search

    def advance(self) -> None:
        """Move the rows by a step, find their next targets, and drop those that have converged."""
        previous = self.targets.critical
        fractions = np.minimum(1.0, MAX_STEP / np.maximum(self.lengths, TINY))
        self._limit_crossing_steps(fractions)
        fractions[self.rows.ends == CIRCLE] = 1.0  # only a full step leads to d = 0
        moved = self._accept(self._move(self.reduction * fractions))
        factor = np.where(moved, STEP_GROWTH, STEP_REDUCTION)
        self.reduction = np.minimum(factor * self.reduction, 1.0)
        self._find_targets()
        done = moved & self._is_last_step(previous)
        if done.any():
            rows = select_rows(self.rows, done)
            self.ends[rows] = self._move(np.ones(done.size))[done]
            self.critical[rows] = self.targets.critical[done]
            self._decide_by_circles(rows.owners[rows.ends == CIRCLE])
            self._select_rows(~done & self.wanted[self.rows])

    def _limit_crossing_steps(self, fractions: FloatArray) -> None:
        """Shorten steps across the circle d = 0 of fits with a known radius, in place.

        Ellipses with the same b form a cone m = b + |d|, whose tangent plane leads away from it on
        the other side of the circle: full steps would alternate between both sides.
        """
        known = np.flatnonzero(self.regions.stack.known_radius[self.rows.owners])
        if known.size:
            d = deviators_from_parameters(self.parameters[known])
            steps = deviators_from_parameters(self.targets.parameters[known]) - d
            limits = CROSSING_FRACTION * np.abs(d) / np.maximum(np.abs(steps), TINY)
            crosses = ((steps + d) * d.conj()).real < 0
            limits = np.where(crosses, np.maximum(limits, MIN_CROSSING_FRACTION), 1.0)
            fractions[known] = np.minimum(fractions[known], limits)

    def restart_surpassed(self) -> None:
        """Restart ends that have not converged, or where another end has a more extreme value."""
        self.critical[self.rows] = self.targets.critical
        again, starts = self._find_surpassed()
        if again.any():
            self.rows = Rows(*np.nonzero(again))
            self.parameters = starts[self.rows]
            self.expansion = expand_cost(self.regions.stack, self.rows.owners, self.parameters)
            self.reduction = np.ones(self.rows.ends.size)
            d, m = deviators_from_parameters(self.parameters), self.parameters[:, 2]
            kappas = np.where(IS_PHI[self.rows.ends], np.abs(d) / m, 1.0)
            self.targets = self.targets._replace(
                angles=np.angle(d), kappas=kappas, critical=self.critical[self.rows]
            )
            self._find_targets()

    def _find_surpassed(self) -> tuple[BoolArray, FloatArray]:
        """Return which ends are restarted (s, 13), and the parameters (s, 13, 5) where they start.

        Every end of a fit, and its estimate, lies in the regions of all ends whose c is not
        smaller: an end starts from the most extreme of these points.
        """
        estimates = self.regions.stack.parameters[:, None]
        active = np.zeros(self.wanted.shape, dtype=bool)
        active[self.rows] = True
        candidates = np.concatenate([self.ends, estimates], axis=1)
        # The estimate, in the last column, lies in all regions: its c is 0.
        critical = np.pad(self.critical, ((0, 0), (0, 1)))
        sources = np.pad(self.wanted & ~active, ((0, 0), (0, 1)), constant_values=True)
        sources[:, CIRCLE] = False
        inside = sources[:, :, None] & (
            critical[:, :, None] < CRITICAL_SLACK * self.critical[:, None]
        )
        heights = _maximised_quantities(candidates, estimates)
        reached = np.where(inside, heights, -np.inf)
        ends = np.diagonal(heights, axis1=1, axis2=2).copy()
        both = np.maximum(ends[:, FIRST], ends[:, SECOND])
        for column in (FIRST, SECOND):
            ends[:, column] = np.where(sources[:, SECOND], both, ends[:, column])
        slack = SURPASSING_FRACTION * np.abs(ends - heights[:, ENDS])
        again = self.wanted & (active | (reached.max(axis=1) > ends + slack))
        again[:, CIRCLE] = active[:, CIRCLE]
        furthest = reached.argmax(axis=1)
        return again, candidates[np.arange(len(candidates))[:, None], furthest]

    def _find_targets(self) -> None:
        """Find the targets of the active rows and the lengths of the steps to them."""
        self.targets = self.regions.find_targets(
            self.rows, self.parameters, self.expansion, self.targets
        )
        steps = self.targets.parameters - self.parameters
        squares = (multiply_vectors(self.expansion.information, steps) * steps).sum(axis=1)
        self.lengths = np.sqrt(np.maximum(squares, 0.0) / self.targets.critical)

    def _drop_second_ends(self) -> None:
        """Drop second ends that start in the first's direction, or with d opposite to theirs."""
        angles, deviators = np.zeros(self.wanted.shape), np.zeros(self.wanted.shape, dtype=complex)
        angles[self.rows] = self.targets.angles
        deviators[self.rows] = deviators_from_parameters(self.targets.parameters)
        second_angles, d = angles[:, SECOND], deviators[:, SECOND]
        self.wanted[:, SECOND] &= np.cos(second_angles - angles[:, FIRST]) <= SAME_DIRECTION
        outward = np.cos(second_angles) * d.real + np.sin(second_angles) * d.imag
        self.wanted[:, SECOND] &= outward > 0
        self._select_rows(self.wanted[self.rows])

    def _move(self, fractions: FloatArray) -> FloatArray:
        """Return the rows moved by fractions of the steps to their targets."""
        owners, targets = self.rows.owners, self.targets.parameters
        return _move_rows(self.regions.stack, owners, self.parameters, targets, fractions)

    def _accept(self, trial: FloatArray) -> BoolArray:
        """Move to trial parameters (k, 5) where F is not too large; return which rows moved."""
        moved = np.hypot(trial[:, 3], trial[:, 4]) < MAX_FLATTENING * trial[:, 2]
        if moved.any():
            owners, ends = select_rows(self.rows, moved)
            new = expand_cost(self.regions.stack, owners, trial[moved])
            best = self.regions.best
            # The smaller increase counts: F with the priors is large off the curved surface of a
            # known radius, and F without them where a prior contradicts the points.
            ratio = np.minimum(
                new.cost - best.cost[owners], new.cost_of_points - best.cost_of_points[owners]
            )
            near = ratio < MAX_RATIO * self.targets.critical[moved]
            near |= ends == CIRCLE
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
        owners, critical = self.rows.owners, self.targets.critical
        ratio = self.expansion.cost - self.regions.best.cost[owners]
        circle = self.rows.ends == CIRCLE
        last: BoolArray = self.lengths < STEP_TOLERANCE
        last &= np.abs(critical - previous) < CRITICAL_TOLERANCE * critical
        last &= circle | (np.abs(ratio - critical) < RATIO_TOLERANCE * critical)
        circle_ratios = self.targets.circle_ratios
        far = circle_ratios > FAR_CIRCLE * self.regions.ratios.ratios_for_circle
        last |= circle & far[owners] & (ratio < CIRCLE_PRECISION * circle_ratios[owners])
        return last

    def _decide_by_circles(self, owners: IntArray) -> None:
        """Drop the ends of fits whose interval is decided by the ratio of the best circle."""
        ratios, circle_ratios = self.regions.ratios, self.targets.circle_ratios
        self.wanted[owners, PHI_LOW] &= (circle_ratios > ratios.ratios_for_circle)[owners]
        determined = ~ratios.allows_any_theta(circle_ratios)[owners]
        self.wanted[owners, THETA_LOW] &= determined
        self.wanted[owners, THETA_HIGH] &= determined

    def _select_rows(self, chosen: BoolArray) -> None:
        """Drop the active rows that are not chosen."""
        if not chosen.all():
            self.rows, self.parameters = select_rows(self.rows, chosen), self.parameters[chosen]
            self.expansion = select_rows(self.expansion, chosen)
            self.targets = self.targets.select(chosen)
            self.lengths, self.reduction = self.lengths[chosen], self.reduction[chosen]


def _move_rows(
    stack: FitStack,
    owners: IntArray,
    parameters: FloatArray,
    targets: FloatArray,
    fractions: FloatArray,
) -> FloatArray:
    """Return the rows moved by a fraction of the step to the targets, in coordinates of an arc.

    The coordinates are the middle point of the arc, log m and d / m, in which the region of a short
    arc is more nearly an ellipsoid. A known radius or phi is a coordinate, too: steps preserve it.
    """
    steps = fractions[:, None] * (targets - parameters)
    m, d = parameters[:, 2], deviators_from_parameters(parameters)
    dm, dd = steps[:, 2], deviators_from_parameters(steps)
    new_delta = d / m + (dd - d * dm / m) / m
    phi_known = ~stack.may_be_circle[owners]
    if phi_known.any():
        delta = d[phi_known] / m[phi_known]
        new_delta[phi_known] = _step_along_phi(delta, new_delta[phi_known])
    new_delta[~targets[:, 3:].any(axis=1) & (fractions == 1)] = 0.0  # a full step to a circle
    new_m = m * np.exp(dm / m)
    # With a known radius b = m - |d| changes linearly, and m follows from b and d / m.
    u = np.where(d == 0, 1.0, d / np.abs(d))
    m_of_known_radius = (m - np.abs(d) + dm - (dd * u.conj()).real) / (1 - np.abs(new_delta))
    new_m = np.where(stack.known_radius[owners], m_of_known_radius, new_m)
    new_d = new_m * new_delta
    # The centre moves so that the middle point c + m w + d conj(w) of the arc moves linearly.
    w = stack.arc_middles[owners]
    moved = parameters + steps
    moved[:, :2] += as_vectors((m + dm - new_m) * w + (d + dd - new_d) * w.conj())
    moved[:, 2], moved[:, 3:] = new_m, as_vectors(new_d)
    return moved


def _step_along_phi(delta: ComplexArray, new_delta: ComplexArray) -> ComplexArray:
    """Return d / m (k,) after a step from `delta` towards `new_delta` that is linear in phi."""
    kappa = np.abs(delta)
    root = np.sqrt(kappa)
    step = ((new_delta - delta) * delta.conj()).real / (kappa * root * (1 + kappa))
    phi = np.clip(2 * np.arctan(root) + step, 0.0, np.pi / 2)
    moved: ComplexArray = np.tan(phi / 2) ** 2 * new_delta / np.abs(new_delta)
    return moved


def _maximised_quantities(parameters: FloatArray, estimates: FloatArray) -> FloatArray:
    """Return the quantity that each end maximises, (s, k, 13), for parameters (s, k, 5)."""
    x, y, m, p, q = np.moveaxis(parameters, 2, 0)
    d, of_estimates = p + 1j * q, estimates[..., 3] + 1j * estimates[..., 4]
    h = np.abs(d)
    turn = np.angle(d * of_estimates.conj())
    b, kappa = m - h, h / m
    heights = (-b, b, -kappa, kappa, -b, kappa, -x, x, -y, y, -turn, turn, 0 * m)
    return np.moveaxis(np.array(heights), 0, 2)
