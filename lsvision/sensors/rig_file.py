"""The rig file: a light section as JSON with schema, units and provenance.

Part of this package and not of ``io`` because `LightSection` has methods to save and load it.
"""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lsvision.errors import LsvisionError, UnreadableFile, UnwritableFile
from lsvision.geometry import Plane
from lsvision.sensors.camera import Camera

SCHEMA = "lsvision/light-section/1"
UNITS = {"length": "mm", "pixel": "px", "angle": "rad"}


def camera_as_json(camera: Camera) -> dict[str, Any]:
    """Return a camera as JSON values; inverse of `camera_from_json`."""
    return {
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "size": list(camera.size),
    }


def camera_from_json(values: Mapping[str, Any]) -> Camera:
    """Return the camera of JSON values; inverse of `camera_as_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If a key is missing or a value has another type or shape.
    """
    width, height = values["size"]
    return Camera(values["matrix"], values["distortion"], (width, height))


def plane_as_json(plane: Plane) -> dict[str, Any]:
    """Return a plane as JSON values; inverse of `plane_from_json`."""
    return {"normal": plane.normal.tolist(), "distance": plane.distance}


def plane_from_json(values: Mapping[str, Any]) -> Plane:
    """Return the plane of JSON values; inverse of `plane_as_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If a key is missing or a value has another type or shape.
    """
    return Plane(values["normal"], values["distance"])


def json_text(schema: str, values: Mapping[str, Any]) -> str:
    """Format values as the text of a JSON file with schema and units.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, which JSON cannot represent.
    """
    content = {"schema": schema, "units": UNITS, **values}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_json(path: str | os.PathLike[str], schema: str) -> dict[str, Any]:
    """Read a JSON file and check its schema and units.

    Raises
    ------
    UnreadableFile
        If the file is missing, is no JSON, or has another schema or other units.
    """
    source = Path(path)
    try:
        values = json.loads(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise UnreadableFile(f"{source} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UnreadableFile(f"{source} is no JSON ({error}): expected a {schema} file") from error
    got = values.get("schema") if isinstance(values, dict) else None
    if got != schema:
        raise UnreadableFile(f"{source} has schema {got!r} and needs {schema!r}: calibrate again")
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
    line_blur_px: float = 0.0,
) -> None:
    """Write a rig file; an existing file is replaced only when all is written. See `read_rig`.

    Raises
    ------
    UnwritableFile
        If the folder is missing or not writable.
    """
    text = json_text(
        SCHEMA,
        {
            "camera": camera_as_json(camera),
            "laser_plane": plane_as_json(plane),
            "line_blur_px": line_blur_px,
            "provenance": dict(provenance),
        },
    )
    target = Path(path)
    temporary = target.with_name(f".{target.name}.part")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise UnwritableFile(
            f"{target} cannot be written ({error.strerror}): name an existing folder that "
            "you may write to"
        ) from error


def read_rig(path: str | os.PathLike[str]) -> tuple[Camera, Plane, dict[str, str], float]:
    """Read camera, laser plane (camera frame), provenance and line blur (px) of a rig file.

    Raises
    ------
    UnreadableFile
        If the file is missing, damaged, or of another schema.
    """
    values = read_json(path, SCHEMA)
    try:
        camera = camera_from_json(values["camera"])
        plane = plane_from_json(values["laser_plane"])
        provenance = {str(key): str(text) for key, text in values["provenance"].items()}
        blur = float(values.get("line_blur_px", 0.0))
        if not (math.isfinite(blur) and blur >= 0):
            raise ValueError(f"expected line_blur_px >= 0, got {blur}")
    except (KeyError, TypeError, ValueError, AttributeError, LsvisionError) as error:
        problem = f"lacks {error}" if isinstance(error, KeyError) else f"is damaged: {error}"
        raise UnreadableFile(f"{path} {problem}; save the light section again") from error
    return camera, plane, provenance, blur
