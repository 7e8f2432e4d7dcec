"""Camera and laser plane (a `LightSection`) from one image of a board in the laser plane.

For simple rigs: the board is moved into the plane until the laser light grazes its whole face. The
camera need not be calibrated; the result is valid within the laser plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lsvision.calibration.board_pose import (
    DEFAULT_FOCAL_RATIO,
    estimate_board_pose,
    guess_board_pose,
)
from lsvision.calibration.target import Target, TargetView, find_target, fit_board_homography
from lsvision.calibration.views import require_size, rms_distance
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.results.quantities import Record, convert_numbers_to_json
from lsvision.results.result import Result
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection

MAX_FOCAL_LENGTH_FACTOR = 4.0
"""Factor by which an estimated focal length differs from the default one at most; beyond it, as for
a board parallel to the image, it is taken as not determined."""


@dataclass(frozen=True, eq=False, repr=False)
class BoardInPlane(Result):
    """Camera and laser plane from one board, with residuals.

    Parameters
    ----------
    light_section : LightSection
        Calibrated light section.
    residuals : (n, 2) ndarray
        Residuals of the board's points, projected minus observed. Units: px.
    """

    light_section: LightSection
    residuals: FloatArray

    @property
    def rms_px(self) -> float:
        """Root mean square distance of projected and observed points. Units: px."""
        return rms_distance(self.residuals)

    def to_dict(self) -> Record:
        """Return the plane, and the rms and number of the residuals, ready for JSON.

        Returns
        -------
        dict
            Camera frame; lengths in ``*_mm``, the rms in ``*_px``.
        """
        plane = self.light_section.laser_plane
        return {
            "normal": convert_numbers_to_json(plane.normal),
            "distance_mm": plane.distance,
            "rms_px": self.rms_px,
            "points": len(self.residuals),
        }

    def _summarise(self) -> str:
        return f"{len(self.residuals)} points of the board, rms {self.rms_px:.3f} px"

    def _list_cells(self) -> list[tuple[str, ...]]:
        """Return the header and one row of the printed table."""
        plane = self.light_section.laser_plane
        normal = ", ".join(f"{value:.4f}" for value in plane.normal)
        row = (
            f"({normal})",
            f"{plane.distance:.3f}",
            f"{self.rms_px:.3f}",
            str(len(self.residuals)),
        )
        return [("normal, camera frame", "distance mm", "rms px", "points"), row]


def calibrate_board_in_plane(
    image: npt.ArrayLike, target: Target, camera: Camera | None = None
) -> BoardInPlane:
    """Calibrate a `LightSection` from one image of a board whose face lies in the laser plane.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Image of the board, which covers the part of the plane that is to be measured.
    target : Target
        Board whose face lies in the laser plane.
    camera : Camera, optional
        Calibrated camera. If None, the result contains a pinhole camera with the homography of the
        board: points in the laser plane are correct, apart from lens distortion, but the pose of
        the camera is a guess.

    Returns
    -------
    BoardInPlane
        Light section, and residuals of the board's points.

    Raises
    ------
    TargetNotFound
        If the board is not found.
    CalibrationFailed
        If the image is not of the camera's size.
    DegenerateGeometry
        If the camera looks along the plane.

    Examples
    --------
    >>> from lsvision.calibration.target import ChArUco
    >>> from lsvision.io.images import read_image
    >>> image = read_image("calibration/example/boards/board_03.jpg")
    >>> calibration = calibrate_board_in_plane(image, ChArUco())
    >>> calibration.rms_px < 1.0
    True
    """
    if camera is not None:
        require_size(camera, image, "image")
    view = find_target(image, target)
    if camera is None:
        camera, pose = _solve_equivalent_pinhole_camera(view)
        method = (
            "board in the laser plane; camera unknown, replaced by an equivalent pinhole camera"
        )
    else:
        pose = estimate_board_pose(view.pixels, view.points, camera).camera_from_board
        method = "board in the laser plane; camera given"
    normal = pose.rotation[:, 2]
    plane = Plane(normal, float(normal @ pose.translation))
    residuals = camera.project(pose.apply(view.points)) - view.pixels
    return BoardInPlane(LightSection(camera, plane, {"method": method}), residuals)


def _solve_equivalent_pinhole_camera(view: TargetView) -> tuple[Camera, Pose]:
    """Return a pinhole camera and ``camera_from_board`` that reproduce the board's homography.

    For any centre of the camera outside of the board's plane there are K and R that reproduce the
    homography exactly. The centre is that of a camera with square pixels whose axis meets the
    image's middle; K may still have a skew and another principal point.
    """
    homography = fit_board_homography(view)
    centre = _compute_camera_centre(homography, view)
    a, b, h = centre
    if not abs(h) > 1e-6:
        raise DegenerateGeometry(
            "the camera looks along the board in the laser plane: look at it at an angle"
        )
    # A board point (X, Y, 0), seen along d = (X, Y, 0) - centre, has (X, Y, 1) = B d. Hence its
    # pixel ~ H (X, Y, 1) = H B d, and H B ~ K R.
    B = np.array([[1, 0, -a / h], [0, 1, -b / h], [0, 0, -1 / h]])
    K, R = _decompose_rq(homography @ B)
    return Camera(K, np.empty(0), view.size), Pose(R, -R @ centre)


def _compute_camera_centre(homography: FloatArray, view: TargetView) -> FloatArray:
    """Return the centre (3,) of a camera with square pixels whose axis meets the image's middle.

    Board frame. Units: mm.
    """
    width, height = view.size
    centred_from_pixels = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, 1]])
    H = centred_from_pixels @ homography
    (a1, b1, c1), (a2, b2, c2) = H[:, 0] / H[2, 2], H[:, 1] / H[2, 2]
    # Zhang 2000, Eqs. (3) and (4), linear in 1 / f^2.
    A = np.array([a1 * a2 + b1 * b2, a1**2 + b1**2 - a2**2 - b2**2])
    C = np.array([c1 * c2, c1**2 - c2**2])
    inverse_square = -float(A @ C) / max(float(A @ A), 1e-300)
    focal = DEFAULT_FOCAL_RATIO * width
    estimate = inverse_square**-0.5 if inverse_square > 0 else math.inf
    if 1 / MAX_FOCAL_LENGTH_FACTOR < estimate / focal < MAX_FOCAL_LENGTH_FACTOR:
        focal = estimate
    normalised = (view.pixels - (np.array([width, height]) - 1) / 2) / focal
    pose = guess_board_pose(view, np.column_stack([normalised, np.ones(len(normalised))]))
    return pose.inverse().translation


def _decompose_rq(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return K and R of the RQ decomposition, K with positive diagonal and K[2, 2] = 1."""
    from scipy.linalg import rq

    K, R = rq(matrix * np.sign(np.linalg.det(matrix)))
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    return K / K[2, 2], R
