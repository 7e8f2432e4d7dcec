"""One measured section in the frame of the robot, the errors of fit and calibration carried along.

All to first order: Jacobian times covariance times its transpose, for the five numbers of the
section and the six of the calibration, which know nothing of each other.
"""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from lsvision.cylinder.problem import tangent_frame
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Cylinder, FloatArray, Pose, as_readonly_array

Frame = Literal["base", "flange"]

MIN_SIN_PHI = 1e-6
"""Of phi: below, the direction's errors are limited by those that the section states."""
TINY_MM = 1e-300


class SectionMount(Protocol):
    """Where a section frame sits on a robot's flange, and all errors of that: a `HandEye`."""

    @property
    def flange_from_section(self) -> Pose:
        """The section frame on the flange. Units: mm."""
        ...

    @property
    def covariance(self) -> FloatArray:
        """(6, 6) of translation (mm) and rotation (rad), both along the flange's axes.

        The rotation is a small turn from the left, R -> exp([w]x) R, about the section's origin.
        """
        ...

    @property
    def robot_std(self) -> tuple[float, float]:
        """One sigma of the flange's pose in each axis of position (mm) and orientation (rad)."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class PlacedCylinder:
    """One of the two cylinders that a section allows, in the frame of the robot.

    Parameters
    ----------
    cylinder : Cylinder
        Its point is where the axis meets the laser plane.
    covariance : (6, 6) array_like
        Order: point x, y, z (mm), direction along ``across[0]`` and ``across[1]`` (rad), radius
        (mm). Linear approximation, the direction's errors limited where phi is near 0.
    frame : {"base", "flange"}
        Of all its coordinates.
    includes_calibration : bool
        Whether the covariance holds the errors of the calibration and, in the base frame, of the
        robot; else they are taken for nothing.
    """

    cylinder: Cylinder
    covariance: FloatArray
    frame: Frame
    includes_calibration: bool

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (6, 6), "covariance")
        )

    @property
    def point(self) -> FloatArray:
        """(3,) where the axis meets the laser plane. Units: mm."""
        return self.cylinder.point

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector along the axis, to the side of the laser plane's normal."""
        return self.cylinder.direction

    @property
    def radius(self) -> float:
        """Units: mm."""
        return self.cylinder.radius

    @property
    def tangent_basis(self) -> FloatArray:
        """(2, 3) e_phi and e_theta: the way the angle from Z grows, and Z x direction."""
        return tangent_frame(self.direction)[:2]

    @property
    def point_std(self) -> FloatArray:
        """(3,) one sigma of `point`, per axis of the frame. Units: mm."""
        std: FloatArray = np.sqrt(np.diag(self.covariance)[:3])
        return std

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction, both ways together. Units: rad."""
        return math.sqrt(self.covariance[3, 3] + self.covariance[4, 4])

    @property
    def radius_std(self) -> float:
        """One sigma of the radius. Units: mm."""
        return math.sqrt(self.covariance[5, 5])


def place_section(
    section: CylinderSection,
    calibration: SectionMount | Pose,
    base_from_flange: Pose | None = None,
) -> tuple[PlacedCylinder, PlacedCylinder]:
    """Both cylinders of a section in the robot's base frame, with the calibration's errors.

    Parameters
    ----------
    section : CylinderSection
        One of ``measure_cylinders(...).cylinders``.
    calibration : HandEye or Pose
        ``flange_from_section`` with its covariance, and the robot's own error; a mere Pose is
        taken as exact, and the result says so (`PlacedCylinder.includes_calibration`).
    base_from_flange : Pose, optional
        Where the robot stood. Without, the result is in the flange frame, and the robot's own
        error is not in it. Units: mm.

    Returns
    -------
    tuple of PlacedCylinder
        In the order of ``section.axis_twins``: cos(phi) n + sin(phi) m, and the one with minus.
        One of them is the cylinder; a second section, or what you know of the scene, tells.

    Raises
    ------
    ValueError
        If the calibration is of a camera or of a sensor that stands still.

    Examples
    --------
    >>> from lsvision.measure import measure_cylinders
    >>> from lsvision.simulate import random_section
    >>> (pipe,) = measure_cylinders(random_section("single", 7, noise_mm=0.02).profile).cylinders
    >>> flange_from_section = Pose(translation=(0.0, 0.0, 150.0))
    >>> first, twin = place_section(pipe, flange_from_section, Pose(translation=(800.0, 0, 0)))
    >>> first.frame, first.includes_calibration, first.point.shape
    ('base', False, (3,))
    """
    flange = Pose() if base_from_flange is None else base_from_flange
    frame: Frame = "flange" if base_from_flange is None else "base"
    if isinstance(calibration, Pose):
        pose, motions = flange @ calibration, []
    else:
        pose = flange @ calibration.flange_from_section
        motions = [(pose.translation, flange.rotation, calibration.covariance)]
        if base_from_flange is not None:
            motions.append((flange.translation, np.eye(3), robot_covariance(calibration)))

    def placed(twin: Cylinder, sign: float) -> PlacedCylinder:
        cylinder = twin.transformed(pose)
        by_fit = twin_jacobian(section, sign)
        by_fit[:6] = np.kron(np.eye(2), pose.rotation) @ by_fit[:6]
        full = by_fit @ section.covariance @ by_fit.T
        for pivot, axes, covariance in motions:
            by_motion = rigid_motion_jacobian(cylinder, pivot, axes)
            full += by_motion @ covariance @ by_motion.T
        rows = np.zeros((6, 7))
        rows[:3, :3], rows[5, 6] = np.eye(3), 1.0
        rows[3:5, 3:6] = tangent_frame(cylinder.direction)[:2]
        return PlacedCylinder(cylinder, rows @ full @ rows.T, frame, bool(motions))

    first, second = Cylinder.twins(section.ellipse)
    return placed(first, 1.0), placed(second, -1.0)


def twin_jacobian(section: CylinderSection, sign: float) -> FloatArray:
    """Change of a twin by centre_x, centre_y, semi_major, semi_minor and theta, section frame.

    Parameters
    ----------
    section : CylinderSection
        The section.
    sign : {1.0, -1.0}
        Of the twin cos(phi) n + sign sin(phi) m.

    Returns
    -------
    (7, 5) ndarray
        Rows: point (3), direction (3), radius. Near phi = 0, where the linear errors are wrong,
        the direction's are those of ``phi_std`` and ``theta_std``, the radius' is ``radius_std``.
    """
    a, b = section.ellipse.semi_major, section.ellipse.semi_minor
    phi, theta = section.phi, section.theta
    # cos(phi) = b / a, section 2.2.3; theta turns the direction by sin(phi).
    phi_by = np.array([0.0, 0.0, b / a**2, -1 / a, 0.0]) / max(math.sin(phi), MIN_SIN_PHI)
    theta_by = np.array([0.0, 0.0, 0.0, 0.0, math.sin(phi)])
    phi_by *= _clamp_direction_covariance(section.phi_std, phi_by, section.covariance)
    theta_by *= _clamp_direction_covariance(
        math.sin(phi) * section.theta_std, theta_by, section.covariance
    )
    major = np.array([math.cos(theta), math.sin(theta), 0.0])
    phi_way = sign * math.cos(phi) * major - math.sin(phi) * np.array([0.0, 0.0, 1.0])
    theta_way = sign * np.array([-math.sin(theta), math.cos(theta), 0.0])
    gradients = np.zeros((7, 5))
    gradients[0, 0] = gradients[1, 1] = 1.0
    gradients[6, 3] = section.radius_std / max(math.sqrt(section.covariance[3, 3]), TINY_MM)
    gradients[3:6] = np.outer(phi_way, phi_by) + np.outer(theta_way, theta_by)
    return gradients


def rigid_motion_jacobian(cylinder: Cylinder, pivot: FloatArray, axes: FloatArray) -> FloatArray:
    """Change of a cylinder by small motions: three shifts, and three turns about a pivot.

    Parameters
    ----------
    cylinder : Cylinder
        Any frame.
    pivot : (3,) ndarray
        The same frame. Units: mm.
    axes : (3, 3) ndarray
        Columns are the axes along and about which it moves.

    Returns
    -------
    (7, 6) ndarray
        Rows: point (3), direction (3), radius.
    """
    gradients = np.zeros((7, 6))
    gradients[:3, :3] = axes
    # Columns e x arm: a small turn about e moves the end of the arm by that.
    gradients[:3, 3:] = np.cross(axes.T, cylinder.point - pivot).T
    gradients[3:6, 3:] = np.cross(axes.T, cylinder.direction).T
    return gradients


def robot_covariance(calibration: SectionMount) -> FloatArray:
    """(6, 6) of the flange's pose: three shifts, three turns about its origin, any axes."""
    position, rotation = calibration.robot_std
    return np.diag([position**2] * 3 + [rotation**2] * 3)


def _clamp_direction_covariance(
    limit: float, gradient: FloatArray, covariance: FloatArray
) -> float:
    linear = math.sqrt(float(gradient @ covariance @ gradient))
    return min(1.0, limit / linear) if linear > 0 else 1.0
