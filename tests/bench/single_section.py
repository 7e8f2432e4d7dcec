"""Errors of one section against the Cramer-Rao bound, over random tubes with phi >= 15 deg.

The spread of a few hundred runs is itself uncertain by 5 %, and the worst of sixty such numbers
by 12 %. So each run is compared with the linear estimate from the same noise, whose spread is the
bound exactly: RMSE^2 = bound^2 + mean(error^2 - linear error^2), and the bias is the mean of
error - linear error. What chance does to both cancels.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from lsvision.geometry import Ellipse, orthogonal_residuals
from lsvision.measure import measure_cylinders
from lsvision.planning import section_bound
from lsvision.simulate import (
    SCENE_KINDS,
    SCENE_SENSOR,
    Scene,
    SectionSettings,
    TubeRanges,
    simulate_section,
)
from lsvision.simulate.scene_kinds import NOISE_MM
from lsvision.simulate.section import noise_std
from tests.bench.goals import Number
from tests.bench.matching import match_tubes
from tests.bench.progress import counted

FIRST_SEED = 20_000
MIN_PHI_DEG = 15.0
QUANTITIES = ("radius", "theta", "phi")
CLEAN = SectionSettings(lost_fraction=0.0, jump_fraction=0.0)
"""Errors along the ray and grazing loss, nothing else."""
ROUGH = SectionSettings(lost_fraction=0.10, jump_fraction=0.05)
STEP = 1e-4  # mm, rad: central differences of the distance, exact to 1e-9


@dataclass(frozen=True)
class Conditions:
    """What is done to the sections of one table."""

    name: str
    settings: SectionSettings = CLEAN
    radius_known: bool = False
    phi_deg: tuple[float, float] = (MIN_PHI_DEG, 40.0)


@dataclass(frozen=True)
class Efficiency:
    """Ratios and biases, one row a tube and one column a quantity."""

    conditions: Conditions
    ratios: np.ndarray
    biases: np.ndarray
    runs: int
    lacking: int
    false: int
    tubes: tuple[str, ...] = field(repr=False)

    @property
    def numbers(self):
        return (*_ratio_rows(self, QUANTITIES, 1.05, 1.15), *_bias_rows(self), *_count_rows(self))

    @property
    def rough_numbers(self):
        return (*_ratio_rows(self, QUANTITIES, 1.2, 1.2), *_count_rows(self))

    @property
    def known_radius_numbers(self):
        return (*_ratio_rows(self, ("phi",), 1.10, 1.10), *_count_rows(self))


def _ratio_rows(result, quantities, median, worst):
    name = result.conditions.name
    for quantity in quantities:
        column = result.ratios[:, QUANTITIES.index(quantity)]
        at = int(np.argmax(column))
        yield Number(f"{name}: {quantity} RMSE/bound, median", np.median(column), high=median)
        yield Number(
            f"{name}: {quantity} RMSE/bound, worst", column[at], high=worst, note=result.tubes[at]
        )


def _bias_rows(result):
    worst = np.abs(result.biases).max(axis=0)
    at = np.abs(result.biases).argmax(axis=0)
    for quantity, value, tube in zip(QUANTITIES, worst, at, strict=True):
        what = f"{result.conditions.name}: {quantity} bias, worst"
        yield Number(what, value, high=0.15, unit="sd", note=result.tubes[tube])


def _count_rows(result):
    note = f"of {result.runs * len(result.ratios)} sections"
    yield Number(f"{result.conditions.name}: tubes missed", result.lacking, high=0, note=note)
    yield Number(f"{result.conditions.name}: false tubes", result.false, note=note)


def compare_with_bound(conditions, tubes, runs):
    """Measure `runs` sections of each of `tubes` random tubes."""
    rows = [
        _one_tube(conditions, FIRST_SEED + tube, runs)
        for tube in counted(range(tubes), f"bound, {conditions.name}")
    ]
    ratios, biases, lacking, false, names = zip(*rows, strict=True)
    return Efficiency(
        conditions, np.array(ratios), np.array(biases), runs, sum(lacking), sum(false), names
    )


def random_tube(seed, phi_deg):
    """Scene with one tube, its sensor, and words that say which."""
    rng = np.random.default_rng(seed)
    noise = float(rng.uniform(*NOISE_MM))
    scene: Scene = SCENE_KINDS["single"](rng, TubeRanges(phi_deg=phi_deg))
    # No quantum: along the ray there is noise and nothing else.
    return scene, replace(SCENE_SENSOR, range_std=noise, quantum=0.0)


def _one_tube(conditions, seed, runs):
    scene, sensor = random_tube(seed, conditions.phi_deg)
    errors, linears, squares, lacking, false = [], [], [], 0, 0
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        section = simulate_section(scene, sensor, conditions.settings, rng=rng)
        (tube,) = section.truth.tubes
        known = tube.radius if conditions.radius_known else None
        match = match_tubes(measure_cylinders(section.profile, known_radius=known), section.truth)
        lacking, false = lacking + len(match.missed), false + len(match.false)
        if not match.found:
            continue
        linear, bound = _linear_errors(section, tube.ellipse, conditions.radius_known)
        errors.append(_errors(match.found[0][1], tube.ellipse))
        linears.append(linear)
        squares.append(bound**2)
    errors, linears, bound2 = np.array(errors), np.array(linears), np.mean(squares, axis=0)
    gained = (errors**2 - linears**2).mean(axis=0)
    # A radius that is known exactly has no error and no bound.
    safe = np.where(bound2 > 0, bound2, np.nan)
    ratio = np.sqrt(np.maximum(1 + gained / safe, 0.0))
    bias = (errors - linears).mean(axis=0) / np.sqrt(safe)
    return ratio, bias, lacking, false, _describe(tube.ellipse, sensor, np.sqrt(bound2[1:]))


def _describe(truth, sensor, bound):
    degrees = np.degrees([truth.theta, truth.phi, *bound])
    return (
        f"r {truth.radius:.0f} theta {degrees[0]:.0f} phi {degrees[1]:.0f} noise "
        f"{sensor.range_std:.2f}, bound theta {degrees[2]:.2g} phi {degrees[3]:.2g} deg"
    )


def _errors(found, truth):
    turn = (found.theta - truth.theta + math.pi / 2) % math.pi - math.pi / 2
    return np.array([found.radius - truth.radius, turn, found.phi - truth.phi])


def _linear_errors(section, truth, radius_known):
    """Errors of the linear estimate from this very noise, and their bound, of QUANTITIES."""
    seen = section.truth.labels == 1
    exact = section.truth.points[seen]
    rays = (exact - section.sensor.origin) / np.hypot(*(exact - section.sensor.origin).T)[:, None]
    std = noise_std(exact, section.sensor)
    covariances = std[:, None, None] ** 2 * rays[:, :, None] * rays[:, None, :]
    bound = section_bound(truth, exact, covariances, 0.0 if radius_known else None)
    across, gradient = _distance_gradients(truth, exact)
    noise = np.einsum("ni,ni->n", section.profile.points[seen] - exact, across)
    variance = (np.einsum("ni,ni->n", rays, across) * std) ** 2
    # Covariance of (centre, a, b, theta) times G' W noise; a step outwards lowers the distance.
    x = -bound.covariance @ gradient.T @ (noise / variance)
    a, b = truth.semi_major, truth.semi_minor
    phi = (b * x[2] / a - x[3]) / (a * math.sin(truth.phi))
    return np.array([x[3], x[4], phi]), np.array([bound.radius_std, bound.theta_std, bound.phi_std])


def _distance_gradients(truth, exact):
    """Change of each point's distance by its own two coordinates, and by the five unknowns."""

    def change(low, high):
        return (high - low) / (2 * STEP)

    def moved(index, by):
        values = [*truth.centre, truth.semi_major, truth.semi_minor, truth.theta]
        values[index] += by
        return orthogonal_residuals(exact, Ellipse((values[0], values[1]), *values[2:]))

    axes = np.eye(2) * STEP
    own = [
        change(orthogonal_residuals(exact - e, truth), orthogonal_residuals(exact + e, truth))
        for e in axes
    ]
    unknowns = [change(moved(i, -STEP), moved(i, STEP)) for i in range(5)]
    return np.column_stack(own), np.column_stack(unknowns)
