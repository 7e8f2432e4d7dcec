"""The paper's chain as literally as its text allows, for comparison; never the better choice.

What the text leaves open is settled so: the sensor error is one number (0.9 mm, the resolution
of section 4); a window whose fit fails has no arc; "the first few points" of an arc are 10 % of
it. Arcs of one pipe that the flow chart opens and closes again and again stay several.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.detection.arcs import Rejection
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.homogenising import homogenise_profile_paper
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import smooth_profile_paper
from lsvision.errors import LsvisionError
from lsvision.geometry import Ellipse, IntArray, Points, radial_residuals
from lsvision.profile import Arc, PreparedProfile

RADIAL_FITTING = FittingSettings(residual="radial")


@dataclass(frozen=True, kw_only=True, slots=True)
class PaperSettings:
    """Numbers of the paper.

    Parameters
    ----------
    sensor_error_mm : float
        Section 4: resolution of the LPS 36 HI. Units: mm.
    window_fraction : float
        Section 3.2.1: num is about 10 percent of n.
    end_part_fraction : float
        Share of an arc that is its start part, and its end part; the paper: "a few points".
    smoothing_fraction : float
        Section 3.3.1: 30 % of the arc's points.
    step_mm : float
        Section 3.3.2. Units: mm.
    """

    sensor_error_mm: float = 0.9
    window_fraction: float = 0.1
    end_part_fraction: float = 0.1
    smoothing_fraction: float = 0.3
    step_mm: float = 0.5


def measure_paper_pipeline(
    profile: PreparedProfile, radius_range: tuple[float, float], settings: PaperSettings
) -> tuple[tuple[CylinderSection, ...], tuple[Rejection, ...]]:
    """Rough identification, screening, smoothing, homogenising, fit: sections 3.2 to 2.3.

    Parameters
    ----------
    profile : PreparedProfile
        Its noise model is not used: the paper has none.
    radius_range : tuple of float
        The paper starts its fits from the cylinder's radius; here from the middle of the
        range, at most 40 mm. Units: mm.
    settings : PaperSettings
        Numbers of the paper.

    Returns
    -------
    cylinders, rejections : tuple
        Huge ellipses on planes are among the cylinders: the paper has no gate against them.
    """
    points = profile.points[profile.valid_indices]
    radius = min(math.sqrt(radius_range[0] * radius_range[1]), 40.0)
    cylinders: list[CylinderSection] = []
    rejections: list[Rejection] = []
    for start, stop in _identify_spans(points, radius, settings):
        indices = profile.valid_indices[start:stop]
        arc = Arc(int(indices.min()), int(indices.max()) + 1)
        try:
            screened = _screen(points[start:stop], indices, radius, settings)
            smooth = smooth_profile_paper(profile.points[screened], settings.smoothing_fraction)
            even = homogenise_profile_paper(smooth, settings.step_mm)
            fit = fit_ellipse(even, initial_ellipse(even, radius), settings=RADIAL_FITTING)
        except LsvisionError as failure:
            rejections.append(Rejection(arc, str(failure)))
            continue
        cylinders.append(CylinderSection(fit, arc, screened))
    ordered = sorted(cylinders, key=lambda cylinder: cylinder.centre[0])
    return tuple(ordered), tuple(rejections)


def initial_ellipse(points: Points, radius: float) -> Ellipse:
    """The paper's initial values (section 2.3): a circle under the highest point.

    Parameters
    ----------
    points : (n, 2) ndarray
        Units: mm.
    radius : float
        Of the cylinder. Units: mm.
    """
    top = points[np.argmax(points[:, 1])]
    return Ellipse((float(top[0]), float(top[1]) - radius), radius, radius, 0.0)


def _identify_spans(
    points: Points, radius: float, settings: PaperSettings
) -> list[tuple[int, int]]:
    """Spans of the flow chart, Figure 6: a window opens an arc when all its r_j are small."""
    count = len(points)
    num = max(6, round(settings.window_fraction * count))
    spans: list[tuple[int, int]] = []
    start = None
    for i in range(count - num + 1):
        on_ellipse = _all_within(points[i : i + num], radius, settings.sensor_error_mm)
        if on_ellipse and start is None:
            start = i
        if not on_ellipse and start is not None:
            spans.append((start, i + num - 1))
            start = None
    if start is not None:
        spans.append((start, count))
    return spans


def _all_within(window: Points, radius: float, sensor_error_mm: float) -> bool:
    try:
        fit = fit_ellipse(window, initial_ellipse(window, radius), settings=RADIAL_FITTING)
    except LsvisionError:
        return False
    return bool(np.abs(fit.residuals).max() < sensor_error_mm)


def _screen(points: Points, indices: IntArray, radius: float, settings: PaperSettings) -> IntArray:
    """Figure 9: points of the start and end part beyond the sensor error are discarded."""
    part = max(1, round(settings.end_part_fraction * len(points)))
    middle = points[part : len(points) - part]
    ellipse = fit_ellipse(middle, initial_ellipse(middle, radius), settings=RADIAL_FITTING).ellipse
    kept = np.abs(radial_residuals(points, ellipse)) < settings.sensor_error_mm
    kept[part : len(points) - part] = True
    return indices[kept]
