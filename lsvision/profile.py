"""The waist of the hourglass: what every sensor gives and every measurement starts from."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from lsvision.shapes import FloatArray, IntArray, Points, as_readonly_array
from lsvision.shapes.noisy_points import NoisyPoints

RELATIVE_FORM_ERROR = 8e-4
"""Rms form error of pipes, and of profile sensors that look at them, over the radius."""


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
        sensor, order kept; a lost point is a NaN row (infinite values count as lost, and a
        row with one lost coordinate is lost whole). Units: mm.
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
        points[~np.isfinite(points).all(axis=1)] = np.nan
        object.__setattr__(self, "points", as_readonly_array(points, ("n", 2)))

    def __len__(self) -> int:
        return len(self.points)

    @property
    def lost(self) -> int:
        """Number of lost points."""
        return int(np.isnan(self.points[:, 0]).sum())


@dataclass(frozen=True, eq=False, slots=True)
class PreparedProfile:
    """A profile with its noise written out: what the detection of arcs works on.

    Parameters
    ----------
    points : (n, 2) ndarray
        As in `Profile`, but in their order along the line. Units: mm.
    covariances : (n, 2, 2) ndarray
        Of the points' errors, NaN where lost. Units: mm^2.
    noisy_points : NoisyPoints
        The same points and covariances once more, in complex numbers.
    valid_indices : (k,) int ndarray
        Which of `points` are there, rising.
    sensor_columns : (n,) int ndarray
        Index that each of `points` has in the `Profile`.
    noise_std : float
        Typical standard deviation of a point across the line. Units: mm.
    pitch : float
        Typical spacing of neighbouring points along X; positive always. Units: mm.
    noise_known : bool
        Whether the covariances come from a noise model or were estimated from neighbours,
        which makes them too small where neighbours' errors are alike.
    """

    points: Points
    covariances: FloatArray
    noisy_points: NoisyPoints
    valid_indices: IntArray
    sensor_columns: IntArray
    noise_std: float
    pitch: float
    noise_known: bool

    def max_noise_factor(self, radius: float) -> float:
        """How many times larger than `covariances` say the scatter about an ellipse may be.

        A given noise model is taken at its word; one estimated from neighbours is up to four
        times too small on real sensors, which smooth along the line. Either may be exceeded by
        the form error of a real pipe of that radius (mm).
        """
        modelled = 3.0 if self.noise_known else 4.0
        return max(modelled, RELATIVE_FORM_ERROR * radius / max(self.noise_std, 1e-12))


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
