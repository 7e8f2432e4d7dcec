"""Measure files, or images of a camera, in order; an error in one does not stop the rest."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.chunk_results import ChunkResult, MeasureTask, format_error, measure_task
from lsvision.cli.file_chunk import FileChunk, FileOptions, read_chunks, read_whole
from lsvision.cli.image_sources import ImageFile, LiveCamera, is_image
from lsvision.cli.messages import Progress, print_error, print_lines
from lsvision.cli.outputs import Pictures
from lsvision.files.file_kinds import is_regular

if TYPE_CHECKING:
    from lsvision.io.result_files import ResultFiles

MAX_SMALL_FILE_BYTES = 5 * 10**4
"""Largest file that is measured in one task together with others. Larger ones are read by the main
process and divided into tasks, so that all processes work on one file."""
TASK_SIZE = 32
"""Number of small files, or of profiles of a larger file, in a task, all of which are measured at
once (`lsvision.measure.PROFILES_AT_ONCE`). It does not depend on the number of processes, so that
the results do not, either."""
MIN_BYTES_FOR_PROCESSES = 2 * 10**6
"""Smallest total size of the files (about 250 profiles of 400 points) for which several processes,
which take a second to start, save time."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options for measuring files and for the outputs.

    Without `pictures` none are drawn; each result is written to `results` immediately. `jobs` is
    the number of processes; None: the number of cores if the files are large enough, else 1. Tables
    are printed on standard error if results go to standard output.
    """

    options: FileOptions
    pictures: Pictures | None = None
    results: "ResultFiles | None" = None
    jobs: int | None = 1
    table_to_stderr: bool = False


def measure_sources(sources: Sequence[Path | LiveCamera], run: RunOptions) -> int:
    """Measure files in order; print, write and draw their results.

    Return the number of files that could not be measured or drawn, each of which is reported on
    stderr. The output is the same for any number of processes.

    Raises
    ------
    LsvisionError
        With poses of a robot, if they cannot be paired with the profiles: a file cannot be read, or
        there are not as many poses as profiles.
    KeyboardInterrupt
        If the run is interrupted; reported on stderr.
    """
    progress, failed = Progress(len(sources)), set[int]()
    try:
        for number, result in _iterate_results(sources, run, progress):
            progress.clear()
            if run.results is not None:
                run.results.add(result.records)
            if result.lines:
                print_lines(result.lines, err=run.table_to_stderr)
            for error in result.errors:
                print_error(error)
                failed.add(number)
    except KeyboardInterrupt:
        progress.clear()
        print_error(f"interrupted: {progress.done} of {len(sources)} were measured")
        raise
    progress.clear()
    return len(failed)


def _iterate_results(
    sources: Sequence[Path | LiveCamera], run: RunOptions, progress: Progress
) -> Iterator[tuple[int, ChunkResult]]:
    """Yield the number of a file and a result, in the order of the files and their profiles."""
    from lsvision.batch.process_pool import EndedProcess, run_tasks

    measure, jobs = partial(measure_task, run.options), _count_jobs(sources, run)
    tasks = _iterate_tasks(sources, run, _read_with_poses(sources, run.options))
    progress.show(0, str(sources[0]) if sources else "")
    for task, results in run_tasks(measure, tasks, jobs, ordered=True):
        _show_progress(progress, task)
        if not isinstance(results, EndedProcess):
            yield from enumerate(results, task.first)
        elif len(task.sources) == 1:
            yield task.first, _build_crash_result(task.sources[0])
        else:  # measure each file in a task of its own, to find the one that ends its process
            singles = (
                MeasureTask(k, (source,)) for k, source in enumerate(task.sources, task.first)
            )
            for single, single_results in run_tasks(measure, singles, jobs, ordered=True):
                if isinstance(single_results, EndedProcess):
                    yield single.first, _build_crash_result(single.sources[0])
                else:
                    yield single.first, single_results[0]


def _build_crash_result(source: Path | LiveCamera) -> ChunkResult:
    """Return the error of a file whose measurement ended its process."""
    message = f"{source}: it ended its process twice (out of memory, or a crash)"
    return ChunkResult(errors=[message])


def _show_progress(progress: Progress, task: MeasureTask) -> None:
    """Show how many files are done, and how many profiles of a larger one."""
    name = str(task.sources[-1])
    if task.chunk is None:
        progress.show(task.first + len(task.sources), name)
    else:
        progress.show(
            task.first, name, task.chunk.first + len(task.chunk), max(task.profiles_read, 1)
        )


def _count_jobs(sources: Sequence[Path | LiveCamera], run: RunOptions) -> int:
    """Return the number of processes: as stated, else 1 unless there is much to do.

    With ``--debug`` 1, so that one process only prints tracebacks.
    """
    if run.jobs is not None:
        return run.jobs
    if run.options.debug or sum(map(_read_size_bytes, sources)) < MIN_BYTES_FOR_PROCESSES:
        return 1
    from lsvision.batch.process_pool import count_usable_cores

    return count_usable_cores()


def _read_size_bytes(source: Path | LiveCamera) -> int:
    """Return the size of a regular file; 0 for a camera, a pipe or a missing file."""
    if isinstance(source, LiveCamera) or not is_regular(source):
        return 0
    return source.stat().st_size


def _read_with_poses(
    sources: Sequence[Path | LiveCamera], options: FileOptions
) -> dict[int, FileChunk]:
    """Return all files by their numbers, each profile with its pose; empty without a pose file.

    All profiles are read first, because the number of poses must equal theirs.
    """
    if options.robot_frame is None or options.robot_frame.pose_file is None:
        return {}
    files = [read_whole(source, options) for source in sources]
    poses = iter(options.robot_frame.pose_file.read(sum(map(len, files))))
    return {
        number: replace(file, flanges=[next(poses) for _ in range(len(file))])
        for number, file in enumerate(files)
    }


def _iterate_tasks(
    sources: Sequence[Path | LiveCamera], run: RunOptions, read_files: dict[int, FileChunk]
) -> Iterator[MeasureTask]:
    """Yield tasks: several small files each, or chunks of a larger file.

    `read_files` holds the files that are read already, from `_read_with_poses`: all or none.
    """
    numbers = range(len(sources))
    for small, group in groupby(numbers, lambda k: not read_files and _is_small(sources[k], run)):
        if not small:
            for number in group:
                yield from _iterate_tasks_of_file(number, sources[number], run, read_files)
        else:
            while files := list(islice(group, TASK_SIZE)):
                yield MeasureTask(files[0], tuple(sources[number] for number in files))


def _is_small(source: Path | LiveCamera, run: RunOptions) -> bool:
    """Return whether a file is measured together with others: small, no image, and not drawn."""
    if run.pictures is not None or isinstance(source, LiveCamera) or is_image(source):
        return False
    return 0 < _read_size_bytes(source) <= MAX_SMALL_FILE_BYTES


def _iterate_tasks_of_file(
    number: int, source: Path | LiveCamera, run: RunOptions, read_files: dict[int, FileChunk]
) -> Iterator[MeasureTask]:
    """Yield the tasks of the chunks of a file, or one with the error of reading it."""
    try:
        for file_chunk in [read_files[number]] if read_files else read_chunks(source, run.options):
            chunk = _with_pictures(file_chunk, run.pictures)
            profiles_read = chunk.first + len(chunk)
            task_size = 1 if isinstance(chunk.file, ImageFile) else TASK_SIZE
            for task_chunk in chunk.split(task_size):
                yield MeasureTask(number, (source,), task_chunk, profiles_read)
    except Exception as error:  # noqa: BLE001 - a bug in one file must not stop the run
        yield MeasureTask(number, (source,), error=format_error(source, error, run.options))


def _with_pictures(chunk: FileChunk, pictures: Pictures | None) -> FileChunk:
    """Return the chunk with a path for the picture of each profile; unused without valid points."""
    if pictures is None:
        return chunk
    paths = []
    for index, profile in enumerate(chunk.file.profiles):
        number = chunk.first + index if chunk.several else None
        is_drawn = profile.lost < len(profile)
        paths.append(pictures.assign_path(chunk.file.path, number) if is_drawn else Path())
    return replace(chunk, pictures=paths)
