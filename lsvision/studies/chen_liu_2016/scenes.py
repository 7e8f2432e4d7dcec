"""Figures 14 and 15: pipes welded together, and among planar and complex clutter."""

import math
from dataclasses import dataclass

from lsvision.measure import Measurement, measure_cylinders
from lsvision.simulate import SimulatedSection, TubeTruth, random_section
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_TIMES
from lsvision.studies.chen_liu_2016.timing import SEARCHED_MM, TUBES, count_matches

SEED = 0
"""Of the pictured scenes: the first of each kind, not a chosen one."""


@dataclass(frozen=True, slots=True)
class ScenePipe:
    """A pipe in a pictured scene: what is true, and what was found of it.

    Parameters
    ----------
    true_radius_mm, true_theta_deg, true_phi_deg : float
        Units: mm, deg.
    radius_mm, theta_deg, phi_deg : tuple of float or None
        Value and one sigma; None where the pipe was not found.
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
        The paper's condition.
    section : SimulatedSection
        The scene, seen.
    measurement : Measurement
        What lsvision finds in it.
    pipes : tuple of ScenePipe
        In the order of the truth.
    false : int
        Results that are no pipe.
    """

    title: str
    section: SimulatedSection
    measurement: Measurement
    pipes: tuple[ScenePipe, ...]
    false: int


def measure_scenes(*, noise_mm: float) -> tuple[SceneFigure, ...]:
    """Measure one scene of each kind that the paper shows.

    Parameters
    ----------
    noise_mm : float
        One sigma along the ray at 400 mm. Units: mm.
    """
    scenes = []
    for printed in PUBLISHED_TIMES[1:]:
        section = random_section(printed.kind, SEED, noise_mm=noise_mm, tubes=TUBES)
        measurement = measure_cylinders(section.profile, radius=SEARCHED_MM)
        pipes = tuple(_pipe(tube, section, measurement) for tube in section.truth.tubes)
        _, false = count_matches(measurement, section.truth)
        scenes.append(SceneFigure(printed.condition, section, measurement, pipes, false))
    return tuple(scenes)


def _pipe(tube: TubeTruth, section: SimulatedSection, measurement: Measurement) -> ScenePipe:
    deg = math.degrees(1.0)
    truth = (tube.radius, tube.theta * deg, tube.phi * deg)
    labels = section.truth.labels
    for c in measurement.cylinders:
        if (labels[c.indices] == tube.label).mean() > 0.5:
            return ScenePipe(
                *truth,
                (c.radius, c.radius_std),
                (c.theta * deg, c.theta_std * deg),
                (c.phi * deg, c.phi_std * deg),
            )
    return ScenePipe(*truth, None, None, None)
