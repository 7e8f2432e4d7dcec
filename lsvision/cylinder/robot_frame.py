"""Transform the cylinder of one section to the robot's frame, with its covariance.

The covariances are propagated to first order, J Sigma J'. The five parameters of the section, the
six of the calibration and the six of the robot's pose have independent errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, cast

import numpy as np
import numpy.typing as npt

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Cylinder, FloatArray, Pose, build_tangent_frame
from lsvision.geometry.arrays import TINY, freeze_arrays
from lsvision.geometry.cylinder import WithCylinder
from lsvision.geometry.pose import as_pose
from lsvision.results.number_format import count_decimals, format_std, format_value
from lsvision.results.quantities import (
    Record,
    convert_numbers_to_json,
    flatten_record,
    replace_nonfinite,
)
from lsvision.results.result import Result

Frame = Literal["base", "flange"]

MIN_SIN_PHI = 1e-6
"""Smallest sin(phi) used as a divisor, against division by 0; where it is reached the linear errors
are limited to the section's ``phi_std`` anyway."""
PLACED_HEADER = ("point x y z mm", "± mm", "direction x y z", "± deg")
"""Header of `format_placed_cells`."""
PLACED_COVARIANCE_ORDER = "point x, y, z (mm), direction along e_phi, e_theta (rad), radius (mm)"
"""Order of `PlacedCylinder.covariance`, as results state it."""


class SectionMount(Protocol):
    """Pose of a section frame on a robot's flange with its uncertainty, such as a `HandEye`."""

    @property
    def flange_from_section(self) -> Pose:
        """Pose of the section frame in the flange frame. Units: mm."""
        ...

    @property
    def covariance(self) -> FloatArray:
        """Covariance of translation (mm) and rotation (rad) along the flange's axes, (6, 6).

        A rotation vector w acts from the left, R -> exp([w]x) R, about the section's origin.
        """
        ...

    @property
    def robot_std(self) -> tuple[float, float]:
        """Standard uncertainty of the flange pose, per axis of position (mm) and rotation (rad)."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class PlacedCylinder(WithCylinder, Result):
    """One of the two cylinders that fit a section, in the frame of the robot.

    Parameters
    ----------
    cylinder : Cylinder
        Its point is the intersection of the axis with the laser plane.
    covariance : (6, 6) array_like
        Order: point x, y, z (mm), direction along the two rows of `tangent_basis` (rad), radius
        (mm). Linear approximation; the errors of the direction are limited where phi is near 0.
    frame : {"base", "flange"}
        Frame of all coordinates.
    includes_calibration : bool
        Whether the covariance includes the errors of the calibration and, in the base frame, those
        of the robot; otherwise both are assumed exact.

    Examples
    --------
    >>> import lsvision as lsv
    >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
    >>> first, second = lsv.place_section(pipe, lsv.Pose(translation=(0, 0, 150.0)))
    >>> first.frame, bool(first.radius == second.radius)
    ('flange', True)
    """

    cylinder: Cylinder
    covariance: FloatArray
    frame: Frame
    includes_calibration: bool

    def __post_init__(self) -> None:
        freeze_arrays(self, covariance=(6, 6))

    @property
    def point_std(self) -> FloatArray:
        """Standard uncertainty of `point` per axis of the frame, (3,). Units: mm."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction. Units: rad."""
        return math.sqrt(self.covariance[3, 3] + self.covariance[4, 4])

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm."""
        return math.sqrt(self.covariance[5, 5])

    def to_dict(self) -> Record:
        """Return point, direction, radius and covariance as plain numbers, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``, angles in ``*_deg``.

        Examples
        --------
        >>> import lsvision as lsv
        >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
        >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
        >>> first, _ = lsv.place_section(pipe, lsv.Pose())
        >>> first.to_dict()["frame"], first.to_dict()["includes_calibration"]
        ('flange', False)
        """
        return {
            "frame": self.frame,
            "includes_calibration": self.includes_calibration,
            "radius_mm": self.radius,
            "radius_std_mm": replace_nonfinite(self.radius_std),
            "point_mm": convert_numbers_to_json(self.point),
            "point_std_mm": convert_numbers_to_json(self.point_std),
            "covariance_order": PLACED_COVARIANCE_ORDER,
            **self.direction_record,
        }

    @property
    def direction_record(self) -> Record:
        """Direction and covariance, which differ between the two cylinders, ready for JSON.

        ``e_phi`` and ``e_theta`` refer to Z of `frame`, not to phi and theta of the section.
        """
        return {
            "direction": convert_numbers_to_json(self.direction),
            "direction_std_deg": replace_nonfinite(math.degrees(self.direction_std)),
            "e_phi": convert_numbers_to_json(self.tangent_basis[0]),
            "e_theta": convert_numbers_to_json(self.tangent_basis[1]),
            "covariance": [convert_numbers_to_json(row) for row in self.covariance],
        }

    def _summarise(self) -> str:
        point, point_std, direction, angle = format_placed_cells(self)
        return (
            f"radius {format_value(self.radius, self.radius_std)} mm, point ({point}) ± "
            f"({point_std}) mm, direction ({direction}) ± {angle} deg, {self.frame} frame"
        )

    def _list_cells(self) -> list[tuple[str, ...]]:
        radius = format_value(self.radius, self.radius_std)
        return [("radius mm", *PLACED_HEADER), (radius, *format_placed_cells(self))]

    def _list_notes(self) -> list[str]:
        errors = "with" if self.includes_calibration else "without"
        return [f"{self.frame} frame, one sigma, {errors} the calibration's error"]

    def _list_rows(self) -> list[Record]:
        row = flatten_record(self.to_dict())
        omitted = (
            "covariance_order",
            *(f"{vector}_{axis}" for vector in ("e_phi", "e_theta") for axis in "xyz"),
        )
        return [{key: value for key, value in row.items() if key not in omitted}]


def format_placed_cells(cylinder: PlacedCylinder) -> tuple[str, ...]:
    """Return the cells of a cylinder in the columns of `PLACED_HEADER`; `±` is one sigma."""
    stds = [float(std) for std in cylinder.point_std]
    direction_decimals = count_decimals(cylinder.direction_std)
    return (
        " ".join(
            f"{coordinate:z.{count_decimals(std)}f}"
            for coordinate, std in zip(cylinder.point, stds, strict=True)
        ),
        " ".join(format_std(std) for std in stds),
        " ".join(f"{component:+z.{direction_decimals}f}" for component in cylinder.direction),
        format_std(math.degrees(cylinder.direction_std)),
    )


def place_section(
    section: CylinderSection,
    calibration: SectionMount | Pose | npt.ArrayLike,
    base_from_flange: Pose | npt.ArrayLike | None = None,
) -> tuple[PlacedCylinder, PlacedCylinder]:
    """Return both cylinders of a section in the base or flange frame, with their covariances.

    Parameters
    ----------
    section : CylinderSection
        Cylinder in a profile, from ``measure_cylinders(...).cylinders``.
    calibration : HandEye, Pose or (4, 4) array_like
        ``flange_from_section`` with its covariance, and the errors of the robot. A Pose is assumed
        exact; `PlacedCylinder.includes_calibration` is then False.
    base_from_flange : Pose or (4, 4) array_like, optional
        Pose of the robot. None: the result is in the flange frame and does not include the
        errors of the robot. Units: mm.

    Returns
    -------
    tuple of PlacedCylinder
        In the order of ``section.axis_candidates``: directions cos(phi) n + sin(phi) m and
        cos(phi) n - sin(phi) m, with n the laser plane's normal and m the ellipse's major axis.
        One of them is the real cylinder; a second section, or other information about the scene,
        determines which one.

    Raises
    ------
    ValueError
        If the calibration is that of a camera, or of a sensor that is not on the robot (see
        `HandEye.flange_from_section`).

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
    flange_pose = Pose() if base_from_flange is None else as_pose(base_from_flange)
    frame: Frame = "flange" if base_from_flange is None else "base"
    motions: list[_UncertainMotion] = []
    if hasattr(calibration, "robot_std"):
        mount = cast("SectionMount", calibration)
        section_pose = flange_pose @ mount.flange_from_section
        motions.append(
            _UncertainMotion(section_pose.translation, flange_pose.rotation, mount.covariance)
        )
        if base_from_flange is not None:
            robot = np.diag(np.repeat(np.square(mount.robot_std), 3))
            motions.append(_UncertainMotion(flange_pose.translation, np.eye(3), robot))
    else:
        section_pose = flange_pose @ as_pose(calibration)
    placed = []
    for twin, sign in zip(Cylinder.twins(section.ellipse), (1.0, -1.0), strict=True):
        jacobian = twin_jacobian(section, sign)
        jacobian[:6] = np.kron(np.eye(2), section_pose.rotation) @ jacobian[:6]
        cylinder = twin.transformed(section_pose)
        covariance = _add_motions(cylinder, jacobian @ section.covariance @ jacobian.T, motions)
        placed.append(PlacedCylinder(cylinder, covariance, frame, bool(motions)))
    first, second = placed
    return first, second


class _UncertainMotion(NamedTuple):
    """Error of a pose: a small rigid motion with its covariance.

    Rotations are about the point `pivot` (3,), in mm; the columns of `axes` (3, 3) are the axes of
    translations and rotations. `covariance` (6, 6): translation (mm), then rotation (rad).
    """

    pivot: FloatArray
    axes: FloatArray
    covariance: FloatArray


def _add_motions(
    cylinder: Cylinder, covariance: FloatArray, motions: list[_UncertainMotion]
) -> FloatArray:
    """Return the covariance of a `PlacedCylinder` (6, 6), with the errors of the poses.

    `covariance` is that of point, direction and radius (7, 7) due to the section alone.
    """
    for motion in motions:
        jacobian = rigid_motion_jacobian(cylinder, motion.pivot, motion.axes)
        covariance = covariance + jacobian @ motion.covariance @ jacobian.T
    # The three components of the direction become the two along the tangent basis.
    projection = np.zeros((6, 7))
    projection[:3, :3], projection[5, 6] = np.eye(3), 1.0
    projection[3:5, 3:6] = build_tangent_frame(cylinder.direction)[:2]
    return projection @ covariance @ projection.T


def twin_jacobian(section: CylinderSection, sign: float) -> FloatArray:
    """Return the Jacobian of one of the two cylinders with respect to the ellipse of a section.

    Parameters
    ----------
    section : CylinderSection
        The measured section.
    sign : {1.0, -1.0}
        Selects the cylinder of direction cos(phi) n + sign sin(phi) m in the section frame, with n
        the laser plane's normal and m the ellipse's major axis.

    Returns
    -------
    (7, 5) ndarray
        Rows: point (3), direction (3), radius; columns: centre_x, centre_y, semi_major,
        semi_minor, theta. Rows are scaled so that the propagated errors do not exceed the
        section's ``phi_std`` and ``theta_std`` near phi = 0, where linear propagation is
        invalid, and so that the radius has ``radius_std``.
    """
    a, b = section.ellipse.semi_major, section.ellipse.semi_minor
    phi, theta = section.phi, section.theta
    # Gradients by the five parameters of phi and of the rotation along e_theta: cos(phi) = b / a
    # (paper section 2.2.3); d theta rotates the direction by sin(phi) d theta.
    phi_gradient = np.array([0.0, 0.0, b / a**2, -1 / a, 0.0]) / max(math.sin(phi), MIN_SIN_PHI)
    azimuth_gradient = np.array([0.0, 0.0, 0.0, 0.0, math.sin(phi)])
    phi_gradient *= _scale_to_limit(section.phi_std, phi_gradient, section.covariance)
    limit = math.sin(phi) * section.theta_std
    azimuth_gradient *= _scale_to_limit(limit, azimuth_gradient, section.covariance)
    # Derivatives of the direction by phi and, over sin(phi), by theta; section frame. For phi > 0
    # they are the tangent frame of the direction.
    major = np.array([math.cos(theta), math.sin(theta), 0.0])
    e_phi = sign * math.cos(phi) * major - math.sin(phi) * np.array([0.0, 0.0, 1.0])
    e_theta = sign * np.array([-math.sin(theta), math.cos(theta), 0.0])
    jacobian = np.zeros((7, 5))
    jacobian[0, 0] = jacobian[1, 1] = 1.0
    jacobian[6, 3] = section.radius_std / max(math.sqrt(section.covariance[3, 3]), TINY)
    jacobian[3:6] = np.outer(e_phi, phi_gradient) + np.outer(e_theta, azimuth_gradient)
    return jacobian


def rigid_motion_jacobian(cylinder: Cylinder, pivot: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the Jacobian (7, 6) of a cylinder with respect to a small rigid motion.

    Rows are point (3), direction (3) and radius, columns translations (mm) and rotations (rad)
    along the columns of `axes` (3, 3); the rotations are about the point `pivot` (3,).
    """
    jacobian = np.zeros((7, 6))
    jacobian[:3, :3] = axes
    # A small rotation w displaces a point by w x (point - pivot).
    jacobian[:3, 3:] = np.cross(axes.T, cylinder.point - pivot).T
    jacobian[3:6, 3:] = np.cross(axes.T, cylinder.direction).T
    return jacobian


def _scale_to_limit(limit: float, gradient: FloatArray, covariance: FloatArray) -> float:
    """Return the factor, at most 1, on a gradient so that its propagated std is within a limit."""
    linear = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
    return min(1.0, limit / linear) if linear > 0 else 1.0
