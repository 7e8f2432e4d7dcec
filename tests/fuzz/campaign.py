"""A campaign bounded by time: a worker tries inputs, and is replaced when one ends or stops it."""

import collections
import json
import math
import queue
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
DEAD_SECONDS = 20.0
"""Silence of the worker after which it is ended: code that Python cannot interrupt."""


@dataclass
class Findings:
    """What a campaign tried and found."""

    tried: collections.Counter = field(default_factory=collections.Counter)
    wrong: list = field(default_factory=list)


def run_campaign(seconds, seed, names, say=print, *, most=math.inf):
    """Try inputs from number `seed` on, for so many seconds, or until `most` were tried."""
    findings, number, stop = Findings(), seed, time.monotonic() + seconds
    while time.monotonic() < stop and findings.tried.total() < most:
        number = _run_worker(number, names, (stop, most), findings, say)
    return findings


def _run_worker(first, names, ends, findings, say):
    stop, most = ends
    command = [sys.executable, "-m", "tests.fuzz.worker", str(first), ",".join(names)]
    worker = subprocess.Popen(
        command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    lines = queue.Queue()
    threading.Thread(target=_read, args=(worker.stdout, lines), daemon=True).start()
    last, deadline = {"begin": first, "target": "start"}, time.monotonic() + 120
    while time.monotonic() < stop and findings.tried.total() < most:
        try:
            line = lines.get(timeout=max(0.01, min(deadline, stop) - time.monotonic()))
        except queue.Empty:
            if time.monotonic() < stop:
                _note(findings, last, f"no answer for {DEAD_SECONDS:g} s", say)
            break
        if line is None:
            _note(findings, last, f"the process ended with {worker.wait()}", say)
            break
        message = json.loads(line)
        deadline = time.monotonic() + DEAD_SECONDS
        if "wrong" in message:
            _note(
                findings,
                {"begin": message["wrong"], "target": message["target"]},
                message["error"],
                say,
            )
        else:
            last = message
            findings.tried[message["target"]] += 1
    worker.kill()
    worker.wait()
    worker.stdout.close()
    return last["begin"] + 1


def _read(stream, lines):
    try:
        for line in stream:
            lines.put(line)
    except ValueError:  # closed
        return
    lines.put(None)


def _note(findings, last, error, say):
    findings.wrong.append((last["target"], last["begin"], error))
    say(f"--- {last['target']} {last['begin']}\n{error.strip()}")
