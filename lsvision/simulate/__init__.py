"""Truth to data; imports none of the code that it validates."""

from lsvision.simulate.bent_tube import BentTube
from lsvision.simulate.prism import Prism
from lsvision.simulate.rays import Rays
from lsvision.simulate.scene import CLUTTER, NOTHING, Scene, Solid
from lsvision.simulate.scene_kinds import (
    SCENE_KINDS,
    SCENE_SENSOR,
    TubeRanges,
    random_section,
)
from lsvision.simulate.section import SimulatedSection, simulate_scan, simulate_section
from lsvision.simulate.sensor_errors import SectionSettings
from lsvision.simulate.truth import SectionTruth, TubeTruth
from lsvision.simulate.tube import Tube

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
