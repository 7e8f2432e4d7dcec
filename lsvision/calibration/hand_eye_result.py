"""What a sensor-to-robot calibration gives: a pose, its covariance, and its evidence."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from lsvision.calibration.flange_poses import Mounting
from lsvision.calibration.rotations import cross_matrices
from lsvision.geometry import FloatArray, Plane, Pose, as_readonly_array

Sensor = Literal["section", "camera"]

HEIGHT_SCALE_SIGMAS = 4.0
"""Sigmas from which on heights that are too long are no chance."""
MIN_HEIGHT_SCALE_ERROR = 0.005
"""Error of the heights' scale from which on a person is told."""


@dataclass(frozen=True, eq=False)
class Sphere:
    """Sphere that served as target.

    Parameters
    ----------
    centre : (3,) array_like
        In the base frame (eye in hand) or the flange frame (eye to hand). Units: mm.
    radius : float
        Units: mm.
    radius_std : float
        One sigma; 0 where the radius was given. Units: mm.
    """

    centre: FloatArray
    radius: float
    radius_std: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_readonly_array(self.centre, (3,), "centre"))


@dataclass(frozen=True, slots=True)
class RejectedPose:
    """A pose that was not believed.

    Parameters
    ----------
    index : int
        Of the pose, from 0.
    reason : str
        In words and numbers.
    """

    index: int
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEye:
    """Where the sensor sits on the robot, or before it.

    Parameters
    ----------
    mount_from_sensor : Pose
        Sensor (section or camera) in the frame that carries it: the flange (eye in hand) or
        the base (eye to hand). Read it by the name that fits: `flange_from_section`,
        `base_from_section`, `flange_from_camera`, `base_from_camera`.
    covariance : (6, 6) array_like
        Of translation (mm) and rotation (rad), both along the mount's axes; the rotation is a
        small turn from the left, R -> exp([w]x) R, about the sensor's origin.
    residuals : (n,) array_like
        Length of each pose's residual, seen minus expected; NaN where nothing was seen.
        Units: mm.
    leave_one_out_residuals : (n,) array_like
        The same had the pose not taken part in the calibration. Units: mm.
    rejected : tuple of RejectedPose
        Poses left out.
    target : Sphere or Plane or Pose
        Where the target was, in the base frame (eye in hand) or flange frame (eye to hand);
        a board as ``base_from_board``.
    working_point : (3,) array_like
        Mean place of the target in the sensor frame. Units: mm.
    robot_std : tuple of float
        One sigma of the robot in each axis of position (mm) and orientation (rad), stated or
        found from the residuals.
    ambiguity_ratio : float
        Cost of the second-best minimum over the best's; near 1 the answer may be another.
    least_determined_std : float
        One sigma in the weakest direction at the nominal or stated robot; a radian counts
        100 mm. Units: mm.
    least_determined_direction : str
        That direction in words.
    mounting : {"eye_in_hand", "eye_to_hand"}
        What carries the sensor.
    sensor : {"section", "camera"}
        What the sensor's frame is.
    height_scale : tuple of float, optional
        What the profiles' heights must be multiplied by, about the working point, to be true,
        and its one sigma; a check on the sensor, 1 where it measures right. None where the
        target does not tell.
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

    def __post_init__(self) -> None:
        for name, shape in (
            ("covariance", (6, 6)),
            ("residuals", ("n",)),
            ("leave_one_out_residuals", ("n",)),
            ("working_point", (3,)),
        ):
            object.__setattr__(self, name, as_readonly_array(getattr(self, name), shape, name))

    @property
    def flange_from_section(self) -> Pose:
        """The section frame of a profile sensor on the flange."""
        return self._named("eye_in_hand", "section")

    @property
    def base_from_section(self) -> Pose:
        """The section frame of a profile sensor that stands still."""
        return self._named("eye_to_hand", "section")

    @property
    def flange_from_camera(self) -> Pose:
        """The camera on the flange; ``@ light_section.camera_from_section`` gives the section."""
        return self._named("eye_in_hand", "camera")

    @property
    def base_from_camera(self) -> Pose:
        """The camera that stands still."""
        return self._named("eye_to_hand", "camera")

    @property
    def sphere(self) -> Sphere:
        """The target, if it was a sphere."""
        if not isinstance(self.target, Sphere):
            raise ValueError(f"want a calibration on a sphere, got {type(self.target).__name__}")
        return self.target

    @property
    def residual_rms(self) -> float:
        """Of the believed poses. Units: mm."""
        return self._rms(self.residuals)

    @property
    def leave_one_out_rms(self) -> float:
        """Of the believed poses, each had it not taken part. Units: mm."""
        return self._rms(self.leave_one_out_residuals)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know before using the result."""
        if self.height_scale is None:
            return ()
        factor, std = self.height_scale
        if abs(factor - 1) < max(HEIGHT_SCALE_SIGMAS * std, MIN_HEIGHT_SCALE_ERROR):
            return ()
        return (
            f"the sensor's heights want to be multiplied by {factor:.3f} +/- {std:.3f}: is their "
            "unit or the sensor's own calibration wrong? Away from the working point positions "
            "err by as much, and so do radii",
        )

    @property
    def working_point_std(self) -> float:
        """`std_at` the working point. Units: mm."""
        return self.std_at(self.working_point)

    def covariance_at(self, point: npt.ArrayLike) -> FloatArray:
        """Covariance that the calibration gives a point of the sensor frame.

        Parameters
        ----------
        point : (2,) or (3,) array_like
            Sensor frame; two numbers are a point of the section plane. Units: mm.

        Returns
        -------
        (3, 3) ndarray
            Along the mount's axes. Units: mm^2.
        """
        p = np.zeros(3)
        given = np.asarray(point, dtype=np.float64)
        if given.shape not in ((2,), (3,)):
            raise ValueError(f"want a point of shape (3,) or (2,), got {given.shape}")
        p[: len(given)] = given
        arm = self.mount_from_sensor.rotation @ p
        transfer = np.concatenate([np.eye(3), -cross_matrices(arm)], axis=1)
        covariance: FloatArray = transfer @ self.covariance @ transfer.T
        return covariance

    def std_at(self, point: npt.ArrayLike) -> float:
        """One sigma (root of the summed variances) of a point's position. Units: mm.

        Errors of translation and rotation largely cancel where the target was seen, so that
        this, not the origin's sigma, says how good the calibration is.
        """
        return math.sqrt(float(np.trace(self.covariance_at(point))))

    def _named(self, mounting: Mounting, sensor: Sensor) -> Pose:
        if (self.mounting, self.sensor) != (mounting, sensor):
            raise ValueError(
                f"want a calibration of a {sensor} {mounting}, got one of a {self.sensor} "
                f"{self.mounting}"
            )
        return self.mount_from_sensor

    def _rms(self, lengths: FloatArray) -> float:
        left_out = [pose.index for pose in self.rejected]
        believed = np.delete(lengths, left_out)
        return float(np.sqrt(np.mean(believed**2)))
