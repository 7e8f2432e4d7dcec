"""The paper's five conditions as random scenes: Table 5 (time) and Figures 14 and 15 (pictures)."""

import math
import time
from dataclasses import dataclass
from statistics import median
from typing import Protocol

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import BoolArray, IntArray
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import Profile
from lsvision.simulate import (
    SectionTruth,
    SimulatedSection,
    TubeRanges,
    TubeTruth,
    random_section,
)
from lsvision.studies.chen_liu_2016.paper_pipeline import measure_cylinders_paper
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_TIMES, PublishedTime
from lsvision.studies.chen_liu_2016.tables import ProgressCallback

RADIUS_MM = 19.0
"""Radius of every pipe, that of the paper's welded pipes. Units: mm."""
TUBES = TubeRanges(radius_mm=(RADIUS_MM, RADIUS_MM), theta_deg=(0.0, 180.0), phi_deg=(10.0, 30.0))
"""Pipes like the paper's welded ones, with the tilts of its tables."""
SEARCH_RANGE_MM = (10.0, 40.0)
"""Search range of the radius in both pipelines; the paper's fits start at its geometric
mean, 20 mm. Units: mm."""
FIGURE_SEED = 0
"""Seed of the scenes in Figures 14 and 15: the first of each kind, not selected."""
REPEATS = 5
"""Measurements of each scene by the fast pipeline, of which the median time is used."""
MIN_IOU = 0.5
"""Smallest intersection over union of the points of a result and of the pipe that it matches."""


@dataclass(frozen=True, slots=True)
class PipelineTiming:
    """Time and matches of one pipeline under one condition.

    Parameters
    ----------
    seconds : float
        Median time of one measurement. Units: s.
    found : int
        Number of pipes that were reported, over all scenes.
    false : int
        Number of results that match no pipe, over all scenes.
    """

    seconds: float
    found: int
    false: int


@dataclass(frozen=True, slots=True)
class Timing:
    """Row of Table 5, measured again.

    Parameters
    ----------
    printed : PublishedTime
        Row as printed in the paper.
    scenes, pipes : int
        Number of scenes, and of pipes in them.
    paper, section : PipelineTiming
        The paper's pipeline, and lsvision, on the same profiles.
    """

    printed: PublishedTime
    scenes: int
    pipes: int
    paper: PipelineTiming
    section: PipelineTiming

    @property
    def ratio(self) -> float:
        """Time of the paper's pipeline over that of lsvision."""
        return self.paper.seconds / self.section.seconds


def time_conditions(
    scenes: int, *, noise_mm: float, seed: int = 0, progress: ProgressCallback = lambda _: None
) -> tuple[Timing, ...]:
    """Return the times of both pipelines on the same random scenes, so many of each condition.

    The noise is the standard deviation along the ray at 400 mm, `seed` that of the first scene;
    `progress` is called with a text before each condition.
    """
    timings = []
    for printed in PUBLISHED_TIMES:
        progress(f"table 5: {printed.condition.lower()}")
        sections = [
            random_section(printed.kind, number, noise_mm=noise_mm, tubes=TUBES)
            for number in range(seed, seed + scenes)
        ]
        pipes = sum(len(section.truth.tubes) for section in sections)
        paper = _time_pipeline(sections, measure_cylinders_paper, repeats=1)
        lsvision = _time_pipeline(sections, measure_cylinders, repeats=REPEATS)
        timings.append(Timing(printed, scenes, pipes, paper, lsvision))
    return tuple(timings)


def count_matches(measurement: Measurement, truth: SectionTruth) -> tuple[int, int]:
    """Return the number of true pipes that were reported, and of results that match no pipe."""
    unmatched = {tube.label for tube in truth.tubes}
    false = 0
    for cylinder in measurement.cylinders:
        points = _mask_points(cylinder, truth.labels)
        matches = [
            label for label in sorted(unmatched) if _exceeds_min_iou(points, truth.labels == label)
        ]
        if matches:
            unmatched.remove(matches[0])
        else:
            false += 1
    return len(truth.tubes) - len(unmatched), false


def _mask_points(cylinder: CylinderSection, labels: IntArray) -> BoolArray:
    """Return a mask of the cylinder's points, one value for each label."""
    points = np.zeros(len(labels), dtype=bool)
    points[cylinder.indices] = True
    return points


def _exceeds_min_iou(points: BoolArray, pipe: BoolArray) -> bool:
    """Return whether the overlap (intersection over union) of two point sets exceeds `MIN_IOU`."""
    return bool((points & pipe).sum() > MIN_IOU * (points | pipe).sum())


@dataclass(frozen=True, slots=True)
class ScenePipe:
    """True and measured values of a pipe in a scene of Figures 14 and 15.

    Parameters
    ----------
    true_radius_mm, true_theta_deg, true_phi_deg : float
        True values. Units: mm, deg.
    radius_mm, theta_deg, phi_deg : tuple of float or None
        Value and standard deviation; None where the pipe was not found.
    """

    true_radius_mm: float
    true_theta_deg: float
    true_phi_deg: float
    radius_mm: tuple[float, float] | None
    theta_deg: tuple[float, float] | None
    phi_deg: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class SceneFigure:
    """One scene of Figures 14 and 15, measured.

    Parameters
    ----------
    title : str
        Name of the paper's condition.
    section : SimulatedSection
        Simulated section.
    measurement : Measurement
        Result of lsvision.
    pipes : tuple of ScenePipe
        True and measured values of all pipes of the scene.
    false : int
        Number of results that match no pipe.
    """

    title: str
    section: SimulatedSection
    measurement: Measurement
    pipes: tuple[ScenePipe, ...]
    false: int


def measure_scenes(*, noise_mm: float) -> tuple[SceneFigure, ...]:
    """Measure one scene of each kind in Figures 14 and 15; the noise is along the ray at 400 mm."""
    scenes = []
    for printed in PUBLISHED_TIMES[1:]:  # without the single pipe, which no figure shows
        section = random_section(printed.kind, FIGURE_SEED, noise_mm=noise_mm, tubes=TUBES)
        measurement = measure_cylinders(section.profile, radius=SEARCH_RANGE_MM)
        pipes = tuple(_compare_pipe(tube, section, measurement) for tube in section.truth.tubes)
        _, false = count_matches(measurement, section.truth)
        scenes.append(SceneFigure(printed.condition, section, measurement, pipes, false))
    return tuple(scenes)


class _MeasureFunction(Protocol):
    """A pipeline: `measure_cylinders` or `measure_cylinders_paper`."""

    def __call__(self, profile: Profile, *, radius: tuple[float, float]) -> Measurement: ...


def _time_pipeline(
    sections: list[SimulatedSection], measure: _MeasureFunction, repeats: int
) -> PipelineTiming:
    """Return the time of a pipeline on sections, and the number of its matches."""
    seconds: list[float] = []
    found = false = 0
    for section in sections:
        runs = []
        for _ in range(repeats):
            start = time.perf_counter()
            measurement = measure(section.profile, radius=SEARCH_RANGE_MM)
            runs.append(time.perf_counter() - start)
        seconds.append(median(runs))
        section_found, section_false = count_matches(measurement, section.truth)
        found, false = found + section_found, false + section_false
    return PipelineTiming(median(seconds), found, false)


def _compare_pipe(
    tube: TubeTruth, section: SimulatedSection, measurement: Measurement
) -> ScenePipe:
    """Return true and measured values of a pipe, those of the result that matches it."""
    deg = math.degrees(1.0)
    truth = (tube.radius, tube.theta * deg, tube.phi * deg)
    labels = section.truth.labels
    for c in measurement.cylinders:
        if _exceeds_min_iou(_mask_points(c, labels), labels == tube.label):
            return ScenePipe(
                *truth,
                (c.radius, c.radius_std),
                (c.theta * deg, c.theta_std * deg),
                (c.phi * deg, c.phi_std * deg),
            )
    return ScenePipe(*truth, None, None, None)
