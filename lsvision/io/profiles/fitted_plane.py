"""Fit of a plane to points in space, and their transformation to its section frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arrays import MAX_COORDINATE_MM
from lsvision.geometry.plane import find_section_pose

MAX_THICKNESS_RATIO = 0.1
"""Largest rms distance from the plane, relative to the rms extent of the points in it normal to the
line that fits them best: at 0.1, the plane of 100 points is determined to about 0.01 rad."""
MIN_EXTENT_RATIO = 0.01
"""Smallest rms extent normal to the line relative to that along it, below which the points are on a
line."""
MIN_POINTS = 5
"""Smallest number of valid points to which a plane is fitted."""
MAX_ZERO_DEPTH_RATIO = 1e-3
"""Largest mean z, relative to the rms extent along the line, that may be noise about 0."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedSections:
    """Points of one or several profiles in the plane that was fitted to all of them.

    `sections` are (n, 2) points (x, y) in the section frame, NaN where lost. `file_from_section` is
    the section frame, with Z along the plane's normal, in the frame of the points. The note
    describes the plane and its residuals. Units: mm.
    """

    sections: tuple[FloatArray, ...]
    file_from_section: Pose
    note: str


def fit_section_plane(clouds: Sequence[FloatArray], *, flip: bool = False) -> FittedSections:
    """Fit one plane to the points of all profiles; return the points in its section frame.

    The frame is that of `find_section_pose`: Y points against the z axis of the points' frame, as
    for a camera that looks along z. If the mean z is negative (heights below the sensor) or about 0
    (points x, y in the plane z = 0), Y and Z are reversed: Y then points along z, or along y if the
    plane is normal to z. `flip` reverses Y and Z once more. Points are (n, 3) in mm, NaN where
    lost.

    Raises
    ------
    UnreadableFile
        If the points do not have three coordinates, are fewer than `MIN_POINTS`, do not lie in a
        plane, lie on a line, or have coordinates too large for any sensor.
    """
    points = _select_valid_points(clouds)
    centre = points.mean(axis=0)
    _, singular_values, axes = np.linalg.svd(points - centre, full_matrices=False)
    extents = singular_values / np.sqrt(len(points))
    _check_flatness(extents)
    plane = Plane(axes[2], float(axes[2] @ centre))
    pose = find_section_pose(plane)
    if (centre[2] < MAX_ZERO_DEPTH_RATIO * extents[0]) != flip:
        pose = Pose(pose.rotation * (1.0, -1.0, -1.0), pose.translation)
    section_from_file = pose.inverse()
    distances = plane.signed_distances(points)
    rms, largest = float(np.sqrt(np.mean(distances**2))), float(np.abs(distances).max())
    normal = ", ".join(f"{component:.4f}" for component in pose.rotation[:, 2].round(4) + 0.0)
    return FittedSections(
        sections=tuple(section_from_file.apply(cloud)[:, :2] for cloud in clouds),
        file_from_section=pose,
        note=f"plane fitted to {len(points)} points: normal ({normal}), "
        f"{abs(plane.distance):.3f} mm from the origin, residual rms {rms:.3g} mm, largest "
        f"{largest:.3g} mm",
    )


def _select_valid_points(clouds: Sequence[FloatArray]) -> FloatArray:
    """Return the points of all profiles that are not lost, after a check of shape and size."""
    if any(cloud.shape[1] != 3 for cloud in clouds):
        raise UnreadableFile(
            "--plane fit needs x, y and z of each point, got x and height: leave --plane out"
        )
    points = np.concatenate(clouds)
    points = points[~np.isnan(points).any(axis=1)]
    if len(points) < MIN_POINTS:
        raise UnreadableFile(
            f"{len(points)} valid points, --plane fit needs at least {MIN_POINTS}: check exposure"
        )
    if float(np.abs(points).max()) > MAX_COORDINATE_MM:
        raise UnreadableFile(
            f"coordinates reach {np.abs(points).max():.3g} mm: state what marks lost points with "
            "--lost, or the unit with --units"
        )
    return points


def _check_flatness(extents: FloatArray) -> None:
    """Raise an error unless the rms extents, descending, are those of a plane."""
    length, width, thickness = extents
    if width <= MIN_EXTENT_RATIO * length:
        raise UnreadableFile(
            f"the points lie on a line (rms {width:.3g} mm across {length:.3g} mm along), which "
            "fits any plane through it: --plane fit needs a curved section, as of a pipe"
        )
    if thickness > MAX_THICKNESS_RATIO * width:
        raise UnreadableFile(
            f"the points do not lie in a plane (rms {thickness:.3g} mm from the best one, and "
            f"{width:.3g} mm across their line): write the points of one laser plane only, "
            "each section in its own file or with its number in a column"
        )
