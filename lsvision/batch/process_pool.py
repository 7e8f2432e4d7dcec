"""Tasks that run in several processes of this machine, a limited number of them at a time.

Each process has its own connection, and the calling process records which tasks it has sent to
which process. `concurrent.futures.ProcessPoolExecutor` shares one queue of results among all
processes; if a process is terminated while it sends a result, the executor waits for the rest
without a time limit.
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
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any, Generic, NamedTuple, TypeVar

from lsvision.batch.thread_limits import THREAD_VARIABLES
from lsvision.errors import LsvisionError

Task = TypeVar("Task")
Value = TypeVar("Value")

IN_FLIGHT_PER_JOB = 3
"""Largest number of tasks per process that are read ahead of the results."""
TASKS_PER_PROCESS = 2
"""Largest number of tasks assigned to a process: one that runs, and one that waits in the
process."""
MAX_CRASHES = 2
"""Number of processes that a task may end before its result is `EndedProcess`."""
MAX_FAILED_STARTS = 3
"""Number of processes that may end before they are ready for one and the same task."""


@dataclass(frozen=True)
class EndedProcess:
    """Value of a task that ended its process `MAX_CRASHES` times (out of memory, or a crash)."""


class Finished(NamedTuple, Generic[Task, Value]):
    """Task, and the value that the function returned for it."""

    task: Task
    value: Value | EndedProcess


class _Ready(NamedTuple):
    """First message of a process: it has started, and now runs tasks."""


class _TaskFailure(NamedTuple):
    """Exception that a task has raised in its process."""

    exception: Exception


@dataclass(eq=False)
class _NumberedTask(Generic[Task]):
    """Task with its number, and how many processes it has ended, or waited for in vain."""

    number: int
    task: Task
    crashes: int = 0
    failed_starts: int = 0


@dataclass(eq=False)
class _Worker(Generic[Task]):
    """Process that runs tasks one after the other once it is ready, and its assigned tasks."""

    process: BaseProcess
    connection: "Connection[Any, Any]"
    assigned: deque[_NumberedTask[Task]] = field(default_factory=deque)
    ready: bool = False


def count_usable_cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows
        return os.cpu_count() or 1


def start_fork_server(preloaded: str) -> None:
    """Start a server from which the processes of `run_tasks` are forked.

    The server imports the module `preloaded` while the program goes on, so that the processes need
    not import it. Without a server each of them is a new interpreter. For programs, not for
    libraries: the start method of `multiprocessing` is the same for the whole program. Where the
    server's socket cannot be created in the folder of temporary files, no server is started.

    Raises
    ------
    RuntimeError
        If the program has a start method.
    """
    from multiprocessing import forkserver

    multiprocessing.set_start_method("forkserver")
    forkserver.set_forkserver_preload([preloaded])
    try:
        with _apply_worker_settings():
            forkserver.ensure_running()
    except OSError:
        multiprocessing.set_start_method("spawn", force=True)


def run_tasks(
    function: Callable[[Task], Value],
    tasks: Iterable[Task],
    jobs: int,
    *,
    ordered: bool,
    isolated: bool = False,
) -> Iterator[Finished[Task, Value]]:
    """Run tasks in several processes, and yield the results.

    With 1 job they run in the calling process, or if `isolated` in another one, which may end.

    Tasks are read lazily, at most `IN_FLIGHT_PER_JOB` per process ahead of the results, which are
    in the order of the tasks if `ordered`, else as they finish. If a process ends (terminated, out
    of memory, a crash), the task that it was running is repeated once; if its process ends again,
    the value is `EndedProcess`. The function is defined in a module; its tasks and values can be
    pickled.

    Raises
    ------
    LsvisionError
        If processes end while they start.
    Exception
        Exception that `tasks` or `function` raises; if `ordered`, after the results of the tasks
        before.
    """
    if jobs == 1 and not isolated:
        yield from (Finished(task, function(task)) for task in tasks)
        return
    failures: list[Exception] = []
    numbered = (_NumberedTask(*pair) for pair in enumerate(_iterate_until_failure(tasks, failures)))
    finished = _run_in_processes(function, numbered, jobs, ordered=ordered)
    yield from (Finished(numbered_task.task, value) for numbered_task, value in finished)
    if failures:
        raise failures[0]


def _iterate_until_failure(tasks: Iterable[Task], failures: list[Exception]) -> Iterator[Task]:
    """Yield tasks; if reading the next one fails, append the exception to `failures` and stop."""
    try:
        yield from tasks
    except Exception as failure:  # noqa: BLE001 - raised after the results of the tasks before it
        failures.append(failure)


def _run_in_processes(
    function: Callable[[Task], Value],
    remaining: Iterator[_NumberedTask[Task]],
    jobs: int,
    *,
    ordered: bool,
) -> Iterator[tuple[_NumberedTask[Task], Value | EndedProcess]]:
    """Yield tasks with their values, in the order of the tasks if `ordered`."""
    waiting: deque[_NumberedTask[Task]] = deque()
    # Finished tasks with their values, by their position in the order of the results.
    finished: dict[int, tuple[_NumberedTask[Task], Any]] = {}
    read = yielded = 0
    with _open_workers() as workers:
        while True:
            for task in islice(remaining, IN_FLIGHT_PER_JOB * jobs - (read - yielded)):
                waiting.append(task)
                read += 1
            _assign_tasks(function, workers, waiting, jobs)
            if yielded in finished:
                task, value = finished.pop(yielded)
                yielded += 1
                if isinstance(value, _TaskFailure):
                    raise value.exception
                yield task, value
            elif read == yielded:
                return
            else:
                for task, value in _collect_results(workers, waiting):
                    position = task.number if ordered else yielded + len(finished)
                    finished[position] = task, value


def _assign_tasks(
    function: Callable[[Task], Value],
    workers: list[_Worker[Task]],
    waiting: deque[_NumberedTask[Task]],
    jobs: int,
) -> None:
    """Send waiting tasks to the processes with the fewest tasks; start processes up to `jobs`."""
    idle = sum(not worker.assigned for worker in workers)
    for _ in range(min(jobs - len(workers), len(waiting) - idle)):
        # All processes are started before a task is sent, because sending a large one takes long.
        workers.append(_start_worker(function))
    while waiting:
        worker = min(workers, key=lambda each: len(each.assigned))
        if len(worker.assigned) == TASKS_PER_PROCESS:
            return
        worker.assigned.append(waiting.popleft())
        with suppress(BrokenPipeError, ConnectionResetError):  # noticed by `_collect_results`
            worker.connection.send(worker.assigned[-1].task)


def _collect_results(
    workers: list[_Worker[Task]], waiting: deque[_NumberedTask[Task]]
) -> Iterator[tuple[_NumberedTask[Task], Any]]:
    """Wait until a process is ready, ends or finishes a task; yield finished tasks, with values.

    The tasks of a process that has ended return to `waiting`.
    """
    busy = {worker.connection: worker for worker in workers if worker.assigned}
    for connection in wait(list(busy)):
        worker = busy[connection]  # type: ignore[index]
        try:
            value = worker.connection.recv()
        except (EOFError, OSError):
            workers.remove(worker)
            _terminate(worker)
            if _count_ended_process(worker):
                yield worker.assigned.popleft(), EndedProcess()
            waiting.extendleft(reversed(worker.assigned))
            continue
        if isinstance(value, _Ready):
            worker.ready = True
        else:
            yield worker.assigned.popleft(), value


def _count_ended_process(worker: _Worker[Task]) -> bool:
    """Count a process that has ended for its first task; return whether the task is given up.

    Raises
    ------
    LsvisionError
        If processes end before they run the task, which is not the task's fault.
    """
    task = worker.assigned[0]
    if worker.ready:
        task.crashes += 1
        return task.crashes == MAX_CRASHES
    task.failed_starts += 1
    if task.failed_starts == MAX_FAILED_STARTS:
        raise LsvisionError(
            f"{MAX_FAILED_STARTS} processes ended while they started (out of memory, or a script "
            "that starts them outside of if __name__ == '__main__'): use fewer jobs"
        )
    return False


@contextmanager
def _open_workers() -> Iterator[list[_Worker[Any]]]:
    """Yield an empty list of processes; at the end, terminate all processes in it."""
    # A started process that still imports the caller's script must not start processes itself.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
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
    # A process that is forked directly could inherit locks that other threads hold.
    forked = multiprocessing.get_start_method(allow_none=True) == "forkserver"
    new_process = multiprocessing.get_context("forkserver" if forked else "spawn").Process  # type: ignore[attr-defined]
    connection, other_end = multiprocessing.Pipe()
    process = new_process(target=_run_worker, args=(function, other_end), daemon=True)
    with _apply_worker_settings():
        process.start()
    other_end.close()  # otherwise the end of the process would not close the connection
    return _Worker(process, connection)


@contextmanager
def _apply_worker_settings() -> Iterator[None]:
    """Set what a new process inherits: one thread for linear algebra, and blocked interrupts.

    An interrupt from the keyboard reaches all processes, also those that are still starting.
    """
    variables = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    blockable = hasattr(signal, "pthread_sigmask")  # not on Windows
    if blockable:
        # Otherwise starting the first process starts the tracker, which in Python 3.11 unblocks
        # interrupts.
        resource_tracker.ensure_running()
        previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
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
    """Terminate a process, also during a task, and release its resources."""
    worker.process.kill()
    worker.process.join()
    worker.process.close()
    worker.connection.close()


def _run_worker(function: Callable[[Any], Any], connection: "Connection[Any, Any]") -> None:
    """Run received tasks, until the parent process closes the connection or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles interrupts
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive_tasks, args=(connection, tasks), daemon=True).start()
    import cv2

    cv2.setNumThreads(1)
    connection.send_bytes(_pickle_result(_Ready()))
    while True:
        task = tasks.get()
        try:
            value = function(ForkingPickler.loads(task))
        except Exception as exception:  # noqa: BLE001 - raised in the parent process
            exception.add_note("".join(traceback.format_exception(exception)))
            value = _TaskFailure(exception)
        connection.send_bytes(_pickle_result(value))


def _pickle_result(value: Any) -> bytes:
    """Return a pickled result, or the pickled reason why it cannot be pickled."""
    try:
        return bytes(ForkingPickler.dumps(value))
    except Exception as exception:  # noqa: BLE001 - raised in the parent process
        reason = RuntimeError(f"the result of a task cannot be pickled: {exception}")
        return bytes(ForkingPickler.dumps(_TaskFailure(reason)))


def _receive_tasks(connection: "Connection[Any, Any]", tasks: "queue.SimpleQueue[bytes]") -> None:
    """Receive tasks while another one runs, so that sending never blocks the parent process."""
    try:
        while True:
            tasks.put(connection.recv_bytes())
    except (EOFError, OSError):  # the parent process has ended
        os._exit(1)
