"""Goal G8 of the camera, image to cylinder: ``python -m tests.bench.camera_chain``."""

import math
import time
from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares

from lsvision.measure import measure_cylinders
from lsvision.sensors.camera import Camera
from lsvision.sensors.light_section import LightSection
from lsvision.simulate.scene import Scene
from lsvision.simulate.solids import Tube
from tests.bench.goals import Number, print_numbers
from tests.laser_line.line_scenes import RIG, STAND_OFF, pipe_on_floor, rendered

RADIUS = 25.0
GOAL = 2.0  # um, without speckle
SPECKLE_GOAL = 25.0  # um, one frame
HALF_ARC = math.radians(60.0)
TIME_GOAL = 25.0  # ms
CONSISTENT = 0.7, 1.4  # squared errors over predicted variance
SECTION = LightSection(Camera(RIG.matrix, RIG.distortion, RIG.size), RIG.laser_plane)


def pipe(phi_deg):
    tilt = math.radians(phi_deg)
    return Scene((Tube.of(RADIUS, math.pi / 2, tilt, (0.0, STAND_OFF - RADIUS)),))


def circle_of(profile):
    """Radius of the 120 deg of a circle that face the sensor, by scipy."""
    points = profile.points[np.abs(profile.points[:, 0]) < RADIUS * math.sin(HALF_ARC)]

    def residuals(circle):
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    return least_squares(residuals, (0.0, STAND_OFF - RADIUS, RADIUS)).x[2]


def circle(images=30):
    """G8 to the letter: a circle fitted to 120 deg of an upright pipe."""
    for looks, goal in ((0, GOAL), (5, SPECKLE_GOAL)):
        radii = [
            circle_of(SECTION.profile(rendered(pipe(0.0), seed, speckle_looks=looks).image))
            for seed in range(images)
        ]
        off = 1e3 * (np.array(radii) - RADIUS)
        name = f"G8 circle, {'speckle' if looks else 'no speckle'}"
        yield Number(f"{name}: |bias|", abs(off.mean()), high=goal, unit="um")
        yield Number(f"{name}: std", off.std(), high=goal, unit="um")


def ellipse(images=30):
    """The whole chain, ellipse free, on all of the arc that is seen."""
    cases = (
        (", blur 0.7 px unstated", 0.7, 0.0),
        (", blur 0.7 px stated", 0.7, 0.7),
        (", blur 0.5 px stated", 0.5, 0.5),
        (", blur 1.0 px stated", 1.0, 1.0),
    )
    for name, blur, stated in cases:
        section = replace(SECTION, line_blur_px=stated)
        found = [
            cylinder
            for seed in range(images)
            for cylinder in chain(
                rendered(pipe(20.0), seed, psf_sigma=blur).image, section
            ).cylinders
        ]
        off = 1e3 * (np.array([one.radius for one in found]) - RADIUS)
        predicted = 1e3 * np.mean([one.radius_std for one in found])
        note = f"{len(found)} of {images} found, predicted std {predicted:.1f} um"
        yield Number(f"tilted 20 deg{name}: |bias|", abs(off.mean()), high=GOAL, unit="um")
        yield Number(f"tilted 20 deg{name}: std", off.std(), high=GOAL, unit="um", note=note)


def speckled(images=30):
    """Speckle of contrast 0.44: errors in units of the predicted std, the lens's blur stated."""
    section = replace(SECTION, line_blur_px=0.7)
    found = [
        cylinder
        for seed in range(images)
        for cylinder in chain(rendered(pipe(20.0), seed, speckle_looks=5).image, section).cylinders
    ]
    scores = np.array([(one.radius - RADIUS) / one.radius_std for one in found])
    off = 1e3 * (np.array([one.radius for one in found]) - RADIUS)
    yield Number("tilted 20 deg, speckle: |bias|", abs(off.mean()), unit="um")
    yield Number("tilted 20 deg, speckle: std", off.std(), unit="um")
    yield Number("tilted 20 deg, speckle: NEES", float(np.mean(scores**2)), *CONSISTENT, unit="")


def chain(image, section=SECTION):
    return measure_cylinders(section.profile(image))


def speed(times=31):
    """Median CPU time: others use the machine."""
    cv2.setNumThreads(1)
    for name, looks in (("", 0), (", speckle", 4)):
        image = rendered(pipe_on_floor(), 0, speckle_looks=looks).image
        chain(image)
        spans = []
        for _ in range(times):
            start = time.process_time()
            chain(image)
            spans.append(1e3 * (time.process_time() - start))
        note = f"least {min(spans):.1f}"
        median = float(np.median(spans))
        yield Number(f"image to cylinders{name}", median, high=TIME_GOAL, unit="ms", note=note)


if __name__ == "__main__":
    print_numbers("Circle", circle())
    print_numbers("Whole chain", ellipse())
    print_numbers("Whole chain in speckle", speckled())
    print_numbers("Speed, 1280 x 1024, one core", speed())
