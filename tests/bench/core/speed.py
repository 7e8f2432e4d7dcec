"""Time of one profile; of two trees in alternating rounds on one core, so that the ratio counts."""

import os

import numpy as np

from lsvision.simulate import random_section
from tests.bench.core.scenes import CoreScene
from tests.bench.goals import Number

TIMED_SCENES = 16
SEED_OFFSET = 60_000
"""Offset of the seeds of these scenes from the first seed of the bench."""
KINDS = {
    "single": ("one pipe", 0.6),
    "welded_complex": ("welded pair in clutter", 0.7),
}
"""Description of each kind, and goal of its ratio."""


def measure_speed(trees, rounds, seed):
    """Rows of each tree: medians in ms and, against a second tree, the ratio of medians."""
    core = max(os.sched_getaffinity(0))
    rows = [[] for _ in trees]
    for kind, (words, goal) in KINDS.items():
        scenes = _scenes(kind, seed + SEED_OFFSET)
        times = [[] for _ in trees]
        paths = [str(tree.store(scenes, f"timed {kind}")) for tree in trees]
        for round_ in range(rounds + 1):
            for tree, tree_times, path in zip(trees, times, paths, strict=True):
                ms = tree.workers[0].ask(do="time", scenes=path, core=core)
                tree_times.extend(ms if round_ else [])  # the first round is not counted
        medians = [float(np.median(tree_times)) for tree_times in times]
        for tree_rows, median in zip(rows, medians, strict=True):
            tree_rows.append(Number(f"speed: {words}, median", median, unit="ms"))
        if len(trees) > 1:
            ratio = medians[0] / medians[1]
            note = f"{rounds} alternating rounds of {len(scenes)} scenes"
            rows[0].append(Number(f"speed: {words}, ratio", ratio, high=goal, note=note))
    return [(tree_rows, []) for tree_rows in rows]


def _scenes(kind, seed):
    sections = [random_section(kind, seed + i) for i in range(TIMED_SCENES)]
    return [
        CoreScene("", kind, "", section.profile.points, section.truth.labels)
        for section in sections
    ]
