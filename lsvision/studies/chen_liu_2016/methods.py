"""Five ways to measure a pipe: the paper's chain, one section, known radius, two, twenty."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lsvision.geometry import Pose
from lsvision.measure import Settings, measure_cylinders
from lsvision.paper_pipeline import PaperSettings
from lsvision.planning import scan_bound, section_bound
from lsvision.planning.sensor_view import cylinder_normals
from lsvision.profile import NoiseModel
from lsvision.scan import measure_scan
from lsvision.simulate import SimulatedSection
from lsvision.studies.chen_liu_2016.cases import COLUMNS, Case, simulate_case
from lsvision.studies.chen_liu_2016.published_results import Triple

Method = Literal["paper", "section", "known", "two", "twenty"]


@dataclass(frozen=True, slots=True)
class MethodInfo:
    """How a way is called, and which sections it takes.

    Parameters
    ----------
    letter : str
        (a) to (e).
    name, short : str
        In plain words, and in few.
    places_mm : tuple of float
        Places of the sections along the laser plane's normal. Units: mm.
    """

    letter: str
    name: str
    short: str
    places_mm: tuple[float, ...]

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of the sections, the paper's own section at z = 0 amid them."""
        return tuple(Pose.along((0.0, 0.0, 1.0), place) for place in self.places_mm)


METHODS: dict[Method, MethodInfo] = {
    "paper": MethodInfo("a", "the paper's chain, literally", "paper’s chain", (0.0,)),
    "section": MethodInfo("b", "lsvision, one section", "one section", (0.0,)),
    "known": MethodInfo("c", "one section, radius known", "radius known", (0.0,)),
    "two": MethodInfo("d", "two sections, 10 mm apart", "two sections", (-5.0, 5.0)),
    "twenty": MethodInfo("e", "twenty sections over 20 mm", "twenty sections",
                      tuple(np.linspace(-10, 10, 20).tolist())),
}  # fmt: skip
"""In the order of the tables' columns."""

Found = tuple[float, float, float]
"""Radius (mm), theta and phi (rad)."""


def measure_case(
    case: Case, way: Method, seed: int, *, noise_mm: float
) -> tuple[Found | None, ...]:
    """One measurement of all pipes of a case.

    Parameters
    ----------
    case : Case
        What is measured; every way is told its radius, as the paper's fit is.
    way : str
        A key of `METHODS`. The ways with one section all see the same one.
    seed : int
        Number of the measurement.
    noise_mm : float
        One sigma along the ray. Units: mm.

    Returns
    -------
    tuple
        For each pipe what was found of it, or None.
    """
    sections = simulate_case(case, seed, METHODS[way].poses, noise_mm=noise_mm)
    if len(sections) > 1:
        return _measure_scan(case, sections, METHODS[way].poses)
    (section,) = sections
    labels = section.truth.labels
    measurement = measure_cylinders(
        section.profile,
        radius=case.radius_mm,
        known_radius=case.radius_mm if way == "known" else None,
        settings=_paper_settings(section) if way == "paper" else Settings(),
    )
    found = [(labels[c.indices], (c.radius, c.theta, c.phi)) for c in measurement.cylinders]
    return _by_label(found, len(case.rows))


def case_bound(case: Case, way: Method, *, noise_mm: float) -> tuple[Triple, ...]:
    """Smallest one-sigma errors that any unbiased method can have, for each pipe.

    Parameters
    ----------
    case : Case
        What is measured.
    way : str
        A key of `METHODS`; the bound of the paper's chain is that of any use of one section.
    noise_mm : float
        One sigma along the ray. Units: mm.
    """
    poses = METHODS[way].poses
    sections = simulate_case(case, 0, poses, noise_mm=noise_mm)
    labels = range(1, len(case.rows) + 1)
    if len(sections) > 1:
        return tuple(_scan_bound(case, sections, poses, label) for label in labels)
    known_std = 0.0 if way == "known" else None
    return tuple(_section_bound(sections[0], label, known_std) for label in labels)


def case_errors(found: Found, case: Case, pipe: int) -> Triple:
    """Errors of what was found of a pipe; theta's is within 90 deg either way."""
    row = case.rows[pipe]
    radius, theta, phi = found
    turn = (math.degrees(theta) - row.theta_deg + 90) % 180 - 90
    return Triple(radius - row.radius_mm, turn, math.degrees(phi) - row.phi_deg)


def _paper_settings(section: SimulatedSection) -> Settings:
    """The paper's chain with the window it has on a whole line.

    10 % of a line full of points, as the paper's sensor gives over a bench. Of the pipe's own
    points alone it would be six, on which every ellipse fits.
    """
    line = COLUMNS / (len(section.profile) - section.profile.lost)
    fraction = PaperSettings().window_fraction * line
    return Settings(paper_settings=PaperSettings(window_fraction=fraction))


def _measure_scan(
    case: Case, sections: tuple[SimulatedSection, ...], poses: tuple[Pose, ...]
) -> tuple[Found | None, ...]:
    scan = measure_scan([s.profile for s in sections], poses, radius=case.radius_mm)
    every = np.array([section.truth.labels for section in sections])
    found = []
    for cylinder in scan.cylinders:
        x, y, z = cylinder.direction
        theta = math.atan2(y, x) if z > 0 else math.atan2(-y, -x)
        numbers = (cylinder.radius, theta, math.acos(min(abs(z), 1.0)))
        found.append((every[cylinder.point_sections, cylinder.indices], numbers))
    return _by_label(found, len(case.rows))


def _by_label(found: Iterable[tuple[np.ndarray, Found]], pipes: int) -> tuple[Found | None, ...]:
    """For each pipe what holds most of its points, if that is mostly the pipe."""
    every = list(found)
    chosen: list[Found | None] = []
    for label in range(1, pipes + 1):
        own = [
            (int((labels == label).sum()), numbers)
            for labels, numbers in every
            if (labels == label).mean() > 0.5
        ]
        chosen.append(max(own)[1] if own else None)
    return tuple(chosen)


def _section_bound(section: SimulatedSection, label: int, known_std: float | None) -> Triple:
    on_pipe = section.truth.labels == label
    bound = section_bound(
        section.truth.tubes[label - 1].ellipse,
        section.truth.points[on_pipe],
        _noise(section).covariances(section.profile.points)[on_pipe],
        known_std,
    )
    deg = math.degrees(1.0)
    return Triple(bound.radius_std, bound.theta_std * deg, bound.phi_std * deg)


def _scan_bound(
    case: Case, sections: tuple[SimulatedSection, ...], poses: tuple[Pose, ...], label: int
) -> Triple:
    pipe = case.scene.tubes[label - 1].local_cylinder(Pose())
    if pipe is None:
        raise ValueError("want a pipe that z = 0 cuts")
    points, variances = [], []
    for section, pose in zip(sections, poses, strict=True):
        on_pipe = section.truth.labels == label
        seen = pose.apply(_in_space(section.truth.points[on_pipe]))
        normals = cylinder_normals(pipe, seen)[:, :2]
        covariances = _noise(section).covariances(section.profile.points)[on_pipe]
        points.append(seen)
        variances.append(np.einsum("ni,nij,nj->n", normals, covariances, normals))
    bound = scan_bound(pipe, np.concatenate(points), np.concatenate(variances))
    deg = math.degrees(1.0)
    return Triple(bound.radius_std, bound.theta_std * deg, bound.phi_std * deg)


def _in_space(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points, np.zeros(len(points))])


def _noise(section: SimulatedSection) -> NoiseModel:
    noise = section.profile.noise
    if noise is None:
        raise ValueError("want a section that knows its noise")
    return noise
