"""Poses as numbers in a robot maker's convention, with standard uncertainties."""

import math
import warnings

import numpy as np
import numpy.typing as npt

from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.result_tables import Row
from lsvision.geometry import FloatArray, Pose
from lsvision.io.robot_conventions import (
    MM_PER_UNIT,
    RAD_PER_UNIT,
    PoseConvention,
    find_convention,
)
from lsvision.results.number_format import format_std, format_value

DERIVATIVE_STEP = 1e-5
"""Step of the central difference; at positions of metres its relative error is below 1e-6, less
than the digits of a printed standard uncertainty. Units: mm, rad."""
MIN_COSINE_OF_MIDDLE = 1e-3
"""Smallest cosine (sine for proper Euler angles, whose first and last axes are the same) of the
middle angle at which the two other angles have a standard uncertainty; it is 0 in gimbal lock."""
DECIMALS = {"mm": 3, "m": 6, "deg": 4, "rad": 6, "": 8}
"""Decimals that are printed, by unit: 0.001 mm, 0.0001 deg; quaternions have no unit."""
# Text of a pose as it is typed in at a robot, by convention.
_ROBOT_FORMATS = {
    "kuka": "{{X {}, Y {}, Z {}, A {}, B {}, C {}}}",
    "fanuc": "X {} Y {} Z {} W {} P {} R {}",
    "staubli": "{{{}, {}, {}, {}, {}, {}}}",
    "ur": "p[{}, {}, {}, {}, {}, {}]",
    "abb": "[[{}, {}, {}], [{}, {}, {}, {}]]",
}


def numbers_from_pose(pose: Pose, convention: str) -> FloatArray:
    """Return the numbers of a pose as a robot shows them; the inverse of `pose_from_numbers`.

    They are in the order and the units of the convention, one of `CONVENTIONS`. In gimbal lock the
    last of three Euler angles is 0. A quaternion has w >= 0.

    Raises
    ------
    ValueError
        If the convention is unknown.

    Examples
    --------
    >>> pose = Pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], (100.0, 0.0, 500.0))
    >>> numbers_from_pose(pose, "kuka").round(6).tolist()
    [100.0, 0.0, 500.0, 90.0, 0.0, 0.0]
    >>> numbers_from_pose(pose, "ur").round(4).tolist()
    [0.1, 0.0, 0.5, 0.0, 0.0, 1.5708]
    """
    pose_convention = find_convention(convention)
    mm = MM_PER_UNIT[pose_convention.length_unit]
    if pose_convention.rotation == "matrix":
        matrix = pose.matrix.copy()
        matrix[:3, 3] /= mm
        return matrix.ravel()
    return np.concatenate([pose.translation / mm, _angles(pose.rotation, pose_convention)])


def propagate_to_numbers(pose: Pose, covariance: npt.ArrayLike, convention: str) -> FloatArray:
    """Return the standard uncertainty of each of the numbers of a pose, to first order.

    `covariance` is the (6, 6) one of translation (mm) and rotation (rad) along the axes of the
    frame in which the pose is given, R -> exp([w]x) R, as in `HandEye`. The result is in the order
    and the units of the convention; NaN for the first and the last Euler angle in gimbal lock,
    where the pose determines only their sum or difference.
    """
    from scipy.spatial.transform import Rotation

    pose_convention, reference = find_convention(convention), numbers_from_pose(pose, convention)
    columns = []
    for step in np.eye(6) * DERIVATIVE_STEP:
        perturbed_poses = [
            Pose(
                Rotation.from_rotvec(sign * step[3:]).as_matrix() @ pose.rotation,
                pose.translation + sign * step[:3],
            )
            for sign in (1.0, -1.0)
        ]
        after, before = (
            _unwrap(numbers_from_pose(perturbed_pose, convention), reference, pose_convention)
            for perturbed_pose in perturbed_poses
        )
        columns.append((after - before) / (2 * DERIVATIVE_STEP))
    jacobian = np.column_stack(columns)
    variances = np.einsum("ij,jk,ik->i", jacobian, np.asarray(covariance), jacobian)
    std: FloatArray = np.sqrt(np.maximum(variances, 0.0))
    if pose_convention.is_euler and _is_singular(pose, pose_convention):
        std[[3, 5]] = np.nan  # the first and the last angle
    return std


def format_frame_rows(hand_eye: HandEye, convention: str) -> list[Row]:
    """Return table rows of the sensor's frame: each number with one sigma, and all in one line."""
    pose_convention = find_convention(convention)
    mount = "flange" if hand_eye.mounting == "eye_in_hand" else "base"
    name = f"{mount}_from_{hand_eye.sensor}"
    pose = hand_eye.mount_from_sensor
    values = numbers_from_pose(pose, convention)
    if pose_convention.rotation == "matrix":
        return _format_matrix_rows(name, values.reshape(4, 4), hand_eye.covariance)
    std = propagate_to_numbers(pose, hand_eye.covariance, convention)
    units = [pose_convention.length_unit] * 3 + [_select_angle_unit(pose_convention)] * (
        len(values) - 3
    )
    fields = [  # X, Y, Z, A, B, C as robots show them, but q1, qx, rx
        field.upper() if pose_convention.is_euler else field for field in pose_convention.fields
    ]
    rows = [
        (f"{name} {field}", format_value(float(value), float(sigma)), unit)
        for field, value, sigma, unit in zip(fields, values, std, units, strict=True)
    ]
    cells = [
        _format_fixed(value, DECIMALS[unit])
        for value, unit in zip(values.tolist(), units, strict=True)
    ]
    text = _ROBOT_FORMATS.get(pose_convention.name, ", ".join(["{}"] * len(cells))).format(*cells)
    unit_text = ", ".join(dict.fromkeys(unit for unit in units if unit))
    return [*rows, (f"to type in, {pose_convention.name}", text, unit_text)]


def _format_fixed(value: float, decimals: int) -> str:
    """Return a number with some decimals, 0 without a sign."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _format_matrix_rows(name: str, matrix: FloatArray, covariance: FloatArray) -> list[Row]:
    """Return the table rows of a 4x4 matrix, and those of the stds of its position and rotation."""
    decimals = [DECIMALS[""]] * 3 + [DECIMALS["mm"]]
    rows: list[Row] = [
        (
            f"{name}, row {number}",
            ", ".join(map(_format_fixed, row, decimals)),
            "mm" if number < 4 else "",
        )
        for number, row in enumerate(matrix.tolist(), start=1)
    ]
    std = np.sqrt(np.diag(covariance))
    position = ", ".join(format_std(value) for value in std[:3].tolist())
    rotation = ", ".join(format_std(value) for value in np.degrees(std[3:]).tolist())
    return [
        *rows,
        ("its position x, y, z, one sigma", position, "mm"),
        ("its rotation about x, y, z, one sigma", rotation, "deg"),
    ]


def _select_angle_unit(pose_convention: PoseConvention) -> str:
    """Return the unit of the numbers of a rotation; empty for a quaternion."""
    return "" if pose_convention.is_quaternion else pose_convention.angle_unit


def _angles(matrix: FloatArray, pose_convention: PoseConvention) -> FloatArray:
    """Return Euler angles, rotation vector or quaternion of a rotation in the convention's unit."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_matrix(matrix)
    angles: FloatArray
    if pose_convention.is_quaternion:
        xyzw = rotation.as_quat(canonical=True)
        angles = np.roll(xyzw, 1) if pose_convention.rotation.endswith("wxyz") else xyzw
    elif pose_convention.rotation == "rotvec":
        angles = rotation.as_rotvec() / RAD_PER_UNIT[pose_convention.angle_unit]
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # gimbal lock: the other two angles then have no sigmas
            angles = (
                rotation.as_euler(pose_convention.rotation)
                / RAD_PER_UNIT[pose_convention.angle_unit]
            )
    return angles


def _unwrap(
    values: FloatArray, reference: FloatArray, pose_convention: PoseConvention
) -> FloatArray:
    """Return the numbers of a pose in the form that is nearest to the numbers of another pose.

    Angles and rotation vectors are changed by whole revolutions, quaternions by their sign.
    """
    nearest: FloatArray = values.copy()
    if pose_convention.rotation == "matrix":
        return nearest
    angles, reference_angles = nearest[3:], reference[3:]
    revolution = 2 * math.pi / RAD_PER_UNIT[pose_convention.angle_unit]
    if pose_convention.is_quaternion:
        nearest[3:] = angles * np.sign(angles @ reference_angles)
    elif pose_convention.rotation == "rotvec":
        # Beyond half a revolution the vector has the opposite direction; short ones only turn.
        if angles @ reference_angles < 0 and np.linalg.norm(reference_angles) > revolution / 4:
            nearest[3:] = angles - revolution * angles / np.linalg.norm(angles)
    else:
        nearest[3:] = angles - revolution * np.round((angles - reference_angles) / revolution)
    return nearest


def _is_singular(pose: Pose, pose_convention: PoseConvention) -> bool:
    """Return whether the angles of the convention are in gimbal lock."""
    middle = _angles(pose.rotation, pose_convention)[1] * RAD_PER_UNIT[pose_convention.angle_unit]
    is_proper_euler = pose_convention.rotation[0] == pose_convention.rotation[2]
    distance_from_lock = math.sin(middle) if is_proper_euler else math.cos(middle)
    return abs(distance_from_lock) < MIN_COSINE_OF_MIDDLE
