"""Errors of the robot: their part in those of the observations, and their estimate.

The covariance of a pose is C_i = C_observation + A_i S A_i' with the Jacobian A_i by the flange
pose and the robot's covariance S = s_p^2 S_p + s_r^2 S_r, with one scale for the errors of position
and one for those of orientation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.batched_least_squares import (
    build_whitening_matrices,
    prior_jacobian_and_residuals,
    whitened_jacobian_and_residuals,
)
from lsvision.calibration.observations import Observations, States
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY

NOMINAL_ROBOT_STD = (0.05, float(np.radians(0.01)))
"""Standard deviation of position (mm) and orientation (rad) of a repeatable six-axis arm: the
units of the scales where none is stated, and the most likely ratio of the two."""
ROBOT_STD_SCALE_BOUNDS = (1e-3, 1e3)
"""Smallest and largest scale that is considered, in units of `NOMINAL_ROBOT_STD`."""
ROBOT_STD_SCALE_PRIOR = 10.0
"""Median of the half-Cauchy prior of the robot's standard deviation, in units of
`NOMINAL_ROBOT_STD`: 0.5 mm, 0.1 deg."""
ROBOT_RATIO_PRIOR = 10.0
"""Standard deviation, as a factor, of the log-normal prior of the ratio of the robot's errors of
position and orientation, about that of `NOMINAL_ROBOT_STD`."""
MIN_COVARIANCE_DOF = 4.0
"""Degrees of freedom up to which the variances mixed in Student's t have no finite variance."""
MIN_VARIANCE = 1e-6
"""Smallest relative variance of a variance that is divided by."""
LOG_LIKELIHOOD_CUTOFF = 12.0
"""Decrease of the log-likelihood from its maximum, beyond which a scale is ignored."""
SCALE_GRID_SIZE = 30
"""Number of scales on the coarse grid between the bounds, and on the fine one about the maximum."""
RATIO_GRID = np.linspace(-2.0, 2.0, 17)
"""Grid of the logarithm of the ratio of both scales, in standard deviations of its prior."""


@dataclass(frozen=True, eq=False)
class RobotStdPosterior:
    """What the residuals tell about the standard deviations of the robot.

    Parameters
    ----------
    scales : (q, 2) ndarray
        Standard deviations of position and orientation, in units of the stated or nominal ones.
    weights : (q,) ndarray
        Probabilities of the scales; one scale for a stated robot.
    covariance_dof : float
        Degrees of freedom of the fit's covariance; infinite for a stated robot.
    """

    scales: FloatArray
    weights: FloatArray
    covariance_dof: float

    @property
    def is_estimated(self) -> bool:
        """Whether the standard deviations were estimated from the residuals, not stated."""
        return math.isfinite(self.covariance_dof)

    @property
    def mean_scales(self) -> FloatArray:
        """Roots (2,) of the mean squares of the scales.

        The mode is often zero, where the observations are as noisy as the robot.
        """
        scales: FloatArray = np.sqrt(self.weights @ self.scales**2)
        return scales


STATED_ROBOT = RobotStdPosterior(np.ones((1, 2)), np.ones(1), math.inf)
"""Posterior of a robot whose standard deviations are known."""


def compute_robot_whitening(
    observations: Observations, states: States, scales: npt.ArrayLike
) -> FloatArray:
    """Return whitening matrices (s, n, m, m) of observations with errors of the robot.

    `scales` (2,) are those of the robot's stated or nominal errors of position and orientation.
    """
    return build_whitening_matrices(
        observations.covariances + robot_covariances(observations, states, scales)
    )


def robot_covariances(
    observations: Observations, states: States, scales: npt.ArrayLike
) -> FloatArray:
    """Return A_i S A_i' (..., s, n, m, m) for scales (..., 2) of the robot's two errors."""
    parts = _compute_robot_covariance_parts(observations, states)
    return np.tensordot(np.square(scales), parts, axes=(-1, 2))


def _compute_robot_covariance_parts(observations: Observations, states: States) -> FloatArray:
    """Return A_i S_p A_i' and A_i S_r A_i', (s, n, 2, m, m)."""
    jacobian = observations.linearise(states).flange_jacobian[:, :, None]
    return jacobian @ observations.flanges.covariances @ np.swapaxes(jacobian, -1, -2)


def infer_robot_std(
    observations: Observations, states: States, mask: FloatArray
) -> RobotStdPosterior:
    """Return the posterior of the robot's standard deviations.

    Restricted likelihood (Harville 1977) of the linearised problem times a half-Cauchy prior of the
    geometric mean of both scales and a log-normal one of their ratio, on a coarse grid and then on
    a fine one.

    The variances of the unknowns, in geometric mean, have a mean m and variance v; those of
    Student's t with k degrees of freedom have v = 2 m^2 / (k - 4).
    """
    likelihood = _build_restricted_likelihood(observations, states, mask)
    # Both scales are the geometric mean times such a factor; the logarithm of their ratio is one of
    # `RATIO_GRID`.
    ratio_factors = ROBOT_RATIO_PRIOR ** (0.5 * np.stack([RATIO_GRID, -RATIO_GRID], axis=-1))
    means = np.geomspace(*ROBOT_STD_SCALE_BOUNDS, SCALE_GRID_SIZE)
    largest = likelihood(means[:, None, None] * ratio_factors)[0].max(axis=1)  # over the ratios
    relevant = np.flatnonzero(largest > largest.max() - LOG_LIKELIHOOD_CUTOFF)
    low, high = max(relevant[0] - 1, 0), min(relevant[-1] + 1, len(means) - 1)
    means = np.geomspace(means[low], means[high], SCALE_GRID_SIZE)
    scales = means[:, None, None] * ratio_factors
    log_likelihoods, log_variances = likelihood(scales)
    log_likelihoods = log_likelihoods - 0.5 * RATIO_GRID**2
    # Half-Cauchy prior of the mean, times the mean: the spacing of the logarithmic grid.
    weights = (
        np.exp(log_likelihoods - log_likelihoods.max())
        * (means / (1 + (means / ROBOT_STD_SCALE_PRIOR) ** 2))[:, None]
    )
    weights /= weights.sum()
    variances = np.exp(log_variances - (weights * log_variances).sum())
    mean = float((weights * variances).sum())
    relative_variance = float((weights * (variances / mean - 1) ** 2).sum())
    covariance_dof = MIN_COVARIANCE_DOF + 2 / max(relative_variance, MIN_VARIANCE)
    return RobotStdPosterior(scales.reshape(-1, 2), weights.ravel(), covariance_dof)


def _build_restricted_likelihood(
    observations: Observations, states: States, mask: FloatArray
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Return a function of robot scales (..., 2): log-likelihood and log-variance (...).

    The likelihood is marginalised over the unknowns; the variance is the geometric mean of theirs.
    """
    used = mask > 0
    parts = _compute_robot_covariance_parts(observations, states)[0, used]
    no_whitening = np.eye(observations.covariances.shape[-1])[None, None]
    jacobian, residual = whitened_jacobian_and_residuals(observations, states, no_whitening)
    prior, prior_residual = prior_jacobian_and_residuals(observations, states)
    rows = jacobian[0, used]
    column_scales = 1 / np.maximum(np.linalg.norm(jacobian[0], axis=(0, 1)), TINY)
    rows = np.concatenate([rows * column_scales, residual[0, used, :, None]], axis=-1)
    columns = rows.shape[-1]
    prior_rows = np.concatenate([prior[0] * column_scales, prior_residual[0, :, None]], axis=-1)

    def likelihood(scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms of both at scales (..., 2), up to a constant each."""
        covariances = observations.covariances[used] + np.tensordot(scales**2, parts, axes=(-1, 1))
        # Normal matrix, right-hand side and sum of squares in one symmetric matrix.
        weighted = np.linalg.solve(covariances, rows).reshape(*scales.shape[:-1], -1, columns)
        normal = rows.reshape(-1, columns).T @ weighted + prior_rows.T @ prior_rows
        matrix, moment = normal[..., :-1, :-1], normal[..., :-1, -1:]
        chi2_decrease = (moment * np.linalg.solve(matrix, moment)).sum(axis=(-2, -1))
        chi2 = normal[..., -1, -1] - chi2_decrease
        information = np.linalg.slogdet(matrix)[1]
        log_determinants = np.linalg.slogdet(covariances)[1].sum(axis=-1)
        log_likelihood: FloatArray = -0.5 * (log_determinants + chi2 + information)
        return log_likelihood, -information / (columns - 1)

    return likelihood
