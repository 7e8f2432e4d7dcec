"""Points and surfaces of a scan with the colours of its picture."""

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Points
from lsvision.results.palette import cylinder_colour
from lsvision.scan import ScanMeasurement
from lsvision.scan.shape import triangulate_tube

GREY = (0.6, 0.6, 0.6)


def coloured_points(scan: ScanMeasurement, points: Points) -> tuple[Points, FloatArray]:
    """Return all points of a scan in grey, then those of each cylinder in its colour.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.
    points : (n, 3) ndarray
        All points, base frame. Units: mm.

    Returns
    -------
    points : (m, 3) ndarray
        Points, each once, base frame. Units: mm.
    colours : (m, 3) ndarray
        Colour of each point: red, green, blue, 0 to 1.
    """
    cylinder_points = [tube.points for tube in scan.cylinders]
    assigned = {tuple(point) for array in cylinder_points for point in array.tolist()}
    unassigned = points[[tuple(point) not in assigned for point in points.tolist()]]
    colours = [np.tile(GREY, (len(unassigned), 1))]
    colours += [
        np.tile(cylinder_rgb(number), (len(array), 1))
        for number, array in enumerate(cylinder_points, 1)
    ]
    return np.concatenate([unassigned, *cylinder_points]), np.concatenate(colours)


def coloured_surfaces(scan: ScanMeasurement) -> tuple[Points, FloatArray, IntArray]:
    """Return the surfaces of all cylinders as one mesh.

    Parameters
    ----------
    scan : ScanMeasurement
        Measurement of the scan.

    Returns
    -------
    points : (n, 3) ndarray
        Corners of the triangles, base frame. Units: mm.
    colours : (n, 3) ndarray
        Colour of each point: red, green, blue, 0 to 1.
    triangles : (m, 3) ndarray of int
        Indices of the corners in `points`.
    """
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3))]
    triangles, count = [np.zeros((0, 3), dtype=np.int64)], 0
    for number, tube in enumerate(scan.cylinders, 1):
        corners, faces = triangulate_tube(tube)
        points.append(corners)
        colours.append(np.tile(cylinder_rgb(number), (len(corners), 1)))
        triangles.append(faces + count)
        count += len(corners)
    return np.concatenate(points), np.concatenate(colours), np.concatenate(triangles)


def cylinder_rgb(number: int) -> tuple[float, float, float]:
    """Return the colour of a cylinder, numbered from 1, as red, green, blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    red, green, blue = to_rgb(cylinder_colour(number))
    return red, green, blue
