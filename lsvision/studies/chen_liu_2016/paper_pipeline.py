"""The paper's own pipeline, as close to its text as possible: a reference for `measure_cylinders`.

Choices that the text leaves open: the sensor error is one number (0.9 mm, the resolution of
section 4); a window without a fit has no arc; "the first few points" of an arc are 10 % of it.
The flow chart (Figure 6) can open and close several arcs on one pipe; they are not joined. The
pipeline has no test against planes, so it reports huge ellipses on them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from lsvision.detection.arcs import Rejection
from lsvision.detection.measurement import Measurement, build_measurement
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.radius_range import find_radius_range
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.problem import Priors
from lsvision.ellipse.section import CylinderSection
from lsvision.errors import FitFailed, LsvisionError
from lsvision.geometry import Ellipse, IntArray, Points, radial_residuals
from lsvision.geometry.arguments import as_number_or_pair
from lsvision.profile import Arc, Profile, as_profile

RADIAL_FITTING = FittingSettings(residual="radial")
"""The paper's fit: radial residuals r_j (Eq. 4), all points of equal weight."""
MIN_WINDOW_POINTS = 6
"""One point more than an ellipse has parameters: five points always lie on a conic."""
MAX_INITIAL_RADIUS_MM = 40.0
"""Largest radius of the circle at which a fit starts; limits wide search ranges. Units: mm."""


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """Constants of the paper's pipeline.

    Parameters
    ----------
    sensor_error_mm : float
        Largest radial residual of a point on an ellipse; section 4: resolution of the
        LPS 36 HI. Units: mm.
    window_fraction : float
        Window of rough identification as a fraction of the profile's points; section 3.2.1:
        num is about 10 percent of n.
    end_part_fraction : float
        Fraction of an arc's points in its start part, and in its end part; the paper: "a few
        points".
    smoothing_fraction : float
        Window of smoothing as a fraction of the arc's points; section 3.3.1: 30 %.
    step_mm : float
        Spacing of homogenised points along x; section 3.3.2. Units: mm.

    Raises
    ------
    ValueError
        If a number is not positive and finite, or an end part is half of an arc or more.
    """

    sensor_error_mm: float = 0.9
    window_fraction: float = 0.1
    end_part_fraction: float = 0.1
    smoothing_fraction: float = 0.3
    step_mm: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < math.inf:
                raise ValueError(f"expected a positive {field.name}, got {value}")
        if not self.end_part_fraction < 0.5:
            raise ValueError(f"expected end_part_fraction < 0.5, got {self.end_part_fraction}")

    def count_window_points(self, count: int) -> int:
        """Return the number of points in a window of rough identification, of `count` points."""
        return max(MIN_WINDOW_POINTS, round(self.window_fraction * count))

    def count_end_points(self, count: int) -> int:
        """Return the number of points in each end part of an arc of `count` >= 3 points.

        At least one point is left in the middle.
        """
        return min(max(1, round(self.end_part_fraction * count)), (count - 1) // 2)


def measure_cylinders_paper(
    profile: Profile | npt.ArrayLike,
    *,
    radius: float | Sequence[float] | None = None,
    known_radius: float | Sequence[float] | None = None,
    settings: PaperSettings = PaperSettings(),
) -> Measurement:
    """Measure the cylinders of a profile by the paper's pipeline, sections 3.2, 3.3 and 2.3.

    Parameters
    ----------
    profile : Profile, (n, 2) array_like or data frame
        Points of one light section, as `measure_cylinders` takes them. Its noise
        model is not used: the paper has none.
    radius : float or (float, float), optional
        Search range (min, max), or a nominal radius with a range of 20 % around it. The fits
        start at the geometric mean of the range, at most 40 mm. Units: mm.
    known_radius : float or (float, float), optional
        Radius, or (radius, std): sets the search range where `radius` gives none. The pipeline
        has no priors. Units: mm.
    settings : PaperSettings
        Constants of the paper.

    Returns
    -------
    Measurement
        Cylinders from left to right; huge ellipses on planes are among them.

    Raises
    ------
    ValueError
        If a radius is not positive or its range is reversed.
    """
    profile = as_profile(profile)
    prepared = prepare_profile(profile, profile.noise)
    search = as_number_or_pair(radius, "radius", "mm", "(min, max)")
    low, high = find_radius_range(search, Priors.from_values(known_radius, None).radius, prepared)
    initial_radius = min(math.sqrt(low * high), MAX_INITIAL_RADIUS_MM)
    valid_indices = prepared.valid_indices
    points = prepared.points[valid_indices]
    if len(points) and points[0, 0] > points[-1, 0]:  # y(x) and S(x) need increasing x
        valid_indices, points = valid_indices[::-1], points[::-1]
    cylinders: list[CylinderSection] = []
    rejections: list[Rejection] = []
    spans = _identify_spans(points, initial_radius, settings)
    if len(points) and not spans:
        reason = (
            f"no {settings.count_window_points(len(points))} neighbouring points of {len(points)} "
            f"lie within {settings.sensor_error_mm:g} mm of an ellipse"
        )
        everything = Arc(int(valid_indices.min()), int(valid_indices.max()) + 1)
        rejections.append(Rejection(everything, reason))
    for start, stop in spans:
        indices = valid_indices[start:stop]
        arc = Arc(int(indices.min()), int(indices.max()) + 1)
        try:
            screened = _screen(points[start:stop], indices, initial_radius, settings)
            fit = _fit_arc(prepared.points[screened], initial_radius, settings)
        except LsvisionError as failure:
            rejections.append(Rejection(arc, str(failure)))
        else:
            cylinders.append(CylinderSection(fit, arc, np.sort(screened)))
    return build_measurement(cylinders, rejections, prepared, profile)


def _guess_initial_ellipse(points: Points, radius: float) -> Ellipse:
    """Return the initial guess of the paper (section 2.3): a circle below the highest point."""
    top = points[np.argmax(points[:, 1])]
    return Ellipse((float(top[0]), float(top[1]) - radius), radius, radius, 0.0)


def largest_window_residual(window: Points, radius: float) -> float:
    """Return the largest abs(r_j) of a window's ellipse in mm; inf if no ellipse fits.

    The window has consecutive points of a profile; the fit starts at a circle of the radius, in mm.
    """
    try:
        fit = fit_ellipse(window, _guess_initial_ellipse(window, radius), settings=RADIAL_FITTING)
    except LsvisionError:
        return math.inf
    return float(np.abs(fit.residuals).max())


def smooth_profile_paper(points: Points, window_fraction: float = 0.3) -> Points:
    """Return an arc with y(x) smoothed by local quadratics (section 3.3.1); (n, 2) in mm.

    The points are ordered by x; the window is a fraction of them. In one of one or two different x,
    such as a vertical flank, it is a mean or a line. Biased: the radius of an ellipse fitted to the
    result is too large, also without noise: for a pipe of 19 mm by 0.4 to 0.8 mm at phi = 10 deg,
    by 0.8 to 1.2 mm at 30 deg.

    Raises
    ------
    FitFailed
        If all points have the same x.
    """
    if not np.ptp(points[:, 0]) > 0:
        raise FitFailed("the arc has no width in x: y(x) cannot be smoothed; leave it out")
    count = len(points)
    window = min(count, max(3, round(window_fraction * count)))
    smooth = points.copy()
    for i in range(count):
        first = min(max(0, i - window // 2), count - window)
        x, y = points[first : first + window].T
        degree = min(2, len(np.unique(x)) - 1)
        smooth[i, 1] = np.polynomial.Polynomial.fit(x, y, degree)(points[i, 0])
    return smooth


def homogenise_profile_paper(points: Points, step_mm: float = 0.5) -> Points:
    """Return a smoothed arc at equal steps of x, by the spline y = S(x) (section 3.3.2), in mm.

    Points whose x does not increase are left out, since S(x) needs increasing x.

    Raises
    ------
    FitFailed
        If x increases nowhere.
    """
    from scipy.interpolate import CubicSpline

    increasing = points[
        np.concatenate([[True], points[1:, 0] > np.maximum.accumulate(points[:-1, 0])])
    ]
    if len(increasing) < 2:
        raise FitFailed("x increases nowhere on the arc: S(x) does not exist; leave it out")
    x = np.arange(increasing[0, 0], increasing[-1, 0], step_mm)
    return np.column_stack([x, CubicSpline(increasing[:, 0], increasing[:, 1])(x)])


def _identify_spans(
    points: Points, radius: float, settings: PaperSettings
) -> list[tuple[int, int]]:
    """Return (start, stop) of each span of Figure 6: consecutive windows with small r_j only."""
    count = len(points)
    num = settings.count_window_points(count)
    spans: list[tuple[int, int]] = []
    start = None
    for i in range(count - num + 1):
        residual = largest_window_residual(points[i : i + num], radius)
        on_ellipse = residual < settings.sensor_error_mm
        if on_ellipse and start is None:
            start = i
        if not on_ellipse and start is not None:
            spans.append((start, i + num - 1))
            start = None
    if start is not None:
        spans.append((start, count))
    return spans


def _screen(points: Points, indices: IntArray, radius: float, settings: PaperSettings) -> IntArray:
    """Return the indices after screening (Figure 9): without end points beyond the sensor error."""
    end_points = settings.count_end_points(len(points))
    middle = points[end_points : len(points) - end_points]
    ellipse = fit_ellipse(
        middle, _guess_initial_ellipse(middle, radius), settings=RADIAL_FITTING
    ).ellipse
    inliers = np.abs(radial_residuals(points, ellipse)) < settings.sensor_error_mm
    inliers[end_points : len(points) - end_points] = True
    return indices[inliers]


def _fit_arc(points: Points, radius: float, settings: PaperSettings) -> EllipseFit:
    """Return the ellipse of screened points, smoothed and homogenised (sections 3.3 and 2.3)."""
    smooth = smooth_profile_paper(points, settings.smoothing_fraction)
    homogenised = homogenise_profile_paper(smooth, settings.step_mm)
    return fit_ellipse(
        homogenised, _guess_initial_ellipse(homogenised, radius), settings=RADIAL_FITTING
    )
