"""Time of one measurement on one core.

Processor time of this one thread, because the machine is shared: what others do to it shows in
wall time at random. The minimum stands beside the median for the same reason.
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
"""Least points of the real profiles that stand for 1280."""
HELP_RUNS = 9
LONG_FILE_POINTS, READING_RUNS = 100_000, 5


@dataclass(frozen=True)
class Times:
    """Seconds of many runs."""

    what: str
    seconds: np.ndarray

    @property
    def median(self):
        return float(np.median(self.seconds))

    @property
    def p95(self):
        return float(np.percentile(self.seconds, 95))

    def rows(self, goal_ms):
        note = f"min {1e3 * self.seconds.min():.2f}, {len(self.seconds)} runs"
        yield Number(f"{self.what}, median", 1e3 * self.median, high=goal_ms, unit="ms", note=note)
        yield Number(f"{self.what}, p95 / median", self.p95 / self.median, high=2.0)


@dataclass(frozen=True)
class LiteralTimes:
    """The same profiles by lsvision, and twice by the paper's pipeline.

    `typed` is the pipeline as one types it in, its fits left to scipy's `least_squares` as it
    stands: unknowns x_0, y_0, a, b, theta, derivatives by differences. The paper says no more,
    and the design page's 5 to 6 s a profile are this pipeline's.
    `measure_cylinders_paper` reaches the same minima with parameters and derivatives of ours.
    """

    kind: str
    ours: Times
    paper: Times
    typed: Times

    @property
    def rows(self):
        note = f"{self.typed.median:.1f} s a profile"
        ratio = self.typed.median / self.ours.median
        yield Number(f"times the literal pipeline as typed, {self.kind}", ratio, 500, note=note)
        ratio = self.paper.median / self.ours.median
        yield Number(f"times measure_cylinders_paper, {self.kind}", ratio)


@dataclass(frozen=True)
class Speed:
    single: Times
    pair: Times
    real: Times | None
    literal: tuple["LiteralTimes", ...]
    growth: tuple[Times, ...]
    lacking: int
    show_help: np.ndarray
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
        # Failing is fast: growth counts only while the tubes are found.
        yield Number("growth: tubes missed at all sizes", self.lacking, high=0)
        note = f"min {self.show_help.min():.2f}, wall"
        yield Number(
            "lsvision --help", float(np.median(self.show_help)), high=0.3, unit="s", note=note
        )
        note = f"{LONG_FILE_POINTS} points of a plain CSV, median of {READING_RUNS} rounds"
        yield Number("read_profile / numpy.loadtxt", self.reading, high=2.0, note=note)


def measure_speed(scenes, repeats):
    """Times over `scenes` random scenes of a kind, each measured `repeats` times."""
    cv2.setNumThreads(1)
    single = [random_section("single", FIRST_SEED + i).profile for i in range(scenes)]
    pair = [random_section("welded_complex", FIRST_SEED + i).profile for i in range(scenes)]
    growth, lacking = _time_growth(scenes // 2, repeats)
    few = max(scenes // 8, 2)
    kinds = (("single", single[:few]), ("welded pair in clutter", pair[:few]))
    return Speed(
        single=time_measuring("single, 376 points", single, repeats),
        pair=time_measuring("welded pair in clutter, 376 points", pair, repeats),
        real=_time_real(repeats),
        literal=tuple(_literal_times(*kind, repeats) for kind in kinds),
        growth=growth,
        lacking=lacking,
        show_help=np.array([_time_help() for _ in range(HELP_RUNS)]),
        reading=_compare_reading(),
    )


def time_measuring(what, profiles, repeats, measure=measure_cylinders):
    """Each profile `repeats` times after one that is not counted."""
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
    with mock.patch("lsvision.studies.chen_liu_2016.paper_pipeline.fit_ellipse", _fit_as_typed):
        typed = time_measuring("literal pipeline as typed", profiles, 1, measure_cylinders_paper)
    return LiteralTimes(kind, ours, paper, typed)


def _fit_as_typed(points, start, **options):
    first = (*start.centre, start.semi_major, start.semi_minor, start.theta)
    x, y, a, b, theta = least_squares(_radial_distances, first, args=points.T).x
    # What makes an EllipseFit of it starts at the minimum, and adds a tenth to the time.
    return fit_ellipse(points, Ellipse.from_axes((x, y), abs(a), abs(b), theta), **options)


def _radial_distances(unknowns, x, y):
    """The paper's r_j, Eq. (4), written so that it has a value at x_j = x_0 too."""
    x0, y0, a, b, theta = unknowns
    u = (x - x0) * math.cos(theta) + (y - y0) * math.sin(theta)
    v = (y - y0) * math.cos(theta) - (x - x0) * math.sin(theta)
    rho = np.hypot(u, v)
    return rho - abs(a * b) * rho / np.hypot(b * u, a * v)


def _time_real(repeats):
    if not real_data():
        return None
    files = sorted((REAL / "sphere-profiles").glob("*.csv"))
    profiles = [profile for profile in map(read_profile, files) if len(profile) >= LONG_PROFILE]
    return time_measuring(f"real, {LONG_PROFILE} points and more", profiles, min(repeats, 3))


def _welded_pairs(columns, scenes):
    """The same scenes at any number of columns."""
    sensor = replace(SCENE_SENSOR, columns=columns)
    for seed in range(FIRST_SEED, FIRST_SEED + scenes):
        rng = np.random.default_rng(seed)
        scene = SCENE_KINDS["welded_complex"](rng, TubeRanges())
        yield simulate_section(scene, sensor, SectionSettings(), rng=rng)


def _time_growth(scenes, repeats):
    """Times at each size, and the tubes that were missed meanwhile."""
    growth, lacking = [], 0
    for columns in COLUMNS:
        sections = list(_welded_pairs(columns, scenes))
        profiles = [section.profile for section in sections]
        growth.append(time_measuring(str(columns), profiles, min(repeats, 3)))
        for section in sections:
            found = measure_cylinders(section.profile)
            lacking += len(match_tubes(found, section.truth).missed)
    return tuple(growth), lacking


def _time_help():
    """Wall and processor seconds of one ``lsvision --help`` in a process of its own."""
    start, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "lsvision", "--help"], check=True, stdout=subprocess.DEVNULL
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime - used.ru_utime + after.ru_stime - used.ru_stime
    return time.perf_counter() - start, processor


def _compare_reading():
    """Processor time of reading a plain CSV, over that of `numpy.loadtxt` on the same file."""
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
