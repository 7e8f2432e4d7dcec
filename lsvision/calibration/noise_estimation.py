"""How much corners and line points scatter, so that a weighted fit's covariance is honest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.autocorrelation import autocorrelation_time
from lsvision.calibration.bundle_adjustment_state import LaserView
from lsvision.geometry import FloatArray

HUBER_THRESHOLD = 3.0
"""Sigmas from which on a residual counts linearly, so that a spoilt view cannot bend the rest."""

GROUPS, MIN_GROUP_SIZE = 4, 40
"""Groups of line points by brightness whose noise is told apart, and fewest points of one."""


@dataclass(frozen=True, eq=False)
class LineNoise:
    """One sigma of each point of each view's line. Units: px.

    Parameters
    ----------
    point_stds : tuple of (m,) ndarray
        Of the point by itself.
    effective_stds : tuple of (m,) ndarray
        So much larger as neighbours err alike: weighted by it a point counts for what it tells.
    """

    point_stds: tuple[FloatArray, ...]
    effective_stds: tuple[FloatArray, ...]


def estimate_line_noise(views: Sequence[LaserView], misfits: Sequence[FloatArray]) -> LineNoise:
    """How much the lines scatter about their own smooth courses.

    Bright points and dark ones, told apart by the sigmas they came with, each by their own
    scatter: a line is ten times surer on white than on black.

    Parameters
    ----------
    views : sequence of LaserView
        The lines.
    misfits : sequence of (m,) ndarray
        Of each line from where boards and plane would have it. Units: px.
    """
    gaps = [gap - _quadratic_trend(view, gap) for view, gap in zip(views, misfits, strict=True)]
    claimed = np.concatenate([view.line_std for view in views])
    ends = np.cumsum([len(gap) for gap in gaps])[:-1]
    own = np.split(_stds_by_predicted_std(claimed, np.concatenate(gaps)), ends)
    normalised = [
        np.clip(gap / std, -HUBER_THRESHOLD, HUBER_THRESHOLD)
        for gap, std in zip(gaps, own, strict=True)
    ]
    # A single line tells likeness roughly; it is the camera's and the surface's, one for all.
    likeness = float(np.mean([autocorrelation_time(each, 3) for each in normalised]))
    return LineNoise(tuple(own), tuple(std * np.sqrt(likeness) for std in own))


def _quadratic_trend(view: LaserView, misfit: FloatArray) -> FloatArray:
    """A parabola along the line, which no noise but board and plane bring about."""
    along = np.ptp(view.line_pixels, axis=0).argmax()
    course = view.line_pixels[:, along] - view.line_pixels[:, along].mean()
    smooth: FloatArray = np.polynomial.Polynomial.fit(course, misfit, 2)(course)
    return smooth


def _stds_by_predicted_std(claimed: FloatArray, gaps: FloatArray) -> FloatArray:
    """Scatter of each of a few groups of points that claim the most alike sigmas."""
    groups = max(1, min(GROUPS, len(claimed) // MIN_GROUP_SIZE))
    edges = np.quantile(claimed, np.arange(1, groups) / groups)
    group = np.searchsorted(edges, claimed)
    stds = np.empty(len(claimed))
    for each in np.unique(group):
        stds[group == each] = huber_std(gaps[group == each])
    return stds


def huber_std(values: FloatArray) -> float:
    """Sigma that makes a Huber fit's covariance right also where tails are heavier than normal.

    Definition: sigma sqrt(mean psi^2) / mean psi' (Huber 1981, section 6.4) with sigma from
    `mad_std`; for a normal distribution it is sigma.
    """
    sigma = mad_std(values)
    clipped = np.clip(values / sigma, -HUBER_THRESHOLD, HUBER_THRESHOLD)
    within = float(np.mean(np.abs(clipped) < HUBER_THRESHOLD))
    return sigma * float(np.sqrt(np.mean(clipped**2))) / within


def mad_std(values: FloatArray) -> float:
    """1.4826 MAD, which for a normal distribution is sigma; kept off zero for perfect data."""
    return max(1.4826 * float(np.median(np.abs(values))), 1e-4)
