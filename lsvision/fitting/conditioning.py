"""Smoothing and homogenising of one arc on the residual to its screened ellipse (paper 3.3)."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.fitting.ellipse_parameters import ellipse_of, is_ellipse, parameters_of
from lsvision.fitting.homogenising import HomogenisingSettings, homogenise
from lsvision.fitting.quick_fit import (
    normal_residuals,
    normal_variances,
    refine_quickly,
)
from lsvision.fitting.smoothing import SmoothingSettings, smooth_residual
from lsvision.shapes import BoolArray, Ellipse, FloatArray, Points


@dataclass(frozen=True, eq=False, slots=True)
class ConditionedArc:
    """An arc, smoothed and homogenised.

    Parameters
    ----------
    points : (m, 2) ndarray
        Equally spaced along the arc, smoothed. Units: mm.
    ellipse : Ellipse
        Quick fit to them: the start of the geometric refinement. Units: mm, rad.
    kept : (n,) bool ndarray
        The measured points that are neither jump nor stray.
    """

    points: Points
    ellipse: Ellipse
    kept: BoolArray


def condition_arc(
    points: Points,
    covariances: FloatArray,
    ellipse: Ellipse,
    smoothing: SmoothingSettings = SmoothingSettings(),
    homogenising: HomogenisingSettings = HomogenisingSettings(),
) -> ConditionedArc:
    """Smooth and homogenise the points of a screened arc; find the jumps among them.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points of the arc. Units: mm.
    covariances : (n, 2, 2) ndarray
        Of their errors. Units: mm^2.
    ellipse : Ellipse
        The screened ellipse. Units: mm, rad.
    smoothing, homogenising : settings
        Sections 3.3.1 and 3.3.2.

    Returns
    -------
    ConditionedArc
    """
    parameters = parameters_of(ellipse)
    signed, normals, w = normal_residuals(points, parameters)
    stds = np.sqrt(normal_variances(normals, covariances))
    middle = w.mean(axis=0)
    # Counted from the middle, so that the cut of atan2 lies off the arc.
    angles = np.arctan2(w @ (-middle[1], middle[0]), w @ middle)
    order = np.argsort(angles, kind="stable")
    feet = (points - signed[:, None] * normals)[order]
    steps = np.hypot(*(feet[1:] - feet[:-1]).T)
    # Points may share a foot; arc length must rise all the same.
    length = np.concatenate([[0.0], np.cumsum(steps + 1e-9 * steps.sum() + 1e-12)])
    smooth = smooth_residual(length, signed[order], stds[order], smoothing)
    even, residual = homogenise(smooth.length, smooth.residual, homogenising)
    turn = np.interp(even, length, angles[order]) + math.atan2(middle[1], middle[0])
    on_even = _beside_ellipse(parameters, turn, residual)
    kept = np.empty(len(points), dtype=bool)
    kept[order] = smooth.weights > 0
    weight = np.interp(even, length, stds[order])[:, None, None] ** 2 * np.eye(2)
    found, _ = refine_quickly(on_even, weight, parameters, steps=1)
    return ConditionedArc(on_even, ellipse_of(found if is_ellipse(found) else parameters), kept)


def _beside_ellipse(parameters: FloatArray, turn: FloatArray, residual: FloatArray) -> Points:
    """Points at a distance (mm) from the points c + E w, w at the angle `turn` (rad)."""
    x, y, m, p, q = parameters
    w = np.column_stack([np.cos(turn), np.sin(turn)])
    E = np.array([[m + p, q], [q, m - p]])
    normals = w @ np.linalg.inv(E)
    normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
    beside: Points = (x, y) + w @ E + residual[:, None] * normals
    return beside
