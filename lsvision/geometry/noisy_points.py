"""Points in a plane with the covariances of their errors, as complex numbers.

A point is ``z = x + iy``. A covariance is represented by the mean of its two principal variances
and a complex number, the deviator, for their difference and direction. A quadratic form n' Sigma n
is then one complex multiplication of whole arrays. Arrays may have leading axes: those of one arc
are (n,), those of a stack of k arcs (k, n).
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import TINY, BoolArray, FloatArray, Points, pad_rows, stack_padded

ComplexArray = npt.NDArray[np.complex128]
FAN_EDGE_DIRECTION = cmath.rect(1.0, math.radians(60))
"""Direction to the sensor of the outermost ray of a usual sensor, 30 deg from +Y."""
MIN_RANGE_ANISOTROPY = 0.25
"""Smallest (Sigma_yy - Sigma_xx) / (Sigma_yy + Sigma_xx) from which the direction of the ray is
derived: an error along a ray only has this value at 38 deg from +Y."""


@dataclass(frozen=True, eq=False, slots=True)
class NoisyPoints:
    """Points with the covariances of their errors.

    Parameters
    ----------
    z : (..., n) complex ndarray
        Points x + iy. Units: mm.
    mean_variance : (..., n) ndarray
        Half the trace of the covariance. Units: mm^2.
    deviator : (..., n) complex ndarray
        Deviators (Sigma_xx - Sigma_yy) / 2 - i Sigma_xy. Units: mm^2.
    """

    z: ComplexArray
    mean_variance: FloatArray
    deviator: ComplexArray

    @classmethod
    def of(cls, points: Points, covariances: FloatArray) -> Self:
        """Return the noisy points of (n, 2) points in mm and (n, 2, 2) covariances in mm^2."""
        xx, xy, yy = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
        deviator = np.empty(len(points), dtype=complex)
        deviator.real, deviator.imag = (xx - yy) / 2, -xy
        return cls(as_complex(points), (xx + yy) / 2, deviator)

    @classmethod
    def uniform(cls, z: ComplexArray, x_std: float, y_std: float) -> Self:
        """Return points x + iy, each with the covariance diag(x_std^2, y_std^2). Units: mm."""
        mean, deviator = np.empty(len(z)), np.empty(len(z), dtype=complex)
        mean.fill((x_std**2 + y_std**2) / 2)
        deviator.fill((x_std**2 - y_std**2) / 2)
        return cls(z, mean, deviator)

    @classmethod
    def stack(cls, arcs: Sequence[Self]) -> tuple[Self, BoolArray | None]:
        """Return the points of k arcs, (k, n), and the mask of valid ones; None if all are valid.

        Each arc has n points or fewer, at least one; its last point is repeated.
        """
        if len(arcs) == 1:
            (arc,) = arcs
            return cls(arc.z[None], arc.mean_variance[None], arc.deviator[None]), None
        indices, valid = pad_rows([len(arc) for arc in arcs])
        z = stack_padded([arc.z for arc in arcs], indices)
        mean = stack_padded([arc.mean_variance for arc in arcs], indices)
        return cls(z, mean, stack_padded([arc.deviator for arc in arcs], indices)), valid

    @property
    def covariances(self) -> FloatArray:
        """(n, 2, 2) covariances of x and y. Units: mm^2."""
        matrices = np.empty((len(self.z), 2, 2))
        matrices[:, 0, 0] = self.mean_variance + self.deviator.real
        matrices[:, 1, 1] = self.mean_variance - self.deviator.real
        matrices[:, 0, 1] = matrices[:, 1, 0] = -self.deviator.imag
        return matrices

    def __len__(self) -> int:
        return len(self.z)

    def __getitem__(self, which: npt.NDArray[np.generic] | int | slice | tuple[Any, ...]) -> Self:
        """Return the points of an index, a slice, an index array, a mask, or a tuple of these."""
        return type(self)(self.z[which], self.mean_variance[which], self.deviator[which])

    def normal_variances(self, normals: ComplexArray) -> FloatArray:
        """Return n' Sigma n of each point, for unit normals (..., n). Units: mm^2."""
        variances: FloatArray = (self.deviator * (normals * normals)).real
        variances += self.mean_variance
        return variances

    @property
    def mean_ray(self) -> complex:
        """Unit vector x + iy of the mean ray, towards the sensor.

        The direction of the largest error of the mean covariance; +Y where that is not clearly
        along Y.
        """
        deviator = complex(self.deviator.sum())
        if not -deviator.real > MIN_RANGE_ANISOTROPY * float(self.mean_variance.sum()):
            return 1j
        root = cmath.sqrt(deviator).conjugate()  # along that error, see `compute_incidence_cosines`
        return root / math.copysign(abs(root), root.imag)

    def compute_incidence_cosines(self, normals: ComplexArray) -> FloatArray:
        """Return the cosine between unit normals (..., n) and the direction to the sensor.

        A point with a negative cosine is not visible. The ray is assumed to have the direction of
        the point's largest error; where that is not clearly along Y, 30 deg from +Y on the side of
        the normal: a point that is not visible along this ray is not along any of the fan.
        """
        # The deviator has twice the negative angle of the largest error: its root is the conjugate
        # of a vector along that error.
        roots = np.sqrt(self.deviator)
        cosines: FloatArray = (normals * roots).real
        cosines /= np.copysign(np.maximum(np.abs(roots), TINY), -roots.imag)
        ray_is_known = -self.deviator.real > MIN_RANGE_ANISOTROPY * self.mean_variance
        if ray_is_known.all():
            return cosines
        in_fan = FAN_EDGE_DIRECTION.imag * normals.imag + FAN_EDGE_DIRECTION.real * np.abs(
            normals.real
        )
        return np.where(ray_is_known, cosines, in_fan)


def rotate_to_ray_frame(z: ComplexArray, ray: complex) -> ComplexArray:
    """Return points x + iy rotated such that a ray, a unit vector, becomes +Y."""
    rotated: ComplexArray = z * (1j * ray.conjugate())
    return rotated


def as_complex(vectors: FloatArray) -> ComplexArray:
    """Return vectors (..., 2) as complex numbers x + iy (...)."""
    return np.ascontiguousarray(vectors, dtype=float).view(complex)[..., 0]


def as_vectors(numbers: ComplexArray) -> FloatArray:
    """Return complex numbers x + iy (n,) as vectors (n, 2)."""
    return np.ascontiguousarray(numbers).view(float).reshape(-1, 2)
