"""The Levenberg-Marquardt method in the normal equations of an ellipse, one step at a time.

The caller evaluates the normal equations, so that it can do so for many ellipses at once. Steps are
limited to a trust region and controlled as in MINPACK's lmder (More, Garbow, Hillstrom 1980).
"""

import math
from collections.abc import Callable
from operator import mul

import numpy as np

from lsvision.ellipse.parameters import PARAMETERS, add_step_on_cone
from lsvision.ellipse.robust_gauss_newton import solve_positive_definite
from lsvision.geometry import FloatArray
from lsvision.statistics.compiled_routines import dsyevd

PARAMETER_TOLERANCE = 1e-10
"""Size of the trust region, relative to the parameters, below which the iteration has converged. A
larger one would depend on the distance of the origin."""
REGION_TOLERANCE = 0.1
"""Relative error with which a step is fitted into the trust region; as in lmder."""
MIN_RELATIVE_INFORMATION = 1e-8
"""Smallest information about a parameter, relative to the largest, as a scale of the trust region:
points on a straight line along X have no information about the centre's y, whose step would
otherwise be unlimited."""
MAX_DAMPING_ITERATIONS = 10
"""Largest number of iterations for the damping of a step."""
MIN_GAIN = 1e-4
"""Ratio of the actual to the predicted decrease of chi^2 from which a step is accepted, as in
lmder."""
SMALL_GAIN, LARGE_GAIN = 0.25, 0.75
"""Ratios up to which the trust region shrinks, and from which it grows; as in lmder."""
MIN_SHRINK_FACTOR = 0.1
"""Smallest factor by which the trust region shrinks after a failure; as in lmder."""
MAX_GAIN = 2.0
"""Largest ratio with which the iteration may end: above it the prediction is wrong."""
UNEVALUATED_FRACTION = 1e-2
"""Predicted decrease of chi^2, over the tolerance, up to which the last step is taken without an
evaluation: most arcs then need 2 evaluations instead of 3. The residuals at the solution are then
extrapolated to first order; their error is the square of a step of a tenth of the tolerated one."""
MAX_CHI2_RATIO = 100.0
"""Ratio of chi^2 to the best one above which a step has failed, however small it was."""


class LevenbergMarquardt:
    """The iteration for one ellipse.

    Evaluate the normal equations at `trial` and pass them to `update`, until `finished` is true.

    Parameters
    ----------
    initial_guess : (5,) ndarray
        Initial parameters; see `lsvision.ellipse.parameters`. Units: mm.
    max_evaluations : int
        Largest number of evaluations.
    tolerance : float
        Relative decrease of chi^2 in a step, below which the iteration has converged.
    min_axis_ratio : float
        Axis ratio b / a below which the iteration ends, without convergence; 0: none.
    on_cone : bool
        Whether each step changes the semi-minor axis b linearly, as a known radius requires: along
        straight steps its prior is a curved valley of chi^2, so narrow that the iteration may end
        before the minimum.

    Attributes
    ----------
    trial : (5,) ndarray
        Parameters to be evaluated next. Units: mm.
    parameters, equations, cost : (5,) ndarray, (6, 6) ndarray, float
        The best parameters, the normal equations at them and chi^2.
    last_step : (5,) ndarray or None
        Step from the last evaluation to `parameters`, if it was so small that no evaluation was
        needed after it.
    evaluations : int
        Number of evaluations up to now.
    finished, converged : bool
        Whether the iteration has ended, and whether at a minimum.
    """

    __slots__ = (
        "_add_step", "_damping", "_max_evaluations", "_min_axis_ratio", "_predicted", "_region",
        "_slope", "_squared_scales", "_step_size", "_tolerance", "converged", "cost", "equations",
        "evaluations", "finished", "last_step", "parameters", "trial",
    )  # fmt: skip

    def __init__(
        self,
        initial_guess: FloatArray,
        max_evaluations: int,
        tolerance: float,
        *,
        min_axis_ratio: float = 0.0,
        on_cone: bool = False,
    ) -> None:
        self._add_step: Callable[[FloatArray, FloatArray], FloatArray]
        self._add_step = add_step_on_cone if on_cone else np.add
        self.trial = self.parameters = initial_guess
        self.equations = np.empty(0)
        self.last_step: FloatArray | None = None
        self.finished = self.converged = False
        self._max_evaluations, self._tolerance = max_evaluations, tolerance
        self._min_axis_ratio = min_axis_ratio
        self.evaluations = 0
        self.cost = self._region = math.inf
        self._damping = self._predicted = self._slope = self._step_size = 0.0
        self._squared_scales = [0.0] * PARAMETERS

    def update(self, equations: FloatArray) -> bool:
        """Continue with the normal equations at `trial`; return whether `trial` is accepted.

        Parameters
        ----------
        equations : (6, 6) ndarray
            The information (5, 5), in the last column the gradient of -chi^2 / 2, and in the
            corner chi^2.
        """
        self.evaluations += 1
        first, cost = self.evaluations == 1, float(equations[PARAMETERS, PARAMETERS])
        accepted = first or self._update_region(cost)
        if accepted:
            self.parameters, self.equations, self.cost = self.trial, equations, cost
            diagonal = equations.diagonal().tolist()
            self._squared_scales = list(map(max, self._squared_scales, diagonal))
        if cost == 0:
            self.finished = self.converged = True
        elif first:
            self.finished = not cost < math.inf
        self.finished |= self.evaluations >= self._max_evaluations or self._is_flat()
        if not self.finished:
            step = self._solve_next_step()
            self.trial = self._add_step(self.parameters, step)
            if first:
                self._region = min(self._region, self._step_size)
            if self._damping == 0 and self._predicted <= UNEVALUATED_FRACTION * self._tolerance:
                self.parameters, self.last_step = self.trial, step
                self.finished = self.converged = True
        return accepted

    @property
    def is_finite(self) -> bool:
        """Whether the best parameters and the numbers at them are finite."""
        return math.isfinite(sum(self.parameters.tolist()) + self.cost + sum(self._squared_scales))

    def _is_flat(self) -> bool:
        """Return whether the axis ratio of the best ellipse is below its limit."""
        if self._min_axis_ratio <= 0:
            return False
        m = float(self.parameters[2])
        h = math.hypot(*self.parameters[3:].tolist())
        return m - h < self._min_axis_ratio * (m + h)

    def _update_region(self, cost: float) -> bool:
        """Adapt the trust region to chi^2 after a step; return whether the step is accepted."""
        failed = not cost < MAX_CHI2_RATIO * self.cost
        actual, predicted = -1.0 if failed else 1 - cost / self.cost, self._predicted
        gain = actual / predicted if predicted else 0.0
        if gain <= SMALL_GAIN:
            shrink = 0.5 if actual >= 0 else 0.5 * self._slope / (self._slope - 0.5 * actual)
            shrink = MIN_SHRINK_FACTOR if failed else max(shrink, MIN_SHRINK_FACTOR)
            self._region = shrink * min(self._region, self._step_size / MIN_SHRINK_FACTOR)
        elif gain >= LARGE_GAIN or self._damping == 0:
            self._region = 2 * self._step_size
        accepted = gain >= MIN_GAIN
        small = max(abs(actual), predicted) <= self._tolerance and gain <= MAX_GAIN
        best = self.trial if accepted else self.parameters
        self.converged = small or self._region <= PARAMETER_TOLERANCE * self._measure_size(
            best.tolist()
        )
        self.finished = self.converged
        return accepted

    def _solve_next_step(self) -> FloatArray:
        """Return the step (5,) to the minimum within the trust region, NaN if there is none."""
        information, gradient = self.equations[:-1, :-1], self.equations[:-1, -1]
        step, self._damping = solve_positive_definite(information, gradient), 0.0
        self._step_size = self._measure_size(step.tolist())
        if not self._step_size <= (1 + REGION_TOLERANCE) * self._region:
            smallest = MIN_RELATIVE_INFORMATION * max(self._squared_scales) or 1.0
            self._squared_scales = [max(square, smallest) for square in self._squared_scales]
            scales = np.sqrt(self._squared_scales)
            scaled = information / scales / scales[:, None]
            step, self._damping = _solve_damped_step(scaled, gradient / scales, self._region)
            step /= scales
            self._step_size = self._measure_size(step.tolist())
        # With (A + damping) step = gradient, chi^2 decreases by 2 gradient' step - step' A step.
        self._slope = sum(map(mul, gradient.tolist(), step.tolist())) / self.cost
        self._predicted = (
            self._slope + self._damping * self._step_size * self._step_size / self.cost
        )
        return step

    def _measure_size(self, vector: list[float]) -> float:
        """Return the length of a vector of parameters (5,) over their standard deviations."""
        squares = map(mul, vector, vector)
        return math.sqrt(sum(map(mul, squares, self._squared_scales)))


def _solve_damped_step(
    information: FloatArray, gradient: FloatArray, length: float
) -> tuple[FloatArray, float]:
    """Return the step (5,) to the minimum within a length, and its damping; NaN if there is none.

    The damping is added to the diagonal of the information; it is found by Hebden's iteration.
    """
    values, vectors, failed = dsyevd(information, lower=1)
    if failed or not values[-1] > 0:
        return np.full(PARAMETERS, np.nan), 0.0
    along = (gradient @ vectors).tolist()
    values = np.maximum(values, np.finfo(float).eps * values[-1]).tolist()
    damping = 0.0
    for _ in range(MAX_DAMPING_ITERATIONS):
        step = [part / (value + damping) for part, value in zip(along, values, strict=True)]
        squares = list(map(mul, step, step))
        size = math.sqrt(sum(squares))
        excess = size / length - 1
        if not (excess > REGION_TOLERANCE or (damping > 0 and excess < -REGION_TOLERANCE)):
            break
        slope = sum(
            [square / (value + damping) for square, value in zip(squares, values, strict=True)]
        )
        damping = max(damping + excess * size * size / slope, 0.0)
    return vectors @ step, damping
