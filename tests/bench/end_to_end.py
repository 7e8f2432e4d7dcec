"""Time of whole commands compared with commit 3666f4e.

``python -m tests.bench end_to_end [--quick]``. Processor time, because other processes use the
machine, and with the same libraries; wall time where several processes are compared.
"""

import argparse
import csv
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lsvision.cli.measure_files import TASK_SIZE
from lsvision.ellipse.section import precompute_intervals
from lsvision.measure import measure_profiles
from lsvision.profile import Profile
from lsvision.simulate import random_section
from tests.bench.goals import Number, print_numbers

BASE = "3666f4e"
"""Commit that the times are compared with."""
ROOT = Path(__file__).parents[2]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
FIRST_SEED = 930_000
COPIES = 5
"""Number of copies of each file, whose measurement is compared for one and for two processes."""
PITCH_MM = 0.3
RADIUS_MM, VISIBLE_HALF_WIDTH = 25.0, 0.9
"""Radius of the pipe of the matrix (mm), and the half width of its visible part in radii."""


@dataclass(frozen=True)
class Effort:
    """Numbers of inputs of each part.

    `files` of two pipes each; `rows` of a matrix, and `base_rows` for the base, which is slower;
    `batch_profiles` in Parquet files; `sections` whose intervals are timed; numbers of rounds with
    `images` and with `scans`.
    """

    files: int
    rows: int
    base_rows: int
    batch_profiles: int
    sections: int
    images: int
    scans: int


QUICK = Effort(
    files=40, rows=300, base_rows=20, batch_profiles=1500, sections=40, images=21, scans=3
)
FULL = Effort(
    files=200, rows=2000, base_rows=100, batch_profiles=100_000, sections=100, images=61, scans=9
)


def points_of(count, kind="welded_pair"):
    """Return the points of `count` sections, of which 32 differ."""
    sections = [random_section(kind, FIRST_SEED + k).profile.points for k in range(min(count, 32))]
    return [sections[k % len(sections)] for k in range(count)]


LAUNCHER = """
import json, resource, subprocess, sys, time
start = time.monotonic()
done = subprocess.run(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
numbers = used.ru_utime + used.ru_stime, time.monotonic() - start, used.ru_maxrss / 1e3
print(json.dumps(numbers), file=sys.stderr)
sys.exit(done.returncode)
"""
"""Program that runs a command and prints its processor time, wall time (s) and memory (MB).

It is a process of its own because the largest memory of a child is at least that of its parent.
"""


def run(tree, *words):
    """Return processor and wall time of a command (s), and memory of its largest process (MB)."""
    command = [sys.executable, "-P", "-m", "lsvision", *map(str, words)]
    done = subprocess.run(
        [sys.executable, "-I", "-c", LAUNCHER, *command], cwd=tree, text=True,
        env=os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)}, capture_output=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{tree}: {words}: {done.stderr[-500:]}")
    return json.loads(done.stderr.splitlines()[-1])


def files_of_two_pipes(base, effort, folder):
    """Yield the times of ``lsvision measure`` for a folder of CSV files, by one and by two jobs."""
    files = folder / "files"
    files.mkdir()
    for number, points in enumerate(points_of(effort.files)):
        np.savetxt(files / f"{number:04}.csv", points, delimiter=",", fmt="%.4f")
    outputs = "--csv", folder / "o.csv", "--json", folder / "o.json"
    old, _, _ = run(base, "measure", files, *outputs)
    new, alone, _ = run(ROOT, "measure", files, *outputs, "--jobs", 1)
    _, both, _ = run(ROOT, "measure", files, *outputs, "--jobs", 2)
    note = f"{old:.1f} and {new:.1f} s of processor"
    what = f"{effort.files} CSV files of two pipes, --csv --json: times faster"
    yield Number(what, old / new, low=25, note=note)
    yield Number("the same with two processes: times faster than one", alone / both, low=1.7)
    _, start, _ = run(ROOT, "measure", next(files.iterdir()), *outputs)
    note = f"Amdahl's law: {start:.2f} of {alone:.2f} s are the start, which one file takes, too"
    limit = alone / (start + (alone - start) / 2)
    yield Number("the most that two processes can be faster", limit, note=note)
    side_by_side = _wall_of_two_commands(sorted(files.iterdir()), folder)
    note = "two independent commands, each with half of the files"
    yield Number("for comparison, two commands at once", alone / side_by_side, note=note)
    yield from _many_more_files(files, folder, outputs)


def _many_more_files(files, folder, outputs):
    """Yield how much faster two processes are for copies of files, where the start counts less."""
    many = folder / "many"
    many.mkdir()
    for source in files.iterdir():
        for copy in range(COPIES):
            shutil.copy(source, many / f"{copy}_{source.name}")
    _, alone, _ = run(ROOT, "measure", many, *outputs, "--jobs", 1)
    _, both, _ = run(ROOT, "measure", many, *outputs, "--jobs", 2)
    count = sum(1 for _ in many.iterdir())
    yield Number(f"{count} files: two processes, times faster than one", alone / both, low=1.7)


def _wall_of_two_commands(files, folder):
    """Return the wall time (s) of two commands at once, each with half of the files."""

    def measure(first):
        outputs = "--csv", folder / f"{first}.csv", "--json", folder / f"{first}.json"
        run(ROOT, "measure", *files[first::2], *outputs, "--jobs", 1)

    start = time.monotonic()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(measure, (0, 1)))
    return time.monotonic() - start


def matrix(base, effort, folder):
    """Yield the times of a matrix of heights per row, the time to start the command included.

    The base measures fewer rows.
    """
    x = np.arange(400) * PITCH_MM - 60
    pipe = RADIUS_MM * (np.sqrt(np.maximum(1 - (x / RADIUS_MM) ** 2, 0.0)) - 1) - 400
    heights = np.where(np.abs(x) < VISIBLE_HALF_WIDTH * RADIUS_MM, pipe, -450.0)
    rng = np.random.default_rng(1)
    rows = heights + rng.normal(0, 0.02, (effort.rows, 400))
    small, large = folder / "small.npy", folder / "large.npy"
    np.save(small, rows[: effort.base_rows])
    np.save(large, rows)
    options = "--x0", -60, "--dx", PITCH_MM, "--csv", folder / "m.csv"
    old, _, _ = run(base, "measure", small, *options)
    base_cylinders = _cylinders_in(folder / "m.csv")
    new, _, memory = run(ROOT, "measure", large, *options, "--jobs", 1)
    cylinders = _cylinders_in(folder / "m.csv")
    yield Number(
        "cylinders a row, the smaller number of both commits",
        min(base_cylinders / effort.base_rows, cylinders / effort.rows),
        low=0.99,
    )
    _, _, small_memory = run(ROOT, "measure", small, *options, "--jobs", 1)
    ratio = old / effort.base_rows / (new / effort.rows)
    note = f"{effort.base_rows / old:.1f} and {effort.rows / new:.0f} profiles a second"
    yield Number(f"matrix of {effort.rows} x 400, --csv: times faster", ratio, low=40, note=note)
    increase = memory - small_memory
    yield Number("its memory above that for the rows of the base", increase, high=20, unit="MB")


def _cylinders_in(path):
    """Return the number of cylinders in a CSV file of results."""
    with path.open(newline="") as file:
        return sum(bool(row["radius_mm"]) for row in csv.DictReader(file))


def batch(_base, effort, folder):
    """Yield profiles per second and memory of ``lsvision batch``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    source = folder / "in"
    source.mkdir()
    files = max(2, effort.batch_profiles // 10_000)
    for number in range(files):
        points = points_of(effort.batch_profiles // files)
        table = pa.table({"x": [p[:, 0] for p in points], "z": [p[:, 1] for p in points]})
        pq.write_table(table, source / f"{number:03}.parquet")
    _, wall, memory = run(ROOT, "batch", source, "--out", folder / "out", "--jobs", 2)
    rate = effort.batch_profiles / wall
    what = f"batch of {effort.batch_profiles} profiles of two pipes, two processes"
    yield Number(what, rate, low=400, unit="1/s")
    note = "with two of them and one of 75 MB it uses 600 MB"
    yield Number("its largest process", memory, high=260, unit="MB", note=note)


def intervals(_base, effort, _folder):
    """Yield the time of all intervals over that of the measurement, for one and many profiles."""
    for kind in ("single", "welded_pair"):
        profiles = [Profile(points) for points in points_of(effort.sections, kind)]
        one_by_one = [_measure_and_bound([profile]) for profile in profiles]
        groups = [profiles[k : k + TASK_SIZE] for k in range(0, len(profiles), TASK_SIZE)]
        together = [_measure_and_bound(group) for group in groups if len(group) == TASK_SIZE]
        medians = [np.median(times, axis=0) for times in (one_by_one, together)]
        for how, (measuring, bounding) in zip(
            ("", f", {TASK_SIZE} profiles at once"), medians, strict=True
        ):
            what = f"intervals of a profile / its measurement, {kind}{how}"
            note = f"{1e3 * bounding:.2f} and {1e3 * measuring:.2f} ms"
            yield Number(what, bounding / measuring, high=1.0, note=note)
        ratio = medians[1].sum() / medians[0].sum()
        yield Number(f"{TASK_SIZE} profiles at once / one by one, {kind}, with intervals", ratio)


def _measure_and_bound(profiles):
    """Return the processor time per profile (s) of the measurement and of all intervals."""
    measurements, measuring = _timed(lambda: measure_profiles(profiles))
    cylinders = [cylinder for each in measurements for cylinder in each.cylinders]
    _, bounding = _timed(lambda: precompute_intervals(cylinders))
    return measuring / len(profiles), bounding / len(profiles)


def _timed(function):
    """Return the value of a function, and its processor time (s)."""
    start = time.process_time()
    value = function()
    return value, time.process_time() - start


def start_up(base, _effort, _folder):
    """Yield the time of ``lsvision measure`` for one file."""
    file = ROOT / "fixtures/welded_pair.csv"
    rounds = [(run(base, "measure", file)[0], run(ROOT, "measure", file)[0]) for _ in range(5)]
    old, new = np.median(rounds, axis=0)
    note = f"{old:.2f} and {new:.2f} s of processor"
    yield Number("lsvision measure FILE / base", new / old, high=0.45, note=note)


def images_and_scans(base, effort, folder):
    """Yield the rows of `tests.bench.images_and_scans`."""
    from tests.bench.images_and_scans import compare

    yield from compare(base, folder, effort.images, effort.scans)


PARTS = {
    part.__name__: part
    for part in (start_up, intervals, files_of_two_pipes, matrix, batch, images_and_scans)
}
"""Each part by name: a function of the tree of the base, an effort and an empty folder."""


def main(arguments=None):
    """Measure the parts and print their rows."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench end_to_end", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer files and profiles")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="lsvision_bench_") as name:
        folder = Path(name)
        archive = subprocess.run(
            ["git", "archive", BASE, "lsvision"], cwd=ROOT, capture_output=True, check=True
        ).stdout
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(folder / "base", filter="data")
        for part in options.only:
            part_folder = folder / part
            part_folder.mkdir()
            effort = QUICK if options.quick else FULL
            print_numbers(part, PARTS[part](folder / "base", effort, part_folder))
