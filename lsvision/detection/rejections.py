"""Every stretch of a profile that holds no cylinder, with one reason: never silence."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from lsvision.detection.arcs import Rejection
from lsvision.detection.candidates import (
    MAX_OVERLAP,
    MAX_RMS_SIGMAS,
    CandidateSettings,
    max_circle_rms,
)
from lsvision.detection.windows import fit_window_circles
from lsvision.geometry import BoolArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex
from lsvision.profile import Arc, PreparedProfile
from lsvision.statistics.robust import mad_std


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
    min_span_points: int = CandidateSettings().min_span_points,
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
    min_span_points : int
        Shorter stretches are left out; where there is no longer one, that is the reason.

    Returns
    -------
    list of Rejection
        In the order of the profile; empty only where there are cylinders or no columns.
    """
    told = np.zeros(len(profile.points), dtype=bool)
    for cylinder in cylinders:
        told[cylinder.indices[0] : cylinder.indices[-1] + 1] = True
    kept: list[Rejection] = []
    for rejection in rejections:
        span = slice(rejection.arc.start, rejection.arc.stop)
        if told[span].mean() <= MAX_OVERLAP:
            flat = _flatness_reason(profile.points[span], profile.noise_std)
            kept.append(Rejection(rejection.arc, flat or rejection.reason))
            told[span] = True
    runs = [run for component in components for run in _untold_runs(component, told)]
    for run in [run for run in runs if len(run) >= min_span_points]:
        reason = run_rejection_reason(profile.points[run], profile.noise_std, radius_range)
        kept.append(Rejection(Arc(int(run[0]), int(run[-1]) + 1), reason))
    if not kept and not cylinders and len(told):
        reason = _few_points_reason(len(profile.valid_indices), min_span_points)
        kept.append(Rejection(Arc(0, len(told)), reason))
    return sorted(kept, key=lambda rejection: rejection.arc.start)


def _untold_runs(component: IntArray, told: BoolArray) -> list[IntArray]:
    """The stretches of a component of which nothing was said."""
    untold = (~told[component]).nonzero()[0]
    cuts = (untold[1:] - untold[:-1] > 1).nonzero()[0] + 1
    bounds = [0, *cuts.tolist(), len(untold)]
    return [component[untold[start:stop]] for start, stop in pairwise(bounds)]


def run_rejection_reason(run: Points, noise_std: float, radius_range: tuple[float, float]) -> str:
    """Why a run of points that seeded no arc is no cylinder: flat, concave, wrong radius.

    Parameters
    ----------
    run : (n, 2) ndarray
        At least 3 points. Units: mm.
    noise_std : float
        Units: mm.
    radius_range : tuple of float
        Units: mm.
    """
    flat = _flatness_reason(run, noise_std)
    if flat is not None:
        return flat
    circle = fit_window_circles(run, np.array([0]), np.array([len(run)]))
    fits = bool((circle.rms <= max_circle_rms(circle.radius, noise_std))[0])
    radius, rms, line_rms = float(circle.radius[0]), float(circle.rms[0]), float(circle.line_rms[0])
    low, high = radius_range
    if not rms < line_rms:
        return f"no arc: {line_rms:.2f} mm rms from a straight line"
    if not circle.convex[0]:
        return "concave towards the sensor"
    if fits and not low <= radius <= high:
        return f"radius {radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    return f"no ellipse: best circle leaves {rms:.2f} mm rms at {noise_std:.2f} mm noise"


def _flatness_reason(run: Points, noise_std: float) -> str | None:
    """How flat points are that lie on a straight line within their noise; None if they do not."""
    z = as_complex(run)
    centred = z - z.mean()
    along = np.exp(0.5j * np.angle(centred @ centred))
    rms = mad_std((centred * along.conj()).imag)
    if rms >= MAX_RMS_SIGMAS * noise_std:
        return None
    return f"flat: {rms:.2f} mm rms from a straight line"


def _few_points_reason(valid: int, least: int) -> str:
    if not valid:
        return "all points are lost"
    return f"too few points: {valid}, of which no {least} are connected"
