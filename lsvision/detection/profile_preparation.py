"""Order and noise of a profile, before anything is recognised in it."""

import math
from statistics import NormalDist

import numpy as np

from lsvision.profile import NoiseModel, PreparedProfile, Profile
from lsvision.shapes import FloatArray, IntArray, Points
from lsvision.shapes.arrays import extent_of
from lsvision.shapes.noisy_points import NoisyPoints, as_complex
from lsvision.statistics.robust import upper_median

MAX_POINTS = 20_000
"""Denser profiles (no sensor has more than 4096 columns) are thinned evenly to this."""
MAX_COORDINATE_MM = 1e9
"""Numbers beyond a thousand kilometres are rubbish of a file, not points."""
NOISE_QUANTILE = 0.35
"""The smaller offsets tell the noise even where many points are stray."""
NOISE_QUANTILE_SIGMAS = NormalDist().inv_cdf((1 + NOISE_QUANTILE) / 2)
"""That share of a normal distribution's offsets is smaller."""
MIN_MONOTONIC_FRACTION = 0.8
"""Share of steps along X in one direction above which the sensor's order is trusted."""


def prepare_profile(profile: Profile, noise: NoiseModel | None) -> PreparedProfile:
    """Write out the noise of a profile's points and their order along the line.

    Parameters
    ----------
    profile : Profile
        Any order; kept where x mostly rises or mostly falls, else by x. More than 20 000
        points are thinned evenly.
    noise : NoiseModel or None
        None: isotropic, estimated from how neighbours scatter about their chords.

    Returns
    -------
    PreparedProfile
    """
    along_line = _line_order(profile.points)
    points = profile.points[along_line]
    columns = np.arange(len(profile))[along_line]
    order = (np.maximum(np.abs(points[:, 0]), np.abs(points[:, 1])) < MAX_COORDINATE_MM).nonzero()[
        0
    ]
    pitch = typical_pitch(points[order])
    if noise is None:
        std = estimate_noise_std(points[order])
        covariances = np.broadcast_to(np.eye(2) * std**2, (len(points), 2, 2))
        noisy = NoisyPoints.of(points, covariances)
        return PreparedProfile(
            points, covariances, noisy, order, columns, std, pitch, noise_known=False
        )
    covariances = noise.covariances(profile.points)[along_line]
    noisy = NoisyPoints.of(points, covariances)
    std = math.sqrt(2 * upper_median(noisy.mean_variance[order])) if len(order) else 0.0
    return PreparedProfile(points, covariances, noisy, order, columns, std, pitch, noise_known=True)


def typical_pitch(points: Points) -> float:
    """Median spacing of neighbouring points along X. Units: mm; tiny but positive always."""
    x = points[:, 0]
    spacing = np.abs(x[1:] - x[:-1])
    spacing = spacing[spacing > 0]
    if len(spacing) == 0:
        return max(extent_of(points) / max(len(points), 1), 1e-9)
    return upper_median(spacing)


def estimate_noise_std(points: Points) -> float:
    """Noise of ordered points, from the height of each above the middle of its neighbours.

    Parameters
    ----------
    points : (n, 2) ndarray
        Ordered, none lost. Units: mm.

    Returns
    -------
    float
        One sigma; never zero. Too small where neighbours' errors are correlated. Units: mm.
    """
    smallest = max(1e-7 * extent_of(points), 1e-9)
    if len(points) < 5:
        return smallest
    z, new = as_complex(points), np.ones(len(points), dtype=bool)
    new[1:] = z[1:] != z[:-1]
    y = points[new, 1]
    if len(y) < 5:
        return smallest
    offset = np.abs(y[1:-1] - (y[2:] + y[:-2]) / 2)
    low = _lower_quantile(offset)
    if low == 0 and (offset > 0).any():
        # The file rounds its numbers more coarsely than they scatter.
        low = _lower_quantile(offset[offset > 0])
    # The middle of three: variance 1 + 1/4 + 1/4.
    return max(low / NOISE_QUANTILE_SIGMAS / math.sqrt(1.5), smallest)


def _lower_quantile(values: FloatArray) -> float:
    rank = int(NOISE_QUANTILE * len(values))
    return float(np.partition(values, rank)[rank])


def _line_order(points: Points) -> slice | IntArray:
    """Columns in the sensor's order, or by x where that order is none, lost ones last; thinned."""
    step = 1 + len(points) // MAX_POINTS
    x = points[np.isfinite(points[:, 0]), 0]
    steps = x[1:] - x[:-1]
    forwards, backwards = np.count_nonzero(steps >= 0), np.count_nonzero(steps <= 0)
    if max(forwards, backwards) >= MIN_MONOTONIC_FRACTION * len(steps):
        return slice(None, None, step)
    by_x: IntArray = np.argsort(points[:, 0], kind="stable")
    return by_x[::step]
