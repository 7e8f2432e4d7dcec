"""Bias of an ellipse fitted to noisy points, to second order in their errors.

The error of a point has a component e_n along the outward normal of the ellipse, the residual, and
a component e_t along the tangent. The latter moves the foot of the point by e_t along the arc
length s, where the vector J, the displacement of the ellipse along its normal by each parameter,
differs by dJ/ds e_t. An error along the ray of the sensor has both components, so that residual and
J are correlated. The minimum of chi^2 then has the bias

    A^-1 sum w dJ/ds cov(e_n, e_t),    A = sum w J J',

with the inverse variances w of the residuals, which are taken as fixed: that they are evaluated at
the measured points changes the radius by 0.02 of its standard deviation (3000 points on 130 to 150
deg). Isotropic errors have no such bias: their fit is the geometric one. The mean of a residual,
kappa var(e_t) / 2 with the curvature kappa, is left out: for errors along Y its bias of the radius
is a thousandth of the above, for isotropic errors 0.07 of a standard deviation with 4000 points and
a noise of 1 % of the radius on 130 deg of a circle. A bias that does not grow, relative to the
standard deviations, with the number of points is left out, too.

For errors along Y the radius becomes too small: by 1.6 noise / radius sqrt(n) of its standard
deviations for n points on an arc of 130 deg, by 2.3 for 90 deg (0.3 for 400 points with a noise of
1 % of the radius, but 1 for 4000). For 60 points it is a twentieth of a standard deviation, and its
removal increases the rms error of theta near a circle by 2 %.

The fit of a cylinder avoids this bias by evaluating J at the most probable true points
(`lsvision.cylinder.problem`).
"""

from dataclasses import replace

import numpy as np

from lsvision.ellipse.parameters import parameter_jacobian, split_parameters
from lsvision.ellipse.problem import EllipseProblem, Solution
from lsvision.ellipse.robust_gauss_newton import solve_positive_definite
from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors


def remove_bias(
    problem: EllipseProblem, solution: Solution, points: NoisyPoints, variance_factor: float
) -> tuple[EllipseProblem, FloatArray]:
    """Return a problem with its points displaced such that its minimum has no bias.

    Parameters
    ----------
    problem : EllipseProblem
        Problem with orthogonal residuals of these points.
    solution : Solution
        Minimum of the problem.
    points : NoisyPoints
        Points (n,) with the covariances of their errors.
    variance_factor : float
        Ratio of the true variances to those of `points`.

    Returns
    -------
    problem : EllipseProblem
        Problem with points displaced along the normals by a small fraction of their noise; the
        same one if its points do not determine an ellipse.
    parameters : (5,) ndarray
        Parameters at its minimum without priors, to first order in the bias. Units: mm.
    """
    with np.errstate(all="ignore"):  # a result that is not finite is not used
        jacobian, slopes = _compute_jacobian_and_slopes(solution)
        rotated = points.deviator * (solution.normals * solution.normals)
        cross_covariances = -variance_factor * rotated.imag
        weights = 1 / (problem.stds * problem.stds)
        information = (jacobian * weights) @ jacobian.T
        bias = solve_positive_definite(information, slopes @ (weights * cross_covariances))
        z = points.z - (bias @ jacobian) * solution.normals
    if not np.isfinite(z).all():
        return problem, solution.parameters
    return replace(problem, points=as_vectors(z)), solution.parameters - bias


def _compute_jacobian_and_slopes(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Return J and dJ/ds of the points, (5, n); s increases anticlockwise.

    In the code w are unit vectors and not weights: the ellipse is c + E w, E w = m w + d conj(w).
    Its derivative by the angle of w is i length n, with the outward unit normal n.
    """
    _, m, d = split_parameters(solution.parameters)
    normals = solution.normals
    w = m * normals + d * normals.conj()
    w /= np.abs(w)
    length = np.abs(m * w - d * w.conj())
    curvature, turn = (m * m - abs(d) ** 2) / length**3, 1 / length
    jacobian = parameter_jacobian(normals, w)
    # Along the arc, n turns by kappa and w by 1 / length: n w turns by the sum of both.
    slopes, both = np.empty_like(jacobian), curvature + turn
    slopes[0], slopes[1] = -curvature * jacobian[1], curvature * jacobian[0]
    slopes[2] = (turn - curvature) * (normals * w.conj()).imag
    slopes[3], slopes[4] = -both * jacobian[4], both * jacobian[3]
    return jacobian, slopes
