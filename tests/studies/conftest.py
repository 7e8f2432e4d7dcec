"""A report of a few measurements, its parts made once: rough numbers, but the whole form."""

import pytest

from lsvision.studies.chen_liu_2016.ablation import run_ablation
from lsvision.studies.chen_liu_2016.achievability import compare_with_bound
from lsvision.studies.chen_liu_2016.cases import list_paper_cases
from lsvision.studies.chen_liu_2016.paper_pitfalls import check_pitfalls
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_TIMES
from lsvision.studies.chen_liu_2016.repeatability import measure_repeatedly
from lsvision.studies.chen_liu_2016.report import ExperimentSizes, PaperReport
from lsvision.studies.chen_liu_2016.scenes import PipelineTiming, Timing, measure_scenes
from lsvision.studies.chen_liu_2016.steps import run_steps
from lsvision.studies.chen_liu_2016.tables import measure_tables

NOISE = 0.1  # mm
FEW = ExperimentSizes(
    runs={"paper": 0, "section": 2, "known": 1, "two": 1, "twenty": 0},
    timing_scenes=1,
    repeats=40,
    ablation_scenes=3,
)


@pytest.fixture(scope="session")
def bounds():
    """Tables 1-4 with nothing measured: the bound alone."""
    runs = dict.fromkeys(FEW.runs, 0)
    return measure_tables(list_paper_cases(), runs, noise_mm=NOISE)


@pytest.fixture(scope="session")
def reaches(bounds):
    """The printed errors beside the bound of one section."""
    return compare_with_bound(bounds, noise_mm=NOISE)


@pytest.fixture(scope="session")
def ablation():
    """Errors of every variant on a dozen pipes."""
    return run_ablation(FEW.ablation_scenes, noise_mm=NOISE)


@pytest.fixture(scope="session")
def repeatability():
    """Figure 16."""
    return measure_repeatedly(FEW.repeats, noise_mm=NOISE)


@pytest.fixture(scope="session")
def scenes():
    """Figures 14 and 15."""
    return measure_scenes(noise_mm=NOISE)


@pytest.fixture(scope="session")
def report(reaches, ablation, repeatability, scenes):
    """Everything but the times, which are made up: 0.02 s against 2 s."""
    timings = [
        Timing(
            printed,
            1,
            printed.pipes,
            PipelineTiming(2.0, 0, 7),
            PipelineTiming(0.02, printed.pipes, 0),
        )
        for printed in PUBLISHED_TIMES
    ]
    return PaperReport(
        noise_mm=NOISE,
        sizes=FEW,
        rows=measure_tables(list_paper_cases(), FEW.runs, noise_mm=NOISE),
        achievability=reaches,
        timings=tuple(timings),
        steps=run_steps(noise_mm=NOISE),
        scenes=scenes,
        repeatability=repeatability,
        ablation=ablation,
        pitfalls=check_pitfalls(),
    )
