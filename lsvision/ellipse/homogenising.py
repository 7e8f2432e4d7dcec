"""Homogenising (paper section 3.3.2): resampling of an arc at equal steps of arc length.

The paper's spline over x fails on vertical flanks, where x does not increase; arc length always
does. The local quadratics of smoothing are already evaluated at equal steps of arc length, so that
no spline is needed.
"""

from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    centre_of,
    deviator_of,
    ellipse_from_parameters,
    is_ellipse,
    parameter_jacobian,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import add_flattening_prior, damped_step
from lsvision.ellipse.smoothing import SmoothedArc
from lsvision.geometry import Ellipse, Points
from lsvision.geometry.noisy_points import as_vectors


class HomogenisedArc(NamedTuple):
    """Smoothed points (k, 2), equally spaced along the arc, and their ellipse. Units: mm, rad."""

    points: Points
    ellipse: Ellipse


def homogenise_arc(smoothed: SmoothedArc) -> HomogenisedArc:
    """Return the smoothed points and their ellipse, the initial guess of the refinement.

    All parts of the arc have equal weight, whatever the sensor's sampling density.
    """
    parameters, w = parameters_from_ellipse(smoothed.ellipse), smoothed.directions
    m, d = float(parameters[2]), deviator_of(parameters)
    along, across = m * w, d * w.conj()
    normals = along - across
    normals /= np.abs(normals)
    z = centre_of(parameters) + along + across + normals * smoothed.residuals
    # The residual is linear in small changes of the parameters: one Gauss-Newton step is enough.
    rows = np.concatenate([parameter_jacobian(normals, w), smoothed.residuals[None]])
    equations = (rows[:PARAMETERS] / smoothed.stds**2) @ rows.T
    add_flattening_prior(equations, parameters)
    fitted = parameters + damped_step(equations, parameters)
    return HomogenisedArc(
        as_vectors(z), ellipse_from_parameters(fitted if is_ellipse(fitted) else parameters)
    )
