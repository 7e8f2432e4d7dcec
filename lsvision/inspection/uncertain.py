"""Numbers with an uncertainty, and their intervals: scalars, and lengths of vectors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.geometry.equality import ComparedByValue
from lsvision.statistics.quantiles import squared_quantile

QUADRATURE_NODES = 64
"""Nodes of the quadrature for the length of a vector."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
"""Nodes and weights of Gauss-Legendre quadrature from -1 to 1."""
MAX_SIGMAS = 8.0
"""Standard deviations from the mean at which integrals over a normal distribution end."""
MIN_STD_RATIO = 1e-9
"""Smallest ratio of the standard deviations along both principal axes in the integral, where the
smaller one is a divisor."""
BISECTIONS = 24
"""Halvings of the range in which the lower end of a length is searched."""
MIN_NORMAL_SIGMAS = 30.0
"""Ratio of a length to its largest standard deviation above which it counts as normally
distributed: its bias is then below a sixtieth of a standard deviation."""


class Uncertain(Protocol):
    """A number with its standard uncertainty and its intervals, all in the same unit."""

    @property
    def value(self) -> float:
        """The estimate."""
        ...

    @property
    def std(self) -> float:
        """Standard uncertainty."""
        ...

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval that contains the true value with probability `level`."""
        ...


@dataclass(frozen=True)
class Scalar:
    """A normally distributed number.

    Parameters
    ----------
    value, std : float
        Estimate and standard uncertainty.
    degrees_of_freedom : float
        Degrees of freedom of the standard uncertainty; infinite if it is known.

    Examples
    --------
    >>> low, high = Scalar(19.0, 0.1).interval(0.95)
    >>> f"{low:.3f} .. {high:.3f}"
    '18.804 .. 19.196'
    """

    value: float
    std: float
    degrees_of_freedom: float = math.inf

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval: the value plus and minus a multiple of its std, by Student's t."""
        half_width = two_sided_factor(level, self.degrees_of_freedom) * self.std
        return self.value - half_width, self.value + half_width


@dataclass(frozen=True, eq=False)
class Length(ComparedByValue):
    """Length of a normally distributed vector of two components, which is never negative.

    Parameters
    ----------
    vector : (2,) ndarray
        The estimate.
    covariance : (2, 2) ndarray
        Covariance of both components.
    degrees_of_freedom : float
        Degrees of freedom of the covariance; infinite if it is known.
    largest : float
        Largest possible length, such as that of an angle between two axes.

    Notes
    -----
    The length of a noisy vector is larger than the true one on average. The lower end is the true
    length at which a length as large as the estimate has the probability (1 - level) / 2, with
    the true vector in the estimated direction; 0 if noise alone makes it that probable. The upper
    end is the length plus a multiple of its std, which the bias makes conservative; where the
    direction of the vector is undetermined, of the largest std.

    Examples
    --------
    >>> low, high = Length(np.array([0.1, 0.0]), 0.01 * np.eye(2)).interval(0.95)
    >>> f"{low:.3f} .. {high:.3f}"
    '0.000 .. 0.296'
    """

    vector: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float = math.inf
    largest: float = math.inf

    @property
    def value(self) -> float:
        """The estimated length."""
        return math.hypot(*self.vector)

    @property
    def std(self) -> float:
        """Standard uncertainty along the vector; the largest one where it is 0."""
        length = self.value
        if length == 0:
            return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance)[-1]), 0.0))
        unit = self.vector / length
        return math.sqrt(max(float(unit @ self.covariance @ unit), 0.0))

    def interval(self, level: float) -> tuple[float, float]:
        """Return both ends, from 0 to `largest`; see the notes of the class."""
        low, high = self._unlimited_interval(level)
        return low, min(high, self.largest)

    def _unlimited_interval(self, level: float) -> tuple[float, float]:
        """Return both ends without the limit `largest`."""
        factor = two_sided_factor(level, self.degrees_of_freedom)
        variances, axes = np.linalg.eigh(self.covariance)
        stds = np.sqrt(np.maximum(variances, 0.0))
        largest_std, length, std = float(stds[1]), self.value, self.std
        if largest_std == 0 or length > MIN_NORMAL_SIGMAS * largest_std:
            return max(length - factor * std, 0.0), length + factor * std
        # The upper end has the std along the vector (0) if its direction is well determined, the
        # largest one (1) if not: if the vector is shorter than two standard deviations.
        undetermined = min(1.0, (2 * largest_std / length) ** 2) if length > 0 else 1.0
        upper_std = math.sqrt(std**2 + undetermined * (largest_std**2 - std**2))
        unit = axes.T @ self.vector / length if length > 0 else np.array([0.0, 1.0])
        # Student's t, approximated by a normal distribution whose quantile at `level` is the same.
        stds = stds * factor / two_sided_factor(level)
        return _lower_length_bound(length, unit, stds, (1 - level) / 2), length + factor * upper_std


@dataclass(frozen=True)
class Gap:
    """Distance of two axes minus both radii.

    Parameters
    ----------
    distance : Length
        Distance of the axes.
    radii : Scalar
        Sum of both radii.
    std : float
        Standard uncertainty, including the correlation of distance and radii.
    """

    distance: Length
    radii: Scalar
    std: float

    @property
    def value(self) -> float:
        """The estimate."""
        return self.distance.value - self.radii.value

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval by Student's t, lower if the axes may coincide.

        The measured distance of coinciding axes is always too large.
        """
        low, high = Scalar(self.value, self.std, self.radii.degrees_of_freedom).interval(level)
        if self.distance.interval(level)[0] == 0:
            low = min(low, -self.radii.interval(level)[1])
        return low, high


def _lower_length_bound(length: float, unit: FloatArray, stds: FloatArray, tail: float) -> float:
    """Return the true length for which a measured one exceeds `length` with probability `tail`.

    `unit` and `stds` are the direction and standard deviations along the principal axes of the
    covariance, (2,), the larger std last. 0 if the probability is larger without any true length.
    """
    if _exceedance_probability(length, np.zeros(2), stds) > tail:
        return 0.0
    low, high = 0.0, length
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if _exceedance_probability(length, middle * unit, stds) > tail:
            high = middle
        else:
            low = middle
    return low


def two_sided_factor(level: float, degrees_of_freedom: float = math.inf) -> float:
    """Return the ratio of the half width of an interval to the standard uncertainty.

    The normal quantile, or Student's for finite degrees of freedom, which are at least 1.

    Examples
    --------
    >>> f"{two_sided_factor(0.95):.3f} {two_sided_factor(0.95, 10):.3f}"
    '1.960 2.228'
    """
    return math.sqrt(squared_quantile(1, np.array([degrees_of_freedom]), level)[0])


def _exceedance_probability(length: float, mean: FloatArray, stds: FloatArray) -> float:
    """Return the probability that a vector with independent components is longer than `length`.

    The integral over the second component, of the larger std, is in closed form, that over the
    first by Gauss-Legendre quadrature.
    """
    from scipy.special import ndtr

    minor, major = max(float(stds[0]), MIN_STD_RATIO * float(stds[1])), float(stds[1])
    low = max(-length, float(mean[0]) - MAX_SIGMAS * minor)
    high = min(length, float(mean[0]) + MAX_SIGMAS * minor)
    if low >= high:
        return 1.0
    # Substituting x = length sin(t) makes the integrand smooth at the ends of the circle.
    start, stop = math.asin(low / length), math.asin(high / length)
    angles = (start + stop) / 2 + (stop - start) / 2 * _NODES
    x, half_chord = length * np.sin(angles), length * np.cos(angles)
    density = np.exp(-(((x - mean[0]) / minor) ** 2) / 2) / (minor * math.sqrt(2 * math.pi))
    chord_probability = ndtr((half_chord - mean[1]) / major) - ndtr((-half_chord - mean[1]) / major)
    return 1.0 - float((_WEIGHTS * (stop - start) / 2 * half_chord) @ (density * chord_probability))
