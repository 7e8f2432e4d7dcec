"""Tasks that run in several processes of this machine, a limited number of them at a time.

Each process has a connection of its own, and the calling process knows which tasks it was given.
`concurrent.futures.ProcessPoolExecutor` shares one queue of results among all processes: it waits
without limit for the rest of a result whose process was terminated while it was sending.
"""

import multiprocessing
import os
import queue
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any, Generic, NamedTuple, TypeVar

Task = TypeVar("Task")
Value = TypeVar("Value")

IN_FLIGHT_PER_JOB = 3
"""Number of tasks per process that are taken ahead of the results."""
TASKS_PER_PROCESS = 2
"""Number of tasks that a process is given: one that runs, and one that waits in it."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that limit the threads of linear algebra to one per process."""


@dataclass(frozen=True)
class EndedProcess:
    """Result of a task that ended its process twice (out of memory, or a crash)."""


class Finished(NamedTuple, Generic[Task, Value]):
    """A task and what its function returned."""

    task: Task
    value: Value | EndedProcess


class _Failed(NamedTuple):
    """Exception that a task raised in its process."""

    exception: Exception


@dataclass(eq=False)
class _Numbered(Generic[Task]):
    """Task with its number, and how often it has ended its process."""

    number: int
    task: Task
    ends: int = 0


@dataclass(eq=False)
class _Worker(Generic[Task]):
    """Process that runs tasks one after the other, and the tasks it was given."""

    process: BaseProcess
    connection: "Connection[Any, Any]"
    given: deque[_Numbered[Task]] = field(default_factory=deque)


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
        If a process ends (killed, out of memory, a crash), the task that it was running is tried
        once more; if that ends its process again, its value is `EndedProcess`.

    Raises
    ------
    Exception
        What `tasks` or `function` raises, after the results of the tasks before if `ordered`.
    """
    if jobs == 1:
        yield from (Finished(task, function(task)) for task in tasks)
        return
    failures: list[Exception] = []
    numbered = (_Numbered(*pair) for pair in enumerate(_until_failure(tasks, failures)))
    finished = _run_in_processes(function, numbered, jobs, ordered=ordered)
    yield from (Finished(job.task, value) for job, value in finished)
    if failures:
        raise failures[0]


def _until_failure(tasks: Iterable[Task], failures: list[Exception]) -> Iterator[Task]:
    """Yield tasks; if taking one fails, append the exception to `failures` instead."""
    try:
        yield from tasks
    except Exception as failure:  # noqa: BLE001 - raised after the results of the tasks before it
        failures.append(failure)


def _run_in_processes(
    function: Callable[[Task], Value],
    remaining: Iterator[_Numbered[Task]],
    jobs: int,
    *,
    ordered: bool,
) -> Iterator[tuple[_Numbered[Task], Value | EndedProcess]]:
    """Yield tasks and their values; finished ones wait for those before them if `ordered`."""
    waiting: deque[_Numbered[Task]] = deque()
    finished: dict[int, tuple[_Numbered[Task], Any]] = {}
    taken = due = 0
    with _open_workers() as workers:
        while True:
            for job in islice(remaining, IN_FLIGHT_PER_JOB * jobs - (taken - due)):
                waiting.append(job)
                taken += 1
            _give_tasks(function, workers, waiting, jobs)
            if due in finished:
                job, value = finished.pop(due)
                due += 1
                if isinstance(value, _Failed):
                    raise value.exception
                yield job, value
            elif taken == due:
                return
            else:
                for job, value in _collect(workers, waiting):
                    finished[job.number if ordered else due + len(finished)] = job, value


def _give_tasks(
    function: Callable[[Task], Value],
    workers: list[_Worker[Task]],
    waiting: deque[_Numbered[Task]],
    jobs: int,
) -> None:
    """Send the waiting tasks to the processes with the fewest; start processes up to `jobs`."""
    idle = sum(not worker.given for worker in workers)
    for _ in range(min(jobs - len(workers), len(waiting) - idle)):
        workers.append(_start_worker(function))  # all of them, before a large task is sent to one
    while waiting:
        worker = min(workers, key=lambda each: len(each.given))
        if len(worker.given) == TASKS_PER_PROCESS:
            return
        worker.given.append(waiting.popleft())
        with suppress(BrokenPipeError, ConnectionResetError):  # noticed by `_collect`
            worker.connection.send(worker.given[-1].task)


def _collect(
    workers: list[_Worker[Task]], waiting: deque[_Numbered[Task]]
) -> Iterator[tuple[_Numbered[Task], Any]]:
    """Wait for processes to finish a task or to end; yield the tasks that are finished.

    The tasks of a process that has ended return to `waiting`; the one that was running counts it.
    """
    busy = {worker.connection: worker for worker in workers if worker.given}
    for connection in wait(list(busy)):
        worker = busy[connection]  # type: ignore[index]
        try:
            value = worker.connection.recv()
        except (EOFError, OSError):
            workers.remove(worker)
            _terminate(worker)
            worker.given[0].ends += 1
            if worker.given[0].ends == 2:
                yield worker.given.popleft(), EndedProcess()
            waiting.extendleft(reversed(worker.given))
            continue
        yield worker.given.popleft(), value


@contextmanager
def _open_workers() -> Iterator[list[_Worker[Any]]]:
    """Yield a list for the processes, which are terminated at the end."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # imports the script
        raise RuntimeError(
            "expected several processes to be started below if __name__ == '__main__':, since "
            "each of them imports the script; or pass jobs=1"
        )
    workers: list[_Worker[Any]] = []
    try:
        yield workers
    finally:
        for worker in workers:
            _terminate(worker)


def _start_worker(function: Callable[[Any], Any]) -> _Worker[Any]:
    """Start a process that runs a function."""
    context = multiprocessing.get_context("spawn")
    connection, other_end = context.Pipe()
    process = context.Process(target=_run_worker, args=(function, other_end), daemon=True)
    with _settings_of_workers():
        process.start()
    other_end.close()  # or the end of the process would not be noticed
    return _Worker(process, connection)


@contextmanager
def _settings_of_workers() -> Iterator[None]:
    """Settings that a new process inherits: one thread of linear algebra, interrupts blocked.

    An interrupt from the keyboard reaches all processes, also those that are still starting.
    """
    variables = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    blockable = hasattr(signal, "pthread_sigmask")  # not on Windows
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blockable else set()
    try:
        yield
    finally:
        if blockable:
            signal.pthread_sigmask(signal.SIG_SETMASK, previous)
        for name, value in variables.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _terminate(worker: _Worker[Any]) -> None:
    """End a process, whatever it is doing, and release its resources."""
    worker.process.kill()
    worker.process.join()
    worker.process.close()
    worker.connection.close()


def _run_worker(function: Callable[[Any], Any], connection: "Connection[Any, Any]") -> None:
    """Run the tasks that arrive, until the parent process closes the connection or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles interrupts
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    import cv2

    cv2.setNumThreads(1)
    while True:
        task = tasks.get()
        try:
            value = function(task)
        except Exception as exception:  # noqa: BLE001 - raised in the parent process
            exception.add_note("".join(traceback.format_exception(exception)))
            value = _Failed(exception)
        connection.send_bytes(_pickled(value))


def _pickled(value: Any) -> bytes:
    """Return a pickled result, or the reason why it cannot be pickled."""
    try:
        return bytes(ForkingPickler.dumps(value))
    except Exception as exception:  # noqa: BLE001 - raised in the parent process
        reason = RuntimeError(f"the result of a task cannot be pickled: {exception}")
        return bytes(ForkingPickler.dumps(_Failed(reason)))


def _receive(connection: "Connection[Any, Any]", tasks: "queue.SimpleQueue[Any]") -> None:
    """Receive tasks while others run, so that the parent process never waits for this one."""
    try:
        while True:
            tasks.put(connection.recv())
    except (EOFError, OSError):  # the parent process has ended
        os._exit(1)
