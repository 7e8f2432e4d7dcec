"""Shape along a tube: how far it bends, tapers and is out of round (the paper's own motive).

The joint fit takes a tube for a straight circular cylinder. Here the same points are fitted
once more with the straight axis bent to a parabola, a radius that changes along it, and a
cross-section r + o1 cos 2 psi + o2 sin 2 psi; each of the three is tested against nothing.
The tilt of the sections needs no allowance: psi is the angle about the axis, in space.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import variance_factor
from lsvision.cylinder.problem import tangent_frame
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray
from lsvision.scan.scan_result import ScannedCylinder
from lsvision.scan.section_centres import SectionCentres, fit_section_centres

PARAMETERS = 10
"""Point and direction across the axis, radius; bow (2), taper, ovality (2)."""
MIN_SECTIONS = 3


@dataclass(frozen=True, eq=False, slots=True)
class FormDeviation:
    """One way in which a tube differs from a straight round cylinder.

    Parameters
    ----------
    values : (k,) ndarray
        Its components. Units: mm.
    covariance : (k, k) ndarray
        Units: mm^2.
    p_value : float
        Probability of a deviation as large in a tube that has none.
    """

    values: FloatArray
    covariance: FloatArray
    p_value: float

    @property
    def size(self) -> float:
        """Length of `values`. Units: mm."""
        return float(np.linalg.norm(self.values))

    @property
    def size_std(self) -> float:
        """One sigma of `size`, along its own direction. Units: mm."""
        unit = self.values / self.size if self.size > 0 else np.eye(len(self.values))[0]
        return math.sqrt(float(unit @ self.covariance @ unit))

    def is_significant(self, level: float = 0.01) -> bool:
        """Whether chance makes as much in less than `level` of perfect tubes."""
        return self.p_value < level


@dataclass(frozen=True, eq=False, slots=True)
class TubeShape:
    """Shape of a tube along its axis.

    Parameters
    ----------
    centres : SectionCentres
        Centre and radius of each section, beside the straight axis.
    bow : FormDeviation
        How far the axis lies beside its middle's tangent at both ends of the stretch seen,
        along e_phi and e_theta of the fit.
    taper : FormDeviation
        Growth of the radius from the middle to the end of the stretch seen.
    ovality_terms : FormDeviation
        o1 and o2.
    radius : float
        Mean radius of the deviating tube. Units: mm.
    half_length : float
        Half of the stretch seen along the axis. Units: mm.
    """

    centres: SectionCentres
    bow: FormDeviation
    taper: FormDeviation
    ovality_terms: FormDeviation
    radius: float
    half_length: float

    @property
    def bow_radius(self) -> float:
        """Radius of the axis as the best circle: (half_length^2 + bow^2) / (2 bow). Units: mm."""
        bow = self.bow.size
        return (self.half_length**2 + bow**2) / (2 * bow) if bow > 0 else math.inf

    @property
    def bow_radius_std(self) -> float:
        """One sigma of `bow_radius`, linear. Units: mm."""
        return self.bow_radius * self.bow.size_std / self.bow.size if self.bow.size else math.inf

    @property
    def ovality(self) -> float:
        """Largest less smallest diameter, over the mean. Definition: 2 |o| / r."""
        return 2 * self.ovality_terms.size / self.radius

    @property
    def ovality_std(self) -> float:
        """One sigma of `ovality`. |o| is never negative: near 0 it reads about its sigma."""
        return 2 * self.ovality_terms.size_std / self.radius

    @property
    def taper_slope(self) -> float:
        """Growth of the radius per length along the direction. Units: mm/mm."""
        return float(self.taper.values[0]) / self.half_length


def measure_shape(tube: ScannedCylinder) -> TubeShape:
    """Measure bow, taper, ovality and the line of centres of a scanned tube.

    Parameters
    ----------
    tube : ScannedCylinder
        Of three sections or more.

    Returns
    -------
    TubeShape
        Tests of bow, taper and ovality account for one another.

    Raises
    ------
    DegenerateGeometry
        Under three sections: two centres are always on a straight line.

    Notes
    -----
    An arc of less than about 90 deg hardly tells an oval from a circle beside it: the
    covariance says so, and the test finds nothing. The poses are taken as exact; a feed that
    wavers bends every tube alike.
    """
    if len(tube.sections) < MIN_SECTIONS:
        raise DegenerateGeometry(
            f"the shape of a tube needs {MIN_SECTIONS} sections of it, got "
            f"{len(tube.sections)}: scan more of it"
        )
    view = _view(tube)
    found, information, residuals = _fit_deviations(view)
    known_noise = math.isinf(tube.fit.degrees_of_freedom)
    freedom = max(len(residuals) - PARAMETERS, 1)
    factor, weight, spread = variance_factor(residuals, freedom, known_noise=known_noise)
    covariance = factor * spread**2 * np.asarray(np.linalg.inv(information), dtype=np.float64)
    bow, taper, ovality = (
        _form_deviation(found[part], covariance[part, part], weight)
        for part in (slice(5, 7), slice(7, 8), slice(8, 10))
    )
    # The straight line of the joint fit stays the reference; only the radius is the tube's own.
    places = view.points + np.array([[0.0], [0.0], [sum(tube.axial_range) / 2]])
    stds = view.stds * spread * math.sqrt(factor)
    return TubeShape(
        centres=fit_section_centres(tube.point_sections, places, stds, float(found[4])),
        bow=bow,
        taper=taper,
        ovality_terms=ovality,
        radius=float(found[4]),
        half_length=view.half_length,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _AxisFramePoints:
    """Points in the axis' frame, from the middle of the stretch seen."""

    points: FloatArray  # (3, n)
    stds: FloatArray
    offsets: FloatArray
    radius: float
    half_length: float

    @property
    def along(self) -> FloatArray:
        along: FloatArray = self.points[2]
        return along


def _view(tube: ScannedCylinder) -> _AxisFramePoints:
    fit = tube.fit
    middle = fit.point + fit.direction * sum(tube.axial_range) / 2
    points = tangent_frame(fit.direction) @ (tube.points - middle).T
    offsets = fit.residuals - fit.normalised * fit.stds
    return _AxisFramePoints(
        points, fit.stds, offsets, fit.radius, (tube.axial_range[1] - tube.axial_range[0]) / 2
    )


def _fit_deviations(view: _AxisFramePoints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The unknowns, their information, and the residuals over their deviations."""
    from scipy.optimize import leastsq

    start = np.zeros(PARAMETERS)
    start[4] = view.radius
    found, *_ = leastsq(
        lambda x: _residuals(view, x), start, xtol=1e-10, ftol=1e-12, epsfcn=1e-11, maxfev=400
    )
    steps = 1e-5 * np.eye(PARAMETERS) * view.radius
    columns = [
        (_residuals(view, found + step) - _residuals(view, found - step)) / (2 * step.max())
        for step in steps
    ]
    weighted = np.column_stack(columns)
    unknowns: FloatArray = found
    return unknowns, weighted.T @ weighted, _residuals(view, unknowns)


def _residuals(view: _AxisFramePoints, unknowns: FloatArray) -> FloatArray:
    """Distances from the bent, tapering, oval tube over their standard deviations.

    All unknowns are lengths at the end of the stretch seen, t = 1, so that they are alike.
    """
    centre, tilt, bow = unknowns[:2], unknowns[2:4], unknowns[5:7]
    t = view.along / view.half_length
    from_axis = view.points[:2] - centre[:, None] - np.outer(tilt, t) - np.outer(bow, t * t)
    slope = (tilt[:, None] + 2 * np.outer(bow, t)) / view.half_length
    # The part of the gap that lies along the axis' own tangent (slope, 1).
    along_tangent = (from_axis * slope).sum(axis=0) ** 2 / (1 + (slope**2).sum(axis=0))
    distance = np.sqrt((from_axis**2).sum(axis=0) - along_tangent)
    psi = np.arctan2(from_axis[1], from_axis[0])
    radius = unknowns[4] + unknowns[7] * t
    radius += unknowns[8] * np.cos(2 * psi) + unknowns[9] * np.sin(2 * psi)
    residuals: FloatArray = (distance - radius - view.offsets) / view.stds
    return residuals


def _form_deviation(values: FloatArray, covariance: FloatArray, freedom: float) -> FormDeviation:
    """With its test: F, or chi^2 where the noise is known."""
    from scipy.stats import chi2, f

    count = len(values)
    statistic = float(values @ np.linalg.solve(covariance, values))
    known = math.isinf(freedom)
    p_value = chi2.sf(statistic, count) if known else f.sf(statistic / count, count, freedom)
    return FormDeviation(values, covariance, float(p_value))
