"""``lsvision paper``: repeat the experiments of Chen and Liu (2016), and write an HTML report."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.messages import print_lines
from lsvision.cli.outputs import check_outputs, write_output
from lsvision.files.file_kinds import STDOUT

DEFAULT_REPORT_PATH = Path("report.html")
"""Default of --out, in the current folder."""


def paper(
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="F.html", help="Report, as one self-contained HTML file."
        ),
    ] = DEFAULT_REPORT_PATH,
    json: Annotated[
        Path | None,
        typer.Option("--json", metavar="F", help="Write the numbers of the report as JSON, too."),
    ] = None,
    full: Annotated[
        bool,
        typer.Option(
            "--full",
            help="Simulate more sections, for narrower confidence intervals; takes ten minutes.",
        ),
    ] = False,
    noise_mm: Annotated[
        float,
        typer.Option(
            metavar="MM",
            min=0.001,
            max=0.3,
            help="Noise of a point: one sigma along the laser's ray, stated at a range of 400 mm.",
        ),
    ] = 0.1,
    seed: Annotated[
        int,
        typer.Option(metavar="N", min=0, help="Random seed of the first simulated measurement."),
    ] = 0,
) -> None:
    """Repeat the experiments of the paper on simulated data, and compare their results.

    The report has the paper's Tables 1-5 and Figures 5-16. It compares five methods: the paper's
    pipeline as published, and lsvision's measurement of one section, of one section with a known
    radius, of two sections and of twenty. Each result is shown beside the published one and the
    Cramer-Rao bound. Takes a minute or two; the same command gives the same numbers, except for
    times.

    \b
      lsvision paper --out report.html
      lsvision paper --full --out report.html --json report.json
      lsvision paper --noise-mm 0.02 --out low_noise.html
    """  # noqa: D301 - the backspace makes click keep the line breaks
    # Before the experiments, which take a minute or more.
    check_outputs(outputs=(), sources=(), streams=(out, json))
    from lsvision.studies.chen_liu_2016 import (
        ExperimentSizes,
        format_report_json,
        render_report_page,
        run_experiments,
    )

    sizes = ExperimentSizes.full() if full else ExperimentSizes.quick()
    report = run_experiments(sizes, noise_mm=noise_mm, seed=seed, progress=_log_progress)
    _log_progress("drawing the report")
    write_output(out, render_report_page(report))
    if json is not None:
        write_output(json, format_report_json(report))
    names = " and ".join(str(path) for path in (out, json) if path is not None)
    print_lines([names], err=STDOUT in (out, json))


def _log_progress(text: str) -> None:
    """Write a line of progress to stderr at once; stdout may get the report."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
