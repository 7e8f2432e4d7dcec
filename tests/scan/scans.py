"""Simulated scans; the simulator shares no code with what is tested."""

import dataclasses

import numpy as np

from lsvision.geometry import Pose
from lsvision.profile import Profile
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, simulate_scan


def feed(count: int, step: float) -> list[Pose]:
    return [Pose.along((0.0, 0.0, 1.0), step * k) for k in range(count)]


def profiles_of(
    scene: Scene, poses: list[Pose], noise: float = 0.05, seed: int = 1
) -> list[Profile]:
    sensor = dataclasses.replace(SCENE_SENSOR, range_std=noise)
    rng = np.random.default_rng(seed)
    seen = simulate_scan(scene, poses, sensor, SectionSettings(), rng=rng)
    return [section.profile for section in seen]
