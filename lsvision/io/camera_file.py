"""Cameras from files: lsvision's own JSON, OpenCV's YAML, ROS camera_info (file or message)."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.atomic_files import write_atomic
from lsvision.files.limited_reading import get_size_limit, limit_file_size, read_bytes
from lsvision.geometry import FloatArray, as_readonly_array
from lsvision.io.calibration import CAMERA_SCHEMA, LASER_PLANE_SCHEMA
from lsvision.sensors.camera import Camera
from lsvision.sensors.rig_file import SCHEMA as RIG_SCHEMA
from lsvision.sensors.rig_file import camera_from_json, parse_document

MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "K", "k", "M1", "mtx")
"""Keys of the camera matrix in the files of different tools."""
DISTORTION_KEYS = (
    *("distortion_coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "distortion_coeffs"),
    *("D", "d", "D1", "dist"),
)
"""Keys of the distortion coefficients in the files of different tools."""
WIDTH_KEYS, HEIGHT_KEYS = ("image_width", "width"), ("image_height", "height")
"""Keys of the size of the images."""

MAX_CAMERA_FILE_BYTES = 64 * 10**6
"""Largest camera file; residuals of 100 views take 2 MB. Units: bytes."""

_SCHEMAS = (CAMERA_SCHEMA, LASER_PLANE_SCHEMA, RIG_SCHEMA)
"""Formats of lsvision that hold a camera."""

LENS_MODELS = ("plumb_bob", "rational_polynomial", "")
"""ROS's names of the lens models whose coefficients are those of OpenCV; empty if not stated."""

_FISHEYE = re.compile(r"^[ \t]*fisheye_model:[ \t]*[1-9]", re.MULTILINE)
"""Mark of a file of OpenCV's calibration program with the coefficients of ``cv2.fisheye``."""


def read_camera(path: str | os.PathLike[str], *, size: tuple[int, int] | None = None) -> Camera:
    """Read a camera from lsvision's JSON, OpenCV's YAML or ROS camera_info.

    The file is a camera or laser-plane calibration or a rig file of lsvision, a YAML file of
    OpenCV's FileStorage, a camera_info file, or the printout of such a message of ROS 1 or 2.
    `size`, (width, height) in px, is for YAML files that do not state it.

    Raises
    ------
    UnreadableFile
        If the file is missing, holds no camera, one of a lens model that is not OpenCV's (fisheye),
        or one for images of another size than `size`; names the file and the remedy.
    """
    source = Path(path)
    return _parse_camera(_read_text(source), source, size)


def _read_text(source: Path) -> str:
    with limit_file_size(min(get_size_limit(), MAX_CAMERA_FILE_BYTES)):
        # An image is not UTF-8; it is then reported as a file without a camera.
        return read_bytes(source).decode("utf-8-sig", "replace")


def _parse_camera(text: str, source: Path, size: tuple[int, int] | None = None) -> Camera:
    """Return the camera of a file's text; see `read_camera`."""
    try:
        if text.lstrip().startswith("{"):
            camera = camera_from_json(parse_document(text, source, _SCHEMAS)["camera"])
            _check_size(camera.size, size)
            return camera
        return _camera_from_yaml(text, size)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UnreadableFile(f"{source} holds no camera as expected: {error}") from error


def read_camera_covariance(path: str | os.PathLike[str]) -> FloatArray | None:
    """Return the covariance of the intrinsics that a camera calibration of lsvision holds.

    Returns
    -------
    (4 + k, 4 + k) ndarray
        Covariance of fx, fy, cx, cy (px) and the k coefficients of distortion; None for other
        files.

    Raises
    ------
    UnreadableFile
        If the file is missing or holds no camera, or the covariance is not a symmetric matrix of
        that size.
    """
    source = Path(path)
    text = _read_text(source)
    camera = _parse_camera(text, source)
    document = parse_document(text, source, _SCHEMAS) if text.lstrip().startswith("{") else {}
    if document.get("camera_covariance") is None:
        return None
    count = 4 + len(camera.distortion)
    try:
        covariance = as_readonly_array(document["camera_covariance"], (count, count), "covariance")
        if not (np.isfinite(covariance).all() and np.allclose(covariance, covariance.T)):
            raise ValueError("expected a finite symmetric matrix, got another")
    except (TypeError, ValueError) as error:
        raise UnreadableFile(f"{source}: camera_covariance: {error}: calibrate again") from error
    return covariance


def write_camera_yaml(path: str | os.PathLike[str], camera: Camera) -> None:
    """Write a camera as YAML that `cv2.FileStorage` of OpenCV 4 and 5 reads.

    Raises
    ------
    UnwritableFile
        If the folder is missing or not writable.
    """
    width, height = camera.size
    lines = ["%YAML:1.0", "---", f"image_width: {width}", f"image_height: {height}"]
    for key, values in (
        ("camera_matrix", camera.matrix),
        ("distortion_coefficients", camera.distortion.reshape(1, -1)),
    ):
        numbers = ", ".join(  # 1.0 rather than 1, which YAML takes for an integer
            f"{value:.17g}" if value % 1 else f"{value:.1f}" for value in values.flat
        )
        rows, columns = values.shape
        lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}"]
        lines += ["   dt: d", f"   data: [ {numbers} ]"]
    write_atomic(path, "\n".join(lines) + "\n")


def _camera_from_yaml(text: str, size: tuple[int, int] | None) -> Camera:
    """Return the camera of a ROS or OpenCV YAML file."""
    model = re.search(r"^[ \t]*distortion_model:[ \t]*[\"']?([^\"'\s]*)", text, re.MULTILINE)
    name = "fisheye" if _FISHEYE.search(text) else model and model.group(1)
    if name and name not in LENS_MODELS:
        raise ValueError(
            f"its lens model is {name!r}; expected {LENS_MODELS[0]} or {LENS_MODELS[1]}: "
            "calibrate again with that model"
        )
    matrix = _find_numbers(text, MATRIX_KEYS, "camera matrix")
    if len(matrix) != 9:
        raise ValueError(
            f"expected a camera matrix of 9 numbers, got {len(matrix)}: write the file again"
        )
    distortion = _find_numbers(text, DISTORTION_KEYS, "distortion coefficients")
    stated_size = _find_size(text)
    if stated_size is not None:
        _check_size(stated_size, size)
    size = size or stated_size
    if size is None:
        raise ValueError("it does not state the size of the images: give size=(width, height)")
    return camera_from_json(
        {"matrix": np.reshape(matrix, (3, 3)), "distortion": distortion, "size": size}
    )


def _check_size(stated: tuple[int, int], expected: tuple[int, int] | None) -> None:
    """Raise ValueError if a file is for images of another size than the caller expects, if any."""
    if expected not in (None, stated):
        raise ValueError(
            f"expected images of {expected[0]} x {expected[1]} px, got the camera of images of "
            f"{stated[0]} x {stated[1]} px: give the file of the camera that took the images"
        )


def _find_numbers(text: str, keys: Iterable[str], quantity: str) -> list[float]:
    """Return the numbers under the first of some keys: a YAML list, or the ``data`` of a matrix."""
    number_pattern, row_pattern = r"[-+.\deE]+", r"\[[^\[\]]*\]"
    for key in keys:
        match = re.search(
            rf"^[ \t]*{key}:[^\[\n]*"  # the key, and a tag such as !!opencv-matrix
            r"(?:\n[ \t]+(?!data)\w+:.*)*"  # rows, cols and dt of a matrix
            r"(?:\n[ \t]*data:)?\s*"
            # [1, 2], [[1, 2], [3, 4]], or lines of "- 1", "- - 1" or "- [1, 2]".
            rf"(\[(?:[^\[\]]|{row_pattern})*\]"
            rf"|(?:(?:-[ \t]+)+(?:{number_pattern}|{row_pattern})\s+)+)",
            text,
            re.MULTILINE,
        )
        if match:
            return [
                float(number_text)
                for number_text in re.findall(rf"(?:^|(?<=[\[,\s])){number_pattern}", match[1])
                if number_text != "-"  # mark of a YAML list item
            ]
    raise ValueError(f"expected {quantity} under one of {', '.join(keys)}; got none")


def _find_size(text: str) -> tuple[int, int] | None:
    """Return width and height of the images; None if the file does not state both. Units: px."""
    width, height = _find_length(text, WIDTH_KEYS), _find_length(text, HEIGHT_KEYS)
    return None if width is None or height is None else (width, height)


def _find_length(text: str, keys: Iterable[str]) -> int | None:
    """Return the whole number under the first of some keys; None if there is none.

    A key that is not indented has priority: camera_info also has the size of a region (roi).
    """
    for indent in ("", "[ \t]+"):
        for key in keys:
            match = re.search(rf"^{indent}{key}:[ \t]*(\d{{1,9}})\b", text, re.MULTILINE)
            if match:
                return int(match.group(1))
    return None
