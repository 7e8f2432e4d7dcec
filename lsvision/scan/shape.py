"""Form deviations of a scanned tube: bow, taper, ovality, and the centre of each section.

The joint fit assumes a straight circular cylinder. Here a deviating tube is fitted to the same
points: its axis is a parabola, its radius changes linearly along the axis, and its cross-section
is r + o1 cos 2 psi + o2 sin 2 psi. Each of the three deviations is tested against zero. psi is
the angle about the axis in space, so that the tilt of the sections needs no correction.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import variance_factor
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, IntArray, Points, tangent_frame
from lsvision.geometry.equality import ComparedByValue
from lsvision.results.quantities import Record, finite, numbers
from lsvision.results.result import Result
from lsvision.scan.scan_result import ScannedCylinder
from lsvision.scan.shape_table import shape_lines

PARAMETERS = 10
"""Point (2) and direction (2) across the axis, radius; bow (2), taper (1), ovality (2)."""
BOW, TAPER, OVALITY = slice(5, 7), slice(7, 8), slice(8, 10)
"""Positions of the deviations among the parameters; the radius is parameter 4."""
MIN_SECTIONS = 3
"""Two centres always lie on a straight line."""
GAUSS_NEWTON_ITERATIONS = 6
"""Gauss-Newton steps for the circle of a section; from 1 mm away four are enough."""
FACETS = 96
"""Facets around a tube's surface; they deviate from the circle by at most r / 1900."""


@dataclass(frozen=True, eq=False, slots=True)
class SectionCentres:
    """Circle fitted to the points of each section, projected along the axis of the tube.

    Parameters
    ----------
    sections : (k,) ndarray of int
        Indices of the profiles.
    along : (k,) ndarray
        Mean position of each section's points along the axis, from ``ScannedCylinder.point``.
        Units: mm.
    deviations : (k, 2) ndarray
        Deviation of the centre of a circle with the tube's mean radius from the straight axis,
        along e_phi and e_theta. Units: mm.
    deviation_covariances : (k, 2, 2) ndarray
        Covariances of `deviations`. Units: mm^2.
    radii : (k,) ndarray
        Radius of each section when fitted together with its centre. Units: mm.
    radii_std : (k,) ndarray
        Standard uncertainty of `radii`, large because one section determines a radius poorly.
        Units: mm.
    """

    sections: IntArray
    along: FloatArray
    deviations: FloatArray
    deviation_covariances: FloatArray
    radii: FloatArray
    radii_std: FloatArray

    @property
    def deviations_std(self) -> FloatArray:
        """(k, 2) standard uncertainty along e_phi and e_theta. Units: mm."""
        return np.sqrt(np.diagonal(self.deviation_covariances, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class FormDeviation(ComparedByValue):
    """One deviation of a tube from a straight circular cylinder.

    Parameters
    ----------
    values : (k,) ndarray
        Components of the deviation. Units: mm.
    covariance : (k, k) ndarray
        Covariance of `values`. Units: mm^2.
    p_value : float
        Probability of a deviation at least as large on a tube without any.
    """

    values: FloatArray
    covariance: FloatArray
    p_value: float

    @property
    def size(self) -> float:
        """Norm of `values`. Units: mm."""
        return float(np.linalg.norm(self.values))

    @property
    def size_std(self) -> float:
        """Standard uncertainty of `size`, along the direction of `values`. Units: mm."""
        unit = self.values / self.size if self.size > 0 else np.eye(len(self.values))[0]
        return math.sqrt(float(unit @ self.covariance @ unit))

    def is_significant(self, level: float = 0.01) -> bool:
        """Return whether the p-value is below a significance level."""
        return self.p_value < level


@dataclass(frozen=True, eq=False, repr=False)
class TubeShape(Result):
    """Form deviations of a tube along its axis.

    Parameters
    ----------
    centres : SectionCentres
        Centre and radius of each section relative to the straight axis.
    bow : FormDeviation
        Deviation from straightness: distance of the axis from its tangent in the middle, at
        both ends of the measured length, along e_phi and e_theta of the fit.
    taper : FormDeviation
        Increase of the radius from the middle to the end of the measured length.
    ovality_terms : FormDeviation
        o1 and o2.
    radius : float
        Mean radius of the deviating tube. Units: mm.
    half_length : float
        Half of the measured length along the axis. Units: mm.
    """

    centres: SectionCentres
    bow: FormDeviation
    taper: FormDeviation
    ovality_terms: FormDeviation
    radius: float
    half_length: float

    @property
    def bow_radius(self) -> float:
        """Radius of curvature of the axis: (half_length^2 + bow^2) / (2 bow). Units: mm."""
        bow = self.bow.size
        return (self.half_length**2 + bow**2) / (2 * bow) if bow > 0 else math.inf

    @property
    def bow_radius_std(self) -> float:
        """Standard uncertainty of `bow_radius`, by linear propagation. Units: mm."""
        return self.bow_radius * self.bow.size_std / self.bow.size if self.bow.size else math.inf

    @property
    def ovality(self) -> float:
        """(Largest - smallest diameter) / mean diameter = 2 |o| / r."""
        return 2 * self.ovality_terms.size / self.radius

    @property
    def ovality_std(self) -> float:
        """Standard uncertainty of `ovality`, which for a round tube is about as large itself."""
        return 2 * self.ovality_terms.size_std / self.radius

    @property
    def taper_slope(self) -> float:
        """Increase of the radius per length along the direction. Units: mm/mm."""
        return float(self.taper.values[0]) / self.half_length

    def to_dict(self) -> Record:
        """Return bow, taper, ovality and the line of centres, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``; the radius of a bow that is none is None.
        """
        centres = self.centres
        return {
            "bow_mm": self.bow.size,
            "bow_std_mm": self.bow.size_std,
            "bow_p_value": self.bow.p_value,
            "bow_radius_mm": finite(self.bow_radius),
            "taper_mm_per_mm": self.taper_slope,
            "taper_p_value": self.taper.p_value,
            "ovality": self.ovality,
            "ovality_std": self.ovality_std,
            "ovality_p_value": self.ovality_terms.p_value,
            "sections": [int(section) for section in centres.sections],
            "along_mm": numbers(centres.along),
            "deviations_mm": [numbers(row) for row in centres.deviations],
            "deviations_std_mm": [numbers(row) for row in centres.deviations_std],
            "radii_mm": numbers(centres.radii),
            "radii_std_mm": numbers(centres.radii_std),
        }

    def _summary(self) -> str:
        return ", ".join(shape_lines(self))

    def _cells(self) -> list[tuple[str, ...]]:
        return []

    def _notes(self) -> list[str]:
        return shape_lines(self)

    def _rows(self) -> list[Record]:
        """A section a row: its centre beside the straight axis, and its radius."""
        record = self.to_dict()
        columns = {
            "section": record["sections"],
            "along_mm": record["along_mm"],
            **{
                f"{name}_{axis}_mm": [row[place] for row in record[f"{name}_mm"]]
                for name in ("deviations", "deviations_std")
                for place, axis in enumerate(("phi", "theta"))
            },
            "radius_mm": record["radii_mm"],
            "radius_std_mm": record["radii_std_mm"],
        }
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def measure_shape(tube: ScannedCylinder) -> TubeShape:
    """Measure bow, taper, ovality and the section centres of a scanned tube.

    Parameters
    ----------
    tube : ScannedCylinder
        Measured in three sections or more.

    Returns
    -------
    TubeShape
        Bow, taper and ovality are estimated together; each test accounts for the other two.

    Raises
    ------
    DegenerateGeometry
        If the tube was measured in fewer than three sections.

    Notes
    -----
    An arc of less than about 90 deg hardly distinguishes an oval from a displaced circle: the
    covariance is large then and the test not significant. The poses are taken as exact; a feed
    that deviates from a straight line shows as the same bow on every tube.

    Examples
    --------
    >>> import lsvision as lsv
    >>> profiles = lsv.read_profiles("fixtures/scan_welded_pair")[::5]
    >>> poses = [lsv.Pose.along((0, 0, 1), 5.0 * k) for k in range(len(profiles))]
    >>> scan = lsv.measure_scan(profiles, poses)
    >>> shape = measure_shape(scan.cylinders[0])
    >>> shape.bow.size < 5 * shape.bow.size_std
    True
    """
    if len(tube.sections) < MIN_SECTIONS:
        raise DegenerateGeometry(
            f"the shape of a tube needs {MIN_SECTIONS} sections of it, got "
            f"{len(tube.sections)}: scan more of it"
        )
    axis_points = _transform_to_axis_frame(tube)
    estimate, information, residuals = _fit_deviations(axis_points)
    noise_known = math.isinf(tube.fit.degrees_of_freedom)
    factor, dof, std_scale = variance_factor(
        residuals, max(len(residuals) - PARAMETERS, 1), known_noise=noise_known
    )
    covariance = factor * std_scale**2 * np.asarray(np.linalg.inv(information), dtype=np.float64)
    bow, taper, ovality = (
        _form_deviation(estimate[part], covariance[part, part], dof)
        for part in (BOW, TAPER, OVALITY)
    )
    # Centres refer to the straight axis of the joint fit; only the radius is the mean radius here.
    points = axis_points.points + np.array([[0.0], [0.0], [sum(tube.axial_range) / 2]])
    stds = axis_points.stds * std_scale * math.sqrt(factor)
    return TubeShape(
        centres=fit_section_centres(tube.point_sections, points, stds, float(estimate[4])),
        bow=bow,
        taper=taper,
        ovality_terms=ovality,
        radius=float(estimate[4]),
        half_length=axis_points.half_length,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _AxisFramePoints:
    """Points along e_phi, e_theta and the axis, from the middle of the measured length."""

    points: FloatArray  # (3, n) mm
    stds: FloatArray  # of the distances from the axis
    offsets: FloatArray  # expected distance - radius
    radius: float
    half_length: float


def _transform_to_axis_frame(tube: ScannedCylinder) -> _AxisFramePoints:
    fit = tube.fit
    middle = fit.point + fit.direction * sum(tube.axial_range) / 2
    points = tangent_frame(fit.direction) @ (tube.points - middle).T
    offsets = fit.residuals - fit.normalised * fit.stds
    half_length = (tube.axial_range[1] - tube.axial_range[0]) / 2
    return _AxisFramePoints(points, fit.stds, offsets, fit.radius, half_length)


def _fit_deviations(axis_points: _AxisFramePoints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parameters, their information matrix and the normalised residuals."""
    from scipy.optimize import leastsq

    initial_guess = np.zeros(PARAMETERS)
    initial_guess[4] = axis_points.radius
    solution, *_ = leastsq(
        lambda x: _residuals(axis_points, x),
        initial_guess,
        xtol=1e-10,
        ftol=1e-12,
        epsfcn=1e-11,
        maxfev=400,
    )
    estimate: FloatArray = solution
    steps = 1e-5 * np.eye(PARAMETERS) * axis_points.radius
    jacobian = np.column_stack(
        [
            (_residuals(axis_points, estimate + step) - _residuals(axis_points, estimate - step))
            / (2 * step.max())
            for step in steps
        ]
    )
    return estimate, jacobian.T @ jacobian, _residuals(axis_points, estimate)


def _residuals(axis_points: _AxisFramePoints, parameters: FloatArray) -> FloatArray:
    """Return the normalised distances from the bent, tapering, oval tube.

    All parameters are displacements at the end of the measured length (t = 1), in mm, so that
    they are of similar magnitude.
    """
    centre, tilt, bow = parameters[:2], parameters[2:4], parameters[BOW]
    t = axis_points.points[2] / axis_points.half_length
    from_axis = axis_points.points[:2] - centre[:, None] - np.outer(tilt, t) - np.outer(bow, t * t)
    slope = (tilt[:, None] + 2 * np.outer(bow, t)) / axis_points.half_length
    # Squared component of from_axis along the tangent (slope, 1) of the bent axis.
    along_tangent = (from_axis * slope).sum(axis=0) ** 2 / (1 + (slope**2).sum(axis=0))
    distance = np.sqrt((from_axis**2).sum(axis=0) - along_tangent)
    psi = np.arctan2(from_axis[1], from_axis[0])
    mean_radius, taper, o1, o2 = parameters[[4, 7, 8, 9]]
    radius = mean_radius + taper * t
    radius += o1 * np.cos(2 * psi) + o2 * np.sin(2 * psi)
    residuals: FloatArray = (distance - radius - axis_points.offsets) / axis_points.stds
    return residuals


def _form_deviation(values: FloatArray, covariance: FloatArray, dof: float) -> FormDeviation:
    """Return the deviation with the p-value of an F test, or of a chi^2 test if dof is inf."""
    from scipy.stats import chi2, f

    count = len(values)
    statistic = float(values @ np.linalg.solve(covariance, values))
    noise_known = math.isinf(dof)
    p_value = chi2.sf(statistic, count) if noise_known else f.sf(statistic / count, count, dof)
    return FormDeviation(values, covariance, float(p_value))


def fit_section_centres(
    point_sections: IntArray, points: FloatArray, stds: FloatArray, radius: float
) -> SectionCentres:
    """Fit a circle to the points of each section, projected along the axis.

    Parameters
    ----------
    point_sections : (n,) int ndarray
        Section of each point.
    points : (3, n) ndarray
        Coordinates along e_phi, e_theta and the axis, origin on the axis. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each point's distance from the axis. Units: mm.
    radius : float
        Mean radius of the tube. Units: mm.
    """
    sections, index = np.unique(point_sections, return_inverse=True)
    across, along = points[:2], points[2]
    centres, covariances = _fit_circles(across, stds, index, radius, free=2)
    circles, circle_covariances = _fit_circles(across, stds, index, radius, free=3)
    return SectionCentres(
        sections=sections,
        along=np.bincount(index, along) / np.bincount(index),
        deviations=centres[:, :2],
        deviation_covariances=covariances,
        radii=radius + circles[:, 2],
        radii_std=np.sqrt(circle_covariances[:, 2, 2]),
    )


def _fit_circles(
    across: FloatArray, stds: FloatArray, index: IntArray, radius: float, *, free: int
) -> tuple[FloatArray, FloatArray]:
    """Return (centre_1, centre_2, deviation from radius) of each section, and the covariances.

    The first `free` of the three are estimated, the others stay 0.
    """
    count = int(index.max()) + 1
    circles = np.zeros((count, 3))
    # The prior (std = radius) keeps a circle finite whose arc is too short to determine it.
    prior = np.eye(free) / radius**2
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        from_centre = across - circles[index, :2].T
        distance = np.hypot(*from_centre)
        jacobian = np.column_stack([(from_centre / distance).T, np.ones(len(stds))])[:, :free]
        jacobian /= stds[:, None]
        residuals = (distance - radius - circles[index, 2]) / stds
        information = np.tile(prior, (count, 1, 1))
        np.add.at(information, index, jacobian[:, :, None] * jacobian[:, None, :])
        gradient = np.zeros((count, free))
        np.add.at(gradient, index, jacobian * residuals[:, None])
        covariances = np.asarray(np.linalg.inv(information), dtype=np.float64)
        circles[:, :free] += (covariances @ gradient[..., None])[..., 0]
    return circles, covariances


def tube_surface(tube: ScannedCylinder, facets: int = FACETS) -> tuple[Points, IntArray]:
    """Triangulate the fitted cylinder over its measured length, for display; ends are open.

    Parameters
    ----------
    tube : ScannedCylinder
        Cylinder with its axial range.
    facets : int
        Number of flat facets around the tube.

    Returns
    -------
    points : (2 * facets, 3) ndarray
        Ring at the first end, then ring at the second; base frame. Units: mm.
    triangles : (2 * facets, 3) ndarray of int
        Rows of `points`, counter-clockwise seen from outside.
    """
    first, second = tube.fit.tangent_basis
    angles = np.linspace(0.0, 2 * np.pi, facets, endpoint=False)
    ring = tube.radius * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
    rings = [tube.point + end * tube.direction + ring for end in tube.axial_range]
    vertex = np.arange(facets)
    following = (vertex + 1) % facets
    lower = np.column_stack([vertex, following, following + facets])
    upper = np.column_stack([vertex, following + facets, vertex + facets])
    return np.concatenate(rings), np.concatenate([lower, upper])
