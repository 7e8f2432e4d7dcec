"""Worker of `tests.bench.images_and_scans`: ``python timed_calls.py FOLDER``.

Runs under any commit's lsvision, so it uses public names only. For each line of its input, a
number of calls and the name of a file in the folder, it prints the median processor time of a call
in seconds. The first call is not counted, because the caches of the processor hold the data of
another process.
"""

import os
import sys
import time
from functools import cache
from pathlib import Path
from statistics import median

import cv2
import numpy as np

import lsvision as lsv

CAMERA = [[2264.0, 0.0, 640.0], [0.0, 2264.0, 512.0], [0.0, 0.0, 1.0]]


def _image_call(file, profile):
    image = file["image"]
    colour = {"channel": "red"} if image.ndim == 3 else {}
    settings = lsv.LineSettings(**colour)
    if not profile:
        return lambda: lsv.extract_laser_line(image, settings)
    camera = lsv.Camera(CAMERA, [-0.1, 0.02, 0.0, 0.0], (1280, 1024))
    rig = lsv.LightSection(camera, lsv.Plane((0.0, 0.75**0.5, 0.5), 150.0))
    return lambda: rig.profile(image, settings)


def _scan_call(file):
    cuts = np.cumsum(file["counts"])[:-1]
    profiles = [lsv.Profile(points) for points in np.split(file["points"], cuts)]
    poses = [lsv.Pose(np.eye(3), translation) for translation in file["translations"]]
    return lambda: lsv.measure_scan(profiles, poses)


@cache
def call_of(path):
    """Return the function without arguments that a file is the input of; made once per file."""
    file = np.load(path)
    if "image" not in file:
        call = _scan_call(file)
    else:
        call = _image_call(file, profile=path.stem.startswith("profile"))
    return call


def _seconds(call):
    start = time.process_time()
    call()
    return time.process_time() - start


def main():
    cv2.setNumThreads(1)
    folder = Path(sys.argv[1])
    for line in sys.stdin:
        count, name = line.strip().split(maxsplit=1)
        call = call_of(folder / name)
        seconds = [_seconds(call) for _ in range(int(count) + 1)]
        print(median(seconds[1:]), flush=True)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
