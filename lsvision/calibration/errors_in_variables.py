"""Hand-eye solution with noisy robot poses (errors in variables).

The error of the robot is part of the covariance of each pose: C_i = C_observation + A_i S A_i' with
the Jacobian A_i by the flange pose and the robot's covariance S = s_p^2 S_p + s_r^2 S_r, with one
scale for the errors of position and one for those of orientation. Without this term the covariance
of the result is several times too small.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.batched_least_squares import (
    prior_jacobian_and_residuals,
    solve_least_squares,
    whitened_jacobian_and_residuals,
    whitening_matrices,
)
from lsvision.calibration.observations import MM_PER_RADIAN, Observations, States
from lsvision.errors import FitFailed
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.statistics.normal_matrix import invert_normal_matrix

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
SINGULAR = (
    "the normal matrix is singular: the poses do not determine all six parameters of the sensor "
    "pose; add poses with other tilt axes"
)
"""Message of a fit that the poses do not determine."""


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
    def mean_scales(self) -> FloatArray:
        """Roots (2,) of the mean squares of the scales.

        The mode is often zero, where the observations are as noisy as the robot.
        """
        scales: FloatArray = np.sqrt(self.weights @ self.scales**2)
        return scales


STATED_ROBOT = RobotStdPosterior(np.ones((1, 2)), np.ones(1), math.inf)


@dataclass(frozen=True, eq=False)
class ErrorsInVariablesFit:
    """Errors-in-variables solution.

    Parameters
    ----------
    states : States
        Estimated state (one).
    mask : (n,) ndarray
        1 for the poses that were used, 0 for others.
    cofactors : (p, p) ndarray
        Inverse normal matrix: covariance of sensor (6) and target(s) before `variance_factor`.
    whitening : (n, m, m) ndarray
        Whitening matrix of every pose, used or not.
    jacobian, residuals : ndarray
        Whitened Jacobian (n, m, p) and residuals (n, m) of every pose, used or not.
    posterior : RobotStdPosterior
        Standard deviations of the robot.
    chi2 : float
        Sum of squared whitened residuals of the used poses and the prior.
    dof : float
        Degrees of freedom of `chi2`; see `degrees_of_freedom`.
    variance_factor : float
        Factor on the covariance, at least 1.
    """

    states: States
    mask: FloatArray
    cofactors: FloatArray
    whitening: FloatArray
    jacobian: FloatArray
    residuals: FloatArray
    posterior: RobotStdPosterior
    chi2: float
    dof: float
    variance_factor: float

    @property
    def robot_std_scales(self) -> FloatArray:
        """Estimated scales (2,) of the robot's standard deviations."""
        return self.posterior.mean_scales

    @property
    def robot_std_is_estimated(self) -> bool:
        """Whether the robot's standard deviations were estimated from the residuals."""
        return math.isfinite(self.posterior.covariance_dof)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of sensor (6) and target(s).

        It is valid if the error of the robot is as stated, or was estimated.
        """
        return self.cofactors * self.variance_factor

    @property
    def prediction_covariances(self) -> FloatArray:
        """Covariances J Q J' (n, m, m) of the predicted observations, without variance factor."""
        return self.jacobian @ self.cofactors @ np.swapaxes(self.jacobian, -1, -2)

    @property
    def redundancy(self) -> FloatArray:
        """Redundancy matrices (n, m, m) of the poses: 1 - J Q J', 1 where not used.

        They map the error of an observation to its residual.
        """
        eye = np.eye(self.residuals.shape[1])
        return eye - self.mask[:, None, None] * self.prediction_covariances

    def steps_by_shifts(self, shifts: FloatArray) -> FloatArray:
        """Return the change (k, p) of the solution by shifts (k, n, m) of the observations.

        The first six of the p numbers are translation (mm) and left-hand rotation (rad) of the
        sensor, the others the step coordinates of the targets.
        """
        used = self.mask[:, None, None] * self.jacobian
        gradients = np.einsum("nrp,nrm,knm->kp", used, self.whitening, shifts)
        steps: FloatArray = -gradients @ self.cofactors
        return steps

    def leave_one_out_residuals(self) -> FloatArray:
        """Return the residual (n, m) of each pose with respect to a fit without it.

        Units are those of the observation. Exact for the linearised problem; residuals of poses
        that were not used are unchanged.
        """
        whitened = np.linalg.solve(
            self.redundancy + 1e-12 * np.eye(self.residuals.shape[1]), self.residuals[..., None]
        )
        return np.linalg.solve(self.whitening, whitened)[..., 0]


def fit_errors_in_variables(
    observations: Observations, initial_guess: States, mask: FloatArray, *, estimate_robot_std: bool
) -> ErrorsInVariablesFit:
    """Return sensor pose and target, fitted with errors in variables from one initial guess.

    `mask` (n,) is 1 for the poses to use, 0 for others. With `estimate_robot_std` the scales of the
    robot's errors are estimated from the residuals; otherwise the stated robot is used, and the
    covariance is scaled by the reduced chi^2 where that is above 1.

    Raises
    ------
    FitFailed
        If the normal equations are singular.
    """
    states, posterior = initial_guess, STATED_ROBOT
    for _ in range(6):
        previous = states
        if estimate_robot_std:
            try:
                posterior = _estimate_robot_std(observations, states, mask)
            except np.linalg.LinAlgError as error:
                raise FitFailed(SINGULAR) from error
        whitening = robot_whitening(observations, states, posterior.mean_scales)
        states = solve_least_squares(
            observations, states, mask[:, None, None] * whitening, max_steps=8
        ).states
        if np.abs(states.translations - previous.translations).max() < 1e-7:
            break
    return _build_fit(observations, states, mask, posterior)


def _build_fit(
    observations: Observations,
    states: States,
    mask: FloatArray,
    posterior: RobotStdPosterior,
) -> ErrorsInVariablesFit:
    """Return the fit at a state, with its cofactors and statistics."""
    whitening = robot_whitening(observations, states, posterior.mean_scales)
    jacobian, residuals = whitened_jacobian_and_residuals(observations, states, whitening)
    prior, prior_residuals = prior_jacobian_and_residuals(observations, states)
    try:
        cofactors = _invert_normal_matrix(jacobian[0], prior[0], mask)
    except np.linalg.LinAlgError as error:
        raise FitFailed(SINGULAR) from error
    chi2 = float((residuals[0] ** 2 * mask[:, None]).sum() + (prior_residuals**2).sum())
    dof = _count_degrees_of_freedom(observations, mask, prior[0], cofactors)
    estimated = math.isfinite(posterior.covariance_dof)
    variance_factor = 1.0 if estimated else max(1.0, chi2 / max(dof, 1))
    return ErrorsInVariablesFit(
        states=states,
        mask=mask,
        cofactors=cofactors,
        whitening=whitening[0],
        jacobian=jacobian[0],
        residuals=residuals[0],
        posterior=posterior,
        chi2=chi2,
        dof=dof,
        variance_factor=variance_factor,
    )


def degrees_of_freedom(
    observations: Observations, states: States, mask: FloatArray, whitening: FloatArray
) -> float:
    """Return the number of observations minus the number of unknowns that they determine.

    An unknown counts by the fraction of its information that is not from its prior: a prior that is
    wide beside the observations leaves no residual, one that is narrow leaves no unknown. All count
    if the observations do not determine them.
    """
    jacobian, _ = whitened_jacobian_and_residuals(observations, states, whitening)
    prior, _ = prior_jacobian_and_residuals(observations, states)
    try:
        cofactors = _invert_normal_matrix(jacobian[0], prior[0], mask)
    except np.linalg.LinAlgError:
        cofactors = np.zeros((jacobian.shape[-1],) * 2)
    return _count_degrees_of_freedom(observations, mask, prior[0], cofactors)


def _count_degrees_of_freedom(
    observations: Observations, mask: FloatArray, prior: FloatArray, cofactors: FloatArray
) -> float:
    """Return `degrees_of_freedom` from the prior's rows of the Jacobian and the cofactors."""
    observed = mask.sum() * observations.covariances.shape[-1]
    determined_by_prior = float(np.trace(prior @ cofactors @ prior.T))
    return float(observed - len(cofactors) + determined_by_prior)


def _invert_normal_matrix(jacobian: FloatArray, prior: FloatArray, mask: FloatArray) -> FloatArray:
    """Return the cofactors (p, p) of a whitened Jacobian (n, m, p) of masked poses and a prior."""
    used = jacobian * mask[:, None, None]
    rows = np.concatenate([used.reshape(-1, jacobian.shape[-1]), prior])
    return invert_normal_matrix(rows.T @ rows)


def robot_whitening(
    observations: Observations, states: States, scales: npt.ArrayLike
) -> FloatArray:
    """Return whitening matrices (s, n, m, m) of observations with errors of the robot.

    `scales` (2,) are those of the robot's stated or nominal errors of position and orientation.
    """
    return whitening_matrices(
        observations.covariances + robot_covariances(observations, states, scales)
    )


def robot_covariances(
    observations: Observations, states: States, scales: npt.ArrayLike
) -> FloatArray:
    """Return A_i S A_i' (..., s, n, m, m) for scales (..., 2) of the robot's two errors."""
    parts = _robot_covariance_parts(observations, states)
    return np.tensordot(np.square(scales), parts, axes=(-1, 2))


def _robot_covariance_parts(observations: Observations, states: States) -> FloatArray:
    """Return A_i S_p A_i' and A_i S_r A_i', (s, n, 2, m, m)."""
    jacobian = observations.linearise(states).flange_jacobian[:, :, None]
    return jacobian @ observations.flanges.covariances @ np.swapaxes(jacobian, -1, -2)


def _estimate_robot_std(
    observations: Observations, states: States, mask: FloatArray
) -> RobotStdPosterior:
    """Return the posterior of the robot's standard deviations.

    Restricted likelihood (Harville 1977) of the linearised problem times a half-Cauchy prior of the
    geometric mean of both scales and a log-normal one of their ratio, on a coarse grid and then on
    a fine one.

    The variances of the unknowns, in geometric mean, have a mean m and variance v; those of
    Student's t with k degrees of freedom have v = 2 m^2 / (k - 4).
    """
    likelihood = _restricted_likelihood(observations, states, mask)
    z = np.linspace(-2.0, 2.0, 17)  # of the ratio's logarithm, in standard deviations of its prior
    # Both scales are the geometric mean times such a factor; their ratio is ROBOT_RATIO_PRIOR^z.
    ratio_factors = ROBOT_RATIO_PRIOR ** (0.5 * np.stack([z, -z], axis=-1))
    means = np.geomspace(*ROBOT_STD_SCALE_BOUNDS, 30)
    largest = likelihood(means[:, None, None] * ratio_factors)[0].max(axis=1)  # over the ratios
    relevant = np.flatnonzero(largest > largest.max() - LOG_LIKELIHOOD_CUTOFF)
    low, high = max(relevant[0] - 1, 0), min(relevant[-1] + 1, len(means) - 1)
    means = np.geomspace(means[low], means[high], 30)
    scales = means[:, None, None] * ratio_factors
    log_likelihoods, log_variances = likelihood(scales)
    log_likelihoods = log_likelihoods - 0.5 * z**2
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


def _restricted_likelihood(
    observations: Observations, states: States, mask: FloatArray
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Return a function of robot scales (..., 2): log-likelihood and log-variance (...).

    The likelihood is marginalised over the unknowns; the variance is the geometric mean of theirs.
    """
    used = mask > 0
    parts = _robot_covariance_parts(observations, states)[0, used]
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


def find_least_determined_direction(
    observations: Observations, fit: ErrorsInVariablesFit
) -> tuple[float, str]:
    """Return the std in mm of the motion that the inlier poses determine least, and the motion.

    One radian counts as 100 mm. The std does not depend on the residuals: it is predicted for the
    stated or nominal robot. It is infinite where the normal matrix is singular.
    """
    whitening = fit.mask[:, None, None] * robot_whitening(observations, fit.states, (1.0, 1.0))
    jacobian, _ = whitened_jacobian_and_residuals(observations, fit.states, whitening)
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    mount, target = rows[:, :6] / ([1.0] * 3 + [MM_PER_RADIAN] * 3), rows[:, 6:]
    prior = np.diag(1 / np.tile(observations.target_prior[1], fit.states.targets.shape[1]))
    target = np.concatenate([target, prior])
    mount = np.concatenate([mount, np.zeros((len(prior), 6))])
    # Project the columns of the target out of those of the mount.
    basis, singular_values, _ = np.linalg.svd(target, full_matrices=False)
    basis = basis[:, singular_values > 1e-12 * singular_values[0]]
    projected = mount - basis @ (basis.T @ mount)
    _, singular_values, directions = np.linalg.svd(projected, full_matrices=False)
    std = float("inf") if singular_values[-1] < 1e-12 else float(1 / singular_values[-1])
    return std, _describe_direction(directions[-1], fit.states.rotations[0])


def _describe_direction(direction: FloatArray, rotation: FloatArray) -> str:
    """Return the dominant axis of a motion (6,) of the sensor, in its own frame."""
    translation, rotation_vector = rotation.T @ direction[:3], rotation.T @ direction[3:]
    rotates = np.linalg.norm(rotation_vector) > np.linalg.norm(translation)
    axis, verb = (rotation_vector, "turning about") if rotates else (translation, "moving along")
    return f"{verb} the sensor's own {'XYZ'[int(np.abs(axis).argmax())]}"
