"""Simulate images of calibration boards with a laser line: exact points plus noise.

Points are projected by OpenCV and not by the library, so that errors of either are noticed.
Assumptions: the laser sheet has no thickness; errors of corners and line are independent and
normal; the board is bent as z = b1 (1 - X^2) + b2 (1 - Y^2) + t X Y with X, Y = -1 to 1.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from lsvision.geometry import FloatArray, Plane, Points, Pose

MAX_ROTATION = np.radians(15.0)
"""Largest rotation of a board about its normal. Units: rad."""
MAX_DRAWS = 1000
"""Largest number of random poses until the line crosses a board: the default scene needs one
to eight."""
MAX_OFFSET_FRACTION = 0.24
"""Largest distance of a board's centre from the principal point, as a fraction of the image's width
and height: in two of five images some corners lie outside, by up to a fifth of the image."""
LINE_ITERATIONS = 50
"""Fixed-point iterations of the laser line on a bent board."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardScene:
    """Camera, laser, calibration board, and the distribution of its poses.

    Parameters
    ----------
    matrix : (3, 3) ndarray
        Camera matrix. Units: px.
    distortion : (k,) ndarray
        Distortion coefficients in OpenCV's order.
    size : tuple of int
        ``(width, height)``. Units: px.
    plane : Plane
        Laser plane, camera frame. Units: mm.
    distance : float
        Mean depth of the boards. Units: mm.
    columns, rows : int
        Number of inner corners, at least two each.
    square : float
        Size of a square. Units: mm.
    tilt : float
        Largest tilt about either axis of the board. Units: rad.
    depth_range : float
        Largest deviation from `distance`, as a fraction of it.
    bow : tuple of float
        Deviations b1, b2 of the middle from flatness along columns and rows; see the module.
        Units: mm.
    twist : float
        Deviation t of the corners from flatness. Units: mm.
    corner_std, line_std : float
        Standard deviation of a corner coordinate, and of a line point along the normal of the
        line. Units: px.
    line_points : int
        Number of points of the line on each board, at least two.
    """

    matrix: FloatArray = field(
        default_factory=lambda: np.array([[2264.0, 0, 639.5], [0, 2264.0, 511.5], [0, 0, 1]])
    )
    distortion: FloatArray = field(default_factory=lambda: np.array([-0.12, 0.1, 0.0, 0.0, 0.0]))
    size: tuple[int, int] = (1280, 1024)
    plane: Plane = field(default_factory=lambda: Plane(np.array([0.0, np.sqrt(0.75), 0.5]), 150.0))
    distance: float = 300.0
    columns: int = 10
    rows: int = 7
    square: float = 12.0
    tilt: float = np.radians(30.0)
    depth_range: float = 0.15
    bow: tuple[float, float] = (0.0, 0.0)
    twist: float = 0.0
    corner_std: float = 0.05
    line_std: float = 0.1
    line_points: int = 100


@dataclass(frozen=True, eq=False)
class SimulatedBoard:
    """Simulated measurement of a board in one pose.

    Parameters
    ----------
    points : (n, 3) ndarray
        Nominal corners, board frame, z = 0. Units: mm.
    pixels : (n, 2) ndarray
        Image points of the corners, with noise. Units: px.
    line_pixels : (m, 2) ndarray
        Image points of the laser line on the board, with noise along its normal. Units: px.
    camera_from_board : Pose
        True pose.
    """

    points: FloatArray
    pixels: FloatArray
    line_pixels: FloatArray
    camera_from_board: Pose


def simulate_boards(
    scene: BoardScene, count: int, *, rng: np.random.Generator
) -> tuple[SimulatedBoard, ...]:
    """Simulate boards in random poses, each crossed by the laser line from side to side.

    Parameters
    ----------
    scene : BoardScene
        Camera, laser and board.
    count : int
        Number of boards.
    rng : numpy.random.Generator
        Source of poses and noise.

    Returns
    -------
    tuple of SimulatedBoard
        Measurement of each board.

    Raises
    ------
    ValueError
        If the line crosses the board from side to side in none of `MAX_DRAWS` poses.

    Examples
    --------
    >>> board = simulate_boards(BoardScene(), 1, rng=np.random.default_rng(0))[0]
    >>> len(board.pixels), len(board.line_pixels)
    (70, 100)
    """
    return tuple(_measure(scene, *_draw_crossed_pose(scene, rng), rng) for _ in range(count))


def _draw_crossed_pose(scene: BoardScene, rng: np.random.Generator) -> tuple[Pose, Points]:
    """Return a random pose in which the line crosses the board, and the line's points on it."""
    for _ in range(MAX_DRAWS):
        pose = _draw_random_pose(scene, rng)
        line = _intersect_board(scene, pose)
        if line is not None:
            return pose, line
    raise ValueError(
        f"expected a laser plane that crosses the board from side to side, got none in {MAX_DRAWS} "
        "poses; move the laser or the board's distance"
    )


def _measure(
    scene: BoardScene, pose: Pose, line: Points, rng: np.random.Generator
) -> SimulatedBoard:
    """Return corners and line points in the image, with noise."""
    corners = _build_corners(scene)
    bent = corners + np.outer(_compute_height(scene, corners[:, :2]), (0.0, 0.0, 1.0))
    pixels = _project(scene, pose.apply(bent))
    line_pixels = _project(scene, pose.apply(line))
    tangents = np.gradient(line_pixels, axis=0)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]]) / np.hypot(*tangents.T)[:, None]
    errors = rng.normal(0, scene.line_std, (len(line), 1))
    return SimulatedBoard(
        corners,
        pixels + rng.normal(0, scene.corner_std, pixels.shape),
        line_pixels + normals * errors,
        pose,
    )


def _draw_random_pose(scene: BoardScene, rng: np.random.Generator) -> Pose:
    """Return a random ``camera_from_board`` within the limits of the scene."""
    about_x, about_y = rng.uniform(-scene.tilt, scene.tilt, 2)
    about_z = rng.uniform(-MAX_ROTATION, MAX_ROTATION)
    rotation = np.eye(3)
    for vector in ((about_x, 0, 0), (0, about_y, 0), (0, 0, about_z)):
        rotation = rotation @ cv2.Rodrigues(np.array(vector, dtype=float))[0]
    depth = scene.distance * (1 + rng.uniform(-scene.depth_range, scene.depth_range))
    focal_lengths = scene.matrix[[0, 1], [0, 1]]
    offset_px = rng.uniform(-MAX_OFFSET_FRACTION, MAX_OFFSET_FRACTION, 2) * scene.size
    centre = np.array([*(offset_px / focal_lengths * depth), depth])
    middle = _build_corners(scene).mean(axis=0)
    return Pose(rotation, centre - rotation @ middle)


def _intersect_board(scene: BoardScene, pose: Pose) -> Points | None:
    """Return (m, 3) points of the laser line, board frame, evenly spaced in x. Units: mm.

    None unless the line crosses the board from its first column to its last.
    """
    corners = _build_corners(scene)
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    x = np.linspace(low[0], high[0], scene.line_points)
    plane = scene.plane.transformed(pose.inverse())
    y = np.zeros_like(x)
    for _ in range(LINE_ITERATIONS):
        # Fixed-point iteration, which converges because the bow is small.
        z = _compute_height(scene, np.column_stack([x, y]))
        y = (plane.distance - plane.normal[0] * x - plane.normal[2] * z) / plane.normal[1]
    if not ((y > low[1]) & (y < high[1])).all():
        return None
    return np.column_stack([x, y, _compute_height(scene, np.column_stack([x, y]))])


def _build_corners(scene: BoardScene) -> Points:
    """Return the nominal corners (n, 3) of the flat board, board frame. Units: mm."""
    row, column = np.divmod(np.arange(scene.columns * scene.rows), scene.columns)
    return np.column_stack([column, row, np.zeros(len(row))]) * scene.square


def _compute_height(scene: BoardScene, points: Points) -> FloatArray:
    """Return z of the bent board at (n, 2) points. Units: mm."""
    half = np.array([scene.columns - 1, scene.rows - 1]) * scene.square / 2
    scaled = (points - half) / half
    height: FloatArray = (1 - scaled**2) @ np.array(scene.bow) + scene.twist * scaled.prod(axis=1)
    return height


def _project(scene: BoardScene, points: Points) -> Points:
    """Return the pixels (n, 2) of points (n, 3) of the camera frame."""
    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), scene.matrix, np.asarray(scene.distortion, float)
    )
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
