"""Five methods to measure a pipe: the paper's, one section, known radius, two and 20 sections."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lsvision.geometry import IntArray, Points, Pose
from lsvision.measure import measure_cylinders
from lsvision.planning import ScanPrediction, SectionPrediction, scan_bound, section_bound
from lsvision.planning.sensor_view import cylinder_normals
from lsvision.profile import NoiseModel
from lsvision.scan import measure_scan
from lsvision.simulate import SimulatedSection
from lsvision.studies.chen_liu_2016.cases import COLUMNS, Case, simulate_case
from lsvision.studies.chen_liu_2016.paper_pipeline import PaperSettings, measure_cylinders_paper
from lsvision.studies.chen_liu_2016.published_results import Triple

Method = Literal["paper", "section", "known", "two", "twenty"]


@dataclass(frozen=True, slots=True)
class MethodInfo:
    """Names of a method, and the sections that it measures.

    Parameters
    ----------
    letter : str
        Letter in tables and figures, a to e.
    name, short : str
        Long and short name.
    positions_mm : tuple of float
        Positions of the sections along the laser plane's normal. Units: mm.
    """

    letter: str
    name: str
    short: str
    positions_mm: tuple[float, ...]

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Poses of the sections; the paper's own section at z = 0 is in their middle."""
        return tuple(Pose.along((0.0, 0.0, 1.0), z) for z in self.positions_mm)


METHODS: dict[Method, MethodInfo] = {
    "paper": MethodInfo("a", "the paper's pipeline, literally", "paper’s pipeline", (0.0,)),
    "section": MethodInfo("b", "lsvision, one section", "one section", (0.0,)),
    "known": MethodInfo("c", "one section, radius known", "radius known", (0.0,)),
    "two": MethodInfo("d", "two sections, 10 mm apart", "two sections", (-5.0, 5.0)),
    "twenty": MethodInfo("e", "twenty sections over 20 mm", "twenty sections",
                      tuple(np.linspace(-10, 10, 20).tolist())),
}  # fmt: skip
"""The methods in the order of the tables' columns."""

Estimate = tuple[float, float, float]
"""Estimate of a pipe: radius (mm), theta and phi (rad)."""


def measure_case(
    case: Case, method: Method, seed: int, *, noise_mm: float
) -> tuple[Estimate | None, ...]:
    """Measure all pipes of a case once; return the estimate of each, None if it was not found.

    Every method gets the nominal radius, as the paper's fit does; all methods with one section get
    the same one, of the random seed. The noise is the standard deviation along the ray, in mm.
    """
    sections = simulate_case(case, seed, METHODS[method].poses, noise_mm=noise_mm)
    if len(sections) > 1:
        return _measure_scan(case, sections, METHODS[method].poses)
    (section,) = sections
    labels = section.truth.labels
    radius, known_radius = case.radius_mm, case.radius_mm if method == "known" else None
    if method == "paper":
        settings = _choose_paper_settings(section)
        measurement = measure_cylinders_paper(section.profile, radius=radius, settings=settings)
    else:
        measurement = measure_cylinders(section.profile, radius=radius, known_radius=known_radius)
    estimates = [(labels[c.indices], (c.radius, c.theta, c.phi)) for c in measurement.cylinders]
    return _match_estimates(estimates, len(case.rows))


def case_bound(case: Case, method: Method, *, noise_mm: float) -> tuple[Triple, ...]:
    """Return the Cramer-Rao bound for each pipe: the smallest stds of any unbiased estimate.

    It is that of the points of one simulated measurement; for the paper's pipeline, that of any use
    of one section. The noise is the standard deviation along the ray, in mm.
    """
    poses = METHODS[method].poses
    sections = simulate_case(case, 0, poses, noise_mm=noise_mm)
    labels = range(1, len(case.rows) + 1)
    if len(sections) > 1:
        return tuple(_scan_bound(case, sections, poses, label) for label in labels)
    known_std = 0.0 if method == "known" else None
    return tuple(_section_bound(sections[0], label, known_std) for label in labels)


def compute_case_errors(estimate: Estimate, case: Case, pipe: int) -> Triple:
    """Return the errors (estimate minus truth) of pipe number `pipe`, from 0.

    The error of theta is in [-90, 90) deg.
    """
    row = case.rows[pipe]
    radius, theta, phi = estimate
    theta_error = (math.degrees(theta) - row.theta_deg + 90) % 180 - 90
    return Triple(radius - row.radius_mm, theta_error, math.degrees(phi) - row.phi_deg)


def _choose_paper_settings(section: SimulatedSection) -> PaperSettings:
    """Return settings of the paper's pipeline with the window of a full profile.

    The window is 10 % of the sensor's columns, as on the paper's profiles of a whole bench. 10 % of
    the pipe's points alone would be six points, which an ellipse always fits.
    """
    columns_per_point = COLUMNS / (len(section.profile) - section.profile.lost)
    fraction = PaperSettings().window_fraction * columns_per_point
    return PaperSettings(window_fraction=fraction)


def _measure_scan(
    case: Case, sections: tuple[SimulatedSection, ...], poses: tuple[Pose, ...]
) -> tuple[Estimate | None, ...]:
    """Return the estimate of each pipe from several sections; None if it was not found."""
    scan = measure_scan([s.profile for s in sections], poses, radius=case.radius_mm)
    labels = np.array([section.truth.labels for section in sections])
    estimates = []
    for cylinder in scan.cylinders:
        x, y, z = cylinder.direction
        theta = math.atan2(y, x) if z > 0 else math.atan2(-y, -x)
        estimate = (cylinder.radius, theta, math.acos(min(abs(z), 1.0)))
        estimates.append((labels[cylinder.point_sections, cylinder.indices], estimate))
    return _match_estimates(estimates, len(case.rows))


def _match_estimates(
    estimates: Iterable[tuple[IntArray, Estimate]], pipes: int
) -> tuple[Estimate | None, ...]:
    """Return for each pipe the estimate with most of its points, or None.

    An estimate belongs to the pipe that more than half of its points come from. Each estimate is
    given with the true labels of its points; the k-th pipe has the label k.
    """
    candidates = list(estimates)
    by_pipe: list[Estimate | None] = []
    for label in range(1, pipes + 1):
        matches = [
            (int((labels == label).sum()), estimate)
            for labels, estimate in candidates
            if (labels == label).mean() > 0.5
        ]
        by_pipe.append(max(matches)[1] if matches else None)
    return tuple(by_pipe)


def _section_bound(section: SimulatedSection, label: int, known_std: float | None) -> Triple:
    """Return the bound of a pipe from one section; `known_std` is that of a known radius in mm."""
    on_pipe = section.truth.labels == label
    return _list_uncertainties(
        section_bound(
            section.truth.tubes[label - 1].ellipse,
            section.truth.points[on_pipe],
            get_noise_model(section).covariances(section.profile.points)[on_pipe],
            known_std,
        )
    )


def _scan_bound(
    case: Case, sections: tuple[SimulatedSection, ...], poses: tuple[Pose, ...], label: int
) -> Triple:
    """Return the bound of a pipe from several sections."""
    pipe = case.scene.tubes[label - 1].local_cylinder(Pose())
    if pipe is None:
        raise ValueError("expected a pipe that intersects z = 0, got one that does not")
    points, variances = [], []
    for section, pose in zip(sections, poses, strict=True):
        on_pipe = section.truth.labels == label
        surface_points = pose.apply(_with_zero_z(section.truth.points[on_pipe]))
        normals = cylinder_normals(pipe, surface_points)[:, :2]
        covariances = get_noise_model(section).covariances(section.profile.points)[on_pipe]
        points.append(surface_points)
        variances.append(np.einsum("ni,nij,nj->n", normals, covariances, normals))
    return _list_uncertainties(scan_bound(pipe, np.concatenate(points), np.concatenate(variances)))


def _list_uncertainties(bound: SectionPrediction | ScanPrediction) -> Triple:
    """Return the standard uncertainties of radius (mm), theta and phi (deg)."""
    deg = math.degrees(1.0)
    return Triple(bound.radius_std, bound.theta_std * deg, bound.phi_std * deg)


def _with_zero_z(points: Points) -> Points:
    """Return points (n, 2) as points (n, 3) in the plane z = 0. Units: mm."""
    return np.column_stack([points, np.zeros(len(points))])


def get_noise_model(section: SimulatedSection) -> NoiseModel:
    """Return the noise model of a simulated section's profile."""
    noise = section.profile.noise
    if noise is None:
        raise ValueError("expected a profile with a noise model, got one without")
    return noise
