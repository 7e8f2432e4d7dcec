"""How many random changes of constants and comparisons in the core turn a test red.

``python -m tests.mutations [--count 40] [--seed 1] [--jobs 2]`` copies the project to a temporary
folder for each mutation, changes one constant by 30 % or turns one comparison round, and runs
first the tests of that module, then those of the whole core, until one fails. It prints each
mutation with what became of it, and the share that was detected.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
CORE = ("detection", "ellipse", "statistics")
TESTS = (
    "tests/detection", "tests/ellipse", "tests/statistics", "tests/test_measure.py", "tests/laws",
    "tests/io/profiles/test_lost_points.py", "tests/test_fixtures.py",
    "tests/bench/test_core_short.py",
)  # fmt: skip
CHANGE = 1.3
"""Factor on a constant, or its inverse."""
TIMEOUT_S = 400.0
TURNED = {ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "=="}
NUMERICAL = ("TINY", "RIDGE", "REGULARISATION", "IDENTITY", "MAX_POINTS", "EXCLUDED", "TOLERANCE",
             "EVALUATIONS", "PRECISION", "AT_ONCE")  # fmt: skip
"""Parts of names of constants whose size changes no result by design: guards against division by
zero, limits of memory and time, convergence tolerances."""


@dataclass(frozen=True)
class Mutation:
    """One change of one file: characters [start, stop) of a line become `text`."""

    path: Path
    line: int
    start: int
    stop: int
    text: str

    @property
    def shown(self):
        old = (ROOT / self.path).read_text().splitlines()[self.line - 1]
        return (
            f"{self.path}:{self.line}: {old.strip()} | {old[self.start : self.stop]} -> {self.text}"
        )

    def apply(self, folder):
        path = folder / self.path
        lines = path.read_text().splitlines(keepends=True)
        old = lines[self.line - 1]
        lines[self.line - 1] = old[: self.start] + self.text + old[self.stop :]
        path.write_text("".join(lines))


def find_mutations(rng):
    """All mutations of the core's constants and comparisons."""
    files = [
        path for package in CORE for path in sorted((ROOT / "lsvision" / package).glob("*.py"))
    ]
    for path in files:
        tree = ast.parse(path.read_text())
        yield from _constants(path.relative_to(ROOT), tree, rng)
        yield from _comparisons(path.relative_to(ROOT), tree, path.read_text().splitlines())


def _constants(path, tree, rng):
    for node in tree.body:
        if not isinstance(node, ast.Assign) or any(
            u in ast.unparse(node.targets[0]) for u in NUMERICAL
        ):
            continue
        for part in ast.walk(node.value):
            if isinstance(part, ast.Constant) and type(part.value) in (int, float) and part.value:
                factor = rng.choice([CHANGE, 1 / CHANGE])
                changed = part.value * factor
                if isinstance(part.value, int):
                    step = 1 if factor > 1 else -1
                    changed = round(changed) if round(changed) != part.value else part.value + step
                yield Mutation(
                    path, part.lineno, part.col_offset, part.end_col_offset, f"{changed:.6g}"
                )


def _comparisons(path, tree, lines):
    for node in ast.walk(tree):
        if not isinstance(node, ast.Compare) or len(node.ops) != 1:
            continue
        left, right, turned = node.left, node.comparators[0], TURNED.get(type(node.ops[0]))
        if turned is None or left.end_lineno != right.lineno:
            continue
        line = lines[left.end_lineno - 1]
        between = line[left.end_col_offset : right.col_offset]
        if between.strip(" ()") in ("<", "<=", ">", ">=", "==", "!="):
            operator = between.strip(" ()")
            start = left.end_col_offset + between.index(operator)
            yield Mutation(path, left.end_lineno, start, start + len(operator), turned)


def is_detected(mutation):
    """Whether a test fails in a copy of the project with the mutation."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "project"
        shutil.copytree(
            ROOT, folder, ignore=shutil.ignore_patterns(".git", "__pycache__", ".*_cache")
        )
        mutation.apply(folder)
        own = f"tests/{mutation.path.parent.name}/test_{mutation.path.stem}.py"
        groups = [(own,)] if (folder / own).is_file() else []
        groups.append(tuple(path for path in TESTS if (folder / path).exists()))
        return any(_fails(folder, group) for group in groups)


def _fails(folder, paths):
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p",
               "no:randomly", *paths]  # fmt: skip
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    every = list(find_mutations(rng))
    chosen = rng.sample(every, min(options.count, len(every)))
    print(f"seed {options.seed}: {len(chosen)} of {len(every)} mutations", flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        detected = 0
        for mutation, found in zip(chosen, pool.map(is_detected, chosen), strict=True):
            detected += found
            print(f"{'detected' if found else 'SURVIVED'}  {mutation.shown}", flush=True)
    print(f"{detected} of {len(chosen)} detected ({100 * detected / len(chosen):.0f} %)")


if __name__ == "__main__":
    main()
