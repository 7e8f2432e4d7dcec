"""Steps of ellipse parameters in coordinates that suit an arc.

A step of the search for interval ends (`lsvision.ellipse.interval_ends`) is computed to first
order, from an expansion in (centre_x, centre_y, m, p, q). On a short arc these are strongly
correlated, and the points determine the ellipse near the arc, not its centre. The step is therefore
taken in the coordinates

    middle point of the arc, log m, e = d / m,

in which the region {F <= min F + c} of a short arc is more nearly an ellipsoid: size and shape vary
by factors. F is the cost, c its critical increase (`lsvision.ellipse.critical_ratio`). Both steps
agree to first order, so that the convergence stays quadratic. For m, p, q, d, h and w see
`lsvision.ellipse.parameters`.
"""

import numpy as np

from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import deviators_from_parameters
from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray, as_vectors

MIN_PHI_RATIO = 0.1
"""Smallest ratio of phi after a step to that before it, with a known phi: from phi = 0 no further
step could be computed."""


def move_along_arcs(
    stack: FitStack,
    fit_indices: IntArray,
    parameters: FloatArray,
    targets: FloatArray,
    fractions: FloatArray,
) -> FloatArray:
    """Return parameters after fractions of the steps to targets, in the coordinates of the arcs.

    A full step to a circle leads to one. A known radius is preserved by steps that preserve it to
    first order, and so is a known phi whose prior excludes a circle: off the ellipses of that phi
    the prior makes F large, and the step would be rejected.

    Parameters
    ----------
    stack : FitStack
        The fits.
    fit_indices : (k,) int ndarray
        Index of the fit of each row.
    parameters, targets : (k, 5) ndarray
        Start and end of the full steps. Units: mm.
    fractions : (k,) ndarray
        Fractions of the steps.

    Returns
    -------
    (k, 5) ndarray
        It may be no ellipse (|d| >= m, or NaN): the search rejects such a step.
    """
    steps = fractions[:, None] * (targets - parameters)
    m, d = parameters[:, 2], deviators_from_parameters(parameters)
    dm, dd = steps[:, 2], deviators_from_parameters(steps)
    new_e = d / m + (dd - d * dm / m) / m  # e = d / m after the step, to first order
    circle_excluded = ~stack.may_be_circle[fit_indices]
    if circle_excluded.any():
        e = d[circle_excluded] / m[circle_excluded]
        new_e[circle_excluded] = _step_along_phi(e, new_e[circle_excluded])
    is_circle = ~targets[:, 3:].any(axis=1) & (fractions == 1)
    new_e[is_circle] = 0.0
    new_m = m * np.exp(dm / m)
    # With a known radius b = m - |d| changes linearly, and m follows from b and d / m. From a
    # circle |d| increases by |dd|, in whatever direction.
    u = np.where(d == 0, dd, d)
    u = np.where(u == 0, 1.0, u / np.abs(u))
    m_of_known_radius = (m - np.abs(d) + dm - (dd * u.conj()).real) / (1 - np.abs(new_e))
    new_m = np.where(stack.known_radius[fit_indices], m_of_known_radius, new_m)
    new_d = new_m * new_e
    # The centre moves so that the middle point, centre + m w + d conj(w), moves linearly.
    w = stack.arc_middles[fit_indices]
    moved = parameters + steps
    moved[:, :2] += as_vectors((m + dm - new_m) * w + (d + dd - new_d) * w.conj())
    moved[:, 2], moved[:, 3:] = new_m, as_vectors(new_d)
    return moved


def _step_along_phi(e: ComplexArray, new_e: ComplexArray) -> ComplexArray:
    """Return d / m (k,) after a step from `e` towards `new_e` that is linear in phi.

    So a prior on phi remains satisfied. Its derivative does not exist at a circle, which the prior
    excludes: phi decreases to a tenth at most in one step (`MIN_PHI_RATIO`).

    phi = 2 arctan(sqrt(h / m)) has the derivative 1 / (sqrt(h / m) (1 + h / m)) by h / m.
    """
    flattening = np.abs(e)
    root = np.sqrt(flattening)
    phi_step = ((new_e - e) * e.conj()).real / (flattening * root * (1 + flattening))
    phi = 2 * np.arctan(root)
    phi = np.clip(phi + phi_step, MIN_PHI_RATIO * phi, np.pi / 2)
    moved: ComplexArray = np.tan(phi / 2) ** 2 * new_e / np.abs(new_e)
    return moved
