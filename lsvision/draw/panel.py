"""Panel next to a drawing: values of each cylinder, and reasons of the rejected arcs."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.draw.rejected import RejectedArc
from lsvision.ellipse.section import CylinderSection
from lsvision.results.number_format import with_minus_signs
from lsvision.results.palette import cylinder_colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADING = "black"
"""Colour of headings, which are bold."""

LEFT, TOP, LINE = 0.685, 0.865, 0.0225
"""Left and top of the panel and height of its lines, as fractions of the figure."""
COLUMNS, LINES = 48, 31
"""Number of characters of a line, and of lines, that fit."""
MAX_FULL_CYLINDERS = 4
"""Number of cylinders above which each gets two lines."""

LEGEND = (
    "θ: direction of the major axis, from X towards Y\n"
    "φ: tilt of the cylinder from the laser plane's normal\n"
    "± one sigma"
)


def draw_panel(
    figure: "Figure", cylinders: Sequence[CylinderSection], rejected: Sequence[RejectedArc]
) -> None:
    """Write the panel into the right third of a figure.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write into.
    cylinders : sequence of CylinderSection
        Cylinders, numbered from 1 in this order.
    rejected : sequence of RejectedArc
        Rejected arcs in the order of their letters.
    """
    lines = [*_cylinder_lines(cylinders), *_rejected_lines(rejected)]
    if len(lines) > LINES:
        left_out = len(lines) - LINES + 1
        lines = [
            *lines[: LINES - 1],
            (f"... {left_out} more lines: see lsvision measure -v", "0.3"),
        ]
    for row, (line, colour) in enumerate(lines):
        weight = "bold" if colour == HEADING else "normal"
        figure.text(LEFT, TOP - row * LINE, with_minus_signs(line), color=colour, fontsize=9,
                    va="top", family="monospace", weight=weight, parse_math=False)  # fmt: skip
    figure.text(LEFT, 0.085, LEGEND, color="0.3", fontsize=8, va="bottom", parse_math=False)


def _cylinder_lines(cylinders: Sequence[CylinderSection]) -> list[tuple[str, str]]:
    """Return the panel's lines on the cylinders with their colours, shorter ones for many."""
    if not cylinders:
        return [("No cylinder found", HEADING), ("", HEADING)]
    lines = [("Cylinders", HEADING)]
    for number, cylinder in enumerate(cylinders, 1):
        texts = _value_lines(cylinder)
        if len(cylinders) > MAX_FULL_CYLINDERS:
            texts = [f"{texts[0]}, {texts[2]}", texts[1]]
        prefixes = [f"{number:<3}", *["   "] * (len(texts) - 1)]
        colour = cylinder_colour(number)
        lines += [
            (f"{prefix} {text}", colour) for prefix, text in zip(prefixes, texts, strict=True)
        ]
        if len(cylinders) <= MAX_FULL_CYLINDERS:
            lines.append(("", HEADING))
    return lines if len(cylinders) <= MAX_FULL_CYLINDERS else [*lines, ("", HEADING)]


def _value_lines(cylinder: CylinderSection) -> list[str]:
    """Return the values of a cylinder as four lines of text."""
    radius, theta, phi, *_ = cylinder.estimates
    x, y = cylinder.centre
    return [
        f"r = {radius.text} mm",
        f"θ = {theta.text}°" if theta.determined else f"θ {theta.text}",
        f"φ = {phi.text}°",
        f"centre ({x:.2f}, {y:.2f}) mm, {len(cylinder.indices)} points",
    ]


def _rejected_lines(rejected: Sequence[RejectedArc]) -> list[tuple[str, str]]:
    """Return the panel's lines on rejected arcs with their colours: letter and wrapped reason."""
    lines = [("Rejected arcs", HEADING)] if rejected else []
    for arc in rejected:
        wrapped = textwrap.wrap(arc.reason, COLUMNS - 4)
        lines += [
            (f"{arc.letter if row == 0 else '':<3} {text}", arc.colour)
            for row, text in enumerate(wrapped)
        ]
    return lines
