"""The points of all sections that lie on a cylinder, also where detection missed its arc."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.problem import (
    axis_distances,
    distance_stds_and_biases,
    parameters_from_cylinder,
    tangent_frame,
)
from lsvision.geometry import BoolArray, Cylinder, FloatArray, IntArray
from lsvision.scan.cloud import ScanCloud


@dataclass(frozen=True, kw_only=True, slots=True)
class PointAssignmentSettings:
    """Which points count as a cylinder's.

    Parameters
    ----------
    sigmas : float
        Largest distance from the surface, in standard deviations.
    max_outlier_run : int
        So many points in a row that are off do not end an arc.
    min_points : int
        Points of an arc.
    min_inlier_fraction : float
        Least share of the points of an arc's span that lie on it.
    min_incidence_cosine : float
        Least component of the normal towards the sensor; below 0 because rays fan out.
    end_sigmas : float
        The last points of the arcs go, and those before them, while their mean over all
        sections is so many of its standard deviations off: what touches the tube there, a
        weld or a plate, leaves its surface gently.
    max_trimmed_points : int
        Points at either end of an arc.
    """

    sigmas: float = 3.5
    max_outlier_run: int = 3
    min_points: int = 8
    min_inlier_fraction: float = 0.6
    min_incidence_cosine: float = -0.35
    end_sigmas: float = 2.5
    max_trimmed_points: int = 5


@dataclass(frozen=True, eq=False, slots=True)
class SectionShifts:
    """A tube whose sections lie beside a straight axis.

    Parameters
    ----------
    cylinder : Cylinder
        The straight axis, with the radius that all sections share.
    sections : (k,) int ndarray
        Indices of the profiles, rising.
    shifts : (k, 2) ndarray
        Of each section's centre along e_phi and e_theta of the axis. Units: mm.
    reduced_chi2 : float
        Chi^2 of the shifts over its degrees of freedom; about 1 for a straight pipe.
    normalised : (n,) ndarray
        Distances of the points from the sections so shifted, in standard deviations.
    """

    cylinder: Cylinder
    sections: IntArray
    shifts: FloatArray
    reduced_chi2: float
    normalised: FloatArray

    @property
    def noise_factor(self) -> float:
        """By how much the points scatter more than the noise model says; 1 or more."""
        return max(1.0, 1.4826 * float(np.median(np.abs(self.normalised))))

    @property
    def normalised_rms(self) -> float:
        """Rms of `normalised`."""
        return float(np.sqrt(np.mean(self.normalised**2)))

    def interpolated(self, section_count: int) -> FloatArray:
        """(section_count, 2) shift of every section, those between interpolated. Units: mm."""
        every = np.arange(section_count)
        columns = [np.interp(every, self.sections, column) for column in self.shifts.T]
        return np.column_stack(columns)


def fit_section_shifts(
    cloud: ScanCloud, cylinder: Cylinder, rows: IntArray, *, free_radius: bool
) -> SectionShifts:
    """Lateral shift of each section that fits its points best.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    cylinder : Cylinder
        Base frame.
    rows : (n,) int ndarray
        Rows of the cloud that are its points.
    free_radius : bool
        Fit the common radius too: that of a straight fit to a bent tube is wrong.
    """
    across, stds, offsets, _ = _point_distances(cloud, cylinder, rows)
    sections, place = np.unique(cloud.point_sections[rows], return_inverse=True)
    shifts, radius = np.zeros((len(sections), 2)), cylinder.radius
    # A short arc leaves the shift along it open; a pipe does not stray by its own radius.
    prior = np.eye(2) / (SHIFT_PRIOR_STD_RADII * radius) ** 2
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        from_centre = across - shifts[place].T
        distances = np.hypot(*from_centre)
        design = (from_centre / distances / stds).T
        misfit = (distances - radius - offsets) / stds
        covariances = np.linalg.inv(_summed(place, design[:, :, None] * design[:, None, :]) + prior)
        pull = _summed(place, design * misfit[:, None])
        step = np.einsum("kij,kj->ki", covariances, pull)
        if free_radius:
            # Schur complement of the shifts: what the radius is known by once they are free.
            with_radius = _summed(place, design / stds[:, None])
            carried = np.einsum("kij,kj->ki", covariances, with_radius)
            known = float((stds**-2.0).sum() - (with_radius * carried).sum())
            growth = (float((misfit / stds).sum()) - float((carried * pull).sum())) / known
            step -= carried * growth
            radius += growth
        shifts = shifts + step
    rest = (np.hypot(*(across - shifts[place].T)) - radius - offsets) / stds
    surprise = float(np.einsum("ki,kij,kj", shifts, np.linalg.inv(covariances), shifts))
    straight = Cylinder(cylinder.point, cylinder.direction, radius)
    return SectionShifts(straight, sections, shifts, surprise / shifts.size, rest)


GAUSS_NEWTON_ITERATIONS = 5
"""Gauss-Newton steps for the shifts; the first is enough for a straight pipe."""
SHIFT_PRIOR_STD_RADII = 0.5
"""Prior standard deviation of a section's shift. Units: radii."""


def _summed(place: IntArray, values: FloatArray) -> FloatArray:
    """Sum of the rows of each section."""
    total = np.zeros((int(place.max()) + 1, *values.shape[1:]))
    np.add.at(total, place, values)
    return total


def assign_points(
    cloud: ScanCloud,
    cylinder: Cylinder,
    shifts: FloatArray,
    noise_factor: float,
    settings: PointAssignmentSettings = PointAssignmentSettings(),
) -> IntArray:
    """Rows of the cloud that lie on a cylinder, arc by arc.

    Parameters
    ----------
    cloud : ScanCloud
        All points.
    cylinder : Cylinder
        Base frame.
    shifts : (sections, 2) ndarray
        Lateral shift of each section, along e_phi and e_theta. Units: mm.
    noise_factor : float
        By how much the noise is larger than the model says.
    settings : PointAssignmentSettings
        Limits.

    Returns
    -------
    (m,) int ndarray
        Rising.
    """
    reach = 0.2 * cylinder.radius + 3 * float(np.abs(shifts).max(initial=0.0))
    close = np.flatnonzero(np.abs(cylinder.signed_distances(cloud.points)) < reach)
    if len(close) == 0:
        return close
    across, stds, offsets, facing = _point_distances(cloud, cylinder, close)
    owners = cloud.point_sections[close]
    z = (np.hypot(*(across - shifts[owners].T)) - cylinder.radius - offsets) / stds
    on = (np.abs(z) < settings.sigmas * noise_factor) & (facing > settings.min_incidence_cosine)
    arcs = _arcs(close, owners, on, settings)
    if not arcs:
        return close[:0]
    before, after = (
        _trim_count(arcs, z, settings),
        _trim_count([a[::-1] for a in arcs], z, settings),
    )
    kept = [arc[before : len(arc) - after] for arc in arcs]
    return close[np.concatenate(kept)]


def _point_distances(
    cloud: ScanCloud, cylinder: Cylinder, rows: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points across the axis, deviations and offsets of their distances, and how they face."""
    frame = tangent_frame(cylinder.direction)
    points, parameters = cloud.points[rows] @ frame.T, parameters_from_cylinder(frame, cylinder)
    covariances = frame @ cloud.covariances[rows] @ frame.T
    stds, offsets, _ = distance_stds_and_biases(points, covariances, parameters)
    across = (points[:, :2] - parameters[:2]).T
    _, normals, _ = axis_distances(points, parameters)
    facing: FloatArray = (normals.T @ frame * cloud.towards_sensor[cloud.point_sections[rows]]).sum(
        axis=1
    )
    return across, stds, offsets, facing


def _arcs(
    rows: IntArray, owners: IntArray, on: BoolArray, settings: PointAssignmentSettings
) -> list[IntArray]:
    """Places of the points that lie on the surface in an arc with others, arc by arc."""
    mine = np.flatnonzero(on)
    if len(mine) == 0:
        return []
    # Rows count the points of a profile in order, those far off included.
    gap = np.diff(rows[mine])
    breaks = np.flatnonzero((gap > settings.max_outlier_run + 1) | (np.diff(owners[mine]) > 0)) + 1
    return [
        run
        for run in np.split(mine, breaks)
        if len(run) >= settings.min_points
        and len(run) >= settings.min_inlier_fraction * (rows[run[-1]] - rows[run[0]] + 1)
    ]


def _trim_count(arcs: list[IntArray], z: FloatArray, settings: PointAssignmentSettings) -> int:
    """How many first points of every arc do not lie on the surface, taken over all arcs."""
    most = min(settings.max_trimmed_points, min(map(len, arcs)) // 2)
    for place in range(most):
        at_place = z[[arc[place] for arc in arcs]]
        if abs(at_place.sum()) < settings.end_sigmas * math.sqrt(len(arcs)):
            return place
    return most
