"""The rig file: a light section as JSON with schema, units and provenance.

It stands here and not in ``io`` because `LightSection` saves and loads itself.
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
    """A camera as plain numbers; see `camera_from_json`."""
    return {
        "matrix": camera.matrix.tolist(),
        "distortion": camera.distortion.tolist(),
        "size": list(camera.size),
    }


def camera_from_json(values: Mapping[str, Any]) -> Camera:
    """The camera that `camera_as_json` wrote.

    Raises
    ------
    KeyError, TypeError, ValueError
        If `values` is something else.
    """
    width, height = values["size"]
    return Camera(values["matrix"], values["distortion"], (width, height))


def plane_as_json(plane: Plane) -> dict[str, Any]:
    """A plane as plain numbers; see `plane_from_json`."""
    return {"normal": plane.normal.tolist(), "distance": plane.distance}


def plane_from_json(values: Mapping[str, Any]) -> Plane:
    """The plane that `plane_as_json` wrote.

    Raises
    ------
    KeyError, TypeError, ValueError
        If `values` is something else.
    """
    return Plane(values["normal"], values["distance"])


def json_text(schema: str, values: Mapping[str, Any]) -> str:
    """Text of a JSON file of a schema, in the package's units.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, which JSON does not know.
    """
    content = {"schema": schema, "units": UNITS, **values}
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_json(path: str | os.PathLike[str], schema: str) -> dict[str, Any]:
    """Read a JSON file of one schema in the package's units.

    Raises
    ------
    UnreadableFile
        If there is no such file, it is no JSON, or it has another schema or other units.
    """
    source = Path(path)
    try:
        values = json.loads(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise UnreadableFile(f"{source} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UnreadableFile(f"{source} is no JSON ({error}): want a {schema} file") from error
    got = values.get("schema") if isinstance(values, dict) else None
    if got != schema:
        raise UnreadableFile(f"{source} has schema {got!r} and needs {schema!r}: calibrate anew")
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
    """Write a light section's values, whole or not at all; see `read_rig`.

    Raises
    ------
    UnwritableFile
        If the folder is missing or refuses.
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
    part = target.with_name(f".{target.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(target)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise UnwritableFile(
            f"{target} cannot be written ({error.strerror}): name an existing folder that "
            "you may write to"
        ) from error


def read_rig(path: str | os.PathLike[str]) -> tuple[Camera, Plane, dict[str, str], float]:
    """Camera, laser plane (camera frame), provenance and line blur (px) of a rig file.

    Raises
    ------
    UnreadableFile
        If the file is missing, damaged, or of another schema; names the file and the mend.
    """
    values = read_json(path, SCHEMA)
    try:
        camera = camera_from_json(values["camera"])
        plane = plane_from_json(values["laser_plane"])
        provenance = {str(key): str(text) for key, text in values["provenance"].items()}
        blur = float(values.get("line_blur_px", 0.0))
        if not (math.isfinite(blur) and blur >= 0):
            raise ValueError(f"want line_blur_px >= 0, got {blur}")
    except (KeyError, TypeError, ValueError, AttributeError, LsvisionError) as error:
        what = f"lacks {error}" if isinstance(error, KeyError) else f"is damaged: {error}"
        raise UnreadableFile(f"{path} {what}; save the light section anew") from error
    return camera, plane, provenance, blur
