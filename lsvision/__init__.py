"""Radius and orientation of cylinders from a light section, each number with its uncertainty.

The public names, in the order of the data flow. Each is imported from its room on first use,
so that ``lsvision --help`` does not wait for numpy, OpenCV and scipy.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lsvision import simulate as simulate
    from lsvision.errors import LsvisionError as LsvisionError
    from lsvision.fitting.cylinder_section import CylinderSection as CylinderSection
    from lsvision.io.profiles import inspect_profiles as inspect_profiles
    from lsvision.io.profiles import read_profile as read_profile
    from lsvision.io.profiles import read_profiles as read_profiles
    from lsvision.measure import Measurement as Measurement
    from lsvision.measure import Settings as Settings
    from lsvision.measure import measure_cylinders as measure_cylinders
    from lsvision.planning import plan_scan as plan_scan
    from lsvision.planning import plan_section as plan_section
    from lsvision.planning import sections_needed as sections_needed
    from lsvision.profile import Arc as Arc
    from lsvision.profile import NoiseModel as NoiseModel
    from lsvision.profile import PointNoise as PointNoise
    from lsvision.profile import Profile as Profile
    from lsvision.recognition.verdict import Rejection as Rejection
    from lsvision.sensor.profile_sensor import LPS36 as LPS36
    from lsvision.sensor.profile_sensor import LPS36HI as LPS36HI
    from lsvision.sensor.profile_sensor import ProfileSensor as ProfileSensor
    from lsvision.shapes import Cylinder as Cylinder
    from lsvision.shapes import Ellipse as Ellipse
    from lsvision.shapes import Plane as Plane
    from lsvision.shapes import Pose as Pose

_ROOMS = {
    "Pose": "lsvision.shapes",
    "Plane": "lsvision.shapes",
    "Ellipse": "lsvision.shapes",
    "Cylinder": "lsvision.shapes",
    "Profile": "lsvision.profile",
    "Arc": "lsvision.profile",
    "NoiseModel": "lsvision.profile",
    "PointNoise": "lsvision.profile",
    "read_profile": "lsvision.io.profiles",
    "read_profiles": "lsvision.io.profiles",
    "inspect_profiles": "lsvision.io.profiles",
    "ProfileSensor": "lsvision.sensor.profile_sensor",
    "LPS36": "lsvision.sensor.profile_sensor",
    "LPS36HI": "lsvision.sensor.profile_sensor",
    "measure_cylinders": "lsvision.measure",
    "Measurement": "lsvision.measure",
    "Settings": "lsvision.measure",
    "CylinderSection": "lsvision.fitting.cylinder_section",
    "Rejection": "lsvision.recognition.verdict",
    "plan_section": "lsvision.planning",
    "plan_scan": "lsvision.planning",
    "sections_needed": "lsvision.planning",
    "LsvisionError": "lsvision.errors",
}

__all__ = [*_ROOMS, "simulate"]  # noqa: PLE0604 - one table, not two lists to keep alike


def __getattr__(name: str) -> Any:
    if name == "simulate":
        return importlib.import_module("lsvision.simulate")
    if name not in _ROOMS:
        raise AttributeError(f"module 'lsvision' has no attribute '{name}'")
    return getattr(importlib.import_module(_ROOMS[name]), name)


def __dir__() -> list[str]:
    return __all__
