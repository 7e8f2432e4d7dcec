"""Hand-eye solution with noisy robot poses (errors in variables).

The error of the robot is part of the covariance of each pose: C_i = C_observation + s^2 A_i S A_i'
with the Jacobian A_i by the flange pose, the nominal robot covariance S and its scale s. Without
this term the covariance of the result is several times too small.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import (
    prior_jacobian_and_residuals,
    solve_least_squares,
    whitened_jacobian_and_residuals,
    whitening_matrices,
)
from lsvision.calibration.observations import MM_PER_RADIAN, Observations, States
from lsvision.errors import FitFailed
from lsvision.geometry import FloatArray
from lsvision.statistics.normal_matrix import invert_normal_matrix

NOMINAL_ROBOT_STD = (0.05, float(np.radians(0.01)))
"""Standard deviation of position (mm) and orientation (rad) of a repeatable six-axis arm: the
ratio of the two where the robot's error is estimated. The data determine its scale but not the
ratio."""
ROBOT_STD_SCALE_BOUNDS = (1e-3, 1e3)
"""Smallest and largest scale that is considered, in units of `NOMINAL_ROBOT_STD`."""
ROBOT_STD_SCALE_PRIOR = 10.0
"""Median of the half-Cauchy prior of the robot's standard deviation, in units of
`NOMINAL_ROBOT_STD`: 0.5 mm, 0.1 deg."""
LOG_LIKELIHOOD_CUTOFF = 12.0
"""Decrease of the log-likelihood beyond which a scale is ignored."""
TINY = 1e-300


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
    robot_std_scale : float
        Standard deviation of the robot in units of the stated or nominal one.
    chi2 : float
        Sum of squared whitened residuals of the used poses and the prior.
    dof : int
        Degrees of freedom: number of observations and priors minus number of unknowns.
    variance_factor : float
        Factor on the covariance, at least 1.
    """

    states: States
    mask: FloatArray
    cofactors: FloatArray
    whitening: FloatArray
    jacobian: FloatArray
    residuals: FloatArray
    robot_std_scale: float
    chi2: float
    dof: int
    variance_factor: float

    @property
    def covariance(self) -> FloatArray:
        """Covariance of sensor (6) and target(s).

        Valid where the error of the robot is as stated or was estimated.
        """
        covariance: FloatArray = self.cofactors * self.variance_factor
        return covariance

    @property
    def prediction_covariances(self) -> FloatArray:
        """Covariances J Q J' (n, m, m) of the predicted observations, without variance factor."""
        covariances: FloatArray = (
            self.jacobian @ self.cofactors @ np.swapaxes(self.jacobian, -1, -2)
        )
        return covariances

    @property
    def redundancy(self) -> FloatArray:
        """Redundancy matrices (n, m, m) of the poses: 1 - J Q J', 1 where not used.

        They map the error of an observation to its residual.
        """
        eye = np.eye(self.residuals.shape[1])
        redundancy: FloatArray = eye - self.mask[:, None, None] * self.prediction_covariances
        return redundancy

    def steps_by_shifts(self, shifts: FloatArray) -> FloatArray:
        """Return the change (k, p) of the solution by shifts (k, n, m) of the observations."""
        used = self.mask[:, None, None] * self.jacobian
        gradients = np.einsum("nrp,nrm,knm->kp", used, self.whitening, shifts)
        steps: FloatArray = -gradients @ self.cofactors
        return steps

    def leave_one_out_residuals(self) -> FloatArray:
        """Return the residual (n, m) of each pose with respect to a fit without it.

        In the units of the observation. Exact for the linearised problem; residuals of poses that
        were not used are unchanged.
        """
        white = np.linalg.solve(
            self.redundancy + 1e-12 * np.eye(self.residuals.shape[1]), self.residuals[..., None]
        )
        predicted: FloatArray = np.linalg.solve(self.whitening, white)[..., 0]
        return predicted


def fit_errors_in_variables(
    observations: Observations, initial_guess: States, mask: FloatArray, *, estimate_robot_std: bool
) -> ErrorsInVariablesFit:
    """Estimate sensor pose and target with errors in variables, from an initial guess.

    Parameters
    ----------
    observations : Observations
        Observations in n poses.
    initial_guess : States
        Initial guess (one state).
    mask : (n,) ndarray
        1 for the poses to use, 0 for others.
    estimate_robot_std : bool
        Whether the scale of the robot's error is estimated from the residuals. Otherwise the stated
        robot is used, and the covariance is scaled by the reduced chi^2 where that exceeds 1.

    Raises
    ------
    FitFailed
        If the normal equations are singular.
    """
    states, scale = initial_guess, 1.0
    for _ in range(6):
        previous = states
        if estimate_robot_std:
            scale = _estimate_robot_std_scale(observations, states, mask)
        whitening = robot_whitening(observations, states, scale)
        states = solve_least_squares(
            observations, states, mask[:, None, None] * whitening, max_steps=8
        ).states
        if np.abs(states.translations - previous.translations).max() < 1e-7:
            break
    return _build_fit(observations, states, mask, scale, estimate=estimate_robot_std)


def _build_fit(
    observations: Observations, states: States, mask: FloatArray, scale: float, *, estimate: bool
) -> ErrorsInVariablesFit:
    """Return the fit at a state, with its cofactors and statistics."""
    whitening = robot_whitening(observations, states, scale)
    jacobian, residuals = whitened_jacobian_and_residuals(observations, states, whitening)
    prior, prior_residuals = prior_jacobian_and_residuals(observations, states)
    used = jacobian[0] * mask[:, None, None]
    normalised_jacobian = np.concatenate([used.reshape(-1, jacobian.shape[-1]), prior[0]])
    try:
        cofactors = invert_normal_matrix(normalised_jacobian.T @ normalised_jacobian)
    except np.linalg.LinAlgError as error:
        raise FitFailed(
            "the normal matrix is singular: the poses do not determine all six parameters of the "
            "sensor pose; add poses with other tilt axes"
        ) from error
    chi2 = float((residuals[0] ** 2 * mask[:, None]).sum() + (prior_residuals**2).sum())
    dof = degrees_of_freedom(observations, states, mask)
    variance_factor = 1.0 if estimate else max(1.0, chi2 / max(dof, 1))
    return ErrorsInVariablesFit(
        states=states,
        mask=mask,
        cofactors=cofactors,
        whitening=whitening[0],
        jacobian=jacobian[0],
        residuals=residuals[0],
        robot_std_scale=scale,
        chi2=chi2,
        dof=dof,
        variance_factor=variance_factor,
    )


def degrees_of_freedom(observations: Observations, states: States, mask: FloatArray) -> int:
    """Return the number of observations and priors minus the number of unknowns."""
    prior = int(np.isfinite(observations.target_prior[1]).sum()) * states.targets.shape[1]
    observed = int(mask.sum()) * observations.covariances.shape[-1]
    unknowns = 6 + states.targets.shape[1] * len(observations.target_prior[1])
    return int(observed + prior - unknowns)


def robot_whitening(observations: Observations, states: States, scale: float) -> FloatArray:
    """Return whitening matrices (s, n, m, m) of C_i = C_observation + scale^2 A_i S A_i'."""
    return whitening_matrices(
        observations.covariances + scale**2 * robot_covariances(observations, states)
    )


def robot_covariances(observations: Observations, states: States) -> FloatArray:
    """Return A_i S A_i' (s, n, m, m): the part of the stated or nominal robot in a covariance."""
    jacobian = observations.linearise(states).flange_jacobian
    robot: FloatArray = jacobian @ observations.flanges.covariances @ np.swapaxes(jacobian, -1, -2)
    return robot


def _estimate_robot_std_scale(
    observations: Observations, states: States, mask: FloatArray
) -> float:
    """Estimate the scale of the robot's error: root of its posterior mean square.

    Restricted likelihood (Harville 1977) of the linearised problem times a half-Cauchy prior, on a
    coarse grid and then on a fine one. The mean and not the mode: where the observations are as
    noisy as the robot, the mode is often zero, and then the covariance is too small.
    """
    likelihood = _restricted_likelihood(observations, states, mask)
    scales = np.geomspace(*ROBOT_STD_SCALE_BOUNDS, 30)
    log_likelihoods = np.array([likelihood(scale) for scale in scales])
    considered = np.flatnonzero(log_likelihoods > log_likelihoods.max() - LOG_LIKELIHOOD_CUTOFF)
    low, high = max(considered[0] - 1, 0), min(considered[-1] + 1, len(scales) - 1)
    scales = np.geomspace(scales[low], scales[high], 30)
    log_likelihoods = np.array([likelihood(scale) for scale in scales])
    # Half-Cauchy prior; the last factor is the spacing of the logarithmic grid.
    weights = (
        np.exp(log_likelihoods - log_likelihoods.max())
        / (1 + (scales / ROBOT_STD_SCALE_PRIOR) ** 2)
        * scales
    )
    return float(np.sqrt((weights * scales**2).sum() / weights.sum()))


def _restricted_likelihood(
    observations: Observations, states: States, mask: FloatArray
) -> Callable[[float], float]:
    """Return the log-likelihood of a robot scale, marginalised over the unknowns."""
    robot = robot_covariances(observations, states)
    unit = np.ones((1, 1, 1, 1)) * np.eye(observations.covariances.shape[-1])
    jacobian, residual = whitened_jacobian_and_residuals(observations, states, unit)
    prior, prior_residual = prior_jacobian_and_residuals(observations, states)
    column_scales = 1 / np.maximum(
        np.linalg.norm(jacobian.reshape(-1, jacobian.shape[-1]), axis=0), TINY
    )

    def likelihood(scale: float) -> float:
        whitening = whitening_matrices(observations.covariances + scale**2 * robot)
        diagonals = np.log(np.einsum("snii->sni", whitening)).sum(axis=-1)
        used = mask[:, None, None] * whitening
        whitened = (used @ jacobian).reshape(1, -1, jacobian.shape[-1])
        jacobians = np.concatenate([whitened, prior], axis=1)[0] * column_scales
        rhs = (used @ residual[..., None]).reshape(1, -1)
        rhs = np.concatenate([rhs, prior_residual], axis=1)[0]
        step = np.linalg.lstsq(jacobians, -rhs, rcond=None)[0]
        chi2 = float(((jacobians @ step + rhs) ** 2).sum())
        _, information = np.linalg.slogdet(jacobians.T @ jacobians)
        return float((diagonals * mask).sum()) - 0.5 * (chi2 + float(information))

    return likelihood


@dataclass(frozen=True, slots=True)
class LeastDeterminedDirection:
    """Direction of the sensor's pose that the poses determine least.

    Parameters
    ----------
    std : float
        Standard deviation for the nominal robot; one radian counts 100 mm. Units: mm.
    description : str
        Direction in words.
    """

    std: float
    description: str


def least_determined_direction(
    observations: Observations, fit: ErrorsInVariablesFit
) -> LeastDeterminedDirection:
    """Return the motion of the sensor that the inlier poses determine least.

    Its standard deviation is predicted for the nominal or stated robot; infinite where the normal
    matrix is singular.
    """
    whitening = fit.mask[:, None, None] * robot_whitening(observations, fit.states, 1.0)
    jacobian, _ = whitened_jacobian_and_residuals(observations, fit.states, whitening)
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    mount, target = rows[:, :6] / ([1.0] * 3 + [MM_PER_RADIAN] * 3), rows[:, 6:]
    prior = np.diag(1 / np.tile(observations.target_prior[1], fit.states.targets.shape[1]))
    target = np.concatenate([target, prior])
    mount = np.concatenate([mount, np.zeros((len(prior), 6))])
    # Project the columns of the target out of those of the mount.
    basis, singular_values, _ = np.linalg.svd(target, full_matrices=False)
    basis = basis[:, singular_values > 1e-12 * singular_values[0]]
    not_explained = mount - basis @ (basis.T @ mount)
    _, singular_values, directions = np.linalg.svd(not_explained, full_matrices=False)
    std = float("inf") if singular_values[-1] < 1e-12 else float(1 / singular_values[-1])
    return LeastDeterminedDirection(
        std, _direction_description(directions[-1], fit.states.rotations[0])
    )


def _direction_description(direction: FloatArray, rotation: FloatArray) -> str:
    """Return the dominant axis of a motion (6,) of the sensor, in its own frame."""
    translation, rotation_vector = rotation.T @ direction[:3], rotation.T @ direction[3:]
    rotates = np.linalg.norm(rotation_vector) > np.linalg.norm(translation)
    axis, verb = (rotation_vector, "turning about") if rotates else (translation, "moving along")
    return f"{verb} the sensor's own {'XYZ'[int(np.abs(axis).argmax())]}"
