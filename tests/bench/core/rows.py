"""The rows of the table, each beside its goal."""

import math

from tests.bench.core.laws import LAWS, MAX_LAW_SIGMAS, SENSOR_LAWS, law_scenes, measure_law
from tests.bench.core.scenes import make_scenes, without_sensor
from tests.bench.core.score import FAR_SIGMAS, TOO_FAR_SIGMAS, score_set
from tests.bench.core.shapes import CURVES, FLATS, PIPE_LIKE
from tests.bench.goals import Number

FREE = (-math.inf, math.inf)
"""Range of a number without a goal."""
COVERAGE = {"A": (93.0, 97.0), "B": (93.0, 97.0)}
MAX_BEYOND_FIVE = {"A": 0.1, "B": 0.1}
MIN_F1, MAX_FALSE_PER_100 = {"As": 0.995}, {"As": 0.5}
MAX_FALSE_SECTIONS = 2.0  # %
MIN_D_FOUND, MIN_D_INSIDE = 98.0, 90.0  # %
MIN_T_INSIDE = 80.0  # %
"""Goals of the sets; sets without one are for information."""


def pipe_rows(score):
    """Rows of a set of scenes with pipes: recognition, errors, intervals, time."""
    name, pipes = score.name, len(score.pipes)
    note = f"{score.scenes} scenes, {score.true} found, {score.missed} missed"
    yield Number(f"{name}: F1", score.f1, MIN_F1.get(name, -math.inf), note=note)
    most = MAX_FALSE_PER_100.get(name, math.inf)
    yield Number(f"{name}: false per 100 scenes", score.false_per_hundred, high=most)
    note = f"{(score.sigmas > FAR_SIGMAS).sum()} of {pipes} radii"
    yield Number(f"{name}: beyond 3 sigma", score.beyond(FAR_SIGMAS), unit="%", note=note)
    note = f"{(score.sigmas > TOO_FAR_SIGMAS).sum()}, worst {score.sigmas.max(initial=0):.1f}"
    five, most = score.beyond(TOO_FAR_SIGMAS), MAX_BEYOND_FIVE.get(name, math.inf)
    yield Number(f"{name}: beyond 5 sigma", five, high=most, unit="%", note=note)
    note = f"+/- {score.chance:.1f} by chance"
    goal = COVERAGE.get(name, FREE)
    yield Number(f"{name}: 95 % of radius", score.coverage, *goal, "%", note)
    kinds = score.coverage_by_kind
    worst = min(kinds, key=kinds.get, default=None)
    if len(kinds) > 1:
        note = f"{worst}, {len(score.by_kind[worst])} radii"
        yield Number(f"{name}: 95 % of radius, worst kind", kinds[worst], unit="%", note=note)
    yield from _bound_rows(score)
    yield Number(f"{name}: point IoU, mean", score.iou)
    yield _time_row(score)


def _bound_rows(score):
    if math.isfinite(score.over_bound):
        kinds = score.over_bound_by_kind
        worst = max(kinds, key=kinds.get, default=None)
        note = f"worst kind {kinds[worst]:.2f}, {worst}" if worst else ""
        yield Number(f"{score.name}: radius RMSE/bound", score.over_bound, note=note)


def _time_row(score):
    return Number(f"{score.name}: median of a profile", score.median_ms, unit="ms")


def clean_rows(score):
    """Set G: efficiency and coverage where there is noise and nothing else."""
    note = f"of {score.scenes}, {score.false} false"
    yield Number("G: tubes missed", score.missed, note=note)
    yield from _bound_rows(score)
    note = f"+/- {score.chance:.1f} by chance"
    yield Number("G: 95 % of radius", score.coverage, unit="%", note=note)


def tube_rows(score):
    """Set C: sections of rectangular tubes in which a pipe is detected."""
    false = sum(score.false_by_kind.values())
    note = f"{false} of {score.scenes}"
    share = 100 * false / score.scenes
    yield Number(
        "C: sections with a false pipe", share, high=MAX_FALSE_SECTIONS, unit="%", note=note
    )
    yield _time_row(score)


def shape_rows(score):
    """Set C2: sections of other shapes in which a pipe is detected, by family and kind."""
    families = {
        "C2: flats, sections with a false pipe": (["plate edge", *FLATS], MAX_FALSE_SECTIONS),
        "C2: curves, sections with a false pipe": (list(CURVES), MAX_FALSE_SECTIONS),
    }
    for what, (kinds, goal) in families.items():
        false = sum(score.false_by_kind.get(kind, 0) for kind in kinds)
        scenes = sum(score.scenes_by_kind.get(kind, 0) for kind in kinds)
        words = [f"{kind} {score.false_by_kind[kind]}" for kind in kinds
                 if score.false_by_kind.get(kind)]  # fmt: skip
        note = f"{false} of {scenes}: {', '.join(words)}" if false else f"0 of {scenes}"
        yield Number(what, 100 * false / max(1, scenes), high=goal, unit="%", note=note)
    for kind in PIPE_LIKE:
        share = 100 * score.false_by_kind.get(kind, 0) / max(1, score.scenes_by_kind.get(kind, 0))
        yield Number(f"C2: {kind}, detected as a pipe", share, unit="%")
    yield _time_row(score)


def fault_rows(score):
    """Set T: fraction of the arcs found whose interval contains a radius of the crest."""
    for kind, scenes in score.scenes_by_kind.items():
        pipes = score.by_kind.get(kind, [])
        inside = sum(pipe.inside for pipe in pipes)
        note = f"{inside} of {len(pipes)} found, {scenes} scenes"
        goal = -math.inf if kind == "flank bias" else MIN_T_INSIDE
        # A rejected arc has no wrong interval.
        share = 100 * inside / len(pipes) if pipes else math.nan
        yield Number(f"T: {kind}, 95 % hold the crest's radius", share, goal, unit="%", note=note)


def processed_rows(score):
    """Set D: fraction of circles that are found, and whose interval contains the radius."""
    found, inside = len(score.pipes), sum(pipe.inside for pipe in score.pipes)
    note = f"{found} of {score.scenes}"
    yield Number("D: found", 100 * found / score.scenes, MIN_D_FOUND, unit="%", note=note)
    note = f"{inside} of {score.scenes}"
    yield Number("D: found and 95 % hold the radius", 100 * inside / score.scenes, unit="%",
                 note=note)  # fmt: skip
    for kind, scenes in score.scenes_by_kind.items():
        pipes = score.by_kind.get(kind, [])
        inside = sum(pipe.inside for pipe in pipes)
        note = f"{len(pipes)} of {scenes} found"
        yield Number(f"D: {kind}, 95 % hold the radius", 100 * inside / scenes, MIN_D_INSIDE,
                     unit="%", note=note)  # fmt: skip
    yield Number("D: false per 100 scenes", score.false_per_hundred)
    yield _time_row(score)


SET_ROWS = {
    "A": pipe_rows,
    "As": pipe_rows,
    "Ah": pipe_rows,
    "Ahs": pipe_rows,
    "B": pipe_rows,
    "Bu": pipe_rows,
    "C": tube_rows,
    "C2": shape_rows,
    "T": fault_rows,
    "D": processed_rows,
    "G": clean_rows,
}


def error_rows(name, errors):
    """Number of errors and warnings of the code under test, if there are any."""
    if errors:
        note = f"first {errors[0]}"
        yield Number(f"{name}: errors and warnings", len(errors), high=0, note=note)


def measure_set(name, trees, effort, seed):
    """Rows and faults of a set of scenes, for each tree."""
    scenes = make_scenes(name, effort, seed)
    for tree in trees:
        score = score_set(name, scenes, tree.measure(scenes))
        errors = error_rows(name, score.errors)
        yield [*SET_ROWS[name](score), *errors], score.faults


def measure_laws(trees, effort, seed):
    """Set F: rows and faults, for each tree; with a sensor only for sections that have one."""
    scenes_as_made = law_scenes(effort, seed)
    bare = [without_sensor(scene) for scene in scenes_as_made]
    with_sensor = [scene for scene in scenes_as_made if scene.sensor is not None]
    for tree in trees:
        rows, faults = [], []
        for words, laws, scenes in (("", LAWS, bare), (", sensor", SENSOR_LAWS, with_sensor)):
            for law in laws:
                score = measure_law(tree, law, scenes, seed)
                moved = int((score.moves > MAX_LAW_SIGMAS).sum())
                note = f"{moved} of {len(score.moves)} radii move"
                move = Number(f"F: {law}{words}, worst move", score.worst,
                                    high=MAX_LAW_SIGMAS, unit="sd", note=note)  # fmt: skip
                note = f"of {score.sections} sections"
                count = Number(f"F: {law}{words}, count changes", score.counts_changed, high=0,
                               note=note)  # fmt: skip
                rows += [move, count]
                faults += score.faults
        yield rows, faults
