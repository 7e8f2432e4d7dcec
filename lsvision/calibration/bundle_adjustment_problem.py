"""Reprojection residuals of boards and laser line, as functions of one parameter vector.

The shape of the board has the parameters of `board_shape.BoardShape`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.board_shape import SHAPE_TERMS, BoardShape
from lsvision.geometry import FloatArray, IntArray, Plane, Points, Pose, as_readonly_array
from lsvision.geometry.arrays import BoolArray, freeze_arrays
from lsvision.sensors.camera import Camera
from lsvision.sensors.distortion import COEFFICIENTS
from lsvision.sensors.light_section import LightSection

MIN_POINTS = 4
"""Smallest number of corners, which determine a homography, and of points of a laser line, whose
noise is the deviation from a parabola."""

FOCAL_PRIOR = 0.02
"""Relative standard deviation of the prior on fx and fy: regularises sets of few boards."""

CENTRE_PRIOR = 0.02
"""Standard deviation of the prior on cx and cy, as a fraction of the focal length."""

DISTORTION_PRIOR = 0.3
"""Standard deviation of the prior on each distortion coefficient."""

BOW_PRIOR = 2.0
"""Standard deviation of the prior on each bow parameter. Units: mm."""

FOCAL_AND_CENTRE = slice(0, 4)
DISTORTION = slice(4, 4 + COEFFICIENTS)
TILT = slice(DISTORTION.stop, DISTORTION.stop + 2)
DISTANCE = TILT.stop
BOW = slice(DISTANCE + 1, DISTANCE + 1 + SHAPE_TERMS)
"""Indices of the parameters that all views share: fx fy cx cy, coefficients of distortion, tilts of
the plane about the section's X and Y, its distance, and bow and twist of the board."""

DIFFERENCE_STEPS = np.array(
    [1e-3] * 4 + [1e-6] * COEFFICIENTS + [1e-6] * 2 + [1e-3] + [1e-3] * SHAPE_TERMS
)
"""Steps of the difference quotients by these parameters. Units: px, 1, rad, mm, mm."""

POSE_DIFFERENCE_STEPS = np.array([1e-6] * 3 + [1e-4] * 3)
"""Steps of the difference quotients by a pose. Units: rad, mm."""


@dataclass(frozen=True, eq=False)
class LaserView:
    """Measurements of one board pose: its corners, and the laser line on it.

    Parameters
    ----------
    points : (n, 3) array_like
        Corners, at least `MIN_POINTS`, board frame, z = 0. Units: mm.
    pixels : (n, 2) array_like
        Corners in the image. Units: px.
    line_pixels : (m, 2) array_like
        Points of the laser line on the board, at least `MIN_POINTS`. Units: px.
    line_std : (m,) array_like
        Standard deviation of each point along the line's normal. Units: px.
    """

    points: FloatArray
    pixels: FloatArray
    line_pixels: FloatArray
    line_std: FloatArray

    def __post_init__(self) -> None:
        corners, points = len(self.points), len(self.line_pixels)
        object.__setattr__(self, "points", as_readonly_array(self.points, ("n", 3), "board points"))
        freeze_arrays(self, pixels=(corners, 2), line_pixels=("m", 2), line_std=(points,))
        if not all(np.isfinite(a).all() for a in (self.points, self.pixels, self.line_pixels)):
            raise ValueError(
                "expected finite points and pixels, got NaN or infinity: leave lost points out"
            )
        if min(corners, points) < MIN_POINTS:
            raise ValueError(
                f"expected at least {MIN_POINTS} points and line_pixels, got {corners} and {points}"
            )
        if not (self.line_std > 0).all():
            raise ValueError(f"expected positive line_std in px, got {self.line_std.min():g}")


@dataclass(frozen=True, slots=True)
class Refinement:
    """Parts of the state that are refined beside the plane and the poses, which always are.

    Parameters
    ----------
    camera : bool
        Whether the intrinsics are refined.
    bow : bool
        Whether bow and twist of the board are refined.
    """

    camera: bool
    bow: bool


@dataclass(frozen=True, eq=False)
class BundleAdjustmentState:
    """Unknowns of the bundle adjustment.

    Parameters
    ----------
    camera : Camera
        Intrinsics.
    plane : Plane
        Laser plane, camera frame. Units: mm.
    camera_from_boards : tuple of Pose
        Pose of the board in each view. Units: mm.
    bow : (3,) array_like
        Bow along x and along y, and twist of the board. Units: mm.
    """

    camera: Camera
    plane: Plane
    camera_from_boards: tuple[Pose, ...]
    bow: FloatArray


class BundleAdjustmentProblem:
    """Residuals and Jacobian of all views as functions of increments to an initial guess.

    The vector has the refined ones (`free`) of the parameters that all views share, in the order
    `FOCAL_AND_CENTRE`, `DISTORTION`, `TILT`, `DISTANCE`, `BOW`, then six for each pose: left
    perturbation (rad) and translation (mm).

    Parameters
    ----------
    views : sequence of LaserView
        Corners and line of each view.
    initial_guess : BundleAdjustmentState
        State to which the increments are added.
    refinement : Refinement
        Parts of the state that are refined.
    corner_stds : sequence of float
        Standard deviation of a corner coordinate in each view. Units: px.
    """

    def __init__(
        self,
        views: Sequence[LaserView],
        initial_guess: BundleAdjustmentState,
        refinement: Refinement,
        corner_stds: Sequence[float],
    ) -> None:
        self.initial_guess, self._count = initial_guess, len(views)
        self._corners, self._corner_view = _concatenate_views([view.points for view in views])
        self._pixels, _ = _concatenate_views([view.pixels for view in views])
        self._line, self._line_view = _concatenate_views([view.line_pixels for view in views])
        line_std, _ = _concatenate_views([view.line_std[:, None] for view in views])
        self._corner_std = np.asarray(corner_stds, dtype=np.float64)[self._corner_view, None]
        self._line_std = line_std[:, 0]
        self._shape = BoardShape.of(self._corners)
        self._axes = build_tilt_axes(initial_guess)
        self.free = np.flatnonzero(_mask_refined(initial_guess.camera, refinement))
        self._cached_camera, self._cached_rays = b"", np.empty((0, 3))
        self._rows_of_view = np.concatenate([np.repeat(self._corner_view, 2), self._line_view])

    @property
    def size(self) -> int:
        """Length of the parameter vector."""
        return len(self.free) + 6 * self._count

    def unpack_state(self, vector: FloatArray) -> BundleAdjustmentState:
        """Return the unknowns at a parameter vector."""
        camera, plane, bow = self._unpack_common_parameters(vector)
        rotations, translations = self._unpack_poses(vector)
        poses = tuple(Pose(R, t) for R, t in zip(rotations, translations, strict=True))
        return BundleAdjustmentState(camera, plane, poses, bow)

    def residuals_in_pixels(self, vector: FloatArray) -> tuple[Points, FloatArray]:
        """Return corner residuals (n, 2) and laser residuals (m,) of all views. Units: px."""
        camera, plane, bow = self._unpack_common_parameters(vector)
        rotations, translations = self._unpack_poses(vector)
        return (
            self._corner_residuals(camera, bow, rotations, translations),
            self._line_residuals(camera, plane, bow, rotations, translations),
        )

    def __call__(self, vector: FloatArray) -> FloatArray:
        """Return the whitened residuals, those of the priors last (0 for one without a prior)."""
        corner, line = self.residuals_in_pixels(vector)
        prior = vector[: len(self.free)] / _list_prior_stds(self.initial_guess.camera)[self.free]
        return np.concatenate([(corner / self._corner_std).ravel(), line / self._line_std, prior])

    def jacobian(self, vector: FloatArray) -> FloatArray:
        """Return the Jacobian by difference quotients.

        The poses share no residual: one evaluation serves the same component of all of them.
        """
        residuals = self(vector)
        jacobian = np.zeros((len(residuals), self.size))
        data = np.arange(len(self._rows_of_view))
        for component, step in enumerate(POSE_DIFFERENCE_STEPS):
            increment = np.zeros(self.size)
            increment[len(self.free) + component :: 6] = step
            columns = len(self.free) + 6 * self._rows_of_view + component
            jacobian[data, columns] = (self(vector + increment) - residuals)[: len(data)] / step
        for column, step in enumerate(DIFFERENCE_STEPS[self.free]):
            increment = np.zeros(self.size)
            increment[column] = step
            jacobian[:, column] = (self(vector + increment) - residuals) / step
        return jacobian

    def find_plane_columns(self) -> IntArray:
        """Return the indices of the plane's tilt about X, about Y, and distance."""
        return np.flatnonzero((self.free >= TILT.start) & (self.free <= DISTANCE))

    def find_bow_columns(self) -> IntArray:
        """Return the indices of the bow; empty where it is fixed."""
        return np.flatnonzero(self.free >= BOW.start)

    def split_corners(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Return values of the corners of all views as one array per view."""
        return tuple(values[self._corner_view == index] for index in range(self._count))

    def split_lines(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Return values of the line points of all views as one array per view."""
        return tuple(values[self._line_view == index] for index in range(self._count))

    def _unpack_common_parameters(self, vector: FloatArray) -> tuple[Camera, Plane, FloatArray]:
        """Return camera, laser plane and bow at a parameter vector."""
        change = np.zeros(len(DIFFERENCE_STEPS))
        change[self.free] = vector[: len(self.free)]
        initial_guess = self.initial_guess
        matrix = initial_guess.camera.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += change[FOCAL_AND_CENTRE]
        distortion = initial_guess.camera.distortion
        distortion = distortion + change[DISTORTION][: len(distortion)]
        camera = replace(initial_guess.camera, matrix=matrix, distortion=distortion)
        normal = initial_guess.plane.normal + change[TILT] @ self._axes
        # Plane scales normal and distance together; the distance here is that to a unit normal.
        normal = normal / np.linalg.norm(normal)
        return (
            camera,
            Plane(normal, initial_guess.plane.distance + change[DISTANCE]),
            initial_guess.bow + change[BOW],
        )

    def _unpack_poses(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (v, 3, 3) and translations (v, 3) of the boards."""
        from scipy.spatial.transform import Rotation

        change = vector[len(self.free) :].reshape(-1, 6)
        initial_rotations = np.array(
            [pose.rotation for pose in self.initial_guess.camera_from_boards]
        )
        initial_translations = np.array(
            [pose.translation for pose in self.initial_guess.camera_from_boards]
        )
        rotations = Rotation.from_rotvec(change[:, :3]).as_matrix() @ initial_rotations
        return rotations, initial_translations + change[:, 3:]

    def _corner_residuals(
        self, camera: Camera, bow: FloatArray, rotations: FloatArray, translations: FloatArray
    ) -> Points:
        """Return projected minus observed corners (n, 2). Units: px."""
        corners = self._shape.bend(self._corners, bow)
        view = self._corner_view
        in_camera = np.einsum("nij,nj->ni", rotations[view], corners) + translations[view]
        return camera.project(in_camera) - self._pixels

    def _line_residuals(
        self,
        camera: Camera,
        plane: Plane,
        bow: FloatArray,
        rotations: FloatArray,
        translations: FloatArray,
    ) -> FloatArray:
        """Return the distance (m,) in px of each line point from the line that plane and board cut.

        To first order: the height over the board of the point in which the pixel's ray meets the
        laser plane, divided by the gradient of this height by the pixel.
        """
        rays, view = self._compute_rays(camera), self._line_view
        ray_dot_normal = rays @ plane.normal
        laser_points = rays * (plane.distance / ray_dot_normal)[:, None]
        R = rotations[view]
        on_board = np.einsum("nij,ni->nj", R, laser_points - translations[view])
        height = on_board[:, 2] - self._shape.compute_heights(on_board[:, :2], bow)
        slopes = self._shape.compute_slopes(on_board[:, :2], bow)
        up = R[:, :, 2] - np.einsum("nij,nj->ni", R[:, :, :2], slopes)
        # A laser point is z m with the ray m and z = D / (n . m), D and n the plane's distance and
        # normal: d height / d m_j = z (up_j - (up . m) n_j / (n . m)).
        depth = plane.distance / ray_dot_normal
        up_ratio = np.einsum("ni,ni->n", up, rays) / ray_dot_normal
        gradient = depth[:, None] * (up[:, :2] - up_ratio[:, None] * plane.normal[:2])
        residuals: FloatArray = camera.focal_length * height / np.hypot(*gradient.T)
        return residuals

    def _compute_rays(self, camera: Camera) -> Points:
        """Return the rays of all line points, cached for the last camera: undistortion is slow."""
        key = camera.matrix.tobytes() + camera.distortion.tobytes()
        if key != self._cached_camera:
            self._cached_camera, self._cached_rays = key, camera.rays(self._line)
        return self._cached_rays


def build_tilt_axes(initial_guess: BundleAdjustmentState) -> FloatArray:
    """Return the changes (2, 3) of the plane's normal per rad of tilt about the section's X, Y."""
    x, y, z = LightSection(initial_guess.camera, initial_guess.plane).camera_from_section.rotation.T
    axes: FloatArray = np.stack([-y, x]) * np.sign(float(z @ initial_guess.plane.normal))
    return axes


def _mask_refined(camera: Camera, refinement: Refinement) -> BoolArray:
    """Return the mask of the parameters that are refined."""
    free = np.zeros(len(DIFFERENCE_STEPS), dtype=bool)
    if refinement.camera:
        free[FOCAL_AND_CENTRE] = True
        # k1, k2, p1, p2 if the camera has them; k3 and beyond if its calibration used them.
        coefficients = camera.distortion != 0
        coefficients[:4] = True
        free[DISTORTION][: len(coefficients)] = coefficients
    free[TILT] = free[DISTANCE] = True
    free[BOW] = refinement.bow
    return free


def _list_prior_stds(camera: Camera) -> FloatArray:
    """Return the standard deviation of the prior on each shared parameter; infinite: no prior."""
    focal = camera.focal_length
    return np.concatenate(
        [
            np.full(2, FOCAL_PRIOR * focal),
            np.full(2, CENTRE_PRIOR * focal),
            np.full(COEFFICIENTS, DISTORTION_PRIOR),
            np.full(3, np.inf),
            np.full(SHAPE_TERMS, BOW_PRIOR),
        ]
    )


def _concatenate_views(arrays: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return the concatenated arrays of the views, and the view index of each row."""
    counts = [len(array) for array in arrays]
    return np.concatenate(arrays), np.repeat(np.arange(len(arrays)), counts)
