"""Values of the options of a measurement; an invalid value is a usage error."""

import math

import typer


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
