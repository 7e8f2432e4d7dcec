"""Ellipse parameters that are regular at a circle, and residuals of points from the ellipse.

The ellipse is ``c + E w`` for all unit vectors w, with the symmetric matrix ``E = [[m + p, q], [q,
m - p]]``; so ``a = m + h``, ``b = m - h``, ``h = |(p, q)|`` and ``theta = atan2(q, p) / 2``. Since
``cos(phi) = b / a``, ``tan^2(phi / 2) = h / m``. In (a, b, theta) a circle (a pipe perpendicular to
the laser plane) is a singular point; in (m, p, q) it is regular.

Points z = x + iy, unit vectors w and the deviator d = p + iq are complex numbers here and in the
other modules of the package, so that ``E w = m w + d conj(w)``.
"""

import math
from typing import Any

import numpy as np

from lsvision.errors import FitFailed
from lsvision.geometry import BoolArray, Ellipse, FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.geometry.ellipse import MAX_FOOT_POINT_ITERATIONS, find_foot_directions
from lsvision.geometry.noisy_points import ComplexArray

PARAMETERS = 5
"""Number of parameters: centre x, y, m, p, q."""
FOOT_TOLERANCE = 3e-3
"""Newton step (rad) below which the iteration ends: nearest points are then exact to 1e-5 rad and
distances to 1e-9 mm."""
MAX_FOOT_STEP = 0.2
"""Largest Newton step (rad) of a point near the ellipse."""
MIN_SEMI_MINOR_MM = 1e-12
"""Smallest |b| as a divisor. Units: mm."""
MIN_AXIS_RATIO = 1e-3
"""Smallest axis ratio of a valid ellipse; below it the points are collinear."""


def orthogonal_residuals_and_normals(
    z: ComplexArray, parameters: FloatArray
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return signed distances to the nearest points c + E w of k ellipses, with their n and w.

    Parameters
    ----------
    z : (k, n) complex ndarray
        Points x + iy of each ellipse. Units: mm.
    parameters : (k, 5) ndarray
        Parameters of the ellipses. Units: mm.

    Returns
    -------
    signed : (k, n) ndarray
        Positive outside. Units: mm.
    normals, w : (k, n) complex ndarray
        Outward unit normal and unit vector of the nearest point.
    """
    centre, m, d = split_parameters(parameters)
    determinant = m * m - (d * d.conjugate()).real
    # The sign of det E, by which the adjugate is divided: negative where a step leads to b < 0.
    side = 2.0 * (determinant >= 0) - 1.0
    m = m + 0j  # numpy multiplies two complex numbers faster than a real and a complex one
    offsets = z - centre
    mean_part, deviator_part = m * offsets, d * offsets.conj()
    across, along = mean_part - deviator_part, mean_part + deviator_part
    w = across * (side / np.abs(across)).astype(complex)
    w = _find_nearest_by_newton(offsets, along, w, parameters, MAX_FOOT_POINT_ITERATIONS)
    conjugate = w.conj()
    normals = m * w
    normals -= d * conjugate
    scale = side / np.abs(normals)
    normals *= scale.astype(complex)
    across *= conjugate
    return (across.real - determinant) * scale, normals, w


def _find_nearest_by_newton(
    offsets: ComplexArray,
    along: ComplexArray,
    w: ComplexArray,
    parameters: FloatArray,
    iterations: int,
) -> ComplexArray:
    """Return w of the nearest points E w of k ellipses, by Newton's method from a first w.

    `along` is m offset + d conj(offset), (k, n): the derivative of the squared distance by the
    angle of w is then minus Im(along conj(w) - 2 m d conj(w)^2). Far from an ellipse the method may
    converge to the farthest point: after a large step all points of that ellipse restart from the
    closed-form nearest point. Ellipses whose points have converged are left out of further steps,
    so that the result of one does not depend on the others.
    """
    _, m, d = split_parameters(parameters)
    for remaining in range(iterations - 1, -1, -1):
        conjugate = w.conj()
        slopes = along * conjugate
        conjugate *= conjugate
        conjugate *= (2 * m) * d
        slopes -= conjugate
        curvatures = slopes.real - conjugate.real
        step = slopes.imag / curvatures
        turn = _build_complex(1.0, step)
        turn *= w
        w = turn * (1 / np.abs(turn)).astype(complex)
        largest_steps = np.abs(step).max(axis=1).tolist()
        lowest_curvatures = curvatures.min(axis=1).tolist()
        for row, (size, lowest) in enumerate(zip(largest_steps, lowest_curvatures, strict=True)):
            if not (size < MAX_FOOT_STEP and lowest > 0):
                w[row] = _find_nearest_directions(offsets[row], parameters[row])
        moving = [row for row, size in enumerate(largest_steps) if not size < FOOT_TOLERANCE]
        if len(moving) < len(w):
            if moving:
                arguments = offsets[moving], along[moving], w[moving], parameters[moving]
                w[moving] = _find_nearest_by_newton(*arguments, remaining)
            break
    return w


def _find_nearest_directions(offsets: ComplexArray, parameters: FloatArray) -> ComplexArray:
    """Return the unit vectors w of the nearest points E w, also for points far from them, (n,)."""
    a, b, rotation = axes_from_parameters(parameters)
    rotated = offsets * rotation.conjugate()
    cos, sin = find_foot_directions(rotated.real, rotated.imag, a, b)
    return _build_complex(cos, sin) * rotation


def radial_residuals_and_normals(
    z: ComplexArray, parameters: FloatArray
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return signed distances along the ray from the centre: the paper's r_j (Eq. 4).

    Parameters
    ----------
    z, parameters
        As for `orthogonal_residuals_and_normals`.

    Returns
    -------
    signed : (k, n) ndarray
        Signed residual of each point, positive outside. Units: mm.
    normals, w : (k, n) complex ndarray
        The normal divided by its cosine with the ray, so that -n d(c + E w) is again the
        derivative of the residual; unit vector of the point on the ray.
    """
    axes = [axes_from_parameters(row) for row in parameters]
    a, b, rotation = (np.array(column)[:, None] for column in zip(*axes, strict=True))
    offsets = (z - split_parameters(parameters)[0]) * rotation.conj()
    w = _build_complex(offsets.real / a, offsets.imag / b)
    rho, scaled = np.abs(offsets), np.abs(w)
    w /= scaled
    gradient = _build_complex(w.real / a, w.imag / b)
    along_ray = (gradient * offsets.conj()).real / rho
    return rho - rho / scaled, gradient * (rotation / along_ray), w * rotation


def parameter_jacobian(
    normals: ComplexArray, w: ComplexArray, out: FloatArray | None = None
) -> FloatArray:
    """Return the displacement of ellipses along their normals by each parameter, (..., 5, n).

    `normals` and the unit vectors `w` of the points c + E w are (..., n); `out` is the array into
    which the result is written.
    """
    jacobian = np.empty((*w.shape[:-1], PARAMETERS, w.shape[-1])) if out is None else out
    deviating = normals * w
    jacobian[..., 0, :], jacobian[..., 1, :] = normals.real, normals.imag
    jacobian[..., 2, :] = (normals * w.conj()).real
    jacobian[..., 3, :], jacobian[..., 4, :] = deviating.real, deviating.imag
    return jacobian


def split_parameters(parameters: FloatArray) -> tuple[Any, Any, Any]:
    """Return centre x + iy, m and d = p + iq of ellipses (..., 5) as columns (..., 1).

    Those of a single ellipse are numbers, with which numpy is faster than with columns.
    """
    if parameters.size == PARAMETERS:
        x, y, m, p, q = parameters.ravel().tolist()
        return complex(x, y), m, complex(p, q)
    columns = parameters[..., :2].view(complex), parameters[..., 2:3]
    return *columns, parameters[..., 3:].view(complex)


def deviator_from_parameters(parameters: FloatArray) -> complex:
    """Return p + iq of one ellipse. Units: mm."""
    return complex(*parameters[-2:].tolist())


def deviators_from_parameters(parameters: FloatArray) -> ComplexArray:
    """Return p + iq of (k, 5) parameters, row by row in memory, as a view (k,). Units: mm."""
    return parameters[:, 3:].view(complex)[:, 0]


def parameters_from_ellipse(ellipse: Ellipse) -> FloatArray:
    """Return (centre_x, centre_y, m, p, q) of an ellipse. Units: mm."""
    m = (ellipse.semi_major + ellipse.semi_minor) / 2
    h = (ellipse.semi_major - ellipse.semi_minor) / 2
    p, q = h * math.cos(2 * ellipse.theta), h * math.sin(2 * ellipse.theta)
    return np.array([*ellipse.centre, m, p, q])


def ellipse_from_parameters(parameters: FloatArray) -> Ellipse:
    """Return the ellipse of (centre_x, centre_y, m, p, q).

    Raises
    ------
    FitFailed
        If the parameters are not finite, or the axis ratio is below `MIN_AXIS_RATIO`.
    """
    if not is_ellipse(parameters):
        a, b, _ = axes_from_parameters(parameters)
        raise FitFailed(
            f"the points have no ellipse (semi-axes {a:.3g} and {b:.3g} mm): they lie on a "
            "straight line or on two; leave them out"
        )
    x, y, m, p, q = parameters.tolist()
    h = math.hypot(p, q)
    return Ellipse((x, y), m + h, m - h, math.atan2(q, p) / 2)


def is_ellipse(parameters: FloatArray) -> bool:
    """Return whether parameters are finite and their axis ratio is above `MIN_AXIS_RATIO`."""
    x, y, m, p, q = parameters.tolist()
    h = math.hypot(p, q)
    return math.isfinite(x + y + m + h) and MIN_AXIS_RATIO * (m + h) < m - h


def are_ellipses(parameters: FloatArray) -> BoolArray:
    """Return `is_ellipse` of each of (..., 5) parameters, (...)."""
    rows = parameters.reshape(-1, PARAMETERS)
    return np.array([is_ellipse(row) for row in rows], dtype=bool).reshape(parameters.shape[:-1])


def compute_semi_minor(parameters: FloatArray) -> float:
    """Return the semi-minor axis b = m - h. Units: mm."""
    return float(parameters[2]) - abs(deviator_from_parameters(parameters))


def semi_minor_gradient(parameters: FloatArray) -> FloatArray:
    """Return the derivative of b by the parameters, (5,); at a circle in the direction p > 0."""
    return _semi_axis_gradient(parameters, -1.0)


def add_step_on_cone(parameters: FloatArray, step: FloatArray) -> FloatArray:
    """Return parameters (5,) plus a step, where b changes by its gradient times the step.

    Ellipses of the same b form the cone m = b + h, which a straight step leaves; m is changed so
    that it does not. Units: mm.
    """
    moved: FloatArray = parameters + step
    b = compute_semi_minor(parameters) + float(semi_minor_gradient(parameters) @ step)
    moved[2] = b + abs(deviator_from_parameters(moved))
    return moved


def semi_major_gradient(parameters: FloatArray) -> FloatArray:
    """Return the derivative of a by the parameters, (5,); at a circle in the direction p > 0."""
    return _semi_axis_gradient(parameters, 1.0)


def axis_ratio_gradient(parameters: FloatArray) -> FloatArray:
    """Return the derivative of b / a by the parameters, (5,); at a circle, for p > 0."""
    m, h = float(parameters[2]), abs(deviator_from_parameters(parameters))
    major, minor = semi_major_gradient(parameters), semi_minor_gradient(parameters)
    return (minor - major * ((m - h) / (m + h))) / (m + h)


def phi_std_from_ratio(phi: float, ratio_std: float) -> float:
    """Return the standard uncertainty of phi = arccos(b / a) from that of b / a. Units: rad.

    That of the ratio, divided by sin(phi); where phi is smaller than its error, the phi whose ratio
    is one standard uncertainty from 1.
    """
    return min(ratio_std / max(math.sin(phi), TINY), math.acos(max(1 - ratio_std, 0.0)))


def axes_from_parameters(parameters: FloatArray) -> tuple[float, float, complex]:
    """Return a, |b| in mm and cos theta + i sin theta of (centre_x, centre_y, m, p, q)."""
    _, _, m, p, q = parameters.tolist()
    h = math.hypot(p, q)
    theta = 0.5 * math.atan2(q, p)
    return abs(m + h), max(abs(m - h), MIN_SEMI_MINOR_MM), complex(math.cos(theta), math.sin(theta))


def _build_complex(real: FloatArray | float, imaginary: FloatArray) -> ComplexArray:
    """Return complex numbers; twice as fast as ``real + 1j * imaginary``."""
    numbers = np.empty(imaginary.shape, dtype=complex)
    numbers.real, numbers.imag = real, imaginary
    return numbers


def _semi_axis_gradient(parameters: FloatArray, sign: float) -> FloatArray:
    """Return the derivative of m + sign h, (5,)."""
    d = deviator_from_parameters(parameters)
    direction = sign * d / abs(d) if d else complex(sign)
    return np.array([0.0, 0.0, 1.0, direction.real, direction.imag])
