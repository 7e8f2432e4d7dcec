"""Set F: results must not depend on the order or the position of the points.

Each law makes another profile of the same points and says where each of its rows comes from, so
that pipes are matched by their points and compared by their radii.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from tests.bench.core.scenes import CoreScene, make_scene, own_scene

OWN_FRACTION = 0.6
"""Fraction of sections from the first simulator; the rest are welded ones of the second."""
SHIFT = np.array([37.0, -21.0])  # mm
TURN = math.radians(10.0)
LOST_ROWS_FRACTION = 0.2
SAME_PIPE = 0.5
"""Least share of common points for two pipes to be the same."""


@dataclass(frozen=True, eq=False)
class Changed:
    """A scene with its points in another order or place; row i was row `rows[i]`, -1 is new."""

    scene: CoreScene
    rows: np.ndarray


def law_scenes(count, seed):
    """Sections of sets A (no empty ones) and B."""
    own = round(OWN_FRACTION * count)
    indices = [i for i in range(2 * own + 7) if i % 7 != 6][:own]
    scenes = [replace(own_scene(seed, i), name=f"As:{i}") for i in indices]
    return scenes + [make_scene("B", i, seed) for i in range(count - own)]


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
    """About the sensor, whose place is known."""
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
"""Laws that need a sensor whose place is known, and all others with that sensor."""


@dataclass(frozen=True)
class LawScore:
    """Sections, those whose cylinders are others, and the moves of all radii in sigma."""

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
    """How far any radius has moved."""
    counts, moves, faults = 0, [], []
    for change, first, second in zip(changed, before, after, strict=True):
        old, new = first["cylinders"], second["cylinders"]
        again = [_move(pipe, new, change.rows) for pipe in old]
        own = [move for move in again if move is not None]
        if len(old) != len(new) or len(own) != len(old):
            counts += 1
            faults.append(f"{change.scene}: {law}, {len(old)} cylinders became {len(new)}")
        moves += own
        worst = max(own, default=0.0)
        if worst > 0.01:
            faults.append(f"{change.scene}: {law}, a radius moved by {worst:.3f} sigma")
    return LawScore(law, len(changed), counts, np.array(moves), tuple(faults))


def _move(pipe, others, rows):
    """By how many sigma the same pipe's radius differs; None where it is not found again."""
    own = set(pipe["indices"])
    for other in others:
        theirs = set(rows[other["indices"]].tolist())
        if len(own & theirs) > SAME_PIPE * len(own | theirs):
            return abs(other["radius"] - pipe["radius"]) / pipe["radius_std"]
    return None


def _changed(scene, points, rows):
    return Changed(replace(scene, points=points), rows)
