"""Options of a measurement: their values, and the function that measures profiles with them.

This module does not import typer, which the processes that run the function do not need.
"""

import math
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.sensors.profile_sensor import ProfileSensor


def parse_search_range(text: str | None) -> float | tuple[float, float] | None:
    """Return the search range of ``--radius`` in mm, from ``min:max`` or a nominal radius."""
    if text is None:
        return None
    low, high = _parse_pair(text, "--radius 19 or --radius 10:40")
    if low <= 0 or (high is not None and not low < high):
        raise _build_usage_error(f"expected --radius above 0 mm, min:max, got {text!r}")
    return low if high is None else (low, high)


def parse_known_radius(text: str | None) -> float | tuple[float, float] | None:
    """Return the prior of ``--known-radius`` in mm, from ``radius`` or ``radius:std``."""
    if text is None:
        return None
    radius, std = _parse_pair(text, "--known-radius 19 or --known-radius 19:0.05")
    if radius <= 0 or (std is not None and std <= 0):
        raise _build_usage_error(f"expected --known-radius and its sigma above 0 mm, got {text!r}")
    return radius if std is None else (radius, std)


def parse_known_phi(text: str | None) -> float | tuple[float, float] | None:
    """Return the prior of ``--known-phi-deg`` in rad, from ``tilt`` or ``tilt:std`` in deg."""
    if text is None:
        return None
    phi_deg, std_deg = _parse_pair(text, "--known-phi-deg 0 or --known-phi-deg 0:2", "deg")
    if not 0 <= phi_deg < 90 or (std_deg is not None and std_deg <= 0):
        raise _build_usage_error(
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
        raise _build_usage_error(f"expected {expected} in {unit}, got {text!r}")
    return numbers[0], numbers[1] if len(numbers) == 2 else None


def _build_usage_error(message: str) -> Exception:
    import typer

    return typer.BadParameter(message)


def build_measure_function(
    radius: str | None = None,
    known_radius: str | None = None,
    known_phi_deg: str | None = None,
    sensor: "ProfileSensor | None" = None,
    *,
    paper: bool = False,
) -> "partial[list[Measurement]]":
    """Return a function that measures profiles with the values of the options.

    The values are those of ``--radius``, ``--known-radius`` and ``--known-phi-deg``. With `paper`
    it is the paper's pipeline as published, which has no priors and no noise model: it searches in
    the range `radius`, or around `known_radius`.

    Raises
    ------
    typer.BadParameter
        If a radius is not a number, not positive, or the range is reversed; if a tilt is not in
        [0, 90) deg; or with `paper` for a sensor, a tilt, or both `radius` and `known_radius`.
    """
    search_range, known = parse_search_range(radius), parse_known_radius(known_radius)
    known_phi = parse_known_phi(known_phi_deg)
    if paper and (sensor is not None or known_phi is not None):
        raise _build_usage_error(
            "expected --paper, or --sensor, --range-std or --known-phi-deg, got both: the paper's "
            "pipeline uses neither the noise nor a known tilt"
        )
    if paper and search_range is not None and known is not None:
        raise _build_usage_error(
            "expected --paper with --radius or --known-radius, got both: the paper's pipeline only "
            "searches in a range"
        )
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
