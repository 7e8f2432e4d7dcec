"""Time of one measurement on one core.

Processor time instead of wall time, and the minimum beside the median, because other processes use
the machine.
"""

import math
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
from scipy.optimize import least_squares

from lsvision.ellipse.fit import fit_ellipse
from lsvision.geometry import Ellipse
from lsvision.io.profiles import read_profile
from lsvision.measure import measure_cylinders
from lsvision.simulate import (
    SCENE_KINDS,
    SCENE_SENSOR,
    SectionSettings,
    TubeRanges,
    random_section,
    simulate_section,
)
from lsvision.studies.chen_liu_2016 import measure_cylinders_paper
from tests.bench.goals import Number
from tests.bench.matching import match_tubes
from tests.bench.progress import counted
from tests.bench.spheres import REAL, real_data

FIRST_SEED = 40_000
COLUMNS = (256, 512, 1024, 2048, 4096)
LONG_PROFILE = 1200
"""Smallest number of points of a real profile that is timed (the sensor has 1280)."""
HELP_RUNS = 9
LONG_FILE_POINTS, READING_RUNS = 100_000, 5


@dataclass(frozen=True)
class Times:
    """Processor time of each of many runs (s)."""

    what: str
    seconds: np.ndarray

    @property
    def median(self):
        return float(np.median(self.seconds))

    @property
    def p95(self):
        return float(np.percentile(self.seconds, 95))

    def rows(self, goal_ms):
        """Yield the median, and the ratio of the 95 % quantile to it."""
        note = f"min {1e3 * self.seconds.min():.2f}, {len(self.seconds)} runs"
        yield Number(f"{self.what}, median", 1e3 * self.median, high=goal_ms, unit="ms", note=note)
        yield Number(f"{self.what}, p95 / median", self.p95 / self.median, high=2.0)


@dataclass(frozen=True)
class LiteralTimes:
    """Times of lsvision and of two implementations of the paper's pipeline on the same profiles.

    `paper` is `measure_cylinders_paper`, whose fits use lsvision's parameters and derivatives.
    `plain` is the same with the fits of scipy's `least_squares` and its defaults: unknowns x_0,
    y_0, a, b, theta, derivatives by differences. The paper does not state more than that.
    """

    kind: str
    ours: Times
    paper: Times
    plain: Times

    @property
    def rows(self):
        note = f"{self.plain.median:.1f} s a profile"
        ratio = self.plain.median / self.ours.median
        yield Number(f"paper's pipeline by scipy / lsvision, {self.kind}", ratio, 500, note=note)
        ratio = self.paper.median / self.ours.median
        yield Number(f"measure_cylinders_paper / lsvision, {self.kind}", ratio)


@dataclass(frozen=True)
class Speed:
    """All times.

    `real` is None without the real profiles; `growth` has the times for each number of `COLUMNS`,
    and `missed` is the number of tubes missed there; `help_seconds` has wall and processor time of
    each run of ``lsvision --help``, (n, 2); `reading` is the ratio of `_compare_reading`.
    """

    single: Times
    pair: Times
    real: Times | None
    literal: tuple[LiteralTimes, ...]
    growth: tuple[Times, ...]
    missed: int
    help_seconds: np.ndarray
    reading: float

    @property
    def slope(self):
        """Exponent of the growth of time with points: least squares over all sizes."""
        medians = [times.median for times in self.growth]
        return float(np.polyfit(np.log(COLUMNS), np.log(medians), 1)[0])

    @property
    def steepest(self):
        """Largest exponent from one size to the next."""
        medians = np.log([times.median for times in self.growth])
        return float((np.diff(medians) / np.diff(np.log(COLUMNS))).max())

    @property
    def numbers(self):
        yield from self.single.rows(2.5)
        yield from self.pair.rows(8.0)
        if self.real is not None:
            yield from self.real.rows(8.0)
        for times in self.literal:
            yield from times.rows
        note = ", ".join(f"{times.what} {1e3 * times.median:.1f} ms" for times in self.growth)
        yield Number("growth with points, exponent", self.slope, high=1.0, note=note)
        yield Number("growth, steepest doubling", self.steepest)
        # The time for many points is only comparable if the tubes are found there.
        yield Number("growth: tubes missed at all sizes", self.missed, high=0)
        wall, processor = np.median(self.help_seconds, axis=0)
        note = f"wall time {wall:.2f} s"
        yield Number("lsvision --help, median", processor, high=0.3, unit="s", note=note)
        note = f"{LONG_FILE_POINTS} points of a plain CSV, median of {READING_RUNS} rounds"
        yield Number("read_profile / numpy.loadtxt", self.reading, high=2.0, note=note)


def measure_speed(scenes, repeats):
    """Measure `scenes` random scenes of each kind `repeats` times."""
    cv2.setNumThreads(1)
    single = [random_section("single", FIRST_SEED + i).profile for i in range(scenes)]
    pair = [random_section("welded_complex", FIRST_SEED + i).profile for i in range(scenes)]
    growth, missed = _time_growth(scenes // 2, repeats)
    few = max(scenes // 8, 2)
    kinds = (("single", single[:few]), ("welded pair in clutter", pair[:few]))
    return Speed(
        single=time_measuring("single, 376 points", single, repeats),
        pair=time_measuring("welded pair in clutter, 376 points", pair, repeats),
        real=_time_real(repeats),
        literal=tuple(_literal_times(*kind, repeats) for kind in kinds),
        growth=growth,
        missed=missed,
        help_seconds=np.array([_time_help() for _ in range(HELP_RUNS)]),
        reading=_compare_reading(),
    )


def time_measuring(what, profiles, repeats, measure=measure_cylinders):
    """Return the times of `repeats` measurements of each profile, after one that is not timed."""
    seconds = []
    for profile in counted(profiles, f"speed, {what}"):
        measure(profile)
        for _ in range(repeats):
            start = time.process_time()
            measure(profile)
            seconds.append(time.process_time() - start)
    return Times(what, np.array(seconds))


def _literal_times(kind, profiles, repeats):
    ours = time_measuring("for the ratio", profiles, repeats)
    paper = time_measuring("measure_cylinders_paper", profiles, 1, measure_cylinders_paper)
    with mock.patch("lsvision.studies.chen_liu_2016.paper_pipeline.fit_ellipse", _fit_by_scipy):
        plain = time_measuring("paper's pipeline by scipy", profiles, 1, measure_cylinders_paper)
    return LiteralTimes(kind, ours, paper, plain)


def _fit_by_scipy(points, initial_guess, **options):
    """Return the fit of the paper's residuals by scipy; replaces `fit_ellipse`."""
    start = (*initial_guess.centre, initial_guess.semi_major, initial_guess.semi_minor,
             initial_guess.theta)  # fmt: skip
    x, y, a, b, theta = least_squares(_radial_distances, start, args=points.T).x
    # The result must be an EllipseFit: this fit starts at the minimum and adds a tenth of the time.
    return fit_ellipse(points, Ellipse.from_axes((x, y), abs(a), abs(b), theta), **options)


def _radial_distances(unknowns, x, y):
    """Return the paper's r_j, Eq. (4), in a form that is also defined at x_j = x_0."""
    x0, y0, a, b, theta = unknowns
    u = (x - x0) * math.cos(theta) + (y - y0) * math.sin(theta)
    v = (y - y0) * math.cos(theta) - (x - x0) * math.sin(theta)
    rho = np.hypot(u, v)
    return rho - abs(a * b) * rho / np.hypot(b * u, a * v)


def _time_real(repeats):
    """Return the times of the long real profiles; None without them."""
    if not real_data():
        return None
    files = sorted((REAL / "sphere-profiles").glob("*.csv"))
    profiles = [profile for profile in map(read_profile, files) if len(profile) >= LONG_PROFILE]
    return time_measuring(f"real, {LONG_PROFILE} points and more", profiles, min(repeats, 3))


def _welded_pairs(columns, scenes):
    """Yield sections of the same welded pairs in clutter by a sensor with so many columns."""
    sensor = replace(SCENE_SENSOR, columns=columns)
    for seed in range(FIRST_SEED, FIRST_SEED + scenes):
        rng = np.random.default_rng(seed)
        scene = SCENE_KINDS["welded_complex"](rng, TubeRanges())
        yield simulate_section(scene, sensor, SectionSettings(), rng=rng)


def _time_growth(scenes, repeats):
    """Return the times for each number of `COLUMNS`, and the number of tubes missed."""
    growth, missed = [], 0
    for columns in COLUMNS:
        sections = list(_welded_pairs(columns, scenes))
        profiles = [section.profile for section in sections]
        growth.append(time_measuring(str(columns), profiles, min(repeats, 3)))
        for section in sections:
            found = measure_cylinders(section.profile)
            missed += len(match_tubes(found, section.truth).missed)
    return tuple(growth), missed


def _time_help():
    """Return wall and processor time (s) of ``lsvision --help`` in a process of its own."""
    start, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "lsvision", "--help"], check=True, stdout=subprocess.DEVNULL
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime - used.ru_utime + after.ru_stime - used.ru_stime
    return time.perf_counter() - start, processor


def _compare_reading():
    """Return the time of `read_profile` for a plain CSV over that of `numpy.loadtxt`."""
    points = np.random.default_rng(1).normal(0, 50, (LONG_FILE_POINTS, 2)).round(4)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.csv"
        path.write_text("".join(f"{x},{z}\n" for x, z in points.tolist()))
        readers = (read_profile, lambda path: np.loadtxt(path, delimiter=","))
        seconds = [[_seconds_of(reader, path) for reader in readers] for _ in range(READING_RUNS)]
    ours, peer = np.median(seconds, axis=0)
    return float(ours / peer)


def _seconds_of(read, path):
    start = time.process_time()
    read(path)
    return time.process_time() - start
