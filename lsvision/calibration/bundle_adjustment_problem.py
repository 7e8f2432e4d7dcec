"""Residuals of boards and laser line in pixels, as functions of one flat vector.

The board's shape is z = b1 (1 - (2x / Lx)^2) + b2 (1 - (2y / Ly)^2), mrcal's two-parameter
bow, with x and y from the middle and Lx, Ly the extent of the corners.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lsvision.calibration.bundle_adjustment_state import BundleAdjustmentState, LaserView
from lsvision.geometry import FloatArray, IntArray, Plane, Points, Pose
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.camera import Camera
from lsvision.sensors.distortion import COEFFICIENTS
from lsvision.sensors.light_section import LightSection

FOCAL_PRIOR = 0.02
"""One sigma of fx and fy before the boards are seen, as a fraction: keeps few boards solvable."""

CENTRE_PRIOR = 0.02
"""One sigma of cx and cy before, as a fraction of the focal length."""

DISTORTION_PRIOR = 0.3
"""One sigma of each distortion coefficient before."""

BOW_PRIOR = 2.0
"""mm; one sigma of each bow parameter before."""

DIFFERENCE_STEPS = np.array([1e-3] * 4 + [1e-6] * COEFFICIENTS + [1e-6] * 2 + [1e-3] + [1e-3] * 2)
"""Steps of the difference quotients: px, 1, rad, mm, mm."""

POSE_DIFFERENCE_STEPS = np.array([1e-6] * 3 + [1e-4] * 3)
"""Steps of a pose: rad, mm."""


class BundleAdjustmentProblem:
    """Residuals and Jacobian of all views around a start, as functions of a flat vector.

    The vector is [fx fy cx cy, 14 coefficients, plane tilt (2), plane distance, bow (2)] as
    increments to the start, of which only the `free` ones take part, then six for each pose
    (rotation vector in the camera frame, translation).

    Parameters
    ----------
    views : sequence of LaserView
        What was seen.
    start : BundleAdjustmentState
        Where to expand.
    refine : tuple of bool
        Whether the camera, and the bow, take part.
    corner_stds : sequence of float
        One sigma of a corner's coordinate in each view. Units: px.
    """

    def __init__(
        self,
        views: Sequence[LaserView],
        start: BundleAdjustmentState,
        refine: tuple[bool, bool],
        corner_stds: Sequence[float],
    ) -> None:
        self.start, self._count = start, len(views)
        self._corners, self._corner_view = _stacked([view.points for view in views])
        self._pixels, _ = _stacked([view.pixels for view in views])
        self._line, self._line_view = _stacked([view.line_pixels for view in views])
        line_std, _ = _stacked([view.line_std[:, None] for view in views])
        self._corner_std = np.asarray(corner_stds, dtype=np.float64)[self._corner_view, None]
        self._line_std = line_std[:, 0]
        middle, extent = _board_shape(self._corners)
        self._middle, self._half = middle, extent / 2
        self._axes = tilt_axes(start)
        self.free = np.flatnonzero(_free(start.camera, *refine))
        self._rays_of, self._kept_rays = b"", np.empty((0, 3))
        self._rows_of_view = np.concatenate([np.repeat(self._corner_view, 2), self._line_view])

    @property
    def size(self) -> int:
        """Length of the vector."""
        return len(self.free) + 6 * self._count

    def state(self, vector: FloatArray) -> BundleAdjustmentState:
        """The unknowns that a vector stands for."""
        camera, plane, bow = self._globals(vector)
        rotations, translations = self._poses(vector)
        poses = tuple(Pose(R, t) for R, t in zip(rotations, translations, strict=True))
        return BundleAdjustmentState(camera, plane, poses, bow)

    def residuals_in_pixels(self, vector: FloatArray) -> tuple[Points, FloatArray]:
        """Corner residuals (n, 2) and laser residuals (m,) of all views. Units: px."""
        camera, plane, bow = self._globals(vector)
        rotations, translations = self._poses(vector)
        return (
            self._corner_residuals(camera, bow, rotations, translations),
            self._line_residuals(camera, plane, bow, rotations, translations),
        )

    def __call__(self, vector: FloatArray) -> FloatArray:
        """Whitened residuals, the priors' last."""
        corner, line = self.residuals_in_pixels(vector)
        prior = vector[: len(self.free)] / _priors(self.start.camera)[self.free]
        return np.concatenate(
            [(corner / self._corner_std).ravel(), line / self._line_std, prior[np.isfinite(prior)]]
        )

    def jacobian(self, vector: FloatArray) -> FloatArray:
        """Difference quotients; those of the poses, which share no residual, all in one go."""
        here = self(vector)
        jacobian = np.zeros((len(here), self.size))
        data = np.arange(len(self._rows_of_view))
        for part, step in enumerate(POSE_DIFFERENCE_STEPS):
            shift = np.zeros(self.size)
            shift[len(self.free) + part :: 6] = step
            columns = len(self.free) + 6 * self._rows_of_view + part
            jacobian[data, columns] = (self(vector + shift) - here)[: len(data)] / step
        for column, step in enumerate(DIFFERENCE_STEPS[self.free]):
            shift = np.zeros(self.size)
            shift[column] = step
            jacobian[:, column] = (self(vector + shift) - here) / step
        return jacobian

    def columns_of_plane(self) -> IntArray:
        """Where in the vector the plane's tilt about X, about Y, and distance stand."""
        return np.flatnonzero((self.free >= 18) & (self.free < 21))

    def columns_of_bow(self) -> IntArray:
        """Where in the vector the bow stands; empty where it is held."""
        return np.flatnonzero(self.free >= 21)

    def split(self, values: FloatArray, line: bool) -> tuple[FloatArray, ...]:
        """Values of all corners, or of all line points, view by view."""
        view = self._line_view if line else self._corner_view
        return tuple(values[view == index] for index in range(self._count))

    def _globals(self, vector: FloatArray) -> tuple[Camera, Plane, FloatArray]:
        change = np.zeros(len(DIFFERENCE_STEPS))
        change[self.free] = vector[: len(self.free)]
        start = self.start
        matrix = start.camera.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
        distortion = start.camera.distortion + change[4:18][: len(start.camera.distortion)]
        camera = replace(start.camera, matrix=matrix, distortion=distortion)
        normal = start.plane.normal + change[18:20] @ self._axes
        # Scaled to unit length by itself; the distance is that of the unit normal.
        normal = normal / np.linalg.norm(normal)
        return camera, Plane(normal, start.plane.distance + change[20]), start.bow + change[21:]

    def _poses(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        from scipy.spatial.transform import Rotation

        change = vector[len(self.free) :].reshape(-1, 6)
        start = np.array([pose.rotation for pose in self.start.camera_from_boards])
        shift = np.array([pose.translation for pose in self.start.camera_from_boards])
        rotations = Rotation.from_rotvec(change[:, :3]).as_matrix() @ start
        return rotations, shift + change[:, 3:]

    def _corner_residuals(
        self, camera: Camera, bow: FloatArray, rotations: FloatArray, translations: FloatArray
    ) -> Points:
        corners = self._corners.copy()
        corners[:, 2] += self._height(corners[:, :2], bow)
        view = self._corner_view
        seen = np.einsum("nij,nj->ni", rotations[view], corners) + translations[view]
        return camera.project(seen) - self._pixels

    def _line_residuals(
        self,
        camera: Camera,
        plane: Plane,
        bow: FloatArray,
        rotations: FloatArray,
        translations: FloatArray,
    ) -> FloatArray:
        """Height of the lit points over the board, as pixels across the line."""
        rays, view = self._rays(camera), self._line_view
        slant = rays @ plane.normal
        lit = rays * (plane.distance / slant)[:, None]
        R = rotations[view]
        on_board = np.einsum("nij,ni->nj", R, lit - translations[view])
        height = on_board[:, 2] - self._height(on_board[:, :2], bow)
        slopes = -2 * bow * (on_board[:, :2] - self._middle) / self._half**2
        up = R[:, :, 2] - np.einsum("nij,nj->ni", R[:, :, :2], slopes)
        # X = z m with z = D / (n . m): d height / d m_j = z (up_j - (up . m) n_j / (n . m)).
        depth = plane.distance / slant
        tilt = np.einsum("ni,ni->n", up, rays) / slant
        gradient = depth[:, None] * (up[:, :2] - tilt[:, None] * plane.normal[:2])
        residuals: FloatArray = camera.focal_length * height / np.hypot(*gradient.T)
        return residuals

    def _rays(self, camera: Camera) -> Points:
        """Rays of all line points; kept while the camera stays, undistortion being the cost."""
        key = camera.matrix.tobytes() + camera.distortion.tobytes()
        if key != self._rays_of:
            self._rays_of, self._kept_rays = key, camera.rays(self._line)
        return self._kept_rays

    def _height(self, points: Points, bow: FloatArray) -> FloatArray:
        height: FloatArray = (1 - ((points - self._middle) / self._half) ** 2) @ bow
        return height


def tilt_axes(start: BundleAdjustmentState) -> FloatArray:
    """Change (2, 3) of the plane's normal by one rad about the section's X, and about its Y."""
    x, y, z = LightSection(start.camera, start.plane).camera_from_section.rotation.T
    axes: FloatArray = np.stack([-y, x]) * np.sign(float(z @ start.plane.normal))
    return axes


def _free(camera: Camera, refine_camera: bool, refine_bow: bool) -> BoolArray:
    free = np.zeros(len(DIFFERENCE_STEPS), dtype=bool)
    if refine_camera:
        free[:4] = True
        used = len(camera.distortion)
        # k3 and beyond stay where they are unless the camera's model uses them.
        free[4 : 4 + min(used, 4)] = True
        free[8 : 4 + used] = camera.distortion[4:] != 0
    free[18:21] = True
    free[21:] = refine_bow
    return free


def _priors(camera: Camera) -> FloatArray:
    focal = camera.focal_length
    return np.concatenate(
        [
            np.full(2, FOCAL_PRIOR * focal),
            np.full(2, CENTRE_PRIOR * focal),
            np.full(COEFFICIENTS, DISTORTION_PRIOR),
            np.full(3, np.inf),
            np.full(2, BOW_PRIOR),
        ]
    )


def _board_shape(corners: Points) -> tuple[FloatArray, FloatArray]:
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    return (low + high) / 2, high - low


def _stacked(arrays: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    counts = [len(array) for array in arrays]
    return np.concatenate(arrays), np.repeat(np.arange(len(arrays)), counts)
