"""Several ellipse fits as arrays, so that their intervals are computed together.

For m, p, q, the unit vector w and the deviator see the `parameters` module.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.parameters import deviators_from_parameters
from lsvision.ellipse.problem import EllipseProblem
from lsvision.geometry import BoolArray, FloatArray
from lsvision.geometry.arrays import TINY, pad_rows, stack_padded
from lsvision.geometry.noisy_points import ComplexArray, as_complex


@dataclass(frozen=True, eq=False, slots=True)
class FitStack:
    """s fits with up to n points each.

    Parameters
    ----------
    fits : tuple of EllipseFit
        The fits.
    parameters : (s, 5) ndarray
        Estimates (centre_x, centre_y, m, p, q). Units: mm.
    covariances : (s, 5, 5) ndarray
        Their covariances. Units: mm^2.
    variance_factors, degrees_of_freedom : (s,) ndarray
        See `EllipseFit`.
    points : (s, n) complex ndarray
        x + iy; after the last point of a fit it is repeated. Units: mm.
    weights : (s, n) ndarray
        1 / variance of the residuals; 0 for repeated points. Units: 1/mm^2.
    arc_middles : (s,) complex ndarray
        Unit vector w of the point in the middle of each arc.
    known_radius, has_prior, may_be_circle, radial : (s,) bool ndarray
        Whether the radius is known; whether there is any prior; false where a prior on phi
        excludes a circle; whether the paper's radial residuals are minimised.
    """

    fits: tuple[EllipseFit, ...]
    parameters: FloatArray
    covariances: FloatArray
    variance_factors: FloatArray
    degrees_of_freedom: FloatArray
    points: ComplexArray
    weights: FloatArray
    arc_middles: ComplexArray
    known_radius: BoolArray
    has_prior: BoolArray
    may_be_circle: BoolArray
    radial: BoolArray

    @classmethod
    def of(cls, fits: Sequence[EllipseFit]) -> Self:
        """Return the stack of one or more fits."""
        problems = [fit.problem for fit in fits]
        tilts = [problem.known_phi for problem in problems]
        points, weights = _stack_points(problems)
        parameters = np.array([fit.parameters for fit in fits])
        middles = points[np.arange(len(fits)), [len(problem.points) // 2 for problem in problems]]
        return cls(
            fits=tuple(fits),
            parameters=parameters,
            covariances=np.array([fit.parameter_covariance for fit in fits]),
            variance_factors=np.array([fit.variance_factor for fit in fits]),
            degrees_of_freedom=np.array([fit.degrees_of_freedom for fit in fits], dtype=float),
            points=points,
            weights=weights,
            arc_middles=_compute_directions(middles, parameters),
            known_radius=np.array([problem.known_radius is not None for problem in problems]),
            has_prior=np.array([problem.prior_residual_count > 0 for problem in problems]),
            may_be_circle=np.array([tilt is None or tilt.includes_circle for tilt in tilts]),
            radial=np.array([problem.residual == "radial" for problem in problems]),
        )


def _stack_points(problems: Sequence[EllipseProblem]) -> tuple[ComplexArray, FloatArray]:
    """Return points and weights as matrices, padded with the last point and weight 0."""
    points = [as_complex(problem.points) for problem in problems]
    indices, valid = pad_rows(list(map(len, points)))
    variances = stack_padded([problem.stds for problem in problems], indices) ** 2
    return stack_padded(points, indices), valid / variances


def _compute_directions(points: ComplexArray, parameters: FloatArray) -> ComplexArray:
    """Return w of the point where the ray from each centre to a point meets the ellipse, (s,)."""
    offset = points - as_complex(parameters[:, :2])
    # Solution of offset = t E w with t > 0.
    w = parameters[:, 2] * offset - deviators_from_parameters(parameters) * offset.conj()
    return w / np.maximum(np.abs(w), TINY)
