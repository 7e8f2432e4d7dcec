"""The function that measures profiles with the options of a command, in any process."""

from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lsvision.measure import Measurement
    from lsvision.profile import Profile
    from lsvision.sensors.profile_sensor import ProfileSensor


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
        model: it searches in the range `radius`, or around `known_radius`.

    Raises
    ------
    typer.BadParameter
        If a radius is not a number, not positive, or the range is reversed; if a tilt is not in
        [0, 90) deg; or with `paper` for a sensor, a tilt, or both `radius` and `known_radius`.
    """
    # These import typer, which the processes that run the function do not need.
    import typer

    from lsvision.cli.measure_options import parse_known_phi, parse_known_radius, parse_search_range

    search_range, known = parse_search_range(radius), parse_known_radius(known_radius)
    known_phi = parse_known_phi(known_phi_deg)
    if paper and (sensor is not None or known_phi is not None):
        raise typer.BadParameter(
            "expected --paper, or --sensor, --range-std or --known-phi-deg, got both: the paper's "
            "pipeline uses neither the noise nor a known tilt"
        )
    if paper and search_range is not None and known is not None:
        raise typer.BadParameter(
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
