"""Laser lines in rendered images beside goals G1 to G7: ``python -m tests.bench.laser_line``."""

import math
import time
from functools import partial

import cv2
import numpy as np

from lsvision.laser_line.extraction import LineSettings, extract_laser_line
from tests.bench.goals import Number, print_numbers
from tests.laser_line.line_scenes import CLUTTER, pipe_on_floor, plank, rendered

FALSE_PX = 3.0
"""Error of a column above which it counts as false. Units: px."""
IMAGES = 3
MAX_BIAS_PX = 0.003
MAX_TIME_RATIO = 2.4
"""Largest ratio of the processor time to that of `centre_of_gravity`, which took 4.1 ms on the
machine for which goal G7 is 10 ms."""
GAUSSIAN = LineSettings(method="gaussian")


def line_errors(settings=None, scene=None, images=IMAGES, **rendering):
    """Return the errors along v of every column of a few images, in px and over their std.

    `rendering` are arguments of `rendered`.
    """
    errors, sigmas = [], []
    for seed in range(images):
        image = rendered(scene or plank(), seed, **rendering)
        line = extract_laser_line(image.image, settings)
        errors.append(line.pixels[:, 1] - image.truth_pixels[:, 1])
        sigmas.append(errors[-1] / line.std)
    return np.concatenate(errors), np.concatenate(sigmas)


def line_numbers(name, goal, settings=None, **rendering):
    """Yield the rows of one kind of images; `goal` is the largest RMS error in px."""
    errors, sigmas = line_errors(settings, **rendering)
    found = np.isfinite(errors)
    rms, bias = math.sqrt(np.mean(errors[found] ** 2)), abs(errors[found].mean())
    nees = float(np.mean(sigmas[found] ** 2))
    lost = f"lost {1 - found.mean():.2%}"
    yield Number(f"{name}: RMS", rms, high=goal, unit="px", note=lost)
    if "speckle_looks" not in rendering:
        yield Number(f"{name}: bias", bias, high=MAX_BIAS_PX, unit="px")
    yield Number(f"{name}: NEES / dof", nees, 0.7, 1.4)


def noise():
    """Yield the rows of goals G1 to G5: brightness, saturation, width and speckle of the line."""
    for peak, goal in ((200, 0.016), (100, 0.022), (50, 0.034), (25, 0.055), (12, 0.10)):
        goal_name = "G2" if peak == 12 else "G1"
        yield from line_numbers(f"{goal_name} {peak} DN", goal, peak=peak)
        yield from line_numbers(f"{goal_name} {peak} DN, gaussian", goal, GAUSSIAN, peak=peak)
    for peak in (400, 1000):
        yield from line_numbers(f"G3 {peak} DN", 0.035, peak=peak)
        yield from line_numbers(f"G3 {peak} DN, gaussian", 0.013, GAUSSIAN, peak=peak)
    for peak, goal in ((200, 0.023), (50, 0.046)):
        yield from line_numbers(f"G4 wide, {peak} DN", goal, sheet_sigma=0.25, peak=peak)
    yield from line_numbers("G5 speckle, 4 looks", 0.30, speckle_looks=4)
    scene = pipe_on_floor()
    yield from line_numbers("G5 the same on a pipe", 0.30, scene=scene, speckle_looks=4)


def clutter(images=20):
    """Yield the rows of goal G6.

    False are columns with an error above `FALSE_PX`, or found where no line is. Columns whose
    surroundings are at full scale without the laser do not count as lost.
    """
    for name, subtract, goal in (("one frame", False, 4.0), ("laser-off frame", True, 0.2)):
        false, lost, hidden, seen = [], 0, 0, 0
        for seed in range(images):
            image = rendered(pipe_on_floor(), 1000 + seed, speckle_looks=4, stray=CLUTTER)
            line = extract_laser_line(image.image, laser_off=image.laser_off if subtract else None)
            error = np.abs(line.pixels[:, 1] - image.truth_pixels[:, 1])
            there, found = np.isfinite(image.truth_pixels[:, 1]), np.isfinite(line.std)
            false.append(100 * ((error > FALSE_PX) | (found & ~there)).mean())
            missed = there & ~found
            blind = missed & _blinded(image)
            lost, hidden, seen = lost + missed.sum(), hidden + blind.sum(), seen + there.sum()
        note = f"median image {np.median(false):.2f} %, worst {max(false):.2f} %"
        yield Number(f"G6 {name}: false", float(np.mean(false)), high=goal, unit="%", note=note)
        percent = 100 * (lost - hidden) / seen
        note = f"and {100 * hidden / seen:.2f} % on surroundings at full scale"
        yield Number(f"G6 {name}: lost", percent, high=1.0, unit="%", note=note)


def _blinded(image):
    """Return a mask of the columns in which the line's pixel is at full scale without laser."""
    u, v = np.nan_to_num(image.truth_pixels).round().astype(int).T
    return image.laser_off[v, u] >= np.iinfo(image.laser_off.dtype).max


def milliseconds(work, times=41):
    """Return the median processor time of a function in ms, and the minimum as text."""
    work()
    spans = []
    for _ in range(times):
        start = time.process_time()
        work()
        spans.append(1e3 * (time.process_time() - start))
    return float(np.median(spans)), f"min {min(spans):.1f}"


def centre_of_gravity(image):
    """Return the row of the line in each column by the simplest method, for comparison of times."""
    columns = np.ascontiguousarray(image.T)
    background = np.median(columns, axis=1)
    offsets = np.arange(-6, 7)
    rows = np.clip(columns.argmax(axis=1)[:, None] + offsets, 0, image.shape[0] - 1)
    values = np.take_along_axis(columns, rows, axis=1) - background[:, None]
    return (values * rows).sum(axis=1) / values.sum(axis=1)


def time_ratio(work, image, times=41):
    """Return the median ratio of processor times of a function and of `centre_of_gravity`.

    Both are timed in turn, because other processes use the machine.
    """
    work()
    ratios = []
    for _ in range(times):
        spans = [time.process_time()]
        for task in (work, lambda: centre_of_gravity(image)):
            task()
            spans.append(time.process_time())
        ratios.append((spans[1] - spans[0]) / (spans[2] - spans[1]))
    return float(np.median(ratios))


def speed():
    """Yield the rows of goal G7: time per image, and the ratio to a simple method."""
    cv2.setNumThreads(1)
    cases = {
        "plank": rendered(plank(), 0).image,
        "pipe": rendered(pipe_on_floor(), 0).image,
        "pipe, speckle": rendered(pipe_on_floor(), 0, speckle_looks=4).image,
    }
    for name, image in cases.items():
        for what, direction in ((", columns", "columns"), (", direction found", None)):
            extract = partial(extract_laser_line, image, LineSettings(direction=direction))
            median, note = milliseconds(extract)
            yield Number(f"G7 {name}{what}", median, high=10.0, unit="ms", note=note)
            ratio = time_ratio(extract, image)
            yield Number(f"G7 {name}{what} / centre of gravity", ratio, high=MAX_TIME_RATIO)


if __name__ == "__main__":
    print_numbers("Noise", noise())
    print_numbers("Clutter", clutter())
    print_numbers("Speed, 1280 x 1024, one core", speed())
