"""Samples of a hand-eye calibration as ROS tools store them: pairs of flange and target poses.

Lengths are in metres. MoveIt: a list of mappings with ``effector_wrt_world`` and
``object_wrt_sensor``, 4x4 matrices row by row. easy_handeye2: ``samples``, a list of mappings with
``robot`` and ``tracking`` (or ``optical``). easy_handeye: ``hand_world_samples`` and
``camera_marker_samples``, each with a list of ``transforms``. In the latter two a pose is a
``translation`` and a ``rotation``, quaternion x y z w.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.geometry import Pose
from lsvision.io.robot_conventions import pose_from_numbers
from lsvision.io.yaml_text import parse_yaml


def read_hand_eye_samples(
    path: str | Path, mounting: Literal["eye_in_hand", "eye_to_hand"]
) -> tuple[list[Pose], list[Pose]]:
    """Read the pairs of a file of MoveIt's hand-eye calibration, of easy_handeye or easy_handeye2.

    Parameters
    ----------
    path : path
        ``.json`` is JSON, anything else YAML.
    mounting : {"eye_in_hand", "eye_to_hand"}
        easy_handeye and easy_handeye2 store the inverse pose of the flange for a fixed camera.

    Returns
    -------
    base_from_flanges, camera_from_targets : list of Pose
        Poses of each sample. Units: mm.

    Raises
    ------
    UnreadableFile
        If the file is missing, cannot be parsed, is of another kind, or contains an invalid pose.
    """
    file = Path(path)
    parse = parse_json if file.suffix.lower() == ".json" else parse_yaml
    try:
        pairs, by_easy_handeye = _find_pairs(parse(read_text(file)))
        flanges = [_parse_pose(flange) for flange, _ in pairs]
        targets = [_parse_pose(target) for _, target in pairs]
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        problem = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise UnreadableFile(
            f"{path}: expected samples of MoveIt, easy_handeye or easy_handeye2, got: {problem}; "
            "poses of the target alone are read with --poses and --target-convention"
        ) from error
    if by_easy_handeye and mounting == "eye_to_hand":
        flanges = [pose.inverse() for pose in flanges]
    return flanges, targets


def _find_pairs(document: Any) -> tuple[list[tuple[Any, Any]], bool]:
    """Return the pairs of flange and target, and whether easy_handeye (or 2) wrote them."""
    if isinstance(document, list):
        return [(row["effector_wrt_world"], row["object_wrt_sensor"]) for row in document], False
    if not isinstance(document, Mapping):
        raise TypeError(f"a {type(document).__name__}")
    if "hand_world_samples" in document:
        flanges = document["hand_world_samples"]["transforms"]
        targets = document["camera_marker_samples"]["transforms"]
        if len(flanges) != len(targets):
            raise ValueError(f"{len(flanges)} poses of the hand and {len(targets)} of the marker")
        return list(zip(flanges, targets, strict=True)), True
    rows = document["samples"]
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise TypeError("samples that are no list of mappings")
    target_key = "optical" if rows and "optical" in rows[0] else "tracking"
    return [(row["robot"], row[target_key]) for row in rows], True


def _parse_pose(value: Any) -> Pose:
    """Return a pose (mm) from a 4x4 matrix (m), or from a translation (m) and a quaternion."""
    if isinstance(value, list):
        rows = [row if isinstance(row, list) else [row] for row in value]
        numbers = [float(number) for row in rows for number in row]
        return pose_from_numbers(numbers, "matrix", length_unit="m")
    if not isinstance(value, Mapping):
        raise TypeError(f"a {type(value).__name__} instead of a pose")
    value = value.get("transform", value)
    numbers = [float(value["translation"][axis]) for axis in "xyz"]
    numbers += [float(value["rotation"][axis]) for axis in "xyzw"]
    return pose_from_numbers(numbers, "ros")
