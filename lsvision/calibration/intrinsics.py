"""Intrinsics of a camera from images of a flat target, with warnings about insufficient data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration import result_tables
from lsvision.calibration.bent_board import BentBoardFit, fit_bent_board
from lsvision.calibration.board_shape import (
    SHAPE_TERMS,
    BoardShape,
    is_shape_determined,
    list_bow_warnings,
)
from lsvision.calibration.camera_uncertainty import intrinsics_covariance
from lsvision.calibration.camera_warnings import check_camera
from lsvision.calibration.target import (
    Target,
    TargetView,
    find_target,
    list_left_out_warnings,
)
from lsvision.calibration.views import (
    RejectedView,
    ViewSources,
    collect_views,
    find_outlier_views,
    require_tilted,
    require_views,
    rms_distance,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Pose
from lsvision.geometry.equality import ComparedByValue
from lsvision.laser_line.image_array import as_image
from lsvision.results.quantities import Record
from lsvision.results.result import Result
from lsvision.sensors.camera import Camera

MIN_VIEWS = 3
"""Smallest number of views: two determine fx, fy, cx and cy without a check (Zhang 2000, 3.1)."""
MIN_BOW_VIEWS = 6
"""Smallest number of views from which the shape of the board is estimated."""
OUTLIER_FACTOR = 2.5
"""Smallest ratio of an outlier view's rms residual to the median."""

PARAMETER_NAMES = (
    *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    *("k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
)
"""Parameters of the camera in OpenCV's order."""


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """Parameters of the camera model that are estimated; the default suffices for most lenses.

    Parameters
    ----------
    radial_terms : int
        Number of radial coefficients k1, k2, k3 that are estimated (0 to 3); the others are 0.
    tangential : bool
        Whether p1 and p2 are estimated.
    fixed_aspect : bool
        Whether fx = fy.
    tilted : bool
        Whether tau_x and tau_y are estimated, for a sensor tilted behind the lens (Scheimpflug).
        With `tangential`, whose effect is similar, stds are up to 1.5 times too small.
    bent_board : bool
        Whether bow and twist of the board are estimated, too, if there are at least six views, and
        three rows and columns of corners.
    """

    radial_terms: int = 2
    tangential: bool = True
    fixed_aspect: bool = False
    tilted: bool = False
    bent_board: bool = True

    def __post_init__(self) -> None:
        terms = self.radial_terms
        if not (isinstance(terms, int | np.integer) and 0 <= terms <= 3):
            raise ValueError(f"expected 0 to 3 radial_terms, a whole number, got {terms}")

    @property
    def flags(self) -> int:
        """OpenCV's ``CALIB_`` flags of these settings."""
        fixed = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)[self.radial_terms :]
        flags = int(sum(fixed))
        flags |= 0 if self.tangential else cv2.CALIB_ZERO_TANGENT_DIST
        flags |= cv2.CALIB_FIX_ASPECT_RATIO if self.fixed_aspect else 0
        # With this flag only the tilt is estimated in addition: k4 to k6 and s1 to s4 stay 0.
        flags |= cv2.CALIB_TILTED_MODEL if self.tilted else 0
        return flags


@dataclass(frozen=True, eq=False)
class CalibratedView(ComparedByValue):
    """View with the pose and the residuals of its board after the calibration.

    Parameters
    ----------
    index : int
        Index of the image.
    target_view : TargetView
        Points of the target in the image.
    camera_from_board : Pose
        Pose of the board.
    residuals : (n, 2) ndarray
        Residuals of the points, projected minus observed. Units: px.
    """

    index: int
    target_view: TargetView
    camera_from_board: Pose
    residuals: FloatArray

    @property
    def rms_px(self) -> float:
        """Root mean square distance of projected and observed points. Units: px."""
        return rms_distance(self.residuals)


@dataclass(frozen=True, eq=False, repr=False)
class CameraCalibration(Result):
    """Calibrated camera with standard deviations, residuals and warnings.

    Parameters
    ----------
    camera : Camera
        Calibrated camera.
    std : mapping of str to float
        Standard deviation of fx, fy, cx, cy (px) and each coefficient; 0 for fixed ones.
    views : tuple of CalibratedView
        Views that were used.
    rejected : tuple of RejectedView
        Images without the target, and repeated ones.
    outliers : tuple of RejectedView
        Views that were used and have large residuals: check them, leave them out, calibrate again.
    warnings : tuple of str
        Warnings about the set of views, with remedies.
    covariance : (4 + k, 4 + k) ndarray, optional
        Covariance of fx, fy, cx, cy (px) and the k coefficients; zero for fixed ones.
    board_bow, board_bow_std : (3,) ndarray
        Deviation of the board's middle from flatness along x and along y, positive away from
        the camera, and its twist at the corners; zero if not estimated (see
        `CameraSettings.bent_board`). Units: mm.
    """

    camera: Camera
    std: Mapping[str, float]
    views: tuple[CalibratedView, ...]
    rejected: tuple[RejectedView, ...]
    outliers: tuple[RejectedView, ...]
    warnings: tuple[str, ...]
    covariance: FloatArray | None = None
    board_bow: FloatArray = field(default_factory=lambda: np.zeros(SHAPE_TERMS))
    board_bow_std: FloatArray = field(default_factory=lambda: np.zeros(SHAPE_TERMS))

    @property
    def rms_px(self) -> float:
        """Root mean square distance over all points, as in OpenCV. Units: px."""
        return rms_distance(np.concatenate([view.residuals for view in self.views]))

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of fx, fy, cx, cy (px) and the distortion coefficients."""
        matrix = self.camera.matrix
        values = [*matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), *self.camera.distortion.tolist()]
        pairs = zip(values, self.std.items(), strict=True)
        return {name: (value, std) for value, (name, std) in pairs}

    def to_dict(self) -> Record:
        """Return the intrinsics with one sigma each, ready for JSON.

        Returns
        -------
        dict
            ``fx_px``, ``fx_std_px`` and so on (coefficients of distortion have no unit, tau_x and
            tau_y are in rad), ``rms_px``, ``board_bow_mm`` and its std, number of views, rejected
            views, outliers and warnings.
        """
        record: Record = {}
        for name, (value, std) in self.parameters.items():
            unit = "_px" if name in ("fx", "fy", "cx", "cy") else ""
            record |= {f"{name}{unit}": value, f"{name}_std{unit}": std}
        return record | {"rms_px": self.rms_px, **result_tables.build_common_record(self)}

    def _summarise(self) -> str:
        width, height = self.camera.size
        return f"{width} x {height} px from {len(self.views)} views, rms {self.rms_px:.3f} px"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return result_tables.cells_from_rows(result_tables.format_camera_rows(self))

    def _list_notes(self) -> list[str]:
        return result_tables.format_rejections(self.rejected, self.outliers, self.warnings)


def calibrate_camera(
    images: Sequence[npt.ArrayLike], target: Target, settings: CameraSettings | None = None
) -> CameraCalibration:
    """Calibrate a camera from images of a flat target.

    Parameters
    ----------
    images : sequence of images
        Images of 8 or 16 bit, grey or colour, all of one size; best 15 to 20, the target tilted by
        25 deg and more to all sides and reaching into every corner of the image.
    target : Target
        Board in the images.
    settings : CameraSettings, optional
        Parameters of the camera model.

    Returns
    -------
    CameraCalibration
        Camera with standard deviations, residuals of each view, and warnings.

    Raises
    ------
    TypeError, ValueError
        If an item is not an image.
    CalibrationFailed
        If the images differ in size, fewer than three show the target, or no camera explains them.
    DegenerateGeometry
        If all boards are parallel.

    Examples
    --------
    >>> from lsvision.io.images import read_image
    >>> from lsvision.calibration.target import ChArUco
    >>> files = [f"calibration/example/boards/board_{k:02d}.jpg" for k in (0, 3, 6, 9, 12)]
    >>> calibration = calibrate_camera([read_image(file) for file in files], ChArUco())
    >>> len(calibration.views), calibration.rms_px < 0.5
    (5, True)
    """
    shapes = [as_image(image, f"image {k}").shape for k, image in enumerate(images)]
    _require_equal_sizes([(shape[1], shape[0]) for shape in shapes], range(len(shapes)))
    views, sources = collect_views(
        images, lambda image: find_target(image, target), lambda view: view.pixels.tobytes()
    )
    calibration = fit_camera(views, settings, sources)
    left_out = list_left_out_warnings(target, views, sources.list_image_indices(len(views)))
    return replace(calibration, warnings=(*calibration.warnings, *left_out))


def fit_camera(
    views: Sequence[TargetView],
    settings: CameraSettings | None = None,
    sources: ViewSources | None = None,
) -> CameraCalibration:
    """Return a camera calibrated from the points of at least three views of one image size.

    `sources` are the images of the views and the rejected ones; see `calibrate_camera`.
    """
    sources = sources or ViewSources()
    require_views(len(views), MIN_VIEWS, "the target", "add images of the board", sources)
    _require_equal_sizes([view.size for view in views], sources.list_image_indices(len(views)))
    settings = settings or CameraSettings()
    solution, std = _solve(views, settings)
    camera, poses, indices = solution.camera, solution.poses, sources.list_image_indices(len(views))
    bent = [solution.shape.bend(view.points, solution.bow) for view in views]
    calibrated_views = tuple(
        CalibratedView(index, view, pose, camera.project(pose.apply(points)) - view.pixels)
        for index, view, pose, points in zip(indices, views, poses, bent, strict=True)
    )
    outliers = find_outlier_views(
        indices,
        [view.rms_px for view in calibrated_views],
        OUTLIER_FACTOR,
        remedy="blurred, moved, or wrong points; leave it out and calibrate again",
    )
    return CameraCalibration(
        camera,
        MappingProxyType(dict(zip(PARAMETER_NAMES, std.tolist(), strict=False))),
        calibrated_views,
        sources.rejected,
        tuple(outliers),
        (
            *check_camera(camera, std, views, poses),
            *list_bow_warnings(solution.bow, solution.bow_std),
        ),
        solution.covariance,
        solution.bow,
        solution.bow_std,
    )


def _solve(
    views: Sequence[TargetView], settings: CameraSettings
) -> tuple[BentBoardFit, FloatArray]:
    """Return camera, poses and board by least squares, and the standard deviations (4 + k,).

    The board is flat if its shape is not estimated.
    """
    matrix, distortion, std, poses = _solve_flat(views, settings)
    require_tilted(poses, "the focal length")
    corners = np.concatenate([view.points for view in views])
    camera, free = Camera(matrix, distortion, views[0].size), std > 0
    free[0] &= not settings.fixed_aspect  # which makes fx a multiple of fy
    if not settings.bent_board or len(views) < MIN_BOW_VIEWS or not is_shape_determined(corners):
        covariance, flat = intrinsics_covariance(camera, views, poses, free), np.zeros(SHAPE_TERMS)
        return BentBoardFit(camera, poses, covariance, BoardShape.of(corners), flat, flat), std
    bent = fit_bent_board(camera, views, poses, free)
    return bent, np.sqrt(bent.covariance.diagonal())


@contextmanager
def _limit_opencv_to_one_thread() -> Iterator[None]:
    """Limit OpenCV to one thread: with more, the last digits of its sums differ between runs."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _solve_from_initial_guesses(views: Sequence[TargetView], flags: int) -> list[Any]:
    """Return OpenCV's solutions from its own initial guess and a linear one, if they are finite.

    From its own initial guess OpenCV 5 sometimes converges to a wrong minimum.
    """
    points = [np.ascontiguousarray(view.points, dtype=np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    size = views[0].size
    solutions = []
    for guess_flag in (0, cv2.CALIB_USE_INTRINSIC_GUESS):
        try:
            # Without the flag OpenCV uses only the ratio of fx and fy.
            guess = cv2.initCameraMatrix2D(points, pixels, size, 1.0) if guess_flag else np.eye(3)
            with _limit_opencv_to_one_thread():
                solution = cv2.calibrateCameraExtended(
                    points, pixels, size, guess, None, flags=flags | guess_flag
                )
        except cv2.error:
            continue
        if np.isfinite(solution[0]) and np.isfinite(solution[1]).all():
            solutions.append(solution)
    return solutions


def _solve_flat(
    views: Sequence[TargetView], settings: CameraSettings
) -> tuple[FloatArray, FloatArray, FloatArray, list[Pose]]:
    """Return camera matrix, distortion, standard deviations and poses, with a flat board.

    The standard deviations (4 + k,) are those of fx, fy, cx, cy and the k coefficients; 0 for those
    that are not estimated.
    """
    solutions = _solve_from_initial_guesses(views, settings.flags)
    if not solutions:
        raise CalibrationFailed(
            f"{len(views)} views are not consistent with one camera: check the target's counts and "
            "size, and that all images come from one camera"
        )
    _, matrix, distortion, rotation_vectors, translations, std, _, _ = min(
        solutions, key=lambda solution: solution[0]
    )
    poses = [
        Pose(cv2.Rodrigues(vector)[0], np.reshape(translation, 3))
        for vector, translation in zip(rotation_vectors, translations, strict=True)
    ]
    coefficients = 14 if settings.tilted else 5
    std = np.reshape(std, -1)[: 4 + coefficients].copy()
    if settings.fixed_aspect:
        std[0] = std[1]  # OpenCV derives fx from fy and returns 0 for its standard deviation
    return matrix, np.reshape(distortion, -1)[:coefficients], std, poses


def _require_equal_sizes(sizes: Sequence[tuple[int, int]], indices: Sequence[int]) -> None:
    """Require images of one size; `sizes` are (width, height) in px, `indices` for the message."""
    for index, (width, height) in zip(indices, sizes, strict=True):
        if (width, height) != sizes[0]:
            raise CalibrationFailed(
                f"image {index} is {width} x {height} px and image {indices[0]} {sizes[0][0]} x "
                f"{sizes[0][1]} px: calibrate one camera at one size, with images neither cropped "
                "nor scaled"
            )
