"""A camera's intrinsics from images of a flat target, with what speaks against them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.calibration.intrinsics_check import check_camera
from lsvision.calibration.target import Target, TargetView, find_target
from lsvision.calibration.views import (
    RejectedView,
    ViewSources,
    collect_views,
    outlier_views,
    require_tilted,
    require_views,
)
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, Pose
from lsvision.sensors.camera import Camera

MIN_VIEWS = 3
"""Two views leave a full camera matrix undetermined (Zhang 2000, section 3.1)."""

OUTLIER_FACTOR = 2.5
"""A view counts as outlier from this multiple of the median view's residual on."""

NAMES = (
    *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    *("k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
)
"""The camera's parameters in OpenCV's order."""


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """The camera's model; the default has as few freedoms as most lenses need.

    Parameters
    ----------
    radial_terms : int
        0 to 3: how many of k1, k2, k3 are free; the others are 0.
    tangential : bool
        Whether p1 and p2 are free.
    fixed_aspect : bool
        Whether fx = fy.
    tilted : bool
        Whether the sensor stands tilted behind the lens (Scheimpflug): tau_x and tau_y free.
        Only where the hardware is.
    """

    radial_terms: int = 2
    tangential: bool = True
    fixed_aspect: bool = False
    tilted: bool = False

    def __post_init__(self) -> None:
        if self.radial_terms not in (0, 1, 2, 3):
            raise ValueError(f"want 0 to 3 radial_terms, got {self.radial_terms}")

    @property
    def flags(self) -> int:
        """The same as OpenCV's ``CALIB_`` flags."""
        fixed = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)[self.radial_terms :]
        flags = int(sum(fixed))
        flags |= 0 if self.tangential else cv2.CALIB_ZERO_TANGENT_DIST
        flags |= cv2.CALIB_FIX_ASPECT_RATIO if self.fixed_aspect else 0
        # The flag also frees nothing but the tilt: k4 to k6 and s1 to s4 stay 0.
        flags |= cv2.CALIB_TILTED_MODEL if self.tilted else 0
        return flags


@dataclass(frozen=True, eq=False)
class CalibratedView:
    """One view after the calibration.

    Parameters
    ----------
    index : int
        Which of the images.
    seen : TargetView
        What it shows.
    camera_from_board : Pose
        Where the board stood.
    residuals : (n, 2) ndarray
        Projected minus seen. Units: px.
    """

    index: int
    seen: TargetView
    camera_from_board: Pose
    residuals: FloatArray

    @property
    def rms_px(self) -> float:
        """Root mean square of the points' distances. Units: px."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A camera with its evidence.

    Parameters
    ----------
    camera : Camera
        The result.
    std : mapping of str to float
        One sigma of fx, fy, cx, cy (px) and each coefficient; 0 where held.
    views : tuple of CalibratedView
        Each view used.
    rejected : tuple of RejectedView
        Images without the target.
    outliers : tuple of RejectedView
        Views that were used and fit badly: look at them, leave them out, calibrate anew.
    warnings : tuple of str
        What makes the set weak.
    """

    camera: Camera
    std: Mapping[str, float]
    views: tuple[CalibratedView, ...]
    rejected: tuple[RejectedView, ...]
    outliers: tuple[RejectedView, ...]
    warnings: tuple[str, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square of all points' distances, as OpenCV counts. Units: px."""
        residuals = np.concatenate([view.residuals for view in self.views])
        return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def calibrate_camera(
    images: Sequence[npt.ArrayLike], target: Target, settings: CameraSettings | None = None
) -> CameraCalibration:
    """Calibrate a camera from images of a flat target.

    Parameters
    ----------
    images : sequence of images
        8 or 16 bit, grey or colour, all of one size; best 15 to 20, the target tilted by
        25 deg and more to all sides and reaching into every corner of the image.
    target : Target
        The board.
    settings : CameraSettings, optional
        The camera's model.

    Returns
    -------
    CameraCalibration
        The camera with standard deviations, residuals of each view, and warnings.

    Raises
    ------
    CalibrationFailed
        If the images differ in size, or fewer than three show the target.
    DegenerateGeometry
        If all boards are parallel.
    """
    _check_sizes(images)
    seen, sources = collect_views(images, lambda image: find_target(image, target))
    return fit_camera(seen, settings, sources)


def fit_camera(
    seen: Sequence[TargetView],
    settings: CameraSettings | None = None,
    sources: ViewSources | None = None,
) -> CameraCalibration:
    """Calibrate a camera from points already found.

    Parameters
    ----------
    seen : sequence of TargetView
        Three at least, all of one image size.
    settings : CameraSettings, optional
        The camera's model.
    sources : ViewSources, optional
        Which images they come from.

    Returns
    -------
    CameraCalibration
        See `calibrate_camera`, also for the errors.
    """
    sources = sources or ViewSources()
    require_views(len(seen), MIN_VIEWS, "the target", "add images of the board", sources)
    matrix, distortion, std, poses = _solve(seen, settings or CameraSettings())
    camera = Camera(matrix, distortion, seen[0].size)
    require_tilted(poses, "the focal length")
    views = tuple(
        CalibratedView(index, view, pose, camera.project(pose.apply(view.points)) - view.pixels)
        for index, view, pose in zip(sources.names(len(seen)), seen, poses, strict=True)
    )
    outliers = outlier_views(
        [view.index for view in views],
        [view.rms_px for view in views],
        OUTLIER_FACTOR,
        ("", "blurred, moved, or points taken wrongly; leave it out and calibrate anew"),
    )
    return CameraCalibration(
        camera,
        MappingProxyType(dict(zip(NAMES, std.tolist(), strict=False))),
        views,
        sources.rejected,
        tuple(outliers),
        check_camera(camera, std, seen, poses),
    )


def _solve(
    seen: Sequence[TargetView], settings: CameraSettings
) -> tuple[FloatArray, FloatArray, FloatArray, list[Pose]]:
    """Camera matrix, distortion, standard deviations and poses of least squares."""
    points = [np.ascontiguousarray(view.points, dtype=np.float32) for view in seen]
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in seen]
    guess = cv2.initCameraMatrix2D(points, pixels, seen[0].size, 1.0)
    # OpenCV 5 has been seen to stop in a bad minimum without a guess: try both, keep the better.
    starts: list[tuple[Any, int]] = [(np.eye(3), 0), (guess, cv2.CALIB_USE_INTRINSIC_GUESS)]
    solutions = []
    for start, extra in starts:
        try:
            solution = cv2.calibrateCameraExtended(
                points, pixels, seen[0].size, start.copy(), None, flags=settings.flags | extra
            )
        except cv2.error:
            continue
        if np.isfinite(solution[0]) and np.isfinite(solution[1]).all():
            solutions.append(solution)
    if not solutions:
        raise CalibrationFailed(
            f"{len(seen)} views have no camera in common: check the target's counts and size, "
            "and that all images come from one camera"
        )
    _, matrix, distortion, turns, shifts, std, _, _ = min(solutions, key=lambda found: found[0])
    poses = [
        Pose(cv2.Rodrigues(turn)[0], np.reshape(shift, 3))
        for turn, shift in zip(turns, shifts, strict=True)
    ]
    used = 14 if settings.tilted else 5
    std = np.reshape(std, -1)[: 4 + used].copy()
    if settings.fixed_aspect:
        std[0] = std[1]  # OpenCV derives fx from fy and leaves its deviation at 0
    return matrix, np.reshape(distortion, -1)[:used], std, poses


def _check_sizes(images: Sequence[npt.ArrayLike]) -> None:
    sizes = [np.asarray(image).shape[1::-1] for image in images]
    for index, size in enumerate(sizes):
        if size != sizes[0]:
            raise CalibrationFailed(
                f"image {index} is {size} px and image 0 {sizes[0]} px: calibrate one camera at "
                "one size, with images neither cropped nor scaled"
            )
