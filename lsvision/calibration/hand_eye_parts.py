"""Parts of the result of a hand-eye calibration: kind of sensor, target, and rejected poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import freeze_arrays
from lsvision.geometry.equality import ComparedByValue

Sensor = Literal["section", "camera"]


@dataclass(frozen=True, eq=False)
class Sphere(ComparedByValue):
    """Sphere that was the target of a calibration.

    Parameters
    ----------
    centre : (3,) array_like
        Centre in the base frame (eye in hand) or flange frame (eye to hand). Units: mm.
    radius : float
        Radius of the sphere. Units: mm.
    radius_std : float
        Standard deviation of the radius; 0 if the radius was given. Units: mm.
    """

    centre: FloatArray
    radius: float
    radius_std: float

    def __post_init__(self) -> None:
        freeze_arrays(self, centre=(3,))


@dataclass(frozen=True)
class RejectedPose:
    """Index of a pose and the reason for its rejection.

    Parameters
    ----------
    index : int
        Index of the pose, from 0.
    reason : str
        Reason in words, with numbers.
    """

    index: int
    reason: str
