"""Text of a simulated section, parsed again."""

import dataclasses
import json

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, random_section
from lsvision.simulate.section import simulate_section
from lsvision.simulate.solids import Hits
from lsvision.simulate.text_export import format_profile, format_scan_truth, format_truth


def test_the_profile_is_recovered():
    section = random_section("planar", 2)
    lines = format_profile(section, "planar, seed 2").splitlines()
    assert lines[0] == "# planar, seed 2"
    assert lines[3] == "x [mm],z [mm]"
    back = np.loadtxt(lines[4:], delimiter=",")
    # Written with as many decimals as the sensor's quantum of 0.01 mm has.
    np.testing.assert_allclose(back, section.profile.points, rtol=0, atol=1e-9)


def test_a_sensor_without_a_quantum_is_written_with_four_decimals():
    sensor = dataclasses.replace(SCENE_SENSOR, quantum=0.0)
    tube = Tube.of(20.0, 0.0, 0.0, (0.0, -400.0))
    section = simulate_section(
        Scene((tube,)), sensor, SectionSettings(), rng=np.random.default_rng(1)
    )
    back = np.loadtxt(format_profile(section, "t").splitlines()[4:], delimiter=",")
    np.testing.assert_allclose(back, section.profile.points, rtol=0, atol=0.5001e-4)


def test_the_truth_contains_units_and_source():
    section = random_section("welded_pair", 2)
    record = json.loads(format_truth(section, {"kind": "welded_pair", "seed": 2}))
    assert (record["kind"], record["seed"]) == ("welded_pair", 2)
    assert record["labels"] == section.truth.labels.tolist()
    assert record["sensor"]["range_std_mm"] == pytest.approx(section.sensor.range_std, abs=1e-6)
    for tube, found in zip(section.truth.tubes, record["tubes"], strict=True):
        assert found["radius_mm"] == pytest.approx(tube.radius, abs=1e-6)
        assert found["theta_rad"] == pytest.approx(tube.theta, abs=1e-6)
        assert found["phi_rad"] == pytest.approx(tube.phi, abs=1e-6)
        assert found["centre_mm"] == pytest.approx(tube.centre, abs=1e-6)


def test_an_unknown_kind_of_tube_raises_an_error():
    class Pillar:
        def first_hits(self, rays):
            return Hits(np.full(len(rays.origins), np.inf), rays.directions)

        def local_cylinder(self, base_from_section):
            return None

    section = random_section("single", 1)
    with pytest.raises(TypeError, match="expected a Tube or a BentTube, got Pillar"):
        format_scan_truth(Scene((Pillar(),)), [Pose()], [section], {})


@pytest.mark.parametrize(("quantum", "decimals"), [(2.0, 0), (0.25, 2), (0.025, 3), (0.1, 1)])
def test_multiples_of_any_quantum_are_written_exactly(quantum, decimals):
    sensor = dataclasses.replace(SCENE_SENSOR, quantum=quantum)
    tube = Tube.of(radius=20.0, theta=0.5, phi=0.3, centre=(0.0, -400.0))
    rng = np.random.default_rng(1)
    section = simulate_section(Scene((tube,)), sensor, SectionSettings(), rng=rng)
    lines = format_profile(section, "tube").splitlines()[4:]
    back = np.loadtxt(lines, delimiter=",")
    np.testing.assert_allclose(back, section.profile.points, rtol=0, atol=1e-9)
    texts = [line for line in lines if "nan" not in line]
    assert {len(text.split(",")[0].partition(".")[2]) for text in texts} == {decimals}
