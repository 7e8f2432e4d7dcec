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
"""Colour of headings, by which they are recognised and written in bold."""

LEFT, TOP, LINE_HEIGHT = 0.685, 0.865, 0.0225
"""Left and top of the panel and height of its lines, as fractions of the figure."""
MAX_COLUMNS, MAX_LINES = 48, 31
"""Number of characters of a line, and of lines, that fit."""
MAX_FULL_CYLINDERS = 4
"""Number of cylinders up to which each has four lines; of more each has two."""

SYMBOLS = (
    "θ: direction of the major axis, from X towards Y\n"
    "φ: tilt of the cylinder from the laser plane's normal\n"
    "± one sigma"
)
"""Text below the panel."""


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
    if len(lines) > MAX_LINES:
        left_out = len(lines) - MAX_LINES + 1
        lines = [
            *lines[: MAX_LINES - 1],
            (f"... {left_out} more lines: see lsvision measure -v", "0.3"),
        ]
    for row, (line, colour) in enumerate(lines):
        weight = "bold" if colour == HEADING else "normal"
        figure.text(LEFT, TOP - row * LINE_HEIGHT, with_minus_signs(line), color=colour, fontsize=9,
                    va="top", family="monospace", weight=weight, parse_math=False)  # fmt: skip
    figure.text(LEFT, 0.085, SYMBOLS, color="0.3", fontsize=8, va="bottom", parse_math=False)


def _cylinder_lines(cylinders: Sequence[CylinderSection]) -> list[tuple[str, str]]:
    """Return the panel's lines on the cylinders with their colours, and an empty line at the end.

    More than `MAX_FULL_CYLINDERS` have shorter lines, without empty ones between them.
    """
    blank = ("", HEADING)
    if not cylinders:
        return [("No cylinder found", HEADING), blank]
    shortened = len(cylinders) > MAX_FULL_CYLINDERS
    lines = [("Cylinders", HEADING)]
    for number, cylinder in enumerate(cylinders, 1):
        texts = _value_lines(cylinder)
        if shortened:
            radius, theta, phi, _ = texts
            texts = [radius, f"{theta}, {phi}"]
        lines += [
            (f"{number if row == 0 else '':<3} {text}", cylinder_colour(number))
            for row, text in enumerate(texts)
        ]
        if not shortened:
            lines.append(blank)
    return [*lines, blank] if shortened else lines


def _value_lines(cylinder: CylinderSection) -> list[str]:
    """Return the values of a cylinder as four lines: radius, theta, phi, centre and points."""
    radius, theta, phi, *_ = cylinder.estimates
    x, y = cylinder.centre
    return [
        f"r = {radius.text} mm",
        f"θ = {theta.text}°" if theta.determined else f"θ {theta.text}",
        f"φ = {phi.text}°",
        f"centre ({x:z.2f}, {y:z.2f}) mm, {len(cylinder.indices)} points",
    ]


def _rejected_lines(rejected: Sequence[RejectedArc]) -> list[tuple[str, str]]:
    """Return the panel's lines on rejected arcs with their colours: letter and wrapped reason."""
    lines = [("Rejected arcs", HEADING)] if rejected else []
    for arc in rejected:
        wrapped = textwrap.wrap(arc.reason, MAX_COLUMNS - 4)  # after the letter and blanks
        lines += [
            (f"{arc.letter if row == 0 else '':<3} {text}", arc.colour)
            for row, text in enumerate(wrapped)
        ]
    return lines
