"""How often the 95 % intervals hold the truth, and how often theta is trusted wrongly."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.measure import measure_cylinders
from lsvision.profile import Profile
from lsvision.simulate import SectionSettings, TubeRanges, random_section
from tests.bench.goals import Number
from tests.bench.matching import match_tubes
from tests.bench.progress import counted
from tests.bench.single_section import CLEAN, ROUGH

FIRST_SEED = 30_000
QUANTITIES = ("radius", "theta", "phi", "centre_x", "centre_y")
ANY_DIRECTION = math.pi - 1e-6
PHI_BANDS_DEG = ((0.0, 5.0), (5.0, 15.0), (15.0, 40.0))
WRONG_THETA = math.radians(30.0)
BLENDED_COLUMNS = 0.8
"""Errors as alike as those of ``sphere-profiles``: correlation 0.68 one point on, 0.2 two on."""


@dataclass(frozen=True)
class Conditions:
    """What is done to the sections, and whether the noise is given to the measurement."""

    name: str
    settings: SectionSettings
    noise_given: bool = True


CONDITIONS = (
    Conditions("clean", CLEAN),
    Conditions("3 % lost, 2 % jumps", SectionSettings()),
    Conditions("10 % lost, 5 % jumps", ROUGH),
)
NOISE_UNKNOWN = (
    Conditions("noise unknown", CLEAN, noise_given=False),
    Conditions(
        "noise unknown, blended along the line",
        SectionSettings(lost_fraction=0, jump_fraction=0, correlation_columns=BLENDED_COLUMNS),
        noise_given=False,
    ),
)
"""No goal of the issue, but what real files without a sensor's name are."""


@dataclass(frozen=True)
class Coverage:
    """One row per section: true phi, whether each interval holds, and what is said of theta."""

    conditions: Conditions
    phi: np.ndarray
    holds: np.ndarray
    any_direction: np.ndarray
    theta_wrong: np.ndarray
    lacking: int

    @property
    def numbers(self):
        name = self.conditions.name
        goal = (93, 97) if self.conditions.noise_given else (-math.inf, math.inf)
        for quantity, share in zip(QUANTITIES, self.holds.mean(axis=0), strict=True):
            yield Number(f"{name}: 95 % of {quantity}", 100 * share, *goal, "%", _spread(self.phi))
        wrong = 100 * self.theta_wrong.mean()
        yield Number(f"{name}: theta trusted, off by > 30 deg", wrong, high=1.0, unit="%")
        pointing = self.holds[~self.any_direction, 1]
        note = f"{self.any_direction.sum()} sections allow any direction and are left out"
        share = 100 * pointing.mean()
        yield Number(f"{name}: 95 % of theta, if it has one", share, unit="%", note=note)
        yield Number(f"{name}: tubes missed", self.lacking, note=f"beside {len(self.phi)} found")
        yield from self._bands()

    def _bands(self):
        for low, high in PHI_BANDS_DEG:
            within = (np.radians(low) <= self.phi) & (self.phi < np.radians(high))
            shares = 100 * self.holds[within].mean(axis=0)
            words = ", ".join(f"{q} {s:.1f}" for q, s in zip(QUANTITIES, shares, strict=True))
            what = f"{self.conditions.name}: phi {low:g}-{high:g} deg, least"
            yield Number(what, shares.min(), unit="%", note=f"{words}; {within.sum()} sections")


def _spread(sample):
    return f"+/- {100 * math.sqrt(0.95 * 0.05 / len(sample)):.1f} by chance"


@dataclass(frozen=True)
class SquareOn:
    """Pipes seen along their axis: theta does not exist."""

    sections: int
    determined: int
    phi_excludes_zero: int

    @property
    def numbers(self):
        trusted, excluded = (
            100 * count / self.sections for count in (self.determined, self.phi_excludes_zero)
        )
        yield Number("phi = 0: theta held to be determined", trusted, high=1.0, unit="%")
        yield Number("phi = 0: 95 % of phi holds 0", 100 - excluded, unit="%")


def count_coverage(conditions, sections):
    """Intervals of one single-tube section each of `sections` random tubes, phi 0-40 deg."""
    rows, lacking = [], 0
    for seed in counted(range(FIRST_SEED, FIRST_SEED + sections), f"coverage, {conditions.name}"):
        section = random_section("single", seed, settings=conditions.settings)
        noise = section.profile.noise if conditions.noise_given else None
        profile = Profile(section.profile.points, noise=noise)
        found = match_tubes(measure_cylinders(profile), section.truth).found
        if found:
            rows.append(_judge(found[0][1], section.truth.tubes[0]))
        else:
            lacking += 1
    phi, holds, free, wrong = (np.array(column) for column in zip(*rows, strict=True))
    return Coverage(conditions, phi, holds, free, wrong, lacking)


def count_square_on(sections):
    """What is said of theta and phi where phi is 0."""
    determined = excluded = 0
    square = TubeRanges(phi_deg=(0.0, 0.0))
    for seed in counted(range(FIRST_SEED, FIRST_SEED + sections), "phi = 0"):
        section = random_section("single", seed, tubes=square)
        for _, cylinder, _ in match_tubes(measure_cylinders(section.profile), section.truth).found:
            determined += cylinder.theta_determined
            excluded += cylinder.interval("phi")[0] > 0
    return SquareOn(sections, determined, excluded)


def _judge(cylinder, truth):
    true = dict(zip(QUANTITIES, (truth.radius, truth.theta, truth.phi, *truth.centre), strict=True))
    intervals = {quantity: cylinder.interval(quantity) for quantity in QUANTITIES}
    holds = [low <= true[quantity] <= high for quantity, (low, high) in intervals.items()]
    low, high = intervals["theta"]
    holds[1] = (truth.theta - low) % math.pi <= high - low
    turn = abs((cylinder.theta - truth.theta + math.pi / 2) % math.pi - math.pi / 2)
    wrong = cylinder.theta_determined and turn > WRONG_THETA
    return truth.phi, holds, high - low > ANY_DIRECTION, wrong
