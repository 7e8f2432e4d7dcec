"""Five pitfalls in the paper's wording, each with numbers that demonstrate it."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Ellipse, FloatArray, Points, orthogonal_residuals, radial_residuals
from lsvision.measure import measure_cylinders
from lsvision.profile import Profile
from lsvision.studies.chen_liu_2016.cases import STANDOFF_MM, build_paper_sensor, simulate_case
from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.repeatability import POSITION

NOISE_MM = 0.05
"""Noise of the section whose Y axis is reversed. Units: mm."""
SPLINE_STEP_MM = 0.5
"""Spacing of homogenised points, as in the paper's section 3.3.2. Units: mm."""


@dataclass(frozen=True, slots=True)
class Check:
    """Number that demonstrates a pitfall.

    Parameters
    ----------
    description : str
        Description of the number, with its unit.
    value : float
        Number; NaN if the formula has no value.
    """

    description: str
    value: float


@dataclass(frozen=True, slots=True)
class Pitfall:
    """Misleading passage in the paper's wording.

    Parameters
    ----------
    title, wording, ours : str
        Topic; wording of the paper; what lsvision does instead.
    checks : tuple of Check
        Numbers that demonstrate it.
    """

    title: str
    wording: str
    ours: str
    checks: tuple[Check, ...]


def check_pitfalls() -> tuple[Pitfall, ...]:
    """Return the five pitfalls with their numbers."""
    return (
        _demonstrate_theta_of_major_axis(),
        _demonstrate_radial_distance(),
        _demonstrate_two_axes(),
        _demonstrate_division_by_zero(),
        _demonstrate_direction_of_y(),
    )


def evaluate_printed_equation_one(points: Points, ellipse: Ellipse, theta: float) -> FloatArray:
    """Return the left-hand side of the paper's Eq. (1) as printed; it should be 1 on the ellipse.

    The points are (n, 2) in mm; of the ellipse, centre and semi-axes are used; theta in rad is the
    angle in the equation.
    """
    dx, dy = (points - ellipse.centre).T
    first = dx * math.sin(theta) - dy * math.cos(theta)
    second = dx * math.cos(theta) + dy * math.sin(theta)
    left_hand_side: FloatArray = (
        first**2 / ellipse.semi_major**2 + second**2 / ellipse.semi_minor**2
    )
    return left_hand_side


def evaluate_printed_equation_four(points: Points, ellipse: Ellipse, theta: float) -> FloatArray:
    """Return the paper's r_j, Eq. (4) as printed, in mm; it should be 0 on the ellipse.

    See `evaluate_printed_equation_one`. NaN for a point with the x of the centre.
    """
    dx, dy = (points - ellipse.centre).T
    a, b = ellipse.semi_major, ellipse.semi_minor
    sin, cos = math.sin(theta), math.cos(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = dy / dx
        denominator = a**2 * (slope * sin + cos) ** 2 + b**2 * (sin - slope * cos) ** 2
        squared = dx**2 + dy**2
        on_ellipse = np.sqrt(squared / dx**2 * a**2 * b**2 / denominator)
        residuals: FloatArray = np.abs(np.sqrt(squared) - on_ellipse)
    return residuals


def _demonstrate_theta_of_major_axis() -> Pitfall:
    ellipse = Ellipse((0.0, 0.0), 20.0, 15.0, math.radians(30))
    vertex = ellipse.points_at(np.zeros(1))
    as_text, as_printed = ellipse.theta, ellipse.theta - math.pi / 2
    eq_1, eq_4 = evaluate_printed_equation_one, evaluate_printed_equation_four
    return Pitfall(
        "θ: direction of which axis?",
        "By the text, θ is the direction of the major axis. Eqs. (1) and (4) as printed put "
        "the long semi-axis a across it, at θ + 90°.",
        "θ is the direction of the major axis, from X towards Y, in [0°, 180°).",
        (
            Check("Eq. (1) at the end of the major axis, θ as in the text (on the ellipse: 1)",
                  float(eq_1(vertex, ellipse, as_text)[0])),
            Check("Eq. (4) there, mm (on ellipse: 0)", float(eq_4(vertex, ellipse, as_text)[0])),
            Check("Eq. (1) with θ turned by 90°", float(eq_1(vertex, ellipse, as_printed)[0])),
            Check("Eq. (4) with θ turned by 90°, mm", float(eq_4(vertex, ellipse, as_printed)[0])),
        ),
    )  # fmt: skip


def _demonstrate_radial_distance() -> Pitfall:
    def ratio(phi_deg: float) -> float:
        """Return the largest ratio of radial to orthogonal residual, for points 0.1 mm outside."""
        phi = math.radians(phi_deg)
        ellipse = Ellipse((0.0, 0.0), 19.0 / math.cos(phi), 19.0, 0.0)
        angles = np.linspace(0, 2 * math.pi, 721)
        a, b = ellipse.semi_major, ellipse.semi_minor
        normals = np.column_stack([b * np.cos(angles), a * np.sin(angles)])
        normals /= np.hypot(*normals.T)[:, None]
        points = ellipse.points_at(angles) + 0.1 * normals
        ratios = radial_residuals(points, ellipse) / orthogonal_residuals(points, ellipse)
        return float(ratios.max())

    return Pitfall(
        "“Absolute Euclidean distance” is not the distance to the ellipse",
        "The name means the nearest distance; Eqs. (2)-(4) measure along the ray from the centre.",
        "Two names, radial and orthogonal; the fit uses the orthogonal one, each point weighted "
        "by its error along the normal of the ellipse.",
        (
            Check("largest ratio of radial to orthogonal distance, φ = 10°", ratio(10)),
            Check("largest ratio of radial to orthogonal distance, φ = 30°", ratio(30)),
            Check("largest ratio of radial to orthogonal distance, φ = 60°", ratio(60)),
        ),
    )


def _demonstrate_two_axes() -> Pitfall:
    ellipse = Ellipse((0.0, -400.0), 19.0 / math.cos(math.radians(20)), 19.0, math.radians(20))
    first, second = ellipse.axis_twins
    axis_angle_deg = math.degrees(math.acos(float(first @ second)))
    sections = [_intersect_rays(axis) for axis in (first, second)]
    return Pitfall(
        "One section fits two pipes",
        "The paper's θ and φ are meant to give the orientation; a pipe leaning forwards and one "
        "leaning back by φ have the same section.",
        "One section returns both axes (axis_twins); two sections decide.",
        (
            Check("angle between the two axes at φ = 20°, degrees", axis_angle_deg),
            Check("largest difference of their sections, mm", float(
                np.abs(sections[0] - sections[1]).max())),
        ),
    )  # fmt: skip


def _intersect_rays(axis: FloatArray) -> FloatArray:
    """Return the distance (mm) in z = 0 from the axis of a 19 mm pipe to its surface, (360,)."""
    angles = np.radians(np.arange(360))
    directions = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(360)])
    perpendicular = directions - (directions @ axis)[:, None] * axis
    distances: FloatArray = 19.0 / np.linalg.norm(perpendicular, axis=1)
    return distances


def _demonstrate_division_by_zero() -> Pitfall:
    ellipse = Ellipse((0.0, -400.0), 22.0, 19.0, math.radians(20))
    inverse_height = math.hypot(math.sin(ellipse.theta) / 22.0, math.cos(ellipse.theta) / 19.0)
    top = np.array([[0.0, -400.0 + 1 / inverse_height]])
    arc_points = ellipse.points_at(np.radians(np.linspace(190, -30, 120)))
    not_increasing = int((np.diff(arc_points[:, 0]) <= 0).sum())
    resampled = _resample_spline_along_arc(arc_points)
    return Pitfall(
        "Eq. (4) divides by x − x₀, and the spline S(x) needs increasing x",
        "A point straight above the centre has no r_j, and an arc past its vertical flank has "
        "no S(x).",
        "Residuals in the ellipse's own frame; homogenising runs along the arc.",
        (
            Check("Eq. (4) at the point of the ellipse above its centre (should be 0)", float(
                evaluate_printed_equation_four(top, ellipse, ellipse.theta - math.pi / 2)[0])),
            Check("lsvision's radial residual there, mm", float(radial_residuals(top, ellipse)[0])),
            Check("points where x does not increase, of 120 on an arc past both vertical flanks",
                  not_increasing),
            Check("largest distance from the ellipse of a spline along that arc, mm", float(
                np.abs(orthogonal_residuals(resampled, ellipse)).max())),
        ),
    )  # fmt: skip


def _resample_spline_along_arc(points: Points) -> Points:
    """Return points at equal steps of arc length, by one spline for each coordinate."""
    from scipy.interpolate import CubicSpline

    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    resampled: Points = CubicSpline(length, points)(np.arange(0.0, length[-1], SPLINE_STEP_MM))
    return resampled


def _demonstrate_direction_of_y() -> Pitfall:
    radius = POSITION.radius_mm
    (section,) = simulate_case(POSITION, 0, METHODS["section"].poses, noise_mm=NOISE_MM)
    upright, sensor = section.profile.points, build_paper_sensor(NOISE_MM)
    reversed_y = Profile(upright * [1.0, -1.0])
    initial_error = float(np.nanmax(reversed_y.points[:, 1])) - radius - STANDOFF_MM
    return Pitfall(
        "Direction of Y",
        "The fit starts at y₀ = y_max − r, so Y grows towards the sensor; section 3.3 lets Y "
        "grow away from it.",
        "Y towards the sensor. A file whose range grows away from it is mirrored when it is read.",
        (
            Check("pipes found, Y towards the sensor", len(
                measure_cylinders(Profile(upright), radius=radius, sensor=sensor).cylinders)),
            Check("pipes found in the same profile, Y away from it", len(
                measure_cylinders(reversed_y, radius=radius).cylinders)),
            Check("distance of the paper's initial centre from the true one, mm",
                  abs(initial_error)),
        ),
    )  # fmt: skip
