"""What each step is worth: left out, or done as the paper's text has it, on the same sections.

Pipes alone, welded and among clutter, with lost points and jumps. Detection runs once a section;
each variant then makes its own ellipse of the same arc. Errors are counted in units of each
pipe's own bound, so that pipes of all sizes and tilts can be pooled. What only helps the
iterative fit to converge shows in the number of its evaluations.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.candidates import find_candidates, seed_ellipse
from lsvision.detection.identification import identify_arcs
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import connected_components, rasterise
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
from lsvision.studies.chen_liu_2016.variants import VARIANTS, AblationArc, Variant, VariantFit

KINDS = ("single", "welded_pair", "complex")
TUBES = TubeRanges(radius_mm=(15.0, 29.0), phi_deg=(15.0, 30.0))
SECTION_SETTINGS = SectionSettings(lost_fraction=0.03, jump_fraction=0.05)
"""Of every section: enough jumps that each pipe has some of them inside its arc."""
RADIUS_RANGE = (10.0, 40.0)
MIN_WINDOW_POINTS = 10
TYPICAL = NormalDist().inv_cdf(0.75)
"""Median of the modulus of a standard normal number."""
QUANTILE_95 = NormalDist().inv_cdf(0.975)


@dataclass(frozen=True, slots=True)
class AblationResult:
    """What a variant costs.

    Parameters
    ----------
    group, name : str
        Of the variant.
    pipes, failed : int
        Pipes tried, and how many of them got no ellipse.
    typical : tuple of float
        Median error of radius, theta, phi over what the best possible method has; 1 is ideal.
    worst : tuple of float
        The same of the error that 19 of 20 stay below.
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
    """What a variant made of one pipe: moduli of its errors over the bound, and its evaluations."""

    errors: FloatArray
    evaluations: int


def run_ablation(
    scenes: int, *, noise_mm: float, seed: int = 0, say: Callable[[str], None] = lambda _: None
) -> tuple[AblationResult, ...]:
    """Cost of every variant on the same random sections.

    Parameters
    ----------
    scenes : int
        Of each kind: single, welded pair, complex.
    noise_mm : float
        One sigma along the ray at 400 mm. Units: mm.
    seed : int
        Of the first scene.
    say : callable
        Told of each kind.
    """
    outcomes: dict[str, list[_Outcome | None]] = {variant.name: [] for variant in VARIANTS}
    for kind in KINDS:
        say(f"ablation: {kind.replace('_', ' ')}")
        for number in range(seed, seed + scenes):
            section = random_section(
                kind, number, noise_mm=noise_mm, settings=SECTION_SETTINGS, tubes=TUBES
            )
            for tube, arc in _arcs_in_hand(section):
                sigmas = _bound(section, tube)
                for variant in VARIANTS:
                    outcomes[variant.name].append(_try_variant(variant, arc, tube, sigmas))
    return tuple(_cost(variant, outcomes[variant.name]) for variant in VARIANTS)


def _arcs_in_hand(section: SimulatedSection) -> list[tuple[TubeTruth, AblationArc]]:
    """Each pipe that detection finds, with its arc and the candidate that seeded it."""
    profile = prepare_profile(section.profile, section.profile.noise)
    components = connected_components(rasterise(profile), MIN_WINDOW_POINTS)
    candidates = find_candidates(profile, components, RADIUS_RANGE)
    arcs, _ = identify_arcs(profile, candidates, RADIUS_RANGE)
    seeds = [IdentifiedArc.of(c.indices, seed_ellipse(profile, c)) for c in candidates]
    labels = section.truth.labels[profile.sensor_columns]
    found = []
    for tube in section.truth.tubes:
        arc = next((a for a in arcs if _mostly(labels, a.indices, tube.label)), None)
        seed = next((s for s in seeds if _mostly(labels, s.indices, tube.label)), None)
        if arc is not None and seed is not None:
            found.append((tube, AblationArc(profile, arc, seed)))
    return found


def _mostly(labels: IntArray, indices: IntArray, label: int) -> bool:
    return bool((labels[indices] == label).mean() > 0.5)


def _bound(section: SimulatedSection, tube: TubeTruth) -> FloatArray:
    on_pipe = section.truth.labels == tube.label
    covariances = section.sensor.covariances(section.truth.points)[on_pipe]
    bound = section_bound(tube.ellipse, section.truth.points[on_pipe], covariances)
    return np.array([bound.radius_std, bound.theta_std, bound.phi_std])


def _try_variant(
    variant: Variant, arc: AblationArc, tube: TubeTruth, sigmas: FloatArray
) -> _Outcome | None:
    """What a variant makes of an arc; None where there is no ellipse."""
    try:
        fit = variant.fit_of(arc)
    except LsvisionError:
        return None
    return _Outcome(_errors(fit, tube) / sigmas, fit.evaluations)


def _errors(fit: VariantFit, tube: TubeTruth) -> FloatArray:
    """Moduli of the errors of radius (mm), theta and phi (rad)."""
    ellipse = fit.ellipse
    turn = (ellipse.theta - tube.theta + math.pi / 2) % math.pi - math.pi / 2
    return np.abs([ellipse.radius - tube.radius, turn, ellipse.phi - tube.phi])


def _cost(variant: Variant, outcomes: Sequence[_Outcome | None]) -> AblationResult:
    found = [outcome for outcome in outcomes if outcome is not None]
    errors = np.array([outcome.errors for outcome in found]) if found else np.full((1, 3), np.nan)
    typical = np.median(errors, axis=0) / TYPICAL
    worst = np.quantile(errors, 0.95, axis=0) / QUANTILE_95
    return AblationResult(
        group=variant.group,
        name=variant.name,
        pipes=len(outcomes),
        failed=len(outcomes) - len(found),
        typical=tuple(typical.tolist()),
        worst=tuple(worst.tolist()),
        evaluations=float(np.mean([o.evaluations for o in found])) if found else math.nan,
    )
