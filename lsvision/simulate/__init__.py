"""Simulate profiles, images and calibration data with known truth.

The package imports none of the code that is tested with its data.
"""

from lsvision.simulate.scene import CLUTTER, NOTHING, Scene, SectionTruth, Solid, TubeTruth
from lsvision.simulate.scene_kinds import (
    SCENE_KINDS,
    SCENE_SENSOR,
    TubeRanges,
    random_section,
)
from lsvision.simulate.section import (
    SectionSettings,
    SimulatedSection,
    simulate_scan,
    simulate_section,
)
from lsvision.simulate.solids import BentTube, Prism, Rays, Tube

__all__ = [
    "CLUTTER",
    "NOTHING",
    "SCENE_KINDS",
    "SCENE_SENSOR",
    "BentTube",
    "Prism",
    "Rays",
    "Scene",
    "SectionSettings",
    "SectionTruth",
    "SimulatedSection",
    "Solid",
    "Tube",
    "TubeRanges",
    "TubeTruth",
    "random_section",
    "simulate_scan",
    "simulate_section",
]
