"""What was found in an image, drawn back into it: a person sees whether it lies on the pipe."""

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lsvision.draw.measurement import draw_on_axes, summary_title
from lsvision.draw.panel import colour_of, draw_panel
from lsvision.draw.photo import show_photo
from lsvision.draw.rejected import rejected_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Points
from lsvision.measure import Measurement
from lsvision.profile import Profile
from lsvision.sensors.light_section import LightSection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE_INCH, DPI = (13.0, 15.0), 100
HEIGHT_RATIOS = (8.0, 7.0)
"""Heights of the photo and of the drawing in mm below it."""
OUTLINE_STEPS = 721


def draw_overlay(
    image: npt.ArrayLike,
    light_section: LightSection,
    profile: Profile,
    measurement: Measurement,
    *,
    title: str = "",
) -> "Figure":
    """Draw a photo with the found ellipses projected back into it, and the section below.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        As measured; blue first.
    light_section : LightSection
        The rig that took it.
    profile : Profile
        Of its laser line. Units: mm.
    measurement : Measurement
        What was found in the profile.
    title : str
        Above the photo, as the name of the file.

    Returns
    -------
    matplotlib.figure.Figure
        Save it with its ``savefig`` or `figure_bytes`. Its first axes hold the photo in px,
        its second the section in mm.

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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_INCH, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    above, below = figure.subfigures(2, 1, height_ratios=HEIGHT_RATIOS)
    photo = above.add_axes((0.065, 0.06, 0.915, 0.87))
    show_photo(photo, image)
    draw_on_photo(photo, light_section, profile, measurement)
    refused = rejected_arcs(profile.points, measurement)
    figure.suptitle(summary_title(len(measurement.cylinders), len(refused), title),
                    x=0.065, y=0.985, ha="left", fontsize=13, parse_math=False)  # fmt: skip
    section = below.add_axes((0.065, 0.085, 0.605, 0.785))
    draw_on_axes(section, profile, measurement)
    draw_panel(below, measurement.cylinders, refused)
    return figure


def draw_on_photo(
    axes: "Axes", light_section: LightSection, profile: Profile, measurement: Measurement
) -> None:
    """Draw what was found into axes that show the photo.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        In px of the image; its limits stay.
    light_section : LightSection
        The rig that took the photo.
    profile : Profile
        Of its laser line. Units: mm.
    measurement : Measurement
        What was found in the profile.
    """
    limits = axes.axis()
    seen = light_section.project(profile.points)
    axes.plot(*seen.T, ",", color="#00B7EB", zorder=2)
    for arc in rejected_arcs(profile.points, measurement):
        axes.plot(*seen[arc.indices].T, ".", color=arc.colour, ms=1.5, zorder=3)
        u, v = seen[arc.indices[len(arc.indices) // 2]]
        axes.annotate(arc.letter, (u, v), xytext=(0, 14), textcoords="offset points",
                      color="white", fontsize=8, weight="bold", ha="center", annotation_clip=True,
                      bbox={"boxstyle": "round,pad=0.15", "fc": arc.colour, "ec": "none"},
                      arrowprops={"arrowstyle": "-", "color": arc.colour, "lw": 0.8})  # fmt: skip
    for number, cylinder in enumerate(measurement.cylinders, 1):
        _draw_cylinder(axes, light_section, seen, cylinder, number)
    axes.axis(limits)


def _draw_cylinder(
    axes: "Axes", light_section: LightSection, seen: Points, cylinder: CylinderSection, number: int
) -> None:
    colour, ellipse = colour_of(number), cylinder.ellipse
    outline = light_section.project(ellipse.points_at(np.linspace(0, 2 * math.pi, OUTLINE_STEPS)))
    for width, shade in ((3.4, "white"), (1.6, colour)):  # readable on any photo
        axes.plot(*outline.T, "-", color=shade, lw=width, zorder=4)
    axes.plot(*seen[cylinder.indices].T, ".", color="yellow", ms=1.2, zorder=5)
    badge = {"boxstyle": "circle,pad=0.25", "fc": colour, "ec": "white"}
    u, v = light_section.project([ellipse.centre])[0]
    axes.text(u, v, str(number), color="white", fontsize=11, weight="bold", ha="center",
              va="center", zorder=6, clip_on=True, bbox=badge)  # fmt: skip
