"""Points of a plane with the covariances of their errors, in complex numbers.

A point is ``z = x + iy``. A covariance is the mean of its two principal variances and a complex
number, its deviator, that says how much more it is along one direction than across it. What in
matrices takes products and sums of components is here one multiplication of whole arrays.
"""

import cmath
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.geometry.arrays import FloatArray, Points

ComplexArray = npt.NDArray[np.complex128]
TINY = 1e-300
FAN_EDGE_DIRECTION = cmath.rect(1.0, math.radians(60))
"""Direction to the sensor of the outermost ray that is still usual, 30 deg off +Y."""
MIN_RANGE_ANISOTROPY = 0.25
"""(Sigma_yy - Sigma_xx) over their sum: a ray of an error without width 38 deg off +Y."""


@dataclass(frozen=True, eq=False, slots=True)
class NoisyPoints:
    """Points and their noise.

    Parameters
    ----------
    z : (n,) complex ndarray
        x + iy. Units: mm.
    mean_variance : (n,) ndarray
        Half the trace of the covariance. Units: mm^2.
    deviator : (n,) complex ndarray
        (Sigma_xx - Sigma_yy) / 2 - i Sigma_xy. Units: mm^2.
    """

    z: ComplexArray
    mean_variance: FloatArray
    deviator: ComplexArray

    @classmethod
    def of(cls, points: Points, covariances: FloatArray) -> Self:
        """Points (n, 2) in mm and their covariances (n, 2, 2) in mm^2."""
        xx, xy, yy = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
        deviator = np.empty(len(points), dtype=complex)
        deviator.real, deviator.imag = (xx - yy) / 2, -xy
        return cls(as_complex(points), (xx + yy) / 2, deviator)

    @classmethod
    def alike(cls, z: ComplexArray, x_std: float, y_std: float) -> Self:
        """Points x + iy with the same independent errors of x and y. Units: mm."""
        mean, deviator = (x_std**2 + y_std**2) / 2, (x_std**2 - y_std**2) / 2
        return cls(z, np.full(len(z), mean), np.full(len(z), complex(deviator)))

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

    def __getitem__(self, which: npt.NDArray[np.generic] | slice) -> Self:
        """Those of a slice, of indices or of a mask."""
        return type(self)(self.z[which], self.mean_variance[which], self.deviator[which])

    def normal_variances(self, normals: ComplexArray) -> FloatArray:
        """N' Sigma n of each point, for unit normals (n,). Units: mm^2."""
        along: FloatArray = (self.deviator * (normals * normals)).real
        along += self.mean_variance
        return along

    def incidence_cosines(self, normals: ComplexArray) -> FloatArray:
        """Cosine between unit normals, (n,), and the direction to the sensor.

        No sensor sees a point where it is negative. The ray is taken as the direction of the
        point's largest error; where that does not lie towards +Y, as the one of a fan of
        +/- 30 deg about +Y that sees the point best.
        """
        rays = np.sqrt(self.deviator.conj())  # half the deviator's angle
        rays = np.where(rays.imag < 0, -rays, rays)
        rays /= np.maximum(np.abs(rays), TINY)
        in_fan = FAN_EDGE_DIRECTION.imag * normals.imag + FAN_EDGE_DIRECTION.real * np.abs(
            normals.real
        )
        told = -self.deviator.real > MIN_RANGE_ANISOTROPY * self.mean_variance
        return np.where(told, (normals * rays.conj()).real, in_fan)


def as_complex(vectors: FloatArray) -> ComplexArray:
    """Vectors (x, y), (n, 2), as complex numbers x + iy, (n,)."""
    numbers: ComplexArray = np.ascontiguousarray(vectors, dtype=float).view(complex)[:, 0]
    return numbers


def as_vectors(numbers: ComplexArray) -> FloatArray:
    """Complex numbers x + iy, (n,), as vectors (x, y): (n, 2)."""
    vectors: FloatArray = np.ascontiguousarray(numbers).view(float).reshape(-1, 2)
    return vectors
