"""Boards that a camera on a robot sees: poses, uncertainty, photos and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.cli.calibrate_inputs import read_images, replace_image_numbers
from lsvision.files.printable import printable

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.observations import Mounting
    from lsvision.calibration.target import Target, TargetView
    from lsvision.geometry import FloatArray, Points, Pose
    from lsvision.sensors.camera import Camera


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Photos and corners of each pose for the report, and warnings.

    Parameters
    ----------
    warnings : sequence of str
        Warnings about the target.
    images : sequence of images
        A photo of each pose; empty for profiles.
    corners : sequence of ((n, 2) ndarray, (n, 2) ndarray)
        In each photo, the corners found, and predicted minus found. Units: px.
    """

    warnings: "Sequence[str]" = ()
    images: Sequence[Any] = ()
    corners: "Sequence[tuple[Points, FloatArray]]" = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenBoards:
    """One board in the image of each pose.

    Parameters
    ----------
    camera : Camera
        Calibrated.
    images : sequence of images
        As read.
    views : sequence of TargetView
        Corners in each.
    poses : sequence of Pose
        ``camera_from_board``.
    covariances : (n, 6, 6) ndarray
        Of the poses; see `estimate_board_pose`.
    camera_modes : (m, n, 6) ndarray, optional
        Where the file of the camera has its covariance; see `board_pose_modes`.
    warnings : tuple of str
        Corners that were left out, and turned views.
    """

    camera: "Camera"
    images: Sequence[Any]
    views: "Sequence[TargetView]"
    poses: "Sequence[Pose]"
    covariances: "FloatArray"
    camera_modes: "FloatArray | None"
    warnings: tuple[str, ...]

    def numbered_from_one_end(
        self, target: "Target", flanges: "Sequence[Pose]", mounting: "Mounting"
    ) -> "SeenBoards":
        """Return the boards numbered from the same end, which the robot's poses determine.

        Raises
        ------
        CalibrationFailed
            If the poses do not determine it.
        """
        from lsvision.calibration.board_turns import pattern_turns, turn_boards

        turns = pattern_turns(target)
        if not turns:
            return self
        carriers = [pose if mounting == "eye_in_hand" else pose.inverse() for pose in flanges]
        turned = turn_boards(self.poses, carriers, turns)
        back = [pose.inverse() @ old for pose, old in zip(turned.poses, self.poses, strict=True)]
        return replace(
            self,
            views=[
                replace(view, points=turn.apply(view.points))
                for view, turn in zip(self.views, back, strict=True)
            ],
            poses=turned.poses,
            covariances=turned.covariances(self.covariances),
            camera_modes=None if self.camera_modes is None else turned.shifts(self.camera_modes),
            warnings=(*self.warnings, turned.warning),
        )

    def evidence(
        self, found: "HandEye", flanges: "Sequence[Pose]", names: Sequence[str]
    ) -> Evidence:
        """Return photos, corners and warnings; corners are predicted from the robot's poses."""
        from lsvision.geometry import Pose

        assert isinstance(found.target, Pose)
        in_hand = found.mounting == "eye_in_hand"
        corners = []
        for view, flange in zip(self.views, flanges, strict=True):
            carrier = flange if in_hand else flange.inverse()
            board = (carrier @ found.mount_from_sensor).inverse() @ found.target
            predicted = self.camera.project(board.apply(view.points))
            corners.append((view.pixels, predicted - view.pixels))
        warnings = [replace_image_numbers(text, image=names, pose=names) for text in self.warnings]
        return Evidence(warnings=warnings, images=self.images, corners=corners)


def see_boards(files: Sequence[Path], target: "Target", camera_file: Path) -> SeenBoards:
    """Find the board in each image.

    Raises
    ------
    LsvisionError
        If an image does not show the board; names it.
    """
    from lsvision.calibration.board_pose import estimate_board_pose
    from lsvision.calibration.camera_uncertainty import board_pose_modes
    from lsvision.calibration.target import find_target, left_out_warnings
    from lsvision.calibration.views import require_size
    from lsvision.errors import LsvisionError
    from lsvision.io.camera_file import read_camera, read_camera_covariance

    camera, camera_covariance = read_camera(camera_file), read_camera_covariance(camera_file)
    poses, covariances, views, images = [], [], [], read_images(files)
    for file, image in zip(files, images, strict=True):
        require_size(camera, image, printable(str(file)))
        try:
            seen = find_target(image, target)
            estimate = estimate_board_pose(seen.pixels, seen.points, camera)
        except LsvisionError as error:
            raise LsvisionError(f"{file}: {error}; or leave out this image and its pose") from error
        poses.append(estimate.camera_from_board)
        covariances.append(estimate.covariance)
        views.append(seen)
    modes = None
    if camera_covariance is not None:
        modes = board_pose_modes(views, camera, camera_covariance)
    return SeenBoards(
        camera=camera,
        images=images,
        views=views,
        poses=poses,
        covariances=np.array(covariances),
        camera_modes=modes,
        warnings=tuple(left_out_warnings(target, views, range(len(views)))),
    )
