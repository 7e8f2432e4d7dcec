"""Panel next to a drawing: values of each cylinder, letters and reasons of rejected arcs."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import IntArray, Points
from lsvision.measure import Measurement
from lsvision.results.number_format import with_minus_signs
from lsvision.results.palette import REJECTED, choose_cylinder_colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADING = "black"
"""Colour of headings, by which they are recognised and written in bold."""
PANEL_LEFT, PANEL_TOP, PANEL_LINE_HEIGHT = 0.685, 0.865, 0.0225
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


@dataclass(frozen=True, eq=False, slots=True)
class RejectedArc:
    """A rejected arc in a picture, with its label there: A to Z, then A1 to Z1, and so on.

    Indices are those of the valid points of the arc that belong to no cylinder, at least one.
    """

    letter: str
    indices: IntArray
    reason: str
    colour: str


def find_rejected_arcs(points: Points, measurement: Measurement) -> tuple[RejectedArc, ...]:
    """Return the rejected arcs in the order of the profile; of several with one span the first.

    `points` are all points of the profile, (n, 2) in mm. A rejection whose points all belong to
    cylinders is omitted.
    """
    unassigned = np.isfinite(points[:, 0])
    for cylinder in measurement.cylinders:
        unassigned[cylinder.indices] = False
    reasons: dict[tuple[int, int], str] = {}
    for rejection in measurement.rejections:
        reasons.setdefault((rejection.arc.start, rejection.arc.stop), rejection.reason)
    arcs: list[RejectedArc] = []
    for (start, stop), reason in sorted(reasons.items()):
        indices = start + np.flatnonzero(unassigned[start:stop])
        if len(indices):
            colour = REJECTED[len(arcs) % len(REJECTED)]
            arcs.append(RejectedArc(_format_letter(len(arcs)), indices, reason, colour))
    return tuple(arcs)


def _format_letter(number: int) -> str:
    """Return A to Z for 0 to 25, then A1 to Z1, A2 to Z2, ..."""
    suffix, letter = divmod(number, 26)
    return chr(ord("A") + letter) + (str(suffix) if suffix else "")


def draw_panel(
    figure: "Figure", cylinders: Sequence[CylinderSection], rejected: Sequence[RejectedArc]
) -> None:
    """Write the panel into the right third of a figure; cylinders are numbered from 1."""
    lines = [*_format_cylinder_lines(cylinders), *_format_rejected_lines(rejected)]
    if len(lines) > MAX_LINES:
        left_out = len(lines) - MAX_LINES + 1
        lines = [
            *lines[: MAX_LINES - 1],
            (f"... {left_out} more lines: see lsvision measure -v", "0.3"),
        ]
    for row, (line, colour) in enumerate(lines):
        weight = "bold" if colour == HEADING else "normal"
        top = PANEL_TOP - row * PANEL_LINE_HEIGHT
        figure.text(PANEL_LEFT, top, with_minus_signs(line), color=colour, fontsize=9, va="top",
                    family="monospace", weight=weight, parse_math=False)  # fmt: skip
    figure.text(PANEL_LEFT, 0.085, SYMBOLS, color="0.3", fontsize=8, va="bottom", parse_math=False)


def _format_cylinder_lines(cylinders: Sequence[CylinderSection]) -> list[tuple[str, str]]:
    """Return the panel's lines on the cylinders with their colours, and an empty line at the end.

    More than `MAX_FULL_CYLINDERS` have shorter lines, without empty ones between them.
    """
    blank = ("", HEADING)
    if not cylinders:
        return [("No cylinder found", HEADING), blank]
    shortened = len(cylinders) > MAX_FULL_CYLINDERS
    lines = [("Cylinders", HEADING)]
    for number, cylinder in enumerate(cylinders, 1):
        texts = _format_value_lines(cylinder)
        if shortened:
            radius, theta, phi, _ = texts
            texts = [radius, f"{theta}, {phi}"]
        lines += [
            (f"{number if row == 0 else '':<3} {text}", choose_cylinder_colour(number))
            for row, text in enumerate(texts)
        ]
        if not shortened:
            lines.append(blank)
    return [*lines, blank] if shortened else lines


def _format_value_lines(cylinder: CylinderSection) -> list[str]:
    """Return the values of a cylinder as four lines: radius, theta, phi, centre and points."""
    radius, theta, phi, *_ = cylinder.estimates
    x, y = cylinder.centre
    return [
        f"r = {radius.text} mm",
        f"θ = {theta.text}°" if theta.determined else f"θ {theta.text}",
        f"φ = {phi.text}°",
        f"centre ({x:z.2f}, {y:z.2f}) mm, {len(cylinder.indices)} points",
    ]


def _format_rejected_lines(rejected: Sequence[RejectedArc]) -> list[tuple[str, str]]:
    """Return the panel's lines on rejected arcs with their colours: letter and wrapped reason."""
    lines = [("Rejected arcs", HEADING)] if rejected else []
    for arc in rejected:
        wrapped = textwrap.wrap(arc.reason, MAX_COLUMNS - 4)  # after the letter and blanks
        lines += [
            (f"{arc.letter if row == 0 else '':<3} {text}", arc.colour)
            for row, text in enumerate(wrapped)
        ]
    return lines
