"""Tasks in processes: order, bounded look-ahead, and processes that end in the middle."""

import itertools
import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lsvision.batch.process_pool import (
    IN_FLIGHT_PER_JOB,
    EndedProcess,
    Finished,
    count_usable_cores,
    run_tasks,
)
from lsvision.errors import LsvisionError
from tests.batch.tasks import (
    EndsOnArrival,
    FailsOnArrival,
    ends_its_process,
    fails,
    large,
    local_function,
    square,
    waits_for_another_result_if_zero,
)


@pytest.fixture(params=["spawn", "forkserver"])
def start_method(request):
    """Processes are started by this method, which a program chooses once."""
    if request.param not in multiprocessing.get_all_start_methods():
        pytest.skip("not on this system")
    before = multiprocessing.get_start_method(allow_none=True)
    multiprocessing.set_start_method(request.param, force=True)
    yield
    multiprocessing.set_start_method(before, force=True)


SERVER = (
    "from lsvision.batch.process_pool import start_fork_server\n"
    "start_fork_server('tests.batch.tasks')\n"
)
"""Code of a program whose processes are forked from a server."""
with_and_without_server = pytest.mark.parametrize(
    "start",
    [
        "",
        pytest.param(
            SERVER, marks=pytest.mark.skipif(sys.platform != "linux", reason="no fork server")
        ),
    ],
)


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("ordered", [True, False])
@pytest.mark.usefixtures("start_method")
def test_every_task_is_done_once(jobs, ordered):
    found = list(run_tasks(square, range(20), jobs, ordered=ordered))
    assert sorted(found) == [Finished(number, number * number) for number in range(20)]
    if ordered:
        assert [task for task, _ in found] == list(range(20))


def test_unordered_results_do_not_wait_for_a_slow_task(tmp_path):
    mark, order = tmp_path / "mark", []
    tasks = [(number, str(mark)) for number in range(6)]
    for _, number in run_tasks(waits_for_another_result_if_zero, tasks, 2, ordered=False):
        order.append(number)
        mark.touch()
    assert order[0] != 0
    assert sorted(order) == list(range(6))


def test_tasks_are_taken_only_a_little_ahead():
    taken = []

    def endless():
        for number in itertools.count():
            taken.append(number)
            yield number

    results = run_tasks(square, endless(), 2, ordered=True)
    for wanted in range(5):
        assert next(results).task == wanted
    results.close()
    assert len(taken) <= 5 + 2 * IN_FLIGHT_PER_JOB


@pytest.mark.usefixtures("start_method")
def test_a_task_that_ends_its_process_once_is_done_and_costs_no_other(tmp_path):
    tasks = [(k, str(tmp_path), "once" if k == 4 else "never") for k in range(12)]
    found = list(run_tasks(ends_its_process, tasks, 2, ordered=False))
    assert sorted(task[0] for task, _ in found) == list(range(12))
    assert all(value == task[0] for task, value in found)


@pytest.mark.usefixtures("start_method")
def test_a_task_that_ends_its_process_twice_is_given_up_alone(tmp_path):
    tasks = [(k, str(tmp_path), "always" if k == 4 else "never") for k in range(12)]
    found = dict(run_tasks(ends_its_process, tasks, 2, ordered=False))
    assert found.pop(tasks[4]) == EndedProcess()
    assert sorted(found.values()) == [k for k in range(12) if k != 4]


@pytest.mark.usefixtures("start_method")
def test_one_job_may_have_a_process_of_its_own_that_a_task_ends(tmp_path):
    tasks = [(k, str(tmp_path), "always" if k == 1 else "never") for k in range(4)]
    found = dict(run_tasks(ends_its_process, tasks, 1, ordered=True, isolated=True))
    assert found.pop(tasks[1]) == EndedProcess()
    assert list(found.values()) == [0, 2, 3]


@pytest.mark.usefixtures("start_method")
def test_processes_that_end_while_they_start_are_no_fault_of_the_tasks():
    with pytest.raises(LsvisionError, match="3 processes ended while they started"):
        list(run_tasks(EndsOnArrival(), range(9), 2, ordered=False))


@pytest.mark.usefixtures("start_method")
def test_a_task_survives_two_processes_that_end_while_they_start(tmp_path):
    found = list(run_tasks(EndsOnArrival(tmp_path, 2), range(9), 1, ordered=True, isolated=True))
    assert [value for _, value in found] == list(range(9))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_exception_of_a_task_reaches_the_caller(jobs):
    with pytest.raises(ValueError, match="task 0"):
        next(run_tasks(fails, range(3), jobs, ordered=True))


def test_by_default_there_is_a_process_for_each_core():
    assert count_usable_cores() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("ends", [False, True])
def test_a_source_that_fails_costs_no_result_of_the_tasks_before(jobs, ends, tmp_path):
    def failing():
        for k in range(10):
            yield k, str(tmp_path), "once" if ends and jobs > 1 and k == 8 else "never"
        raise OSError("unplugged")

    results = run_tasks(ends_its_process, failing(), jobs, ordered=True)
    done = []
    with pytest.raises(OSError, match="unplugged"):
        done.extend(value for _, value in results)
    assert sorted(done) == list(range(10))


@pytest.mark.usefixtures("start_method")
def test_a_caller_that_stops_early_does_not_wait_for_results_on_their_way():
    # ProcessPoolExecutor waits without limit for a result whose process is terminated meanwhile.
    for delay in (0.0, 0.01, 0.03):
        results = run_tasks(large, itertools.repeat(bytes(20_000_000)), 2, ordered=False)
        next(results)
        time.sleep(delay)
        results.close()
    assert multiprocessing.active_children() == []


@pytest.mark.usefixtures("start_method")
def test_large_tasks_and_large_results_do_not_block_each_other():
    tasks = [bytes([number]) + bytes(3_000_000) for number in range(12)]
    assert list(run_tasks(large, tasks, 2, ordered=True)) == [
        Finished(task, task[::-1]) for task in tasks
    ]


def test_a_result_that_cannot_be_pickled_is_named():
    with pytest.raises(RuntimeError, match="the result of a task cannot be pickled"):
        list(run_tasks(local_function, range(3), 2, ordered=True))


def test_a_task_that_cannot_be_received_is_an_exception_of_the_task():
    with pytest.raises(ValueError, match="task 0"):
        list(run_tasks(square, [FailsOnArrival()] * 2, 2, ordered=True))


def test_an_exception_of_a_task_says_where_it_was_raised():
    with pytest.raises(ValueError, match="task 0") as caught:
        list(run_tasks(fails, range(3), 2, ordered=True))
    assert "in fails" in caught.value.__notes__[0]


def run_in_repository(code, **options):
    """The finished process of a Python that can import the tests, too."""
    repository = Path(__file__).parents[2]
    return subprocess.run(
        [sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, timeout=60,
        env={**os.environ, "PYTHONPATH": str(repository)}, check=False, **options,
    )  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@with_and_without_server
def test_a_process_ends_with_its_parent_in_the_middle_of_a_task(start):
    code = start + (
        "import os\n"
        "from lsvision.batch.process_pool import run_tasks\n"
        "from tests.batch.tasks import pid_then_sleep\n"
        "results = run_tasks(pid_then_sleep, [0, 0, 600, 600], 2, ordered=False)\n"
        "print({next(results).value, next(results).value}, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = run_in_repository(code)
    assert done.returncode == -9, done.stderr
    deadline = time.monotonic() + 20
    running = [int(pid) for pid in done.stdout.strip("{} \n").split(",")]
    while any(map(_is_running, running)):
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
@with_and_without_server
def test_an_interrupt_reaches_only_the_parent_also_while_processes_start(delay, start):
    code = start + (
        "import os, signal, threading\n"
        "from lsvision.batch.process_pool import run_tasks\n"
        "from tests.batch.tasks import pid_then_sleep\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def run():\n"
        f"    threading.Timer({delay}, os.killpg, (0, signal.SIGINT)).start()\n"
        "    list(run_tasks(pid_then_sleep, [600, 600], 2, ordered=False))\n"
        "try: run()\n"
        "except KeyboardInterrupt: print('interrupted')\n"
    )
    done = run_in_repository(code, start_new_session=True)
    assert (done.stdout, done.stderr, done.returncode) == ("interrupted\n", "", 0)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@with_and_without_server
def test_the_first_process_is_started_with_interrupts_blocked_too(start):
    """In Python 3.11 the resource tracker, started with the first process, unblocks them."""
    code = start + (
        "from lsvision.batch.process_pool import run_tasks\n"
        "from tests.batch.tasks import blocks_interrupts\n"
        "print({value for _, value in run_tasks(blocks_interrupts, range(8), 2, ordered=True)})\n"
    )
    done = run_in_repository(code)
    assert (done.returncode, done.stdout) == (0, "{True}\n"), done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="no fork server")
def test_a_fork_server_imports_the_modules_of_its_processes_once():
    code = SERVER + (
        "from lsvision.batch.process_pool import run_tasks\n"
        "from tests.batch.tasks import importing_process\n"
        "found = run_tasks(importing_process, range(8), 2, ordered=True)\n"
        "print(len({value for _, value in found}))\n"
    )
    done = run_in_repository(code)
    assert (done.returncode, done.stdout) == (0, "1\n"), done.stderr
    without = run_in_repository(code.replace(SERVER, ""))
    assert (without.returncode, without.stdout) == (0, "2\n"), without.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="no fork server")
def test_without_a_socket_for_the_server_processes_are_spawned(tmp_path):
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    code = (
        f"import tempfile; tempfile.tempdir = {str(folder)!r}\n"
        + SERVER
        + (
            "from lsvision.batch.process_pool import run_tasks\n"
            "from tests.batch.tasks import square\n"
            "print([value for _, value in run_tasks(square, range(3), 2, ordered=True)])\n"
        )
    )
    done = run_in_repository(code)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[0, 1, 4]\n", "")


def _is_running(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes() != b""  # empty until it is waited for
    except OSError:
        return False
