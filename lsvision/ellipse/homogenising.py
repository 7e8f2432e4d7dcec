"""Homogenising (paper section 3.3.2): resampling of an arc at equal steps of arc length.

The paper resamples with a spline y(x), which fails on vertical flanks, where x does not increase;
arc length always increases. Smoothing (`lsvision.ellipse.smoothing`) already evaluates its local
quadratics at equal steps of arc length, so that no spline is needed.

Symbols: the point c + E w of an ellipse for a unit vector w, with E given by m and d = p + iq (see
`lsvision.ellipse.parameters`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.parameters import (
    ellipse_from_parameters,
    is_ellipse,
    parameter_jacobian,
    parameters_from_ellipse,
    split_parameters,
)
from lsvision.ellipse.robust_gauss_newton import WeightedSystem, solve_damped_step
from lsvision.ellipse.smoothing import SmoothedArc
from lsvision.geometry import Ellipse, Points
from lsvision.geometry.noisy_points import as_vectors


class HomogenisedArc(NamedTuple):
    """Points of an arc at equal steps of arc length, and the ellipse fitted to them.

    Parameters
    ----------
    points : (k, 2) ndarray
        Smoothed points. Units: mm.
    ellipse : Ellipse
        Ellipse of these points; the screened ellipse if the fit to the points is not an ellipse.
        Units: mm, rad.
    """

    points: Points
    ellipse: Ellipse


def homogenise_arcs(smoothed: Sequence[SmoothedArc]) -> list[HomogenisedArc]:
    """Return the smoothed points of each arc, and the ellipse fitted to them.

    The points are equally spaced, so that densely and sparsely sampled parts of an arc have equal
    weight in the fit. The ellipse is the initial guess of the geometric refinement.

    Parameters
    ----------
    smoothed : sequence of SmoothedArc
        Smoothed residuals of each arc.

    Returns
    -------
    list of HomogenisedArc
        One for each arc.
    """
    if not smoothed:
        return []
    screened = np.array([parameters_from_ellipse(arc.ellipse) for arc in smoothed])
    w = np.array([arc.directions for arc in smoothed])
    residuals = np.array([arc.residuals for arc in smoothed])
    stds = np.array([arc.stds for arc in smoothed])
    centre, m, d = split_parameters(screened)
    # E w is m w + d conj(w), and the outward normal there is along m w - d conj(w).
    mean_part, deviator_part = m * w, d * w.conj()
    normals = mean_part - deviator_part
    normals /= np.abs(normals)
    smoothed_points = centre + (mean_part + deviator_part) + normals * residuals
    # The residual is linear in small changes of the parameters: one Gauss-Newton step is enough.
    rows = np.concatenate([parameter_jacobian(normals, w), residuals[:, None]], axis=1)
    equations = WeightedSystem(rows, 1 / (stds * stds)).build_normal_equations()
    fitted = screened + solve_damped_step(equations, screened)
    return [
        HomogenisedArc(
            as_vectors(points),
            ellipse_from_parameters(refined if is_ellipse(refined) else initial),
        )
        for points, refined, initial in zip(smoothed_points, fitted, screened, strict=True)
    ]
