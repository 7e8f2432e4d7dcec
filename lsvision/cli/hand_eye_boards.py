"""Boards detected by a camera on a robot: poses, uncertainty, photos and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.cli.calibrate_inputs import read_images, replace_image_numbers
from lsvision.files.printable import printable
from lsvision.results.summaries import counted

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.observations import Mounting
    from lsvision.calibration.target import Target, TargetView
    from lsvision.geometry import FloatArray, Points, Pose
    from lsvision.sensors.camera import Camera

MIN_BOARDS = 4
"""Smallest number of images that show the board."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Photos and corners of each pose for the report, and warnings.

    Parameters
    ----------
    warnings : sequence of str
        Warnings about the target.
    images : sequence of images
        Photo of each pose; empty for profiles.
    corners : sequence of ((n, 2) ndarray, (n, 2) ndarray)
        Corners found in each photo, and residuals (predicted minus found). Units: px.
    """

    warnings: "Sequence[str]" = ()
    images: Sequence[Any] = ()
    corners: "Sequence[tuple[Points, FloatArray]]" = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectedBoards:
    """Boards in those images in which one was found.

    Parameters
    ----------
    indices : list of int
        Indices of the images in which the board was found; all other fields are of these.
    camera : Camera
        Calibrated camera.
    images : sequence of images
        Images with a board.
    views : sequence of TargetView
        Corners in each image.
    poses : sequence of Pose
        ``camera_from_board`` of each image.
    covariances : (n, 6, 6) ndarray
        Covariances of the poses; see `estimate_board_pose`.
    camera_modes : (m, n, 6) ndarray, optional
        Shifts by errors of the camera, if its file has a covariance; see `board_pose_modes`.
    warnings : tuple of str
        Warnings about images and corners that were left out, and about turned views.
    """

    indices: list[int]
    camera: "Camera"
    images: Sequence[Any]
    views: "Sequence[TargetView]"
    poses: "Sequence[Pose]"
    covariances: "FloatArray"
    camera_modes: "FloatArray | None"
    warnings: tuple[str, ...]

    def number_from_one_end(
        self, target: "Target", flanges: "Sequence[Pose]", mounting: "Mounting"
    ) -> "DetectedBoards":
        """Return the boards numbered from the same end, according to the robot's poses.

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
        turn_poses = [
            pose.inverse() @ original
            for pose, original in zip(turned.poses, self.poses, strict=True)
        ]
        return replace(
            self,
            views=[
                replace(view, points=turn.apply(view.points))
                for view, turn in zip(self.views, turn_poses, strict=True)
            ],
            poses=turned.poses,
            covariances=turned.covariances(self.covariances),
            camera_modes=None if self.camera_modes is None else turned.shifts(self.camera_modes),
            warnings=(*self.warnings, turned.warning),
        )

    def build_evidence(
        self, calibration: "HandEye", flanges: "Sequence[Pose]", names: Sequence[str]
    ) -> Evidence:
        """Return photos, corners and warnings; corners are predicted from the robot's poses."""
        from lsvision.geometry import Pose

        assert isinstance(calibration.target, Pose)
        in_hand = calibration.mounting == "eye_in_hand"
        corners = []
        for view, flange in zip(self.views, flanges, strict=True):
            carrier = flange if in_hand else flange.inverse()
            board = (carrier @ calibration.mount_from_sensor).inverse() @ calibration.target
            predicted = self.camera.project(board.apply(view.points))
            corners.append((view.pixels, predicted - view.pixels))
        warnings = [replace_image_numbers(text, image=names, pose=names) for text in self.warnings]
        return Evidence(warnings=warnings, images=self.images, corners=corners)


def find_boards(files: Sequence[Path], target: "Target", camera_file: Path) -> DetectedBoards:
    """Return the board in each image; an image without it is left out, with its pose.

    Raises
    ------
    LsvisionError
        If fewer than 4 images show the board, with the reason of the first that does not; if an
        image is not of the camera's size.
    """
    from lsvision.calibration.board_pose import estimate_board_pose
    from lsvision.calibration.camera_uncertainty import board_pose_modes
    from lsvision.calibration.target import find_target, left_out_warnings
    from lsvision.calibration.views import require_size
    from lsvision.errors import LsvisionError
    from lsvision.io.camera_file import read_camera, read_camera_covariance

    camera, camera_covariance = read_camera(camera_file), read_camera_covariance(camera_file)
    images = read_images(files)
    indices, views, estimates, left_out = [], [], [], []
    for index, (file, image) in enumerate(zip(files, images, strict=True)):
        require_size(camera, image, printable(str(file)))
        try:
            view = find_target(image, target)
            estimates.append(estimate_board_pose(view.pixels, view.points, camera))
        except LsvisionError as error:
            left_out.append(f"{printable(str(file))}: {error}")
            continue
        indices.append(index)
        views.append(view)
    if len(indices) < MIN_BOARDS:
        finding = f"{len(indices)} of {counted(len(files), 'image')} show the board"
        raise LsvisionError("; ".join([f"{finding} and {MIN_BOARDS} are needed", *left_out[:1]]))
    camera_modes = None
    if camera_covariance is not None:
        camera_modes = board_pose_modes(views, camera, camera_covariance)
    warnings = [f"left out with its pose: {reason}" for reason in left_out]
    return DetectedBoards(
        indices=indices,
        camera=camera,
        images=[images[index] for index in indices],
        views=views,
        poses=[estimate.camera_from_board for estimate in estimates],
        covariances=np.array([estimate.covariance for estimate in estimates]),
        camera_modes=camera_modes,
        warnings=(*warnings, *left_out_warnings(target, views, range(len(views)))),
    )
