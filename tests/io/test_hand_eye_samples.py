"""Samples of ROS tools: what is not a pose is reported by the name of the file."""

import json

import pytest

from lsvision.errors import UnreadableFile
from lsvision.io.hand_eye_file import read_hand_eye_samples

POSE = {"translation": {"x": 1, "y": 0, "z": 0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_lengths_are_converted_to_mm(tmp_path, suffix):
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
def test_other_content_is_rejected_by_name(tmp_path, document, message):
    path = tmp_path / "samples.json"
    path.write_text(json.dumps(document))
    with pytest.raises(UnreadableFile, match=rf"samples\.json: .*{message}"):
        read_hand_eye_samples(path, "eye_in_hand")
