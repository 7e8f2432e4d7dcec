"""Set F: results must not depend on the order or the position of the points.

Each law makes another profile of the same points, and returns from which row each of its rows
comes, so that pipes are matched by their points and compared by their radii.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.simulate import SCENE_KINDS
from tests.bench.core.scenes import CoreScene, make_scene

SIMULATE_FRACTION = 0.6
"""Fraction of sections made by `lsvision.simulate`; the rest are welded ones of set B."""
SHIFT = np.array([37.0, -21.0])  # mm
TURN = math.radians(10.0)
LOST_ROWS_FRACTION = 0.2
"""Mean number of lost rows inserted per point."""
SAME_PIPE_IOU = 0.5
"""Smallest intersection over union of the points of two results that are the same pipe."""
MAX_LAW_SIGMAS = 0.01
"""Goal: largest move of a radius, in its standard uncertainties."""


@dataclass(frozen=True, eq=False)
class Changed:
    """A scene whose points have another order or place; row i was row `rows[i]`, -1 is new."""

    scene: CoreScene
    rows: np.ndarray


def law_scenes(count, seed):
    """Return sections of set As, those of its kind without pipes left out, and of set B."""
    simulated, kinds = round(SIMULATE_FRACTION * count), list(SCENE_KINDS)
    with_pipes = (i for i in itertools.count() if kinds[i % len(kinds)] != "empty")
    indices = itertools.islice(with_pipes, simulated)
    scenes = [make_scene("As", i, seed) for i in indices]
    return scenes + [make_scene("B", i, seed) for i in range(count - simulated)]


def reverse(scene, rng):
    rows = np.arange(len(scene.points))[::-1]
    return _changed(scene, scene.points[rows], rows)


def mirror(scene, rng):
    sensor = scene.sensor
    if sensor is not None:
        sensor = replace(sensor, origin=(-sensor.origin[0], sensor.origin[1]))
    points = scene.points * [-1.0, 1.0]
    return _changed(replace(scene, sensor=sensor), points, np.arange(len(points)))


def insert_lost_rows(scene, rng):
    after = np.flatnonzero(rng.random(len(scene.points)) < LOST_ROWS_FRACTION) + 1
    rows = np.insert(np.arange(len(scene.points)), after, -1)
    points = np.where((rows < 0)[:, None], np.nan, scene.points[rows])
    return _changed(scene, points, rows)


def shift(scene, rng):
    sensor = scene.sensor
    if sensor is not None:
        sensor = replace(sensor, origin=tuple(np.add(sensor.origin, SHIFT).tolist()))
    points = scene.points + SHIFT
    return _changed(replace(scene, sensor=sensor), points, np.arange(len(points)))


def rotate(scene, rng):
    """Rotate the points about the sensor's origin."""
    cos, sin = math.cos(TURN), math.sin(TURN)
    origin = np.array(scene.sensor.origin)
    points = (scene.points - origin) @ np.array([[cos, sin], [-sin, cos]]) + origin
    return _changed(scene, points, np.arange(len(points)))


LAWS = {
    "reversal": reverse,
    "mirror": mirror,
    "lost rows": insert_lost_rows,
    "shift": shift,
}
SENSOR_LAWS = LAWS | {"rotation": rotate}
"""Laws of sections with a noise model, including one that needs the sensor's origin."""


@dataclass(frozen=True)
class LawScore:
    """Number of sections, of those with other cylinders, and moves of all radii in sigmas."""

    law: str
    sections: int
    counts_changed: int
    moves: np.ndarray
    faults: tuple[str, ...]

    @property
    def worst(self):
        return float(self.moves.max(initial=0.0))


def measure_law(tree, law, scenes, seed):
    """Measure scenes before and after a law's change."""
    changed = [
        SENSOR_LAWS[law](scene, np.random.default_rng([seed, index]))
        for index, scene in enumerate(scenes)
    ]
    before = tree.measure(scenes, ())
    after = tree.measure([change.scene for change in changed], ())
    return compare_radii(law, changed, before, after)


def compare_radii(law, changed, before, after):
    """Score the results of changed scenes against those of the original ones."""
    counts, moves, faults = 0, [], []
    for change, first, second in zip(changed, before, after, strict=True):
        old, new = first["cylinders"], second["cylinders"]
        matched = [_move(pipe, new, change.rows) for pipe in old]
        found = [move for move in matched if move is not None]
        if len(old) != len(new) or len(found) != len(old):
            counts += 1
            faults.append(f"{change.scene}: {law}, {len(old)} cylinders became {len(new)}")
        moves += found
        worst = max(found, default=0.0)
        if worst > MAX_LAW_SIGMAS:
            faults.append(f"{change.scene}: {law}, a radius moved by {worst:.3f} sigma")
    return LawScore(law, len(changed), counts, np.array(moves), tuple(faults))


def _move(pipe, others, rows):
    """Return by how many sigmas the same pipe's radius differs; None if it is not found again."""
    points = set(pipe["indices"])
    for other in others:
        other_points = set(rows[other["indices"]].tolist())
        if len(points & other_points) > SAME_PIPE_IOU * len(points | other_points):
            return abs(other["radius"] - pipe["radius"]) / pipe["radius_std"]
    return None


def _changed(scene, points, rows):
    return Changed(replace(scene, points=points), rows)
