"""Spoilt inputs against readers, API and command line: ``python -m tests.fuzz``.

An input is a number and a target: ``python -m tests.fuzz --only poses --input 4711`` repeats one.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main():
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    from tests.fuzz.campaign import run_campaign
    from tests.fuzz.targets import SHARES
    from tests.fuzz.worker import run_input

    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the campaign [60]")
    parser.add_argument("--seed", type=int, help="number of the first input [from the clock]")
    parser.add_argument("--only", action="append", choices=list(SHARES), help="only this target")
    parser.add_argument("--input", type=int, help="try this one input in this process")
    options = parser.parse_args()
    names = options.only or list(SHARES)
    if options.input is not None:
        with tempfile.TemporaryDirectory() as folder:
            sys.exit(run_input(names[0], options.input, Path(folder)))
    seed = int(time.time()) * 1000 if options.seed is None else options.seed
    print(f"seed {seed}, {options.seconds:g} s, targets {' '.join(names)}", flush=True)
    findings = run_campaign(options.seconds, seed, names, lambda text: print(text, flush=True))
    print(f"{findings.tried.total()} inputs: {dict(findings.tried.most_common())}")
    print(f"{len(findings.wrong)} findings")
    sys.exit(bool(findings.wrong))


if __name__ == "__main__":
    main()
