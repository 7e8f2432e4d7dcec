"""Ends of intervals: the extrema of five quantities over {F <= min F + c}, computed together.

Each end of each fit is a row of parameters (centre_x, centre_y, m, p, q); F, c and d = (p, q) are
those of `lsvision.ellipse.critical_ratio`. An iteration expands F to second order at every row, so
that the region is an ellipsoid, and moves the row to the extremum of its quantity over that
ellipsoid (`lsvision.ellipse.region_extrema`). This is sequential quadratically constrained
programming: as the constraint is expanded to second order, convergence is quadratic.

(Venzon and Moolgavkar, A method for computing profile-likelihood-based confidence intervals,
Applied Statistics 37, 1988, apply Newton's method to the same conditions; it cycles for phi within
two standard deviations of a circle.)

One more row of a fit is its best circle, the minimum of F on d = 0. The rows of all fits are moved
at once: for the few numbers of one fit, the calls of numpy would take most of the time.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.arc_steps import move_along_arcs
from lsvision.ellipse.cost_expansion import Expansion, expand_cost, multiply_vectors
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import deviators_from_parameters
from lsvision.ellipse.region_extrema import (
    CIRCLE,
    DIRECTED_END_COUNT,
    END_COUNT,
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
from lsvision.geometry.arrays import select_rows

MAX_EVALUATIONS = 20, 4, 4
"""Largest numbers of iterations, each with one evaluation of F: from the estimate, and after each
restart of rows from a point further out that another row found. On an arc of more than 90 deg one
or two suffice; if all these are not enough, the end of the region is too far away to be useful."""
TOLERANCE = 0.25
"""Limit of convergence: length of the last step in radii of the region, and difference of F - min F
from c as a fraction of c. The error of the end is quadratic in it; at this limit it is 1 % of the
width. With 0.35, 8 of 1000 intervals change by more than 2 %, and ends that are not found become a
third more frequent; with 0.175, for 2 to 4 % more evaluations, neither improves."""
CRITICAL_TOLERANCE = 0.007
"""Limit of convergence of c: difference from its last value as a fraction of c. The width is
proportional to sqrt(c), so that its error is 0.35 %. With 0.02, 15 of 3000 intervals change by more
than 2 %; 0.0035 takes 1 % more evaluations."""
CROSSING_STEP_FRACTION = 0.3
"""With a known radius: fraction of a step across the circle that is taken. With full steps the ends
of 50 of 2000 fits (arcs of 40 to 150 deg, tilts of 0 to 50 deg) are not found, with this fraction
those of 13. Near the circle these are 40, 35 and 35 of 4000 with 0.2, 0.3 and 0.4."""
MAX_RATIO = 6.0
"""Largest F - min F after a step, in units of c; a step beyond it is rejected. Without a limit the
ends of 26 of these 2000 fits are not found, with 2 to 20 those of 13 to 16; the larger the limit,
the fewer evaluations (10 % from 2 to 20)."""
STEP_FACTOR = 2.0
"""Factor by which the fraction of a step that is taken decreases after a rejected step (which
includes one that leads to no ellipse), and increases after an accepted one. It matters only that it
increases again: results and number of evaluations are the same within 2 % with a decrease to 0.25
to 0.5 and an increase of 1.5 to 2, but with one of 1.05 the ends of almost four times as many fits
are not found."""
FIRST_COLUMNS, SECOND_COLUMNS = list(SECOND_ENDS), list(SECOND_ENDS.values())
"""Columns of the ends that may have two local extrema, and columns of their second extrema."""
MAX_FLATTENING = 0.998
"""Largest h / m of a step: an axis ratio of 1 to 1000."""
EXCLUDED_CIRCLE_FACTOR, MAX_PREDICTION_ERROR = 1.5, 20.0
"""The search for the best circle ends early, since a circle is clearly excluded, if its predicted
ratio F - min F exceeds the first factor times the larger critical one. The prediction is that of
the present expansion, at which the ratio must be below the second factor times the predicted
one."""
CRITICAL_SLACK, SURPASSING_FRACTION = 1.001, 0.02
"""Factor on c that allows for rounding when two c are compared, and distance by which a point must
be further out than an end to replace it, as a fraction of half the width of the interval."""


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


def find_interval_ends(
    stack: FitStack, critical_ratios: CriticalRatios, wanted: BoolArray
) -> IntervalEnds:
    """Find the extrema of radius, centre, phi and theta over {F <= min F + c}, and best circles.

    Parameters
    ----------
    stack : FitStack
        The fits.
    critical_ratios : CriticalRatios
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
        search = _Search.start(Regions(stack, critical_ratios, best), wanted)
        for limit in MAX_EVALUATIONS:
            for _ in range(limit):
                if not search.rows.ends.size:
                    break
                search.advance()
            not_converged = search.rows.fit_indices  # all ends of these fits are unreliable
            search.restart_surpassed()
            if not search.rows.ends.size:
                break
    # Rows that would be restarted again are surpassed by other ends, or have not converged.
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
    expansion, targets : Expansion, Targets
        F about the present parameters of these ends, and the extrema to which the next step leads.
    lengths : (k,) ndarray
        Length of the step to the target, in radii of the region.
    step_fractions : (k,) ndarray
        Fraction of this step that is taken: below 1 after rejected steps.
    """

    regions: Regions
    ends: FloatArray
    critical: FloatArray
    wanted: BoolArray
    rows: Rows
    expansion: Expansion
    targets: Targets
    lengths: FloatArray
    step_fractions: FloatArray

    @classmethod
    def start(cls, regions: Regions, wanted: BoolArray) -> "_Search":
        """Start all rows at the estimates, with targets from their expansion."""
        wanted = wanted.copy()
        wanted[:, CIRCLE] &= regions.critical_ratios.may_be_circle
        rows = Rows(*np.nonzero(wanted))
        ends = np.repeat(regions.stack.parameters[:, None], END_COUNT, axis=1)
        critical = np.repeat(regions.critical_ratios.one_dof[:, None], END_COUNT, axis=1)
        angles, m_factors = np.zeros((2, len(ends), END_COUNT))
        if wanted[:, :DIRECTED_END_COUNT].any():
            angles[:, :DIRECTED_END_COUNT], m_factors[:, :DIRECTED_END_COUNT] = (
                regions.search_directions()
            )
        circle_ratios = np.full(len(ends), math.inf)
        last = Targets(ends[rows], angles[rows], m_factors[rows], critical[rows], circle_ratios)
        search = cls(
            regions, ends, critical, wanted, rows, select_rows(regions.best, rows.fit_indices),
            last, critical[rows], np.ones(rows.ends.size),
        )  # fmt: skip
        search._find_targets()
        return search

    def advance(self) -> None:
        """Move the rows by a step, find their next targets, and drop those that have converged."""
        previous = self.targets.critical
        fractions = np.where(self._crosses_circle(), CROSSING_STEP_FRACTION, 1.0)
        moved = self._accept(self._move(self.step_fractions * fractions))
        factor = np.where(moved, STEP_FACTOR, 1 / STEP_FACTOR)
        self.step_fractions = np.minimum(factor * self.step_fractions, 1.0)
        self._find_targets()
        done = moved & self._is_last_step(previous)
        if done.any():
            rows = select_rows(self.rows, done)
            self.ends[rows] = self._move(np.ones(done.size))[done]
            self.critical[rows] = self.targets.critical[done]
            self._decide_by_circles(rows.fit_indices[rows.ends == CIRCLE])
            self._select_rows(~done & self.wanted[self.rows])

    def _crosses_circle(self) -> BoolArray:
        """Return which steps (k,) of fits with a known radius lead across the circle d = 0.

        Ellipses with the same b form a cone m = b + |d|, whose tangent plane leads away from it on
        the other side of the circle: full steps would alternate between both sides.
        """
        crosses = self.regions.stack.known_radius[self.rows.fit_indices]
        known = np.flatnonzero(crosses)
        if known.size:
            d = deviators_from_parameters(self.expansion.parameters[known])
            targets = deviators_from_parameters(self.targets.parameters[known])
            crosses[known] = (targets * d.conj()).real < 0
        return crosses

    def restart_surpassed(self) -> None:
        """Restart ends that have not converged, or where another end has a more extreme value."""
        self.critical[self.rows] = self.targets.critical
        again, starts = self._find_surpassed()
        if again.any():
            self.rows = Rows(*np.nonzero(again))
            parameters = starts[self.rows]
            self.expansion = expand_cost(self.regions.stack, self.rows.fit_indices, parameters)
            self.step_fractions = np.ones(self.rows.ends.size)
            d, m = deviators_from_parameters(parameters), parameters[:, 2]
            m_factors = np.where(IS_PHI[self.rows.ends], np.abs(d) / m, 1.0)
            self.targets = self.targets._replace(
                angles=np.angle(d), m_factors=m_factors, critical=self.critical[self.rows]
            )
            self._find_targets()

    def _find_surpassed(self) -> tuple[BoolArray, FloatArray]:
        """Return which ends are restarted (s, 13), and the parameters (s, 13, 5) where they start.

        All ends have the same F and differ in c only: an end of smaller c lies in the region of one
        of larger c, whose quantity cannot be more extreme there than at its own end. If it is, that
        end is a local extremum only, and starts again from the most extreme of these points, among
        which is the estimate. An end that has not converged starts there in any case.
        """
        estimates = self.regions.stack.parameters[:, None]
        active = np.zeros(self.wanted.shape, dtype=bool)
        active[self.rows] = True
        # The points are the ends and, last, the estimate, which lies in all regions: its c is 0.
        points = np.concatenate([self.ends, estimates], axis=1)
        critical = np.pad(self.critical, ((0, 0), (0, 1)))
        is_found = np.pad(self.wanted & ~active, ((0, 0), (0, 1)), constant_values=True)
        is_found[:, CIRCLE] = False
        in_region = is_found[:, :, None] & (
            critical[:, :, None] < CRITICAL_SLACK * self.critical[:, None]
        )
        values = _select_maximised_quantities(points, estimates)
        values_in_region = np.where(in_region, values, -np.inf)
        values_at_ends = np.diagonal(values, axis1=1, axis2=2).copy()
        # Of two local extrema of one quantity, the more extreme one counts.
        both = np.maximum(values_at_ends[:, FIRST_COLUMNS], values_at_ends[:, SECOND_COLUMNS])
        for columns in (FIRST_COLUMNS, SECOND_COLUMNS):
            single = values_at_ends[:, columns]
            values_at_ends[:, columns] = np.where(is_found[:, SECOND_COLUMNS], both, single)
        slack = SURPASSING_FRACTION * np.abs(values_at_ends - values[:, END_COUNT])
        is_surpassed = values_in_region.max(axis=1) > values_at_ends + slack
        again = self.wanted & (active | is_surpassed)
        again[:, CIRCLE] = active[:, CIRCLE]
        starts = points[np.arange(len(points))[:, None], values_in_region.argmax(axis=1)]
        return again, starts

    def _find_targets(self) -> None:
        """Find the targets of the active rows and the lengths of the steps to them."""
        self.targets = self.regions.find_targets(self.rows, self.expansion, self.targets)
        steps = self.targets.parameters - self.expansion.parameters
        squares = (multiply_vectors(self.expansion.information, steps) * steps).sum(axis=1)
        self.lengths = np.sqrt(np.maximum(squares, 0.0) / self.targets.critical)

    def _move(self, fractions: FloatArray) -> FloatArray:
        """Return the parameters (k, 5) after fractions (k,) of the steps to the targets."""
        parameters, targets = self.expansion.parameters, self.targets.parameters
        return move_along_arcs(
            self.regions.stack, self.rows.fit_indices, parameters, targets, fractions
        )

    def _accept(self, trial: FloatArray) -> BoolArray:
        """Move to trial parameters (k, 5) where F is not too large; return which rows moved."""
        moved = np.hypot(trial[:, 3], trial[:, 4]) < MAX_FLATTENING * trial[:, 2]
        if moved.any():
            fit_indices, ends = select_rows(self.rows, moved)
            new = expand_cost(self.regions.stack, fit_indices, trial[moved])
            best = self.regions.best
            # Of F with and without the priors the smaller increase counts: with them F is large off
            # the curved surface of a known radius, without them where priors contradict the points.
            ratio = np.minimum(
                new.cost - best.cost[fit_indices],
                new.cost_of_points - best.cost_of_points[fit_indices],
            )
            near = ratio < MAX_RATIO * self.targets.critical[moved]
            near |= ends == CIRCLE
            moved[moved] = near
            if moved.all():
                self.expansion = new
                return moved
            for field, values in zip(self.expansion, new, strict=True):
                field[moved] = values[near]
        return moved

    def _is_last_step(self, previous: FloatArray) -> BoolArray:
        """Return whether the next step of each row is its last; `previous` is c one step ago."""
        fit_indices, critical = self.rows.fit_indices, self.targets.critical
        ratio = self.expansion.cost - self.regions.best.cost[fit_indices]
        is_circle = self.rows.ends == CIRCLE
        last: BoolArray = self.lengths < TOLERANCE
        last &= np.abs(critical - previous) < CRITICAL_TOLERANCE * critical
        last &= is_circle | (np.abs(ratio - critical) < TOLERANCE * critical)
        predicted = self.targets.circle_ratios
        critical_ratios = self.regions.critical_ratios
        highest = np.maximum(critical_ratios.for_circle, critical_ratios.no_circle)
        excluded = predicted > EXCLUDED_CIRCLE_FACTOR * highest
        is_predicted = ratio < MAX_PREDICTION_ERROR * predicted[fit_indices]
        last |= is_circle & excluded[fit_indices] & is_predicted
        return last

    def _decide_by_circles(self, fit_indices: IntArray) -> None:
        """Drop the ends of fits whose interval is decided by the ratio of the best circle."""
        critical_ratios, circle_ratios = self.regions.critical_ratios, self.targets.circle_ratios
        is_tilted = circle_ratios > critical_ratios.for_circle
        self.wanted[fit_indices, PHI_LOW] &= is_tilted[fit_indices]
        determined = ~critical_ratios.allows_any_theta(circle_ratios)[fit_indices]
        self.wanted[fit_indices, THETA_LOW] &= determined
        self.wanted[fit_indices, THETA_HIGH] &= determined

    def _select_rows(self, chosen: BoolArray) -> None:
        """Drop the active rows that are not chosen."""
        if not chosen.all():
            self.rows = select_rows(self.rows, chosen)
            self.expansion = select_rows(self.expansion, chosen)
            self.targets = self.targets.select(chosen)
            self.lengths, self.step_fractions = self.lengths[chosen], self.step_fractions[chosen]


def _select_maximised_quantities(parameters: FloatArray, estimates: FloatArray) -> FloatArray:
    """Return the quantity that each end maximises, (s, k, 13), for parameters (s, k, 5).

    `estimates` (s, 1, 5) are the parameters from whose theta the rotation of d is counted.
    """
    x, y, m, p, q = np.moveaxis(parameters, 2, 0)
    d, d_of_estimates = p + 1j * q, estimates[..., 3] + 1j * estimates[..., 4]
    h = np.abs(d)
    rotation = np.angle(d * d_of_estimates.conj())
    b, flattening = m - h, h / m
    # In the order of the ends, from RADIUS_LOW to CIRCLE, which maximises nothing.
    quantities = (
        -b, b, -flattening, flattening, -b, flattening, -x, x, -y, y, -rotation, rotation, 0 * m
    )  # fmt: skip
    return np.moveaxis(np.array(quantities), 0, 2)
