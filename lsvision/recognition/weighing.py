"""Order and noise of a profile, before anything is recognised in it."""

import math

import numpy as np

from lsvision.profile import NoiseModel, Profile, WeighedProfile
from lsvision.shapes import FloatArray, IntArray, Points

ORDERLY = 0.8
"""Share of steps along X in one direction above which the sensor's order is trusted."""


def weigh_profile(profile: Profile, noise: NoiseModel | None) -> WeighedProfile:
    """Write out the noise of a profile's points and their order along the line.

    Parameters
    ----------
    profile : Profile
        Any order; kept where x mostly rises or mostly falls, else by x.
    noise : NoiseModel or None
        None: isotropic, estimated from how neighbours scatter about their chords.

    Returns
    -------
    WeighedProfile
    """
    points = profile.points
    order = _order_along_line(points)
    if noise is None:
        std = estimate_noise_std(points[order])
        covariances = np.broadcast_to(np.eye(2) * std**2, (len(points), 2, 2))
        return WeighedProfile(points, covariances, order, std, noise_known=False)
    covariances = noise.covariances(points)
    variances = covariances[order, 0, 0] + covariances[order, 1, 1]
    std = float(np.sqrt(np.median(variances))) if len(order) else 0.0
    return WeighedProfile(points, covariances, order, std, noise_known=True)


def estimate_noise_std(points: Points) -> float:
    """Noise of ordered points, from the distance of each from the chord of its neighbours.

    Parameters
    ----------
    points : (n, 2) ndarray
        Ordered, none lost. Units: mm.

    Returns
    -------
    float
        One sigma; never zero. Too small where neighbours' errors are correlated. Units: mm.
    """
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 1.0
    smallest = max(1e-7 * extent, 1e-9)
    if len(points) < 5:
        return smallest
    chord = points[2:] - points[:-2]
    middle = points[1:-1] - (points[2:] + points[:-2]) / 2
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), smallest)
    offset = np.abs(middle[:, 0] * chord[:, 1] - middle[:, 1] * chord[:, 0]) / length
    # The middle of three: variance 1 + 1/4 + 1/4.
    return max(float(np.median(offset)) * 1.4826 / math.sqrt(1.5), smallest)


def _order_along_line(points: Points) -> IntArray:
    valid = np.flatnonzero(np.isfinite(points[:, 0]))
    steps: FloatArray = np.diff(points[valid, 0])
    if len(steps) == 0:
        return valid
    rising, falling = float(np.mean(steps >= 0)), float(np.mean(steps <= 0))
    if max(rising, falling) >= ORDERLY:
        return valid
    by_x: IntArray = valid[np.argsort(points[valid, 0], kind="stable")]
    return by_x
