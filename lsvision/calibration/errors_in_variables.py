"""Sensor-to-robot solution with robot poses that are noisy themselves (errors in variables).

The robot's error enters the covariance of each pose: C_i = C_sighting + s^2 A_i S A_i'.
Treating the robot as perfect instead makes a covariance several times too small.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import (
    prior_rows,
    solve_least_squares,
    whitened_jacobian_and_residuals,
    whitening_matrices,
)
from lsvision.calibration.observations import Observations, States
from lsvision.errors import FitFailed
from lsvision.geometry import FloatArray

NOMINAL_ROBOT_STD = (0.05, float(np.radians(0.01)))
"""Ratio of position to orientation error (mm, rad) where the robot's error is estimated: a
repeatable six-axis arm. Its size comes from the data, its shape cannot."""
ROBOT_STD_SCALE_BOUNDS = (1e-3, 1e3)
"""Least and largest size looked for, in units of `NOMINAL_ROBOT_STD`."""
ROBOT_STD_SCALE_PRIOR = 10.0
"""Beforehand every other robot errs by more than this size: 0.5 mm, 0.1 deg."""
LOG_LIKELIHOOD_CUTOFF = 12.0
"""Fall of the log-likelihood beyond which a size does not count."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class ErrorsInVariablesFit:
    """Errors-in-variables solution of one state.

    Parameters
    ----------
    states : States
        One state.
    mask : (n,) ndarray
        1 for the poses that counted.
    cofactors : (p, p) ndarray
        Inverse normal matrix: covariance of sensor (6) and target(s) before widening.
    whitening : (n, m, m) ndarray
        Of every pose, counted or not.
    jacobian, residuals : ndarray
        (n, m, p) and (n, m), whitened, of every pose.
    robot_std_scale : float
        Size of the robot's error in units of the prior.
    chi2 : float
        Of the counted poses' whitened residuals and the prior's.
    dof : int
        Numbers seen less unknowns.
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
        """Of sensor (6) and target(s); honest where robot's error is as stated or estimated."""
        covariance: FloatArray = self.cofactors * self.variance_factor
        return covariance

    @property
    def redundancy(self) -> FloatArray:
        """(n, m, m) 1 - J Q J' of each counted pose: what of its error its residual shows."""
        eye = np.eye(self.residuals.shape[1])
        hats = self.jacobian @ self.cofactors @ np.swapaxes(self.jacobian, -1, -2)
        redundancy: FloatArray = eye - self.mask[:, None, None] * hats
        return redundancy

    def leave_one_out_residuals(self) -> FloatArray:
        """(n, m) residual of each pose had it not taken part, in the sighting's own units.

        Exact for the linearised problem; poses that did not count are as they are.
        """
        white = np.linalg.solve(
            self.redundancy + 1e-12 * np.eye(self.residuals.shape[1]), self.residuals[..., None]
        )
        predicted: FloatArray = np.linalg.solve(self.whitening, white)[..., 0]
        return predicted


def fit_errors_in_variables(
    sightings: Observations, start: States, mask: FloatArray, *, estimate_robot_std: bool
) -> ErrorsInVariablesFit:
    """Errors-in-variables solution from a start near it.

    Parameters
    ----------
    sightings : Observations
        What was seen.
    start : States
        One state.
    mask : (n,) ndarray
        1 for poses that count, 0 for others.
    estimate_robot_std : bool
        Whether the size of the robot's error comes from the residuals or stands as stated, and
        then only widens the covariance where the residuals are larger than it explains.

    Raises
    ------
    FitFailed
        If the normal equations are singular.
    """
    states, scale = start, 1.0
    for _ in range(6):
        previous = states
        if estimate_robot_std:
            scale = _estimate_robot_std_scale(sightings, states, mask)
        whitening = robot_whitening(sightings, states, scale)
        states = solve_least_squares(
            sightings, states, mask[:, None, None] * whitening, max_steps=8
        ).states
        if np.abs(states.translations - previous.translations).max() < 1e-7:
            break
    return _build_fit(sightings, states, mask, scale, estimate=estimate_robot_std)


def _build_fit(
    sightings: Observations, states: States, mask: FloatArray, scale: float, *, estimate: bool
) -> ErrorsInVariablesFit:
    whitening = robot_whitening(sightings, states, scale)
    jacobian, residuals = whitened_jacobian_and_residuals(sightings, states, whitening)
    prior, prior_residuals = prior_rows(sightings, states)
    counted = jacobian[0] * mask[:, None, None]
    rows = np.concatenate([counted.reshape(-1, jacobian.shape[-1]), prior[0]])
    try:
        cofactors = _scaled_inverse(rows.T @ rows)
    except np.linalg.LinAlgError as error:
        raise FitFailed("the poses leave a direction of the sensor's pose wholly free") from error
    chi2 = float((residuals[0] ** 2 * mask[:, None]).sum() + (prior_residuals**2).sum())
    dof = degrees_of_freedom(sightings, states, mask)
    widening = 1.0 if estimate else max(1.0, chi2 / max(dof, 1))
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
        variance_factor=widening,
    )


def degrees_of_freedom(sightings: Observations, states: States, mask: FloatArray) -> int:
    """Numbers seen (and prior) less unknowns."""
    prior = int(np.isfinite(sightings.target_prior[1]).sum()) * states.targets.shape[1]
    seen = int(mask.sum()) * sightings.covariances.shape[-1]
    unknown = 6 + states.targets.shape[1] * len(sightings.target_prior[1])
    return int(seen + prior - unknown)


def robot_whitening(sightings: Observations, states: States, scale: float) -> FloatArray:
    """Whitening of C_i = C_sighting + scale^2 A_i S A_i'; (s, n, m, m)."""
    return whitening_matrices(
        sightings.covariances + scale**2 * _robot_covariances(sightings, states)
    )


def _robot_covariances(sightings: Observations, states: States) -> FloatArray:
    """A_i S A_i', the error that a unit robot gives each sighting; (s, n, m, m)."""
    by_flange = sightings.linearise(states).flange_jacobian
    robot: FloatArray = by_flange @ sightings.flanges.covariances @ np.swapaxes(by_flange, -1, -2)
    return robot


def _estimate_robot_std_scale(sightings: Observations, states: States, mask: FloatArray) -> float:
    """Size of the robot's error, from the residuals: root of its mean square a posteriori.

    By the restricted likelihood (Harville 1977) of the linearised problem over a grid, coarse
    and then fine where the likelihood is. The mean, and not the likeliest size: that would be
    none in one of a few calibrations whose sightings are as noisy as the robot, and their
    covariance then be too small.
    """
    likelihood = _restricted_likelihood(sightings, states, mask)
    sizes = np.geomspace(*ROBOT_STD_SCALE_BOUNDS, 30)
    levels = np.array([likelihood(size) for size in sizes])
    within = np.flatnonzero(levels > levels.max() - LOG_LIKELIHOOD_CUTOFF)
    low, high = max(within[0] - 1, 0), min(within[-1] + 1, len(sizes) - 1)
    sizes = np.geomspace(sizes[low], sizes[high], 30)
    levels = np.array([likelihood(size) for size in sizes])
    # Beforehand a half-Cauchy distribution; the last factor is that of the logarithmic grid.
    weights = np.exp(levels - levels.max()) / (1 + (sizes / ROBOT_STD_SCALE_PRIOR) ** 2) * sizes
    return float(np.sqrt((weights * sizes**2).sum() / weights.sum()))


def _restricted_likelihood(
    sightings: Observations, states: States, mask: FloatArray
) -> Callable[[float], float]:
    """Logarithm of the likelihood of a size of the robot's error, the unknowns taken out."""
    robot = _robot_covariances(sightings, states)
    unit = np.ones((1, 1, 1, 1)) * np.eye(sightings.covariances.shape[-1])
    jacobian, residual = whitened_jacobian_and_residuals(sightings, states, unit)
    prior, prior_residual = prior_rows(sightings, states)
    columns = 1 / np.maximum(np.linalg.norm(jacobian.reshape(-1, jacobian.shape[-1]), axis=0), TINY)

    def likelihood(size: float) -> float:
        whitening = whitening_matrices(sightings.covariances + size**2 * robot)
        diagonals = np.log(np.einsum("snii->sni", whitening)).sum(axis=-1)
        counted = mask[:, None, None] * whitening
        white = (counted @ jacobian).reshape(1, -1, jacobian.shape[-1])
        rows = np.concatenate([white, prior], axis=1)[0] * columns
        right = (counted @ residual[..., None]).reshape(1, -1)
        right = np.concatenate([right, prior_residual], axis=1)[0]
        step = np.linalg.lstsq(rows, -right, rcond=None)[0]
        chi2 = float(((rows @ step + right) ** 2).sum())
        _, information = np.linalg.slogdet(rows.T @ rows)
        return float((diagonals * mask).sum()) - 0.5 * (chi2 + float(information))

    return likelihood


def _scaled_inverse(matrix: FloatArray) -> FloatArray:
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse: FloatArray = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    return inverse
