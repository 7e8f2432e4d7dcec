"""JSON files of hand-eye calibrations."""

import json
import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from lsvision.calibration.covariance_check import check_covariance
from lsvision.calibration.observations import Mounting, RejectedPose, Sensor, Sphere
from lsvision.errors import UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_text
from lsvision.geometry import Plane, Pose
from lsvision.results.quantities import replace_nonfinite

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye

HandEyeClass = TypeVar("HandEyeClass", bound="HandEye")

SCHEMA = "lsvision/hand-eye/1"
"""Name and version of the file's format."""
MAX_VALUE = 1e9
"""Largest number of a hand-eye file: 1000 km, in mm; larger ones overflow later."""
MIN_DEGREES_OF_FREEDOM = 2.0
"""Degrees of freedom up to which Student's t has no variance."""
UNITS = {
    "length": "mm",
    "angle": "rad",
    "covariance": "translation mm, left perturbation rad",
}
"""Units of the file's numbers, written into it."""


def write_hand_eye(
    path: str | os.PathLike[str], hand_eye: "HandEye", provenance: Mapping[str, str] | None
) -> None:
    """Write a calibration as JSON, atomically; see `HandEye.save`."""
    document = {
        "schema": SCHEMA,
        "units": UNITS,
        "provenance": dict(provenance or {}),
        "mounting": hand_eye.mounting,
        "sensor": hand_eye.sensor,
        "mount_from_sensor": hand_eye.mount_from_sensor.matrix.tolist(),
        "covariance": hand_eye.covariance.tolist(),
        "working_point": hand_eye.working_point.tolist(),
        "working_std": hand_eye.working_point_std,
        "residuals": _replace_nan_by_null(hand_eye.residuals),
        "held_out": _replace_nan_by_null(hand_eye.leave_one_out_residuals),
        "rejected": [{"index": r.index, "reason": r.reason} for r in hand_eye.rejected],
        "target": _build_target_document(hand_eye.target),
        "robot_std": list(hand_eye.robot_std),
        "ambiguity": hand_eye.ambiguity_ratio if np.isfinite(hand_eye.ambiguity_ratio) else None,
        "weakness": hand_eye.least_determined_std,
        "weakest": hand_eye.least_determined_direction,
        "height_factor": hand_eye.height_scale,
        "target_factor": hand_eye.target_scale,
        "degrees_of_freedom": replace_nonfinite(hand_eye.degrees_of_freedom),
    }
    write_atomic(path, json.dumps(document, indent=2) + "\n")


def read_hand_eye(
    path: str | os.PathLike[str], hand_eye_class: "type[HandEyeClass]"
) -> "HandEyeClass":
    """Return a calibration that `write_hand_eye` wrote; see `HandEye.load`.

    The class is `HandEye`, which this module does not import.

    Raises
    ------
    UnreadableFile
        If the file is missing, is not JSON, is of another schema or lacks a field; if a pose is not
        a rigid motion, a covariance is invalid, or a number is not finite.
    """
    path = os.fspath(path)
    try:
        document = parse_json(read_text(path))
    except ValueError as error:
        raise UnreadableFile(f"{path}: expected a hand-eye file (JSON), got: {error}") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise UnreadableFile(
            f"{path}: expected schema {SCHEMA!r}, got {schema!r}: check that it is a hand-eye file"
        )
    if document.get("units", UNITS) != UNITS:
        raise UnreadableFile(
            f"{path}: expected units {UNITS}, got {document['units']}: convert its numbers"
        )
    try:
        hand_eye = hand_eye_class(**_arguments_from_document(document))
        _check_numbers(hand_eye)
    except KeyError as error:
        raise UnreadableFile(
            f"{path}: expected a complete hand-eye file, got one with a bad or missing {error}: "
            "calibrate again"
        ) from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UnreadableFile(
            f"{path}: expected a hand-eye file as lsvision writes it, got one that is damaged: "
            f"{error}: calibrate again"
        ) from error
    return hand_eye


def _arguments_from_document(document: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `HandEye` from the document of a file."""
    ambiguity = document["ambiguity"]
    position, rotation = document["robot_std"]
    return {
        "mount_from_sensor": Pose.from_matrix(document["mount_from_sensor"]),
        "covariance": document["covariance"],
        "residuals": np.array(document["residuals"], dtype=np.float64),
        "leave_one_out_residuals": np.array(document["held_out"], dtype=np.float64),
        "rejected": tuple(RejectedPose(r["index"], r["reason"]) for r in document["rejected"]),
        "target": _target_from_document(document["target"]),
        "working_point": document["working_point"],
        "robot_std": (float(position), float(rotation)),
        "ambiguity_ratio": float("inf") if ambiguity is None else float(ambiguity),
        "least_determined_std": float(document["weakness"]),
        "least_determined_direction": document["weakest"],
        "mounting": document["mounting"],
        "sensor": document["sensor"],
        "height_scale": _scale_from_document(document.get("height_factor")),
        "target_scale": _scale_from_document(document.get("target_factor")),
        "degrees_of_freedom": _dof_from_document(document.get("degrees_of_freedom")),
    }


def _check_numbers(hand_eye: "HandEye") -> None:
    """Raise an error for numbers that are not finite or out of range."""
    check_covariance(hand_eye.covariance)
    factor, factor_std = hand_eye.height_scale or (1.0, 0.0)
    size, size_std = hand_eye.target_scale or (1.0, 0.0)
    scales = [factor, factor_std, size, size_std]
    lengths = [*hand_eye.robot_std, hand_eye.least_determined_std, *scales]
    target = hand_eye.target
    if isinstance(target, Sphere):
        lengths += [target.radius, target.radius_std, *np.abs(target.centre).tolist()]
    numbers = [*hand_eye.working_point, *hand_eye.mount_from_sensor.translation, *lengths]
    if not (np.abs(numbers) <= MAX_VALUE).all() or min(lengths) < 0:
        raise ValueError(
            f"expected finite numbers below {MAX_VALUE:g} and no negative standard uncertainty, "
            f"got working point {hand_eye.working_point.tolist()}, standard uncertainties, scales "
            f"and sphere {lengths}"
        )
    if not hand_eye.ambiguity_ratio >= 0:
        raise ValueError(f"expected ambiguity >= 0, got {hand_eye.ambiguity_ratio}")
    count = len(hand_eye.residuals)
    if len(hand_eye.leave_one_out_residuals) != count:
        raise ValueError(
            f"expected as many held-out residuals as residuals, got "
            f"{len(hand_eye.leave_one_out_residuals)} and {count}"
        )
    residuals = np.concatenate([hand_eye.residuals, hand_eye.leave_one_out_residuals])
    if (np.abs(residuals) > MAX_VALUE).any():
        raise ValueError(f"expected residuals below {MAX_VALUE:g} mm, got {residuals.tolist()}")
    indices = [pose.index for pose in hand_eye.rejected]
    if not all(type(index) is int and 0 <= index < count for index in indices):
        raise ValueError(f"expected rejected poses from 0 to {count - 1}, got {indices}")
    if len(set(indices)) == count:
        raise ValueError(f"expected a pose that is not rejected, got {count} rejected poses")
    if hand_eye.mounting not in get_args(Mounting) or hand_eye.sensor not in get_args(Sensor):
        raise ValueError(
            f"expected mounting {' or '.join(get_args(Mounting))} and sensor "
            f"{' or '.join(get_args(Sensor))}, got {hand_eye.mounting!r} and {hand_eye.sensor!r}"
        )


def _scale_from_document(value: Any) -> tuple[float, float] | None:
    """Return a scale and its standard deviation; None where the file states none."""
    if value is None:
        return None
    factor, std = value
    return float(factor), float(std)


def _dof_from_document(value: Any) -> float:
    """Return the degrees of freedom; infinite where the file states none (older files)."""
    dof = math.inf if value is None else float(value)
    if not dof > MIN_DEGREES_OF_FREEDOM:
        raise ValueError(f"expected degrees_of_freedom above {MIN_DEGREES_OF_FREEDOM:g}, got {dof}")
    return dof


def _build_target_document(target: Sphere | Plane | Pose) -> dict[str, Any]:
    """Return a target as a JSON object with its kind. Units: mm."""
    if isinstance(target, Sphere):
        return {
            "kind": "sphere",
            "centre": target.centre.tolist(),
            "radius": target.radius,
            "radius_std": target.radius_std,
        }
    if isinstance(target, Plane):
        return {"kind": "plane", "normal": target.normal.tolist(), "distance": target.distance}
    return {"kind": "board", "pose": target.matrix.tolist()}


def _target_from_document(document: dict[str, Any]) -> Sphere | Plane | Pose:
    """Return the target of a JSON object from `_build_target_document`."""
    kind = document["kind"]
    if kind == "sphere":
        return Sphere(document["centre"], document["radius"], document["radius_std"])
    if kind == "plane":
        return Plane(document["normal"], document["distance"])
    if kind == "board":
        return Pose.from_matrix(document["pose"])
    raise ValueError(f"expected a target of kind sphere, plane or board, got {kind!r}")


def _replace_nan_by_null(lengths: npt.NDArray[np.float64]) -> list[float | None]:
    """Return the lengths with None, which JSON writes as null, for NaN."""
    return [float(value) if np.isfinite(value) else None for value in lengths]
