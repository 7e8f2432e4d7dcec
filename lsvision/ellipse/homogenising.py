"""Homogenising (paper section 3.3.2): resampling of an arc at equal steps of arc length.

The paper's spline over x fails on vertical flanks, where x does not increase; arc length always
does. The local quadratics of smoothing are already evaluated at equal steps of arc length, so that
no spline is needed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import (
    PARAMETERS,
    ellipse_from_parameters,
    is_ellipse,
    parameter_jacobian,
    parameters_from_ellipse,
    split_parameters,
)
from lsvision.ellipse.robust_gauss_newton import (
    WeightedSystem,
    add_flattening_prior,
    damped_step,
)
from lsvision.ellipse.smoothing import SmoothedArc
from lsvision.geometry import Ellipse, Points
from lsvision.geometry.noisy_points import as_vectors


class HomogenisedArc(NamedTuple):
    """Smoothed points (k, 2), equally spaced along the arc, and their ellipse. Units: mm, rad."""

    points: Points
    ellipse: Ellipse


def homogenise_arcs(smoothed: Sequence[SmoothedArc]) -> list[HomogenisedArc]:
    """Return the smoothed points and ellipse of each arc, the initial guess of its refinement.

    All parts of an arc have equal weight, whatever the sensor's sampling density.
    """
    if not smoothed:
        return []
    parameters = np.array([parameters_from_ellipse(arc.ellipse) for arc in smoothed])
    w = np.array([arc.directions for arc in smoothed])
    rows = np.empty((len(w), PARAMETERS + 1, w.shape[1]))
    rows[:, PARAMETERS] = [arc.residuals for arc in smoothed]
    stds = np.array([arc.stds for arc in smoothed])
    centre, m, d = split_parameters(parameters)
    mean_part, deviator_part = m * w, d * w.conj()
    normals = mean_part - deviator_part
    normals /= np.abs(normals)
    mean_part += deviator_part
    z = centre + mean_part + normals * rows[:, PARAMETERS]
    # The residual is linear in small changes of the parameters: one Gauss-Newton step is enough.
    parameter_jacobian(normals, w, out=rows[:, :PARAMETERS])
    equations = WeightedSystem(rows, 1 / (stds * stds)).normal_equations()
    add_flattening_prior(equations, parameters)
    fitted = parameters + damped_step(equations, parameters)
    return [
        HomogenisedArc(
            as_vectors(points),
            ellipse_from_parameters(refined if is_ellipse(refined) else screened),
        )
        for points, refined, screened in zip(z, fitted, parameters, strict=True)
    ]
