"""Accuracy and speed of `measure_cylinders` beside the goals: ``python -m tests.bench [--quick]``.

``python -m tests.bench core`` compares the core of any two commits: `tests.bench.core`;
``python -m tests.bench end_to_end`` times whole commands: `tests.bench.end_to_end`. Scans, laser
lines and calibrations have commands of their own: `tests.bench.scan`, `camera_chain`, `laser_line`,
`laser_plane` and `hand_eye`.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from tests.bench.goals import Number, missed, print_numbers

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Effort:
    """Numbers of simulated measurements.

    Recognition: `scenes` of each kind. Comparison with the bound: `runs` sections of each of
    `tubes` tubes. Coverage: `intervals` sections. Speed: `timed_scenes` of each kind, measured
    `repeats` times. Images: `pictures` tubes, with random seed `seed` (None: the usual one).
    """

    scenes: int
    tubes: int
    runs: int
    intervals: int
    timed_scenes: int
    repeats: int
    pictures: int
    seed: int | None = None


# The slow tests measure with QUICK.
QUICK = Effort(scenes=100, tubes=20, runs=60, intervals=300, timed_scenes=16, repeats=5, pictures=5)
FULL = Effort(
    scenes=400, tubes=40, runs=300, intervals=2000, timed_scenes=60, repeats=20, pictures=20
)
SHOTS = 10
"""Number of images of each picture (a tube with its camera), each with its own noise."""


def recognition(effort):
    from tests.bench.recognition import score_recognition

    return score_recognition(effort.scenes).numbers


def single_section(effort):
    from tests.bench.single_section import Conditions, compare_with_bound

    return compare_with_bound(Conditions("clean"), effort.tubes, effort.runs).numbers


def rough_section(effort):
    from tests.bench.single_section import ROUGH, Conditions, compare_with_bound

    rough = Conditions("5 % jumps, 10 % lost", ROUGH)
    return compare_with_bound(rough, effort.tubes, effort.runs).rough_numbers


def known_radius(effort):
    from tests.bench.single_section import Conditions, compare_with_bound

    known = Conditions("known radius", radius_known=True)
    return compare_with_bound(known, effort.tubes, effort.runs).known_radius_numbers


def coverage(effort):
    from tests.bench.coverage import CONDITIONS, NOISE_UNKNOWN, count_coverage, count_square_on

    for conditions in CONDITIONS + NOISE_UNKNOWN:
        yield from count_coverage(conditions, effort.intervals).numbers
    yield from count_square_on(effort.intervals).numbers


def spheres(_effort):
    from tests.bench.spheres import measure_sphere_robot, real_data, score_spheres

    if not real_data():
        return [Number("real profiles: ../shared/real is absent", float("nan"))]
    return [*score_spheres().numbers, *measure_sphere_robot().numbers]


def images(effort):
    from tests.bench.images import FIRST_SEED, score_images

    seed = FIRST_SEED if effort.seed is None else effort.seed
    return score_images(effort.pictures, SHOTS, seed)


def speed(effort):
    from tests.bench.speed import measure_speed

    return measure_speed(effort.timed_scenes, effort.repeats).numbers


def steps(effort):
    from tests.bench.steps import time_steps

    return time_steps(effort.timed_scenes, effort.repeats)


BENCHES: dict[str, Callable[[Effort], Iterable[Number]]] = {
    "recognition": recognition,
    "single_section": single_section,
    "rough_section": rough_section,
    "known_radius": known_radius,
    "coverage": coverage,
    "spheres": spheres,
    "images": images,
    "speed": speed,
    "steps": steps,
}
"""Function of an effort that returns the rows of each part.

Each imports its module when it is called, after `main` has limited the number of threads.
"""


def main():
    """Run the command, or one of the commands `core` and `end_to_end`."""
    for variable in ONE_THREAD:
        os.environ[variable] = "1"  # before numpy is imported, which starts its threads
    if sys.argv[1:2] == ["core"]:
        from tests.bench.core.command import main as measure_core

        return measure_core(sys.argv[2:])
    if sys.argv[1:2] == ["end_to_end"]:
        from tests.bench.end_to_end import main as time_commands

        return time_commands(sys.argv[2:])
    return measure_numbers(sys.argv[1:])


def measure_numbers(arguments):
    """Print the rows of the parts that are named, or of all, and those short of their goal."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("only", nargs="*", help=f"of {', '.join(BENCHES)}; all without")
    parser.add_argument("--quick", action="store_true", help="a few minutes instead of many")
    parser.add_argument("--seed", type=int, help="random seed of the images")
    options = parser.parse_args(arguments)
    effort = replace(QUICK if options.quick else FULL, seed=options.seed)
    for unknown in set(options.only) - set(BENCHES):
        parser.error(f"expected one of {', '.join(BENCHES)}, got {unknown}")
    from tests.bench.sources import fingerprint

    missed_rows, sources = [], fingerprint()
    print(f"lsvision sources {sources}, {time.strftime('%Y-%m-%d %H:%M')}")
    for name in options.only or BENCHES:
        start = time.perf_counter()
        numbers = list(BENCHES[name](effort))
        print_numbers(f"{name}  ({time.perf_counter() - start:.0f} s)", numbers)
        missed_rows += missed(numbers)
    if fingerprint() != sources:
        print("\nTHE SOURCES CHANGED WHILE MEASURING: the numbers are of several states; run again")
    print(f"\n{len(missed_rows)} goals not reached")
    for row in missed_rows:
        print(f"  {row}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
