"""Tests of the core bench on artificial results."""

import math

import numpy as np
import pytest

from lsvision.planning import section_bound
from lsvision.simulate import SectionSettings, random_section
from lsvision.simulate.section import noise_std
from tests.bench.core.bound import bound_radius
from tests.bench.core.laws import SENSOR_LAWS, compare_radii, insert_lost_rows, reverse
from tests.bench.core.scenes import SETS, make_scene
from tests.bench.core.score import score_set

SEED = 5


def perfect(scene, radius_std=0.1):
    """Results that hold the truth of a scene."""
    cylinders = [
        {
            "radius": tube.radius,
            "radius_std": radius_std,
            "indices": np.flatnonzero(scene.labels == tube.label).tolist(),
            "intervals": {"radius": [tube.radius - 0.2, tube.radius + 0.2]},
        }
        for tube in scene.tubes
    ]
    return {"cylinders": cylinders, "ms": 1.0, "warnings": []}


@pytest.mark.parametrize("name", SETS)
def test_a_scene_is_the_same_again_and_its_labels_fit_its_points(name):
    first, again = make_scene(name, 3, SEED), make_scene(name, 3, SEED)
    np.testing.assert_array_equal(first.points, again.points)
    assert len(first.labels) == len(first.points)
    for tube in first.tubes:
        assert np.isfinite(first.points[first.labels == tube.label]).all()


def test_the_truth_scores_without_fault():
    scenes = [make_scene("A", index, SEED) for index in range(7)]
    score = score_set("A", scenes, [perfect(scene) for scene in scenes])
    assert (score.f1, score.false, score.missed, score.coverage) == (1.0, 0, 0, 100.0)
    assert not score.faults


def test_wrong_results_are_counted():
    scene = make_scene("A", 1, SEED)
    result = perfect(scene)
    first, second = result["cylinders"]
    first["radius"] += 0.4
    first["intervals"]["radius"] = [first["radius"] - 0.2, first["radius"] + 0.2]
    second["indices"] = second["indices"][:3]
    score = score_set("A", [scene], [result])
    assert (score.true, score.false, score.missed) == (1, 1, 1)
    assert score.beyond(3.0) == 100.0
    assert score.beyond(5.0) == 0.0
    assert score.coverage == 0.0
    assert len(score.faults) == 3


def test_the_bound_is_that_of_the_planning():
    section = random_section("single", SEED, settings=SectionSettings(jump_fraction=0.0))
    (tube,) = section.truth.tubes
    exact = section.truth.points[section.truth.labels == 1]
    rays = exact - section.sensor.origin
    along = rays * (noise_std(exact, section.sensor) / np.hypot(*rays.T))[:, None]
    wanted = section_bound(tube.ellipse, exact, along[:, :, None] * along[:, None]).radius_std
    bound, _ = bound_radius(section, tube)
    assert bound == pytest.approx(wanted, rel=1e-9)


def test_linear_estimates_reach_the_bound():
    pipes = [make_scene("G", index, SEED).tubes[0] for index in range(200)]
    ratio = np.array([pipe.linear_error / pipe.bound for pipe in pipes])
    assert math.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=4 / math.sqrt(2 * len(pipes)))


@pytest.mark.parametrize("law", SENSOR_LAWS)
def test_rows_of_a_changed_scene_say_where_they_come_from(law, rng):
    scene = make_scene("As", 4, SEED)
    change = SENSOR_LAWS[law](scene, rng)
    kept = np.flatnonzero(change.rows >= 0)
    before = scene.points[change.rows[kept]] - scene.sensor.origin
    after = change.scene.points[kept] - change.scene.sensor.origin
    np.testing.assert_allclose(np.hypot(*before.T), np.hypot(*after.T), rtol=1e-9)


def test_moves_and_counts_of_a_law_are_reported(rng):
    scene = make_scene("As", 1, SEED)
    change = insert_lost_rows(reverse(scene, rng).scene, rng)
    back = len(scene.points) - 1 - change.rows
    rows = np.where(change.rows < 0, -1, back)
    old, new = perfect(scene), perfect(scene)
    for cylinder in new["cylinders"]:
        own = np.isin(rows, cylinder["indices"])
        cylinder["indices"] = np.flatnonzero(own).tolist()
        cylinder["radius"] += 0.05
    changed = type(change)(change.scene, rows)
    score = compare_radii("made up", [changed], [old], [new])
    assert score.worst == pytest.approx(0.5)
    assert score.counts_changed == 0
    new["cylinders"].pop()
    assert compare_radii("made up", [changed], [old], [new]).counts_changed == 1
