"""Verdicts by truth: missing, additional, exchanged, rejected; extra uncertainty; half turns."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lsvision as lsv
from lsvision.detection.arcs import Rejection
from lsvision.inspection.decision import judge_quantity
from lsvision.inspection.judge import _judge_periodic_angle
from lsvision.inspection.limits import quantity_from_key
from lsvision.measure import Measurement, measure_cylinders
from lsvision.profile import Arc
from lsvision.results.quantities import Estimate
from lsvision.scan.joint_fit import JointFitSettings
from lsvision.simulate import SCENE_SENSOR, Scene, SectionSettings, Tube, simulate_section

SETTINGS = SectionSettings(jump_fraction=0.0, lost_fraction=0.0)
LEFT, RIGHT = 20.0, 14.0
FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture(scope="module")
def pair():
    """Pipes of 20 and 14 mm, tilted by 25 deg, at x = -40 and 40 mm."""
    tubes = (
        Tube.of(LEFT, 0.4, math.radians(25), (-40.0, -400.0)),
        Tube.of(RIGHT, 0.4, math.radians(25), (40.0, -400.0)),
    )
    sensor = replace(SCENE_SENSOR, range_std=0.02)
    section = simulate_section(Scene(tubes), sensor, SETTINGS, rng=np.random.default_rng(2))
    return measure_cylinders(section.profile)


def job(*parts, more=""):
    tables = "\n".join(f'[[part]]\nname = "{name}"\n{lines}' for name, lines in parts)
    return lsv.Job.from_text(f'name = "test"\n{tables}\n{more}')


def limits(nominal, tolerance=0.5):
    return f"radius_mm = {{ nominal = {nominal}, upper = {tolerance}, lower = -{tolerance} }}"


def test_parts_within_and_beyond_their_limits(pair):
    verdict = lsv.judge(
        pair,
        job(("left", f"x_mm = [-80, 0]\n{limits(20)}"), ("right", f"x_mm = [0, 80]\n{limits(18)}")),
    )
    assert [item.decision for item in verdict.parts] == ["OK", "NG"]
    assert verdict.decision == "NG"
    assert not verdict.passed
    (radius,) = verdict.part("right").quantities
    assert radius.margin < -5
    assert "lies wholly below 17.5" in radius.reason


def test_a_limit_at_the_value_is_undecided_and_says_which(pair):
    value = pair.cylinders[0].radius
    verdict = lsv.judge(pair, job(("left", f"order = 1\nradius_mm = {{ max = {value} }}")))
    assert verdict.decision == "undecided"
    assert f"contains the limit {value:.9g}" in verdict.parts[0].quantities[0].reason
    assert not verdict.passed
    passing = job(
        ("left", f"order = 1\nradius_mm = {{ max = {value} }}"), more='[decision]\nundecided = "ok"'
    )
    assert lsv.judge(pair, passing).passed


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((18.0, 18.9), "contains the limit 18.9"),
        ((19.1, 20.0), "contains the limit 19.1"),
        ((18.9, 19.2), "contains the limit 19.1"),
        ((18.0, 20.0), "contains the limits 18.9 and 19.1"),
    ],
)
def test_an_undecided_quantity_names_the_limits_that_its_interval_crosses(interval, words):
    radius = Estimate(quantity_from_key("radius_mm"), 19.0, 0.1, interval)
    verdict = judge_quantity(radius, (18.9, 19.1), 0.95)
    assert verdict.decision == "undecided"
    assert verdict.reason.endswith(words)


def test_a_part_that_the_job_does_not_have_is_rejected(pair):
    tube = job(("left", f"order = 1\n{limits(20)}"))
    for parts in (tube, lsv.judge(pair, tube)):
        with pytest.raises(ValueError, match="expected a part among 'left', got 'right'"):
            parts.part("right")


def test_an_extra_uncertainty_can_open_a_verdict(pair):
    parts = ("left", f"order = 1\n{limits(LEFT)}\ndiameter_mm = {{ min = 39, max = 41 }}")
    assert lsv.judge(pair, job(parts)).decision == "OK"
    opened = lsv.judge(pair, job(parts, more="[decision]\nextra_std = { radius_mm = 0.4 }"))
    radius, diameter = opened.parts[0].quantities
    assert (radius.decision, diameter.decision) == ("undecided", "undecided")
    assert radius.estimate.std == pytest.approx(math.hypot(pair.cylinders[0].radius_std, 0.4))
    assert diameter.estimate.std == pytest.approx(2 * radius.estimate.std)


def test_an_extra_uncertainty_leaves_an_interval_within_the_possible_values():
    tube = Tube.of(LEFT, 0.4, 0.0, (0.0, -400.0))
    section = simulate_section(Scene((tube,)), SCENE_SENSOR, SETTINGS, rng=np.random.default_rng(2))
    upright = job(
        ("left", "order = 1\nphi_deg = { min = 0, max = 30 }"),
        more="[decision]\nextra_std = { phi_deg = 0.2 }",
    )
    verdict = lsv.judge(measure_cylinders(section.profile), upright)
    (phi,) = verdict.parts[0].quantities
    assert phi.estimate.interval[0] == 0
    assert verdict.decision == "OK"


def test_parts_are_distinguished_by_radius(pair):
    verdict = lsv.judge(pair, job(("thin", limits(14)), ("thick", limits(20))))
    assert [item.cylinder for item in verdict.parts] == [1, 0]
    assert verdict.decision == "OK"


def test_a_part_of_another_radius_is_missing_and_what_is_there_is_additional(pair):
    verdict = lsv.judge(pair, job(("thin", limits(14)), ("thicker", limits(30))))
    assert verdict.part("thicker").decision == "NG"
    assert "missing" in verdict.part("thicker").reason
    assert verdict.additional == (0,)
    assert "additional: cylinder 1, radius 20" in verdict.notes[0]


def test_additional_cylinders_are_ng_where_the_job_says_so(pair):
    only = ("left", f"x_mm = [-80, 0]\n{limits(20)}")
    assert lsv.judge(pair, job(only)).decision == "OK"
    assert lsv.judge(pair, job(only, more='[decision]\nadditional = "ng"')).decision == "NG"


def test_exchanged_parts_are_reported(pair):
    verdict = lsv.judge(
        pair,
        job(("left", f"x_mm = [-80, 0]\n{limits(14)}"), ("right", f"x_mm = [0, 80]\n{limits(20)}")),
    )
    assert verdict.decision == "NG"
    assert verdict.notes == ("exchanged: 'left' and 'right' have each other's size",)


def test_a_missing_part_carries_the_reason_of_what_was_rejected_there(pair):
    failure = Rejection(Arc(3, 9), "residual rms 4.1 times the noise, limit 2.0")
    profile = lsv.Profile(np.column_stack([np.linspace(100, 120, 12), np.full(12, -400.0)]))
    measurement = replace(pair, rejections=(failure,), profile=profile)
    there = lsv.judge(measurement, job(("third", f"x_mm = [90, 130]\n{limits(20)}")))
    assert there.decision == "NG"
    assert there.parts[0].reason == f"missing; rejected there: {failure.reason}"
    elsewhere = lsv.judge(measurement, job(("third", f"x_mm = [200, 230]\n{limits(20)}")))
    assert elsewhere.parts[0].reason == "missing: no arc was found there"


def test_a_cylinder_whose_radius_is_not_determinable_is_undecided_not_missing():
    failure = Rejection(Arc(3, 9), "radius not determinable: 12 to 698 mm (95 %); longer arc")
    verdict = lsv.judge(Measurement((), (failure,)), job(("tube", f"order = 1\n{limits(20)}")))
    assert verdict.decision == "undecided"
    assert verdict.parts[0].reason.startswith("rejected: radius not determinable: 12 to 698 mm")


def test_a_relation_without_one_of_its_parts_is_undecided_beside_the_missing_part(pair):
    relation = '[[relation]]\nbetween = ["left", "third"]\ngap_mm = { max = 1 }'
    parts = (("left", f"order = 1\n{limits(20)}"), ("third", f"order = 3\n{limits(20)}"))
    verdict = lsv.judge(pair, job(*parts, more=relation))
    assert verdict.relations[0].reason == "without third there is nothing to compare"
    assert (verdict.relations[0].decision, verdict.decision) == ("undecided", "NG")


def test_a_relation_is_judged(pair):
    relation = (
        '[[relation]]\nbetween = ["left", "right"]\n'
        "distance_mm = { nominal = 80, upper = 1, lower = -1 }\ngap_mm = { max = 10 }"
    )
    parts = (("left", f"order = 1\n{limits(20)}"), ("right", f"order = 2\n{limits(14)}"))
    (item,) = lsv.judge(pair, job(*parts, more=relation)).relations
    assert [each.decision for each in item.quantities] == ["OK", "NG"]


def test_a_known_radius_sharpens_the_part_that_has_it(pair):
    plain = ("left", "order = 1\nphi_deg = { min = 24.5, max = 25.5 }")
    known = (
        "left",
        f"order = 1\nknown_radius_mm = [{LEFT}, 0.01]\nphi_deg = {{ min = 20, max = 30 }}",
    )
    before, after = (lsv.judge(pair, job(part)).parts[0].quantities[0] for part in (plain, known))
    assert after.estimate.std < 0.7 * before.estimate.std
    low, high = after.estimate.interval
    assert low < 25 < high


@pytest.mark.parametrize("key", ["radius_mm", "diameter_mm"])
def test_a_known_radius_decides_nothing_on_the_radius(pair, key):
    """A pipe of 20 mm is not OK as one of 20.35 mm, because the job says that it is."""
    nominal = 20.35 * (2 if key == "diameter_mm" else 1)
    ends = f"{key} = {{ nominal = {nominal}, upper = 0.2, lower = -0.2 }}"
    part = ("left", f"order = 1\nknown_radius_mm = [20.35, 0.02]\n{ends}")
    (judged,) = lsv.judge(pair, job(part)).parts[0].quantities
    (plain,) = lsv.judge(pair, job(("left", f"order = 1\n{ends}"))).parts[0].quantities
    assert judged.estimate == plain.estimate
    assert judged.decision == "NG"


def test_a_radius_or_tilt_measured_with_a_known_one_is_undecided(pair):
    known = measure_cylinders(pair.profile, known_radius=(LEFT, 0.05), radius=(18, 22))
    part = ("left", f"x_mm = [-80, 0]\n{limits(LEFT)}\nphi_deg = {{ max = 40 }}")
    radius, phi = lsv.judge(known, job(part)).parts[0].quantities
    assert (radius.decision, phi.decision) == ("undecided", "OK")
    assert "not determinable" in radius.reason
    tilt = math.radians(25), math.radians(0.1)
    known = measure_cylinders(pair.profile, known_phi=tilt, radius=(18, 22))
    radius, phi = lsv.judge(known, job(part)).parts[0].quantities
    assert (radius.decision, phi.decision) == ("OK", "undecided")


def test_a_known_radius_that_the_points_contradict_is_not_used_and_reported(pair):
    part = ("left", f"order = 1\nknown_radius_mm = 18\n{limits(18)}")
    verdict = lsv.judge(pair, job(part))
    assert verdict.decision == "NG"
    assert verdict.parts[0].quantities[0].estimate.value == pair.cylinders[0].radius
    assert "left: known_radius_mm is not used: the points contradict it" in verdict.notes
    near = ("left", f"order = 1\nknown_radius_mm = 19.9\n{limits(20)}")
    assert not any("known_radius_mm" in note for note in lsv.judge(pair, job(near)).notes)


def direction(value, low, high, ends):
    estimate = Estimate(quantity_from_key("theta_deg"), value, 1.0, (low, high))
    return _judge_periodic_angle(estimate, ends, 0.95)


@pytest.mark.parametrize(
    ("value", "low", "high", "ends", "decision"),
    [
        (178.0, 176.0, 180.0, (-5.0, 5.0), "OK"),
        (178.0, 176.0, 180.0, (175.0, 185.0), "OK"),
        (178.0, 170.0, 186.0, (-5.0, 5.0), "undecided"),
        (90.0, 88.0, 92.0, (-5.0, 5.0), "NG"),
        (90.0, 0.0, 180.0, (-5.0, 5.0), "undecided"),
        (60.0, 10.0, 176.0, (-5.0, 5.0), "undecided"),
        (95.0, 4.0, 186.0, (20.0, 30.0), "undecided"),
    ],
)
def test_theta_is_the_same_after_half_a_turn(value, low, high, ends, decision):
    assert direction(value, low, high, ends).decision == decision


@pytest.mark.parametrize(("phi_deg", "tail_level"), [(6, 0.975), (40, 0.95)])
def test_the_lower_end_of_a_small_phi_has_all_of_the_error(phi_deg, tail_level):
    scene = Scene((Tube.of(19.0, 0.4, math.radians(phi_deg), (0.0, -400.0)),))
    section = simulate_section(scene, SCENE_SENSOR, SETTINGS, rng=np.random.default_rng(5))
    measurement = measure_cylinders(section.profile)
    verdict = lsv.judge(measurement, job(("tube", "order = 1\nphi_deg = { max = 60 }")))
    (phi,) = verdict.part("tube").quantities
    (cylinder,) = measurement.cylinders
    low, high = phi.estimate.interval
    assert low == pytest.approx(math.degrees(cylinder.interval("phi", tail_level)[0]))
    assert high == pytest.approx(math.degrees(cylinder.interval("phi", 0.95)[1]))
    assert (low < 0.75 * high) == (tail_level > 0.95)


def test_theta_that_is_not_determined_is_undecided():
    section = lsv.simulate.random_section(
        "single", 4, noise_mm=0.05, tubes=lsv.simulate.TubeRanges(phi_deg=(0.0, 0.1))
    )
    found = measure_cylinders(section.profile)
    verdict = lsv.judge(found, job(("tube", "order = 1\ntheta_deg = { min = 0, max = 100 }")))
    assert verdict.decision == "undecided"
    assert verdict.parts[0].quantities[0].reason == "not determinable from this measurement"


def test_what_a_profile_does_not_have_is_rejected(pair):
    with pytest.raises(ValueError, match="for a profile, got bow_mm of part 'left': a scan has it"):
        lsv.judge(pair, job(("left", "order = 1\nbow_mm = { max = 1 }")))


def test_a_window_may_be_as_wide_as_numbers_go(pair):
    verdict = lsv.judge(pair, job(("right", f"x_mm = [0, 1.7e308]\n{limits(14)}")))
    assert verdict.decision == "OK"


def test_a_window_in_z_is_rejected_for_a_profile(pair):
    with pytest.raises(ValueError, match="z_mm of part 'left' is for scans: leave it out"):
        lsv.judge(pair, job(("left", f"z_mm = [0, 9]\n{limits(20)}")))


def test_a_blocked_job_decides_nothing_and_says_why(pair):
    verdict = lsv.judge(
        pair, job(("left", f"order = 1\n{limits(20)}")), blocked="golden part failed"
    )
    assert (verdict.decision, verdict.parts[0].decision) == ("undecided", "undecided")
    assert verdict.to_dict()["reason"] == "golden part failed"
    assert verdict.parts[0].quantities[0].decision == "OK"


def test_a_verdict_is_json_a_table_and_rows(pair):
    verdict = lsv.judge(
        pair, job(("left", f"order = 1\n{limits(20)}"), ("third", f"order = 3\n{limits(20)}"))
    )
    record = json.loads(verdict.to_json())
    assert (record["decision"], record["job"], record["revision"]) == ("NG", "test", 1)
    assert len(record["job_hash"]) == 64
    quantity = record["parts"][0]["quantities"][0]
    assert (
        quantity["min"] < quantity["low"] < quantity["value"] < quantity["high"] < quantity["max"]
    )
    frame = verdict.to_dataframe()
    assert list(frame["item_decision"]) == ["OK", "NG"]
    assert "radius mm" in str(verdict)
    assert "third: missing" in str(verdict)
    assert repr(verdict) == "<Verdict: NG (left OK, third NG)>"


SCAN_LIMITS = """
radius_mm = { nominal = 19, upper = 0.05, lower = -0.05 }
nominal_direction = [0.321394, 0.116978, 0.939693]
nominal_point_mm = [-28.0, -420.0, 0.0]
direction_deg = { max = 0.2 }
position_mm = { max = 0.1 }
point_x_mm = { min = -28.1, max = -27.9 }
bow_mm = { max = 0.1 }
taper_mm_per_m = { min = -10, max = 10 }
ovality_percent = { max = 1 }
length_seen_mm = { min = 30 }
"""


@pytest.fixture(scope="module")
def scan():
    profiles = lsv.read_profiles(FIXTURES / "scan_welded_pair")
    return lsv.measure_scan(profiles, [lsv.Pose.along((0, 0, 1), 1.0 * k) for k in range(20)])


def test_a_scan_is_judged_with_form_and_place(scan):
    relation = '[[relation]]\nbetween = ["thick", "thin"]\ngap_mm = { max = 0.1 }'
    verdict = lsv.judge(scan, job(("thick", SCAN_LIMITS), ("thin", limits(15)), more=relation))
    assert len(verdict.part("thick").quantities) == 8
    assert verdict.decision == "OK", str(verdict)


def test_the_form_of_a_tube_in_two_sections_is_undecided():
    profiles = lsv.read_profiles(FIXTURES / "scan_welded_pair")[::19]
    scan = lsv.measure_scan(profiles, [lsv.Pose.along((0, 0, 1), 19.0 * k) for k in range(2)])
    verdict = lsv.judge(scan, job(("thick", f"bow_mm = {{ max = 1 }}\n{limits(19)}")))
    assert verdict.decision == "undecided"
    radius, bow = verdict.part("thick").quantities
    assert (radius.decision, bow.reason) == ("OK", "not determinable from this measurement")
    assert verdict.to_dict()["parts"][0]["quantities"][1]["value"] is None
    assert "not determinable" in str(verdict)


def test_the_direction_of_a_tube_in_one_section_is_undecided():
    tubes = [Tube.of(19.0, 0.5, 0.35, (x, -400.0)) for x in (-40.0, 40.0)]
    section = simulate_section(
        Scene(tuple(tubes)), SCENE_SENSOR, SETTINGS, rng=np.random.default_rng(3)
    )
    measured = lsv.measure_scan([section.profile], [lsv.Pose()])
    direction = [float(value) for value in tubes[0].cylinder.direction]
    lines = f"nominal_direction = {direction}\ndirection_deg = {{ max = 5 }}\n{limits(19)}"
    more = '[[relation]]\nbetween = ["a", "b"]\nangle_deg = { max = 60 }\n'
    verdict = lsv.judge(
        measured, job(("a", f"order = 1\n{lines}"), ("b", f"order = 2\n{lines}"), more=more)
    )
    for item in verdict.parts:
        assert {q.key: str(q.decision) for q in item.quantities} == {
            "radius_mm": "OK", "direction_deg": "undecided",
        }  # fmt: skip
    assert verdict.relations[0].decision == "undecided"


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_a_nominal_direction_has_any_length(scan, scale):
    verdicts = [
        lsv.judge(scan, job(("a", f"order = 1\nnominal_direction = [0, 0, {length!r}]\n"
                                  "direction_deg = { max = 5 }")))
        for length in (1.0, scale)
    ]  # fmt: skip
    assert verdicts[0].parts == verdicts[1].parts


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("phi_deg = { max = 30 }", "for a scan, got phi_deg of part 'thick'"),
        ("known_radius_mm = 19", "known_radius_mm of part 'thick' is for profiles"),
    ],
)
def test_what_a_scan_does_not_have_is_rejected(scan, lines, message):
    with pytest.raises(ValueError, match=message):
        lsv.judge(scan, job(("thick", f"order = 1\n{lines}")))


def scan_of_short_arcs(undeterminable: int, others: int) -> lsv.ScanMeasurement:
    """Scan of a tube of 19 mm: short arcs in the first profiles, straight lines in the others."""
    angles = np.pi / 2 + np.linspace(0.6, -0.6, 60)
    arc = np.column_stack([19 * np.cos(angles), 19 * np.sin(angles) - 400])
    line = np.column_stack([arc[:, 0], np.full(60, -381.0)])
    rng = np.random.default_rng(1)
    noise = 0.1 * rng.standard_normal((undeterminable + others, 60))
    profiles = [arc] * undeterminable + [line] * others
    profiles = [
        points + np.outer(errors, [0, 1]) for points, errors in zip(profiles, noise, strict=False)
    ]
    poses = [lsv.Pose.along((0, 0, 1), 5.0 * k) for k in range(len(profiles))]
    return lsv.measure_scan(profiles, poses)


@pytest.mark.parametrize(("others", "decision"), [(0, "undecided"), (4, "NG")])
def test_a_tube_of_a_scan_whose_radius_is_not_determinable_is_undecided(others, decision):
    measured = scan_of_short_arcs(3, others)
    assert not measured.cylinders
    (part,) = lsv.judge(measured, job(("tube", f"order = 1\n{limits(19)}"))).parts
    assert part.decision == decision
    assert ("radius not determinable" in part.reason) == (decision == "undecided")


def test_a_joint_radius_that_is_too_uncertain_is_undecided():
    profiles = lsv.read_profiles(FIXTURES / "scan_welded_pair")[::10]
    strict = lsv.ScanSettings(joint_fit=JointFitSettings(max_relative_radius_std=1e-6))
    poses = [lsv.Pose.along((0, 0, 1), 10.0 * k) for k in range(2)]
    measured = lsv.measure_scan(profiles, poses, settings=strict)
    (part,) = lsv.judge(measured, job(("thick", limits(19)))).parts
    assert part.decision == "undecided"
    assert "with a standard uncertainty of" in part.reason


def test_flush_of_a_scan_needs_a_direction(scan):
    relation = '[[relation]]\nbetween = ["thick", "thin"]\nflush_mm = { max = 1 }'
    parts = (("thick", limits(19)), ("thin", limits(15)))
    with pytest.raises(ValueError, match="flush_mm of 'thick - thin' needs a direction"):
        lsv.judge(scan, job(*parts, more=relation))
