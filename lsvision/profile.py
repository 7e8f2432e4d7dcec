"""Profiles: the ordered points of one light section in mm, and the noise model of the points."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from lsvision.geometry import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.geometry.arguments import as_section_points
from lsvision.geometry.arrays import MAX_COORDINATE_MM, measure_extent
from lsvision.geometry.equality import ComparedByValue
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.statistics.lost_markers import find_lost_markers

MARKER_TOLERANCE = 1e-7
"""Largest relative difference at which a coordinate equals a marker of lost points: coordinates in
single precision are rounded."""
MAX_NOISE_FACTOR, MAX_ESTIMATED_NOISE_FACTOR = 3.0, 4.0
"""Largest ratio of the rms residual of an ellipse to the noise of the points: for a given noise
model, and for an estimated noise, which is too small if the sensor smooths along the line."""
MAX_RELATIVE_SCATTER = 1e-2
"""Ratio of the rms residual to the radius that is always accepted: it covers the form deviation of
pipes (below 1e-3) and errors common to neighbours, which the noise estimate does not contain (0.1
mm at a radius of 10 mm)."""

METRES_EXTENTS_MM, METRES_PITCH_MM, MIN_STEPS = (1e-3, 1.0), 0.002, 5
"""Extents between which, and pitch below which, a profile given as mm is taken to be in metres, and
smallest number of steps between points for that test. No profile sensor reaches these values: the
smallest fields of view are some mm wide, the finest pitch is 0.0025 mm."""

MAX_PLAUSIBLE_COORDINATE_MM = 1e5
"""Largest coordinate without a warning: lidars reach 100 m, and a point at a range of 0.1 m, given
in micrometres, has this coordinate."""
MIN_ZERO_ROWS = 3
"""Smallest number of points at (0, 0) that causes the warning of markers of lost points."""


@runtime_checkable
class NoiseModel(Protocol):
    """Covariances of the errors of a profile's points.

    Examples
    --------
    >>> noise = PointNoise(np.ones((3, 2, 2)))
    >>> isinstance(noise, NoiseModel), noise.covariances(np.zeros((3, 2))).shape
    (True, (3, 2, 2))
    """

    def covariances(self, points: Points) -> FloatArray:
        """Return the covariance of each point's error.

        Parameters
        ----------
        points : (n, 2) ndarray
            Points in the section frame; NaN rows are lost points. Units: mm.

        Returns
        -------
        (n, 2, 2) ndarray
            Covariance of each point: symmetric, positive semi-definite, not zero. Of lost points
            it is ignored. Units: mm^2.
        """
        ...


@dataclass(frozen=True, eq=False)
class PointNoise(ComparedByValue):
    """Noise model with a covariance for each point, as from a calibrated camera.

    Parameters
    ----------
    point_covariances : (n, 2, 2) array_like
        Covariance of each point, in the order of the profile; any numbers where a point is lost.
        Units: mm^2.

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
        """Return the given covariances, one for each of `points`.

        Parameters
        ----------
        points : (n, 2) ndarray
            Points of the profile. Units: mm.

        Returns
        -------
        (n, 2, 2) ndarray
            Covariance of each point. Units: mm^2.

        Raises
        ------
        ValueError
            If the number of points differs from that of the covariances.
        """
        if len(points) != len(self.point_covariances):
            raise ValueError(f"expected {len(self.point_covariances)} points, got {len(points)}")
        return self.point_covariances


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Profile(ComparedByValue):
    """Ordered points of one light section.

    Parameters
    ----------
    points : (n, 2) array_like or data frame
        Section frame: X along the laser line, Y towards the sensor. The index of a point is its
        column in the sensor. A lost point is a row of NaN; a point with a NaN or infinite
        coordinate, or one beyond 1e9 mm, becomes such a row. A data frame has columns x and z (or
        y): see `lsvision.geometry.arguments.as_section_points`. Units: mm.
    noise : NoiseModel, optional
        Noise model of the points.
    lost : float or sequence of float, optional
        Values that mark lost points, such as -9999, in either coordinate; 0 marks them only as y,
        since valid points may have x = 0. By default nothing is
        removed, and a value that looks like such a marker causes a warning; ``()`` means that
        there are no markers.

    Raises
    ------
    TypeError, ValueError
        If `points` is not a table of numbers, or not (n, 2).

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
        rows = as_section_points(points)
        valid: BoolArray = np.abs(rows) <= MAX_COORDINATE_MM
        if not valid.all():
            rows = _mark_lost(rows, ~(valid[:, 0] & valid[:, 1]))
        if lost is None:
            _warn_about_markers(rows)
        else:
            for value in np.atleast_1d(np.asarray(lost, dtype=np.float64)):
                is_marker: BoolArray = np.isclose(rows, value, rtol=MARKER_TOLERANCE, atol=0)
                rows = _mark_lost(rows, is_marker[:, 1] | (is_marker[:, 0] & (value != 0)))
        object.__setattr__(self, "points", rows)
        object.__setattr__(self, "noise", noise)

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        valid = self.points[~np.isnan(self.points[:, 0])]
        ranges = [
            f", {name} {column.min():.6g} to {column.max():.6g} mm"
            for name, column in zip("xy", valid.T, strict=True)
            if len(column)
        ]
        return f"<Profile: {len(self)} points, {self.lost} lost{''.join(ranges)}>"

    @property
    def lost(self) -> int:
        """Number of lost points."""
        return int(np.isnan(self.points[:, 0]).sum())


def as_profile(points: Profile | npt.ArrayLike) -> Profile:
    """Return a `Profile` unchanged, or construct one from points.

    Warns
    -----
    UserWarning
        If the points seem to be in metres: the longer side of their bounding box is 0.001 to 1 mm,
        and the median step along X is below 0.002 mm (376 points over 0.2 m, given in metres, have
        one of 0.0005 mm). Also if a coordinate exceeds 100 m, as of points in micrometres.
    """
    profile = points if isinstance(points, Profile) else Profile(cast("Points", points))
    valid = profile.points[~np.isnan(profile.points[:, 0])]
    extent, (low, high) = measure_extent(valid), METRES_EXTENTS_MM
    largest_coordinate = float(np.abs(valid).max(initial=0.0))
    if largest_coordinate > MAX_PLAUSIBLE_COORDINATE_MM:
        warnings.warn(
            f"expected a profile in mm, got coordinates up to {largest_coordinate:.3g} mm: "
            "if they are in micrometres, divide the points by 1000",
            UserWarning,
            stacklevel=3,
        )
    if not low < extent < high:
        return profile
    steps = np.abs(np.diff(valid[:, 0]))
    steps = steps[steps > 0]  # sensors may repeat a sample
    if len(steps) >= MIN_STEPS and np.median(steps) < METRES_PITCH_MM:
        warnings.warn(
            f"expected a profile in mm, got one of {extent:.3g} mm with a point every "
            f"{np.median(steps):.2g} mm: if they are in metres, multiply the points by 1000",
            UserWarning,
            stacklevel=3,
        )
    return profile


def require_several(profiles: Any) -> None:
    """Raise TypeError for one profile or a name, where a sequence of profiles is expected.

    Examples
    --------
    >>> require_several("scans/")
    Traceback (most recent call last):
    ...
    TypeError: expected a sequence of profiles, got str 'scans/': lsvision.read_profiles reads files
    """
    if isinstance(profiles, str | bytes | os.PathLike):
        hint = f"{type(profiles).__name__} {str(profiles)!r}: lsvision.read_profiles reads files"
    elif isinstance(profiles, Profile) or _is_table(profiles):
        hint = f"one {type(profiles).__name__}: put it into a list"
    elif not isinstance(profiles, Iterable):
        hint = type(profiles).__name__
    else:
        return
    raise TypeError(f"expected a sequence of profiles, got {hint}")


def _is_table(profiles: Any) -> bool:
    """Return whether an object is a data frame or an array of the points of one profile."""
    return hasattr(profiles, "columns") or getattr(profiles, "ndim", 0) == 2


def _mark_lost(points: Points, lost: BoolArray) -> Points:
    """Return read-only points with NaN in the rows where `lost` (n,) is true."""
    marked: Points = np.where(lost[:, np.newaxis], np.nan, points)
    marked.setflags(write=False)
    return marked


def _warn_about_markers(points: Points) -> None:
    """Warn if (0, 0) or a known marker of lost points occurs among the points."""
    zeros = int(np.count_nonzero(~points.any(axis=1)))
    if zeros >= MIN_ZERO_ROWS:
        warnings.warn(
            f"(0, 0) occurs in {zeros} of {len(points)} points and looks like a marker of lost "
            "points: pass Profile(points, lost=0), or lost=() if not",
            UserWarning,
            stacklevel=3,
        )
    for axis in (1, 0):
        for value in find_lost_markers(points[:, axis], known_only=True):
            count = int(np.count_nonzero(points[:, axis] == value))
            warnings.warn(
                f"{value:.10g} occurs in {count} of {len(points)} points and looks like a marker "
                f"of lost points: pass Profile(points, lost={value:.10g}), or lost=() if not",
                UserWarning,
                stacklevel=3,
            )


@dataclass(frozen=True, eq=False, slots=True)
class PreparedProfile:
    """Valid points of a profile in their order along the line, with their noise.

    Parameters
    ----------
    points : (n, 2) ndarray
        Valid points in their order along the line; if all points are lost, all of them, as NaN
        rows. Units: mm.
    noisy_points : NoisyPoints
        The same points as complex numbers x + iy, with the covariances of their errors.
    valid_indices : (k,) int ndarray
        Indices of the `points` that are not lost: 0 to n - 1, or none.
    sensor_columns : (n,) int ndarray
        Index of each of `points` in the `Profile`.
    noise_std : float
        Median standard deviation of a point's error along its ray: estimated, or the root of the
        trace of its covariance (exact if the error lies along the ray). Units: mm.
    pitch : float
        Median spacing of neighbouring points across the mean ray; always positive. Units: mm.
    min_variance_factor : float
        Smallest ratio that a fit accepts of the true variances to those of `noisy_points`: 1 for a
        given noise model, less for an estimated noise.
    ray : complex
        Unit vector x + iy of the mean ray, towards the sensor: that of the noise model, +Y where
        this is unknown.
    """

    points: Points
    noisy_points: NoisyPoints
    valid_indices: IntArray
    sensor_columns: IntArray
    noise_std: float
    pitch: float
    min_variance_factor: float
    ray: complex

    @property
    def noise_is_estimated(self) -> bool:
        """Whether the noise was estimated from neighbours, not given by a noise model."""
        return self.min_variance_factor < 1

    @property
    def estimated_std(self) -> float | None:
        """`noise_std` if it was estimated, None for a given noise model. Units: mm."""
        return self.noise_std if self.noise_is_estimated else None

    def max_noise_factor(self, radius: float) -> float:
        """Return the largest accepted ratio of the rms residual of an ellipse to `noise_std`.

        Parameters
        ----------
        radius : float
            Radius of the cylinder. Units: mm.

        Returns
        -------
        float
            At least 3 for a given noise model, 4 for an estimated noise.
        """
        factor = MAX_ESTIMATED_NOISE_FACTOR if self.noise_is_estimated else MAX_NOISE_FACTOR
        return max(factor, MAX_RELATIVE_SCATTER * radius / self.noise_std)


@dataclass(frozen=True)
class Arc:
    """Span of consecutive points of a profile, whose inliers lie on one ellipse.

    Parameters
    ----------
    start, stop : int
        First index, and index after the last: ``profile.points[start:stop]``.

    Examples
    --------
    >>> len(Arc(412, 447))
    35
    """

    start: int
    stop: int

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.stop:
            raise ValueError(f"expected 0 <= start < stop, got [{self.start}, {self.stop})")

    def __len__(self) -> int:
        return self.stop - self.start

    def of(self, profile: Profile) -> Points:
        """Return the points of the arc, lost points as NaN rows.

        Parameters
        ----------
        profile : Profile
            Profile of the arc.

        Returns
        -------
        (k, 2) ndarray
            Points in the section frame. Units: mm.

        Examples
        --------
        >>> Arc(1, 2).of(Profile([[0.0, -400.0], [1.0, -399.0]])).tolist()
        [[1.0, -399.0]]
        """
        return profile.points[self.start : self.stop]
