"""Pictures of calibrations: where the target was seen, and how large the residuals are."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.calibration.hand_eye_result import HandEye, Sphere
from lsvision.calibration.intrinsics import CameraCalibration
from lsvision.calibration.laser_plane_result import LaserPlaneCalibration, rms
from lsvision.geometry import FloatArray, Plane, Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INLIER_COLOUR, OUTLIER_COLOUR, NEUTRAL_COLOUR, LASER = "#0072B2", "#D55E00", "#999999", "#C8102E"
AXES = ("#C8102E", "#00805E", "#0072B2")
"""Of X, Y and Z."""
MAX_BAR_LABELS = 24
"""Bars beyond which only every few get a name."""


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure with a canvas of its own; inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def draw_coverage(found: CameraCalibration) -> "Figure":
    """Where in the image the target's points were seen, and the residuals of all points."""
    figure = new_figure(9.5, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    for view in found.views:
        left.plot(*view.seen.pixels.T, ".", markersize=3)
    width, height = found.camera.size
    left.set(xlim=(0, width), ylim=(height, 0), xlabel="u px", ylabel="v px", aspect="equal",
             title="Points seen, a colour a view")  # fmt: skip
    residuals = np.concatenate([view.residuals for view in found.views])
    right.plot(*residuals.T, ".", color=INLIER_COLOUR, markersize=2)
    reach = 1.1 * float(np.abs(residuals).max()) + 1e-9
    right.set(xlim=(-reach, reach), ylim=(reach, -reach), xlabel="du px", ylabel="dv px",
              aspect="equal", title="Projected minus seen")  # fmt: skip
    return figure


def draw_bars(
    names: Sequence[str],
    series: Sequence[tuple[str, Sequence[float]]],
    bad: Sequence[int],
    unit: str,
) -> "Figure":
    """Residuals as bars, a group each view or pose.

    Parameters
    ----------
    names : sequence of str
        Of the groups.
    series : sequence of (str, sequence of float)
        Its name and a value for each group; NaN leaves a gap.
    bad : sequence of int
        Groups to mark.
    unit : str
        Of the values.
    """
    figure = new_figure(9.5, 3.4)
    axes = figure.subplots()
    place, width = np.arange(len(names)), 0.8 / len(series)
    for number, (name, values) in enumerate(series):
        shade = 1.0 if number == 0 else 0.45
        colours = [OUTLIER_COLOUR if index in bad else INLIER_COLOUR for index in range(len(names))]
        axes.bar(place + (number + 0.5) * width - 0.4, values, width, color=colours, alpha=shade,
                 label=name)  # fmt: skip
    step = 1 + len(names) // MAX_BAR_LABELS
    axes.set_xticks(place[::step], names[::step], rotation=45, ha="right", fontsize=8,
                    parse_math=False)  # fmt: skip
    axes.set_ylabel(unit)
    if len(series) > 1:
        axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_laser_plane(found: LaserPlaneCalibration, board: FloatArray) -> "Figure":
    """Camera, laser plane and boards in space, and from the side.

    Parameters
    ----------
    found : LaserPlaneCalibration
        The calibration.
    board : (4, 3) ndarray
        Corners of the pattern, board frame. Units: mm.
    """
    figure = new_figure(9.5, 4.6)
    side = figure.add_subplot(1, 2, 1)
    space: Any = figure.add_subplot(1, 2, 2, projection="3d")
    outlines = [view.camera_from_board.apply(board)[[0, 1, 2, 3, 0]] for view in found.views]
    for outline in outlines:
        side.plot(outline[:, 2], outline[:, 1], color=NEUTRAL_COLOUR, linewidth=0.8)
        space.plot(
            outline[:, 0], outline[:, 2], -outline[:, 1], color=NEUTRAL_COLOUR, linewidth=0.8
        )
    sheet = _sheet(found.plane, np.concatenate(outlines))
    side.plot(sheet[:, 2], sheet[:, 1], color=LASER, linewidth=1.5)
    closed = sheet[[0, 1, 2, 3, 0]]
    space.plot(closed[:, 0], closed[:, 2], -closed[:, 1], color=LASER)
    side.plot(0, 0, "k^")
    space.scatter(0, 0, 0, color="black", marker="^")
    side.set(xlabel="z mm, along the view", ylabel="y mm, down in the image", aspect="equal",
             title="From the side: boards grey, laser red")  # fmt: skip
    side.set_ylim(side.get_ylim()[::-1] if side.get_ylim()[0] < side.get_ylim()[1] else None)
    space.set(xlabel="x", ylabel="z", zlabel="-y", title="In space, mm", aspect="equal")
    return figure


def draw_poses(found: HandEye, flanges: Sequence[Pose]) -> "Figure":
    """Where the sensor stood, and where in its view the target was."""
    figure = new_figure(9.5, 4.6)
    space: Any = figure.add_subplot(1, 2, 1, projection="3d")
    view = figure.add_subplot(1, 2, 2)
    sensors, centre = _sensors(found, flanges), _target_point(found, flanges)
    left_out = {pose.index for pose in found.rejected}
    seen = np.array([pose.inverse().apply_one(centre) for pose in sensors])
    length = 0.25 * float(np.linalg.norm(seen, axis=1).mean())
    for index, pose in enumerate(sensors):
        start = pose.translation
        for axis, colour in zip(pose.rotation.T, AXES, strict=True):
            space.plot(*np.column_stack([start, start + length * axis]), color=colour,
                       linewidth=1.2)  # fmt: skip
        space.text(
            *start, f" {index}", fontsize=7, color=OUTLIER_COLOUR if index in left_out else "black"
        )
    space.scatter(*centre, color="black")
    mount = "robot's base" if found.mounting == "eye_in_hand" else "flange"
    title = f"Sensor (X red, Y green, Z blue) in the\n{mount} frame, mm; target black"
    space.set(xlabel="x", ylabel="y", zlabel="z", aspect="equal", title=title)
    _draw_view(view, seen, left_out, found)
    return figure


def view_sizes(found: LaserPlaneCalibration) -> tuple[list[float], list[float]]:
    """Root mean square of line and corner residuals of each view. Units: px."""
    return (
        [rms(view.line_residuals) for view in found.views],
        [float(np.sqrt(2)) * rms(view.corner_residuals) for view in found.views],
    )


def _draw_view(axes: "Axes", seen: FloatArray, left_out: set[int], found: HandEye) -> None:
    across = float(np.abs(seen[:, 2]).max()) + 1e-9
    if found.sensor == "camera":
        axes.set(xlabel="x mm", ylabel="y mm", title="Target in the camera's view")
        axes.invert_yaxis()
        colours = seen[:, 2]
        limits: tuple[float, float] = (float(colours.min()), float(colours.max()))
    else:
        axes.set(xlabel="X mm", ylabel="Y mm", title="Target's centre in the section")
        colours, limits = seen[:, 2], (-across, across)
    dots = axes.scatter(*seen[:, :2].T, c=colours, cmap="coolwarm", vmin=limits[0],
                        vmax=limits[1], edgecolors="black", s=60)  # fmt: skip
    for index, point in enumerate(seen):
        axes.annotate(str(index), point[:2], xytext=(6, 4), textcoords="offset points", fontsize=8,
                      color=OUTLIER_COLOUR if index in left_out else "black")  # fmt: skip
    label = "z mm, along the view" if found.sensor == "camera" else "Z mm, beside the laser plane"
    axes.figure.colorbar(dots, ax=axes, label=label)
    axes.set_aspect("equal", adjustable="datalim")


def _sensors(found: HandEye, flanges: Sequence[Pose]) -> list[Pose]:
    """The sensor in the frame in which the target stands still."""
    if found.mounting == "eye_in_hand":
        return [flange @ found.mount_from_sensor for flange in flanges]
    return [flange.inverse() @ found.mount_from_sensor for flange in flanges]


def _target_point(found: HandEye, flanges: Sequence[Pose]) -> FloatArray:
    if isinstance(found.target, Sphere):
        return found.target.centre
    if isinstance(found.target, Plane):
        # Of a plane, the point below the middle of where the sensors looked.
        looked = [pose.apply_one(found.working_point) for pose in _sensors(found, flanges)]
        middle = np.mean(looked, axis=0)
        normal = found.target.normal
        foot: FloatArray = middle - normal * (normal @ middle - found.target.distance)
        return foot
    return found.target.translation


def _sheet(plane: Plane, points: FloatArray) -> FloatArray:
    """(4, 3) corners of the part of the laser plane near points."""
    along = np.cross(plane.normal, (1.0, 0.0, 0.0))
    along = along / np.linalg.norm(along)
    other = np.cross(along, plane.normal)
    flat = np.column_stack([points @ along, points @ other])
    (low_a, low_b), (high_a, high_b) = flat.min(axis=0), flat.max(axis=0)
    origin = plane.normal * plane.distance
    corners = [(low_a, low_b), (high_a, low_b), (high_a, high_b), (low_a, high_b)]
    return np.array([origin + a * along + b * other for a, b in corners])
