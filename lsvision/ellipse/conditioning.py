"""Smoothing and homogenising of one arc on the residual to its screened ellipse (paper 3.3)."""

import cmath
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.homogenising import HomogenisingSettings, homogenise
from lsvision.ellipse.parameters import (
    centre_of,
    ellipse_from_parameters,
    is_ellipse,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals, refine_ellipse
from lsvision.ellipse.smoothing import SmoothingSettings, smooth_residual
from lsvision.shapes import BoolArray, Ellipse, FloatArray, Points
from lsvision.shapes.noisy_points import ComplexArray, NoisyPoints, as_vectors


@dataclass(frozen=True, eq=False, slots=True)
class ConditionedArc:
    """An arc, smoothed and homogenised.

    Parameters
    ----------
    points : (m, 2) ndarray
        Equally spaced along the arc, smoothed. Units: mm.
    ellipse : Ellipse
        Quick fit to them: the start of the geometric refinement. Units: mm, rad.
    inliers : (n,) bool ndarray
        The measured points that are neither jump nor stray.
    """

    points: Points
    ellipse: Ellipse
    inliers: BoolArray


def condition_arc(
    points: NoisyPoints,
    ellipse: Ellipse,
    smoothing: SmoothingSettings = SmoothingSettings(),
    homogenising: HomogenisingSettings = HomogenisingSettings(),
) -> ConditionedArc:
    """Smooth and homogenise the points of a screened arc; find the jumps among them.

    Parameters
    ----------
    points : NoisyPoints
        Of the arc, n of them.
    ellipse : Ellipse
        The screened ellipse. Units: mm, rad.
    smoothing, homogenising : settings
        Sections 3.3.1 and 3.3.2.

    Returns
    -------
    ConditionedArc
    """
    parameters = parameters_from_ellipse(ellipse)
    compared = ellipse_residuals(points, parameters)
    # Counted from the middle, so that the cut of the angle lies off the arc.
    middle = cmath.rect(1.0, cmath.phase(compared.w.sum()))
    angles = np.angle(compared.w * middle.conjugate())
    order = angles.argsort(kind="stable")
    angles, signed = angles[order], compared.residuals[order]
    stds = np.sqrt(compared.variances[order])
    feet = points.z[order] - signed * compared.normals[order]
    length = np.zeros(len(points))
    np.abs(feet[1:] - feet[:-1]).cumsum(out=length[1:])
    # Points may share a foot; arc length must rise all the same.
    length += (1e-9 * length[-1] + 1e-12) * np.arange(len(points))
    smooth = smooth_residual(length, signed, stds, smoothing)
    even, residual = homogenise(smooth.length, smooth.residual, homogenising)
    w = middle * np.exp(1j * np.interp(even, length, angles))
    on_even = NoisyPoints(
        _offset_from_ellipse(parameters, w, residual),
        np.interp(even, length, stds) ** 2,
        np.zeros(len(even), dtype=complex),
    )
    kept = np.empty(len(points), dtype=bool)
    kept[order] = smooth.weights > 0
    found, _ = refine_ellipse(on_even, parameters, steps=1)
    start = ellipse_from_parameters(found if is_ellipse(found) else parameters)
    return ConditionedArc(as_vectors(on_even.z), start, kept)


def _offset_from_ellipse(
    parameters: FloatArray, w: ComplexArray, residual: FloatArray
) -> ComplexArray:
    """Points at a distance (mm) from the points c + E w of an ellipse."""
    m, d = float(parameters[2]), complex(parameters[3], parameters[4])
    along, across = m * w, d * w.conj()
    normals = along - across
    beside: ComplexArray = normals * (residual / np.abs(normals))
    beside += along + across + centre_of(parameters)
    return beside
