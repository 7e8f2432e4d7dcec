"""``lsvision batch``: a Parquet file of cylinders for each file of profiles; resumable."""

import glob
import os
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.measure_options import build_measure_function
from lsvision.cli.messages import (
    FAILED,
    StatusLine,
    format_duration,
    print_error,
    print_lines,
    print_notes,
)
from lsvision.cli.option_groups import expand_option_groups
from lsvision.cli.profile_options import (
    KnownPhi,
    KnownRadius,
    Radius,
    ReadingOptions,
    SensorOptions,
)
from lsvision.cli.sources import find_sources, list_left_out, list_suffixes_of_profiles
from lsvision.errors import LsvisionError
from lsvision.files.file_kinds import STDIN, is_directory
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from lsvision.batch.manifest import Status
    from lsvision.batch.measure_file import BatchJob, FileOutcome, FileTask
    from lsvision.io.profiles import ReadOptions
    from lsvision.measure import Measurement


@expand_option_groups
def batch(
    *,
    ctx: typer.Context,
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="FILE|DIR|GLOB", help="Any number of files of profiles."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder of the results.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Processes on this machine [number of cores]."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Work on the cluster of this Dask scheduler."),
    ] = None,
    status: Annotated[
        Path | None,
        typer.Option(
            "--status",
            metavar="DIR",
            help="Print the progress of a batch, from its folder of results.",
        ),
    ] = None,
    job_file: Annotated[
        Path | None,
        typer.Option(
            "--job", metavar="F.toml", help="Measure and judge by this job; see lsvision job."
        ),
    ] = None,
    radius: Radius = None,
    known_radius: KnownRadius = None,
    known_phi_deg: KnownPhi = None,
    sensor: SensorOptions,
    reading: ReadingOptions,
) -> None:
    """Measure many files: one Parquet file of cylinders out for each file of profiles in.

    A cylinder is a row: source, profile, cylinder, the columns of ``lsvision measure --csv``, the
    other columns of the input (ids, times), reason and rejections; a profile without cylinders is a
    row with its reason. Of a folder the files directly in it are read, 'DIR/**/*.csv' names those
    in subfolders, too. Parquet (lists x and z, one profile per row) and NPY are read in parts, so
    that the memory does not grow with the file. _manifest.jsonl in the folder of the results, which
    can be read as one table, lists the finished files: the same command continues where the last
    one was interrupted, and measures files that are new, changed or failed, or whose results were
    changed.

    \b
    A folder of Parquet files, on all cores (with --job also judged: a column decision):
      lsvision batch profiles --out cylinders --radius 10:40
    Progress of a batch:
      lsvision batch --status cylinders
    On several machines (first `dask scheduler` on one, `dask worker tcp://HOST:8786` on each; the
    folders are shared):
      lsvision batch /data/profiles --out /data/cylinders --scheduler tcp://HOST:8786
    """  # noqa: D301 - the backspace makes click keep the line breaks
    if status is not None and _list_given_options(ctx) == ["status"]:
        _print_status(status)
        return
    if status is not None or not files or out is None:
        raise typer.BadParameter("expected files and --out DIR, or --status DIR alone")
    if scheduler is not None and jobs is not None:
        raise typer.BadParameter(
            "expected --jobs or --scheduler, got both: the workers of the scheduler decide how "
            "many processes they start"
        )
    from lsvision.batch.manifest import format_summary
    from lsvision.batch.process_pool import count_usable_cores
    from lsvision.batch.run import plan_tasks

    measure_function = build_measure_function(
        radius, known_radius, known_phi_deg, sensor.parse(), paper=False
    )
    options = reading.parse()
    job = _build_batch_job(measure_function, options, job_file)
    suffixes = list_suffixes_of_profiles(reading.dx)
    sources, any_missing = _find_sources(files, suffixes)
    print_lines(list_left_out(files, suffixes, out), err=True)
    tasks = plan_tasks(sources, _find_root(files), out, job)
    result = _run(tasks, out, jobs or count_usable_cores(), scheduler)
    names = [task.name for task in tasks]
    typer.echo(format_summary(result, names))
    if any_missing or any(result.outcomes[name].error for name in names):
        raise typer.Exit(FAILED)


def _run(tasks: "list[FileTask]", out: Path, jobs: int, scheduler: str | None) -> "Status":
    """Measure the files, and print the progress, errors and notes on stderr; return the state."""
    from lsvision.batch.run import run_batch

    report = _Report(len(tasks))
    try:
        status = run_batch(tasks, out, jobs=jobs, isolated=True, scheduler=scheduler, report=report)
    except KeyboardInterrupt:
        report.clear()
        report.print_notes()
        print_error(
            f"interrupted: {out} contains the finished files; the same command continues from there"
        )
        raise
    report.clear()
    report.print_notes()
    return status


def _list_given_options(ctx: typer.Context) -> list[str]:
    """Return the names of the arguments and options on the command line."""
    return [
        name
        for name in ctx.params
        if (source := ctx.get_parameter_source(name)) and source.name == "COMMANDLINE"
    ]


def _find_sources(names: Sequence[str], suffixes: frozenset[str]) -> tuple[list[Path], bool]:
    """Return the files, at least one, and whether any is missing, which is printed as an error."""
    sources, missing = find_sources(names, suffixes)
    if Path(STDIN) in sources:
        raise typer.BadParameter("expected files on a disk, got - for standard input")
    for failure in missing:
        print_error(str(failure))
    if not sources:
        raise typer.Exit(FAILED)
    return sources, bool(missing)


def _build_batch_job(
    measure_function: "partial[list[Measurement]]", options: "ReadOptions", path: Path | None
) -> "BatchJob":
    """Return the settings of the batch, from the options or from the job file `path`.

    Raises
    ------
    typer.BadParameter
        If options of the measurement are given beside a job file.
    LsvisionError
        If the job file cannot be used, is one for scans or images, or limits what profiles do not
        have.
    """
    from lsvision.batch.measure_file import BatchJob

    if path is None:
        return BatchJob(measure_function, options)
    if any(value is not None for value in measure_function.keywords.values()):
        raise typer.BadParameter("expected --job or options of the measurement, got both")
    from lsvision.inspection.job import Job
    from lsvision.inspection.measuring import measure_profiles_of_job
    from lsvision.inspection.unused_keys import describe_rejected_keys, describe_unused_keys

    job = Job.load(path)
    if (unused := describe_unused_keys(job)) is not None:
        print_error(f"{path}: note: {unused}")
    if job.golden is not None:
        print_error(f"{path}: note: batch does not check the golden part, as lsvision inspect does")
    if job.scan is not None or job.rig.light_section is not None:
        raise LsvisionError(
            f"{path}: expected a job for profiles, got one for scans or images: use lsvision "
            "inspect"
        )
    if (rejected := describe_rejected_keys(job)) is not None:
        raise LsvisionError(f"{path}: {rejected}")
    return BatchJob(partial(measure_profiles_of_job, job=job), options, job)


def _find_root(names: Sequence[str]) -> Path:
    """Return the folder that holds all files that the names denote, present and future ones.

    Results are named relative to it: files that are added to a folder or pattern change no names.
    """
    return Path(os.path.commonpath([_find_folder(name) for name in names if name]))


def _find_folder(name: str) -> str:
    """Return the absolute folder of a file, folder or pattern; of a pattern the part without it."""
    folder = Path(name) if is_directory(name) else Path(name).parent
    while glob.has_magic(str(folder)) and not is_directory(folder):
        folder = folder.parent
    return os.path.abspath(folder)  # noqa: PTH100 - Path.absolute keeps the ".." of a name


def _print_status(folder: Path) -> None:
    """Print the summary of a batch, its failed files, and the results that were changed."""
    from lsvision.batch.manifest import (
        MANIFEST,
        find_changed_results,
        format_summary,
        read_status,
    )

    status = read_status(folder)
    if status is None:
        raise LsvisionError(f"{folder / MANIFEST}: no such file: name the --out of a batch")
    changes = find_changed_results(folder, status)
    print_lines(
        [
            format_summary(status, changed=changes),
            *(f"  {outcome.error}" for outcome in status.failed),
            *(
                f"  {folder / status.outputs[name]}: changed or deleted after it was written "
                f"({change}): the next run measures {name} again"
                for name, change in changes.items()
            ),
        ]
    )


class _Report(StatusLine):
    """Progress on stderr, and a line per failure; a `Report` of `run_batch`.

    `total` includes the files that an earlier run has measured.
    """

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total, self._start = total, time.monotonic()
        self._files = self._profiles = 0
        self._list_notes: dict[str, list[str]] = {}

    def __call__(self, outcome: "FileOutcome", left: int) -> None:
        self._files += 1
        self._profiles += outcome.profiles
        for note in outcome.notes:
            self._list_notes.setdefault(note, []).append(outcome.name)
        if outcome.error:
            self.clear()
            print_error(outcome.error)
        seconds = max(time.monotonic() - self._start, 1e-3)
        self.write(
            f"{self._total - left}/{self._total} files, {format_count(self._profiles, 'profile')}, "
            f"{self._profiles / seconds:.0f}/s, "
            f"{format_duration(seconds / self._files * left)} left"
        )

    def print_notes(self) -> None:
        """Print what was assumed in reading the files, each remark once."""
        print_notes(self._list_notes)
