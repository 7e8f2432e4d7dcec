"""Ellipse parameters that are regular at a circle, and residuals of points from the ellipse.

The ellipse is ``c + E w`` for all unit vectors w, with the symmetric matrix
``E = [[m + p, q], [q, m - p]]``; so ``a = m + h``, ``b = m - h``, ``h = |(p, q)|`` and
``theta = atan2(q, p) / 2``. In (a, b, theta) a circle (a pipe perpendicular to the laser plane)
is a singular point; in (m, p, q) it is regular.
"""

import math

import numpy as np

from lsvision.errors import FitFailed
from lsvision.geometry import Ellipse, FloatArray, Points
from lsvision.geometry.ellipse import MAX_FOOT_POINT_ITERATIONS, foot_directions
from lsvision.geometry.noisy_points import ComplexArray, as_complex

PARAMETERS = 5
"""Number of parameters: centre x, y, m, p, q."""
FOOT_TOLERANCE = 3e-3
"""Newton step (rad) below which the iteration ends: nearest points are then exact to 1e-5 rad and
distances to 1e-9 mm."""
MAX_STEP = 0.2
"""Largest Newton step (rad) of a point near the ellipse."""
MIN_AXIS_RATIO = 1e-3
"""Smallest axis ratio of a valid ellipse; below it the points are collinear."""


def orthogonal_residuals_and_normals(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return signed distances to the nearest points c + E w, with normal n and w of each.

    Returns
    -------
    signed : (n,) ndarray
        Positive outside. Units: mm.
    normals, w : (n,) complex ndarray
        Outward unit normal and unit vector of the nearest point.

    Notes
    -----
    Newton's method along the ellipse, from its intersection with the ray to each point; the
    distance changes by -n d(c + E w). Far from an ellipse it may converge to the farthest point:
    after a large step all points restart from the closed-form nearest point.
    """
    (m, p, q), offsets = parameters[2:].tolist(), as_complex(points) - centre_of(parameters)
    d = complex(p, q)
    side, squares = math.copysign(1.0, m * m - abs(d) ** 2), 2 * (m * m + abs(d) ** 2)
    w = (side * m) * offsets - (side * d) * offsets.conj()
    w /= np.abs(w)
    largest = math.inf
    for _ in range(MAX_FOOT_POINT_ITERATIONS):
        mean_part, deviator_part = m * w, d * w.conj()
        foot, normals = mean_part + deviator_part, mean_part - deviator_part
        residuals = offsets - foot
        if largest < FOOT_TOLERANCE:
            break
        # Derivative by the step: |normals|^2 + residuals . foot, where |foot|^2 + |normals|^2 is
        # the same everywhere.
        derivative = ((residuals - foot) * foot.conj()).real + squares
        step = (residuals * normals.conj()).imag / derivative
        largest = float(np.abs(step).max(initial=0.0))
        if not (largest < MAX_STEP and derivative.min() > 0):
            w = _nearest_directions(offsets, parameters)
        else:
            w *= 1 + 1j * step
            w /= np.abs(w)
    normals *= side / np.abs(normals)
    return (residuals * normals.conj()).real, normals, w


def _nearest_directions(offsets: ComplexArray, parameters: FloatArray) -> ComplexArray:
    """Return the unit vectors w of the nearest points E w, also for points far from them."""
    a, b, rotation = axes_of(parameters)
    rotated = offsets * rotation.conjugate()
    cos, sin = foot_directions(rotated.real, rotated.imag, a, b)
    return _complex(cos, sin) * rotation


def radial_residuals_and_normals(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return signed distances along the ray from the centre: the paper's r_j (Eq. 4).

    Returns
    -------
    signed : (n,) ndarray
        Signed residual of each point, positive outside. Units: mm.
    normals, w : (n,) complex ndarray
        The normal divided by its cosine with the ray, so that -n d(c + E w) is again the
        derivative of the residual; unit vector of the point on the ray.
    """
    a, b, rotation = axes_of(parameters)
    offsets = (as_complex(points) - centre_of(parameters)) * rotation.conjugate()
    w = _complex(offsets.real / a, offsets.imag / b)
    rho, scaled = np.abs(offsets), np.abs(w)
    w /= scaled
    gradient = _complex(w.real / a, w.imag / b)
    along_ray = (gradient * offsets.conj()).real / rho
    return rho - rho / scaled, gradient * (rotation / along_ray), w * rotation


def parameter_jacobian(
    normals: ComplexArray, w: ComplexArray, out: FloatArray | None = None
) -> FloatArray:
    """Return the derivative of the ellipse along its normals by each parameter: (5, n)."""
    jacobian = np.empty((PARAMETERS, len(w))) if out is None else out
    deviating = normals * w
    jacobian[0], jacobian[1] = normals.real, normals.imag
    jacobian[2] = (normals * w.conj()).real
    jacobian[-2], jacobian[-1] = deviating.real, deviating.imag
    return jacobian


def centre_of(parameters: FloatArray) -> complex:
    """Return the centre as x + iy. Units: mm."""
    return complex(*parameters[:2].tolist())


def deviator_of(parameters: FloatArray) -> complex:
    """Return p + iq. Units: mm."""
    return complex(*parameters[-2:].tolist())


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
    a, b, turn = axes_of(parameters)
    if not is_ellipse(parameters):
        raise FitFailed(
            f"the points have no ellipse (semi-axes {a:.3g} and {b:.3g} mm): they lie on a "
            "straight line or on two; leave them out"
        )
    centre = (float(parameters[0]), float(parameters[1]))
    return Ellipse(centre, a, b, math.atan2(turn.imag, turn.real))


def is_ellipse(parameters: FloatArray) -> bool:
    """Return whether parameters are finite and their axis ratio is above `MIN_AXIS_RATIO`."""
    x, y, m, p, q = parameters.tolist()
    h = math.hypot(p, q)
    return math.isfinite(x + y + m + h) and MIN_AXIS_RATIO * (m + h) < m - h


def semi_minor(parameters: FloatArray) -> float:
    """Return the semi-minor axis b = m - h. Units: mm."""
    return float(parameters[2]) - abs(deviator_of(parameters))


def semi_minor_gradient(parameters: FloatArray) -> FloatArray:
    """Return the derivative of b by the parameters, (5,); at a circle in the direction p > 0."""
    return _semi_axis_gradient(parameters, -1.0)


def semi_major_gradient(parameters: FloatArray) -> FloatArray:
    """Return the derivative of a by the parameters, (5,); at a circle in the direction p > 0."""
    return _semi_axis_gradient(parameters, 1.0)


def axes_of(parameters: FloatArray) -> tuple[float, float, complex]:
    """Return a, |b| in mm and cos theta + i sin theta of (centre_x, centre_y, m, p, q)."""
    _, _, m, p, q = parameters.tolist()
    h = math.hypot(p, q)
    theta = 0.5 * math.atan2(q, p)
    return abs(m + h), max(abs(m - h), 1e-12), complex(math.cos(theta), math.sin(theta))


def _complex(real: FloatArray, imaginary: FloatArray) -> ComplexArray:
    numbers = np.empty(len(real), dtype=complex)
    numbers.real, numbers.imag = real, imaginary
    return numbers


def _semi_axis_gradient(parameters: FloatArray, sign: float) -> FloatArray:
    """Return the derivative of m + sign h, (5,)."""
    d = deviator_of(parameters)
    direction = sign * d / abs(d) if d else complex(sign)
    return np.array([0.0, 0.0, 1.0, direction.real, direction.imag])
