"""How often a verdict is wrong, and how often it is open, on simulated parts near their limits.

``python -m tests.inspection.false_verdicts [PARTS]`` prints it for every condition.
"""

import math
import sys
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from lsvision.errors import DegenerateGeometry
from lsvision.inspection.decision import Decision, judge_quantity
from lsvision.inspection.job_tables import Part
from lsvision.inspection.quantities import measure_quantity
from lsvision.measure import measure_cylinders
from lsvision.planning import section_bound
from lsvision.simulate import TubeRanges, random_section
from tests.bench.matching import match_tubes

LEVEL, SIGMAS = 0.95, 3.0
FIRST_SEED = 710_000
KEYS = ("radius_mm", "theta_deg", "phi_deg", "centre_x_mm", "centre_y_mm")
NOISES_MM = (0.02, 0.05, 0.1)
PHI_BANDS_DEG = ((0.0, 5.0), (5.0, 15.0), (15.0, 40.0))
KINDS = ("single", "complex")
PART = Part(name="tube", order=1)


@dataclass(frozen=True)
class Condition:
    kind: str
    noise_mm: float
    phi_deg: tuple[float, float]

    def __str__(self):
        low, high = self.phi_deg
        return f"{self.kind}, noise {self.noise_mm:g} mm, phi {low:g}-{high:g} deg"


CONDITIONS = tuple(
    Condition(kind, noise, band) for kind in KINDS for noise in NOISES_MM for band in PHI_BANDS_DEG
)


@dataclass(frozen=True)
class Outcome:
    """Verdicts on a quantity of one part, by limits that are up to 3 sigma from the truth.

    Parameters
    ----------
    false_ok, false_ng : bool
        Whether the part is OK by a limit that it violates, NG by one that it keeps; each limit lies
        at a random distance from the truth.
    at_limit : int
        Number of ends of the interval, 0 or 1, that are on the wrong side of the truth.
    undecided, least : float
        Fraction of all such limits by which the part is undecided, and the smallest one that is
        possible with the best estimate; NaN where unknown.
    """

    false_ok: bool
    false_ng: bool
    at_limit: int
    undecided: float
    least: float


def simulate_part(condition, seed):
    """Outcomes by key of one simulated part; None if it was not found or cannot be drawn."""
    tubes = TubeRanges(phi_deg=condition.phi_deg)
    try:
        section = random_section(condition.kind, seed, noise_mm=condition.noise_mm, tubes=tubes)
    except DegenerateGeometry:
        return None
    found = match_tubes(measure_cylinders(section.profile), section.truth).found
    if not found:
        return None
    rng = np.random.default_rng(seed)
    truth, cylinder = section.truth.tubes[0], found[0][1]
    stds = ideal_stds(section)
    values = {
        "radius_mm": truth.radius,
        "theta_deg": math.degrees(truth.theta),
        "phi_deg": math.degrees(truth.phi),
        "centre_x_mm": truth.centre[0],
        "centre_y_mm": truth.centre[1],
    }
    return {key: outcome(cylinder, key, values[key], stds.get(key), rng) for key in KEYS}


def ideal_stds(section):
    """Standard deviations of the best possible estimate, where it is normally distributed."""
    truth = section.truth.tubes[0]
    points = section.profile.points[section.truth.labels == 1]
    bound = section_bound(
        truth.cylinder.section(), points, section.profile.noise.covariances(points)
    )
    stds = np.sqrt(np.diag(bound.covariance))
    phi_std = bound.phi_std
    if truth.phi < 4 * phi_std:
        return {}
    return {
        "radius_mm": bound.radius_std,
        "phi_deg": math.degrees(phi_std),
        "theta_deg": math.degrees(stds[4]),
        "centre_x_mm": bound.centre_x_std,
        "centre_y_mm": bound.centre_y_std,
    }


def outcome(cylinder, key, truth, ideal_std, rng):
    estimate = measure_quantity(cylinder, PART, key, LEVEL)
    if key == "theta_deg":
        truth += 180 * round((estimate.value - truth) / 180)
    std = ideal_std if ideal_std is not None else min(estimate.std, 10.0)
    shift = rng.uniform(0, SIGMAS) * std
    above = rng.random() < 0.5
    bad = (-math.inf, truth - shift) if above else (truth + shift, math.inf)
    good = (-math.inf, truth + shift) if above else (truth - shift, math.inf)
    low, high = estimate.interval if estimate.determined else (-math.inf, math.inf)
    covered = min(high, truth + SIGMAS * std) - max(low, truth - SIGMAS * std)
    return Outcome(
        false_ok=judge_quantity(estimate, bad, LEVEL).decision == Decision.OK,
        false_ng=judge_quantity(estimate, good, LEVEL).decision == Decision.NG,
        at_limit=int(high < truth) + int(low > truth),
        undecided=max(covered, 0.0) / (2 * SIGMAS * std),
        least=math.nan if ideal_std is None else MIN_UNDECIDED,
    )


def _min_undecided():
    """Fraction of limits within 3 sigma that are open to the interval of a normal estimate."""
    half = 1.959964
    shifts = np.linspace(-SIGMAS, SIGMAS, 2001)
    return float(np.mean(ndtr(half - shifts) - ndtr(-half - shifts)))


MIN_UNDECIDED = _min_undecided()


def run(condition, parts, first_seed=FIRST_SEED):
    """Outcomes of as many parts, and how many were not found."""
    results = [simulate_part(condition, seed) for seed in range(first_seed, first_seed + parts)]
    return [result for result in results if result is not None], results.count(None)


def shares(results, key):
    """False OK, false NG, wrong at the limit (one-sided), undecided over the least share."""
    outcomes = [result[key] for result in results]
    known = [each for each in outcomes if math.isfinite(each.least)]
    ratio = (
        sum(each.undecided for each in known) / sum(each.least for each in known)
        if known
        else math.nan
    )
    return (
        np.mean([each.false_ok for each in outcomes]),
        np.mean([each.false_ng for each in outcomes]),
        np.mean([each.at_limit for each in outcomes]) / 2,
        ratio,
    )


def main(parts):
    for number, condition in enumerate(CONDITIONS):
        results, lost = run(condition, parts, FIRST_SEED + 100_000 * number)
        print(f"{condition}: {len(results)} parts, {lost} not found", flush=True)
        for key in KEYS:
            false_ok, false_ng, at_limit, ratio = shares(results, key)
            print(
                f"  {key:12} false OK {100 * false_ok:.2f} %, false NG {100 * false_ng:.2f} %, "
                f"at the limit {100 * at_limit:.2f} %, undecided {ratio:.2f} times the least",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1112)
