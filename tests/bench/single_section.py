"""Errors of one section compared with the Cramer-Rao bound, for random tubes with phi >= 15 deg.

The standard deviation of a few hundred runs is itself uncertain by 5 %, and the largest of sixty
such numbers by 12 %. Therefore each run is compared with the linear estimate from the same noise,
whose standard deviation is exactly the bound: RMSE^2 = bound^2 + mean(error^2 - linear error^2),
and the bias is the mean of error - linear error. The random parts of both cancel.
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
    """Errors of the simulated sensor, prior knowledge of the radius, and range of the tilts."""

    name: str
    settings: SectionSettings = CLEAN
    radius_known: bool = False
    phi_deg: tuple[float, float] = (MIN_PHI_DEG, 40.0)


@dataclass(frozen=True)
class Efficiency:
    """Results of `runs` sections of each tube.

    `ratios` (tubes, 3) are RMSE over the bound, `biases` (tubes, 3) the bias over the bound, of
    `QUANTITIES`; `missed` and `false` numbers of tubes and detections, `tubes` their descriptions.
    """

    conditions: Conditions
    ratios: np.ndarray
    biases: np.ndarray
    runs: int
    missed: int
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
    yield Number(f"{result.conditions.name}: tubes missed", result.missed, high=0, note=note)
    yield Number(f"{result.conditions.name}: false tubes", result.false, note=note)


def compare_with_bound(conditions, tubes, runs):
    """Measure `runs` sections of each of `tubes` random tubes."""
    rows = [
        _measure_tube(conditions, FIRST_SEED + tube, runs)
        for tube in counted(range(tubes), f"bound, {conditions.name}")
    ]
    ratios, biases, missed, false, names = zip(*rows, strict=True)
    return Efficiency(
        conditions, np.array(ratios), np.array(biases), runs, sum(missed), sum(false), names
    )


def random_tube(seed, phi_deg):
    """Return a scene with one random tube, and its sensor with random noise."""
    rng = np.random.default_rng(seed)
    noise = float(rng.uniform(*NOISE_MM))
    scene: Scene = SCENE_KINDS["single"](rng, TubeRanges(phi_deg=phi_deg))
    # No quantum: the noise along the ray is the only error.
    return scene, replace(SCENE_SENSOR, range_std=noise, quantum=0.0)


def _measure_tube(conditions, seed, runs):
    """Return ratios, biases, tubes missed, false detections and a description; see `Efficiency`."""
    scene, sensor = random_tube(seed, conditions.phi_deg)
    errors, linear_errors, bounds, missed, false = [], [], [], 0, 0
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        section = simulate_section(scene, sensor, conditions.settings, rng=rng)
        (tube,) = section.truth.tubes
        known = tube.radius if conditions.radius_known else None
        match = match_tubes(measure_cylinders(section.profile, known_radius=known), section.truth)
        missed, false = missed + len(match.missed), false + len(match.false)
        if not match.found:
            continue
        linear_error, bound = _linear_errors(section, tube.ellipse, conditions.radius_known)
        errors.append(_errors(match.found[0][1], tube.ellipse))
        linear_errors.append(linear_error)
        bounds.append(bound)
    errors, linear_errors = np.array(errors), np.array(linear_errors)
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    divisor = np.where(bound > 0, bound, np.nan)  # 0 for a radius that is known exactly
    excess = (errors**2 - linear_errors**2).mean(axis=0)
    ratio = np.sqrt(np.maximum(1 + excess / divisor**2, 0.0))
    bias = (errors - linear_errors).mean(axis=0) / divisor
    return ratio, bias, missed, false, _describe(tube.ellipse, sensor, bound[1:])


def _describe(truth, sensor, bound):
    """Return tube and noise as text; `bound` is that of theta and phi (rad)."""
    degrees = np.degrees([truth.theta, truth.phi, *bound])
    return (
        f"r {truth.radius:.0f} theta {degrees[0]:.0f} phi {degrees[1]:.0f} noise "
        f"{sensor.range_std:.2f}, bound theta {degrees[2]:.2g} phi {degrees[3]:.2g} deg"
    )


def _errors(found, truth):
    """Return the errors of `QUANTITIES` (mm, rad), (3,)."""
    theta_error = (found.theta - truth.theta + math.pi / 2) % math.pi - math.pi / 2
    return np.array([found.radius - truth.radius, theta_error, found.phi - truth.phi])


def _linear_errors(section, truth, radius_known):
    """Return the errors (3,) of the linear estimate from a section's noise, and the bound (3,)."""
    seen = section.truth.labels == 1
    exact = section.truth.points[seen]
    rays = (exact - section.sensor.origin) / np.hypot(*(exact - section.sensor.origin).T)[:, None]
    std = noise_std(exact, section.sensor)
    covariances = std[:, None, None] ** 2 * rays[:, :, None] * rays[:, None, :]
    bound = section_bound(truth, exact, covariances, 0.0 if radius_known else None)
    normals, gradient = _distance_gradients(truth, exact)
    noise = np.einsum("ni,ni->n", section.profile.points[seen] - exact, normals)
    variance = (np.einsum("ni,ni->n", rays, normals) * std) ** 2
    # Gauss-Newton step of (centre, a, b, theta): minus covariance times J' W times the residuals.
    x = -bound.covariance @ gradient.T @ (noise / variance)
    a, b = truth.semi_major, truth.semi_minor
    phi = (b * x[2] / a - x[3]) / (a * math.sin(truth.phi))  # of cos(phi) = b / a
    return np.array([x[3], x[4], phi]), np.array([bound.radius_std, bound.theta_std, bound.phi_std])


def _distance_gradients(truth, exact):
    """Return the derivatives of each point's distance by x, y (n, 2) and by the ellipse (n, 5)."""

    def derivative(low, high):
        return (high - low) / (2 * STEP)

    def distances_of_changed(index, by):
        values = [*truth.centre, truth.semi_major, truth.semi_minor, truth.theta]
        values[index] += by
        return orthogonal_residuals(exact, Ellipse((values[0], values[1]), *values[2:]))

    axes = np.eye(2) * STEP
    by_point = [
        derivative(orthogonal_residuals(exact - e, truth), orthogonal_residuals(exact + e, truth))
        for e in axes
    ]
    by_ellipse = [
        derivative(distances_of_changed(i, -STEP), distances_of_changed(i, STEP)) for i in range(5)
    ]
    return np.column_stack(by_point), np.column_stack(by_ellipse)
