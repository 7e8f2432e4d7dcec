"""Settings and result of a hand-eye calibration."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.calibration.hand_eye_checks import (
    LARGE_RESIDUAL_MM,
    MIN_BOARD_SCALE_ERROR,
    MIN_HEIGHT_SCALE_ERROR,
    describe_board_scale,
    describe_height_scale,
    describe_residuals,
    is_wrong_scale,
)
from lsvision.calibration.hand_eye_json import read_hand_eye, write_hand_eye
from lsvision.calibration.observations import Mounting, RejectedPose, Sensor, Sphere
from lsvision.calibration.pose_outliers import OutlierSettings
from lsvision.calibration.result_tables import (
    build_hand_eye_record,
    cells_from_rows,
    format_hand_eye_rows,
)
from lsvision.calibration.rotations import build_cross_matrices
from lsvision.calibration.sphere_arc import SphereArcSettings
from lsvision.geometry import FloatArray, Plane, Pose
from lsvision.geometry.arguments import as_numbers
from lsvision.geometry.arrays import freeze_arrays, rms
from lsvision.geometry.settings_repr import ShowsChanges
from lsvision.results.quantities import Record
from lsvision.results.result import Result
from lsvision.statistics.coverage import coverage_factor


@dataclass(frozen=True, kw_only=True, repr=False)
class HandEyeSettings(ShowsChanges):
    """Standard uncertainty of the robot, and limits for acceptance of a calibration.

    Parameters
    ----------
    robot_std : tuple of float, optional
        Standard deviation of the robot's pose in each axis of position (mm) and orientation (rad).
        If None, both are estimated from the residuals; a prior favours a ratio of 0.05 mm to
        0.01 deg.
        The "repeatability" of a data sheet is the best case; absolute accuracy is several times
        worse.
    arc : SphereArcSettings
        Detection of the sphere in a profile.
    outliers : OutlierSettings
        Rejection of outlying poses.
    max_residual_rms : float, optional
        Largest root mean square residual of the inlier poses; a larger one shows poses and profiles
        that do not belong together. If None, it follows from the noise: four times the residual
        expected for `robot_std` and the observations, or, without `robot_std`, that expected for
        2 mm and 0.4 deg; never less than 3 mm. Units: mm.
    max_least_determined_std : float
        Largest standard deviation of the least determined direction for a nominal or the stated
        robot. Units: mm.
    min_ambiguity_ratio : float
        Smallest ratio of the second-best minimum's cost to the best's.
    """

    robot_std: tuple[float, float] | None = None
    arc: SphereArcSettings = field(default_factory=SphereArcSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    max_residual_rms: float | None = None
    max_least_determined_std: float = 10.0
    min_ambiguity_ratio: float = 1.2

    def __post_init__(self) -> None:
        if self.robot_std is not None:
            position, rotation = as_numbers(self.robot_std, 2, "a robot_std (mm, rad)")
            if not (1e-6 <= position <= 1e3 and 1e-9 <= rotation <= 1):
                raise ValueError(
                    "expected a robot_std (mm, rad) above 0 and finite, from 1e-6 to 1000 mm and "
                    f"1e-9 to 1 rad, got {self.robot_std}"
                )
        if self.max_residual_rms is not None and not self.max_residual_rms > 0:
            raise ValueError(f"expected a max_residual_rms above 0 mm, got {self.max_residual_rms}")
        if not (self.max_least_determined_std > 0 and self.min_ambiguity_ratio >= 0):
            raise ValueError(
                "expected a max_least_determined_std above 0 mm and a min_ambiguity_ratio of at "
                f"least 0, got {self.max_least_determined_std} and {self.min_ambiguity_ratio}"
            )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HandEye(Result):
    """Pose of the sensor on the robot's flange, or in its base frame, with diagnostics.

    Parameters
    ----------
    mount_from_sensor : Pose
        Sensor (section or camera) in the frame that carries it: the flange (eye in hand) or
        the base (eye to hand). Use the property of the setup: `flange_from_section`,
        `base_from_section`, `flange_from_camera`, `base_from_camera`.
    covariance : (6, 6) array_like
        Covariance of translation (mm) and rotation (rad), both along the mount's axes; the rotation
        is a left perturbation, R -> exp([w]x) R, about the sensor's origin.
    residuals : (n,) array_like
        Norm of each pose's residual, observed minus predicted; NaN where the target was not found.
        Units: mm.
    leave_one_out_residuals : (n,) array_like
        The same with respect to a fit without this pose. Units: mm.
    rejected : tuple of RejectedPose
        Poses that were not used.
    target : Sphere or Plane or Pose
        The target in the base frame (eye in hand) or flange frame (eye to hand);
        a board as ``base_from_board`` or ``flange_from_board``.
    working_point : (3,) array_like
        Mean position of the target in the sensor frame. Units: mm.
    robot_std : tuple of float
        Standard deviation of the robot in each axis of position (mm) and orientation (rad):
        estimated from the residuals, or the stated one, increased if the residuals exceed it.
    ambiguity_ratio : float
        Cost of the second-best minimum over the best's; near 1 the solution is ambiguous.
    least_determined_std : float
        Standard deviation of the least determined direction for a nominal or the stated robot; one
        radian counts as 100 mm. Units: mm.
    least_determined_direction : str
        Description of that direction.
    mounting : {"eye_in_hand", "eye_to_hand"}
        Whether the flange or the base carries the sensor.
    sensor : {"section", "camera"}
        Frame of the sensor: the section frame of a profile sensor, or the camera frame.
    height_scale : tuple of float, optional
        Factor by which the profiles' heights must be multiplied, about the working point, and its
        standard deviation; a check of the sensor, 1 for a correct one. None where the target does
        not determine it.
    target_scale : tuple of float, optional
        Factor by which the size of a board must be multiplied, and its standard deviation; a check
        of the stated size. The factor is not applied; if it differs significantly from 1, the
        covariance includes the change that it would make. An error below 0.3 % never counts as
        significant, and shifts the camera along its axis by that fraction of its distance from the
        board. None for other targets, and where the robot's motion does not determine it.
    degrees_of_freedom : float
        Degrees of freedom of the covariance, above 4: the fewer poses, the larger is
        `coverage_factor`. Infinite for a stated robot.

    Examples
    --------
    >>> import lsvision as lsv
    >>> folder = "calibration/example"
    >>> poses = lsv.read_robot_poses(f"{folder}/sphere_poses.csv", "kuka")
    >>> profiles = lsv.read_profiles(f"{folder}/sphere")
    >>> hand_eye = lsv.calibrate_hand_eye_sphere(profiles, poses, 20.0)
    >>> hand_eye  # doctest: +ELLIPSIS
    <HandEye: section, eye in hand, 0.0... mm at the working point, from 12 of 12 poses>
    >>> hand_eye.flange_from_section.translation.shape, hand_eye.covariance_at((0, -200)).shape
    ((3,), (3, 3))
    >>> hand_eye.std_at(hand_eye.working_point) == hand_eye.to_dict()["working_point_std_mm"]
    True
    >>> 1.9 < hand_eye.coverage_factor() < 2.1 < hand_eye.coverage_factor(quantities=3) < 3.0
    True
    >>> import tempfile
    >>> path = f"{tempfile.mkdtemp()}/hand_eye.json"
    >>> hand_eye.save(path)
    >>> HandEye.load(path) == hand_eye
    True
    """

    mount_from_sensor: Pose
    covariance: FloatArray
    residuals: FloatArray
    leave_one_out_residuals: FloatArray
    rejected: tuple[RejectedPose, ...]
    target: Sphere | Plane | Pose
    working_point: FloatArray
    robot_std: tuple[float, float]
    ambiguity_ratio: float
    least_determined_std: float
    least_determined_direction: str
    mounting: Mounting
    sensor: Sensor
    height_scale: tuple[float, float] | None = None
    target_scale: tuple[float, float] | None = None
    degrees_of_freedom: float = math.inf

    def __post_init__(self) -> None:
        freeze_arrays(self, covariance=(6, 6), residuals=("n",), leave_one_out_residuals=("n",))
        freeze_arrays(self, working_point=(3,))

    @property
    def flange_from_section(self) -> Pose:
        """Section frame of a profile sensor on the flange."""
        return self._require_pose("eye_in_hand", "section")

    @property
    def base_from_section(self) -> Pose:
        """Section frame of a profile sensor fixed in the base frame."""
        return self._require_pose("eye_to_hand", "section")

    @property
    def flange_from_camera(self) -> Pose:
        """Camera on the flange; ``@ light_section.camera_from_section`` gives the section."""
        return self._require_pose("eye_in_hand", "camera")

    @property
    def base_from_camera(self) -> Pose:
        """Camera fixed in the base frame."""
        return self._require_pose("eye_to_hand", "camera")

    @property
    def sphere(self) -> Sphere:
        """The target of a calibration on a sphere; ValueError for another target."""
        if not isinstance(self.target, Sphere):
            raise ValueError(
                f"expected a calibration on a sphere, got {type(self.target).__name__}"
            )
        return self.target

    @property
    def residual_rms(self) -> float:
        """Root mean square residual of the inlier poses. Units: mm."""
        return self._rms(self.residuals)

    @property
    def leave_one_out_rms(self) -> float:
        """Root mean square leave-one-out residual of the inlier poses. Units: mm."""
        return self._rms(self.leave_one_out_residuals)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about large residuals, the sensor's heights, and the stated size of a board."""
        warnings, height, size = [], self.height_scale, self.target_scale
        if self.residual_rms > LARGE_RESIDUAL_MM:
            warnings.append(describe_residuals(self.residual_rms, self.robot_std))
        if height and is_wrong_scale(height, MIN_HEIGHT_SCALE_ERROR):
            is_given = isinstance(self.target, Sphere) and self.target.radius_std == 0
            warnings.append(describe_height_scale(height, radius_is_given=is_given))
        if size and is_wrong_scale(size, MIN_BOARD_SCALE_ERROR):
            warnings.append(describe_board_scale(size))
        return tuple(warnings)

    def coverage_factor(self, level: float = 0.95, quantities: int = 1) -> float:
        """Return the half width of an interval, or of a joint region, in standard deviations.

        Parameters
        ----------
        level : float
            Level of confidence, between 0 and 1.
        quantities : int
            Number of quantities of the joint region: 3 for a position, 6 for the pose.

        Returns
        -------
        float
            As `CylinderFit.coverage_factor`, for standard deviations from `covariance`.

        Raises
        ------
        ValueError
            If the level is not between 0 and 1.
        """
        factor = coverage_factor(quantities, self.degrees_of_freedom, level)
        # The variance of Student's t is dof / (dof - 2): `covariance` contains it.
        return factor * math.sqrt(1 - 2 / self.degrees_of_freedom)

    @property
    def working_point_std(self) -> float:
        """`std_at` the working point. Units: mm."""
        return self.std_at(self.working_point)

    def covariance_at(self, point: npt.ArrayLike) -> FloatArray:
        """Return the covariance of a point's position due to the errors of the calibration.

        Parameters
        ----------
        point : (2,) or (3,) array_like
            Sensor frame; two numbers are a point of the section plane. Units: mm.

        Returns
        -------
        (3, 3) ndarray
            Along the mount's axes. Units: mm^2.

        Raises
        ------
        ValueError
            If the point is of another shape.
        """
        p = np.zeros(3)
        coordinates = np.asarray(point, dtype=np.float64)
        if coordinates.shape not in ((2,), (3,)):
            raise ValueError(f"expected a point of shape (3,) or (2,), got {coordinates.shape}")
        p[: len(coordinates)] = coordinates
        lever_arm = self.mount_from_sensor.rotation @ p
        point_jacobian = np.concatenate([np.eye(3), -build_cross_matrices(lever_arm)], axis=1)
        covariance: FloatArray = point_jacobian @ self.covariance @ point_jacobian.T
        return covariance

    def std_at(self, point: npt.ArrayLike) -> float:
        """Return the standard deviation of a point's position: root of the summed variances.

        Errors of translation and rotation largely cancel where the target was measured: this value,
        and not that of the sensor's origin, is the accuracy of the calibration.

        Parameters
        ----------
        point : (2,) or (3,) array_like
            Sensor frame. Units: mm.

        Returns
        -------
        float
            Root of the summed variances. Units: mm.
        """
        return math.sqrt(float(np.trace(self.covariance_at(point))))

    def save(
        self, path: str | os.PathLike[str], provenance: Mapping[str, str] | None = None
    ) -> None:
        """Write the hand-eye file (JSON), as ``lsvision calibrate hand-eye`` does.

        Parameters
        ----------
        path : path
            ``.json``; an existing file is replaced only when all is written.
        provenance : mapping of str to str, optional
            Method, date, version and inputs' hash, from `lsvision.io.calibration.build_provenance`.

        Raises
        ------
        UnwritableFile
            If the folder is missing or not writable.
        """
        write_hand_eye(path, self, provenance)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read the hand-eye file that `save` or ``lsvision calibrate hand-eye`` wrote.

        Parameters
        ----------
        path : path
            ``.json``.

        Returns
        -------
        HandEye
            The calibration, equal to the one that was saved.

        Raises
        ------
        UnreadableFile
            If the file is missing, damaged, or of another schema.

        Examples
        --------
        >>> HandEye.load("nowhere.json")
        Traceback (most recent call last):
        ...
        lsvision.errors.UnreadableFile: nowhere.json: no such file: check the name
        """
        return read_hand_eye(path, cls)

    def to_dict(self) -> Record:
        """Return the pose, its uncertainty and the diagnostics as plain numbers, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``, angles in ``*_deg``; `save` writes what `load` reads again.
        """
        return build_hand_eye_record(self)

    def _summarise(self) -> str:
        used = len(self.residuals) - len(self.rejected)
        return (
            f"{self.sensor}, {self.mounting.replace('_', ' ')}, {self.working_point_std:.3f} mm "
            f"at the working point, from {used} of {len(self.residuals)} poses"
        )

    def _list_cells(self) -> list[tuple[str, ...]]:
        return cells_from_rows(format_hand_eye_rows(self))

    def _list_notes(self) -> list[str]:
        left_out = [f"left out: pose {pose.index}: {pose.reason}" for pose in self.rejected]
        return left_out + [f"warning: {text}" for text in self.warnings]

    def _require_pose(self, mounting: Mounting, sensor: Sensor) -> Pose:
        if (self.mounting, self.sensor) != (mounting, sensor):
            expected, got = (name.replace("_", " ") for name in (mounting, self.mounting))
            raise ValueError(
                f"expected a calibration of a {sensor}, {expected}, got one of a {self.sensor}, "
                f"{got}"
            )
        return self.mount_from_sensor

    def _rms(self, residuals: FloatArray) -> float:
        return rms(np.delete(residuals, [pose.index for pose in self.rejected]))
