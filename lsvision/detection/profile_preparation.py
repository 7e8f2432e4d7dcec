"""Order and noise of a profile, before anything is detected in it."""

import math
from statistics import NormalDist

import numpy as np

from lsvision.detection.line_order import order_along_line
from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.geometry.arrays import extent_of
from lsvision.geometry.noisy_points import NoisyPoints, as_complex
from lsvision.profile import NoiseModel, PreparedProfile, Profile
from lsvision.statistics.robust import upper_median

MAX_POINTS = 20_000
"""Denser profiles (no sensor has more than 4096 columns) are thinned to so many points at most."""
NOISE_QUANTILE = 0.35
"""The smaller offsets tell the noise even where many points are outliers."""
NOISE_QUANTILE_SIGMAS = NormalDist().inv_cdf((1 + NOISE_QUANTILE) / 2) * math.sqrt(1.5)
"""That quantile for errors of 1 sigma, of a point less the mean of its two neighbours."""
LATERAL_FRACTION = 0.2
"""Error along X over the error along Y where no noise model is given: the tangent of 11 deg,
by which the unknown ray usually leaves Y."""
MIN_ESTIMATED_VARIANCE_FACTOR = 0.25
"""An estimated standard deviation may be twice the true one: outliers and rounding raise it."""
MIN_NOISE_PITCHES, MIN_PITCH_MM = 1e-5, 1e-9
"""Noise in pitches, and pitch in mm, of points that show none: above the rounding of float64."""


def prepare_profile(profile: Profile, noise: NoiseModel | None) -> PreparedProfile:
    """Order a profile's valid points along the line and add their noise.

    Parameters
    ----------
    profile : Profile
        Any order: see `order_along_line`. More than 20 000 points are thinned evenly.
    noise : NoiseModel or None
        None: along Y, estimated from how neighbours scatter about their chords.

    Returns
    -------
    PreparedProfile
        Without the lost points; of a profile without any other, with all of them.
    """
    columns = _valid_columns(profile.points)
    points = profile.points[columns]
    order = order_along_line(points)
    if order is not None:
        columns, points = columns[order], points[order]
    valid = np.arange(len(columns))
    pitch = typical_pitch(points)
    if len(columns) == 0:
        columns, points = np.arange(len(profile)), profile.points
    if noise is None:
        std, factor = estimate_noise_std(points[valid], pitch), MIN_ESTIMATED_VARIANCE_FACTOR
        noisy = NoisyPoints.alike(as_complex(points), LATERAL_FRACTION * std, std)
    else:
        noisy, factor = NoisyPoints.of(points, noise.covariances(profile.points)[columns]), 1.0
        std = math.sqrt(2 * upper_median(noisy.mean_variance)) if len(valid) else 0.0
    return PreparedProfile(points, noisy, valid, columns, std, pitch, factor)


def _valid_columns(points: Points) -> IntArray:
    """Columns that are not lost, thinned from both ends alike."""
    valid: IntArray = (~np.isnan(points[:, 0])).nonzero()[0]
    if len(valid) <= MAX_POINTS:
        return valid
    half = np.arange(0, len(valid) // 2, -(-len(valid) // MAX_POINTS))
    both = np.concatenate([half, len(valid) - 1 - half[::-1]])
    return np.asarray(valid[both])


def typical_pitch(points: Points) -> float:
    """Median spacing of neighbouring points along X.

    Parameters
    ----------
    points : (n, 2) ndarray
        Ordered, none lost. Units: mm.

    Returns
    -------
    float
        Positive always. Units: mm.
    """
    x = points[:, 0]
    spacing = np.abs(x[1:] - x[:-1])
    spacing = spacing[spacing > 0]
    if len(spacing) == 0:
        return max(extent_of(points) / max(len(points), 1), MIN_PITCH_MM)
    return upper_median(spacing)


def estimate_noise_std(points: Points, pitch: float) -> float:
    """Noise of ordered points, from the height of each above the middle of its neighbours.

    Parameters
    ----------
    points : (n, 2) ndarray
        Ordered, none lost. Units: mm.
    pitch : float
        Their spacing. Units: mm.

    Returns
    -------
    float
        One sigma along Y; never zero. Too small where neighbours' errors are correlated.
        Units: mm.
    """
    z, y = as_complex(points), points[:, 1]
    repeated = z[1:] == z[:-1]
    if repeated.any():
        y = y[np.append(True, ~repeated)]
    offset = np.abs(y[1:-1] - (y[2:] + y[:-2]) / 2)
    # Without zeros: a file may round its numbers, or hold them over several columns.
    low = _lower_quantile(offset[offset > 0])
    return max(low / NOISE_QUANTILE_SIGMAS, MIN_NOISE_PITCHES * pitch)


def _lower_quantile(values: FloatArray) -> float:
    rank = int(NOISE_QUANTILE * len(values))
    return float(np.partition(values, rank)[rank]) if len(values) else 0.0
