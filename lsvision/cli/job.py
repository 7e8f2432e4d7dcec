"""``lsvision job``: new, check and schema of a job file."""

import datetime
import json
import math
from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.messages import FAILED, print_error, print_lines
from lsvision.cli.option_groups import build_command_group, expand_option_groups
from lsvision.cli.outputs import check_outputs, write_output
from lsvision.cli.profile_options import Radius, ReadingOptions
from lsvision.files.file_kinds import STDOUT, is_regular

job = build_command_group(
    "job", "Make and check a job file: the parts to measure and their limits."
)

JobFile = Annotated[Path, typer.Argument(metavar="JOB.toml", help="The job file.")]


@job.command("new")
@expand_option_groups
def new_job(
    *,
    profile: Annotated[Path, typer.Argument(metavar="PROFILE", help="A profile of good parts.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="JOB.toml", help="The job; - is standard output.")
    ] = STDOUT,
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the job.")] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            min=1e-6, metavar="MM", help="Tolerance of each radius, to either side, and of gaps."
        ),
    ] = 0.1,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing --out.")] = False,
    radius: Radius = None,
    reading: ReadingOptions,
) -> None:
    """Write a commented job from a measured profile: these pipes with a tolerance.

    Of a file with several profiles the first is measured. Options for reading are not part of the
    job: inspect takes the same ones. An existing file, whose limits may have been edited, is only
    replaced with --force.

    \b
      lsvision job new fixtures/welded_pair.csv --radius 10:60 --tolerance 0.3 -o pair.toml
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.cli.measure_options import parse_search_range
    from lsvision.cli.sources import read_sources
    from lsvision.errors import LsvisionError, UnwritableFile
    from lsvision.inspection.job import Job
    from lsvision.inspection.job_template import build_job_text, find_needed_tolerance
    from lsvision.measure import measure_cylinders

    if not math.isfinite(tolerance):
        raise typer.BadParameter(f"expected a finite --tolerance in mm, got {tolerance:g}")
    options = reading.parse()
    search = parse_search_range(radius)
    check_outputs((), [profile], streams=(out,))
    if is_regular(out) and not force:
        raise UnwritableFile(f"{out}: it exists: name another file, or replace it with --force")
    (file,) = read_sources([profile], options)
    measurement = measure_cylinders(file.profiles[0], radius=search)
    if not measurement.cylinders:
        raise LsvisionError(f"{profile}: no cylinder for a job: {measurement.reason}")
    text = build_job_text(name or profile.stem, measurement.cylinders, tolerance)
    write_output(out, text)
    needed = find_needed_tolerance(Job.from_text(text), measurement.cylinders)
    if needed is not None:
        print_error(
            f"{profile}: note: undecided by this job: its tolerance of {tolerance:g} mm does "
            f"not contain the intervals of radii and gaps, --tolerance {needed:g} does; a stated "
            "noise or several sections make them narrower"
        )


@job.command("check")
def check_job(
    path: JobFile,
    record: Annotated[
        bool,
        typer.Option("--record", help="Record this revision in the history beside the file."),
    ] = False,
) -> None:
    """Print every mistake of a job file with its line and the remedy, or a summary of the job.

    \b
      lsvision job check fixtures/jobs/welded_pair.toml
      lsvision job check job.toml --record
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.errors import InvalidJob
    from lsvision.inspection.calibration_files import check_calibration_files
    from lsvision.inspection.history import (
        build_history_path,
        describe_unrecorded_change,
        record_revision,
    )
    from lsvision.inspection.job import Job
    from lsvision.inspection.unused_keys import describe_rejected_keys, describe_unused_keys

    try:
        checked = Job.load(path)
    except InvalidJob as error:
        for mistake in error.mistakes:
            print_error(f"{path}: {mistake}")
        raise typer.Exit(FAILED) from None
    check_calibration_files(checked, path)
    parts = ", ".join(part.name for part in checked.parts)
    lines = [
        f"{path}: {checked.name}, revision {checked.revision}, hash {checked.hash[:12]}",
        f"  parts: {parts}; relations: {len(checked.relations)}",
    ]
    if record:
        now = datetime.datetime.now(datetime.UTC)
        state = "recorded in" if record_revision(checked, path, now) else "is already in"
        lines.append(f"  revision {checked.revision} {state} {build_history_path(path).name}")
    elif note := describe_unrecorded_change(checked, path):
        lines.append(f"  note: {note}")
    notes = (describe_unused_keys(checked), describe_rejected_keys(checked))
    lines += [f"  note: {text}" for text in notes if text]
    print_lines(lines)


@job.command("schema")
def write_schema(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="F", help="The file; - is standard output.")
    ] = STDOUT,
) -> None:
    """Write the JSON Schema of job files, by which editors complete and check them.

    \b
      lsvision job schema --out job.schema.json
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.inspection.job import Job

    check_outputs((), (), streams=(out,))
    write_output(out, json.dumps(Job.model_json_schema(), indent=2) + "\n")
