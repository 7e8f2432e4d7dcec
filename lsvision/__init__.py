"""Radius and orientation of cylinders from a light section, each number with its uncertainty.

The public names, in the order of the data flow. Each is imported from its room on first use,
so that ``lsvision --help`` does not wait for numpy, OpenCV and scipy.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lsvision.errors import LsvisionError as LsvisionError
    from lsvision.profile import Arc as Arc
    from lsvision.profile import NoiseModel as NoiseModel
    from lsvision.profile import PointNoise as PointNoise
    from lsvision.profile import Profile as Profile
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
    "ProfileSensor": "lsvision.sensor.profile_sensor",
    "LPS36": "lsvision.sensor.profile_sensor",
    "LPS36HI": "lsvision.sensor.profile_sensor",
    "LsvisionError": "lsvision.errors",
}

__all__ = list(_ROOMS)


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module 'lsvision' has no attribute '{name}'")
    return getattr(importlib.import_module(_ROOMS[name]), name)


def __dir__() -> list[str]:
    return __all__
