"""Tasks that run in several processes of this machine, a limited number of them at a time."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Generic, NamedTuple, TypeVar

Task = TypeVar("Task")
Value = TypeVar("Value")

IN_FLIGHT_PER_JOB = 3
"""Number of unfinished tasks per process: one that runs, and others that wait."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that limit the threads of linear algebra to one per process."""


@dataclass(frozen=True)
class EndedProcess:
    """Result of a task that ended its process twice (out of memory, or a crash)."""


class Finished(NamedTuple, Generic[Task, Value]):
    """A task and what its function returned."""

    task: Task
    value: Value | EndedProcess


def default_jobs() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows
        return os.cpu_count() or 1


def run_tasks(
    function: Callable[[Task], Value], tasks: Iterable[Task], jobs: int, *, ordered: bool
) -> Iterator[Finished[Task, Value]]:
    """Run tasks in several processes, and yield the results.

    Parameters
    ----------
    function : callable
        Function of a module; it, its arguments and its results can be pickled.
    tasks : iterable
        Tasks, read lazily, at most `IN_FLIGHT_PER_JOB` for each process ahead of the results.
    jobs : int
        Number of processes; with 1 the tasks run in the calling process.
    ordered : bool
        Yield in the order of the tasks, else as they finish.

    Yields
    ------
    Finished
        If a process ends (killed, out of memory, a crash), the tasks in flight are tried once
        more, one at a time; one that ends its process again has the value `EndedProcess`.

    Raises
    ------
    Exception
        What `tasks` raises, after the results of the tasks before; what `function` raises, at once.
    """
    if jobs == 1:
        yield from (Finished(task, function(task)) for task in tasks)
        return
    failures: list[Exception] = []
    remaining = _until_failure(tasks, failures)
    while True:
        lost: list[Task] = []
        yield from _run_pool(function, remaining, jobs, lost, ordered=ordered)
        if not lost:
            break
        yield from _run_one_by_one(function, lost)
    if failures:
        raise failures[0]


def _until_failure(tasks: Iterable[Task], failures: list[Exception]) -> Iterator[Task]:
    """Yield tasks; if taking one fails, append the exception to `failures` instead."""
    try:
        yield from tasks
    except Exception as failure:  # noqa: BLE001 - raised after the results of the tasks before it
        failures.append(failure)


def _run_pool(
    function: Callable[[Task], Value],
    remaining: Iterator[Task],
    jobs: int,
    lost: list[Task],
    *,
    ordered: bool,
) -> Iterator[Finished[Task, Value]]:
    """Yield results until no task remains or a process ends; then `lost` holds those in flight."""
    in_flight: dict[Future[Value], Task] = {}
    with _open_pool(jobs) as pool:
        while True:
            try:
                for task in islice(remaining, IN_FLIGHT_PER_JOB * jobs - len(in_flight)):
                    in_flight[pool.submit(function, task)] = task
            except BrokenProcessPool:
                lost.append(task)
                lost.extend(in_flight.values())
                return
            if not in_flight:
                return
            awaited = [next(iter(in_flight))] if ordered else in_flight
            for future in wait(awaited, return_when=FIRST_COMPLETED).done:
                if isinstance(future.exception(), BrokenProcessPool):
                    lost.extend(in_flight.values())
                    return
                yield Finished(in_flight.pop(future), future.result())


def _run_one_by_one(
    function: Callable[[Task], Value], tasks: list[Task]
) -> Iterator[Finished[Task, Value]]:
    """Yield the results of tasks, each alone in a process; one that ends is replaced."""
    remaining = iter(tasks)
    ended = True
    while ended:
        ended = False
        with _open_pool(1) as pool:
            for task in remaining:
                try:
                    value: Value | EndedProcess = pool.submit(function, task).result()
                except BrokenProcessPool:
                    value, ended = EndedProcess(), True
                yield Finished(task, value)
                if ended:
                    break


@contextmanager
def _open_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of single-threaded processes, terminated if the caller stops early."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # imports the script
        raise RuntimeError(
            "expected several processes to be started below if __name__ == '__main__':, since "
            "each of them imports the script; or pass jobs=1"
        )
    previous = set(multiprocessing.active_children())
    variables = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, initializer=_prepare_process)
    try:
        yield pool
    except BaseException:  # an interrupt, or the caller stopped reading results
        for process in set(multiprocessing.active_children()) - previous:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in variables.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _prepare_process() -> None:
    """Ignore interrupts, which the parent process handles, and end with that process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()
    import cv2

    cv2.setNumThreads(1)


def _exit_after(parent: "multiprocessing.process.BaseProcess") -> None:
    """Exit as soon as another process has ended."""
    parent.join()
    os._exit(1)
