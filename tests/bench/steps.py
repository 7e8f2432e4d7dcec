"""Time of each step of `measure_cylinders`, and of the whole with half of the points.

Processor time, the minimum of several rounds, because other processes use the machine. The part
that does not decrease with the number of points is the overhead of calls of Python and numpy
functions.
"""

import sys
import time
from collections import defaultdict
from contextlib import ExitStack
from unittest import mock

import lsvision.measure
from lsvision.profile import Profile
from lsvision.simulate import random_section
from tests.bench.goals import Number

STEPS = (
    "prepare_profile", "find_radius_range", "build_range_image", "find_connected_components",
    "find_candidates", "identify_arcs", "screen_arcs", "find_tangential_end_reason", "smooth_arcs",
    "homogenise_arcs", "refine_arcs", "find_rejection_reason", "suppress_overlapping",
    "complete_rejections", "build_measurement",
)  # fmt: skip
"""The functions that `lsvision.measure` calls, in order."""
FIRST_SEED = 40_000
THINNING = 2
"""One of so many points is measured in the comparison with fewer points."""


def time_steps(scenes, repeats):
    """Yield the rows for a single pipe and for a welded pair in clutter."""
    for kind, name in (("single", "one pipe"), ("welded_complex", "welded pair in clutter")):
        points = [random_section(kind, FIRST_SEED + k).profile.points for k in range(scenes)]
        profiles = [Profile(each) for each in points]
        total, by_step = _min_times(profiles, repeats)
        yield Number(f"{name}: measure_cylinders", 1e3 * total, unit="ms")
        for step in STEPS:
            fraction = f"{by_step[step] / total:.1%}"
            yield Number(f"{name}: {step}", 1e6 * by_step[step], unit="us", note=fraction)
        rest = total - sum(by_step.values())
        yield Number(f"{name}: all else", 1e6 * rest, unit="us", note=f"{rest / total:.1%}")
        fewer, _ = _min_times([Profile(each[::THINNING]) for each in points], repeats)
        what = f"{name}: time with one of {THINNING} points / with all"
        yield Number(what, fewer / total)
        python, compiled = _count_calls(profiles[0])
        yield Number(f"{name}: calls of functions", python + compiled, note=f"{python} of Python")


def _min_times(profiles, repeats):
    """Return the time per profile, and that of each step (s): each the minimum of the rounds."""
    totals, by_step = [], {step: [] for step in STEPS}
    for _ in range(repeats):
        spent = defaultdict(float)
        with ExitStack() as stack:
            for step in STEPS:
                timed = _timed(getattr(lsvision.measure, step), spent, step)
                stack.enter_context(mock.patch.object(lsvision.measure, step, timed))
            start = time.process_time()
            for profile in profiles:
                lsvision.measure.measure_cylinders(profile)
            totals.append(time.process_time() - start)
        for step in STEPS:
            by_step[step].append(spent[step])
    minima = {step: min(times) / len(profiles) for step, times in by_step.items()}
    return min(totals) / len(profiles), minima


def _timed(function, spent, step):
    """Return the function with its processor time added to `spent[step]` at each call."""

    def call(*args, **options):
        start = time.process_time()
        try:
            return function(*args, **options)
        finally:
            spent[step] += time.process_time() - start

    return call


def _count_calls(profile):
    """Return the numbers of calls of Python and of compiled functions in one measurement."""
    counts = {"call": 0, "c_call": 0}

    def count(_frame, event, _argument):
        if event in counts:
            counts[event] += 1

    sys.setprofile(count)
    try:
        lsvision.measure.measure_cylinders(profile)
    finally:
        sys.setprofile(None)
    return counts["call"], counts["c_call"]
