"""Table 5: time of one measurement under the paper's five conditions, both chains in one run."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from lsvision.measure import Measurement, Settings, measure_cylinders
from lsvision.simulate import SectionTruth, SimulatedSection, TubeRanges, random_section
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_TIMES, PublishedTime

RADIUS_MM = 19.0
TUBES = TubeRanges(radius_mm=(RADIUS_MM, RADIUS_MM), theta_deg=(0.0, 180.0), phi_deg=(10.0, 30.0))
"""The paper's welded pipes, at the tilts of its tables."""
SEARCHED_MM = (10.0, 40.0)
"""Neither chain is told the radius; the paper's starts its fits from the middle, 20 mm."""
REPEATS = 5
"""Of the fast chain on each scene; the median counts."""
MIN_IOU = 0.5
"""Least intersection over union of the points for a result to be the pipe."""


@dataclass(frozen=True, slots=True)
class PipelineTiming:
    """What one chain did under one condition.

    Parameters
    ----------
    seconds : float
        Median time of one measurement.
    found : int
        Pipes reported, over all scenes.
    false : int
        Results that are no pipe, over all scenes.
    """

    seconds: float
    found: int
    false: int


@dataclass(frozen=True, slots=True)
class Timing:
    """A row of Table 5, measured again.

    Parameters
    ----------
    printed : PublishedTime
        What the paper says.
    scenes, pipes : int
        Scenes measured, and pipes in them.
    paper, section : PipelineTiming
        The paper's chain, and lsvision, on the same profiles.
    """

    printed: PublishedTime
    scenes: int
    pipes: int
    paper: PipelineTiming
    section: PipelineTiming

    @property
    def ratio(self) -> float:
        """How many times faster lsvision is."""
        return self.paper.seconds / self.section.seconds


def time_conditions(
    scenes: int, *, noise_mm: float, seed: int = 0, say: Callable[[str], None] = lambda _: None
) -> tuple[Timing, ...]:
    """Time both chains on the same random scenes of each condition.

    Parameters
    ----------
    scenes : int
        Of each condition.
    noise_mm : float
        One sigma along the ray. Units: mm.
    seed : int
        Of the first scene.
    say : callable
        Told of each condition.
    """
    timings = []
    for printed in PUBLISHED_TIMES:
        say(f"table 5: {printed.condition.lower()}")
        sections = [
            random_section(printed.kind, number, noise_mm=noise_mm, tubes=TUBES)
            for number in range(seed, seed + scenes)
        ]
        pipes = sum(len(section.truth.tubes) for section in sections)
        paper = _time_chain(sections, Settings.paper(), repeats=1)
        ours = _time_chain(sections, Settings(), repeats=REPEATS)
        timings.append(Timing(printed, scenes, pipes, paper, ours))
    return tuple(timings)


def count_matches(measurement: Measurement, truth: SectionTruth) -> tuple[int, int]:
    """Pipes reported, and results that are none: a result is a pipe if it has its points.

    Parameters
    ----------
    measurement : Measurement
        What a chain reports.
    truth : SectionTruth
        What is there.
    """
    free = {tube.label for tube in truth.tubes}
    false = 0
    for cylinder in measurement.cylinders:
        got = np.zeros(len(truth.labels), dtype=bool)
        got[cylinder.indices] = True
        hit = next((label for label in sorted(free) if _same(got, truth.labels == label)), None)
        if hit is None:
            false += 1
        else:
            free.remove(hit)
    return len(truth.tubes) - len(free), false


def _same(got: np.ndarray, wanted: np.ndarray) -> bool:
    return bool((got & wanted).sum() > MIN_IOU * (got | wanted).sum())


def _time_chain(
    sections: list[SimulatedSection], settings: Settings, repeats: int
) -> PipelineTiming:
    seconds: list[float] = []
    found = false = 0
    for section in sections:
        runs = []
        for _ in range(repeats):
            start = time.perf_counter()
            measurement = measure_cylinders(section.profile, radius=SEARCHED_MM, settings=settings)
            runs.append(time.perf_counter() - start)
        seconds.append(median(runs))
        more_found, more_false = count_matches(measurement, section.truth)
        found, false = found + more_found, false + more_false
    return PipelineTiming(median(seconds), found, false)
