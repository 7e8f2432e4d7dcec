"""``python -m tests.bench core``: the core's table for any tree of source.

Without options the working tree is measured; --against measures the same scenes a second time and
the speed of both in alternating rounds on one core.
"""

import argparse
import csv
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.bench.core.rows import measure_laws, measure_set
from tests.bench.core.scenes import SETS, make_scene
from tests.bench.core.speed import measure_speed
from tests.bench.core.trees import ROOT, tree_on_trial
from tests.bench.goals import missed

SEED = 770_000
"""First seed of the scenes."""
QUICK = {
    "A": 210, "As": 210, "Ah": 140, "Ahs": 140, "B": 180, "Bu": 40, "C": 120, "C2": 168, "T": 80,
    "D": 160, "E": 1, "F": 40, "G": 150, "speed": 10,
}  # fmt: skip
FULL = {
    "A": 560, "As": 560, "Ah": 420, "Ahs": 420, "B": 480, "Bu": 120, "C": 200, "C2": 560, "T": 160,
    "D": 320, "E": 1, "F": 94, "G": 600, "speed": 30,
}  # fmt: skip
"""Number of scenes of each set, with and without --quick; of speed the number of rounds. Set E is
all of the real data."""


@dataclass
class Report:
    """Rows of the first tree, set by set, and faults of all trees."""

    names: list[str]
    rows: list[list] = field(default_factory=list)
    faults: list[list[str]] = field(default_factory=list)

    def add(self, title, measured):
        """Print the rows of one set, a column for each tree."""
        rows, faults = zip(*measured, strict=True)
        print(f"\n{title}")
        others = [{row.what: row.value for row in other} for other in rows[1:]]
        for row in rows[0]:
            columns = "".join(f" {other.get(row.what, float('nan')):10.4g}" for other in others)
            verdict = ("ok" if row.reached else "SHORT") if row.has_goal else ""
            line = f"  {row.what:46} {row.value:10.4g}{columns} {row.unit:3}"
            print(f"{line} {row.goal:>9} {verdict:5} {row.note}".rstrip(), flush=True)
        self.rows.append(rows[0])
        self.faults.append([list(tree_faults) for tree_faults in faults])


def main(arguments):
    parser = argparse.ArgumentParser(prog="python -m tests.bench core", description=__doc__)
    code = parser.add_mutually_exclusive_group()
    code.add_argument("--commit", metavar="REV", help="measure this commit")
    code.add_argument("--tree", metavar="FOLDER", type=Path, help="measure this folder")
    parser.add_argument("--against", metavar="REV", help="a commit or folder for a second column")
    parser.add_argument("--quick", action="store_true", help="fewer scenes")
    parser.add_argument(
        "--seed", type=int, default=SEED,
        help="first seed of the scenes; two runs with seeds less than 1000 apart share scenes",
    )  # fmt: skip
    parser.add_argument("--only", nargs="+", choices=QUICK, metavar="SET", default=list(QUICK))
    parser.add_argument("--jobs", type=int, default=1, help="processes that measure")
    parser.add_argument("--faults", action="store_true", help="list the scenes with faults")
    parser.add_argument("--dump", nargs=2, metavar=("SET:INDEX", "CSV"), help="write a scene")
    options = parser.parse_args(arguments)
    if options.dump:
        return dump(*options.dump, options.seed)
    sources = [options.commit or (options.tree or ROOT).resolve()]
    if options.against:
        folder = Path(options.against)
        sources.append(folder.resolve() if folder.is_dir() else options.against)
    return run(sources, options)


def run(sources, options):
    """Measure every set for every source and print the table."""
    effort, start = QUICK if options.quick else FULL, time.perf_counter()
    with ExitStack() as stack:
        trees = [stack.enter_context(tree_on_trial(s, options.jobs)) for s in sources]
        report = Report([tree.name for tree in trees])
        for number, name in enumerate(report.names):
            print(f"{'against ' if number else ''}{name}")
        print(f"seed {options.seed}, {time.strftime('%Y-%m-%d %H:%M')}")
        if len(trees) > 1:
            print(f"{'':48} {'measured':>10} {'against':>10}")
        for name in options.only:
            began = time.perf_counter()
            measured = list(_measure(name, trees, effort[name], options.seed))
            report.add(f"{name}  ({time.perf_counter() - began:.0f} s)", measured)
    short = [row for rows in report.rows for row in missed(rows)]
    print(f"\n{len(short)} goals not reached, {time.perf_counter() - start:.0f} s")
    for row in short:
        print(f"  {row}")
    if options.faults:
        _print_faults(report)
    return 0


def _measure(name, trees, effort, seed):
    """Return rows and faults of a set for each tree; `effort` is the number of scenes or rounds."""
    if name == "F":
        return measure_laws(trees, effort, seed)
    if name == "speed":
        return measure_speed(trees, effort, seed)
    if name == "E":
        from tests.bench.core.real import measure_real  # imports lsvision's readers

        return measure_real(trees)
    return measure_set(name, trees, effort, seed)


def _print_faults(report):
    for number, name in enumerate(report.names):
        print(f"\nfaults, {name}")
        for faults in report.faults:
            for fault in faults[number]:
                print(f"  {fault}")


def dump(which, path, seed):
    """Write the points of one scene as CSV, lost ones as nan, and print its truth."""
    name, _, index = which.partition(":")
    if name not in SETS or not index.isdigit():
        raise SystemExit(f"expected SET:INDEX with a set of {', '.join(SETS)}, got {which}")
    scene = make_scene(name, int(index), seed)
    with Path(path).open("w", newline="") as file:
        csv.writer(file).writerows(np.round(scene.points, 5).tolist())
    print(scene)
    for tube in scene.tubes:
        columns = np.flatnonzero(scene.labels == tube.label)
        span = f"columns {columns[0]}-{columns[-1]}" if len(columns) else "unseen"
        print(f"  tube {tube.label}: radius {tube.radii}, {span}, {len(columns)} points")
    print(f"  sensor: {scene.sensor}")
    return 0
