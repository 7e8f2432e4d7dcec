"""The waist of the hourglass: what every sensor gives and every measurement starts from."""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Points, as_readonly_array
from lsvision.geometry.noisy_points import NoisyPoints

MAX_COORDINATE_MM = 1e9
"""A thousand kilometres: larger numbers of a file are no points, and their squares overflow."""
MAX_NOISE_FACTOR, MAX_ESTIMATED_NOISE_FACTOR = 3.0, 4.0
"""Scatter about an ellipse over the standard deviation of a noise model, and over an estimated
one, which is too small where a sensor smooths along the line."""
MAX_RELATIVE_SCATTER = 1e-2
"""Scatter over the radius that is always allowed: form error of pipes (below 1e-3), and errors
that neighbours share, which no difference of neighbours shows (0.1 mm at a radius of 10 mm)."""


@runtime_checkable
class NoiseModel(Protocol):
    """What is known of the errors of a profile's points."""

    def covariances(self, points: Points) -> FloatArray:
        """Covariance of each point's error.

        Parameters
        ----------
        points : (n, 2) ndarray
            Section frame; NaN rows are lost points. Units: mm.

        Returns
        -------
        (n, 2, 2) ndarray
            Units: mm^2. NaN where the point is lost.
        """
        ...


@dataclass(frozen=True, eq=False)
class PointNoise:
    """Noise given point by point, as a calibrated camera knows it.

    Parameters
    ----------
    point_covariances : (n, 2, 2) array_like
        Covariance of each point, in the order of the profile. Units: mm^2.
    """

    point_covariances: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "point_covariances",
            as_readonly_array(self.point_covariances, ("n", 2, 2), "covariances"),
        )

    def covariances(self, points: Points) -> FloatArray:
        """The covariances as given; one for each of `points`.

        Raises
        ------
        ValueError
            If there are not as many as points.
        """
        if len(points) != len(self.point_covariances):
            raise ValueError(f"want {len(self.point_covariances)} points, got {len(points)}")
        return self.point_covariances


@dataclass(frozen=True, eq=False)
class Profile:
    """Ordered points of one light section.

    Parameters
    ----------
    points : (n, 2) array_like
        Section frame: X along the laser line, Y towards the sensor. Index = column of the
        sensor, order kept; a lost point is a NaN row (values that are infinite or beyond 1e9 mm
        count as lost, and a row with one lost coordinate is lost whole). Units: mm.
    noise : NoiseModel, optional
        What the sensor knows of its own errors.

    Raises
    ------
    ValueError
        If `points` is not (n, 2).

    Examples
    --------
    >>> profile = Profile([[0.0, -400.0], [float("nan"), 0.0], [1.2, -399.8]])
    >>> len(profile), profile.lost
    (3, 1)
    """

    points: Points
    noise: NoiseModel | None = None

    def __post_init__(self) -> None:
        points = np.array(as_readonly_array(self.points, ("n", 2), "points"))
        points[~(np.abs(points) < MAX_COORDINATE_MM).all(axis=1)] = np.nan
        object.__setattr__(self, "points", as_readonly_array(points, ("n", 2)))

    def __len__(self) -> int:
        return len(self.points)

    @property
    def lost(self) -> int:
        """Number of lost points."""
        return int(np.isnan(self.points[:, 0]).sum())


@dataclass(frozen=True, eq=False, slots=True)
class PreparedProfile:
    """A profile in its order along the line, with the noise of its points.

    Parameters
    ----------
    points : (n, 2) ndarray
        As in `Profile`, but in their order along the line. Units: mm.
    noisy_points : NoisyPoints
        The same points with the covariances of their errors, in complex numbers.
    valid_indices : (k,) int ndarray
        Which of `points` are not lost, rising.
    sensor_columns : (n,) int ndarray
        Index that each of `points` has in the `Profile`.
    noise_std : float
        Typical standard deviation of a point along its largest error. Units: mm.
    pitch : float
        Typical spacing of neighbouring points along X; positive always. Units: mm.
    min_variance_factor : float
        The points' variances may be so many times smaller than `noisy_points` says, not more:
        1 for a given noise model, less for an estimated one.
    """

    points: Points
    noisy_points: NoisyPoints
    valid_indices: IntArray
    sensor_columns: IntArray
    noise_std: float
    pitch: float
    min_variance_factor: float

    @property
    def noise_is_estimated(self) -> bool:
        """Whether the noise was estimated from neighbours; else it comes from a noise model."""
        return self.min_variance_factor < 1

    def max_noise_factor(self, radius: float) -> float:
        """How many times larger than the noise the scatter about an ellipse may be.

        Parameters
        ----------
        radius : float
            Of the cylinder. Units: mm.
        """
        modelled = MAX_ESTIMATED_NOISE_FACTOR if self.noise_is_estimated else MAX_NOISE_FACTOR
        scatter = MAX_RELATIVE_SCATTER * radius
        return max(modelled, scatter / self.noise_std) if self.noise_std else math.inf


@dataclass(frozen=True, slots=True)
class Arc:
    """Index span of a profile believed to lie on one ellipse.

    Parameters
    ----------
    start, stop : int
        Half open: ``profile.points[start:stop]``.

    Examples
    --------
    >>> len(Arc(412, 447))
    35
    """

    start: int
    stop: int

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.stop:
            raise ValueError(f"want 0 <= start < stop, got [{self.start}, {self.stop})")

    def __len__(self) -> int:
        return self.stop - self.start

    def of(self, profile: Profile) -> Points:
        """Points of the span, lost ones as NaN rows. Units: mm."""
        return profile.points[self.start : self.stop]
