"""Many profiles in Python: as one by one, in order, without reading far ahead."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

import lsvision as lsv
from lsvision.batch.process_pool import IN_FLIGHT_PER_JOB
from lsvision.measure import PROFILES_AT_ONCE
from tests.batch.sources import profiles
from tests.measurements import assert_same_measurement


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_are_those_of_measure_cylinders_in_order(jobs):
    every = profiles(2 * PROFILES_AT_ONCE + 3)
    points = [section for section in every if np.isfinite(section).any()]
    found = list(lsv.measure_many(points, jobs=jobs, sensor="lps36hi", radius=(5, 60)))
    single = [lsv.measure_cylinders(p, sensor="lps36hi", radius=(5, 60)) for p in points]
    assert len(found) == len(single)
    for one, other in zip(found, single, strict=True):
        assert_same_measurement(one, other)
    assert sum(len(each.cylinders) for each in found) > len(points) / 2


def test_an_endless_generator_is_read_a_bounded_number_ahead():
    (points,) = profiles(1)
    taken = []

    def endless():
        for number in itertools.count():
            taken.append(number)
            yield points

    results = lsv.measure_many(endless(), jobs=2)
    next(results)
    results.close()
    assert len(taken) <= (1 + 2 * IN_FLIGHT_PER_JOB) * PROFILES_AT_ONCE


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_generator_that_fails_costs_no_profile_before(jobs):
    before = profiles(PROFILES_AT_ONCE + 3)

    def failing():
        yield from before
        raise OSError("unplugged")

    found = []
    with pytest.raises(OSError, match="unplugged"):
        found.extend(lsv.measure_many(failing(), jobs=jobs))
    assert len(found) == len(before)


def test_slips_are_reported():
    with pytest.raises(ValueError, match="expected jobs >= 1, got 0"):
        lsv.measure_many([], jobs=0)
    for jobs in (1.5, "2", True):
        with pytest.raises(TypeError, match=f"expected jobs as a whole number, got .* {jobs!r}"):
            lsv.measure_many([], jobs=jobs)
    with pytest.raises(TypeError):
        next(lsv.measure_many(["text"], jobs=1))


def test_a_script_without_a_guard_is_told_so(tmp_path):
    script = tmp_path / "many.py"
    script.write_text(
        "import lsvision as lsv\n"
        "section = lsv.simulate.random_section('single', 7)\n"
        "print(len(list(lsv.measure_many([section.profile], jobs=2))))\n"
    )
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("lsvision.errors.LsvisionError: 3 processes ended while they started")
    assert "outside of if __name__ == '__main__')" in last
    assert "expected several processes to be started below if __name__" in done.stderr
