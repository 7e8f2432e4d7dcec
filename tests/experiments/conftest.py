"""A report of a few measurements, made once: its numbers are rough, its form is whole."""

import pytest

from lsvision.experiments.ablation import ablate
from lsvision.experiments.cases import paper_cases
from lsvision.experiments.printed import PRINTED_TIMES
from lsvision.experiments.reach import judge_tables
from lsvision.experiments.repeatability import measure_repeatedly
from lsvision.experiments.report import Effort, PaperReport
from lsvision.experiments.scenes import picture_scenes
from lsvision.experiments.steps import follow_steps
from lsvision.experiments.tables import measure_tables
from lsvision.experiments.timing import Chain, Timing
from lsvision.experiments.traps import check_traps

NOISE = 0.1  # mm
FEW = Effort(
    runs={"paper": 0, "section": 2, "known": 1, "two": 1, "twenty": 1},
    timing_scenes=1,
    repeats=40,
    ablation_scenes=3,
)


@pytest.fixture(scope="session")
def bounds():
    """Tables 1-4 with nothing measured: the bound alone."""
    runs = dict.fromkeys(FEW.runs, 0)
    return measure_tables(paper_cases(), runs, noise_mm=NOISE)


@pytest.fixture(scope="session")
def report():
    """Everything but the times, which are made up: 0.02 s against 2 s."""
    rows = measure_tables(paper_cases(), FEW.runs, noise_mm=NOISE)
    timings = [
        Timing(printed, 1, printed.pipes, Chain(2.0, 0, 7), Chain(0.02, printed.pipes, 0))
        for printed in PRINTED_TIMES
    ]
    return PaperReport(
        noise_mm=NOISE,
        effort=FEW,
        rows=rows,
        reaches=judge_tables(rows, noise_mm=NOISE),
        timings=tuple(timings),
        steps=follow_steps(noise_mm=NOISE),
        scenes=picture_scenes(noise_mm=NOISE),
        repeatability=measure_repeatedly(FEW.repeats, noise_mm=NOISE),
        costs=ablate(FEW.ablation_scenes, noise_mm=NOISE),
        traps=check_traps(),
    )
