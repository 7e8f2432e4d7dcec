"""All experiments in one run: how much work, and everything that came out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

from lsvision.studies.chen_liu_2016.ablation import AblationResult, run_ablation
from lsvision.studies.chen_liu_2016.achievability import Achievability, compare_with_bound
from lsvision.studies.chen_liu_2016.cases import paper_cases
from lsvision.studies.chen_liu_2016.methods import METHODS, Method
from lsvision.studies.chen_liu_2016.paper_pitfalls import Pitfall, check_pitfalls
from lsvision.studies.chen_liu_2016.repeatability import Repeatability, measure_repeatedly
from lsvision.studies.chen_liu_2016.scenes import SceneFigure, measure_scenes
from lsvision.studies.chen_liu_2016.steps import StepExample, run_steps
from lsvision.studies.chen_liu_2016.tables import TableRow, measure_tables
from lsvision.studies.chen_liu_2016.timing import Timing, time_conditions

PAPER_NOISE_MM = 0.1
"""One sigma along the ray at 400 mm that goes with the paper's sensor. Units: mm."""
LEAST_NOISE_MM, LARGEST_NOISE_MM = 0.001, 0.3
"""Beyond these the pipes' arcs say all, or nothing, and there is nothing to compare."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ExperimentSizes:
    """How often everything is measured.

    Parameters
    ----------
    runs : mapping of Method to int
        Measurements of each pipe of Tables 1-4.
    timing_scenes : int
        Scenes of each condition of Table 5.
    repeats : int
        Measurements of the one position of Figure 16.
    ablation_scenes : int
        Scenes of each kind.
    """

    runs: Mapping[Method, int]
    timing_scenes: int
    repeats: int
    ablation_scenes: int

    @classmethod
    def quick(cls) -> Self:
        """Under a minute: spreads are right to 10-15 % for one section, 25-40 % for the rest."""
        runs = {"paper": 3, "section": 24, "known": 24, "two": 8, "twenty": 3}
        return cls(runs=_checked(runs), timing_scenes=1, repeats=200, ablation_scenes=20)

    @classmethod
    def full(cls) -> Self:
        """About ten minutes: right to 4 % for one section, 7-15 % for the rest."""
        runs = {"paper": 20, "section": 400, "known": 400, "two": 100, "twenty": 30}
        return cls(runs=_checked(runs), timing_scenes=4, repeats=1000, ablation_scenes=200)


@dataclass(frozen=True, eq=False)
class PaperReport:
    """What came out.

    Parameters
    ----------
    noise_mm : float
        One sigma along the ray at 400 mm. Units: mm.
    effort : ExperimentSizes
        How often everything was measured.
    rows : tuple of TableRow
        Tables 1-4.
    reaches : tuple of Achievability
        Which of their figures one section can give.
    timings : tuple of Timing
        Table 5; the only part that differs from run to run.
    steps : StepExample
        Figures 5-10.
    scenes : tuple of SceneFigure
        Figures 14 and 15.
    repeatability : Repeatability
        Figure 16.
    costs : tuple of AblationResult
        The ablation.
    traps : tuple of Pitfall
        Of the paper's wording.
    """

    noise_mm: float
    effort: ExperimentSizes
    rows: tuple[TableRow, ...]
    reaches: tuple[Achievability, ...]
    timings: tuple[Timing, ...]
    steps: StepExample
    scenes: tuple[SceneFigure, ...]
    repeatability: Repeatability
    costs: tuple[AblationResult, ...]
    traps: tuple[Pitfall, ...]


def run_experiments(
    effort: ExperimentSizes,
    *,
    noise_mm: float = PAPER_NOISE_MM,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> PaperReport:
    """Run all experiments of the paper on the simulator.

    Parameters
    ----------
    effort : ExperimentSizes
        How often everything is measured.
    noise_mm : float
        One sigma along the ray at 400 mm. Units: mm.
    seed : int
        Same seed, same numbers, but for the timings.
    say : callable
        Told, in a few words, what is being worked on.

    Returns
    -------
    PaperReport

    Raises
    ------
    ValueError
        If the noise is not in [0.001, 0.3] mm.
    """
    if not LEAST_NOISE_MM <= noise_mm <= LARGEST_NOISE_MM:
        raise ValueError(
            f"want noise_mm in [{LEAST_NOISE_MM:g}, {LARGEST_NOISE_MM:g}], got {noise_mm:g}"
        )
    timings = time_conditions(effort.timing_scenes, noise_mm=noise_mm, seed=seed, say=say)
    rows = measure_tables(paper_cases(), effort.runs, noise_mm=noise_mm, seed=seed, say=say)
    say("which figures one section can give")
    reaches = compare_with_bound(rows, noise_mm=noise_mm)
    say("figures 5-10, 14 and 15")
    steps, scenes = run_steps(noise_mm=noise_mm), measure_scenes(noise_mm=noise_mm)
    say(f"figure 16: {effort.repeats} measurements of one position")
    repeatability = measure_repeatedly(effort.repeats, noise_mm=noise_mm, seed=seed)
    costs = run_ablation(effort.ablation_scenes, noise_mm=noise_mm, seed=seed, say=say)
    return PaperReport(
        noise_mm=noise_mm,
        effort=effort,
        rows=rows,
        reaches=reaches,
        timings=timings,
        steps=steps,
        scenes=scenes,
        repeatability=repeatability,
        costs=costs,
        traps=check_pitfalls(),
    )


def _checked(runs: Mapping[str, int]) -> dict[Method, int]:
    """One number for each way, in the order of `METHODS`."""
    return {way: runs[way] for way in METHODS}
