"""Outlines of what stands around pipes: bars, boxes, profiles, and curved sheets of many kinds.

Every function returns a `Prism` placed by the middle of its sensor side, turned by a tilt from X
towards Y. Frame: section frame. Units: mm and rad. Curves are drawn in pieces of about 0.3 mm,
whose sagitta stays below a micrometre for the radii that occur. No outline holds an arc of a
circle of a pipe's size (a rounded corner does, of 5 mm radius at most): what a finder takes for
a pipe here is none.
"""

import math

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from lsvision.geometry import FloatArray
from lsvision.simulate.prism import Prism

SEGMENT_LENGTH_MM = 0.3
"""Length along X of the straight pieces of a curve. Units: mm."""
MAX_CORNER_RADIUS = 5.0
"""Largest radius of a rounded corner; pipes start at twice that. Units: mm."""

Centre = tuple[float, float]


def place_outline(outline: npt.ArrayLike, centre: Centre, tilt: float = 0.0) -> Prism:
    """Prism of an outline drawn around (0, 0), turned and moved to its place.

    Parameters
    ----------
    outline : (k, 2) array_like
        Units: mm.
    centre : tuple of float
        Where its (0, 0) comes to lie. Units: mm.
    tilt : float
        Turn from X towards Y. Units: rad.
    """
    cos, sin = math.cos(tilt), math.sin(tilt)
    turned = np.asarray(outline, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]])
    return Prism(turned + centre)


def ground(width: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Plane under the scene."""
    return place_outline([[-width / 2, 0.0], [width / 2, 0.0]], centre, tilt)


def bar(width: float, thickness: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Flat bar or box: a rectangle.

    Examples
    --------
    >>> bar(40.0, 5.0, (0.0, -400.0)).outline[0]
    array([ -20., -400.])
    """
    x = width / 2
    corners = [[-x, 0.0], [x, 0.0], [x, -thickness], [-x, -thickness], [-x, 0.0]]
    return place_outline(corners, centre, tilt)


def rounded_box(
    width: float, height: float, corner: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Square tube: a rectangle with rounded corners, open below.

    Raises
    ------
    ValueError
        If the corner is a pipe: over 5 mm, or more than the box holds.
    """
    if not 0 < corner <= min(MAX_CORNER_RADIUS, width / 2, height):
        raise ValueError(f"want a corner in (0, {MAX_CORNER_RADIUS:g}] mm, got {corner}")
    turn = np.linspace(0.0, math.pi / 2, 25)
    x, y = width / 2 - corner + corner * np.sin(turn), corner * (np.cos(turn) - 1)
    right = np.vstack([np.column_stack([x, y]), [[width / 2, -height]]])
    left = right[::-1] * [-1.0, 1.0]
    return place_outline(np.vstack([left, right]), centre, tilt)


def v_groove(
    width: float, opening: float, depth: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Plate with a V groove for a weld."""
    x, half = width / 2, opening / 2
    outline = [[-x, 0.0], [-half, 0.0], [0.0, -depth], [half, 0.0], [x, 0.0]]
    return place_outline(outline, centre, tilt)


def angle_iron(leg: float, thickness: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Angle iron standing on its two edges, its back towards the sensor."""
    reach, edge = leg / math.sqrt(2), thickness / math.sqrt(2)
    inside = [[reach - edge, -reach - edge], [0.0, -2 * edge], [-reach + edge, -reach - edge]]
    outline = [[-reach, -reach], [0.0, 0.0], [reach, -reach], *inside, [-reach, -reach]]
    return place_outline(outline, centre, tilt)


def sine_sheet(
    width: float, amplitude: float, wavelength: float, centre: Centre, tilt: float = 0.0
) -> Prism:
    """Corrugated sheet."""
    x = _abscissae(width)
    wave = amplitude * np.sin(2 * math.pi * x / wavelength)
    return place_outline(np.column_stack([x, wave]), centre, tilt)


def gaussian_bumps(width: float, bumps: npt.ArrayLike, centre: Centre, tilt: float = 0.0) -> Prism:
    """Sheet with dents and bumps.

    Parameters
    ----------
    width : float
        Units: mm.
    bumps : (k, 3) array_like
        Position along the sheet, height (negative: a dent) and standard width. Units: mm.
    centre, tilt
        As for all.
    """
    x = _abscissae(width)
    position, height, spread = np.asarray(bumps, dtype=np.float64).T[:, :, None]
    y = (height * np.exp(-0.5 * ((x - position) / spread) ** 2)).sum(axis=0)
    return place_outline(np.column_stack([x, y]), centre, tilt)


def parabola(width: float, depth: float, centre: Centre, tilt: float = 0.0) -> Prism:
    """Trough (negative depth) or ridge whose section is a parabola."""
    x = _abscissae(width)
    return place_outline(np.column_stack([x, -depth * (2 * x / width) ** 2]), centre, tilt)


def spline_sheet(knots: npt.ArrayLike, centre: Centre, tilt: float = 0.0) -> Prism:
    """Free-form sheet: a natural cubic spline.

    Parameters
    ----------
    knots : (k, 2) array_like
        First column rising. Units: mm.
    centre, tilt
        As for all.
    """
    x, y = np.asarray(knots, dtype=np.float64).T
    curve = CubicSpline(x, y, bc_type="natural")
    fine = np.arange(x[0], x[-1] + SEGMENT_LENGTH_MM / 2, SEGMENT_LENGTH_MM)
    return place_outline(np.column_stack([fine, curve(fine)]), centre, tilt)


def _abscissae(width: float) -> FloatArray:
    return np.linspace(-width / 2, width / 2, math.ceil(width / SEGMENT_LENGTH_MM) + 1)
