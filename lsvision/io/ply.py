"""PLY files of points and surfaces, for MeshLab, CloudCompare and Blender."""

import os

import numpy as np
import numpy.typing as npt

from lsvision.files.atomic_files import write_atomic
from lsvision.geometry import FloatArray, IntArray, Points

_VERTEX = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
)
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])


def write_ply(
    path: str | os.PathLike[str],
    points: Points,
    colours: npt.ArrayLike,
    triangles: IntArray | None = None,
) -> None:
    """Write coloured points, or the triangles between them, as binary PLY, atomically.

    Parameters
    ----------
    path : path
        ``.ply``.
    points : (n, 3) ndarray
        Points, written in single precision: rounded to 0.1 um at 1 m. Units: mm.
    colours : (n, 3) array_like
        Red, green, blue of each point, 0 to 1.
    triangles : (m, 3) int ndarray, optional
        Rows of `points`, counter-clockwise seen from outside.

    Raises
    ------
    ValueError
        If the shapes do not match, a number is not finite in single precision, a colour is not
        from 0 to 1, or a corner of a triangle is no row of `points`.
    UnwritableFile
        If the file cannot be written.
    """
    points, colours = np.asarray(points, dtype=np.float64), np.asarray(colours, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or colours.shape != points.shape:
        raise ValueError(f"expected (n, 3) points and colours, got {points.shape}, {colours.shape}")
    is_finite = bool((np.abs(points) <= np.finfo(np.float32).max).all())
    in_range = colours.min(initial=0.0) >= 0 and colours.max(initial=1.0) <= 1
    if not (is_finite and in_range):
        raise ValueError("expected finite points and colours from 0 to 1")
    faces = np.zeros((0, 3), dtype=np.int64) if triangles is None else np.asarray(triangles)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise ValueError(f"expected (m, 3) whole numbers as triangles, got {faces.shape}")
    if faces.size and not (faces.min() >= 0 and faces.max() < len(points)):
        raise ValueError(
            f"expected triangles of rows from 0 to below {len(points)}, got {faces.min()} to "
            f"{faces.max()}"
        )
    header = _encode_header(len(points), None if triangles is None else len(faces))
    write_atomic(path, header + _encode_vertices(points, colours) + _encode_faces(faces))


def _encode_header(point_count: int, triangle_count: int | None) -> bytes:
    """Return the header of a binary PLY file; of points only if `triangle_count` is None."""
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment lsvision, base frame, mm",
        f"element vertex {point_count}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
    ]
    if triangle_count is not None:
        lines += [f"element face {triangle_count}", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _encode_vertices(points: Points, colours: FloatArray) -> bytes:
    rows = np.empty(len(points), dtype=_VERTEX)
    for column, (axis, colour) in enumerate(zip("xyz", ("red", "green", "blue"), strict=True)):
        rows[axis] = points[:, column]
        rows[colour] = np.round(255 * colours[:, column])
    return rows.tobytes()


def _encode_faces(triangles: IntArray) -> bytes:
    rows = np.empty(len(triangles), dtype=_FACE)
    rows["count"], rows["corners"] = 3, triangles
    return rows.tobytes()
