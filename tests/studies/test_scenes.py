"""Scenes of Table 5 and Figures 14 and 15, and how results are matched with pipes."""

from dataclasses import replace

import pytest

from lsvision.measure import Measurement, measure_cylinders
from lsvision.simulate import random_section
from lsvision.studies.chen_liu_2016.paper_pipeline import measure_cylinders_paper
from lsvision.studies.chen_liu_2016.scenes import TUBES, count_matches, measure_scenes


def test_every_pipe_of_a_scene_is_found_within_5_sigma(scenes):
    pipes = [pipe for scene in scenes for pipe in scene.pipes]
    assert len(pipes) == 6
    for pipe in pipes:
        value, std = pipe.radius_mm
        assert abs(value - pipe.true_radius_mm) < 5 * std
    assert sum(scene.false for scene in scenes) == 0


def test_results_match_pipes_by_their_points():
    section = random_section("welded_pair", 0, noise_mm=0.05, tubes=TUBES)
    found = measure_cylinders(section.profile, radius=(10.0, 40.0))
    assert count_matches(found, section.truth) == (2, 0)
    twice = Measurement((*found.cylinders, found.cylinders[0]), ())
    assert count_matches(twice, section.truth) == (2, 1)
    assert count_matches(Measurement((), ()), section.truth) == (0, 0)


def test_a_result_that_counts_as_false_is_not_shown_as_the_pipe(scenes, monkeypatch):
    other = random_section("single", 7, noise_mm=0.05, tubes=TUBES)
    (pipe,) = measure_cylinders(other.profile, radius=(10.0, 40.0)).cylinders

    def measure(profile, **options):
        found = measure_cylinders(profile, **options).cylinders
        fragment = replace(pipe, indices=found[0].indices[:9])
        return Measurement((fragment, *found), ())

    monkeypatch.setattr("lsvision.studies.chen_liu_2016.scenes.measure_cylinders", measure)
    fragmented = measure_scenes(noise_mm=0.1)
    assert [scene.false for scene in fragmented] == [1] * 4
    assert [scene.pipes for scene in fragmented] == [scene.pipes for scene in scenes]


@pytest.mark.paper
def test_the_papers_chain_reports_planes():
    section = random_section("planar", 0, noise_mm=0.1, tubes=TUBES)
    literal = measure_cylinders_paper(section.profile, radius=(10.0, 40.0))
    assert count_matches(literal, section.truth)[1] >= 1
    ours = measure_cylinders(section.profile, radius=(10.0, 40.0))
    assert count_matches(ours, section.truth) == (1, 0)
