"""Circles whose data a sensor or a program has smoothed, resampled, held or quantised.

Columns have an even pitch along X, noise is along Y, phi is 0, and there are no other objects. At
the ends of the arc, the windows of a filter are one-sided; in every other scene the points without
a full window are lost instead.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

RADII, PITCHES, NOISES = (10.0, 25.0), (0.1, 0.25), (0.03, 0.1)  # mm
STEEPEST = np.radians(75.0)
"""Slope beyond which a flank is lost."""


def circle(rng, noise=None):
    """x, y of a noisy arc and its circle: (x, y, radius, centre, sigma). Units: mm."""
    radius, pitch = rng.uniform(*RADII), rng.uniform(*PITCHES)
    centre = np.array([rng.uniform(-20, 20), -400.0 - radius])
    reach = radius * np.sin(STEEPEST)
    x = np.arange(centre[0] - reach + rng.uniform(0, pitch), centre[0] + reach, pitch)
    sigma = rng.uniform(*NOISES)
    white = rng.standard_normal(len(x)) if noise is None else noise(rng, len(x))
    y = centre[1] + np.sqrt(radius**2 - (x - centre[0]) ** 2) + sigma * white
    return x, y, radius, centre, sigma


def untouched(rng, ends):
    """White noise and nothing done to it: what the others are compared with."""
    x, y, radius, centre, sigma = circle(rng)
    return x, y, radius, centre, f"noise {sigma:.3f}"


def resampled(rng, ends):
    """Linear interpolation to 2-5 times as many columns."""
    x, y, radius, centre, sigma = circle(rng)
    factor = int(rng.integers(2, 6))
    fine = np.linspace(x[0], x[-1], factor * (len(x) - 1) + 1)
    return fine, np.interp(fine, x, y), radius, centre, f"noise {sigma:.3f} times {factor}"


def held(rng, ends):
    """Each height repeated over 2-4 columns."""
    x, y, radius, centre, sigma = circle(rng)
    factor = int(rng.integers(2, 5))
    step = (x[1] - x[0]) / factor
    fine = (x[:, None] + step * (np.arange(factor) - (factor - 1) / 2)).ravel()
    return fine, np.repeat(y, factor), radius, centre, f"noise {sigma:.3f} times {factor}"


def median(rng, ends):
    """Median over 5-21 columns."""
    size = int(rng.choice(np.arange(5, 22, 2)))
    return _filtered(rng, ends, size // 2, np.nanmedian, f"median {size}")


def mean(rng, ends):
    """Mean over 3-9 columns."""
    size = int(rng.choice([3, 5, 7, 9]))
    return _filtered(rng, ends, size // 2, np.nanmean, f"mean {size}")


def gaussian(rng, ends):
    """Gaussian filter of a sigma of 1-4 columns."""
    spread = rng.uniform(1.0, 4.0)
    half = int(np.ceil(3 * spread))
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) / spread) ** 2)

    def blend(windows, axis):
        there = np.isfinite(windows) * weights
        return (np.nan_to_num(windows) * weights).sum(axis) / there.sum(axis)

    return _filtered(rng, ends, half, blend, f"sigma {spread:.1f} columns")


def quantised(rng, ends):
    """Heights rounded to 0.01-0.1 mm, columns to 0.01 mm."""
    x, y, radius, centre, sigma = circle(rng)
    step = float(rng.choice([0.01, 0.02, 0.05, 0.1]))
    rounded = np.round(y / step) * step
    return np.round(x, 2), rounded, radius, centre, f"noise {sigma:.3f} step {step}"


def correlated(rng, ends):
    """Noise of first order, 0.3-0.9 from one column to the next."""
    rho = rng.uniform(0.3, 0.9)

    def noise(rng, count):
        white = rng.standard_normal(count)
        errors = [white[0]]
        for fresh in white[1:]:
            errors.append(rho * errors[-1] + np.sqrt(1 - rho**2) * fresh)
        return np.array(errors)

    x, y, radius, centre, sigma = circle(rng, noise)
    return x, y, radius, centre, f"noise {sigma:.3f} rho {rho:.2f}"


PROCESSES = {
    "untouched": untouched,
    "resampled": resampled,
    "median": median,
    "mean": mean,
    "gaussian": gaussian,
    "held": held,
    "quantised": quantised,
    "correlated": correlated,
}
"""Each draws x, y, radius, centre and a description; `ends` is "one-sided" or "lost"."""


def _filtered(rng, ends, half, reduce, words):
    x, y, radius, centre, sigma = circle(rng)
    padded = np.concatenate([np.full(half, np.nan), y, np.full(half, np.nan)])
    smooth = reduce(sliding_window_view(padded, 2 * half + 1), axis=1)
    if ends == "lost":
        smooth[:half] = smooth[-half:] = np.nan
    return x, smooth, radius, centre, f"noise {sigma:.3f} {words} ends {ends}"
