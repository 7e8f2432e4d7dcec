"""Section frame of a plane in a camera's frame: origin, X along the line, Y towards the sensor."""

import numpy as np

from lsvision.geometry import Plane, Pose

MIN_FACING_COSINE = 0.98
"""Cosine of the angle (11 deg) between the optical axis and the plane's normal above which the
plane faces the camera, so that the optical axis does not determine the direction of Y."""


def section_pose(plane: Plane) -> Pose:
    """Return the pose of the section frame in the frame of the camera.

    Origin at the point of the plane nearest to the camera's centre; Y in the plane, opposite to the
    optical axis; X in the plane, perpendicular to Y, increasing with image u (with image v if X is
    closer to the direction of v); Z = X x Y. Where the plane faces the camera (within 11 deg), X
    follows image u and Y points up in the image.

    Parameters
    ----------
    plane : Plane
        Plane in the camera frame, with z along the optical axis. Units: mm.

    Returns
    -------
    Pose
        ``camera_from_section``. Units: mm.

    Examples
    --------
    >>> section_pose(Plane((0.0, 0.866, 0.5), 150.0)).rotation[:, 1].round(3)
    array([ 0.   ,  0.5  , -0.866])
    """
    normal, optical_axis = plane.normal, np.array([0.0, 0.0, 1.0])
    if abs(normal @ optical_axis) > MIN_FACING_COSINE:
        # The cross product with the optical axis is nearly zero: X follows image u instead.
        x = np.array([1.0, 0.0, 0.0])
        x = x - normal * (normal @ x)
        upwards = np.array([0.0, -1.0, 0.0])
    else:
        x = np.cross(normal, optical_axis)
        x = x * np.sign(x[np.argmax(np.abs(x))])
        upwards = -optical_axis
    x = x / np.linalg.norm(x)
    y = np.cross(normal, x)
    y = y * np.sign(y @ upwards)
    rotation = np.column_stack([x, y, np.cross(x, y)])
    return Pose(rotation, normal * plane.distance)
