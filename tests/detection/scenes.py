"""Profiles built from simple pieces, so that a test of one step knows where each surface lies."""

import math

import numpy as np

from lsvision import Ellipse, PointNoise, Profile
from lsvision.detection import candidates, identification, screening
from lsvision.detection.arcs import IdentifiedArc, ScreenedArc
from lsvision.detection.profile_preparation import prepare_profile

PITCH = 0.6  # mm
STEP_DEG = 1.5
STEP = 2 * 20 * math.sin(math.radians(STEP_DEG / 2))  # mm, on a circle of 20 mm


def line(*pieces, noise_mm=0.02, rng=None):
    """Return the prepared profile of successive pieces of (n, 2) points, with isotropic noise."""
    points = np.concatenate(pieces)
    rng = rng or np.random.default_rng(5)
    return prepare_profile(Profile(points + noise_mm * rng.normal(size=points.shape)), None)


def flat(start, stop, y=-440.0, slope=0.0):
    x = np.arange(start, stop, PITCH)
    return np.column_stack([x, y + slope * (x - start)])


def dome(centre, radius, half_deg=75.0, y=-440.0):
    """Upper arc of a circle, columns at equal steps of x; its centre at `y`."""
    reach = radius * math.sin(math.radians(half_deg))
    x = np.arange(centre - reach, centre + reach, PITCH)
    return np.column_stack([x, y + np.sqrt(radius**2 - (x - centre) ** 2)])


def bowl(centre, radius, half_deg=75.0, y=-400.0):
    x, up = dome(centre, radius, half_deg, 0.0).T
    return np.column_stack([x, y - up])


def exact(points, std=0.01):
    """Return the prepared profile of exact points, with a given noise of `std` mm."""
    noise = PointNoise(np.tile(std**2 * np.eye(2), (len(points), 1, 1)))
    return prepare_profile(Profile(points), noise)


def arc_points(angles_deg, radius=20.0, centre=(0.0, -440.0)):
    """Points of a circle at angles from the top, positive to the right."""
    angles = np.radians(angles_deg)
    return np.column_stack([np.sin(angles), np.cos(angles)]) * radius + centre


def walk(start, headings_deg, step):
    """Return points at equal steps from `start`, each step at its own angle from +X."""
    headings = np.radians(headings_deg)
    steps = step * np.column_stack([np.cos(headings), np.sin(headings)])
    return start + np.cumsum(steps, axis=0)


def circle(radius=20.0, centre=(0.0, -440.0)):
    return Ellipse(centre, radius, radius, 0.0)


def identified(start, stop, ellipse):
    """The arc of all points [start, stop)."""
    return IdentifiedArc(np.arange(start, stop), ellipse)


def as_screened(profile, arc, std, mixed_points=0):
    """Return the arc as screened, with the same inliers and a noise of `std` mm."""
    factor = (std / profile.noise_std) ** 2
    noisy_points = profile.noisy_points[arc.indices]
    return ScreenedArc(arc.indices, noisy_points, arc.ellipse, factor, mixed_points)


def find_candidates(profile, components, radius_range, *settings):
    """Candidates of one profile."""
    (found,) = candidates.find_candidates([profile], [components], [radius_range], *settings)
    return found


def identify_arcs(profile, seeds, radius_range):
    """Arcs and rejections of one profile."""
    (found,) = identification.identify_arcs([profile], [seeds], [radius_range])
    return found


def screen_arc(profile, arc):
    """One arc of a profile after screening."""
    (screened,) = screening.screen_arcs([profile], [arc])
    return screened


def with_foot(curvature, *, begins_deg=45.0):
    """Return an arc with the foot of a weld bead: beyond an angle it bends towards the sensor.

    Returns the points, the index of the first one of the foot, and the distances from the circle.
    """
    arc = arc_points(np.arange(-60.0, begins_deg + 0.1, STEP_DEG))
    turns = curvature * STEP_DEG * (np.arange(16) + 0.5)
    foot = walk(arc[-1], turns - begins_deg, STEP)
    points = np.concatenate([arc, foot])
    return points, len(arc), np.hypot(*(points - (0.0, -440.0)).T) - 20
