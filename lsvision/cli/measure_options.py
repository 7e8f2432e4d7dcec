"""Values of the options of a measurement; an invalid value is a usage error."""

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.sensors.profile_sensor import ProfileSensor

RANGE_WARNING_FACTOR = 3.0
"""Factor beyond the limits of a sensor's range from which a warning is given."""


def build_measure_function(
    radius: str | None = None,
    known_radius: str | None = None,
    known_phi_deg: str | None = None,
    sensor: "ProfileSensor | None" = None,
    *,
    paper: bool = False,
) -> "partial[list[Measurement]]":
    """Return a function that measures profiles with the values of the options.

    Parameters
    ----------
    radius : str, optional
        Search range, ``10:40``, or nominal radius, ``19``. Units: mm.
    known_radius : str, optional
        Known radius, ``19``, or with its std, ``19:0.05``. Units: mm.
    known_phi_deg : str, optional
        Known tilt, ``0``, or with its std, ``0:2``. Units: deg.
    sensor : ProfileSensor, optional
        Noise of the points.
    paper : bool
        Whether to measure by the paper's pipeline as published, which has no priors and no noise
        model: of the options only the search range has an effect, or, without one, that about the
        known radius.

    Raises
    ------
    typer.BadParameter
        If a radius is not a number, not positive, or the range is reversed; or if a tilt is not in
        [0, 90) deg.
    """
    search_range, known = parse_search_range(radius), parse_known_radius(known_radius)
    known_phi = parse_known_phi(known_phi_deg)
    if paper:
        return partial(_measure_profiles_paper, radius=search_range, known_radius=known)
    return partial(
        _measure_profiles,
        radius=search_range,
        known_radius=known,
        known_phi=known_phi,
        sensor=sensor,
    )


def _measure_profiles(profiles: "Sequence[Profile]", **options: Any) -> "list[Measurement]":
    """Measure profiles; the packages for that are imported by the processes that measure."""
    from lsvision.measure import measure_profiles

    return measure_profiles(profiles, **options)


def _measure_profiles_paper(
    profiles: "Sequence[Profile]",
    radius: float | tuple[float, float] | None,
    known_radius: float | tuple[float, float] | None,
) -> "list[Measurement]":
    """Measure profiles by the paper's pipeline, one by one."""
    from lsvision.studies.chen_liu_2016 import measure_cylinders_paper

    return [
        measure_cylinders_paper(profile, radius=radius, known_radius=known_radius)
        for profile in profiles
    ]


def range_warning(profile: "Profile", sensor: "ProfileSensor | None") -> str | None:
    """Return a warning if the profile lies far outside the range of the sensor; else None.

    The noise grows with the distance from the sensor; it is wrong if heights are not measured from
    the sensor, but from the middle of its range, for example.

    Parameters
    ----------
    profile : Profile
        Profile with at least one point.
    sensor : ProfileSensor, optional
        Sensor with its range; None gives no warning.
    """
    if sensor is None:
        return None
    import numpy as np

    distance = float(np.nanmedian(np.hypot(*(profile.points - sensor.origin).T)))
    if (
        sensor.min_range / RANGE_WARNING_FACTOR
        <= distance
        <= sensor.max_range * RANGE_WARNING_FACTOR
    ):
        return None
    return (
        f"the points lie {distance:.3g} mm from the origin, the sensor measures at "
        f"{sensor.min_range:g} to {sensor.max_range:g} mm: check that heights start at the sensor"
    )


def parse_search_range(text: str | None) -> float | tuple[float, float] | None:
    """Return the search range of ``--radius`` in mm, from ``min:max`` or a nominal radius."""
    if text is None:
        return None
    low, high = _parse_pair(text, "--radius 19 or --radius 10:40")
    if low <= 0 or (high is not None and not low < high):
        raise typer.BadParameter(f"expected --radius above 0 mm, min:max, got {text!r}")
    return low if high is None else (low, high)


def parse_known_radius(text: str | None) -> float | tuple[float, float] | None:
    """Return the prior of ``--known-radius`` in mm, from ``radius`` or ``radius:std``."""
    if text is None:
        return None
    radius, std = _parse_pair(text, "--known-radius 19 or --known-radius 19:0.05")
    if radius <= 0 or (std is not None and std <= 0):
        raise typer.BadParameter(f"expected --known-radius and its sigma above 0 mm, got {text!r}")
    return radius if std is None else (radius, std)


def parse_known_phi(text: str | None) -> float | tuple[float, float] | None:
    """Return the prior of ``--known-phi-deg`` in rad, from ``tilt`` or ``tilt:std`` in deg."""
    if text is None:
        return None
    phi_deg, std_deg = _parse_pair(text, "--known-phi-deg 0 or --known-phi-deg 0:2", "deg")
    if not 0 <= phi_deg < 90 or (std_deg is not None and std_deg <= 0):
        raise typer.BadParameter(
            f"expected --known-phi-deg from 0 to below 90 deg and its sigma above 0, got {text!r}"
        )
    phi = math.radians(phi_deg)
    return phi if std_deg is None else (phi, math.radians(std_deg))


def _parse_pair(text: str, expected: str, unit: str = "mm") -> tuple[float, float | None]:
    """Return one finite number and None, or two finite numbers with a colon between them.

    `expected` and `unit` are for the error message.
    """
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(map(math.isfinite, numbers)):
        raise typer.BadParameter(f"expected {expected} in {unit}, got {text!r}")
    return numbers[0], numbers[1] if len(numbers) == 2 else None
