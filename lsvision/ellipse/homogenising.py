"""Homogenising (paper section 3.3.2): points at equal steps, along arc length.

The paper's spline runs over x and breaks where a flank is vertical (x no longer rises); along
arc length it does not. There the local quadratics of smoothing are evaluated at equal steps
already, so no spline is needed.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    centre_of,
    ellipse_from_parameters,
    is_ellipse,
    parameter_jacobian,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import add_flattening_prior, damped_step
from lsvision.ellipse.smoothing import SmoothedArc
from lsvision.geometry import Ellipse, Points
from lsvision.geometry.noisy_points import as_vectors


@dataclass(frozen=True, eq=False, slots=True)
class HomogenisedArc:
    """An arc, smoothed and homogenised.

    Parameters
    ----------
    points : (k, 2) ndarray
        Equally spaced along the arc, smoothed. Units: mm.
    ellipse : Ellipse
        Fit to them: the initial guess of the geometric refinement. Units: mm, rad.
    """

    points: Points
    ellipse: Ellipse


def homogenise_arc(smoothed: SmoothedArc) -> HomogenisedArc:
    """Place the smoothed residual beside the ellipse at equal steps, and fit an ellipse to it.

    Parameters
    ----------
    smoothed : SmoothedArc
        k positions of an arc.

    Returns
    -------
    HomogenisedArc
        Every part of the arc counts alike, however densely the sensor sampled it.
    """
    parameters, w = parameters_from_ellipse(smoothed.ellipse), smoothed.directions
    m, d = float(parameters[2]), complex(parameters[3], parameters[4])
    along, across = m * w, d * w.conj()
    normals = along - across
    normals /= np.abs(normals)
    z = centre_of(parameters) + along + across + normals * smoothed.residuals
    # The smoothed residual is linear in the change of the parameters: one step fits it.
    rows = np.concatenate([parameter_jacobian(normals, w), smoothed.residuals[None]])
    equations = (rows[:PARAMETERS] / smoothed.stds**2) @ rows.T
    add_flattening_prior(equations, parameters)
    found = parameters + damped_step(equations, parameters)
    return HomogenisedArc(
        as_vectors(z), ellipse_from_parameters(found if is_ellipse(found) else parameters)
    )
