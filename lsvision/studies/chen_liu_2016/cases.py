"""Simulation of the pipes and welded pairs in the paper's Tables 1-4.

The conditions are ideal: nothing else in view, parallel rays 0.6 mm apart, errors along the ray,
points lost only beyond 70 deg of incidence.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lsvision.geometry import Ellipse, Pose
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import Scene, SectionSettings, SimulatedSection, Tube, simulate_scan
from lsvision.simulate.welds import build_weld_bead, compute_touching_centre
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_ROWS, PublishedRow

PITCH_MM = 0.6
"""Section 4 of the paper: resolution along the line. Units: mm."""
STANDOFF_MM = 400.0
"""Distance of the pipes from the sensor. Units: mm."""
COLUMNS = 375
"""Number of points of a full profile."""
INCIDENCE_LIMIT_DEG = 70.0
"""Largest angle of incidence at which a point is measured. Units: deg."""
BEAD_LEG = 0.5
"""Length of a weld bead along each pipe's surface, in radii."""

SECTION_SETTINGS = SectionSettings(
    rays="parallel",
    lost_fraction=0,
    jump_fraction=0,
    grazing_limit_deg=INCIDENCE_LIMIT_DEG,
    grazing_ramp_deg=0,
)
"""Errors of the sensor: noise and loss at grazing incidence; no other lost points, no jumps."""


def build_paper_sensor(noise_mm: float) -> ProfileSensor:
    """Return the paper's sensor: pitch 0.6 mm, std `noise_mm` along the ray at 400 mm."""
    return ProfileSensor(
        name="the paper's sensor, simulated",
        range_std=noise_mm,
        columns=COLUMNS,
        min_range=300.0,
        max_range=500.0,
        width_at_max_range=PITCH_MM * (COLUMNS - 1),
    )


@dataclass(frozen=True, slots=True)
class Case:
    """Object of one measurement of the paper: a pipe, or a welded pair.

    Parameters
    ----------
    rows : tuple of PublishedRow
        Row of each pipe, from left to right; the k-th pipe has the label k in the scene.
    """

    rows: tuple[PublishedRow, ...]

    @property
    def radius_mm(self) -> float:
        """Radius of all pipes. Units: mm."""
        return self.rows[0].radius_mm

    @property
    def scene(self) -> Scene:
        """Scene of the pipes, with theta and phi in the section z = 0; a pair has a weld bead."""
        ellipses = [_build_section(row) for row in self.rows]
        if len(ellipses) == 1:
            return Scene((_build_tube(self.rows[0], (0.0, -STANDOFF_MM)),))
        left, right = ellipses
        distance, _ = compute_touching_centre(left, right, 0.0)
        centres = [(x, -STANDOFF_MM) for x in (-distance / 2, distance / 2)]
        tubes = [_build_tube(row, centre) for row, centre in zip(self.rows, centres, strict=True)]
        x, y, z = tubes[0].cylinder.direction
        sections = [tube.cylinder.section() for tube in tubes]
        leg = BEAD_LEG * self.radius_mm
        # A bulge of 0 is a concave fillet, as in the paper's Figure 12.
        bead = build_weld_bead(*sections, leg=leg, bulge=0.0, along=(float(x), float(y), float(z)))
        return Scene((*tubes, bead))


def list_paper_cases() -> tuple[Case, ...]:
    """Return the twelve pipes of Tables 1-3 and the three pairs of Table 4."""
    singles = [Case((row,)) for row in PUBLISHED_ROWS if row.table < 4]
    pairs = [
        Case((first, second))
        for first, second in pairwise(PUBLISHED_ROWS)
        if first.table == 4 and first.number == 1
    ]
    return (*singles, *pairs)


def simulate_case(
    case: Case,
    seed: int,
    poses: tuple[Pose, ...],
    *,
    noise_mm: float,
) -> tuple[SimulatedSection, ...]:
    """Simulate the sections of a case at poses in the base frame.

    The same arguments give the same sections. The noise is the standard deviation along the ray, in
    mm.
    """
    row = case.rows[0]
    numbers = [seed, row.table, row.number, round(row.phi_deg), len(poses)]
    rng = np.random.default_rng(numbers)
    return simulate_scan(case.scene, poses, build_paper_sensor(noise_mm), SECTION_SETTINGS, rng=rng)


def _build_section(row: PublishedRow) -> Ellipse:
    """Return the section of a row's pipe, centred at the origin."""
    phi = math.radians(row.phi_deg)
    major = row.radius_mm / math.cos(phi)
    return Ellipse((0.0, 0.0), major, row.radius_mm, math.radians(row.theta_deg))


def _build_tube(row: PublishedRow, centre: tuple[float, float]) -> Tube:
    """Return a row's pipe with the centre of its section at (x, y) in mm."""
    return Tube.of(row.radius_mm, math.radians(row.theta_deg), math.radians(row.phi_deg), centre)
