"""Second-order expansion of the costs of ellipse fits, about many ellipses at once.

The notation m, p, q, d, h and w is that of `lsvision.ellipse.parameters`. The cost F of a fit is
the sum of its squared residuals r over their standard deviations, with those of the priors, divided
by the variance factor: -2 log likelihood up to a constant. About parameters (centre_x, centre_y, m,
p, q) it is F + 2 b' delta + delta' A delta, with b = J' r and A = J' J + sum r Hess r (both over
the variance factor). So A is the observed information about the parameters, and A^-1 their
covariance.

Orthogonal distances D have closed-form second derivatives. Parameter i moves the point P(t) = c +
m w + d conj(w), w = exp(it), by X_i = (1, i, w, conj w, i conj w): by N_i along the outward unit
normal n, by T_i along the unit tangent i n, and rotates the tangent by a_i. With the curvature k
and the speed |P'|,

    dD / dp_i = -N_i,    a_i = -Re(X_i' conj n) / |P'| = (0, 0, 1, -1, -1) T_i / |P'|,

since the foot of a point moves along the tangent only: by -T_j, so that the point P under it has
dt / dp_j = -T_j / |P'|. The normal at the foot then turns by a_j - k T_j, and N_i = Re(X_i conj n)
has the derivative T_i (a_j - k T_j) + a_i T_j. Therefore

    d^2 D / dp_i dp_j = k T_i T_j - a_i T_j - a_j T_i,

where terms in D times the curvature are neglected. (Ahn et al., Least-squares orthogonal distances
fitting, Pattern Recognition 34, 2001, have the first derivatives.)
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
ROTATION_SIGNS = np.array([0.0, 0.0, 1.0, -1.0, -1.0])[:, None]
"""Rotation a_i of the tangent by each parameter, in units of its tangential displacement T_i over
the speed |P'|."""
DIFFERENCE_STEP = 1e-4
"""Step of central differences of the priors, as a fraction of h; at a circle its square, as a
fraction of m. The relative error of the derivatives is the square of the step, 1e-8, and that of
rounding 1e-12."""
REGULARISATION = 1e-12
"""Fraction of its diagonal elements, plus 1/mm^2, that is added to them, so that A is always
invertible."""


class SquaresExpansion(NamedTuple):
    """Second-order expansion of k sums of squares, not divided by the variance factors.

    Parameters
    ----------
    squares : (k,) ndarray
        Sums of squares of the residuals r, over their standard deviations.
    gradient : (k, 5) ndarray
        Half of their gradients, J' r. Units: 1/mm.
    gauss_newton, residual_hessian : (k, 5, 5) ndarray
        Both parts of half of their second derivatives: J' J, and sum r Hess r. Units: 1/mm^2.
    """

    squares: FloatArray
    gradient: FloatArray
    gauss_newton: FloatArray
    residual_hessian: FloatArray


class Expansion(NamedTuple):
    """F about k rows of parameters.

    Parameters
    ----------
    parameters : (k, 5) ndarray
        Parameters about which F is expanded. Units: mm.
    cost, cost_of_points : (k,) ndarray
        F with and without the priors.
    gradient, gradient_of_points : (k, 5) ndarray
        b with and without the priors: half of the gradient. Units: 1/mm.
    information, information_of_points : (k, 5, 5) ndarray
        A with and without the priors: half of the second derivatives. Units: 1/mm^2.
    covariance : (k, 5, 5) ndarray
        Inverse of A. Units: mm^2.
    """

    parameters: FloatArray
    cost: FloatArray
    gradient: FloatArray
    information: FloatArray
    covariance: FloatArray
    cost_of_points: FloatArray
    gradient_of_points: FloatArray
    information_of_points: FloatArray


def expand_cost(stack: FitStack, fit_indices: IntArray, parameters: FloatArray) -> Expansion:
    """Expand F to second order.

    Parameters
    ----------
    stack : FitStack
        Fits with their problems and variance factors.
    fit_indices : (k,) int ndarray
        Index of the fit of each row.
    parameters : (k, 5) ndarray
        Parameters about which F is expanded. Units: mm.

    Returns
    -------
    Expansion
        An indefinite A is replaced by its Gauss-Newton approximation J'J (of points alone it is
        not); the cost is infinite where the expansion is not finite.
    """
    variance_factors = stack.variance_factors[fit_indices]
    factor_rows, factor_matrices = variance_factors[:, None], variance_factors[:, None, None]
    expansion = _expand_points(stack, fit_indices, parameters)
    squares, gradient, gauss_newton, residual_hessian = expansion
    cost_of_points, gradient_of_points = squares / variance_factors, gradient / factor_rows
    information_of_points = (gauss_newton + residual_hessian) / factor_matrices
    _add_priors(stack, fit_indices, parameters, expansion)
    information = gauss_newton + residual_hessian
    if not math.isfinite(float(information.sum())):
        infinite = ~np.isfinite(information).all(axis=(1, 2))
        information[infinite] = np.eye(PARAMETERS)
        squares[infinite] = cost_of_points[infinite] = np.inf
    _make_positive_definite(information, gauss_newton)
    information /= factor_matrices
    return Expansion(
        parameters=parameters,
        cost=squares / variance_factors,
        gradient=gradient / factor_rows,
        information=information,
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        cost_of_points=cost_of_points,
        gradient_of_points=gradient_of_points,
        information_of_points=information_of_points,
    )


def _make_positive_definite(information: FloatArray, gauss_newton: FloatArray) -> None:
    """Replace indefinite A (k, 5, 5) by J'J and add `REGULARISATION`, in place."""
    try:
        np.linalg.cholesky(information)  # a quarter of the time of the eigenvalues
    except np.linalg.LinAlgError:
        indefinite = ~(np.linalg.eigvalsh(information)[:, 0] > 0)
        information[indefinite] = gauss_newton[indefinite]
    information += REGULARISATION * (information + 1.0) * np.eye(PARAMETERS)


def _expand_points(
    stack: FitStack, fit_indices: IntArray, parameters: FloatArray
) -> SquaresExpansion:
    """Expand the sum of squares of the points; that of radial residuals by Gauss-Newton."""
    expansion = _expand_orthogonal(stack, fit_indices, parameters)
    squares, gradient, gauss_newton, residual_hessian = expansion
    for k in np.flatnonzero(stack.radial[fit_indices]):
        problem = stack.fits[fit_indices[k]].problem
        squares[k], gradient[k], gauss_newton[k] = _linearise_radial(problem, parameters[k])
        residual_hessian[k] = 0.0
    return expansion


def _add_priors(
    stack: FitStack, fit_indices: IntArray, parameters: FloatArray, expansion: SquaresExpansion
) -> None:
    """Add the residuals of the priors to the sums of squares, in place."""
    squares, gradient, gauss_newton, residual_hessian = expansion
    for k in np.flatnonzero(stack.has_prior[fit_indices]):
        problem = stack.fits[fit_indices[k]].problem
        rows = problem.linearise_priors(parameters[k])
        residuals, jacobian = rows[:, PARAMETERS], -rows[:, :PARAMETERS]
        squares[k] += residuals @ residuals
        gradient[k] += jacobian.T @ residuals
        gauss_newton[k] += jacobian.T @ jacobian
        residual_hessian[k] += _differentiate_priors(problem, parameters[k], residuals)


def _expand_orthogonal(
    stack: FitStack, fit_indices: IntArray, parameters: FloatArray
) -> SquaresExpansion:
    """Expand the sums of squares of the orthogonal distances; see the docstring of the module."""
    distances, speed, normals, w = _find_nearest_points(stack.points[fit_indices], parameters)
    _, m, d = split_parameters(parameters)
    normals = normals.conj()
    # X_i conj(n) for X_i = w and conj w; its real part is N_i, its imaginary part T_i.
    of_m, of_p = w * normals, w.conj() * normals
    N, T = np.empty((2, len(w), PARAMETERS, w.shape[1]))
    N[:, 0], N[:, 1], N[:, 2], N[:, 3] = normals.real, -normals.imag, of_m.real, of_p.real
    T[:, 0], T[:, 1], T[:, 2], T[:, 3] = normals.imag, normals.real, of_m.imag, of_p.imag
    N[:, 4], T[:, 4] = -T[:, 3], N[:, 3]
    weights = stack.weights[fit_indices]
    weighted = distances * weights
    # A half of sum r Hess r, to which its transpose is added: r (k T_i T_j / 2 - a_i T_j).
    half_k = (m * m - np.abs(d) ** 2) / (2 * speed**3)
    weighted_rotations = ROTATION_SIGNS * (weighted / speed)[:, None]
    half_hessian = (T * ((weighted * half_k)[:, None] - weighted_rotations)) @ T.transpose(0, 2, 1)
    return SquaresExpansion(
        squares=(distances * weighted).sum(axis=1),
        gradient=-multiply_vectors(N, weighted),
        gauss_newton=(N * weights[:, None]) @ N.transpose(0, 2, 1),
        residual_hessian=half_hessian + half_hessian.transpose(0, 2, 1),
    )


def _find_nearest_points(
    points: ComplexArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, ComplexArray, ComplexArray]:
    """Return distance, speed |m w - d conj(w)|, unit normal and w of the nearest points, (k, n).

    By Newton's method on the angle of w, as `orthogonal_residuals_and_normals` but without its
    safeguard for points far from the ellipse: a step that leads there is rejected by its cost.
    """
    centre, m, d = split_parameters(parameters)
    offsets = points - centre
    w = m * offsets - d * offsets.conj()
    w /= np.abs(w)
    moving = True
    for _ in range(MAX_FOOT_ITERATIONS):
        m_part, d_part = m * w, d * w.conj()
        feet, normals = m_part + d_part, m_part - d_part
        residuals = offsets - feet
        if not moving:
            break
        # Half of the squared distance has the derivative -Im(residual conj(normal)) by the angle;
        # its second derivative:
        curvatures = normals.real**2 + normals.imag**2 + (residuals * feet.conj()).real
        steps = (residuals * normals.conj()).imag / curvatures
        moving = bool((np.abs(steps) >= FOOT_TOLERANCE).any())
        w *= 1 + 1j * steps
        w /= np.abs(w)
    speed = np.abs(normals)
    normals /= speed
    return (residuals * normals.conj()).real, speed, normals, w


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
    """Return sum r Hess r of the priors, (5, 5), by central differences of their derivatives.

    The priors do not depend on the centre.
    """
    m, p, q = parameters[2:].tolist()
    step = DIFFERENCE_STEP * max(math.hypot(p, q), DIFFERENCE_STEP * m)
    hessian = np.zeros((PARAMETERS, PARAMETERS))
    for i in range(2, PARAMETERS):
        shift = step * np.eye(PARAMETERS)[i]
        # The rows contain the negative derivatives.
        ahead, behind = (problem.linearise_priors(parameters + sign * shift) for sign in (1, -1))
        hessian[i] = (behind - ahead)[:, :PARAMETERS].T @ residuals / (2 * step)
    return (hessian + hessian.T) / 2


def multiply_vectors(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Multiply k matrices (k, i, j) by k vectors (k, j)."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
