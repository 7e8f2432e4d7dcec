"""Processor time of laser lines, profiles of images, and scans, compared with another commit.

One process for each commit is timed in turn, so that other processes of the machine affect both.
"""

import os
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from lsvision.geometry import Pose
from lsvision.io.profiles import read_profile
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_scan
from tests.bench.goals import Number
from tests.laser_line.line_scenes import CLUTTER, pipe_on_floor, plank, rendered

ROOT = Path(__file__).parents[2]
WORKER = Path(__file__).with_name("timed_calls.py")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
GOALS = {"line": 0.65, "profile": 0.8, "scan": 0.7}
"""Largest ratio to the base commit for each kind of input, the first word of its name."""
IMAGE_CALLS = 5
"""Number of calls with an image of which a process returns the median; a scan is called once."""
SECOND_LINE_PX = 200
"""Distance of the lines of the image with two. Units: px."""
FIXTURE_FEED_MM = 2.0
"""Feed between the sections of the scans in ``fixtures``. Units: mm."""
LONG_SCAN_SECTIONS, LONG_SCAN_MM = 100, 100.0
PIPES = ((12.0, -45.0), (19.0, 0.0), (15.0, 45.0))
"""Radius and X of each pipe of the long scan. Units: mm."""


def images():
    """Return one image of 1280 x 1024 (one of them upright) of each kind, by name."""
    pipe = rendered(pipe_on_floor(), 1).image
    clutter = rendered(pipe_on_floor(), 1, speckle_looks=4, stray=CLUTTER).image
    grey = (0.1 * pipe.astype(float)).astype(np.uint8)
    return {
        "clean": rendered(plank(), 1).image,
        "pipe": pipe,
        "pipe in speckle and clutter": clutter,
        "diagonal": rendered(plank(0.7), 1).image,
        "upright": np.ascontiguousarray(pipe.T[:, ::-1]),
        "two lines": np.maximum(pipe, np.roll(pipe, SECOND_LINE_PX, axis=0)),
        "colour": np.stack([grey, grey, pipe], axis=2),
    }


def scans():
    """Yield name, k profiles (lists of (n, 2) points) and translations (k, 3) of each scan."""
    for folder in sorted((ROOT / "fixtures").glob("scan_*")):
        points = [read_profile(path).points for path in sorted(folder.glob("*.csv"))]
        yield folder.name, points, _along(FIXTURE_FEED_MM * np.arange(len(points)))
    feed = np.linspace(0.0, LONG_SCAN_MM, LONG_SCAN_SECTIONS)
    poses = [Pose.along((0.0, 0.0, 1.0), step) for step in feed]
    tubes = [Tube.of(radius, 0.4, 0.1, (x, -400.0)) for radius, x in PIPES]
    seen = simulate_scan(
        Scene(tuple(tubes)), poses, SCENE_SENSOR, SectionSettings(), rng=np.random.default_rng(1)
    )
    name = f"{LONG_SCAN_SECTIONS} sections, {len(PIPES)} pipes"
    yield name, [section.profile.points for section in seen], _along(feed)


def _along(feed):
    """Return translations (k, 3) along Z."""
    return np.outer(feed, [0.0, 0.0, 1.0])


def write_inputs(folder):
    """Write a file for each call that is timed, and return their names.

    A name starts with "line" (of an image), "profile" (of an image) or "scan".
    """
    names = []
    for name, image in images().items():
        for what in ("line", "profile"):
            if what == "profile" and image.shape[:2] != (1024, 1280):
                continue  # the camera of the worker has this size
            np.savez(folder / f"{what} {name}.npz", image=image)
            names.append(f"{what} {name}")
    for name, points, translations in scans():
        arrays = {"points": np.concatenate(points), "counts": [len(each) for each in points]}
        np.savez(folder / f"scan {name}.npz", translations=translations, **arrays)
        names.append(f"scan {name}")
    return names


@contextmanager
def started_worker(tree, folder):
    """Start a worker with the lsvision of a tree; yield a function from a name to seconds."""
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)}
    with subprocess.Popen(
        [sys.executable, "-P", str(WORKER), str(folder)], cwd=tree, env=environment, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip

        def seconds(name):
            calls = 1 if name.startswith("scan") else IMAGE_CALLS
            process.stdin.write(f"{calls} {name}.npz\n")
            process.stdin.flush()
            return float(process.stdout.readline())

        yield seconds


def compare(base, folder, image_rounds, scan_rounds):
    """Yield the median ratio of this commit's time to that of the tree `base` for each input."""
    names = write_inputs(folder)
    with ExitStack() as stack:
        old, new = (stack.enter_context(started_worker(tree, folder)) for tree in (base, ROOT))
        for name in names:
            rounds = scan_rounds if name.startswith("scan") else image_rounds
            pairs = np.array([(old(name), new(name)) for _ in range(rounds)])
            before, after = 1e3 * np.median(pairs, axis=0)
            ratio = float(np.median(pairs[:, 1] / pairs[:, 0]))
            goal, note = GOALS[name.split()[0]], f"{before:.1f} and {after:.1f} ms"
            yield Number(f"{name} / base", ratio, high=goal, note=note)
