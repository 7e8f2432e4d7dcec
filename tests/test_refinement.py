"""What an arc's own fit tells of its last points, on seeds used for nothing else."""

import numpy as np

from lsvision import Settings, measure_cylinders
from lsvision.detection.end_extension import EndExtensionSettings
from lsvision.simulate import random_section, simulate_section
from tests.bench.single_section import ROUGH, random_tube

UNREACHING = Settings(end_extension=EndExtensionSettings(max_iterations=0))


def test_each_end_that_a_fit_reaches_makes_it_surer_of_the_other():
    """Jumps in a row next to a lost line: growth leaves six last points at either end."""
    scene, sensor = random_tube(888_000, (15.0, 40.0))
    section = simulate_section(scene, sensor, ROUGH, rng=np.random.default_rng([888_000, 49]))
    own = np.flatnonzero(section.truth.labels == 1)
    (whole,) = measure_cylinders(section.profile).cylinders
    (part,) = measure_cylinders(section.profile, settings=UNREACHING).cylinders
    assert len(part.indices) <= len(own) - 12
    np.testing.assert_array_equal(whole.indices, own)


def test_an_arc_does_not_reach_for_what_makes_it_no_pipe():
    """Its ellipse is so unsure (20 %) that a point of the clutter fits it, at 63 deg of tilt."""
    section = random_section("welded_complex", 10_370)
    smaller, _ = sorted(section.truth.tubes, key=lambda tube: tube.radius)
    pipe, _ = measure_cylinders(section.profile).cylinders
    assert abs(pipe.radius - smaller.radius) < 2 * pipe.radius_std
