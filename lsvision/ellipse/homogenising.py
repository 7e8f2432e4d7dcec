"""Homogenising (paper section 3.3.2): points at equal steps, along arc length.

The paper's spline runs over x and breaks where a flank is vertical (x no longer rises); along
arc length it does not. There the local quadratics of smoothing are evaluated at equal steps
already, so no spline is needed.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.parameters import (
    centre_of,
    ellipse_from_parameters,
    is_ellipse,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import refine_ellipse
from lsvision.ellipse.smoothing import SmoothedArc
from lsvision.geometry import Ellipse, Points
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors


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
    parameters = parameters_from_ellipse(smoothed.ellipse)
    m, d = float(parameters[2]), complex(parameters[3], parameters[4])
    along, across = m * smoothed.directions, d * smoothed.directions.conj()
    normals = along - across
    z = along + across + centre_of(parameters) + normals * (smoothed.residuals / np.abs(normals))
    points = NoisyPoints(z, smoothed.stds**2, np.zeros(len(z), dtype=complex))
    found, _ = refine_ellipse(points, parameters, steps=1)
    return HomogenisedArc(
        as_vectors(z), ellipse_from_parameters(found if is_ellipse(found) else parameters)
    )


def homogenise_profile_paper(points: Points, step_mm: float = 0.5) -> Points:
    """Points at equal steps of x by the spline y = S(x), as the paper says; for comparison.

    Parameters
    ----------
    points : (n, 2) ndarray
        Smoothed arc. Units: mm. Points whose x does not rise are left out: S(x) needs it.
    step_mm : float
        Units: mm.

    Returns
    -------
    (m, 2) ndarray
        Units: mm.
    """
    from scipy.interpolate import CubicSpline

    rising = points[np.concatenate([[True], points[1:, 0] > np.maximum.accumulate(points[:-1, 0])])]
    x = np.arange(rising[0, 0], rising[-1, 0], step_mm)
    return np.column_stack([x, CubicSpline(rising[:, 0], rising[:, 1])(x)])
