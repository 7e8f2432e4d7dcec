"""Hand-eye calibrations and their samples in files; those of ROS tools have lengths in metres.

MoveIt stores a list of mappings with ``effector_wrt_world`` and ``object_wrt_sensor``, 4x4
matrices row by row. easy_handeye2: ``samples``, a list of mappings with ``robot`` and ``tracking``
(or ``optical``). easy_handeye: ``hand_world_samples`` and ``camera_marker_samples``, each with a
list of ``transforms``. In the latter two a pose is a ``translation`` and a ``rotation``, quaternion
x y z w.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.errors import UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.geometry import Pose
from lsvision.io.robot_conventions import pose_from_numbers
from lsvision.io.yaml_text import parse_yaml


def save_hand_eye(
    hand_eye: HandEye, path: str | Path, provenance: Mapping[str, str] | None = None
) -> None:
    """Write a calibration as JSON, atomically: `HandEye.save`.

    Parameters
    ----------
    hand_eye : HandEye
        The calibration.
    path : path
        ``.json``.
    provenance : mapping of str to str, optional
        Method, date, version and inputs' hash, from `lsvision.io.calibration.build_provenance`.

    Raises
    ------
    UnwritableFile
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import lsvision as lsv
    >>> folder = "calibration/example"
    >>> poses = lsv.read_robot_poses(f"{folder}/sphere_poses.csv", "kuka")
    >>> profiles = lsv.read_profiles(f"{folder}/sphere")
    >>> hand_eye = lsv.calibrate_hand_eye_sphere(profiles, poses, 20.0)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "hand_eye.json"
    >>> lsv.save_hand_eye(hand_eye, path)
    >>> lsv.load_hand_eye(path) == hand_eye
    True
    """
    hand_eye.save(path, provenance)


def load_hand_eye(path: str | Path) -> HandEye:
    """Read a calibration that `save_hand_eye` wrote: `HandEye.load`.

    Parameters
    ----------
    path : path
        ``.json``.

    Returns
    -------
    HandEye
        The calibration.

    Raises
    ------
    UnreadableFile
        If the file is missing, is not JSON, is of another schema or lacks a field; if a pose is not
        a rigid motion, a covariance is invalid, or a number is not finite.

    Examples
    --------
    >>> load_hand_eye("nowhere.json")
    Traceback (most recent call last):
    ...
    lsvision.errors.UnreadableFile: nowhere.json: no such file: check the name
    """
    return HandEye.load(path)


def export_easy_handeye(
    hand_eye: HandEye, path: str | Path, *, robot_frame: str, sensor_frame: str
) -> None:
    """Write the pose of the sensor as ROS easy_handeye's YAML: metres, quaternion x y z w.

    `robot_frame` and `sensor_frame` are names of frames in tf. The first carries the sensor: it is
    that of the effector (eye in hand) or of the robot's base (eye to hand).

    Raises
    ------
    UnwritableFile
        If the file cannot be written.
    """
    from scipy.spatial.transform import Rotation

    in_hand = hand_eye.mounting == "eye_in_hand"
    pose = hand_eye.mount_from_sensor
    x, y, z = pose.translation / 1000
    quaternion = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)
    qx, qy, qz, qw = (float(value) for value in quaternion)
    carrier = "robot_effector_frame" if in_hand else "robot_base_frame"
    text = (
        "parameters:\n"
        f"  eye_on_hand: {str(in_hand).lower()}\n"
        f"  {carrier}: {json.dumps(robot_frame)}\n"
        f"  tracking_base_frame: {json.dumps(sensor_frame)}\n"
        "transformation:\n"
        f"  x: {x:.9f}\n  y: {y:.9f}\n  z: {z:.9f}\n"
        f"  qx: {qx:.12f}\n  qy: {qy:.12f}\n  qz: {qz:.12f}\n  qw: {qw:.12f}\n"
    )
    write_atomic(path, text)


def read_hand_eye_samples(
    path: str | Path, mounting: Literal["eye_in_hand", "eye_to_hand"]
) -> tuple[list[Pose], list[Pose]]:
    """Read the pairs of a file of MoveIt's hand-eye calibration, of easy_handeye or easy_handeye2.

    ``.json`` is JSON, anything else YAML. Returns ``base_from_flange`` and ``camera_from_target``
    of each sample, in mm. For a fixed camera (``"eye_to_hand"``) easy_handeye and easy_handeye2
    store the inverse of ``base_from_flange``.

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
