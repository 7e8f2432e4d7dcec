"""PLY files of the points and surfaces of a scan, for MeshLab, CloudCompare and Blender."""

import os

import numpy as np
import numpy.typing as npt

from lsvision.files.atomic_files import write_atomic
from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.results.palette import choose_cylinder_colour
from lsvision.scan import ScanMeasurement
from lsvision.scan.shape import triangulate_cylinder

_VERTEX = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
)
"""A point in binary PLY."""
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])
"""A triangle in binary PLY."""
UNASSIGNED_RGB = (0.6, 0.6, 0.6)
"""Colour of points on no cylinder, grey: red, green, blue from 0 to 1."""


def write_ply(
    path: str | os.PathLike[str],
    points: Points,
    colours: npt.ArrayLike,
    triangles: IntArray | None = None,
) -> None:
    """Write coloured points, or the triangles between them, as binary PLY, atomically.

    `points` are (n, 3) in mm, rounded to single precision (0.1 um at 1 m), `colours` (n, 3), red,
    green, blue from 0 to 1, `triangles` (m, 3), rows of `points` counter-clockwise seen from
    outside.

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
    if not (np.abs(points) <= np.finfo(np.float32).max).all():
        raise ValueError("expected finite points, got NaN, infinity or more than single precision")
    if not (colours.min(initial=0.0) >= 0 and colours.max(initial=1.0) <= 1):
        raise ValueError(
            f"expected colours from 0 to 1, got {colours.min():g} to {colours.max():g}"
        )
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


def colour_points(scan: ScanMeasurement, points: Points) -> tuple[Points, FloatArray]:
    """Return the points of a scan, each once, and their colours, both (n, 3).

    Points on no cylinder (grey) come first, then those of each cylinder. `points` are all measured
    ones, base frame, in mm; a colour is red, green, blue from 0 to 1.
    """
    cylinder_points = [cylinder.points for cylinder in scan.cylinders]
    # The cylinders hold copies of the points, which are found again by their equal coordinates.
    assigned = {tuple(point) for array in cylinder_points for point in array.tolist()}
    unassigned = points[[tuple(point) not in assigned for point in points.tolist()]]
    colours = [np.tile(UNASSIGNED_RGB, (len(unassigned), 1))]
    colours += [
        np.tile(convert_cylinder_colour(number), (len(array), 1))
        for number, array in enumerate(cylinder_points, 1)
    ]
    return np.concatenate([unassigned, *cylinder_points]), np.concatenate(colours)


def colour_surfaces(scan: ScanMeasurement) -> tuple[Points, FloatArray, IntArray]:
    """Return the surfaces of all cylinders as one triangle mesh, each in its cylinder's colour.

    Vertices (n, 3), base frame, in mm; the colour of each, red, green, blue from 0 to 1; and the
    indices of the three vertices of each triangle, (m, 3).
    """
    # Empty arrays first, so that a scan without cylinders gives an empty mesh.
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3))]
    triangles, vertex_count = [np.zeros((0, 3), dtype=np.int64)], 0
    for number, cylinder in enumerate(scan.cylinders, 1):
        vertices, cylinder_triangles = triangulate_cylinder(cylinder)
        points.append(vertices)
        colours.append(np.tile(convert_cylinder_colour(number), (len(vertices), 1)))
        triangles.append(cylinder_triangles + vertex_count)
        vertex_count += len(vertices)
    return np.concatenate(points), np.concatenate(colours), np.concatenate(triangles)


def convert_cylinder_colour(number: int) -> tuple[float, float, float]:
    """Return the colour of a cylinder, numbered from 1, as red, green, blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    red, green, blue = to_rgb(choose_cylinder_colour(number))
    return red, green, blue
