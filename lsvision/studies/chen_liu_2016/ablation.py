"""Ablation: errors with each step left out, or done as in the paper, on the same sections.

The sections show pipes alone, welded and among clutter, with lost points and jumps. Detection
runs once for each section; each variant then fits its own ellipse to the same arc. Errors are
divided by the Cramer-Rao bound of the pipe, so that pipes of all sizes and tilts can be pooled.
Steps that only improve the initial guess reduce the number of evaluations of the iterative fit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.candidates import fit_seed_ellipse
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.errors import LsvisionError
from lsvision.geometry import FloatArray, IntArray
from lsvision.planning import section_bound
from lsvision.simulate import (
    SectionSettings,
    SimulatedSection,
    TubeRanges,
    TubeTruth,
    random_section,
)
from lsvision.studies.chen_liu_2016.steps import detect_arcs
from lsvision.studies.chen_liu_2016.tables import ProgressCallback
from lsvision.studies.chen_liu_2016.variants import VARIANTS, AblationArc, Variant, VariantFit

KINDS = ("single", "welded_pair", "complex")
"""Kinds of simulated scenes, keys of `SCENE_KINDS`."""
TUBES = TubeRanges(radius_mm=(15.0, 29.0), phi_deg=(15.0, 30.0))
"""Radii of the paper's tables, and tilts as in them but for phi = 10 deg."""
SECTION_SETTINGS = SectionSettings(lost_fraction=0.03, jump_fraction=0.05)
"""Errors of the sensor in every section: enough jumps that each arc contains some of them."""
MEDIAN_OF_MODULUS = NormalDist().inv_cdf(0.75)
"""Median of the absolute value of a standard normal variable."""
QUANTILE_95 = NormalDist().inv_cdf(0.975)
"""95 % quantile of the absolute value of a standard normal variable."""


@dataclass(frozen=True, slots=True)
class AblationResult:
    """Errors of a variant over the Cramer-Rao bound.

    Parameters
    ----------
    group, name : str
        Group and name of the variant.
    pipes, failed : int
        Number of pipes, and of those without an ellipse.
    typical : tuple of float
        Median error of radius, theta, phi over that of an efficient method; 1 is ideal.
    worst : tuple of float
        95 % quantiles of the errors over those of an efficient method.
    evaluations : float
        Mean number of evaluations of the residuals in the iterative fit.
    """

    group: str
    name: str
    pipes: int
    failed: int
    typical: tuple[float, float, float]
    worst: tuple[float, float, float]
    evaluations: float


@dataclass(frozen=True, eq=False, slots=True)
class _Outcome:
    """Moduli of the errors (3,) of one pipe over the bound, and evaluations of the fit."""

    errors: FloatArray
    evaluations: int


def run_ablation(
    scenes: int, *, noise_mm: float, seed: int = 0, progress: ProgressCallback = lambda _: None
) -> tuple[AblationResult, ...]:
    """Measure the errors of every variant on the same random sections, `scenes` of each kind.

    `noise_mm` is the standard deviation along the ray at 400 mm, `seed` that of the first scene;
    `progress` is called with a text before each kind.
    """
    outcomes: dict[str, list[_Outcome | None]] = {variant.name: [] for variant in VARIANTS}
    for kind in KINDS:
        progress(f"ablation: {kind.replace('_', ' ')}")
        for number in range(seed, seed + scenes):
            section = random_section(
                kind, number, noise_mm=noise_mm, settings=SECTION_SETTINGS, tubes=TUBES
            )
            for tube, arc in _detect_arcs(section):
                bound = _bound(section, tube)
                for variant in VARIANTS:
                    outcomes[variant.name].append(_apply_variant(variant, arc, tube, bound))
    return tuple(_summarise(variant, outcomes[variant.name]) for variant in VARIANTS)


def _detect_arcs(section: SimulatedSection) -> list[tuple[TubeTruth, AblationArc]]:
    """Return each detected pipe with its arc and the first candidate on it."""
    profile = prepare_profile(section.profile, section.profile.noise)
    arcs, candidates = detect_arcs(profile)
    seeds = [IdentifiedArc(c.indices, fit_seed_ellipse(profile, c)) for c in candidates]
    labels = section.truth.labels[profile.sensor_columns]
    detected = []
    for tube in section.truth.tubes:
        arc = next((a for a in arcs if _are_mostly_on(labels, a.indices, tube.label)), None)
        seed = next((s for s in seeds if _are_mostly_on(labels, s.indices, tube.label)), None)
        if arc is not None and seed is not None:
            detected.append((tube, AblationArc(profile, arc, seed)))
    return detected


def _are_mostly_on(labels: IntArray, indices: IntArray, label: int) -> bool:
    """Return whether more than half of the points belong to the pipe with a label."""
    return bool((labels[indices] == label).mean() > 0.5)


def _bound(section: SimulatedSection, tube: TubeTruth) -> FloatArray:
    """Return the Cramer-Rao bound (3,) as stds of radius (mm), theta and phi (rad)."""
    on_pipe = section.truth.labels == tube.label
    covariances = section.sensor.covariances(section.truth.points)[on_pipe]
    bound = section_bound(tube.ellipse, section.truth.points[on_pipe], covariances)
    return np.array([bound.radius_std, bound.theta_std, bound.phi_std])


def _apply_variant(
    variant: Variant, arc: AblationArc, tube: TubeTruth, bound: FloatArray
) -> _Outcome | None:
    """Return the errors of a variant on an arc; None if no ellipse fits."""
    try:
        fit = variant.fit(arc)
    except LsvisionError:
        return None
    return _Outcome(_compute_errors(fit, tube) / bound, fit.evaluations)


def _compute_errors(fit: VariantFit, tube: TubeTruth) -> FloatArray:
    """Return the absolute errors of radius (mm), theta and phi (rad)."""
    ellipse = fit.ellipse
    theta_error = (ellipse.theta - tube.theta + math.pi / 2) % math.pi - math.pi / 2
    return np.abs([ellipse.radius - tube.radius, theta_error, ellipse.phi - tube.phi])


def _summarise(variant: Variant, outcomes: Sequence[_Outcome | None]) -> AblationResult:
    """Return the median and 95 % quantile of the errors of a variant over all pipes."""
    fitted = [outcome for outcome in outcomes if outcome is not None]
    errors = np.array([outcome.errors for outcome in fitted]) if fitted else np.full((1, 3), np.nan)
    typical = np.median(errors, axis=0) / MEDIAN_OF_MODULUS
    worst = np.quantile(errors, 0.95, axis=0) / QUANTILE_95
    return AblationResult(
        group=variant.group,
        name=variant.name,
        pipes=len(outcomes),
        failed=len(outcomes) - len(fitted),
        typical=tuple(typical.tolist()),
        worst=tuple(worst.tolist()),
        evaluations=float(np.mean([o.evaluations for o in fitted])) if fitted else math.nan,
    )
