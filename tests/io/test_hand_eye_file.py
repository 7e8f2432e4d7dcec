"""Calibration files, and samples of ROS tools: what is written is read again, nothing else is."""

import json
import math
import re

import numpy as np
import pytest
import yaml

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.observations import RejectedPose, Sphere
from lsvision.errors import UnreadableFile, UnwritableFile
from lsvision.geometry import Plane, Pose
from lsvision.io.hand_eye_file import (
    export_easy_handeye,
    load_hand_eye,
    read_hand_eye_samples,
    save_hand_eye,
)

QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
POSE = {"translation": {"x": 1, "y": 0, "z": 0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}
"""Pose of a sample: lengths in m."""
TARGETS = {
    "sphere": Sphere((1, 2, 3), 20.0, 0.01),
    "plane": Plane((0, 0, 1), 5.0),
    "board": Pose(QUARTER, (7, 8, 9)),
}


def hand_eye(target=TARGETS["sphere"], mounting="eye_in_hand"):
    return HandEye(
        mount_from_sensor=Pose(QUARTER, (10, 20, 30)),
        covariance=np.diag([1, 2, 3, 4, 5, 6]) * 1e-4,
        residuals=np.array([0.1, np.nan, 0.2]),
        leave_one_out_residuals=np.array([0.2, np.nan, 0.3]),
        rejected=(RejectedPose(1, "no sphere found"),),
        target=target,
        working_point=(0, -150, 0),
        robot_std=(0.05, 1e-4),
        ambiguity_ratio=float("inf"),
        least_determined_std=0.2,
        least_determined_direction="turning about the sensor's own Y",
        mounting=mounting,
        sensor="section",
        height_scale=(0.993, 0.001) if isinstance(target, Sphere) else None,
        target_scale=(0.99, 0.0004) if isinstance(target, Pose) else None,
        degrees_of_freedom=math.inf if isinstance(target, Plane) else 12.5,
    )


@pytest.mark.parametrize("kind", TARGETS)
def test_a_calibration_survives_its_file(tmp_path, kind):
    path = tmp_path / "hand_eye.json"
    before = hand_eye(TARGETS[kind])
    save_hand_eye(before, path)
    after = load_hand_eye(path)
    np.testing.assert_array_equal(after.mount_from_sensor.matrix, before.mount_from_sensor.matrix)
    np.testing.assert_array_equal(after.covariance, before.covariance)
    np.testing.assert_array_equal(after.residuals, before.residuals)
    assert (after.rejected, after.robot_std, after.ambiguity_ratio) == (
        before.rejected,
        before.robot_std,
        before.ambiguity_ratio,
    )
    assert type(after.target) is type(before.target)
    assert after.height_scale == before.height_scale
    assert after.target_scale == before.target_scale
    assert after.degrees_of_freedom == before.degrees_of_freedom


def test_degrees_of_freedom_may_be_absent_but_not_below_those_of_a_variance(tmp_path):
    path = tmp_path / "hand_eye.json"
    save_hand_eye(hand_eye(), path)
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"degrees_of_freedom": 2.0}))
    with pytest.raises(UnreadableFile, match="degrees_of_freedom above 2, got 2"):
        load_hand_eye(path)
    del document["degrees_of_freedom"]
    path.write_text(json.dumps(document))
    assert load_hand_eye(path).degrees_of_freedom == math.inf


def test_the_class_saves_and_loads_its_files(tmp_path):
    before, path = hand_eye(), tmp_path / "hand_eye.json"
    before.save(path, {"method": "sphere"})
    assert HandEye.load(path) == HandEye.load(str(path)) == before
    assert json.loads(path.read_text())["provenance"] == {"method": "sphere"}


@pytest.mark.parametrize(
    ("text", "message"),
    [("{}", "expected schema 'lsvision/hand-eye/1', got None"), ("[", "hand-eye file (JSON)")],
)
def test_the_class_loads_no_other_file(tmp_path, text, message):
    path = tmp_path / "rig.json"
    path.write_text(text)
    with pytest.raises(UnreadableFile, match=re.escape(message)):
        HandEye.load(path)


def test_the_file_says_units_and_where_it_comes_from(tmp_path):
    save_hand_eye(hand_eye(), tmp_path / "h.json", {"inputs_sha256": "abc"})
    document = json.loads((tmp_path / "h.json").read_text())
    assert document["units"]["length"] == "mm"
    assert document["provenance"] == {"inputs_sha256": "abc"}


def test_ros_gets_metres_and_w_last(tmp_path):
    path = tmp_path / "easy.yaml"
    export_easy_handeye(hand_eye(), path, robot_frame="tool0", sensor_frame="profiler")
    document = yaml.safe_load(path.read_text())
    assert document["transformation"]["x"] == pytest.approx(0.01)
    half = np.sqrt(0.5)  # a quarter turn about z
    quaternion = [document["transformation"][key] for key in ("qx", "qy", "qz", "qw")]
    np.testing.assert_allclose(quaternion, [0, 0, half, half], atol=1e-9)
    assert document["parameters"] == {
        "eye_on_hand": True,
        "robot_effector_frame": "tool0",
        "tracking_base_frame": "profiler",
    }


def test_a_standing_sensor_names_the_base_frame(tmp_path):
    path = tmp_path / "easy.yaml"
    standing = hand_eye(mounting="eye_to_hand")
    export_easy_handeye(standing, path, robot_frame="base", sensor_frame="profiler")
    assert yaml.safe_load(path.read_text())["parameters"]["robot_base_frame"] == "base"


UNREADABLE = {
    "words": ("not json", "expected a hand-eye file"),
    "schema": ('{"schema": "other/1"}', "expected schema 'lsvision/hand-eye/1', got 'other/1'"),
    "list": ("[]", "got None"),
    "field": ('{"schema": "lsvision/hand-eye/1"}', "bad or missing 'ambiguity'"),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_other_files_are_rejected_by_name(tmp_path, case):
    text, message = UNREADABLE[case]
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(UnreadableFile, match=message):
        load_hand_eye(path)


def test_an_unknown_target_is_rejected(tmp_path):
    save_hand_eye(hand_eye(), tmp_path / "h.json")
    text = (tmp_path / "h.json").read_text().replace('"sphere"', '"cone"')
    (tmp_path / "h.json").write_text(text)
    with pytest.raises(UnreadableFile, match="cone"):
        load_hand_eye(tmp_path / "h.json")


def test_nothing_is_left_behind_where_nothing_can_be_written(tmp_path):
    with pytest.raises(UnwritableFile, match="nowhere"):
        save_hand_eye(hand_eye(), tmp_path / "nowhere" / "h.json")
    assert list(tmp_path.iterdir()) == []


def changed(document, path, value):
    *parents, last = path
    for key in parents:
        document = document[key]
    document[last] = value


DAMAGED = {
    "nan": (["covariance", 0, 0], float("nan"), "expected finite numbers, got NaN"),
    "negative": (["covariance", 0, 0], -1.0, "expected a positive semi-definite covariance"),
    "asymmetric": (["covariance", 0, 1], 1e-4, "expected a symmetric covariance"),
    "shape": (["covariance"], [[1.0]], "expected covariance of shape"),
    "null": (["covariance", 0, 0], None, "expected covariances below"),
    "scaled": (["mount_from_sensor", 0, 1], -1.1, "expected an orthonormal rotation"),
    "mirrored": (["mount_from_sensor", 2, 2], -1.0, "a reflection"),
    "huge": (["mount_from_sensor", 0, 3], 1e200, "expected finite numbers below"),
    "text": (["mount_from_sensor"], "here", "damaged"),
    "point": (["working_point", 1], None, "expected finite numbers below"),
    "robot": (["robot_std", 0], -0.1, "no negative standard uncertainty"),
    "ragged": (["held_out"], [0.1], "as many held-out residuals as residuals"),
    "index": (["rejected", 0, "index"], 3, "expected rejected poses from 0 to 2"),
    "bool": (["rejected", 0, "index"], True, "expected rejected poses from 0 to 2"),
    "all": (["rejected"], [{"index": k, "reason": ""} for k in range(3)], "got 3 rejected poses"),
    "mounting": (["mounting"], "eye", "expected mounting eye_in_hand or eye_to_hand"),
    "sensor": (["sensor"], ["section"], "and sensor section or camera"),
    "radius": (["target", "radius"], None, "damaged"),
    "factor": (["height_factor"], [1.0], "damaged"),
    "units": (["units", "length"], "m", "expected units"),
    "list": (["target"], [], "damaged"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_numbers_that_are_none_are_rejected(tmp_path, case):
    path, value, message = DAMAGED[case]
    save_hand_eye(hand_eye(), tmp_path / "h.json")
    document = json.loads((tmp_path / "h.json").read_text())
    changed(document, path, value)
    (tmp_path / "h.json").write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=message) as reason:
        load_hand_eye(tmp_path / "h.json")
    assert "h.json" in str(reason.value)


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_lengths_of_samples_are_converted_to_mm(tmp_path, suffix):
    path = tmp_path / f"samples{suffix}"
    path.write_text(json.dumps({"samples": [{"robot": POSE, "tracking": POSE}]}))
    flanges, targets = read_hand_eye_samples(path, "eye_in_hand")
    assert flanges[0].translation.tolist() == targets[0].translation.tolist() == [1000.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"samples": [{"robot": "abc", "tracking": POSE}]}, "a str instead of a pose"),
        ({"samples": [{"robot": None, "tracking": POSE}]}, "a NoneType instead of a pose"),
        ({"samples": [{"robot": POSE}]}, "no 'tracking'"),
        ({"samples": "abc"}, "samples that are no list of mappings"),
        ({"samples": {"a": 1}}, "samples that are no list of mappings"),
        ({"samples": [1]}, "samples that are no list of mappings"),
        ("abc", "got: a str"),
    ],
)
def test_samples_with_other_content_are_rejected_by_name(tmp_path, document, message):
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=rf"samples\.json: .*{message}"):
        read_hand_eye_samples(path, "eye_in_hand")
