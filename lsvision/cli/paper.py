"""``lsvision paper``: the paper's tables and figures, run again, as one page."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.messages import print_lines
from lsvision.cli.outputs import STDOUT, check_outputs, write_output

DEFAULT_PAGE = Path("report.html")


def paper(
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="F.html", help="The page, one HTML file that needs no other."
        ),
    ] = DEFAULT_PAGE,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="F", help="The same numbers as JSON.")
    ] = None,
    full: Annotated[
        bool,
        typer.Option(
            "--full", help="More sections, for narrower confidence intervals: about ten minutes."
        ),
    ] = False,
    noise_mm: Annotated[
        float,
        typer.Option(
            metavar="MM",
            min=0.001,
            max=0.3,
            help="Noise of a point, one sigma along the ray at 400 mm.",
        ),
    ] = 0.1,
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Seed of the first measurement.")
    ] = 0,
) -> None:
    """Run the paper's experiments again and assess its results.

    Its Tables 1-5 and Figures 5-16 on the simulator: the paper's pipeline as published, lsvision
    from one section, with a known radius, from two sections and from twenty, each beside the
    published number and the Cramer-Rao bound. Takes a minute or two; the same command gives the
    same numbers, except for times.

    \b
      lsvision paper --out report.html
      lsvision paper --full --out report.html --json report.json
      lsvision paper --noise-mm 0.02 --out low_noise.html
    """  # noqa: D301 - the backspace makes click keep the line breaks
    check_outputs((), (), streams=(out, json))
    from lsvision.studies.chen_liu_2016 import (
        ExperimentSizes,
        report_json,
        report_page,
        run_experiments,
    )

    sizes = ExperimentSizes.full() if full else ExperimentSizes.quick()
    report = run_experiments(sizes, noise_mm=noise_mm, seed=seed, progress=_log_progress)
    _log_progress("drawing the page")
    write_output(out, report_page(report))
    if json is not None:
        write_output(json, report_json(report))
    print_lines([f"{out}" if json is None else f"{out} and {json}"], err=STDOUT in (out, json))


def _log_progress(text: str) -> None:
    """Write a line of progress on stderr."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
