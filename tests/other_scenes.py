"""A second, plain simulator: heights over evenly spaced x, no ray tracing.

It shares no line with `lsvision.simulate`, its tubes are cut by a formula of their own, and its
sensor has other points, other clutter and other losses: what the package finds there was not
tuned on it.
"""

import math
from dataclasses import dataclass

import numpy as np

WIDTH, GROUND = 160.0, -420.0  # mm
STEEPEST = math.tan(math.radians(80.0))
LOST, JUMPING = 0.03, 0.02


@dataclass(frozen=True)
class OtherTube:
    """A section of a tube: radius (mm), phi, theta (rad) and centre (mm)."""

    radius: float
    phi: float
    theta: float
    x: float
    y: float

    @property
    def half_width(self):
        a = self.radius / math.cos(self.phi)
        return math.hypot(a * math.cos(self.theta), self.radius * math.sin(self.theta))

    def top(self, x):
        """The upper root of the ellipse's quadratic in y; -inf beside it."""
        a, b = self.radius / math.cos(self.phi), self.radius
        c, s, dx = math.cos(self.theta), math.sin(self.theta), x - self.x
        A = (s / a) ** 2 + (c / b) ** 2
        B = 2 * c * s * dx * (a**-2 - b**-2)
        C = dx**2 * ((c / a) ** 2 + (s / b) ** 2) - 1
        root = np.sqrt(np.maximum(B**2 - 4 * A * C, 0))
        return np.where(B**2 >= 4 * A * C, self.y + (root - B) / (2 * A), -np.inf)


def other_scene(rng, tubes, *, welded=False, cluttered=False):
    """Points (n, 2) with lost rows, labels (n,) and tubes of a random scene."""
    x = np.linspace(-WIDTH / 2, WIDTH / 2, int(rng.choice([320, 640, 1280])))
    y, labels = GROUND + rng.uniform(-0.05, 0.05) * x, np.zeros(len(x), int)
    placed = _place_tubes(rng, tubes, welded)
    for label, tube in enumerate(placed, 1):
        higher = tube.top(x) > y
        y[higher], labels[higher] = tube.top(x)[higher], label
    if welded:
        between = np.flatnonzero((x > placed[0].x) & (x < placed[1].x))
        valley = between[np.argmin(y[between])]
        reach = rng.uniform(4, 7)
        bead = y[valley] + rng.uniform(2.5, 3.5) - 2 * ((x - x[valley]) / reach) ** 2
        filled = (np.abs(x - x[valley]) < reach) & (bead > y)
        y[filled], labels[filled] = bead[filled], 0
    for _ in range(rng.integers(1, 4) if cluttered else 0):
        _add_clutter(rng, x, y, labels)
    return *_as_seen(rng, x, y, labels), placed


def _place_tubes(rng, count, welded):
    placed, x = [], rng.uniform(-50, -40) if count > 1 else rng.uniform(-45, 45)
    gap = (0.97, 1.0) if welded else (1.05, 1.2)
    for _ in range(count):
        radius, phi = rng.uniform(10, 18 if count > 2 else 24), rng.uniform(0, math.radians(40))
        tube = OtherTube(radius, phi, rng.uniform(0, math.pi), 0.0, 0.0)
        if placed:
            x += (placed[-1].half_width + tube.half_width) * rng.uniform(*gap)
        a = radius / math.cos(phi)
        y = GROUND + math.hypot(a * math.sin(tube.theta), radius * math.cos(tube.theta))
        placed.append(OtherTube(radius, phi, tube.theta, x, y + rng.uniform(0, 3)))
    return placed


def _add_clutter(rng, x, y, labels):
    """A box, a ramp, stairs, a wave or spikes where there is no tube."""
    start, width = rng.uniform(-75, 60), rng.uniform(8, 25)
    here = (x > start) & (x < start + width) & (labels == 0)
    along = x[here] - start
    heights = (
        np.full(len(along), rng.uniform(5, 30)),
        3 + along * rng.uniform(0.2, 1.2),
        5 + 2 * np.floor(along / 4),
        10 + rng.uniform(1, 3) * np.sin(along / rng.uniform(2, 6)),
        rng.uniform(2, 20, len(along)),
    )
    y[here] = np.maximum(y[here], GROUND + heights[rng.integers(len(heights))])


def _as_seen(rng, x, y, labels):
    """Noise along the ray from the origin, jumps, and rows lost at random and on steep flanks."""
    exact = np.column_stack([x, y])
    distance = np.hypot(x, y)
    std = rng.uniform(0.02, 0.1) * (distance / 400) ** 2
    points = exact * (1 + std * rng.standard_normal(len(x)) / distance)[:, None]
    jumps = rng.random(len(x)) < JUMPING
    points[jumps, 1] += rng.uniform(-8, 8, jumps.sum())
    lost = (np.abs(np.gradient(y, x)) > STEEPEST) | (rng.random(len(x)) < LOST)
    points[lost] = np.nan
    return points, np.where(lost | jumps, -1, labels)
