"""Tubes found, tubes missed and false detections in random scenes of all seven kinds."""

from dataclasses import dataclass

import numpy as np

from lsvision.measure import measure_cylinders
from lsvision.simulate import SCENE_KINDS, random_section
from tests.bench.goals import Number
from tests.bench.matching import match_tubes
from tests.bench.progress import counted

FIRST_SEED = 10_000  # the method was developed on seeds from 0


@dataclass(frozen=True)
class KindScore:
    """Results of all scenes of one kind.

    Numbers of `profiles` and of `true`, `false` and `missed` tubes, the IoU of each tube found, and
    the seed of each scene with a fault, as "seed:+false-missed".
    """

    kind: str
    profiles: int
    true: int
    false: int
    missed: int
    ious: tuple[float, ...]
    faults: tuple[str, ...]

    @property
    def f1(self):
        return 2 * self.true / (2 * self.true + self.false + self.missed)


@dataclass(frozen=True)
class Recognition:
    """Results of all kinds of scenes."""

    kinds: tuple[KindScore, ...]

    @property
    def numbers(self):
        true = sum(kind.true for kind in self.kinds)
        false = sum(kind.false for kind in self.kinds)
        missed = sum(kind.missed for kind in self.kinds)
        profiles = sum(kind.profiles for kind in self.kinds)
        ious = np.concatenate([kind.ious for kind in self.kinds])
        overall = [
            Number("F1 overall", 2 * true / (2 * true + false + missed), 0.99),
            Number("false tubes per 100 profiles", 100 * false / profiles, high=0.5),
            Number("point IoU, median", float(np.median(ious)), 0.97),
        ]
        return (*overall, *(_row(kind) for kind in self.kinds))


def _row(score):
    counts = f"{score.true} found, {score.missed} missed, {score.false} false"
    note = f"{counts} {' '.join(score.faults[:8])}"
    if score.true + score.missed == 0:
        return Number(f"false tubes {score.kind}", score.false, note=note)
    return Number(f"F1 {score.kind}", score.f1, 0.98, note=note)


def score_recognition(scenes):
    """Measure `scenes` random scenes of each kind."""
    return Recognition(tuple(_score_kind(kind, scenes) for kind in SCENE_KINDS))


def _score_kind(kind, scenes):
    true = false = missed = 0
    ious, faults = [], []
    for seed in counted(range(FIRST_SEED, FIRST_SEED + scenes), f"recognition {kind}"):
        section = random_section(kind, seed)
        match = match_tubes(measure_cylinders(section.profile), section.truth)
        visible = {tube.label for tube in section.truth.tubes if tube.visible}
        visible_ious = [iou for label, _, iou in match.found if label in visible]
        true += len(visible_ious)
        false += len(match.false)
        missed += len(match.missed)
        ious += visible_ious
        if match.false or match.missed:
            faults.append(f"{seed}:+{len(match.false)}-{len(match.missed)}")
    return KindScore(kind, scenes, true, false, missed, tuple(ious), tuple(faults))
