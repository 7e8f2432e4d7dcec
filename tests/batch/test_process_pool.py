"""Tasks in processes: order, bounded look-ahead, and processes that end in the middle."""

import itertools
import os

import pytest

from lsvision.batch.process_pool import (
    IN_FLIGHT_PER_JOB,
    EndedProcess,
    Finished,
    default_jobs,
    run_tasks,
)
from tests.batch.tasks import ends_its_process, fails, slow_if_zero, square


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("ordered", [True, False])
def test_every_task_is_done_once(jobs, ordered):
    found = list(run_tasks(square, range(20), jobs, ordered=ordered))
    assert sorted(found) == [Finished(number, number * number) for number in range(20)]
    if ordered:
        assert [task for task, _ in found] == list(range(20))


def test_unordered_results_do_not_wait_for_a_slow_task():
    order = [task for task, _ in run_tasks(slow_if_zero, range(6), 2, ordered=False)]
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


def test_a_task_that_ends_its_process_once_is_done_and_costs_no_other(tmp_path):
    tasks = [(k, str(tmp_path), "once" if k == 4 else "never") for k in range(12)]
    found = list(run_tasks(ends_its_process, tasks, 2, ordered=False))
    assert sorted(task[0] for task, _ in found) == list(range(12))
    assert all(value == task[0] for task, value in found)


def test_a_task_that_ends_its_process_twice_is_given_up_alone(tmp_path):
    tasks = [(k, str(tmp_path), "always" if k == 4 else "never") for k in range(12)]
    found = dict(run_tasks(ends_its_process, tasks, 2, ordered=False))
    assert found.pop(tasks[4]) == EndedProcess()
    assert sorted(found.values()) == [k for k in range(12) if k != 4]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_exception_of_a_task_reaches_the_caller(jobs):
    with pytest.raises(ValueError, match="task 0"):
        next(run_tasks(fails, range(3), jobs, ordered=True))


def test_by_default_there_is_a_process_for_each_core():
    assert default_jobs() == len(os.sched_getaffinity(0))


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
