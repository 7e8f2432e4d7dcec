"""Accuracy before measuring: of one section, and of a scan."""

import math
from dataclasses import replace

import numpy as np

from lsvision.errors import TooFewPoints
from lsvision.geometry import Cylinder, FloatArray, IntArray, Points, Pose
from lsvision.planning.scan_bound import Feed, ScanPrediction, scan_bound
from lsvision.planning.section_bound import SectionPrediction, section_bound
from lsvision.planning.sensor_view import SensorView, cylinder_normals, visible_points


def plan_section(
    radius: float,
    theta: float,
    phi: float,
    *,
    view: SensorView | None = None,
    known_radius_std: float | None = None,
) -> SectionPrediction:
    """One-sigma errors to expect of a pipe from one section.

    The steep flanks say most, so where the outermost point falls within a pitch moves the
    numbers: by up to 17 % for the default view, 29 % at a pitch of 0.6 mm (largest over smallest).

    Parameters
    ----------
    radius : float
        Units: mm.
    theta, phi : float
        Direction of the major axis, and angle between the pipe and the laser plane's normal.
        Units: rad.
    view : SensorView, optional
        Sensor, standoff, pitch; None = ``SensorView()``, an LPS 36 HI at 400 mm.
    known_radius_std : float, optional
        One sigma of a radius known beforehand; 0 = exactly. Units: mm.

    Returns
    -------
    SectionPrediction
        One sigma of radius, theta, phi and centre.

    Raises
    ------
    TooFewPoints
        If the sensor sees fewer than five points of the pipe.
    DegenerateGeometry
        If the arc seen leaves the ellipse undetermined.
    ValueError
        If radius or phi is out of range.

    Examples
    --------
    >>> sigma = plan_section(19.0, math.radians(20), math.radians(20))
    >>> f"radius {sigma.radius_std:.2f} mm, phi {math.degrees(sigma.phi_std):.1f} deg"
    'radius 0.39 mm, phi 1.9 deg'
    """
    view = SensorView() if view is None else view
    pipe = _pipe(radius, theta, phi, view)
    points = visible_points(pipe, view)
    _require_points(len(points))
    covariances = view.sensor.covariances(points)
    return section_bound(pipe.section(), points, covariances, known_radius_std)


def plan_scan(
    radius: float,
    theta: float,
    phi: float,
    *,
    view: SensorView | None = None,
    feed: Feed | None = None,
    known_radius_std: float | None = None,
) -> ScanPrediction:
    """One-sigma errors to expect of a pipe from a joint fit to several parallel sections.

    The middle of the scan has the pipe where `view` says; a tilted pipe wanders through the
    view from there, and sections that lose it give what they see.

    Parameters
    ----------
    radius, theta, phi, view, known_radius_std
        As in `plan_section`.
    feed : Feed, optional
        Number of sections, spacing, direction, uncertainty of the poses; None = ``Feed()``,
        20 sections 1 mm apart along the laser plane's normal.

    Returns
    -------
    ScanPrediction
        One sigma of radius, direction, theta, phi, and of the position amid the scan.

    Raises
    ------
    TooFewPoints
        If the sensor sees fewer than five points in all sections together.
    DegenerateGeometry
        If what is seen leaves the cylinder undetermined.
    ValueError
        If radius or phi is out of range.

    Examples
    --------
    >>> sigma = plan_scan(19.0, math.radians(20), math.radians(20), feed=Feed(sections=20))
    >>> f"radius {sigma.radius_std:.3f} mm, phi {math.degrees(sigma.phi_std):.3f} deg"
    'radius 0.008 mm, phi 0.025 deg'
    """
    view = SensorView() if view is None else view
    feed = Feed() if feed is None else feed
    pipe = _pipe(radius, theta, phi, view)
    sections = [_see_section(pipe, view, shift) for shift in feed.shifts]
    points = np.concatenate([points for points, _ in sections])
    _require_points(len(points))
    variances = np.concatenate([variances for _, variances in sections])
    owners = np.repeat(np.arange(feed.sections), [len(points) for points, _ in sections])
    prediction = scan_bound(
        pipe,
        points,
        variances,
        known_radius_std=known_radius_std,
        shared_errors=_pose_errors(cylinder_normals(pipe, points), owners, feed),
    )
    return replace(prediction, sections=feed.sections, length=feed.length)


def _pipe(radius: float, theta: float, phi: float, view: SensorView) -> Cylinder:
    """The pipe in the section frame, its axis through the view's centre."""
    if not 0 <= phi < math.pi / 2:
        raise ValueError(f"want phi in [0, pi/2) rad, got {phi}")
    if not math.isfinite(theta):
        raise ValueError(f"want a finite theta in rad, got {theta}")
    sin_phi = math.sin(phi)
    direction = np.array([sin_phi * math.cos(theta), sin_phi * math.sin(theta), math.cos(phi)])
    return Cylinder(np.array([view.offset, -view.standoff, 0.0]), direction, radius)


def _see_section(pipe: Cylinder, view: SensorView, shift: FloatArray) -> tuple[Points, FloatArray]:
    """Points (n, 3) in the frame of the scan's middle, and their variances along the normal."""
    scan_from_section = Pose(translation=shift)
    seen_pipe = pipe.transformed(scan_from_section.inverse())
    points = visible_points(seen_pipe, view)
    normals = cylinder_normals(seen_pipe, points)[:, :2]
    variances = np.einsum("ni,nij,nj->n", normals, view.sensor.covariances(points), normals)
    return scan_from_section.apply(points), variances


def _pose_errors(normals: FloatArray, owners: IntArray, feed: Feed) -> FloatArray | None:
    """Change of each point's distance by one sigma of each error of the poses."""
    columns = []
    if feed.pose_std > 0:
        mine = owners[:, None] == np.arange(feed.sections)
        columns += [feed.pose_std * normals[:, [axis]] * mine for axis in range(3)]
    if feed.feed_std > 0:
        steps = feed.shifts @ feed.unit
        across = np.linalg.svd(feed.unit[None])[2][1:]
        columns.append(feed.feed_std * steps[owners][:, None] * (normals @ across.T))
    return np.column_stack(columns) if columns else None


def _require_points(got: int) -> None:
    if got < 5:
        hint = "check standoff and offset against the sensor's range and width, or refine the pitch"
        raise TooFewPoints("the view of the pipe", got, 5, hint)
