"""Every stretch of a profile that holds no cylinder, with one reason: never silence."""

import cmath
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from lsvision.detection.acceptance import Rejection
from lsvision.detection.windows import WindowCircles, fit_window_circles
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import BoolArray, IntArray, Points
from lsvision.shapes.noisy_points import as_complex

MAX_OVERLAP = 0.5
"""A rejection that shares more of its points with a cylinder or another rejection is left out."""
MIN_POINTS = 8


class HasIndices(Protocol):
    """What has been accepted as a cylinder: it rests on points."""

    @property
    def indices(self) -> IntArray:
        """Indices of the profile's points."""
        ...


def complete_rejections(
    profile: PreparedProfile,
    components: list[IntArray],
    cylinders: Sequence[HasIndices],
    rejections: list[Rejection],
    radius_range: tuple[float, float],
) -> list[Rejection]:
    """Rejections without repetition, and one for each stretch nothing was said of yet.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    components : list of (k,) int ndarray
        Connected points.
    cylinders : sequence
        What was found.
    rejections : list of Rejection
        What was tried in vain, the most telling first.
    radius_range : tuple of float
        Units: mm.

    Returns
    -------
    list of Rejection
        In the order of the profile.
    """
    told = np.zeros(len(profile.points), dtype=bool)
    for cylinder in cylinders:
        told[cylinder.indices[0] : cylinder.indices[-1] + 1] = True
    kept: list[Rejection] = []
    for rejection in rejections:
        span = slice(rejection.arc.start, rejection.arc.stop)
        if told[span].mean() <= MAX_OVERLAP:
            own = profile.points[span][np.isfinite(profile.points[span, 0])]
            flat = flatness_reason(own, profile.noise_std)
            kept.append(Rejection(rejection.arc, flat or rejection.reason))
            told[span] = True
    runs = [run for component in components for run in _unexplained_runs(component, told)]
    points = [profile.points[run] for run in runs]
    reasons = unassigned_run_reasons(points, profile.noise_std, radius_range)
    for run, reason in zip(runs, reasons, strict=True):
        kept.append(Rejection(Arc(int(run[0]), int(run[-1]) + 1), reason))
    return sorted(kept, key=lambda rejection: rejection.arc.start)


def _unexplained_runs(component: IntArray, told: BoolArray) -> list[IntArray]:
    """The stretches of a component of which nothing was said."""
    untold = (~told[component]).nonzero()[0]
    cuts = (untold[1:] - untold[:-1] > 1).nonzero()[0] + 1
    bounds = [0, *cuts.tolist(), len(untold)]
    stretches = [untold[start:stop] for start, stop in pairwise(bounds)]
    return [component[stretch] for stretch in stretches if len(stretch) >= MIN_POINTS]


def unassigned_run_reasons(
    runs: list[Points], noise_std: float, radius_range: tuple[float, float]
) -> list[str]:
    """Why runs of points that seeded no arc are no cylinders: flat, concave, wrong radius.

    Parameters
    ----------
    runs : list of (n, 2) ndarray
        At least 3 points each. Units: mm.
    noise_std : float
        Units: mm.
    radius_range : tuple of float
        Units: mm.
    """
    flat = [flatness_reason(run, noise_std) for run in runs]
    curved = [run for run, reason in zip(runs, flat, strict=True) if reason is None]
    circled = iter(_circle_fit_reasons(curved, noise_std, radius_range))
    return [reason or next(circled) for reason in flat]


def _circle_fit_reasons(
    runs: list[Points], noise_std: float, radius_range: tuple[float, float]
) -> list[str]:
    if not runs:
        return []
    points, stops = np.concatenate(runs), np.cumsum([len(run) for run in runs])
    starts = np.append(0, stops[:-1])
    circles = fit_window_circles(points, starts, stops)
    sides = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    return [
        _circle_fit_reason(circles, i, 20 * longest, noise_std, radius_range)
        for i, longest in enumerate(sides.max(axis=1).tolist())
    ]


def _circle_fit_reason(
    circles: WindowCircles,
    i: int,
    straight: float,
    noise_std: float,
    radius_range: tuple[float, float],
) -> str:
    radius, rms = float(circles.radius[i]), float(circles.rms[i])
    if radius > straight:
        return f"flat: radius over {straight:.0f} mm"
    if not circles.convex[i]:
        return "concave towards the sensor"
    low, high = radius_range
    if not low <= radius <= high and rms < max(5 * noise_std, 0.02 * radius):
        return f"radius {radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    return f"no ellipse: best circle leaves {rms:.2f} mm rms at {noise_std:.2f} mm noise"


def flatness_reason(own: Points, noise_std: float) -> str | None:
    """How flat points are that lie on a straight line within their noise; None if they do not.

    Parameters
    ----------
    own : (n, 2) ndarray
        Units: mm.
    noise_std : float
        Units: mm.
    """
    z = as_complex(own)
    centred = z - z.sum() / len(z)
    along = cmath.phase(centred @ centred) / 2
    across = np.abs((centred * cmath.rect(1.0, -along)).imag)
    # The largest tenth may be jumps; nine tenths of a normal distribution lie in 1.645 sigma.
    rank = int(0.9 * len(across))
    rms = float(np.partition(across, rank)[rank]) / 1.645
    return f"flat: {rms:.2f} mm rms from a straight line" if rms < 2.5 * noise_std else None
