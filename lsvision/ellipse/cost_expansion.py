"""Second-order expansion of the costs of ellipse fits, about many ellipses at once.

The notation m, p, q, d, h and w is that of `lsvision.ellipse.parameters`. F is the weighted sum of
squares of the residuals, priors included, over the variance factor. About
parameters (centre_x, centre_y, m, p, q) it is F + 2 b' delta + delta' A delta, with b = J' r and
A = J' J + sum r Hess r.
"""

import math
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import FOOT_TOLERANCE, PARAMETERS, split_parameters
from lsvision.ellipse.problem import EllipseProblem, ProblemStack
from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray

MAX_FOOT_ITERATIONS = 20
"""Largest number of Newton steps of the nearest points; they end at `FOOT_TOLERANCE`."""
STRAIN_SIGNS = np.array([0.0, 0.0, 1.0, -1.0, -1.0])[:, None]
"""Rotation of the tangent by each parameter, as a multiple of its tangential displacement."""
DIFFERENCE_STEP = 1e-4
"""Step of central differences of the priors, as a fraction of h; at a circle its square, as a
fraction of m."""
RIDGE = 1e-12
"""Fraction of its diagonal, and of 1, that is added to A, so that A is always invertible."""

SecondOrder = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Sum of squares (k,), J'r (k, 5), J'J and sum r Hess r (k, 5, 5)."""


class Expansion(NamedTuple):
    """F about k rows of parameters.

    Parameters
    ----------
    cost, cost_of_points : (k,) ndarray
        F with and without the priors.
    gradient, gradient_of_points : (k, 5) ndarray
        b with and without the priors. Units: 1/mm.
    information, information_of_points : (k, 5, 5) ndarray
        A with and without the priors. Units: 1/mm^2.
    covariance : (k, 5, 5) ndarray
        Inverse of A. Units: mm^2.
    """

    cost: FloatArray
    gradient: FloatArray
    information: FloatArray
    covariance: FloatArray
    cost_of_points: FloatArray
    gradient_of_points: FloatArray
    information_of_points: FloatArray


def expand_cost(stack: FitStack, owners: IntArray, parameters: FloatArray) -> Expansion:
    """Expand F to second order.

    Parameters
    ----------
    stack : FitStack
        Fits with their problems and variance factors.
    owners : (k,) int ndarray
        Number of the fit of each row.
    parameters : (k, 5) ndarray
        Parameters about which F is expanded. Units: mm.

    Returns
    -------
    Expansion
        An indefinite A is replaced by its Gauss-Newton approximation J'J; the cost is infinite
        where the expansion is not finite.
    """
    variance_factors = stack.variance_factors[owners]
    factor_rows, factor_matrices = variance_factors[:, None], variance_factors[:, None, None]
    squares, slope, gauss_newton, curvature = _expand_points(stack, owners, parameters)
    cost_of_points, gradient_of_points = squares / variance_factors, slope / factor_rows
    information_of_points = (gauss_newton + curvature) / factor_matrices
    _add_priors(stack, owners, parameters, (squares, slope, gauss_newton, curvature))
    information = gauss_newton + curvature
    if not math.isfinite(float(information.sum())):
        infinite = ~np.isfinite(information).all(axis=(1, 2))
        information[infinite] = np.eye(PARAMETERS)
        squares[infinite] = cost_of_points[infinite] = np.inf
    try:
        np.linalg.cholesky(information)
    except np.linalg.LinAlgError:
        indefinite = ~(np.linalg.eigvalsh(information)[:, 0] > 0)
        information[indefinite] = gauss_newton[indefinite]
    information += RIDGE * (information + 1.0) * np.eye(PARAMETERS)
    information /= factor_matrices
    return Expansion(
        cost=squares / variance_factors,
        gradient=slope / factor_rows,
        information=information,
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        cost_of_points=cost_of_points,
        gradient_of_points=gradient_of_points,
        information_of_points=information_of_points,
    )


def _expand_points(stack: FitStack, owners: IntArray, parameters: FloatArray) -> SecondOrder:
    """Expand the sum of squares of the points; that of radial residuals by Gauss-Newton."""
    squares, slope, gauss_newton, curvature = _expand_orthogonal(stack, owners, parameters)
    for k in np.flatnonzero(stack.radial[owners]):
        problem = stack.fits[owners[k]].problem
        squares[k], slope[k], gauss_newton[k] = _linearise_radial(problem, parameters[k])
        curvature[k] = 0.0
    return squares, slope, gauss_newton, curvature


def _add_priors(
    stack: FitStack, owners: IntArray, parameters: FloatArray, second_order: SecondOrder
) -> None:
    """Add the residuals of the priors to the sum of squares, in place."""
    squares, slope, gauss_newton, curvature = second_order
    for k in np.flatnonzero(stack.has_prior[owners]):
        problem = stack.fits[owners[k]].problem
        rows = problem.prior_rows(parameters[k])
        residuals, jacobian = rows[:, PARAMETERS], -rows[:, :PARAMETERS]
        squares[k] += residuals @ residuals
        slope[k] += jacobian.T @ residuals
        gauss_newton[k] += jacobian.T @ jacobian
        curvature[k] += _differentiate_priors(problem, parameters[k], residuals)


def _expand_orthogonal(stack: FitStack, owners: IntArray, parameters: FloatArray) -> SecondOrder:
    """Expand the sum of squares of the orthogonal distances.

    Parameter i moves the ellipse by X_i = (1, i, w, conj w, i conj w), with normal and tangential
    components N_i and T_i. The distance has the derivative -N_i and the second
    derivative kappa T_i T_j - a_i T_j - a_j T_i, with kappa the curvature and a_i the rotation of
    the tangent; terms in distance times curvature are neglected.
    """
    distances, steepness, normals, w = _nearest_points(stack.points[owners], parameters)
    _, m, d = split_parameters(parameters)
    normals = normals.conj()
    along, across = w * normals, w.conj() * normals
    N, T = np.empty((2, len(w), PARAMETERS, w.shape[1]))
    N[:, 0], N[:, 1], N[:, 2], N[:, 3] = normals.real, -normals.imag, along.real, across.real
    T[:, 0], T[:, 1], T[:, 2], T[:, 3] = normals.imag, normals.real, along.imag, across.imag
    N[:, 4], T[:, 4] = -T[:, 3], N[:, 3]
    weights = stack.weights[owners]
    weighted = distances * weights
    half_kappa = (m * m - np.abs(d) ** 2) / (2 * steepness**3)
    rotation = STRAIN_SIGNS * (weighted / steepness)[:, None]
    curvature = (T * ((weighted * half_kappa)[:, None] - rotation)) @ T.transpose(0, 2, 1)
    return (
        (distances * weighted).sum(axis=1),
        -multiply_vectors(N, weighted),
        (N * weights[:, None]) @ N.transpose(0, 2, 1),
        curvature + curvature.transpose(0, 2, 1),
    )


def _nearest_points(
    points: ComplexArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, ComplexArray, ComplexArray]:
    """Return distance, |m w - d conj(w)|, unit normal and w of the nearest points, (k, n) each."""
    centre, m, d = split_parameters(parameters)
    offsets = points - centre
    w = m * offsets - d * offsets.conj()
    w /= np.abs(w)
    moving = True
    for _ in range(MAX_FOOT_ITERATIONS):
        along, across = m * w, d * w.conj()
        foot, normals = along + across, along - across
        residuals = offsets - foot
        if not moving:
            break
        bending = normals.real**2 + normals.imag**2 + (residuals * foot.conj()).real
        turn = (residuals * normals.conj()).imag / bending
        moving = bool((np.abs(turn) >= FOOT_TOLERANCE).any())
        w *= 1 + 1j * turn
        w /= np.abs(w)
    steepness = np.abs(normals)
    normals /= steepness
    return (residuals * normals.conj()).real, steepness, normals, w


def _linearise_radial(
    problem: EllipseProblem, parameters: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Return sum of squares, J'r and J'J of the paper's radial residuals."""
    (rows,), _ = ProblemStack.of([problem]).evaluate(parameters[None])
    residuals, jacobian = rows[PARAMETERS], -rows[:PARAMETERS].T
    return float(residuals @ residuals), jacobian.T @ residuals, jacobian.T @ jacobian


def _differentiate_priors(
    problem: EllipseProblem, parameters: FloatArray, residuals: FloatArray
) -> FloatArray:
    """Return the sum of residual times second derivative of the priors, (5, 5), by differences."""
    m, p, q = parameters[2:].tolist()
    step = DIFFERENCE_STEP * max(math.hypot(p, q), DIFFERENCE_STEP * m)
    curvature = np.zeros((PARAMETERS, PARAMETERS))
    for i in range(2, PARAMETERS):
        shift = step * np.eye(PARAMETERS)[i]
        # The rows contain the negative derivatives.
        ahead, behind = (problem.prior_rows(parameters + s * shift) for s in (1, -1))
        curvature[i] = (behind - ahead)[:, :PARAMETERS].T @ residuals / (2 * step)
    return (curvature + curvature.T) / 2


def multiply_vectors(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Multiply k matrices (k, i, j) by k vectors (k, j)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
