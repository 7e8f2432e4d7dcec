"""Measure points with the lsvision found on PYTHONPATH; run as a script in its own process.

It uses only public names of lsvision, so that the same file measures any commit. Each line on stdin
is a request, as JSON, and is answered by one line on stdout:

- ``{"do": "measure", "scenes": npz, "first": i, "step": k, "quantities": [...], "out": json}``
- ``{"do": "read", "paths": [...], "quantities": [...], "out": json}``: files instead of points
- ``{"do": "time", "scenes": npz, "core": number}``: processor time of each scene in ms, on one core

An npz holds the `points` of all scenes one after the other (n, 2), where each scene `stops`, and
a row of `sensors` each (range_std, reference_range, origin x and y, quantum; NaN without one).
"""

import json
import os
import sys
import time
import warnings

import cv2
import numpy as np

import lsvision as lsv


def load_profiles(path):
    with np.load(path) as file:
        points, stops, sensors = file["points"], file["stops"], file["sensors"]
    parts = np.split(points, stops[:-1])
    return [_profile(own, row) for own, row in zip(parts, sensors.tolist(), strict=True)]


def _profile(points, row):
    range_std, reference_range, x, y, quantum = row
    if not np.isfinite(range_std):
        return lsv.Profile(points)
    sensor = lsv.ProfileSensor(
        range_std=range_std, reference_range=reference_range, origin=(x, y), quantum=quantum
    )
    return lsv.Profile(points, noise=sensor)


def measure(profile, quantities):
    """Return the result of a profile as plain numbers, with the error and warnings of the code."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = _measure(profile, quantities)
    return result | {"warnings": [str(warning.message) for warning in caught]}


def _measure(profile, quantities):
    start = time.process_time()
    try:
        found = lsv.measure_cylinders(profile)
    except Exception as error:  # noqa: BLE001 - any error is counted
        return {"cylinders": [], "rejections": [], "ms": 0.0, "error": repr(error)}
    ms = 1e3 * (time.process_time() - start)
    result = {"rejections": [rejection.reason for rejection in found.rejections], "ms": ms}
    try:
        result["cylinders"] = [_numbers(c, quantities) for c in found.cylinders]
    except Exception as error:  # noqa: BLE001
        result |= {"cylinders": [_numbers(c, []) for c in found.cylinders], "error": repr(error)}
    return result


def _numbers(cylinder, quantities):
    return {
        "radius": cylinder.radius,
        "radius_std": cylinder.radius_std,
        "theta": cylinder.theta,
        "phi": cylinder.phi,
        "centre": list(cylinder.centre),
        "indices": cylinder.indices.tolist(),
        "intervals": {quantity: list(cylinder.interval(quantity)) for quantity in quantities},
    }


def do_measure(request):
    profiles = load_profiles(request["scenes"])[request["first"] :: request["step"]]
    if profiles:
        measure(profiles[0], [])  # what is imported or compiled on first use is not counted
    results = [measure(profile, request["quantities"]) for profile in profiles]
    _write(request["out"], results)
    return len(results)


def do_read(request):
    results = []
    for path in request["paths"]:
        profile = lsv.read_profile(path)
        result = measure(profile, request["quantities"])
        results.append(result | {"points": profile.points.tolist()})
    _write(request["out"], results)
    return len(results)


def do_time(request):
    os.sched_setaffinity(0, {request["core"]})
    times = []
    for profile in load_profiles(request["scenes"]):
        start = time.process_time()
        lsv.measure_cylinders(profile)
        times.append(1e3 * (time.process_time() - start))
    return times


def _write(path, results):
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
        json.dump(results, file)


def main():
    cv2.setNumThreads(1)
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the code under test prints is no answer
    print(json.dumps(lsv.__file__), file=answers, flush=True)
    does = {"measure": do_measure, "read": do_read, "time": do_time}
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(does[request["do"]](request)), file=answers, flush=True)


if __name__ == "__main__":
    main()
