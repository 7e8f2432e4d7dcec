"""Points and surfaces of a scan for PLY files, the cylinders in the colours of the figure."""

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.results.palette import cylinder_colour
from lsvision.scan import ScanMeasurement
from lsvision.scan.shape import triangulate_tube

UNASSIGNED_RGB = (0.6, 0.6, 0.6)
"""Colour of points on no cylinder, grey: red, green, blue from 0 to 1."""


def colour_points(scan: ScanMeasurement, points: Points) -> tuple[Points, FloatArray]:
    """Return the points of a scan, sorted by cylinder, and their colours.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.
    points : (n, 3) ndarray
        All measured points, base frame. Units: mm.

    Returns
    -------
    points : (n, 3) ndarray
        Points on no cylinder, then those of each cylinder; each point once. Base frame. Units: mm.
    colours : (n, 3) ndarray
        Colour of each point, grey or that of its cylinder: red, green, blue from 0 to 1.
    """
    cylinder_points = [tube.points for tube in scan.cylinders]
    # The cylinders hold copies of the points, which are found again by their equal coordinates.
    assigned = {tuple(point) for array in cylinder_points for point in array.tolist()}
    unassigned = points[[tuple(point) not in assigned for point in points.tolist()]]
    colours = [np.tile(UNASSIGNED_RGB, (len(unassigned), 1))]
    colours += [
        np.tile(cylinder_rgb(number), (len(array), 1))
        for number, array in enumerate(cylinder_points, 1)
    ]
    return np.concatenate([unassigned, *cylinder_points]), np.concatenate(colours)


def colour_surfaces(scan: ScanMeasurement) -> tuple[Points, FloatArray, IntArray]:
    """Return the surfaces of all cylinders as one triangle mesh, each in its cylinder's colour.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.

    Returns
    -------
    points : (n, 3) ndarray
        Vertices of the triangles, base frame. Units: mm.
    colours : (n, 3) ndarray
        Colour of each vertex: red, green, blue from 0 to 1.
    triangles : (m, 3) ndarray of int
        Indices of the three vertices of each triangle in `points`.
    """
    # Empty arrays first, so that a scan without cylinders gives an empty mesh.
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3))]
    triangles, vertex_count = [np.zeros((0, 3), dtype=np.int64)], 0
    for number, tube in enumerate(scan.cylinders, 1):
        vertices, tube_triangles = triangulate_tube(tube)
        points.append(vertices)
        colours.append(np.tile(cylinder_rgb(number), (len(vertices), 1)))
        triangles.append(tube_triangles + vertex_count)
        vertex_count += len(vertices)
    return np.concatenate(points), np.concatenate(colours), np.concatenate(triangles)


def cylinder_rgb(number: int) -> tuple[float, float, float]:
    """Return the colour of a cylinder, numbered from 1, as red, green, blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    red, green, blue = to_rgb(cylinder_colour(number))
    return red, green, blue
