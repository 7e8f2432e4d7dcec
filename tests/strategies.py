"""What hypothesis draws from: shapes, arcs, and profiles no sensor would give."""

import math

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from lsvision.geometry import Cylinder, Ellipse, Pose
from lsvision.profile import Profile

# Same examples each run: a suite is green or it is not. Nothing is written beside the code.
PROPERTY = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)

seeds = st.integers(0, 2**32 - 1)
lengths = st.floats(-500.0, 500.0)
angles = st.floats(-4 * math.pi, 4 * math.pi)


@st.composite
def ellipses(draw, phi_deg=(0.0, 80.0)):
    """Sections of pipes of 1 to 100 mm radius."""
    radius = draw(st.floats(1.0, 100.0))
    phi = math.radians(draw(st.floats(*phi_deg)))
    return Ellipse((draw(lengths), draw(lengths)), radius / math.cos(phi), radius, draw(angles))


@st.composite
def directions(draw, smallest_z=0.0):
    """Unit vectors whose z is at least so large."""
    turn, z = draw(angles), draw(st.floats(smallest_z, 1.0)) * draw(st.sampled_from([-1.0, 1.0]))
    across = math.sqrt(1 - z * z)
    return np.array([across * math.cos(turn), across * math.sin(turn), z])


@st.composite
def cylinders(draw, smallest_z=0.1):
    """Cylinders that cross the section plane, tilted by 84 deg at the most."""
    point = [draw(lengths) for _ in range(3)]
    return Cylinder(point, draw(directions(smallest_z)), draw(st.floats(1.0, 100.0)))


@st.composite
def poses(draw):
    """Any rotation, from a random quaternion; half a metre away at the most."""
    rng = np.random.default_rng(draw(seeds))
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return Pose(rotation, [draw(lengths) for _ in range(3)])


@st.composite
def arcs_with_noise(draw, noise_mm=0.0):
    """An ellipse at 400 mm and points on 100 to 170 deg of its upper side: (ellipse, points)."""
    radius, phi = draw(st.floats(10.0, 40.0)), math.radians(draw(st.floats(0.0, 40.0)))
    ellipse = Ellipse((draw(st.floats(-60, 60)), -400.0), radius / math.cos(phi), radius,
                      draw(st.floats(0, math.pi)))  # fmt: skip
    half = math.radians(draw(st.floats(100.0, 170.0)) / 2)
    # The eccentric anomaly of the direction towards the sensor.
    top = math.pi / 2 - ellipse.theta
    points = ellipse.points_at(np.linspace(top + half, top - half, draw(st.integers(30, 120))))
    rng = np.random.default_rng(draw(seeds))
    return ellipse, points + noise_mm * rng.normal(size=points.shape)


@st.composite
def random_profiles(draw):
    """Random walks, steps, arcs, planes; with duplicates, lost points, huge and infinite values."""
    rng = np.random.default_rng(draw(seeds))
    count = draw(st.integers(0, 160))
    points = draw(st.sampled_from(MAKERS))(rng, count) * draw(
        st.sampled_from([1.0, 1.0, 1e-6, 1e5, 1e12])
    )
    points = points + draw(st.sampled_from([0.0, 400.0, 1e6]))
    for spoil in draw(st.lists(st.sampled_from(SPOILERS), max_size=3)):
        points = spoil(rng, points)
    return Profile(points)


def _walk(rng, count):
    steps = rng.normal(size=count) * rng.choice([0.05, 0.5, 5.0])
    return np.column_stack([0.6 * np.arange(count), np.cumsum(steps)])


def _steps(rng, count):
    level = np.repeat(rng.uniform(-50, 50, 8), 20)[:count]
    return np.column_stack([0.6 * np.arange(count), level + 0.05 * rng.normal(size=count)])


def _arcs(rng, count):
    x = 0.6 * np.arange(count)
    y = np.full(count, -440.0)
    for centre in rng.uniform(0, 0.6 * max(count, 1), 2):
        radius = rng.uniform(2, 40)
        height = radius**2 - (x - centre) ** 2
        y = np.maximum(y, np.where(height > 0, np.sqrt(np.abs(height)) - 430.0, -440.0))
    return np.column_stack([x, y + rng.choice([0.0, 0.01, 0.2]) * rng.normal(size=count)])


def _cloud(rng, count):
    return rng.normal(size=(count, 2)) * 50


def _line(rng, count):
    x = np.linspace(0, rng.uniform(0, 200), count)
    return np.column_stack([x, rng.choice([0.0, 1.0, -3.0]) * x])


def _one_place(rng, count):
    return np.repeat(rng.normal(size=(1, 2)), count, axis=0)


def _ring(rng, count):
    turn = np.linspace(0, rng.uniform(1, 12), count)
    return 20 * np.column_stack([np.cos(turn), np.sin(turn)])


MAKERS = (_walk, _steps, _arcs, _arcs, _cloud, _line, _one_place, _ring)


def _lose(rng, points):
    return np.where(rng.random((len(points), 1)) < 0.3, np.nan, points)


def _jump(rng, points):
    jumps = (rng.random(len(points)) < 0.1) * rng.normal(size=len(points)) * 1e3
    return points + np.column_stack([0 * jumps, jumps])


def _go_to_infinity(rng, points):
    return np.where(rng.random(points.shape) < 0.02, np.inf, points)


def _repeat(rng, points):
    return points[np.sort(rng.integers(0, len(points), len(points)))] if len(points) else points


def _shuffle(rng, points):
    return rng.permutation(points)


def _quantise(_rng, points):
    return np.round(points)


def _put_in_rubbish(rng, points):
    rubbish = rng.choice([1e15, -1e300, 1e-300], size=points.shape)
    return np.where(rng.random(points.shape) < 0.01, rubbish, points)


SPOILERS = (_lose, _jump, _go_to_infinity, _repeat, _shuffle, _quantise, _put_in_rubbish)
