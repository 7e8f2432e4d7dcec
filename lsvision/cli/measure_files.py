"""Many files, or images of a camera, in order; an error in one does not stop the rest."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.file_part import (
    FilePart,
    PartOptions,
    PartResult,
    error_text,
    measure_file,
    measure_part,
    read_parts,
    read_whole,
)
from lsvision.cli.image_sources import LiveCamera
from lsvision.cli.messages import print_error, print_lines
from lsvision.cli.outputs import Pictures
from lsvision.cli.progress import Progress
from lsvision.files.file_kinds import is_regular

if TYPE_CHECKING:
    from lsvision.io.result_files import ResultFiles

MAX_SIZE_IN_PROCESS = 4 * 10**6
"""Largest file that a process reads by itself; larger ones are read by the main process and
measured in parts, so that one file occupies all processes. Units: bytes."""
PROFILES_PER_TASK = 16
"""Number of profiles in a part that is sent to a process."""
MIN_SIZE_FOR_PROCESSES = 2 * 10**6
"""Total size of the files above which several processes, which take a second to start, save time:
about 250 profiles of 400 points. Units: bytes."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How files are measured, and what is written and drawn.

    Parameters
    ----------
    part : PartOptions
        How files are read and measured.
    pictures : Pictures, optional
        Names of the pictures; without, none is drawn.
    results : ResultFiles, optional
        Files to which each result is written at once.
    jobs : int, optional
        Number of processes; by default one, or for many files the number of cores.
    table_to_stderr : bool
        Print the tables on standard error, because results go to standard output.
    """

    part: PartOptions
    pictures: Pictures | None = None
    results: "ResultFiles | None" = None
    jobs: int | None = 1
    table_to_stderr: bool = False


@dataclass(frozen=True, eq=False)
class _Task:
    """A whole file, a part of it, or the error of reading it."""

    number: int
    source: Path | LiveCamera
    part: FilePart | None = None
    error: str = ""


def measure_sources(sources: Sequence[Path | LiveCamera], run: RunOptions) -> int:
    """Measure files in order; print, write and draw the results of each.

    Parameters
    ----------
    sources : sequence of Path or LiveCamera
        The files.
    run : RunOptions
        How they are measured, and what is written. The output is the same for any number of
        processes.

    Returns
    -------
    int
        Number of files that could not be measured or drawn; each is reported on stderr.

    Raises
    ------
    LsvisionError
        With poses of a robot: if a file cannot be read, or there are not as many poses as profiles,
        so that poses and profiles cannot be paired.
    KeyboardInterrupt
        If the run is interrupted; reported on stderr.
    """
    progress, failed = Progress(len(sources)), set[int]()
    try:
        for task, result in _results(sources, run, progress):
            progress.clear()
            if run.results is not None:
                run.results.add(result.records)
            if result.lines:
                print_lines(result.lines, err=run.table_to_stderr)
            for error in result.errors:
                print_error(error)
                failed.add(task.number)
    except KeyboardInterrupt:
        progress.clear()
        print_error(f"interrupted: {progress.done} of {len(sources)} were measured")
        raise
    progress.clear()
    return len(failed)


def _results(
    sources: Sequence[Path | LiveCamera], run: RunOptions, progress: Progress
) -> Iterator[tuple[_Task, PartResult]]:
    """Yield the results in the order of the files and their profiles."""
    jobs = _count_jobs(sources, run)
    read_files = _read_with_poses(sources, run.part)
    if jobs == 1:
        for number, source in enumerate(sources):
            progress.show(number, str(source))
            for task in _tasks_of_file(number, source, run, read_files):
                for each in _slices(task, 1):
                    if task.part is not None and each.part is not None:
                        profiles_read = task.part.first + len(task.part)
                        progress.show(number, str(source), each.part.first, profiles_read)
                    yield each, _measure(run.part, each)
        return
    from lsvision.batch.process_pool import EndedProcess, run_tasks

    in_parts = run.pictures is not None or len(sources) < 2 * jobs or bool(read_files)
    tasks = _tasks_for_processes(sources, run, read_files, in_parts=in_parts)
    for task, found in run_tasks(partial(_measure, run.part), tasks, jobs, ordered=True):
        progress.show(task.number, str(task.source))
        if isinstance(found, EndedProcess):
            ended = f"{task.source}: it ended its process twice (out of memory, or a crash)"
            yield task, PartResult(errors=[ended])
        else:
            yield task, found


def _count_jobs(sources: Sequence[Path | LiveCamera], run: RunOptions) -> int:
    """Return the number of processes: as stated, or 1 unless there is much to do."""
    if run.jobs is not None:
        return run.jobs
    if run.part.debug or sum(map(_size, sources)) < MIN_SIZE_FOR_PROCESSES:
        return 1
    from lsvision.batch.process_pool import default_jobs

    return default_jobs()


def _size(source: Path | LiveCamera) -> int:
    if isinstance(source, LiveCamera) or not is_regular(source):
        return 0
    return source.stat().st_size


def _measure(options: PartOptions, task: _Task) -> PartResult:
    if task.error:
        return PartResult(errors=[task.error])
    if task.part is not None:
        return measure_part(options, task.part)
    return measure_file(options, Path(str(task.source)))


def _slices(task: _Task, count: int) -> Iterator[_Task]:
    """Yield a task in parts of at most `count` profiles."""
    if task.part is None:
        yield task
    else:
        yield from (replace(task, part=part) for part in task.part.slices(count))


def _read_with_poses(
    sources: Sequence[Path | LiveCamera], options: PartOptions
) -> dict[int, FilePart]:
    """Read the files by their numbers, and pair their profiles with poses; empty without poses."""
    if options.placing is None or options.placing.rows is None:
        return {}
    files = [read_whole(source, options) for source in sources]
    poses = iter(options.placing.rows.read(sum(map(len, files))))
    return {
        number: replace(file, flanges=[next(poses) for _ in range(len(file))])
        for number, file in enumerate(files)
    }


def _tasks_for_processes(
    sources: Sequence[Path | LiveCamera],
    run: RunOptions,
    read_files: dict[int, FilePart],
    *,
    in_parts: bool,
) -> Iterator[_Task]:
    """Yield files that the processes read, and parts of large ones; or parts of all files."""
    for number, source in enumerate(sources):
        if not in_parts and 0 < _size(source) <= MAX_SIZE_IN_PROCESS:
            yield _Task(number, source)
        else:
            for task in _tasks_of_file(number, source, run, read_files):
                yield from _slices(task, PROFILES_PER_TASK)


def _tasks_of_file(
    number: int, source: Path | LiveCamera, run: RunOptions, read_files: dict[int, FilePart]
) -> Iterator[_Task]:
    """Read a file and yield its parts, or a task with the error."""
    try:
        for part in [read_files[number]] if read_files else read_parts(source, run.part):
            yield _Task(number, source, _with_pictures(part, run.pictures))
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        yield _Task(number, source, error=error_text(source, error, run.part))


def _with_pictures(part: FilePart, pictures: Pictures | None) -> FilePart:
    """Return the part with a name for the picture of each profile that has points."""
    if pictures is None:
        return part
    paths = [
        pictures.path_of(part.file.path, part.first + place, 2 if part.several else 1)
        if profile.lost < len(profile)
        else Path()
        for place, profile in enumerate(part.file.profiles)
    ]
    return replace(part, pictures=paths)
