"""Score results against the truth: found, missed and false pipes, errors and coverage."""

import math
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from tests.bench.matching import match_tubes

FAR_SIGMAS, TOO_FAR_SIGMAS = 3.0, 5.0
MIN_PIPES_OF_KIND = 10
"""Number of found pipes below which no coverage of a kind is given."""


@dataclass(frozen=True)
class FoundPipe:
    """A pipe that was found: error of its radius, in its standard uncertainties and in bounds.

    `bounds` is the error over the Cramer-Rao bound, `linear_bounds` that of the linear estimate
    from the same noise, `inside` whether the 95 % interval contains the radius, and `iou` the
    intersection over union of its points with the true ones.
    """

    scene: str
    kind: str
    sigmas: float
    bounds: float
    linear_bounds: float
    inside: bool
    iou: float


@dataclass(frozen=True)
class SetScore:
    """Scores of the scenes of a set.

    `true` and `missed` count visible pipes, `false` results that are no pipe; `pipes` are all that
    were found. `false_by_kind` counts scenes with a false result. `ms` is the time of each profile.
    `faults` are lines of text, `errors` those of them that are errors or warnings.
    """

    name: str
    scenes: int
    true: int
    false: int
    missed: int
    pipes: tuple[FoundPipe, ...]
    ms: tuple[float, ...]
    scenes_by_kind: dict[str, int]
    false_by_kind: dict[str, int]
    faults: tuple[str, ...]
    errors: tuple[str, ...]

    @property
    def f1(self):
        wanted = 2 * self.true + self.false + self.missed
        return 2 * self.true / wanted if wanted else math.nan

    @property
    def false_per_hundred(self):
        return 100 * self.false / self.scenes

    @cached_property
    def sigmas(self):
        return np.abs([pipe.sigmas for pipe in self.pipes])

    def beyond(self, sigmas):
        """Fraction of the radii with a larger error. Units: percent."""
        return 100 * float(np.mean(self.sigmas > sigmas)) if self.pipes else math.nan

    @property
    def coverage(self):
        return _coverage(self.pipes)

    @property
    def chance(self):
        """One standard deviation of a true coverage of 95 %. Units: percent."""
        return 100 * math.sqrt(0.95 * 0.05 / max(1, len(self.pipes)))

    @property
    def over_bound(self):
        """Root mean square of the errors of the radius over their bounds."""
        return _over_bound(self.pipes)

    @property
    def iou(self):
        return float(np.mean([pipe.iou for pipe in self.pipes])) if self.pipes else math.nan

    @property
    def median_ms(self):
        return float(np.median(self.ms))

    @property
    def by_kind(self):
        """The found pipes of each kind."""
        kinds = defaultdict(list)
        for pipe in self.pipes:
            kinds[pipe.kind].append(pipe)
        return dict(kinds)

    @property
    def coverage_by_kind(self):
        """Coverage of each kind of which enough were found. Units: percent."""
        return {
            kind: _coverage(pipes)
            for kind, pipes in self.by_kind.items()
            if len(pipes) >= MIN_PIPES_OF_KIND
        }

    @property
    def over_bound_by_kind(self):
        return {
            kind: _over_bound(pipes)
            for kind, pipes in self.by_kind.items()
            if len(pipes) >= MIN_PIPES_OF_KIND
        }


def score_set(name, scenes, results):
    """Score the results of one set's scenes."""
    true = false = missed = 0
    pipes, faults, errors = [], [], []
    scenes_by_kind, false_by_kind = defaultdict(int), defaultdict(int)
    for scene, result in zip(scenes, results, strict=True):
        match = match_tubes(_measured(result), scene)
        visible = {tube.label for tube in scene.tubes if tube.visible}
        judged = [_judge(scene, *found) for found in match.found]
        true += sum(label in visible for label, _, _ in match.found)
        false, missed = false + len(match.false), missed + len(match.missed)
        scenes_by_kind[scene.kind] += 1
        false_by_kind[scene.kind] += bool(match.false)
        pipes += judged
        faults += _faults(scene, match, judged)
        errors += [f"{scene}: {what}" for what in _complaints(result)]
    return SetScore(
        name, len(scenes), true, false, missed, tuple(pipes),
        tuple(result["ms"] for result in results), dict(scenes_by_kind), dict(false_by_kind),
        tuple(faults + errors), tuple(errors),
    )  # fmt: skip


def _measured(result):
    cylinders = [SimpleNamespace(**cylinder) for cylinder in result["cylinders"]]
    return SimpleNamespace(cylinders=cylinders)


def _judge(scene, label, cylinder, iou):
    tube = next(tube for tube in scene.tubes if tube.label == label)
    errors = [cylinder.radius - radius for radius in tube.radii]
    error = min(errors, key=abs)
    low, high = cylinder.intervals.get("radius", (math.nan, math.nan))
    inside = any(low <= radius <= high for radius in tube.radii)
    sigmas = error / cylinder.radius_std if cylinder.radius_std > 0 else math.inf
    linear = tube.linear_error / tube.bound
    return FoundPipe(scene.name, scene.kind, sigmas, error / tube.bound, linear, inside, iou)


def _complaints(result):
    """Error and warnings of the code under test."""
    return [*([result["error"]] if "error" in result else []), *result["warnings"]]


def _faults(scene, match, pipes):
    """Missed and false pipes, and radii beyond 3 sigma or outside their interval, one line each."""
    for label in match.missed:
        yield f"{scene}: missed tube {label}"
    for cylinder in match.false:
        first, last = cylinder.indices[0], cylinder.indices[-1]
        yield f"{scene}: false, radius {cylinder.radius:.2f}, columns {first}-{last}"
    for pipe, (label, cylinder, iou) in zip(pipes, match.found, strict=True):
        what = f"tube {label} radius {cylinder.radius:.3f} +/- {cylinder.radius_std:.3f}"
        what += f", {pipe.sigmas:+.1f} sigma, IoU {iou:.3f}"
        if abs(pipe.sigmas) > FAR_SIGMAS:
            yield f"{scene}: beyond 3 sigma, {what}"
        elif not pipe.inside:
            low, high = cylinder.intervals.get("radius", (math.nan, math.nan))
            yield f"{scene}: outside [{low:.3f}, {high:.3f}], {what}"


def _coverage(pipes):
    return 100 * float(np.mean([pipe.inside for pipe in pipes])) if pipes else math.nan


def _over_bound(pipes):
    """RMSE over the bound: its square is 1 plus the mean excess over the linear estimates."""
    excess = [pipe.bounds**2 - pipe.linear_bounds**2 for pipe in pipes]
    known = [value for value in excess if math.isfinite(value)]
    return math.sqrt(max(0.0, 1 + np.mean(known))) if known else math.nan
