"""Run all experiments: their sizes and their results."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from lsvision.results.quantities import convert_to_plain
from lsvision.studies.chen_liu_2016.ablation import AblationResult, run_ablation
from lsvision.studies.chen_liu_2016.achievability import Achievability, compare_with_bound
from lsvision.studies.chen_liu_2016.cases import list_paper_cases
from lsvision.studies.chen_liu_2016.methods import METHODS, Method
from lsvision.studies.chen_liu_2016.paper_pitfalls import Pitfall, check_pitfalls
from lsvision.studies.chen_liu_2016.repeatability import Repeatability, measure_repeatedly
from lsvision.studies.chen_liu_2016.report_tables import format_readme_table
from lsvision.studies.chen_liu_2016.scenes import (
    SceneFigure,
    Timing,
    measure_scenes,
    time_conditions,
)
from lsvision.studies.chen_liu_2016.steps import StepExample, run_steps
from lsvision.studies.chen_liu_2016.tables import ProgressCallback, TableRow, measure_tables

PAPER_NOISE_MM = 0.1
"""Standard deviation along the ray at 400 mm of the paper's sensor. Units: mm."""
MIN_NOISE_MM, MAX_NOISE_MM = 0.001, 0.3
"""Permitted noise: a hundredth of the paper's, and the one at which a few of 100 sections do not
determine the radius (at 0.5 mm a quarter do not). Units: mm."""
SCHEMA = "lsvision.paper/1"
"""Name and version of the file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ExperimentSizes:
    """Number of measurements and scenes of each experiment.

    Parameters
    ----------
    runs : mapping of Method to int
        Number of measurements of each pipe of Tables 1-4 by each method.
    timing_scenes : int
        Number of scenes of each condition of Table 5.
    repeats : int
        Number of measurements of the position of Figure 16.
    ablation_scenes : int
        Number of scenes of each kind in the ablation.

    Raises
    ------
    ValueError
        If `runs` lacks a method or has a negative number, or another number is below 1 (of
        `repeats`: 2).
    """

    runs: Mapping[Method, int]
    timing_scenes: int
    repeats: int
    ablation_scenes: int

    def __post_init__(self) -> None:
        if set(self.runs) != set(METHODS) or min(self.runs.values()) < 0:
            raise ValueError(f"expected runs >= 0 of {', '.join(METHODS)}, got {dict(self.runs)}")
        for name, minimum in (("timing_scenes", 1), ("repeats", 2), ("ablation_scenes", 1)):
            if not getattr(self, name) >= minimum:
                raise ValueError(f"expected {name} >= {minimum}, got {getattr(self, name)}")

    @classmethod
    def quick(cls) -> Self:
        """Return sizes for a minute or two; std of an rms: 14 % (section, known), else 25-41 %."""
        runs = {"paper": 3, "section": 24, "known": 24, "two": 8, "twenty": 3}
        return cls(runs=_order_runs(runs), timing_scenes=1, repeats=200, ablation_scenes=20)

    @classmethod
    def full(cls) -> Self:
        """Return sizes for about ten minutes; std of an rms: 4 % (section, known), else 7-16 %."""
        runs = {"paper": 20, "section": 400, "known": 400, "two": 100, "twenty": 30}
        return cls(runs=_order_runs(runs), timing_scenes=4, repeats=1000, ablation_scenes=200)


@dataclass(frozen=True, eq=False)
class PaperReport:
    """Results of all experiments.

    Parameters
    ----------
    noise_mm : float
        Standard deviation along the ray at 400 mm. Units: mm.
    sizes : ExperimentSizes
        Number of measurements and scenes.
    rows : tuple of TableRow
        Rows of Tables 1-4.
    achievability : tuple of Achievability
        Comparison of the paper's printed errors with the bound of one section.
    timings : tuple of Timing
        Rows of Table 5; the only results that differ from run to run.
    steps : StepExample
        Intermediate results, for Figures 5-10.
    scenes : tuple of SceneFigure
        Scenes of Figures 14 and 15.
    repeatability : Repeatability
        Repeated measurements of Figure 16.
    ablation : tuple of AblationResult
        Errors with single steps changed or left out.
    pitfalls : tuple of Pitfall
        Misleading passages in the paper's wording.
    """

    noise_mm: float
    sizes: ExperimentSizes
    rows: tuple[TableRow, ...]
    achievability: tuple[Achievability, ...]
    timings: tuple[Timing, ...]
    steps: StepExample
    scenes: tuple[SceneFigure, ...]
    repeatability: Repeatability
    ablation: tuple[AblationResult, ...]
    pitfalls: tuple[Pitfall, ...]


def run_experiments(
    sizes: ExperimentSizes,
    *,
    noise_mm: float = PAPER_NOISE_MM,
    seed: int = 0,
    progress: ProgressCallback = lambda _: None,
) -> PaperReport:
    """Run all experiments of the paper on the simulator.

    The same seed gives the same results except for the times; `progress` is called with a short
    text before each experiment.

    Raises
    ------
    ValueError
        If the noise (standard deviation along the ray at 400 mm) is not in [0.001, 0.3] mm.
    """
    if not MIN_NOISE_MM <= noise_mm <= MAX_NOISE_MM:
        raise ValueError(
            f"expected noise_mm in [{MIN_NOISE_MM:g}, {MAX_NOISE_MM:g}], got {noise_mm:g}"
        )
    timings = time_conditions(sizes.timing_scenes, noise_mm=noise_mm, seed=seed, progress=progress)
    rows = measure_tables(
        list_paper_cases(), sizes.runs, noise_mm=noise_mm, seed=seed, progress=progress
    )
    progress("printed errors against the bound of one section")
    achievability = compare_with_bound(rows, noise_mm=noise_mm)
    progress("figures 5-10, 14 and 15")
    steps, scenes = run_steps(noise_mm=noise_mm), measure_scenes(noise_mm=noise_mm)
    progress(f"figure 16: {sizes.repeats} measurements of one position")
    repeatability = measure_repeatedly(sizes.repeats, noise_mm=noise_mm, seed=seed)
    ablation = run_ablation(sizes.ablation_scenes, noise_mm=noise_mm, seed=seed, progress=progress)
    return PaperReport(
        noise_mm=noise_mm,
        sizes=sizes,
        rows=rows,
        achievability=achievability,
        timings=timings,
        steps=steps,
        scenes=scenes,
        repeatability=repeatability,
        ablation=ablation,
        pitfalls=check_pitfalls(),
    )


def _order_runs(runs: Mapping[str, int]) -> dict[Method, int]:
    """Return the number of measurements by each method, in the order of `METHODS`."""
    return {method: runs[method] for method in METHODS}


def format_report_json(report: PaperReport) -> str:
    """Return the report as JSON text; the same report gives the same text.

    Lengths are in ``*_mm``, angles in ``*_deg``, times in ``*seconds``; NaN and infinity are null.
    Numbers of `Achievability` without a unit in their key are in that of its quantity. The keys
    "ways", "places_mm", "reach" and "traps" are those of the first version of the file.
    """
    document = {
        "schema": SCHEMA,
        "noise_mm": report.noise_mm,
        "effort": convert_to_plain(report.sizes),
        "ways": {key: {"letter": info.letter, "name": info.name, "places_mm": info.positions_mm}
                 for key, info in METHODS.items()},
        "tables_1_to_4": [convert_to_plain(row) for row in report.rows],
        "readme_table": format_readme_table(report.rows),
        "reach": [
            {**convert_to_plain(result), "chance": result.chance, "reachable": result.reachable}
            for result in report.achievability
        ],
        "table_5": [{**convert_to_plain(timing), "ratio": timing.ratio} for timing in
        report.timings], "figures_14_and_15": [_build_scene_record(scene) for scene in
        report.scenes], "figure_16": _build_repeatability_record(report.repeatability),
        "ablation_in_units_of_the_bound": [convert_to_plain(result) for result in report.ablation],
        "traps": [convert_to_plain(pitfall) for pitfall in report.pitfalls],
    }  # fmt: skip
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _build_scene_record(scene: SceneFigure) -> dict[str, Any]:
    return {"title": scene.title, "false": scene.false, "pipes": convert_to_plain(scene.pipes)}


def _build_repeatability_record(repeatability: Repeatability) -> dict[str, Any]:
    """Return the results of Figure 16 as a JSON object."""
    order = ("centre_x_mm", "centre_y_mm", "semi_major_mm", "semi_minor_mm")
    return {
        "measurements": len(repeatability.ellipses),
        "missed": repeatability.missed,
        "std": convert_to_plain(dict(zip(order, repeatability.stds_mm, strict=True))),
        "bound": dict(zip(order, repeatability.bound_stds_mm, strict=True)),
        "box_mm": repeatability.box_mm,
        "expected_box_mm": repeatability.expected_box_mm,
        "noise_of_printed_box_mm": repeatability.noise_of_printed_box_mm,
    }
