"""Boards detected in the images of a hand-eye calibration: poses, covariances and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lsvision.cli.calibrate_inputs import add_file_names, read_images
from lsvision.errors import LsvisionError
from lsvision.files.printable import escape_text
from lsvision.results.summaries import format_count

if TYPE_CHECKING:
    from lsvision.calibration.board_pose import BoardPoseEstimate
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.observations import Mounting
    from lsvision.calibration.target import Target, TargetView
    from lsvision.geometry import FloatArray, Points, Pose
    from lsvision.sensors.camera import Camera

MIN_BOARDS = 4
"""Smallest number of images that show the board: three determine the sensor's pose on the robot, a
fourth one checks it."""


@dataclass(frozen=True, kw_only=True)
class ReportData:
    """Data of a hand-eye calibration that its report shows beside the result.

    Warnings are about the target, and about images and corners that were left out. For each photo,
    if the sensor takes photos, `corners` are those found, (n, 2), and their residuals (predicted
    minus found). Units: px.
    """

    warnings: "Sequence[str]" = ()
    images: Sequence[Any] = ()
    corners: "Sequence[tuple[Points, FloatArray]]" = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectedBoards:
    """The board's pose, ``camera_from_board``, in each image in which it was found.

    `indices` are the positions of these n images among all images. The other fields have an item
    for each of the n images, in the same order. Covariances, (n, 6, 6), are those of
    `estimate_board_pose`. `camera_modes`, (m, n, 6), are the shifts of each pose by each of m
    independent errors of the camera, one standard deviation each, see `compute_board_pose_modes`;
    None if the camera's file has no covariance. Warnings are about images and corners that were
    left out, and boards whose corners were numbered from another end.
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
        """Return the boards with their corners numbered from the same end in all images.

        An image does not show from which end to number a board that looks the same after a turn;
        the robot's poses do: `flanges` are ``base_from_flange`` of each image with a board, in the
        order of `indices`.

        Raises
        ------
        CalibrationFailed
            If the robot's poses do not determine the end.
        """
        from lsvision.calibration.board_turns import list_pattern_turns, turn_boards

        turns = list_pattern_turns(target)
        if not turns:
            return self
        mount_poses = [_compute_mount_pose(flange, mounting) for flange in flanges]
        turned = turn_boards(self.poses, mount_poses, turns)
        turned_from_original = [
            camera_from_turned.inverse() @ camera_from_original
            for camera_from_turned, camera_from_original in zip(
                turned.poses, self.poses, strict=True
            )
        ]
        return replace(
            self,
            views=[
                replace(view, points=turn.apply(view.points))
                for view, turn in zip(self.views, turned_from_original, strict=True)
            ],
            poses=turned.poses,
            covariances=turned.covariances(self.covariances),
            camera_modes=None
            if self.camera_modes is None
            else turned.compute_shifts(self.camera_modes),
            warnings=(*self.warnings, turned.warning),
        )

    def build_report_data(
        self, calibration: "HandEye", flanges: "Sequence[Pose]", names: Sequence[str]
    ) -> ReportData:
        """Return photos, corners with their residuals, and warnings for the report.

        Corners are predicted by the calibration from the robot's poses `flanges`, which are
        ``base_from_flange``. These poses and the `names` of the files, for the warnings, are those
        of the images with a board, in the order of `indices`.
        """
        from lsvision.geometry import Pose

        assert isinstance(calibration.target, Pose)
        corners = []
        for view, flange in zip(self.views, flanges, strict=True):
            mount_pose = _compute_mount_pose(flange, calibration.mounting)
            # In the frame in which the board does not move, as `calibration.target`.
            camera_pose = mount_pose @ calibration.mount_from_sensor
            camera_from_board = camera_pose.inverse() @ calibration.target
            predicted = self.camera.project(camera_from_board.apply(view.points))
            corners.append((view.pixels, predicted - view.pixels))
        warnings = [add_file_names(text, image=names, pose=names) for text in self.warnings]
        return ReportData(warnings=warnings, images=self.images, corners=corners)


def find_boards(files: Sequence[Path], target: "Target", camera_file: Path) -> DetectedBoards:
    """Find the board in each image; images that do not show it are left out, with a warning.

    Raises
    ------
    LsvisionError
        If fewer than `MIN_BOARDS` images show the board (the message has the reason for the first
        image without it), or an image does not have the size of the camera's images.
    """
    from lsvision.calibration.camera_uncertainty import compute_board_pose_modes
    from lsvision.calibration.target import list_left_out_warnings
    from lsvision.io.camera_file import read_camera, read_camera_covariance

    camera, camera_covariance = read_camera(camera_file), read_camera_covariance(camera_file)
    images = read_images(files)
    detections, left_out = _detect_boards(files, images, target, camera)
    if len(detections) < MIN_BOARDS:
        finding = f"{len(detections)} of {format_count(len(files), 'image')} show the board"
        problem = f"{finding} and {MIN_BOARDS} are needed"
        raise LsvisionError("; ".join([problem, *left_out[:1]]))
    views = [detection.view for detection in detections]
    camera_modes = None
    if camera_covariance is not None:
        camera_modes = compute_board_pose_modes(views, camera, camera_covariance)
    warnings = [f"image and its robot pose left out: {reason}" for reason in left_out]
    # Warnings number the images with a board; `build_report_data` replaces numbers by file names.
    numbers = range(len(views))
    return DetectedBoards(
        indices=[detection.index for detection in detections],
        camera=camera,
        images=[images[detection.index] for detection in detections],
        views=views,
        poses=[detection.estimate.camera_from_board for detection in detections],
        covariances=np.array([detection.estimate.covariance for detection in detections]),
        camera_modes=camera_modes,
        warnings=(*warnings, *list_left_out_warnings(target, views, numbers)),
    )


@dataclass(frozen=True, eq=False)
class _Detection:
    """Board in an image: index of the image, corners, and pose with its covariance."""

    index: int
    view: "TargetView"
    estimate: "BoardPoseEstimate"


def _detect_boards(
    files: Sequence[Path], images: Sequence[Any], target: "Target", camera: "Camera"
) -> tuple[list[_Detection], list[str]]:
    """Return the boards detected in images, and file and reason for each image without one."""
    from lsvision.calibration.board_pose import estimate_board_pose
    from lsvision.calibration.target import find_target
    from lsvision.calibration.views import require_size

    detections: list[_Detection] = []
    left_out: list[str] = []
    for index, (file, image) in enumerate(zip(files, images, strict=True)):
        require_size(camera, image, escape_text(str(file)))
        try:
            view = find_target(image, target)
            estimate = estimate_board_pose(view.pixels, view.points, camera)
        except LsvisionError as error:
            left_out.append(f"{escape_text(str(file))}: {error}")
        else:
            detections.append(_Detection(index, view, estimate))
    return detections, left_out


def _compute_mount_pose(flange: "Pose", mounting: "Mounting") -> "Pose":
    """Return the pose of the camera's mount in the frame in which the board does not move.

    Eye in hand: ``base_from_flange``; eye to hand: its inverse, ``flange_from_base``.
    """
    return flange if mounting == "eye_in_hand" else flange.inverse()
