"""Processor time of lines, profiles of images, and scans, beside that of another commit.

One process for each commit answers in turn, so that what others do to the machine meets both.
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
"""Largest ratio to the base, by the first word of a name."""
IMAGE_CALLS = 5
"""Calls for each answer of a process; one for a scan."""
SECOND_LINE_PX = 200
FIXTURE_FEED_MM = 2.0
LONG_SCAN_SECTIONS, LONG_SCAN_MM = 100, 100.0
PIPES = ((12.0, -45.0), (19.0, 0.0), (15.0, 45.0))
"""Radius and place across the feed of the pipes of the long scan. Units: mm."""


def images():
    """One image of 1280 x 1024 of each kind, by name."""
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
    """Profiles (lists of (n, 2) points) and translations (k, 3) of scans, by name."""
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
    return np.outer(feed, [0.0, 0.0, 1.0])


def write_inputs(folder):
    """Write the inputs of all calls; return their names."""
    names = []
    for name, image in images().items():
        for what in ("line", "profile"):
            if what == "profile" and image.shape[:2] != (1024, 1280):
                continue
            np.savez(folder / f"{what} {name}.npz", image=image)
            names.append(f"{what} {name}")
    for name, points, translations in scans():
        arrays = {"points": np.concatenate(points), "counts": [len(each) for each in points]}
        np.savez(folder / f"scan {name}.npz", translations=translations, **arrays)
        names.append(f"scan {name}")
    return names


@contextmanager
def answering(tree, folder):
    """A process with the lsvision of a tree; yields a function from a name to seconds."""
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
    """Medians of the ratios of the two trees, each pair of calls measured in turn."""
    names = write_inputs(folder)
    with ExitStack() as stack:
        old, new = (stack.enter_context(answering(tree, folder)) for tree in (base, ROOT))
        for name in names:
            rounds = scan_rounds if name.startswith("scan") else image_rounds
            pairs = np.array([(old(name), new(name)) for _ in range(rounds)])
            before, after = 1e3 * np.median(pairs, axis=0)
            ratio = float(np.median(pairs[:, 1] / pairs[:, 0]))
            goal, note = GOALS[name.split()[0]], f"{before:.1f} and {after:.1f} ms"
            yield Number(f"{name} / the base", ratio, high=goal, note=note)
