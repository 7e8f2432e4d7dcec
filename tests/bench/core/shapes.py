"""Outlines that are no pipe, drawn around (0, 0) with the sensor above. Units: mm.

Each function draws a random outline, an array of corners (n, 2), and its description. Arcs of the
outlines (rounded corners, bends) are between tangential flats.
"""

import math

import numpy as np

from lsvision.profile import Profile
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate import Scene, SectionSettings, simulate_section
from lsvision.simulate.clutter import build_ground, place_outline

RANGE = 400.0
FIELD = 140.0
"""Length of the laser line at `RANGE`."""
FAR = 650.0
"""Largest range of the sensor."""
MIN_FLAT_MM, MIN_FLAT_FRACTION = 4.0, 0.15
"""Smallest length of the flat between two rounded corners, and the same as a fraction of the width;
without a flat, a tube seen from above is an arch."""
CORNER_PIECES = 48
"""Number of straight pieces of a rounded corner: sagitta under 3 um at a radius of 20 mm."""


def sensor_of(pitch, noise):
    """Sensor with this pitch at `RANGE`, and this standard deviation of the noise along the ray."""
    return ProfileSensor(
        range_std=noise,
        reference_range=RANGE,
        columns=round(FIELD / pitch) + 1,
        max_range=FAR,
        width_at_max_range=FIELD * FAR / RANGE,
    )


def look_at(outline, rng, *, pitch, noise, tilt=0.0, floor=None, settings=None):
    """Simulate a section of an outline, rotated by `tilt` (rad), whose (0, 0) is about 400 mm away.

    `floor` is the depth of a plate under it; `settings` are those of `simulate_section`, by default
    noise along the ray and the loss of points at grazing incidence only.
    """
    at = (rng.uniform(-15.0, 15.0), -RANGE + rng.uniform(-15.0, 15.0))
    objects = [place_outline(outline, at, tilt)]
    if floor is not None:
        objects.append(build_ground(400.0, (0.0, at[1] - floor), rng.uniform(-0.03, 0.03)))
    settings = settings or SectionSettings(lost_fraction=0.0, jump_fraction=0.0)
    return simulate_section(Scene(tuple(objects)), sensor_of(pitch, noise), settings, rng=rng)


def displaced(section, along_ray):
    """Return the section's noise-free points, each displaced along its ray by `along_ray` (mm)."""
    exact = section.truth.points
    rays = exact - section.sensor.origin
    points = exact + rays / np.hypot(*rays.T)[:, None] * along_ray[:, None]
    return Profile(points).points


def round_corners(corners, radii):
    """Return the open line through `corners` with the inner corners rounded by arcs of `radii`."""
    corners = np.asarray(corners, dtype=float)
    pieces = [corners[:1]]
    for before, corner, after, radius in zip(
        corners[:-2], corners[1:-1], corners[2:], radii, strict=True
    ):
        into = (corner - before) / np.hypot(*(corner - before))
        out = (after - corner) / np.hypot(*(after - corner))
        turn = math.atan2(into[0] * out[1] - into[1] * out[0], into @ out)
        start = corner - into * radius * math.tan(abs(turn) / 2)
        angles = np.linspace(0.0, abs(turn), CORNER_PIECES + 1)
        side = math.copysign(1.0, turn) * np.array([-into[1], into[0]])
        arc = radius * (np.sin(angles)[:, None] * into + (1 - np.cos(angles))[:, None] * side)
        pieces.append(start + arc)
    return np.vstack([*pieces, corners[-1:]])


def rectangular_tube(rng):
    """Width 30-60, corners 3-18 with a flat between them; also return its height."""
    width = rng.uniform(30.0, 60.0)
    flat = max(MIN_FLAT_MM, MIN_FLAT_FRACTION * width)
    corner = rng.uniform(3.0, min(18.0, (width - flat) / 2))
    height = rng.uniform(max(25.0, 2 * corner + 4.0), 60.0)
    x = width / 2
    corners = [[0, -height], [-x, -height], [-x, 0], [x, 0], [x, -height], [0, -height]]
    return round_corners(corners, [corner] * 4), height, f"width {width:.0f} corner {corner:.1f}"


def bent_sheet(rng):
    """A sheet bent by 90 deg, the bend towards the sensor; outer radius 3-20."""
    radius, half = rng.uniform(3.0, 20.0), math.pi / 4
    legs = radius + rng.uniform(15.0, 40.0, 2)
    ends = [
        [-legs[0] * math.cos(half), -legs[0] * math.sin(half)],
        [legs[1] * math.cos(half), -legs[1] * math.sin(half)],
    ]
    return round_corners([ends[0], [0.0, 0.0], ends[1]], [radius]), f"bend {radius:.1f}"


def plate_edge(rng):
    """A flat plate whose one visible edge is rounded by 3-15; also return its height."""
    radius, width = rng.uniform(3.0, 15.0), rng.uniform(40.0, 90.0)
    down = radius + rng.uniform(2.0, 20.0)
    line = round_corners([[-width, 0.0], [0.0, 0.0], [0.0, -down]], [radius])
    mirrored = line * [-1.0, 1.0] if rng.random() < 0.5 else line
    return mirrored - [mirrored[:, 0].mean(), 0.0], down, f"edge {radius:.1f}"


def v_block(rng):
    """A block with a V of 90 deg, its edges rounded by 1-4."""
    width, opening = rng.uniform(60.0, 110.0), rng.uniform(25.0, 50.0)
    x, v, edge = width / 2, opening / 2, rng.uniform(1.0, 4.0)
    corners = [[-x, -40], [-x, 0], [-v, 0], [0, -v], [v, 0], [x, 0], [x, -40]]
    return round_corners(corners, [edge, edge, 0.5, edge, edge]), f"edges {edge:.1f}"


def angle_inside(rng):
    """An angle iron from inside: two flats and a hollow fillet of 4-15 between them."""
    fillet, leg = rng.uniform(4.0, 15.0), rng.uniform(25.0, 50.0)
    toe = leg / math.sqrt(2)
    corners = [[-toe, toe], [0.0, 0.0], [toe, toe]]
    return round_corners(corners, [fillet]), f"fillet {fillet:.1f}"


def angle_back(rng):
    """An angle iron from its back: a heel rounded by 0.5-3."""
    heel, leg = rng.uniform(0.5, 3.0), rng.uniform(25.0, 50.0)
    toe = leg / math.sqrt(2)
    return round_corners([[-toe, -toe], [0.0, 0.0], [toe, -toe]], [heel]), f"heel {heel:.1f}"


def thread(rng):
    """A thread of 60 deg along its axis, pitch 1.5-6, crest p/8 and root p/4 flat."""
    pitch, turns = rng.uniform(1.5, 6.0), int(rng.integers(8, 16))
    depth = 5 / 8 * math.sqrt(3) / 2 * pitch
    x = pitch * np.add.outer(np.arange(turns) - turns / 2, [0, 2 / 8, 9 / 16, 11 / 16])
    y = np.tile([-depth, -depth, 0.0, 0.0], turns)
    return np.column_stack([x.ravel(), y]), f"pitch {pitch:.1f}"


def polygon(rng, corners):
    """A regular polygon about a circle of 10-25."""
    radius = rng.uniform(10.0, 25.0)
    angles = rng.uniform(0, 2 * math.pi) + np.arange(corners + 1) * 2 * math.pi / corners
    line = radius / math.cos(math.pi / corners) * np.column_stack([np.cos(angles), np.sin(angles)])
    return line - [0.0, radius], f"radius {radius:.1f}"


def superellipse(rng):
    """``|x/a|^n + |y/b|^n = 1``, a and b 15-30, n 3-5."""
    a, b, n = rng.uniform(15, 30), rng.uniform(15, 30), rng.uniform(3, 5)
    t = np.linspace(0, 2 * math.pi, 721)
    c, s = np.cos(t), np.sin(t)
    x = a * np.sign(c) * np.abs(c) ** (2 / n)
    y = b * np.sign(s) * np.abs(s) ** (2 / n)
    return np.column_stack([x, y - b]), f"n {n:.1f} a {a:.0f} b {b:.0f}"


def catenary(rng):
    """Crest radius 15-25, down to a slope of 40-65 deg."""
    a, slope = rng.uniform(15.0, 25.0), rng.uniform(40.0, 65.0)
    x = np.linspace(-1, 1, 401) * a * math.asinh(math.tan(math.radians(slope)))
    return np.column_stack([x, a * (1 - np.cosh(x / a))]), f"a {a:.1f} slope {slope:.0f}"


def parabola(rng):
    """Crest radius 10-30, down to a slope of 65 deg."""
    radius = rng.uniform(10.0, 30.0)
    x = np.linspace(-1, 1, 401) * radius * math.tan(math.radians(65.0))
    return np.column_stack([x, -(x**2) / (2 * radius)]), f"radius {radius:.1f}"


def gaussian_bump(rng):
    """Height 8-20, standard width 5-10, on a flat."""
    height, spread = rng.uniform(8.0, 20.0), rng.uniform(5.0, 10.0)
    x = np.linspace(-60, 60, 801)
    y = height * (np.exp(-0.5 * (x / spread) ** 2) - 1)
    return np.column_stack([x, y]), f"height {height:.1f} spread {spread:.1f}"


def cosine_bump(rng):
    """One wave of height 8-20 and length 25-50, on a flat."""
    height, length = rng.uniform(8.0, 20.0), rng.uniform(25.0, 50.0)
    x = np.linspace(-60, 60, 801)
    wave = np.where(np.abs(x) < length / 2, (1 + np.cos(2 * math.pi * x / length)) / 2, 0.0)
    return np.column_stack([x, height * (wave - 1)]), f"height {height:.1f} length {length:.1f}"


def corrugated(rng):
    """A sine of length 20-60 whose steepest slope is 30-50 deg."""
    length = rng.uniform(20.0, 60.0)
    amplitude = length * math.tan(math.radians(rng.uniform(30.0, 50.0))) / (2 * math.pi)
    x = np.linspace(-60, 60, 1201)
    phase = rng.uniform(0, 2 * math.pi)
    y = amplitude * np.sin(2 * math.pi * x / length + phase)
    return np.column_stack([x, y]), f"length {length:.1f} amplitude {amplitude:.1f}"


FLATS = {
    "bent sheet": bent_sheet,
    "V-block": v_block,
    "angle iron, inside": angle_inside,
    "angle iron, back": angle_back,
    "thread": thread,
    "octagon": lambda rng: polygon(rng, 8),
}
"""Outlines of flats, with or without arcs between them; each draws outline and description."""
CURVES = {
    "gaussian bump": gaussian_bump,
    "cosine bump": cosine_bump,
    "corrugated sheet": corrugated,
    "parabola": parabola,
    "superellipse": superellipse,
}
"""Outlines without circular arcs; each draws outline and description."""
PIPE_LIKE = {"catenary": catenary, "16-gon": lambda rng: polygon(rng, 16)}
"""Outlines that cannot be distinguished from a pipe with much noise: for information only."""
