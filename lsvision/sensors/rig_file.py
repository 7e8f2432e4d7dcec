"""The rig file: a light section as JSON with schema, units and provenance.

The module is in this package and not in ``io``, because `LightSection` has methods to save and load
it.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.json_text import parse_json
from lsvision.files.limited_reading import read_bytes
from lsvision.geometry import Plane
from lsvision.sensors.camera import MAX_VALUE, Camera

SCHEMA = "lsvision/light-section/1"
"""Name and version of the format of a rig file."""
UNITS = {"length": "mm", "pixel": "px", "angle": "rad"}
"""Units of the numbers in a rig or camera file, which every such file states."""
MAX_LINE_BLUR_PX = 1e3
"""Largest blur of a laser line. Units: px."""

# Exceptions that wrong or missing values of a parsed file raise.
_DAMAGE_ERRORS = (
    KeyError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
    LsvisionError,
)


def convert_camera_to_json(camera: Camera) -> dict[str, Any]:
    """Return a camera as JSON values; inverse of `camera_from_json`."""
    return {
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "size": list(camera.size),
    }


def camera_from_json(values: Mapping[str, Any]) -> Camera:
    """Return the camera of JSON values; inverse of `convert_camera_to_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If a key is missing, or a value has another type or shape or is beyond the limits of this
        module.
    """
    return Camera(values["matrix"], values["distortion"], tuple(values["size"]))


def convert_plane_to_json(plane: Plane) -> dict[str, Any]:
    """Return a plane as JSON values; inverse of `plane_from_json`."""
    return {"normal": plane.normal.tolist(), "distance": plane.distance}


def plane_from_json(values: Mapping[str, Any]) -> Plane:
    """Return the plane of JSON values; inverse of `convert_plane_to_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If a key is missing, or a value has another type or shape or is beyond `MAX_VALUE`.
    """
    plane = Plane(values["normal"], values["distance"])
    if not abs(plane.distance) <= MAX_VALUE:
        raise ValueError(f"expected a plane within {MAX_VALUE:g} mm, got {plane.distance:g} mm")
    return plane


def format_json(schema: str, values: Mapping[str, Any]) -> str:
    """Return values as the text of a JSON file with schema and units.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, which JSON cannot represent.
    """
    content = {"schema": schema, "units": UNITS, **values}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_json(path: str | os.PathLike[str], schema: str) -> dict[str, Any]:
    """Return the values of a JSON file, with checked schema and units.

    Raises
    ------
    UnreadableFile
        If the file is missing, is not JSON, or has another schema or other units.
    """
    text = read_bytes(path).decode("utf-8-sig", "replace")  # an image is reported as not JSON
    return parse_document(text, Path(path), (schema,))


def parse_document(text: str, source: Path, schemas: Sequence[str]) -> dict[str, Any]:
    """Return the values of a JSON text of one of several schemas; see `read_json`.

    Messages name the file `source` and the last one of the `schemas`.
    """
    try:
        values = parse_json(text)
    except ValueError as error:
        raise UnreadableFile(
            f"{source} is not JSON ({error}): expected a {schemas[-1]} file"
        ) from error
    schema = values.get("schema") if isinstance(values, dict) else None
    if schema not in schemas:
        raise UnreadableFile(
            f"{source} has schema {schema!r} and needs {schemas[-1]!r}: name a file of that "
            "schema, or calibrate again"
        )
    if values.get("units") != UNITS:
        raise UnreadableFile(
            f"{source} has units {values.get('units')} and needs {UNITS}: convert its numbers"
        )
    return dict(values)


def write_rig(
    path: str | os.PathLike[str],
    camera: Camera,
    plane: Plane,
    provenance: Mapping[str, str],
    line_blur_px: float,
) -> None:
    """Write a rig file; an existing file is replaced only after everything is written.

    Raises
    ------
    UnwritableFile
        If the folder is missing or not writable.
    ValueError
        If a number is beyond the limits of this module.
    """
    values = {
        "camera": convert_camera_to_json(camera),
        "laser_plane": convert_plane_to_json(plane),
        "line_blur_px": line_blur_px,
        "provenance": dict(provenance),
    }
    _rig_from_json(values)  # what `read_rig` would reject is not written
    write_atomic(path, format_json(SCHEMA, values))


def check_line_blur(blur: float) -> float:
    """Return a line blur (px) as a float; ValueError unless it is from 0 to `MAX_LINE_BLUR_PX`."""
    if not (math.isfinite(blur) and 0 <= blur <= MAX_LINE_BLUR_PX):
        raise ValueError(f"expected line_blur_px from 0 to {MAX_LINE_BLUR_PX:g}, got {blur}")
    return float(blur)


def _rig_from_json(values: Mapping[str, Any]) -> tuple[Camera, Plane, dict[str, str], float]:
    """Return camera, laser plane, provenance and line blur (px) of JSON values."""
    return (
        camera_from_json(values["camera"]),
        plane_from_json(values["laser_plane"]),
        {str(key): str(text) for key, text in values["provenance"].items()},
        check_line_blur(float(values.get("line_blur_px", 0.0))),
    )


def read_rig(path: str | os.PathLike[str]) -> tuple[Camera, Plane, dict[str, str], float]:
    """Return camera, laser plane (camera frame), provenance and line blur (px) of a rig file.

    Raises
    ------
    UnreadableFile
        If the file is missing, damaged, or of another schema.
    """
    values = read_json(path, SCHEMA)
    try:
        return _rig_from_json(values)
    except _DAMAGE_ERRORS as error:
        problem = f"lacks {error}" if isinstance(error, KeyError) else f"is damaged: {error}"
        raise UnreadableFile(f"{path} {problem}; save the light section again") from error
