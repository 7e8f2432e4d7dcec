"""Save and load hand-eye calibrations, and export them to ROS easy_handeye."""

import json
from collections.abc import Mapping
from pathlib import Path

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.files.atomic_files import write_atomic


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

    Parameters
    ----------
    hand_eye : HandEye
        The calibration.
    path : path
        ``.yaml``.
    robot_frame : str
        Name in tf of the frame that carries the sensor: the effector (eye in hand) or the
        robot's base (eye to hand).
    sensor_frame : str
        Name of the sensor's frame.

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
