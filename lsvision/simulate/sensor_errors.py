"""What goes wrong between a scene and its profile: grazing light, losses, jumps, noise.

Each draws as many random numbers whatever the scene, so that a change to one object leaves the
mishaps of the other columns as they were.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lsvision.geometry import FloatArray, Points
from lsvision.geometry.arrays import BoolArray
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.rays import Hits, Rays


@dataclass(frozen=True, kw_only=True, slots=True)
class SectionSettings:
    """What goes wrong between a scene and its profile.

    Parameters
    ----------
    rays : {"fan", "parallel"}
        Fan from the sensor's origin, equally spaced at its far limit; or parallel columns of
        equal pitch, as wide as the line is there.
    noise_factor : float
        True noise over what the sensor claims; 0 is noise-free.
    correlation_columns : float
        Length over which neighbours' errors are alike (standard deviation of the Gaussian that
        blends them); 0 is independent errors. Units: columns.
    lost_fraction : float
        Share of columns lost singly, at random.
    lost_runs, lost_run_columns : int
        Number of runs of neighbouring columns lost together, and the longest such run.
    jump_fraction : float
        Share of points displaced by a jump.
    jump_mm : tuple of float
        Smallest and largest jump, of either sign, along the ray. Units: mm.
    jump_pair_share : float
        Share of the jumps that also take the next column with them.
    grazing_limit_deg, grazing_ramp_deg : float
        Incidence beyond which every point is lost, and the stretch before it over which the
        chance of loss climbs from 0 to 1. Units: deg.
    camera : tuple of float, optional
        Second viewpoint, section frame: what it cannot see is lost. Units: mm.
    """

    rays: Literal["fan", "parallel"] = "fan"
    noise_factor: float = 1.0
    correlation_columns: float = 0.0
    lost_fraction: float = 0.03
    lost_runs: int = 0
    lost_run_columns: int = 6
    jump_fraction: float = 0.02
    jump_mm: tuple[float, float] = (2.0, 12.0)
    jump_pair_share: float = 0.3
    grazing_limit_deg: float = 82.0
    grazing_ramp_deg: float = 6.0
    camera: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.rays not in ("fan", "parallel"):
            raise ValueError(f"want rays 'fan' or 'parallel', got {self.rays!r}")
        for what in ("lost_fraction", "jump_fraction", "jump_pair_share"):
            if not 0 <= getattr(self, what) <= 1:
                raise ValueError(f"want {what} in [0, 1], got {getattr(self, what)}")
        for what in ("noise_factor", "correlation_columns", "grazing_ramp_deg", "lost_runs"):
            if not 0 <= getattr(self, what) < math.inf:
                raise ValueError(f"want {what} >= 0, got {getattr(self, what)}")
        if not 0 < self.jump_mm[0] <= self.jump_mm[1]:
            raise ValueError(f"want jump_mm (smallest, largest), got {self.jump_mm}")

    @classmethod
    def ideal(cls) -> "SectionSettings":
        """Nothing goes wrong: no noise, loss, jump or grazing limit."""
        return cls(noise_factor=0, lost_fraction=0, jump_fraction=0, grazing_limit_deg=90.0,
                   grazing_ramp_deg=0)  # fmt: skip


def noise_std(exact: Points, sensor: ProfileSensor) -> FloatArray:
    """One sigma along the ray: the sensor's, growing with the square of the range.

    Written out here a second time, not asked of the sensor: it is the truth the sensor's own
    noise model is held to.

    Parameters
    ----------
    exact : (n, 2) ndarray
        Noise-free points, section frame. Units: mm.
    sensor : ProfileSensor
        Noise at the reference range, and where the rays start.

    Returns
    -------
    (n,) ndarray
        Units: mm.
    """
    dx, dy = exact[:, 0] - sensor.origin[0], exact[:, 1] - sensor.origin[1]
    std: FloatArray = sensor.range_std * (dx * dx + dy * dy) / sensor.reference_range**2
    return std


def visible_at_incidence(
    hits: Hits, rays: Rays, settings: SectionSettings, rng: np.random.Generator
) -> BoolArray:
    """Which points survive their angle of incidence.

    Parameters
    ----------
    hits : Hits
        Normals are what counts.
    rays : Rays
        With unit directions, in the frame of the hits.
    settings : SectionSettings
        The limit and its ramp.
    rng : numpy.random.Generator
        One number a ray.

    Returns
    -------
    (n,) ndarray of bool
    """
    cosine = np.clip(-np.einsum("ij,ij->i", hits.normals, rays.directions), -1.0, 1.0)
    beyond = settings.grazing_limit_deg - np.degrees(np.arccos(cosine))
    ramp = max(settings.grazing_ramp_deg, 1e-9)
    kept: BoolArray = rng.random(len(cosine)) < beyond / ramp
    return kept


def lost_columns(columns: int, settings: SectionSettings, rng: np.random.Generator) -> BoolArray:
    """Columns lost at random, singly and in runs; one a column."""
    lost: BoolArray = rng.random(columns) < settings.lost_fraction
    for _ in range(settings.lost_runs):
        start = rng.integers(columns)
        lost[start : start + rng.integers(2, max(settings.lost_run_columns, 2) + 1)] = True
    return lost


def jumps_along(columns: int, settings: SectionSettings, rng: np.random.Generator) -> FloatArray:
    """Displacement of each column by a jump; 0 for most. Units: mm."""
    share = settings.jump_pair_share
    single = rng.random(columns) < settings.jump_fraction / (1 + share)
    paired = rng.random(columns) < share
    size = rng.uniform(*settings.jump_mm, columns) * rng.choice([-1.0, 1.0], columns)
    follows = np.concatenate([[False], (single & paired)[:-1]])
    jump: FloatArray = np.where(single, size, np.where(follows, np.roll(size, 1), 0.0))
    return jump


def correlated_unit_noise(
    columns: int, settings: SectionSettings, rng: np.random.Generator
) -> FloatArray:
    """Unit normal errors, blended along the line where they are correlated; one a column."""
    length = settings.correlation_columns
    if length == 0:
        return rng.standard_normal(columns)
    reach = math.ceil(4 * length)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / length) ** 2)
    white = rng.standard_normal(columns + 2 * reach)
    return np.convolve(white, weights / np.linalg.norm(weights), mode="valid")
