"""Pictures of calibrations: the target in the sensor's view, poses in space, and residuals."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.calibration.camera_warnings import CELLS_PER_SIDE, find_covered_cells
from lsvision.calibration.hand_eye_result import HandEye
from lsvision.calibration.intrinsics import CameraCalibration
from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
from lsvision.calibration.observations import Sphere
from lsvision.draw.figures import create_figure, make_printable
from lsvision.draw.space import fit_into_area, scale_axes
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arrays import rms
from lsvision.results.palette import BOARD, FRAME_AXES, INLIER, LASER_PLANE, OUTLIER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWING_AREA = (0.54, 0.02, 0.45, 0.82)
"""Left, bottom, width and height of the 3D drawing, as fractions of the figure."""
MAX_BAR_LABELS = 24
"""Largest number of names below the bars; of more groups only every second, third, ... is named."""


def draw_coverage(calibration: CameraCalibration) -> "Figure":
    """Return a figure of the corners of all views in the image, and of their residuals.

    Cells of the image without a corner are shaded.
    """
    from matplotlib.patches import Rectangle

    figure = create_figure((9.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    for view in calibration.views:
        left.plot(*view.target_view.pixels.T, ".", markersize=3)
    width, height = calibration.camera.size
    cell_width, cell_height = width / CELLS_PER_SIDE, height / CELLS_PER_SIDE
    for row, column in np.argwhere(
        ~find_covered_cells(calibration.camera.size, [v.target_view for v in calibration.views])
    ):
        corner = (column * cell_width, row * cell_height)
        left.add_patch(
            Rectangle(corner, cell_width, cell_height, color=OUTLIER, alpha=0.15, linewidth=0)
        )
    left.set(xlim=(0, width), ylim=(height, 0), xlabel="u / px", ylabel="v / px", aspect="equal",
             title="Detected points, one colour per view")  # fmt: skip
    residuals = np.concatenate([view.residuals for view in calibration.views])
    right.plot(*residuals.T, ".", color=INLIER, markersize=2)
    limit = 1.1 * float(np.abs(residuals).max()) + 1e-9  # above 0, also for exact views
    right.set(xlim=(-limit, limit), ylim=(limit, -limit), xlabel="du / px", ylabel="dv / px",
              aspect="equal", title="Projected minus detected")  # fmt: skip
    return figure


def draw_bars(
    names: Sequence[str],
    series: Sequence[tuple[str, Sequence[float]]],
    outliers: Sequence[int],
    axis_label: str,
) -> "Figure":
    """Return a figure of residuals as bars, one group for each view or pose.

    Each series is a name and a value for each group, NaN for a gap; bars of the first series are
    opaque. The groups at the positions `outliers` have the colour of outliers.
    """
    figure = create_figure((9.5, 3.4), layout="constrained")
    axes = figure.subplots()
    positions, group_width = np.arange(len(names)), 0.8
    width = group_width / len(series)
    colours = [OUTLIER if index in outliers else INLIER for index in range(len(names))]
    for number, (name, values) in enumerate(series):
        centres = positions + (number + 0.5) * width - group_width / 2
        axes.bar(centres, values, width, color=colours, alpha=1.0 if number == 0 else 0.45,
                 label=name)  # fmt: skip
    step = math.ceil(len(names) / MAX_BAR_LABELS)
    axes.set_xticks(positions[::step], list(map(make_printable, names[::step])), rotation=45,
                    ha="right", fontsize=8, parse_math=False)  # fmt: skip
    axes.set_ylabel(axis_label)
    if len(series) > 1:
        axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(series))
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_laser_plane(calibration: LaserPlaneCalibration, board: FloatArray) -> "Figure":
    """Return a figure of camera, laser plane and boards, in space and from the side.

    The camera frame is drawn with y downwards; in space its z axis is horizontal. `board` are the
    (4, 3) corners of the pattern in order around it, board frame, in mm.
    """
    figure = create_figure((9.5, 4.6))
    side = figure.add_axes((0.075, 0.13, 0.4, 0.73))
    space: Any = figure.add_axes(DRAWING_AREA, projection="3d")
    outlines = [view.camera_from_board.apply(board)[[0, 1, 2, 3, 0]] for view in calibration.views]
    for outline in outlines:
        side.plot(outline[:, 2], outline[:, 1], color=BOARD, linewidth=0.8)
        space.plot(outline[:, 0], outline[:, 2], -outline[:, 1], color=BOARD, linewidth=0.8)
    plane_corners = _find_plane_corners(calibration.plane, np.concatenate(outlines))
    side.plot(plane_corners[:, 2], plane_corners[:, 1], color=LASER_PLANE, linewidth=1.5)
    closed = plane_corners[[0, 1, 2, 3, 0]]
    space.plot(closed[:, 0], closed[:, 2], -closed[:, 1], color=LASER_PLANE)
    side.plot(0, 0, "k^")
    space.scatter(0, 0, 0, color="black", marker="^")
    side.set_aspect("equal", adjustable="datalim")
    side.set(xlabel="z / mm, along the view", ylabel="y / mm, down in the image",
             title="From the side: boards grey, laser red")  # fmt: skip
    side.invert_yaxis()
    scale_axes(space, ("x / mm", "z / mm", "−y / mm"))
    fit_into_area(space, DRAWING_AREA)
    _write_space_title(figure, "In space; triangle: camera")
    return figure


def draw_poses(calibration: HandEye, flanges: Sequence[Pose]) -> "Figure":
    """Return a figure of the sensor's poses, and of the target's positions in its view.

    `flanges` are ``base_from_flange`` of each observation, also of the rejected ones.
    """
    figure = create_figure((9.5, 4.6))
    space: Any = figure.add_axes(DRAWING_AREA, projection="3d")
    view = figure.add_axes((0.075, 0.13, 0.4, 0.73))
    sensors, centre = (
        _compute_sensor_poses(calibration, flanges),
        _find_target_point(calibration, flanges),
    )
    left_out = {pose.index for pose in calibration.rejected}
    targets_in_view = np.array([pose.inverse().apply_one(centre) for pose in sensors])
    length = 0.25 * float(np.linalg.norm(targets_in_view, axis=1).mean())
    for index, pose in enumerate(sensors):
        start = pose.translation
        for axis, colour in zip(pose.rotation.T, FRAME_AXES, strict=True):
            space.plot(*np.column_stack([start, start + length * axis]), color=colour,
                       linewidth=1.2)  # fmt: skip
        space.text(*start, f" {index}", fontsize=7, color=OUTLIER if index in left_out else "black")
    space.scatter(*centre, color="black")
    frame = "robot's base" if calibration.mounting == "eye_in_hand" else "flange"
    scale_axes(space, ("x / mm", "y / mm", "z / mm"))
    fit_into_area(space, DRAWING_AREA)
    _write_space_title(
        figure, f"Sensor (X red, Y green, Z blue) in the\n{frame} frame; target black"
    )
    _draw_view(view, targets_in_view, left_out, calibration)
    return figure


def _write_space_title(figure: "Figure", title: str) -> None:
    """Write a title above the 3D drawing, at the height of the title of the 2D drawing."""
    left, _, width, _ = DRAWING_AREA
    figure.text(left + width / 2, 0.885, title, ha="center", va="bottom", fontsize=12)


def compute_rms_of_views(calibration: LaserPlaneCalibration) -> tuple[list[float], list[float]]:
    """Return for each view the rms of the line's residuals and of the corners'. Units: px."""
    return (
        [rms(view.line_residuals) for view in calibration.views],
        [rms(np.hypot(*view.corner_residuals.T)) for view in calibration.views],
    )


def _draw_view(
    axes: "Axes", targets_in_view: FloatArray, left_out: set[int], calibration: HandEye
) -> None:
    """Draw the target's positions (n, 3) in the sensor's frame, coloured by the third coordinate.

    `left_out` holds the indices of the rejected positions. Units: mm.
    """
    third = targets_in_view[:, 2]
    if calibration.sensor == "camera":
        axes.set(xlabel="x / mm", ylabel="y / mm", title="Target in the camera's view")
        axes.invert_yaxis()
        low, high, label = float(third.min()), float(third.max()), "z / mm, along the view"
    else:
        point = (
            "Target's centre" if isinstance(calibration.target, Sphere) else "Point of the plane"
        )
        axes.set(xlabel="X / mm", ylabel="Y / mm", title=f"{point} in the section")
        high = float(np.abs(third).max()) + 1e-9  # above 0 for a target in the laser plane, too
        low, label = -high, "Z / mm, beside the laser plane"
    dots = axes.scatter(*targets_in_view[:, :2].T, c=third, cmap="coolwarm", vmin=low,
                        vmax=high, edgecolors="black", s=60)  # fmt: skip
    for index, point in enumerate(targets_in_view):
        axes.annotate(str(index), point[:2], xytext=(6, 4), textcoords="offset points", fontsize=8,
                      color=OUTLIER if index in left_out else "black")  # fmt: skip
    axes.figure.colorbar(dots, ax=axes, label=label)
    axes.margins(0.12)  # the numbers beside the outermost dots
    axes.set_aspect("equal", adjustable="datalim")


def _compute_sensor_poses(calibration: HandEye, flanges: Sequence[Pose]) -> list[Pose]:
    """Return the poses of the sensor in the frame in which the target is fixed.

    That is the base frame for a sensor on the flange, else the flange frame.
    """
    if calibration.mounting == "eye_in_hand":
        return [flange @ calibration.mount_from_sensor for flange in flanges]
    return [flange.inverse() @ calibration.mount_from_sensor for flange in flanges]


def _find_target_point(calibration: HandEye, flanges: Sequence[Pose]) -> FloatArray:
    """Return a point (3,) of the target, in the frame in which it is fixed. Units: mm."""
    if isinstance(calibration.target, Sphere):
        return calibration.target.centre
    if isinstance(calibration.target, Plane):
        # The point of the plane nearest to the mean of the sensors' working points.
        working_points = [
            pose.apply_one(calibration.working_point)
            for pose in _compute_sensor_poses(calibration, flanges)
        ]
        middle = np.mean(working_points, axis=0)
        normal = calibration.target.normal
        nearest: FloatArray = middle - normal * (normal @ middle - calibration.target.distance)
        return nearest
    return calibration.target.translation


def _find_plane_corners(plane: Plane, points: FloatArray) -> FloatArray:
    """Return the (4, 3) corners of a rectangle in a plane that contains the projections of points.

    The points are (n, 3); two sides of the rectangle are perpendicular to the x axis, or to the y
    axis if the plane's normal is nearly along x. Units: mm.
    """
    side_normal = (1.0, 0.0, 0.0) if abs(plane.normal[0]) < 0.99 else (0.0, 1.0, 0.0)
    first_axis = np.cross(plane.normal, side_normal)
    first_axis = first_axis / np.linalg.norm(first_axis)
    second_axis = np.cross(first_axis, plane.normal)
    coordinates = np.column_stack([points @ first_axis, points @ second_axis])
    (low_a, low_b), (high_a, high_b) = coordinates.min(axis=0), coordinates.max(axis=0)
    origin = plane.normal * plane.distance
    corners = [(low_a, low_b), (high_a, low_b), (high_a, high_b), (low_a, high_b)]
    return np.array([origin + a * first_axis + b * second_axis for a, b in corners])
