"""Text on the cylinders and the rejections of a result."""

from collections.abc import Sequence
from typing import Protocol

from lsvision.results.number_format import format_value


class HasRadius(Protocol):
    """Cylinder whose radius has a standard uncertainty."""

    @property
    def radius(self) -> float:
        """Radius. Units: mm."""

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm."""


def format_count(count: int, noun: str) -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> format_count(1, "arc"), format_count(2, "arc")
    ('1 arc', '2 arcs')
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"


def summarise_cylinders(cylinders: Sequence[HasRadius]) -> str:
    """Return the number of cylinders and their radii.

    Examples
    --------
    >>> summarise_cylinders(())
    '0 cylinders'
    """
    radii = ", ".join(f"radius {format_value(c.radius, c.radius_std)} mm" for c in cylinders)
    return format_count(len(cylinders), "cylinder") + (f" ({radii})" if radii else "")


def list_rejections(rejections: Sequence[object], noun: str, *, has_cylinders: bool) -> list[str]:
    """Return lines with the number of rejections, and each of them if no cylinder was found.

    The noun is that of a rejected item, in the singular.

    Examples
    --------
    >>> list_rejections(["points 3 to 9: too short"], "arc", has_cylinders=True)
    ['1 arc rejected: see .rejections']
    >>> list_rejections(["points 3 to 9: too short"], "arc", has_cylinders=False)
    ['no cylinder found, 1 arc rejected', '  points 3 to 9: too short']
    """
    rejected = f"{format_count(len(rejections), noun)} rejected"
    if has_cylinders:
        return [f"{rejected}: see .rejections"] if rejections else []
    return [f"no cylinder found, {rejected}", *(f"  {rejection!s}" for rejection in rejections)]
