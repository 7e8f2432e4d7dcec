"""Preparation of a profile for detection: points in order along the line, with their noise."""

import math
from statistics import NormalDist

import numpy as np

from lsvision.detection.line_order import order_along_line
from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.geometry.arrays import (
    MAX_VARIANCE_MM2,
    PSD_TOLERANCE,
    measure_extent,
    require_covariances,
)
from lsvision.geometry.noisy_points import NoisyPoints, as_complex, as_vectors, rotate_to_ray_frame
from lsvision.profile import NoiseModel, PreparedProfile, Profile
from lsvision.statistics.robust import upper_median
from lsvision.statistics.rounding import find_rounding

MAX_POINTS = 8192
"""Largest number of points; denser profiles are thinned. No sensor has more than 4096 columns, with
two returns each. A line whose noise is 200 times its pitch takes a second with this number, and one
to two minutes with 20 000."""
NOISE_QUANTILE = 0.35
"""Quantile of the offsets from which the noise is estimated; low, because of outliers."""
NOISE_QUANTILE_SIGMAS = NormalDist().inv_cdf((1 + NOISE_QUANTILE) / 2) * math.sqrt(1 + 1 / 2)
"""Ratio of this quantile of a point's offset from the mean of its neighbours to the standard
deviation of the noise."""
LATERAL_FRACTION = 0.35
"""Ratio of the error along X to that along Y where no noise model is given: the direction of the
ray is unknown by 20 deg. Of 25 points on half a circle whose errors are isotropic, 85 % of the 95 %
intervals contain the radius (with 0.22 76 %, with 0.5 85 %), and the radii are off by 15 % less
than with 0.22. If the errors are along Y, radii are off by up to 7 % more than with 0.22 on arcs of
120 and 160 deg, and by 10 % more on half circles (with 0.5 by 20 %); those of real spheres by less
than 1 %."""
MIN_ESTIMATED_VARIANCE_FACTOR = 0.5**2
"""Smallest variance factor of an estimated noise: outliers and rounded numbers may double the
estimated standard deviation."""
MIN_NOISE_PITCHES = 1e-5
"""Smallest estimated noise, in pitches: that of exact points, above the rounding of float64."""


def prepare_profile(profile: Profile, noise: NoiseModel | None) -> PreparedProfile:
    """Order the valid points of a profile along the line, and add their noise.

    Lost points are left out, unless all points are lost. More than `MAX_POINTS` points are thinned
    evenly.

    Parameters
    ----------
    profile : Profile
        Any profile; it may be empty. Units: mm.
    noise : NoiseModel or None
        Noise of the points; None: noise along Y, estimated by `estimate_noise_std`, or the error
        of rounding where that is larger (`find_rounding`).

    Returns
    -------
    PreparedProfile
        Ordered points with their noise.

    Raises
    ------
    ValueError
        If the noise model's covariance of a valid point is not finite, zero, or has a negative
        eigenvalue.
    """
    columns = _select_valid_columns(profile.points)
    points = profile.points[columns]
    order = order_along_line(points)
    if order is not None:
        columns, points = columns[order], points[order]
    valid = np.arange(len(columns))
    if len(columns) == 0:  # all points are lost, and kept
        columns, points = np.arange(len(profile)), profile.points
    if noise is None:
        ray, factor = 1j, MIN_ESTIMATED_VARIANCE_FACTOR
        pitch = measure_typical_pitch(points[valid])
        step = find_rounding([points[valid, 1]])
        if step is None:
            std = estimate_noise_std(points[valid], pitch)
        else:
            std, factor = step / math.sqrt(12), 1.0
        noisy = NoisyPoints.uniform(as_complex(points), LATERAL_FRACTION * std, std)
    else:
        covariances, factor = noise.covariances(profile.points)[columns], 1.0
        noisy = _add_covariances(points, covariances, valid)
        ray = noisy[valid].mean_ray
        pitch = measure_typical_pitch(as_vectors(rotate_to_ray_frame(noisy.z[valid], ray)))
        # Of errors along the ray, the variance is the trace of the covariance.
        std = math.sqrt(2 * upper_median(noisy.mean_variance)) if len(valid) else 0.0
    return PreparedProfile(points, noisy, valid, columns, std, pitch, factor, ray)


def _select_valid_columns(points: Points) -> IntArray:
    """Return the columns that are not lost, thinned symmetrically from both ends."""
    valid: IntArray = (~np.isnan(points[:, 0])).nonzero()[0]
    if len(valid) <= MAX_POINTS:
        return valid
    half = np.arange(0, len(valid) // 2, math.ceil(len(valid) / MAX_POINTS))
    return np.asarray(valid[np.concatenate([half, len(valid) - 1 - half[::-1]])])


def _add_covariances(points: Points, covariances: FloatArray, valid: IntArray) -> NoisyPoints:
    """Return points with covariances; raise ValueError if that of a valid point is invalid."""
    with np.errstate(invalid="ignore"):  # values that are not finite are rejected below
        noisy = NoisyPoints.of(points, covariances)
        limits = np.minimum((1 + PSD_TOLERANCE) * noisy.mean_variance, MAX_VARIANCE_MM2)
        is_covariance = (limits > 0) & (np.abs(noisy.deviator) <= limits)
    if not is_covariance[valid].all():
        require_covariances(covariances[valid])  # slower, with a message
    return noisy


def measure_typical_pitch(points: Points) -> float:
    """Return the median spacing of ordered points (n, 2) along X (across the rays). Units: mm.

    Where all have the same x, their extent along Y over their number; 1 if all coincide or there is
    no point.
    """
    x = points[:, 0]
    spacing = np.abs(x[1:] - x[:-1])
    spacing = spacing[spacing > 0]
    if len(spacing) == 0:
        return measure_extent(points) / max(len(points), 1) or 1.0
    return upper_median(spacing)


def estimate_noise_std(points: Points, pitch: float) -> float:
    """Return the standard deviation of the noise of ordered points along Y. Units: mm.

    The estimate comes from the offset of each point from the mean of its neighbours, and is too
    small if the errors of neighbours are correlated.

    Parameters
    ----------
    points : (n, 2) ndarray
        Valid points in order along the line; any number. Units: mm.
    pitch : float
        Typical spacing of the points. Units: mm.

    Returns
    -------
    float
        At least `MIN_NOISE_PITCHES` pitches, the result also for fewer than three points.
    """
    z, y = as_complex(points), points[:, 1]
    repeated = z[1:] == z[:-1]
    if repeated.any():
        y = y[np.append(True, ~repeated)]
    offset = np.abs(y[1:-1] - (y[2:] + y[:-2]) / 2)
    # Zeros are excluded: a file may contain rounded numbers, or the same one for several columns.
    offset = offset[offset > 0]
    if len(offset) == 0:
        return MIN_NOISE_PITCHES * pitch
    rank = int(NOISE_QUANTILE * len(offset))
    offset.partition(rank)
    return max(float(offset[rank]) / NOISE_QUANTILE_SIGMAS, MIN_NOISE_PITCHES * pitch)
