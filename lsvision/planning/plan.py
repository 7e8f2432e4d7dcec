"""Plan a measurement: uncertainty of a section or a scan, and the number of sections needed."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import Cylinder, FloatArray, IntArray, Points, Pose, build_tangent_frame
from lsvision.planning.bounds import scan_bound, section_bound
from lsvision.planning.predictions import ScanPrediction, SectionPrediction
from lsvision.planning.sensor_view import Feed, SensorView, cylinder_normals, find_visible_points

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MAX_SECTIONS = 2048
"""Largest number of sections in a proposal of `sections_needed`."""


def plan_section(
    radius: float,
    theta: float,
    phi: float,
    *,
    view: SensorView | None = None,
    known_radius_std: float | None = None,
) -> SectionPrediction:
    """Predict the standard uncertainties of a cylinder measured in one section.

    The steep flanks carry most information, so that the result depends on the position of the
    outermost point within a pitch: for a radius of 19 mm by up to 18 % in the default view, 29 % at
    a pitch of 0.6 mm (largest to smallest); for one of 10 mm by twice as much.

    Parameters
    ----------
    radius : float
        Radius of the cylinder. Units: mm.
    theta, phi : float
        Direction of the major axis, and angle between the cylinder and the laser plane's normal.
        Units: rad.
    view : SensorView, optional
        Sensor, standoff and pitch; None = ``SensorView()``, an LPS 36 HI at 400 mm.
    known_radius_std : float, optional
        Standard deviation of a prior on the radius; 0 = exactly known. Units: mm.

    Returns
    -------
    SectionPrediction
        Standard uncertainties of radius, theta, phi and centre.

    Raises
    ------
    TooFewPoints
        If fewer than five points of the cylinder are visible.
    DegenerateGeometry
        If the visible arc does not determine the ellipse.
    ValueError
        If radius, theta, phi or `known_radius_std` is out of range.

    Examples
    --------
    >>> sigma = plan_section(19.0, math.radians(20), math.radians(20))
    >>> f"radius {sigma.radius_std:.2f} mm, phi {math.degrees(sigma.phi_std):.1f} deg"
    'radius 0.39 mm, phi 1.9 deg'
    """
    view = SensorView() if view is None else view
    cylinder = _place_cylinder_in_view(radius, theta, phi, view)
    points = find_visible_points(cylinder, view)
    _require_points(len(points))
    covariances = view.sensor.covariances(points)
    return section_bound(cylinder.section(), points, covariances, known_radius_std)


def plan_scan(
    radius: float,
    theta: float,
    phi: float,
    *,
    view: SensorView | None = None,
    feed: Feed | None = None,
    known_radius_std: float | None = None,
) -> ScanPrediction:
    """Predict the standard uncertainties of a joint fit to several parallel sections.

    `view` gives the position of the cylinder in the middle of the scan. A tilted cylinder moves
    through the field of view along the scan; sections contribute the points that are visible in
    them.

    Parameters
    ----------
    radius, theta, phi, view
        As in `plan_section`.
    feed : Feed, optional
        Number of sections, spacing, direction and uncertainty of the poses; None = ``Feed()``,
        20 sections 1 mm apart along the laser plane's normal.
    known_radius_std : float, optional
        As in `plan_section`.

    Returns
    -------
    ScanPrediction
        Standard uncertainties of radius, direction, theta, phi, and of the position in the
        middle of the scan.

    Raises
    ------
    TooFewPoints
        If fewer than five points are visible in all sections together.
    DegenerateGeometry
        If the visible points do not determine the cylinder, such as those of one section at
        phi = 0.
    ValueError
        As in `plan_section`.

    Examples
    --------
    >>> sigma = plan_scan(19.0, math.radians(20), math.radians(20), feed=Feed(sections=20))
    >>> f"radius {sigma.radius_std:.3f} mm, phi {math.degrees(sigma.phi_std):.3f} deg"
    'radius 0.008 mm, phi 0.025 deg'
    """
    view = SensorView() if view is None else view
    feed = Feed() if feed is None else feed
    cylinder = _place_cylinder_in_view(radius, theta, phi, view)
    sections = [_find_visible_section(cylinder, view, shift) for shift in feed.shifts]
    points = np.concatenate([points for points, _ in sections])
    _require_points(len(points))
    variances = np.concatenate([variances for _, variances in sections])
    point_sections = np.repeat(np.arange(feed.sections), [len(points) for points, _ in sections])
    prediction = scan_bound(
        cylinder,
        points,
        variances,
        known_radius_std=known_radius_std,
        shared_errors=_pose_error_jacobian(
            cylinder_normals(cylinder, points), point_sections, feed
        ),
    )
    return replace(prediction, sections=feed.sections, length=feed.length)


def _place_cylinder_in_view(radius: float, theta: float, phi: float, view: SensorView) -> Cylinder:
    """Return the cylinder in the section frame, its axis through the centre of the view."""
    if not 0 <= phi < math.pi / 2:
        raise ValueError(
            f"expected phi from 0 to below pi/2 rad (90 deg), got {phi:.6g} rad "
            f"({math.degrees(phi):.6g} deg)"
        )
    if not math.isfinite(theta):
        raise ValueError(f"expected a finite theta in rad, got {theta}")
    sin_phi = math.sin(phi)
    direction = np.array([sin_phi * math.cos(theta), sin_phi * math.sin(theta), math.cos(phi)])
    return Cylinder(np.array([view.offset, -view.standoff, 0.0]), direction, radius)


def _find_visible_section(
    cylinder: Cylinder, view: SensorView, shift: FloatArray
) -> tuple[Points, FloatArray]:
    """Return visible points (n, 3), scan frame, and their variances along the surface normal."""
    scan_from_section = Pose(translation=shift)
    cylinder_in_section = cylinder.transformed(scan_from_section.inverse())
    points = find_visible_points(cylinder_in_section, view)
    normals = cylinder_normals(cylinder_in_section, points)[:, :2]
    variances = np.einsum("ni,nij,nj->n", normals, view.sensor.covariances(points), normals)
    return scan_from_section.apply(points), variances


def _pose_error_jacobian(
    normals: FloatArray, point_sections: IntArray, feed: Feed
) -> "csr_array[np.float64] | None":
    """Return the errors of the poses as `shared_errors` (n, k) of `scan_bound`; None if all are 0.

    k is 3 for the position of each section, and 2 for the direction of the feed.
    """
    if feed.pose_std == feed.feed_std == 0:
        return None
    from scipy.sparse import csr_array, hstack

    count = len(normals)
    row_starts, columns = np.arange(0, 3 * count + 1, 3), 3 * point_sections[:, None] + np.arange(3)
    by_position = csr_array(
        ((feed.pose_std * normals).ravel(), columns.ravel(), row_starts),
        shape=(count, 3 * feed.sections),
    )
    positions, lateral = feed.shifts @ feed.unit, build_tangent_frame(feed.unit)[:2]
    by_direction = feed.feed_std * positions[point_sections][:, None] * (normals @ lateral.T)
    return hstack([by_position, csr_array(by_direction)], format="csr")


def _require_points(count: int) -> None:
    """Raise TooFewPoints for fewer visible points than an ellipse has parameters."""
    if count < 5:
        hint = "check standoff and offset against the sensor's range and width, or refine the pitch"
        raise TooFewPoints("the view of the pipe", count, 5, hint)


@dataclass(frozen=True, kw_only=True)
class AccuracyTarget:
    """Largest acceptable standard uncertainties; those not given are unlimited.

    Parameters
    ----------
    radius_std : float
        Limit for the radius. Units: mm.
    theta_std, phi_std, direction_std : float
        Limits for the angles. Units: rad.

    Raises
    ------
    ValueError
        If no limit is given, or one is not positive.
    """

    radius_std: float = math.inf
    theta_std: float = math.inf
    phi_std: float = math.inf
    direction_std: float = math.inf

    def __post_init__(self) -> None:
        values = (self.radius_std, self.theta_std, self.phi_std, self.direction_std)
        if not all(value > 0 for value in values) or min(values) == math.inf:
            raise ValueError(f"expected at least one target, all of them positive, got {self}")

    def is_met_by(self, prediction: ScanPrediction) -> bool:
        """Return whether every standard uncertainty is within its limit."""
        return (
            prediction.radius_std <= self.radius_std
            and prediction.theta_std <= self.theta_std
            and prediction.phi_std <= self.phi_std
            and prediction.direction_std <= self.direction_std
        )


def sections_needed(  # noqa: PLR0913 - the parameters of `plan_scan`, and the target
    radius: float,
    theta: float,
    phi: float,
    *,
    target: AccuracyTarget,
    view: SensorView | None = None,
    feed: Feed | None = None,
    known_radius_std: float | None = None,
) -> ScanPrediction:
    """Return the shortest scan, with the spacing of the feed, that reaches a target accuracy.

    The uncertainties need not decrease with the number of sections: they fluctuate with the
    positions of the points within a pitch, and an error of the feed direction may make them grow.
    Numbers are tried in steps of a half and then bisected: a scan may be missed that is shorter, or
    that alone reaches the target by 2 % or less.

    Parameters
    ----------
    radius, theta, phi
        As in `plan_section`.
    target : AccuracyTarget
        Largest acceptable standard uncertainties.
    view : SensorView, optional
        As in `plan_section`.
    feed : Feed, optional
        As in `plan_scan`; its number of sections is not used.
    known_radius_std : float, optional
        As in `plan_section`.

    Returns
    -------
    ScanPrediction
        Prediction for that scan, with its `sections` and `length`.

    Raises
    ------
    DegenerateGeometry
        If no number of sections up to 2048 is found to reach the target, or two do not determine
        the cylinder.
    TooFewPoints
        If fewer than five points are visible in two sections together.
    ValueError
        As in `plan_scan`.

    Examples
    --------
    >>> target = AccuracyTarget(phi_std=math.radians(0.05))
    >>> scan = sections_needed(19.0, math.radians(20), math.radians(20), target=target)
    >>> f"{scan.sections} sections over {scan.length:g} mm"
    '13 sections over 12 mm'
    """
    feed = Feed() if feed is None else feed

    def plan(sections: int) -> ScanPrediction:
        scan = replace(feed, sections=sections)
        return plan_scan(
            radius, theta, phi, view=view, feed=scan, known_radius_std=known_radius_std
        )

    try:
        prediction = plan(1)
    except (DegenerateGeometry, TooFewPoints):  # as of the direction at phi = 0, or few points
        prediction = plan(2)
    insufficient, sufficient = prediction.sections - 1, prediction.sections
    while not target.is_met_by(prediction):
        if sufficient == MAX_SECTIONS:
            raise DegenerateGeometry(_describe_unreachable(prediction))
        # No larger steps, since the uncertainties may have a minimum.
        larger = min(sufficient + (sufficient + 1) // 2, MAX_SECTIONS)
        insufficient, sufficient = sufficient, larger
        prediction = plan(sufficient)
    while sufficient - insufficient > 1:
        middle = (insufficient + sufficient) // 2
        candidate = plan(middle)
        if target.is_met_by(candidate):
            sufficient, prediction = middle, candidate
        else:
            insufficient = middle
    return prediction


def _describe_unreachable(longest: ScanPrediction) -> str:
    """Return the message for a target that the longest scan does not reach."""
    return (
        f"{longest.sections} sections over {longest.length:g} mm reach radius "
        f"{longest.radius_std:.2g} mm, direction {math.degrees(longest.direction_std):.2g} deg, "
        f"phi {math.degrees(longest.phi_std):.2g} deg, theta {math.degrees(longest.theta_std):.2g}"
        " deg and not the target: increase the spacing, or reduce the uncertainty of the poses"
    )
