"""Coverage of the 95 % intervals, and how often a wrong theta is reported as determined."""

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
"""Width from which an interval of theta contains all directions. Units: rad."""
PHI_BANDS_DEG = ((0.0, 5.0), (5.0, 15.0), (15.0, 40.0))
MAX_THETA_ERROR = math.radians(30.0)
"""Error of theta above which it must not be reported as determined. Units: rad."""
CORRELATION_COLUMNS = 0.8
"""Correlation of the errors as in ``sphere-profiles``: 0.68 of neighbours, 0.2 at two columns."""


@dataclass(frozen=True)
class Conditions:
    """Errors of the simulated sensor, and whether the measurement gets the noise model."""

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
        "noise unknown, smoothed along the line",
        SectionSettings(lost_fraction=0, jump_fraction=0, correlation_columns=CORRELATION_COLUMNS),
        noise_given=False,
    ),
)
"""As for real files without the name of a sensor; without a goal."""


@dataclass(frozen=True)
class Coverage:
    """Results of n sections in which the tube was found, and the number of others.

    `phi` (n,) is the true tilt (rad), `contains_truth` (n, 5) whether the interval of each of
    `QUANTITIES` contains the truth, `any_direction` (n,) whether that of theta contains all
    directions, and `theta_wrong` (n,) whether theta is reported as determined and is not.
    """

    conditions: Conditions
    phi: np.ndarray
    contains_truth: np.ndarray
    any_direction: np.ndarray
    theta_wrong: np.ndarray
    missed: int

    @property
    def numbers(self):
        name = self.conditions.name
        goal = (93, 97) if self.conditions.noise_given else (-math.inf, math.inf)
        chance = f"+/- {100 * math.sqrt(0.95 * 0.05 / len(self.phi)):.1f} by chance"
        for quantity, coverage in zip(QUANTITIES, self.contains_truth.mean(axis=0), strict=True):
            yield Number(f"{name}: 95 % of {quantity}", 100 * coverage, *goal, "%", chance)
        wrong = 100 * self.theta_wrong.mean()
        yield Number(f"{name}: theta determined, off by > 30 deg", wrong, high=1.0, unit="%")
        note = f"{self.any_direction.sum()} sections allow any direction and are left out"
        coverage = 100 * self.contains_truth[~self.any_direction, 1].mean()
        yield Number(f"{name}: 95 % of theta, if it is bounded", coverage, unit="%", note=note)
        yield Number(f"{name}: tubes missed", self.missed, note=f"beside {len(self.phi)} found")
        yield from self._bands()

    def _bands(self):
        for low, high in PHI_BANDS_DEG:
            within = (np.radians(low) <= self.phi) & (self.phi < np.radians(high))
            coverage = 100 * self.contains_truth[within].mean(axis=0)
            each = ", ".join(f"{q} {c:.1f}" for q, c in zip(QUANTITIES, coverage, strict=True))
            what = f"{self.conditions.name}: phi {low:g}-{high:g} deg, lowest coverage"
            yield Number(what, coverage.min(), unit="%", note=f"{each}; {within.sum()} sections")


@dataclass(frozen=True)
class SquareOn:
    """Results for pipes along the laser plane's normal (phi = 0), whose theta is undefined."""

    sections: int
    determined: int
    phi_excludes_zero: int

    @property
    def numbers(self):
        determined, excluded = (
            100 * count / self.sections for count in (self.determined, self.phi_excludes_zero)
        )
        yield Number("phi = 0: theta reported as determined", determined, high=1.0, unit="%")
        yield Number("phi = 0: 95 % of phi contains 0", 100 - excluded, unit="%")


def count_coverage(conditions, sections):
    """Measure one section of each of `sections` random tubes, phi 0-40 deg."""
    rows, missed = [], 0
    for seed in counted(range(FIRST_SEED, FIRST_SEED + sections), f"coverage, {conditions.name}"):
        section = random_section("single", seed, settings=conditions.settings)
        noise = section.profile.noise if conditions.noise_given else None
        profile = Profile(section.profile.points, noise=noise)
        found = match_tubes(measure_cylinders(profile), section.truth).found
        if found:
            rows.append(_judge(found[0][1], section.truth.tubes[0]))
        else:
            missed += 1
    return Coverage(conditions, *map(np.array, zip(*rows, strict=True)), missed)


def count_square_on(sections):
    """Measure one section of each of `sections` random tubes with phi = 0."""
    determined = excluded = 0
    square = TubeRanges(phi_deg=(0.0, 0.0))
    for seed in counted(range(FIRST_SEED, FIRST_SEED + sections), "phi = 0"):
        section = random_section("single", seed, tubes=square)
        for _, cylinder, _ in match_tubes(measure_cylinders(section.profile), section.truth).found:
            determined += cylinder.theta_determined
            excluded += cylinder.interval("phi")[0] > 0
    return SquareOn(sections, determined, excluded)


def _judge(cylinder, truth):
    """Return true phi, coverage of each interval, and the two flags of `Coverage` on theta."""
    true = dict(zip(QUANTITIES, (truth.radius, truth.theta, truth.phi, *truth.centre), strict=True))
    intervals = {quantity: cylinder.interval(quantity) for quantity in QUANTITIES}
    contains = [low <= true[quantity] <= high for quantity, (low, high) in intervals.items()]
    low, high = intervals["theta"]
    contains[1] = (truth.theta - low) % math.pi <= high - low
    theta_error = abs((cylinder.theta - truth.theta + math.pi / 2) % math.pi - math.pi / 2)
    wrong = cylinder.theta_determined and theta_error > MAX_THETA_ERROR
    return truth.phi, contains, high - low > ANY_DIRECTION, wrong
