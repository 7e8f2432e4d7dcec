"""The whole pipeline on scenes of a second simulator, whose noise it has to estimate."""

import numpy as np
import pytest

from lsvision import Profile, measure_cylinders
from tests.bench.matching import point_iou
from tests.other_scenes import other_scene

SCENES = 12
FIRST_SEED = 40_000
SAME_TUBE = 0.8
"""Least share of common points; the foot of a bead lies within the noise."""
FIVE_SIGMA = 5.0

KINDS = {
    "one": {"tubes": 1},
    "three": {"tubes": 3},
    "clutter only": {"tubes": 0, "cluttered": True},
    "one in clutter": {"tubes": 1, "cluttered": True},
    "welded": {"tubes": 2, "welded": True},
    "welded in clutter": {"tubes": 2, "welded": True, "cluttered": True},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(FIRST_SEED, FIRST_SEED + SCENES))
def test_every_tube_is_found_and_nothing_else(kind, seed):
    points, labels, tubes = other_scene(np.random.default_rng(seed), **KINDS[kind])
    found = measure_cylinders(Profile(points)).cylinders
    assert len(found) == len(tubes)
    for label, (tube, cylinder) in enumerate(zip(tubes, found, strict=True), 1):
        assert point_iou(cylinder.indices, labels == label) >= SAME_TUBE
        assert abs(cylinder.radius - tube.radius) <= FIVE_SIGMA * cylinder.radius_std
