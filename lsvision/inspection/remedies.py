"""Remedies for undecided quantities: the shortest scan that is predicted to be precise enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.errors import LsvisionError
from lsvision.inspection.decision import Decision, QuantityVerdict
from lsvision.inspection.job import Job
from lsvision.inspection.uncertain import two_sided_factor
from lsvision.inspection.verdict import Verdict
from lsvision.measure import Measurement
from lsvision.planning import Feed, ScanPrediction, SensorView, plan_scan, plan_section
from lsvision.results.number_format import format_std
from lsvision.sensors.profile_sensor import ProfileSensor

SECTION_COUNTS = (2, 3, 5, 10, 20)
"""Numbers of sections that are tried."""
SPACING_MM = 10.0
"""Distance of neighbouring sections of a planned scan. Units: mm."""
PLANNED_KEYS = ("radius_mm", "diameter_mm", "theta_deg", "phi_deg")
"""Keys of the quantities whose uncertainty the planner predicts."""
MIN_STANDOFF_RADII = 3.0
"""Smallest distance from the sensor to the centre of a part that is planned with. Units: radii."""
NUMBER_WORDS = {2: "two", 3: "three", 5: "five"}
"""Words for the numbers of `SECTION_COUNTS` below ten."""


@dataclass(frozen=True)
class Remedy:
    """Measurement that would decide a quantity, if its value does not change.

    Parameters
    ----------
    item, quantity : str
        Part and key.
    sections : int, optional
        Number of sections of a scan, `SPACING_MM` apart; None if none of `SECTION_COUNTS` is
        enough, or nothing can be predicted.
    std : float
        Standard uncertainty that is predicted for this scan, in the unit of the key; NaN without
        `sections`.
    text : str
        Description of the measurement.
    """

    item: str
    quantity: str
    sections: int | None
    std: float
    text: str

    def __str__(self) -> str:
        name = self.quantity.rpartition("_")[0].replace("_", " ")
        return f"{self.item}, {name}: {self.text}"


def plan_remedies(verdict: Verdict, measurement: Measurement, job: Job) -> tuple[Remedy, ...]:
    """Plan a scan that would decide each undecided quantity of a profile's parts.

    The quantities are radius, diameter, theta and phi. The planner is given the noise, pitch and
    position of the measured part; its predictions are scaled such that, for one section, the std of
    the radius is at least the measured one.
    """
    remedies = []
    for item in verdict.parts:
        for quantity in item.quantities:
            undecided = quantity.decision == Decision.UNDECIDED and quantity.key in PLANNED_KEYS
            if undecided and item.cylinder is not None:
                section = measurement.cylinders[item.cylinder]
                remedies.append(_plan_remedy(item.name, quantity, section, job))
    return tuple(remedies)


def _plan_remedy(item: str, verdict: QuantityVerdict, section: CylinderSection, job: Job) -> Remedy:
    """Return the shortest scan that would decide a quantity, or why none would."""
    key, extra = verdict.key, job.extra_std(verdict.key)
    if not verdict.estimate.determined:
        reason = "no prediction: without a value its distance from the limit is not known"
        return Remedy(item, key, None, math.nan, reason)
    distance = min(abs(verdict.estimate.value - limit) for limit in verdict.limits)
    permitted = distance / two_sided_factor(job.decision.level)
    if permitted <= extra:
        reason = (
            f"no scan would decide: the limit is nearer than extra_std alone ({extra:g}) allows"
            if extra > 0
            else "no scan would decide: the value lies at the limit"
        )
        return Remedy(item, key, None, math.nan, reason)
    max_std = math.sqrt(permitted**2 - extra**2)
    name, unit = verdict.estimate.quantity.name, verdict.estimate.quantity.unit_text
    try:
        scan = _find_shortest_scan(section, key, max_std)
    except (LsvisionError, ValueError) as failure:
        return Remedy(item, key, None, math.nan, f"no prediction: {failure}")
    if scan is None:
        text = (
            f"{SECTION_COUNTS[-1]} sections {SPACING_MM:g} mm apart would not decide: {name} needs "
            f"± {max_std:.2g} {unit}"
        )
        return Remedy(item, key, None, math.nan, text)
    sections, std = scan
    text = (
        f"{NUMBER_WORDS.get(sections, str(sections))} sections {SPACING_MM:g} mm apart would "
        f"decide: {name} ± {format_std(std)} {unit}"
    )
    if key in ("theta_deg", "phi_deg"):  # no limits of a scan
        text += " (direction_deg in a job with [scan])"
    return Remedy(item, key, sections, std, text)


def _find_shortest_scan(
    section: CylinderSection, key: str, max_std: float
) -> tuple[int, float] | None:
    """Return number of sections and predicted std of the shortest scan with at most `max_std`.

    None if none of `SECTION_COUNTS` is enough. Stds are in the unit of the key.
    """
    std_ratio = _std_ratio(section)
    for sections in SECTION_COUNTS:
        std = std_ratio * _predict_std(section, key, sections)
        if std <= max_std:
            return sections, std
    return None


def _std_ratio(section: CylinderSection) -> float:
    """Return the ratio of measured to predicted std of a section's radius, at least 1."""
    predicted = plan_section(
        section.radius, section.theta, section.phi, view=_build_measured_view(section)
    ).radius_std
    return max(section.radius_std / predicted, 1.0)


def _predict_std(section: CylinderSection, key: str, sections: int) -> float:
    """Return the predicted std of a quantity from a scan, in the unit of its key."""
    feed = Feed(sections=sections, spacing=SPACING_MM)
    scan: ScanPrediction = plan_scan(
        section.radius, section.theta, section.phi, view=_build_measured_view(section), feed=feed
    )
    return {
        "radius_mm": scan.radius_std,
        "diameter_mm": 2 * scan.radius_std,
        "theta_deg": math.degrees(scan.theta_std),
        "phi_deg": math.degrees(scan.phi_std),
    }[key]


def _build_measured_view(section: CylinderSection) -> SensorView:
    """Return the view in which the section was measured: its noise, pitch and position."""
    problem = section.fit.problem
    noise = float(np.median(problem.stds)) * math.sqrt(section.fit.variance_factor)
    x, y = section.centre
    # In some profiles y is measured from a reference plane near the part instead of the sensor.
    standoff = max(abs(y), MIN_STANDOFF_RADII * section.radius)
    # The limits of the sensor's field are not known: they are chosen such that it contains all of
    # the part, also where a tilted part moves through the field along a scan.
    farthest = standoff + 3 * section.radius
    sensor = ProfileSensor(
        name="as measured",
        range_std=max(noise, 1e-6),
        reference_range=standoff,
        min_range=1e-3 * farthest,
        max_range=2 * farthest,
        width_at_max_range=8 * (abs(x) + 3 * section.radius),
    )
    pitch = float(np.median(np.abs(np.diff(problem.points[:, 0]))))
    return SensorView(sensor=sensor, standoff=standoff, offset=x, pitch=pitch)
