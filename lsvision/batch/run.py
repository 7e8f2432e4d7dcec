"""Run of a batch: writes a Parquet file for each file of profiles, and a manifest."""

import importlib.util
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from lsvision.batch.cluster import run_on_cluster
from lsvision.batch.job import BatchJob
from lsvision.batch.manifest import Manifest, Status, read_status
from lsvision.batch.measure_file import FileOutcome, FileTask, measure_file
from lsvision.batch.process_pool import EndedProcess, Finished, run_tasks
from lsvision.errors import LsvisionError
from lsvision.files.limited_reading import current_size_limit
from lsvision.files.printable import printable_name

Report = Callable[[FileOutcome], None]
"""Function that is called with the outcome of each file."""


def plan_tasks(sources: Sequence[Path], root: Path, folder: Path, job: BatchJob) -> list[FileTask]:
    """Return the tasks of a batch, each with the file that its results are written to.

    Parameters
    ----------
    sources : sequence of Path
        Files of profiles.
    root : Path
        Absolute folder that holds all files; their names in the results are relative to it.
    folder : Path
        Folder of the results: ``part.parquet`` goes to ``part.parquet``, ``a.csv`` to
        ``a.csv.parquet``.
    job : BatchJob
        Settings with which the files are read and measured.

    Raises
    ------
    LsvisionError
        If results would overwrite a source or each other, or are among the sources.
    """
    tasks: dict[Path, FileTask] = {}
    folder = folder.absolute()
    for source in map(Path.absolute, sources):
        name = source.relative_to(root)
        suffix = "" if name.suffix.lower() == ".parquet" else ".parquet"
        output = folder / name.with_name(name.name + suffix)
        if source.resolve().is_relative_to(folder.resolve()):
            raise LsvisionError(
                f"{source}: it lies in the folder of the results: name another --out"
            )
        if output in tasks:
            raise LsvisionError(
                f"{source} and {tasks[output].source}: both would become {output}: rename one"
            )
        tasks[output] = FileTask(source, output, printable_name(name), job, current_size_limit())
    return list(tasks.values())


def run_batch(
    tasks: Sequence[FileTask],
    folder: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    report: Report = lambda _: None,
) -> Status:
    """Measure the files that are not done yet.

    Parameters
    ----------
    tasks : sequence of FileTask
        Files of one job.
    folder : Path
        Folder of the results and the manifest.
    jobs : int
        Number of processes on this machine.
    scheduler : str, optional
        Address of a Dask scheduler, which takes the place of the processes.
    report : callable
        Function that is called with the outcome of each file, as soon as it is in the manifest.

    Returns
    -------
    Status
        State after the run.

    Raises
    ------
    LsvisionError
        If the folder holds results of another job or cannot be written, or the scheduler goes
        away; finished files are kept.
    """
    if not tasks:
        raise ValueError("expected at least one file, got none")
    if importlib.util.find_spec("pyarrow") is None:
        raise LsvisionError("a batch needs pyarrow: pip install 'lsvision[batch]'")
    with Manifest(folder, tasks[0].job) as manifest:
        status = read_status(folder)
        open_tasks = [task for task in tasks if status is None or not status.is_done(task)]
        manifest.begin(len(tasks))
        for task in open_tasks:
            task.output.parent.mkdir(parents=True, exist_ok=True)
        for task, value in _run_tasks(open_tasks, jobs, scheduler):
            ended = isinstance(value, EndedProcess)
            outcome = value if isinstance(value, FileOutcome) else _outcome_of_ended_process(task)
            manifest.add(outcome, set_aside=ended)
            report(outcome)
    status = read_status(folder)
    if status is None:
        raise LsvisionError(
            f"{folder}: the manifest was removed during the run: run the batch again"
        )
    return status


def _run_tasks(
    tasks: Iterable[FileTask], jobs: int, scheduler: str | None
) -> Iterator[Finished[FileTask, FileOutcome]]:
    """Return an iterator over tasks and outcomes, in the order in which they are finished."""
    if scheduler is not None:
        return run_on_cluster(measure_file, tasks, scheduler)
    return run_tasks(measure_file, tasks, jobs, ordered=False)


def _outcome_of_ended_process(task: FileTask) -> FileOutcome:
    """Return the outcome of a file in which the measuring process ended, with the reason."""
    return FileOutcome(
        task.name,
        error=f"{task.source}: it ended its process twice (out of memory, or a crash): set aside",
    )
