"""Source trees under test, copied to temporary folders, and processes that measure with them."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).parents[3]
WORKER = Path(__file__).with_name("measure_worker.py")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerFailed(RuntimeError):
    """The measuring process has ended; its messages are on stderr."""


class Worker:
    """A process that measures with the code in `folder`."""

    def __init__(self, folder):
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(WORKER)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder,
            env=os.environ | ONE_THREAD | {"PYTHONPATH": str(folder)},
        )  # fmt: skip
        used = Path(self._answer())
        if folder.resolve() not in used.resolve().parents:
            raise WorkerFailed(f"the worker measures with {used}, expected one in {folder}")

    def start(self, **request):
        print(json.dumps(request), file=self._process.stdin, flush=True)

    def ask(self, **request):
        self.start(**request)
        return self._answer()

    def _answer(self):
        line = self._process.stdout.readline()
        if not line:
            raise WorkerFailed(f"the worker ended with code {self._process.wait()}")
        return json.loads(line)

    def finish(self):
        return self._answer()

    def close(self):
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


@dataclass(frozen=True)
class Tree:
    """A copy of the code under test with its workers, and the folder of the files they exchange."""

    name: str
    folder: Path
    exchange: Path
    workers: tuple[Worker, ...] = field(repr=False)

    def measure(self, scenes, quantities=("radius",)):
        """Results of scenes, in their order."""
        if not scenes:
            return []
        path = self.store(scenes)
        outs = [self.exchange / f"out{i}.json" for i in range(len(self.workers))]
        for first, (worker, out) in enumerate(zip(self.workers, outs, strict=True)):
            worker.start(
                do="measure", scenes=str(path), first=first, step=len(self.workers),
                quantities=list(quantities), out=str(out),
            )  # fmt: skip
        results = [None] * len(scenes)
        for first, (worker, out) in enumerate(zip(self.workers, outs, strict=True)):
            worker.finish()
            results[first :: len(self.workers)] = json.loads(out.read_text())
        return results

    def read(self, paths, quantities=("phi",)):
        """Results of files that the code under test reads, with the points that it read."""
        out = self.exchange / "read.json"
        request = {"do": "read", "paths": [str(p) for p in paths], "quantities": list(quantities)}
        self.workers[0].ask(**request, out=str(out))
        return json.loads(out.read_text())

    def store(self, scenes, name="scenes"):
        """Write points and sensors of scenes, without the truth; return the path of the file."""
        path = self.exchange / f"{name}.npz"
        np.savez(
            path,
            points=np.concatenate([scene.points for scene in scenes]),
            stops=np.cumsum([len(scene.points) for scene in scenes]),
            sensors=np.array([_sensor_row(scene.sensor) for scene in scenes]),
        )
        return path


@contextmanager
def tree_on_trial(source, jobs):
    """The tree of `source`, a folder or the name of a commit, copied to a temporary folder."""
    with TemporaryDirectory(prefix="lsvision-core-") as temporary:
        folder, exchange = Path(temporary, "tree"), Path(temporary, "exchange")
        exchange.mkdir()
        folder.mkdir()
        if isinstance(source, Path):
            skip = shutil.ignore_patterns("__pycache__")
            shutil.copytree(source / "lsvision", folder / "lsvision", ignore=skip)
        else:
            _archive(source, folder)
        workers = tuple(Worker(folder) for _ in range(jobs))
        try:
            yield Tree(f"{source} ({fingerprint(folder)})", folder, exchange, workers)
        finally:
            for worker in workers:
                worker.close()


def _archive(commit, folder):
    git = ["git", "-C", str(ROOT), "archive", commit, "lsvision"]
    packed = subprocess.run(git, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=packed, check=True)


def fingerprint(folder):
    """First eight digits of the hash of all source files of the package in `folder`."""
    digest = hashlib.sha256()
    for path in sorted((folder / "lsvision").rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def _sensor_row(sensor):
    if sensor is None:
        return [np.nan] * 5
    return [sensor.range_std, sensor.reference_range, *sensor.origin, sensor.quantum]
