"""Hand-eye solution with noisy robot poses (errors in variables).

The error of the robot is propagated to the covariance of the observation in each pose (module
`robot_std`); the robot's poses are no unknowns of the fit. Without this term the covariance of the
result is several times too small.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import (
    prior_jacobian_and_residuals,
    solve_least_squares,
    whitened_jacobian_and_residuals,
)
from lsvision.calibration.observations import MM_PER_RADIAN, Observations, States
from lsvision.calibration.robot_std import (
    STATED_ROBOT,
    RobotStdPosterior,
    compute_robot_whitening,
    infer_robot_std,
)
from lsvision.errors import FitFailed
from lsvision.geometry import FloatArray
from lsvision.statistics.normal_matrix import invert_normal_matrix

MAX_ITERATIONS, STEPS_PER_ITERATION = 6, 8
"""Largest number of times that the whitening is computed, at the initial guess and then at the
latest solution, and of Levenberg-Marquardt steps with each whitening."""
CONVERGED_MM = 1e-7
"""Change of the sensor's position below which the solution has converged. Units: mm."""
RANK_TOLERANCE = 1e-12
"""Smallest singular value that is not rounding, absolute or relative to the largest."""
SINGULAR = (
    "the normal matrix is singular: the poses do not determine all six parameters of the sensor "
    "pose; add poses with other tilt axes"
)
"""Message of a fit that the poses do not determine."""


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
        Degrees of freedom of `chi2`; see `count_degrees_of_freedom`.
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
        """Scales (2,) of the robot's standard deviations of position and orientation.

        1 if they were stated, else relative to `NOMINAL_ROBOT_STD`.
        """
        return self.posterior.mean_scales

    @property
    def robot_std_is_estimated(self) -> bool:
        """Whether the robot's standard deviations were estimated from the residuals."""
        return self.posterior.is_estimated

    @property
    def covariance(self) -> FloatArray:
        """Covariance of sensor (6) and target(s).

        It is valid if the error of the robot is as stated, or was estimated.
        """
        return self.cofactors * self.variance_factor

    @property
    def prediction_covariances(self) -> FloatArray:
        """Covariances J Q J' (n, m, m) of the predicted whitened observations of each pose.

        Without the variance factor.
        """
        return self.jacobian @ self.cofactors @ np.swapaxes(self.jacobian, -1, -2)

    @property
    def redundancy(self) -> FloatArray:
        """Redundancy matrices (n, m, m) of the poses: 1 - J Q J', 1 where not used.

        They map the whitened error of a pose's observation to its whitened residual.
        """
        eye = np.eye(self.residuals.shape[1])
        return eye - self.mask[:, None, None] * self.prediction_covariances

    def propagate_shifts(self, shifts: FloatArray) -> FloatArray:
        """Return the change (k, p) of the solution by shifts (k, n, m) of the observations.

        The first six of the p numbers are translation (mm) and left perturbation (rad) of the
        sensor, the others local coordinates of the targets, see
        `Observations.update_targets`.
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
    for _ in range(MAX_ITERATIONS):
        previous = states
        if estimate_robot_std:
            try:
                posterior = infer_robot_std(observations, states, mask)
            except np.linalg.LinAlgError as error:
                raise FitFailed(SINGULAR) from error
        whitening = compute_robot_whitening(observations, states, posterior.mean_scales)
        states = solve_least_squares(
            observations, states, mask[:, None, None] * whitening, max_steps=STEPS_PER_ITERATION
        ).states
        if np.abs(states.translations - previous.translations).max() < CONVERGED_MM:
            break
    return _build_fit(observations, states, mask, posterior)


def _build_fit(
    observations: Observations,
    states: States,
    mask: FloatArray,
    posterior: RobotStdPosterior,
) -> ErrorsInVariablesFit:
    """Return the fit at a state, with its cofactors and statistics."""
    whitening = compute_robot_whitening(observations, states, posterior.mean_scales)
    jacobian, residuals = whitened_jacobian_and_residuals(observations, states, whitening)
    prior, prior_residuals = prior_jacobian_and_residuals(observations, states)
    try:
        cofactors = _invert_normal_matrix(jacobian[0], prior[0], mask)
    except np.linalg.LinAlgError as error:
        raise FitFailed(SINGULAR) from error
    chi2 = float((residuals[0] ** 2 * mask[:, None]).sum() + (prior_residuals**2).sum())
    dof = _count_degrees_of_freedom(observations, mask, prior[0], cofactors)
    variance_factor = 1.0 if posterior.is_estimated else max(1.0, chi2 / max(dof, 1))
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


def count_degrees_of_freedom(
    observations: Observations, states: States, mask: FloatArray, whitening: FloatArray
) -> float:
    """Return the number of observations minus the number of unknowns that they determine.

    It is N - p + trace(P Q P') for N observed numbers, p unknowns with cofactors Q, and whitened
    rows P of their priors: an unknown counts by the fraction of its information that is from the
    observations. The squared
    residuals of the priors are part of `chi2`, but their degrees of freedom, 1 minus the diagonal
    element of P Q P' for each, are not counted: chi^2 over its degrees of freedom is then rather
    too large. If the normal matrix is singular, the result is N - p.
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
    """Return `count_degrees_of_freedom` from the prior's rows of the Jacobian and the cofactors."""
    observed = mask.sum() * observations.covariances.shape[-1]
    determined_by_prior = float(np.trace(prior @ cofactors @ prior.T))
    return float(observed - len(cofactors) + determined_by_prior)


def _invert_normal_matrix(jacobian: FloatArray, prior: FloatArray, mask: FloatArray) -> FloatArray:
    """Return the cofactors (p, p) of a whitened Jacobian (n, m, p) of masked poses and a prior."""
    used = jacobian * mask[:, None, None]
    rows = np.concatenate([used.reshape(-1, jacobian.shape[-1]), prior])
    return invert_normal_matrix(rows.T @ rows)


def find_least_determined_direction(
    observations: Observations, fit: ErrorsInVariablesFit
) -> tuple[float, str]:
    """Return the std in mm of the motion that the inlier poses determine least, and the motion.

    One radian counts as 100 mm. The std does not depend on the residuals: it is predicted for the
    stated or nominal robot. It is infinite where the normal matrix is singular.
    """
    whitening = fit.mask[:, None, None] * compute_robot_whitening(
        observations, fit.states, (1.0, 1.0)
    )
    jacobian, _ = whitened_jacobian_and_residuals(observations, fit.states, whitening)
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    sensor, target = rows[:, :6] / ([1.0] * 3 + [MM_PER_RADIAN] * 3), rows[:, 6:]
    _, prior_stds = observations.target_prior
    prior = np.diag(1 / np.tile(prior_stds, fit.states.targets.shape[1]))
    target = np.concatenate([target, prior])
    sensor = np.concatenate([sensor, np.zeros((len(prior), 6))])
    # Project the columns of the target out of those of the sensor's pose in its mount.
    basis, singular_values, _ = np.linalg.svd(target, full_matrices=False)
    basis = basis[:, singular_values > RANK_TOLERANCE * singular_values[0]]
    projected = sensor - basis @ (basis.T @ sensor)
    _, singular_values, directions = np.linalg.svd(projected, full_matrices=False)
    std = float("inf") if singular_values[-1] < RANK_TOLERANCE else float(1 / singular_values[-1])
    return std, _describe_direction(directions[-1], fit.states.rotations[0])


def _describe_direction(direction: FloatArray, rotation: FloatArray) -> str:
    """Return the dominant axis of a motion (6,) of the sensor, in its own frame."""
    translation, rotation_vector = rotation.T @ direction[:3], rotation.T @ direction[3:]
    rotates = np.linalg.norm(rotation_vector) > np.linalg.norm(translation)
    axis, verb = (rotation_vector, "turning about") if rotates else (translation, "moving along")
    return f"{verb} the sensor's own {'XYZ'[int(np.abs(axis).argmax())]}"
