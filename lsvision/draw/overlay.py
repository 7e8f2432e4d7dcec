"""Picture of an image with the measured ellipses projected into it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.draw.figures import (
    create_figure,
    draw_legend,
    format_summary_title,
    get_figure,
    label_once,
    set_title,
    show_photo,
)
from lsvision.draw.measurement import draw_on_axes, label_rejected
from lsvision.draw.panel import draw_panel, find_rejected_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Points
from lsvision.measure import Measurement
from lsvision.profile import Profile
from lsvision.results.palette import POINTS, choose_cylinder_colour
from lsvision.sensors.light_section import LightSection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE_INCH, DPI = (13.0, 15.0), 100
"""Width and height of the figure, and resolution of the PNG (1 / inch)."""
HEIGHT_RATIOS = (8.0, 7.0)
"""Relative heights of the photo and of the drawing in mm below it."""
OUTLINE_POINTS = 721
"""Number of points of a drawn ellipse."""


def draw_overlay(
    image: npt.ArrayLike,
    light_section: LightSection,
    profile: Profile,
    measurement: Measurement,
    *,
    title: str = "",
    ax: Axes | None = None,
) -> Figure:
    """Return a figure of an image with the projected ellipses, and of the section below.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Measured image, grey or blue, green, red (OpenCV).
    light_section : LightSection
        Calibrated camera and laser plane.
    profile : Profile
        Profile of the laser line in the image. Units: mm.
    measurement : Measurement
        Measurement of the profile.
    title : str
        Title above the photo, such as the name of the file.
    ax : matplotlib.axes.Axes, optional
        Axes to draw the photo into, alone. By default a new figure with both is drawn.

    Returns
    -------
    matplotlib.figure.Figure
        Figure of `ax`, else a new one. Save it with its ``savefig`` or `render_figure`.
        Its first axes hold the photo in px, its second the section in mm.

    Examples
    --------
    >>> from lsvision.sensors.camera import Camera
    >>> from lsvision.geometry import Plane
    >>> camera = Camera([[600, 0, 32], [0, 600, 24], [0, 0, 1]], [], (64, 48))
    >>> rig = LightSection(camera, Plane((0.0, 0.866, 0.5), 150.0))
    >>> profile = Profile(rig.points_from_pixels([[10.0, 20.0], [50.0, 20.0]]))
    >>> photo = np.zeros((48, 64), np.uint8)
    >>> len(draw_overlay(photo, rig, profile, Measurement((), ())).axes)
    2
    """
    if ax is not None:
        show_photo(ax, image)
        draw_on_photo(ax, light_section, profile, measurement)
        set_title(ax, title)
        return get_figure(ax)
    figure = create_figure(SIZE_INCH, dpi=DPI)
    upper, lower = figure.subfigures(2, 1, height_ratios=HEIGHT_RATIOS)
    photo = upper.add_axes((0.065, 0.06, 0.915, 0.84))
    show_photo(photo, image)
    photo.set_anchor("W")  # its left edge is aligned with that of the section
    draw_on_photo(photo, light_section, profile, measurement)
    rejected = find_rejected_arcs(profile.points, measurement)
    figure.suptitle(format_summary_title(len(measurement.cylinders), len(rejected), title),
                    x=0.065, y=0.985, ha="left", fontsize=13, parse_math=False)  # fmt: skip
    section = lower.add_axes((0.065, 0.085, 0.605, 0.785))
    draw_on_axes(section, profile, measurement)
    draw_panel(lower, measurement.cylinders, rejected)
    return figure


def draw_on_photo(
    axes: Axes, light_section: LightSection, profile: Profile, measurement: Measurement
) -> None:
    """Draw a measurement into axes that show its image; their limits are kept."""
    limits = axes.axis()
    pixels = light_section.project(profile.points)
    axes.plot(*pixels.T, ".", color=POINTS, ms=2.5, zorder=2, label="measured points")
    rejected = find_rejected_arcs(profile.points, measurement)
    for arc in rejected:
        axes.plot(*pixels[arc.indices].T, "x", color=arc.colour, ms=3, mew=0.8, zorder=3,
                  label=label_once(axes, "rejected arc"))  # fmt: skip
    for number, cylinder in enumerate(measurement.cylinders, 1):
        _draw_cylinder(axes, light_section, pixels, cylinder, number)
    axes.axis(limits)
    label_rejected(axes, pixels, rejected)
    draw_legend(axes)


def _draw_cylinder(
    axes: Axes, light_section: LightSection, pixels: Points, cylinder: CylinderSection, number: int
) -> None:
    """Draw points, ellipse, major axis if it is determined, and number of a cylinder, in px."""
    colour, ellipse = choose_cylinder_colour(number), cylinder.ellipse
    outline = light_section.project(ellipse.points_at(np.linspace(0, 2 * math.pi, OUTLINE_POINTS)))
    cylinder_pixels = pixels[cylinder.indices].T
    # White below the colour, so that points and ellipse are visible on any photo.
    axes.plot(*cylinder_pixels, "o", color="white", ms=4.4, mew=0, zorder=4)
    axes.plot(*outline.T, "-", color="white", lw=2.4, zorder=4)
    axes.plot(*cylinder_pixels, "o", color=colour, ms=3.2, mew=0, zorder=5,
              label=label_once(axes, "points of a cylinder"))  # fmt: skip
    axes.plot(*outline.T, "-", color=colour, lw=1.1, zorder=5,
              label=label_once(axes, "fitted ellipse"))  # fmt: skip
    if cylinder.theta_determined:  # otherwise its direction would look like a result
        ends = light_section.project(ellipse.points_at(np.array([0.0, math.pi])))
        axes.plot(*ends.T, "--", color=colour, lw=1.3, zorder=5,
                  label=label_once(axes, "major axis (direction θ)"))  # fmt: skip
    badge = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    u, v = light_section.project([ellipse.centre])[0]
    axes.text(u, v, str(number), color="white", fontsize=11, weight="bold", ha="center",
              va="center", zorder=6, clip_on=True, bbox=badge)  # fmt: skip
