"""A profile: the ordered points of one section in mm, which sensors give and steps take."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, IntArray, Points, as_readonly_array
from lsvision.geometry.arguments import as_section_points
from lsvision.geometry.arrays import extent_of
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.statistics.lost_markers import find_lost_markers

MAX_COORDINATE_MM = 1e9
"""A thousand kilometres: larger numbers of a file are no points, and their squares overflow."""
MARKER_TOLERANCE = 1e-7
"""Relative difference of a coordinate from a marker of lost points: single precision rounds."""
MAX_NOISE_FACTOR, MAX_ESTIMATED_NOISE_FACTOR = 3.0, 4.0
"""Scatter about an ellipse over the standard deviation of a noise model, and over an estimated
one, which is too small where a sensor smooths along the line."""
MAX_RELATIVE_SCATTER = 1e-2
"""Scatter over the radius that is always allowed: form error of pipes (below 1e-3), and errors
that neighbours share, which no difference of neighbours shows (0.1 mm at a radius of 10 mm)."""

METRES_EXTENTS, METRES_PITCH, MIN_STEPS = (1e-3, 1.0), 0.002, 5
"""Extents between which, and pitch below which, both together, a profile is taken to be in metres,
and the fewest steps that tell a pitch. No profile sensor is as fine: the smallest fields of view
are some mm wide, the finest pitch is 0.0025 mm. Units: mm."""


@runtime_checkable
class NoiseModel(Protocol):
    """What is known of the errors of a profile's points.

    Examples
    --------
    >>> isinstance(PointNoise(np.ones((3, 2, 2))), NoiseModel)
    True
    """

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
class PointNoise(ComparedByValue):
    """Noise given point by point, as a calibrated camera knows it.

    Parameters
    ----------
    point_covariances : (n, 2, 2) array_like
        Covariance of each point, in the order of the profile. Units: mm^2.

    Examples
    --------
    >>> noise = PointNoise([[[0.01, 0.0], [0.0, 0.04]]])
    >>> Profile([[0.0, -400.0]], noise).noise.covariances(np.zeros((1, 2)))[0, 1, 1]
    np.float64(0.04)
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

        Parameters
        ----------
        points : (n, 2) ndarray
            Of the profile.

        Returns
        -------
        (n, 2, 2) ndarray
            Units: mm^2.
        """
        if len(points) != len(self.point_covariances):
            raise ValueError(f"want {len(self.point_covariances)} points, got {len(points)}")
        return self.point_covariances


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Profile(ComparedByValue):
    """Ordered points of one light section.

    Parameters
    ----------
    points : (n, 2) array_like or data frame
        Section frame: X along the laser line, Y towards the sensor. Index = column of the
        sensor, order kept; a lost point is a NaN row (values that are infinite or beyond 1e9 mm
        count as lost, and a row with one lost coordinate is lost whole). Of a data frame the
        columns x and z (or y): see `lsvision.geometry.arguments.as_section_points`. Units: mm.
    noise : NoiseModel, optional
        What the sensor knows of its own errors.
    lost : float or sequence of float, optional
        Values that mark lost points, as -9999, in either coordinate. Without it nothing is
        removed, and values that look like such a marker are warned of; ``()`` says that there
        are none.

    Raises
    ------
    TypeError, ValueError
        If `points` is no table of numbers, or not (n, 2).

    Warns
    -----
    UserWarning
        If a value looks like a marker of lost points and `lost` is not given.

    Examples
    --------
    >>> profile = Profile([[0.0, -400.0], [float("nan"), 0.0], [1.2, -399.8]])
    >>> len(profile), profile.lost
    (3, 1)
    >>> profile
    <Profile: 3 points, 1 lost, x 0 to 1.2 mm, y -400 to -399.8 mm>
    >>> Profile([[0.0, -400.0], [0.6, -9999.0], [1.2, -399.8]], lost=-9999).lost
    1
    """

    points: Points
    noise: NoiseModel | None = None

    def __init__(
        self,
        points: npt.ArrayLike,
        noise: NoiseModel | None = None,
        *,
        lost: float | Sequence[float] | None = None,
    ) -> None:
        rows = np.array(as_section_points(points))
        rows[~(np.abs(rows) < MAX_COORDINATE_MM).all(axis=1)] = np.nan
        if lost is None:
            _warn_of_markers(rows)
        else:
            for value in np.atleast_1d(np.asarray(lost, dtype=np.float64)):
                near = np.abs(rows - value) <= MARKER_TOLERANCE * abs(value)
                rows[near.any(axis=1)] = np.nan
        object.__setattr__(self, "points", as_readonly_array(rows, ("n", 2)))
        object.__setattr__(self, "noise", noise)

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        seen = self.points[~np.isnan(self.points[:, 0])]
        spans = [
            f", {name} {column.min():.6g} to {column.max():.6g} mm"
            for name, column in zip("xy", seen.T, strict=True)
            if len(column)
        ]
        return f"<Profile: {len(self)} points, {self.lost} lost{''.join(spans)}>"

    @property
    def lost(self) -> int:
        """Number of lost points."""
        return int(np.isnan(self.points[:, 0]).sum())


def as_profile(points: Profile | npt.ArrayLike) -> Profile:
    """Return a profile as it is, and anything that `Profile` takes as one.

    Warns
    -----
    UserWarning
        If the points seem to be in metres: the longer span is 0.001 to 1 mm, with less than
        0.002 mm from one point to the next along X. The finest profile sensors sold have a pitch
        of 0.0025 mm; a profile of 0.2 m with 376 points has one of 0.0005 "mm".
    """
    profile = points if isinstance(points, Profile) else Profile(cast("Points", points))
    valid = profile.points[~np.isnan(profile.points[:, 0])]
    steps = np.abs(np.diff(valid[:, 0]))
    steps = steps[steps > 0]  # held samples
    extent = extent_of(valid)
    low, high = METRES_EXTENTS
    if len(steps) >= MIN_STEPS and low < extent < high and np.median(steps) < METRES_PITCH:
        warnings.warn(
            f"expected a profile in mm, got one of {extent:.3g} mm with a point every "
            f"{np.median(steps):.2g} mm: metres? multiply the points by 1000",
            UserWarning,
            stacklevel=3,
        )
    return profile


def _warn_of_markers(points: Points) -> None:
    for axis in (1, 0):
        for value in find_lost_markers(points[:, axis], known_only=True):
            count = int(np.count_nonzero(points[:, axis] == value))
            warnings.warn(
                f"{value:.10g} stands in {count} of {len(points)} points and looks like a marker "
                f"of lost points: say Profile(points, lost={value:.10g}), or lost=() if not",
                UserWarning,
                stacklevel=3,
            )


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


@dataclass(frozen=True)
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
        """Points of the span, lost ones as NaN rows. Units: mm.

        Parameters
        ----------
        profile : Profile
            The one that the arc is of.

        Returns
        -------
        (k, 2) ndarray
            Section frame. Units: mm.
        """
        return profile.points[self.start : self.stop]
