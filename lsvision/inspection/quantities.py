"""Numbers of a measured cylinder that a job can limit, in the units of its keys."""

from __future__ import annotations

import math

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray
from lsvision.inspection.axis_relation import angle_between
from lsvision.inspection.job_tables import Part
from lsvision.inspection.limits import SCAN_KEYS, SECTION_KEYS, quantity_from_key
from lsvision.inspection.relate import MeasuredCylinder
from lsvision.inspection.uncertain import Length, Scalar, Uncertain
from lsvision.results.quantities import Estimate
from lsvision.scan.scan_result import ScannedCylinder
from lsvision.scan.shape import measure_shape
from lsvision.scan.shape_result import CylinderShape

KEYS_OF_AXIS = ("direction_deg", "position_mm", "point_x_mm", "point_y_mm", "point_z_mm")
"""Quantities of a scan that differ between the two twins of a cylinder in one section."""
KEYS_OF_RADIUS = ("radius_mm", "diameter_mm")
"""Quantities that differ, too, between those of short arcs on opposite sides, and that a known
radius determines."""

NEAR_ZERO_RATIO = 0.75
"""Ratio of the ends of phi's interval below which only the lower end may miss the true phi."""


def measure_quantity(cylinder: MeasuredCylinder, part: Part, key: str, level: float) -> Estimate:
    """Return a quantity of a cylinder with its interval at `level`, in the unit of its key.

    The key is one of `SECTION_KEYS` for a section, of `SCAN_KEYS` for a scan. Not determined: theta
    whose interval contains every direction; radius and phi of a section fitted with a known one;
    bow, taper and ovality of a cylinder in fewer than three sections, which are NaN; direction and
    position of a cylinder with a twin that fits equally well, as in one section, and its radius if
    that of the twin is another one. Each end of an interval misses with a probability of at most
    (1 - level) / 2, also that of a phi near 0.

    Raises
    ------
    ValueError
        If a measurement of this kind does not have the quantity.
    """
    if isinstance(cylinder, CylinderSection):
        return _measure_in_section(cylinder, part, key, level)
    if key not in SCAN_KEYS:
        raise ValueError(
            f"expected limits among {', '.join(SCAN_KEYS)} for a scan, got {key} of part "
            f"{part.name!r}: judge each profile by itself, or leave it out"
        )
    quantity = quantity_from_key(key)
    try:
        number = _measure_in_scan(cylinder, part, key)
    except DegenerateGeometry:  # a form deviation of too few sections
        return Estimate(quantity, math.nan, math.nan, (math.nan, math.nan), determined=False)
    value, std = number.value * quantity.scale, number.std * quantity.scale
    has_twin = cylinder.twin_has_other_radius if key in KEYS_OF_RADIUS else cylinder.ambiguous
    determined = not (has_twin and key in KEYS_OF_AXIS + KEYS_OF_RADIUS)
    return Estimate(
        quantity, value, std, quantity.convert_to_unit(number.interval(level)), determined
    )


def _measure_in_section(section: CylinderSection, part: Part, key: str, level: float) -> Estimate:
    """Return a quantity of a single section, for a key of `SECTION_KEYS`."""
    if key not in SECTION_KEYS:
        raise ValueError(
            f"expected limits among {', '.join(SECTION_KEYS)} for a profile, got {key} of part "
            f"{part.name!r}: a scan has it ([scan] in the job), or leave it out"
        )
    quantity = quantity_from_key(key)
    is_diameter = key == "diameter_mm"
    name = "radius" if is_diameter else quantity.name
    low, high = (
        _interval_of_phi(section, level) if key == "phi_deg" else section.interval(name, level)  # type: ignore[arg-type] # a key of SECTION_KEYS
    )
    if name.startswith("centre_"):
        axis = "xy".index(name[-1])
        value, std = section.centre[axis], math.sqrt(section.covariance[axis, axis])
    else:
        value, std = getattr(section, name), getattr(section, f"{name}_std")
    scale = 2.0 if is_diameter else quantity.scale
    # The interval of theta is (0, pi) where every direction is possible.
    determined = key != "theta_deg" or high - low < math.pi
    if key in KEYS_OF_RADIUS:
        determined = section.fit.problem.known_radius is None
    if key == "phi_deg":
        determined = section.fit.problem.known_phi is None
    return Estimate(quantity, scale * value, scale * std, (scale * low, scale * high), determined)


def _interval_of_phi(section: CylinderSection, level: float) -> tuple[float, float]:
    """Return an interval of phi of which each end misses with at most (1 - level) / 2. Units: rad.

    A phi of the size of its error is measured too large on average. Its interval then misses the
    true phi with probability 1 - level by lying above it, and never by lying below: the lower end
    is that of the interval at the level (1 + level) / 2.
    """
    low, high = section.interval("phi", level)
    if low < NEAR_ZERO_RATIO * high:
        low, _ = section.interval("phi", (1 + level) / 2)
    return low, high


def _measure_in_scan(cylinder: ScannedCylinder, part: Part, key: str) -> Uncertain:
    """Return a quantity of a scanned cylinder in mm, rad, mm/m or percent."""
    fit = cylinder.fit
    if key in ("radius_mm", "diameter_mm"):
        factor = 2.0 if key == "diameter_mm" else 1.0
        return Scalar(factor * fit.radius, factor * fit.radius_std, fit.degrees_of_freedom)
    if key == "direction_deg":
        return angle_between(fit, np.asarray(part.nominal_direction, dtype=np.float64))
    if key == "length_seen_mm":
        start, stop = cylinder.axial_range
        variance = math.hypot(*cylinder.axial_range_std) ** 2 - 2 * cylinder.axial_range_covariance
        return Scalar(stop - start, math.sqrt(max(variance, 0.0)))
    if key in ("bow_mm", "taper_mm_per_m", "ovality_percent"):
        return _measure_form(measure_shape(cylinder), key)
    return _measure_position(cylinder, part, key)


def _measure_position(cylinder: ScannedCylinder, part: Part, key: str) -> Uncertain:
    """Return the distance of the axis from the nominal point, or a coordinate of the axis.

    The coordinate is that of the axis point nearest to the nominal point; without a nominal point,
    of ``cylinder.point``.
    """
    nominal_point = (
        cylinder.point if part.nominal_point_mm is None else np.array(part.nominal_point_mm)
    )
    fit = cylinder.fit.with_reference_point(nominal_point)
    basis, covariance = fit.tangent_basis, fit.covariance[:2, :2]
    if key == "position_mm":
        return Length(basis @ (fit.point - nominal_point), covariance, fit.degrees_of_freedom)
    axis = "xyz".index(quantity_from_key(key).name[-1])
    gradient: FloatArray = basis[:, axis]
    std = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
    return Scalar(float(fit.point[axis]), std, fit.degrees_of_freedom)


def _measure_form(shape: CylinderShape, key: str) -> Uncertain:
    """Return bow (mm), ovality (percent) or taper (mm per m) of a scanned cylinder."""
    if key == "bow_mm":
        return Length(shape.bow.values, shape.bow.covariance)
    if key == "ovality_percent":
        # Percent of the mean diameter; largest minus smallest diameter is 4 times the amplitude.
        factor = 100 * 4 / (2 * shape.radius)
        terms = shape.ovality_terms
        return Length(factor * terms.values, factor**2 * terms.covariance)
    std = 1e3 * shape.taper.size_std / shape.half_length
    return Scalar(1e3 * shape.taper_slope, std)
