"""The shape of a tube in words and numbers."""

from typing import TYPE_CHECKING

from lsvision.results.number_format import format_value

if TYPE_CHECKING:
    from lsvision.scan.shape import FormDeviation, TubeShape

SIGNIFICANCE = 0.01
"""Level of the tests of shape."""


def shape_lines(shape: "TubeShape") -> list[str]:
    """Bow, taper and ovality with one sigma, a line each, and whether chance makes as much."""
    bow = (
        f"{format_value(shape.bow.size, shape.bow.size_std)} mm over {2 * shape.half_length:.0f} mm"
    )
    if shape.bow.is_significant(SIGNIFICANCE):
        bow += f", a radius of {format_value(shape.bow_radius / 1e3, shape.bow_radius_std / 1e3)} m"
    slope = 1e3 * shape.taper_slope
    slope_std = 1e3 * shape.taper.size_std / shape.half_length
    ovality = format_value(100 * shape.ovality, 100 * shape.ovality_std)
    return [
        f"bow {bow} ({_verdict(shape.bow)})",
        f"taper {format_value(slope, slope_std)} mm/m ({_verdict(shape.taper)})",
        f"ovality {ovality} % ({_verdict(shape.ovality_terms)})",
    ]


def _verdict(deviation: "FormDeviation") -> str:
    return "significant" if deviation.is_significant(SIGNIFICANCE) else "not significant"
