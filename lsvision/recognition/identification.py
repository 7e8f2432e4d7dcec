"""Rough identification: the arc that belongs to each candidate (paper section 3.2.1).

The paper slides a window of 10 % of the points over the whole profile and asks whether all r_j
lie below the sensor error. Here the windows start at a candidate and walk outwards from it, the
ellipse fitted anew after each step, until points beyond the sensor error follow one another;
single lost lines and jumps inside do not end an arc.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.fitting.ellipse_problem import ellipse_of, is_ellipse, parameters_of
from lsvision.fitting.quick_fit import (
    normal_residuals,
    parameter_rows,
    refine_quickly,
    tolerant_variances,
)
from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.candidates import Candidate, seed_ellipse
from lsvision.shapes import BoolArray, Ellipse, FloatArray, IntArray, Points

FARTHEST_NORMAL = -0.5
"""Smallest y of an outward normal that a sensor with a fan of +/- 30 deg can still light."""


@dataclass(frozen=True, kw_only=True, slots=True)
class IdentificationSettings:
    """Rough identification, section 3.2.1.

    Parameters
    ----------
    sensor_error_sigmas : float
        The paper's sensor error, as a multiple of the point's standard deviation along the
        ellipse's normal.
    window_fraction : float
        Share of the arc by which it may grow at each end in one step (the paper's 10 % are of
        the whole profile).
    ending_points : int
        More than so many points in a row beyond the sensor error interrupt an arc.
    bridge_fraction : float
        An interruption shorter than this share of the arc is bridged where good points follow.
    rounds : int
        Fits and steps at the most.
    """

    sensor_error_sigmas: float = 4.0
    window_fraction: float = 0.5
    ending_points: int = 3
    bridge_fraction: float = 0.25
    correlation: float = 4.0
    largest_extrapolation: float = 0.5
    rounds: int = 10
    fewest_points: int = 8
    largest_change: float = 3.0


@dataclass(frozen=True, eq=False, slots=True)
class WeighedSpan:
    """Points around an arc, their covariances, and how much more they may scatter.

    Parameters
    ----------
    points : (n, 2) ndarray
        Units: mm.
    covariances : (n, 2, 2) ndarray
        Units: mm^2.
    largest_misfit : float
        See `WeighedProfile`.
    """

    points: Points
    covariances: FloatArray
    largest_misfit: float


@dataclass(frozen=True, eq=False, slots=True)
class IdentifiedArc:
    """An arc, the points on it, and the ellipse that holds them together.

    Parameters
    ----------
    arc : Arc
        The span.
    indices : (k,) int ndarray
        The points of the span that lie on the ellipse; jumps and lost ones are missing.
    ellipse : Ellipse
        Units: mm, rad.
    """

    arc: Arc
    indices: IntArray
    ellipse: Ellipse


def identify_arc(
    profile: WeighedProfile,
    candidate: Candidate,
    free: IntArray,
    settings: IdentificationSettings = IdentificationSettings(),
) -> IdentifiedArc | None:
    """Grow a candidate to the whole arc around it.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    candidate : Candidate
        Where to begin.
    free : (k,) int ndarray
        Indices of the points that may belong to it, ordered.
    settings : IdentificationSettings
        Sensor error and steps.

    Returns
    -------
    IdentifiedArc or None
        None where the growth breaks down: the points around the seed are no ellipse.
    """
    own, covariances = profile.points[free], profile.covariances[free]
    seeded = np.zeros(len(profile.points), dtype=bool)
    seeded[candidate.indices] = True
    inside = np.flatnonzero(seeded[free])
    if len(inside) < settings.fewest_points:
        return None
    parameters = parameters_of(seed_ellipse(profile, candidate))
    start, stop = int(inside[0]), int(inside[-1]) + 1
    for round_ in range(settings.rounds):
        parameters, unsure = refine_quickly(
            own[inside], covariances[inside], parameters, 2 if round_ == 0 else 1
        )
        if not _plausible(parameters, candidate.radius, settings.largest_change):
            return None
        step = max(4, int(settings.window_fraction * (stop - start)))
        low, high = max(0, start - step), min(len(own), stop + step)
        near = WeighedSpan(
            own[low:high], covariances[low:high], profile.largest_misfit(candidate.radius)
        )
        on_ellipse = _on_ellipse(near, parameters, unsure, inside - low, settings)
        middle = min(max((start + stop) // 2 - low, 0), high - low - 1)
        begin, end = _run_around(on_ellipse, middle, settings)
        last, (start, stop) = (start, stop), (low + begin, low + end)
        inside = start + np.flatnonzero(on_ellipse[begin:end])
        if len(inside) < settings.fewest_points:
            return None
        if last == (start, stop) and round_ > 0:
            break
    indices = free[inside]
    return IdentifiedArc(
        Arc(int(indices[0]), int(indices[-1]) + 1), indices, ellipse_of(parameters)
    )


def _plausible(parameters: FloatArray, radius: float, largest_change: float) -> bool:
    """An ellipse, and not quite another size than the circle it began with."""
    size = float(parameters[2])
    return is_ellipse(parameters) and radius / largest_change < size < radius * largest_change


def _on_ellipse(
    near: WeighedSpan,
    parameters: FloatArray,
    unsure: FloatArray,
    inside: IntArray,
    settings: IdentificationSettings,
) -> BoolArray:
    """Within the sensor error, widened by what the ellipse does not know further out."""
    signed, normals, w = normal_residuals(near.points, parameters)
    variances = tolerant_variances(normals, near.covariances)
    scatter = 1.4826 * float(np.median(np.abs(signed / np.sqrt(variances))[inside]))
    limit = settings.sensor_error_sigmas * min(max(scatter, 1.0), near.largest_misfit)
    rows = parameter_rows(normals, w)
    extrapolated = settings.correlation * ((unsure @ rows) * rows).sum(axis=0)
    extrapolated = np.minimum(extrapolated, settings.largest_extrapolation * variances)
    close = signed * signed < limit * limit * (variances + extrapolated)
    lit: BoolArray = close & (normals[:, 1] > FARTHEST_NORMAL)
    return lit


def _run_around(good: BoolArray, middle: int, settings: IdentificationSettings) -> tuple[int, int]:
    """Half-open run around `middle`, over interruptions that good points follow."""
    members = np.flatnonzero(good)
    if len(members) == 0:
        return middle, middle
    cuts = np.flatnonzero(np.diff(members) > settings.ending_points) + 1
    firsts = members[np.concatenate([[0], cuts])]
    stops = members[np.concatenate([cuts - 1, [-1]])] + 1
    away = np.maximum(np.maximum(firsts - middle, middle + 1 - stops), 0)
    first = last = int(np.argmin(away))
    bridge = settings.bridge_fraction * float(stops[first] - firsts[first])
    lengths = stops - firsts
    while first > 0:
        gap = firsts[first] - stops[first - 1]
        if gap > bridge or lengths[first - 1] <= max(gap, 5):
            break
        first -= 1
    while last + 1 < len(firsts):
        gap = firsts[last + 1] - stops[last]
        if gap > bridge or lengths[last + 1] <= max(gap, 5):
            break
        last += 1
    return int(firsts[first]), int(stops[last])
