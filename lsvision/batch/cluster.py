"""Tasks that run on a Dask cluster, a limited number of them at a time."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any, TypeVar

from lsvision.batch.process_pool import EndedProcess, Finished
from lsvision.errors import LsvisionError

Task = TypeVar("Task")
Value = TypeVar("Value")

IN_FLIGHT_PER_THREAD = 3
"""Largest number of unfinished tasks per thread of the workers: one that runs, and two that
wait."""
CONNECT_TIMEOUT_S = 10.0
"""Time limit for the connection to the scheduler. Units: s."""
ANSWER_TIMEOUT_S = 60.0
"""Time limit for each answer of the scheduler, which may be busy. Units: s."""
CLOSE_TIMEOUT_S = 2.0
"""Time limit for closing the connection, whose scheduler may have ended. Units: s."""
POLL_S = 1.0
"""Interval between checks of the connection while all workers are busy. Units: s."""


class _TaskError(Exception):
    """An error of a task that is of the type of a lost connection."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error)
        self.error = error


def run_on_cluster(
    function: Callable[[Task], Value], tasks: Iterable[Task], address: str
) -> Iterator[Finished[Task, Value]]:
    """Yield the results of tasks as they finish on the cluster of a scheduler.

    Tasks are read lazily. If a worker ends, other workers repeat its tasks; a task that has ended
    several workers has the value `EndedProcess`. The function is in a module that is installed on
    all workers; the address is such as ``tcp://192.168.0.10:8786``.

    Raises
    ------
    LsvisionError
        If dask is not installed, no scheduler answers, or the connection to it is lost.
    Exception
        As `function`.
    """
    client = _connect(address)
    try:
        yield from _run_tasks(client, function, iter(tasks))
    except _TaskError as failure:
        raise failure.error from None
    except OSError as error:  # also TimeoutError
        raise _build_scheduler_lost_error(address, error) from None
    finally:
        client.close(timeout=CLOSE_TIMEOUT_S)


def _connect(address: str) -> Any:
    """Return a client of the scheduler, or raise `LsvisionError` if there is none."""
    try:
        import distributed
        from distributed.comm.addressing import resolve_address
    except ModuleNotFoundError:
        raise LsvisionError(
            "--scheduler needs dask: pip install 'lsvision[cluster]' here and on all workers"
        ) from None
    try:
        # A client with a malformed address would wait for 20 s at the end of the process.
        with contextlib.suppress(OSError):  # an unknown host, reported by the client
            resolve_address(address)
    except ValueError as error:
        raise LsvisionError(
            f"{address}: {error}: expected the address of a scheduler such as "
            "tcp://192.168.0.10:8786"
        ) from None
    try:
        open_client: Any = distributed.Client  # without annotations
        return open_client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except OSError as error:  # also TimeoutError
        reason = " ".join(str(error).split())[:100]
        raise LsvisionError(
            f"{address}: no scheduler answers ({reason}): start `dask scheduler` there"
        ) from None


def _run_tasks(
    client: Any, function: Callable[[Task], Value], remaining: Iterator[Task]
) -> Iterator[Finished[Task, Value]]:
    """Submit tasks, a new one when another one finishes, and yield the results."""
    in_flight: dict[Any, Task] = {}
    while True:
        max_count = IN_FLIGHT_PER_THREAD * max(_count_threads(client), 1)
        for task in islice(remaining, max(max_count - len(in_flight), 0)):
            in_flight[client.submit(function, task, pure=False)] = task
        if not in_flight:
            return
        for future in _wait_for_any(client, list(in_flight)):
            yield Finished(in_flight.pop(future), _collect_result(client, future))


def _count_threads(client: Any) -> int:
    """Return the number of threads of all workers.

    Raises
    ------
    OSError
        If the scheduler does not answer; the client itself would wait without a time limit.
    """
    answer = client.sync(client.scheduler.ncores, callback_timeout=ANSWER_TIMEOUT_S)
    return sum(answer.values())


def _wait_for_any(client: Any, futures: list[Any]) -> list[Any]:
    """Wait until at least one future is done, and return those that are done."""
    import distributed

    wait: Any = distributed.wait  # without annotations
    while True:
        # `wait` takes the current client; this one is not the default.
        with contextlib.suppress(TimeoutError), client.as_current():
            return list(wait(futures, timeout=POLL_S, return_when="FIRST_COMPLETED").done)
        _count_threads(client)


def _collect_result(client: Any, future: Any) -> Any:
    """Return the result of a future, or `EndedProcess` if its task has ended several workers."""
    import distributed

    while True:
        try:
            return future.result(timeout=ANSWER_TIMEOUT_S)
        except distributed.KilledWorker:
            return EndedProcess()
        except distributed.CancelledError as error:
            raise _build_scheduler_lost_error(client.scheduler.address, error) from None
        except OSError as error:
            if future.status == "error":  # raised by the task itself
                raise _TaskError(error) from None
            if not isinstance(error, TimeoutError):
                raise
            # Timed out: the worker that held the result has ended, and the task runs again; check
            # that the scheduler still answers.
            _count_threads(client)


def _build_scheduler_lost_error(address: str, error: Exception) -> LsvisionError:
    """Return the error of a lost connection to the scheduler."""
    return LsvisionError(
        f"{address}: the connection to the scheduler is lost ({type(error).__name__}): start the "
        "scheduler, and repeat the command: finished files are kept"
    )
