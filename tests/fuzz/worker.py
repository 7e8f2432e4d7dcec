"""Runs inputs one after the other and tells each on stdout, so that its death names the input."""

import json
import os
import signal
import sys
import tempfile
import traceback
import warnings
import zlib
from pathlib import Path

import numpy as np

MEMORY_BYTES = 6 * 10**9
"""Address space of the worker: an input that needs more is a finding."""
MAX_SECONDS = 5.0
"""Longest processor time for an input; waiting is ended by the campaign."""


class TooSlow(BaseException):
    """An input took longer than `MAX_SECONDS`."""


def input_rng(name, number):
    return np.random.default_rng([zlib.crc32(name.encode()), number])


def run_input(name, number, folder):
    """What is wrong with an input, or None."""
    from tests.fuzz.targets import TARGETS

    for path in folder.iterdir():
        path.unlink()
    try:
        TARGETS[name](input_rng(name, number), folder)
    except (Exception, TooSlow) as error:  # noqa: BLE001 - whatever it is, it is a finding
        return "".join(traceback.format_exception(error))[-3000:]
    return None


def chosen(names, number):
    """The target of an input: each as often as its share."""
    from tests.fuzz.targets import SHARES

    shares = np.array([SHARES[name] for name in names], dtype=float)
    return names[input_rng("choice", number).choice(len(names), p=shares / shares.sum())]


def main():
    first, names = int(sys.argv[1]), sys.argv[2].split(",")
    warnings.simplefilter("error")
    # Documented; the program ignores it, because the reader tells of odd units.
    warnings.filterwarnings("ignore", "expected a profile in mm", UserWarning)
    warnings.filterwarnings("ignore", ".* looks like a marker of lost points", UserWarning)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGPROF, _too_slow)
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    parent = os.getppid()
    with tempfile.TemporaryDirectory() as folder:
        number = first
        while os.getppid() == parent:
            name = chosen(names, number)
            _tell({"begin": number, "target": name})
            signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
            wrong = run_input(name, number, Path(folder))
            signal.setitimer(signal.ITIMER_PROF, 0)
            if wrong is not None:
                _tell({"wrong": number, "target": name, "error": wrong})
            number += 1


def _too_slow(*_):
    raise TooSlow


def _tell(what):
    sys.__stdout__.write(json.dumps(what) + "\n")
    sys.__stdout__.flush()


if __name__ == "__main__":
    main()
