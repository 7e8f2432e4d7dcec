"""Radius of a pipe from images, beside the goals (G8): ``python -m tests.bench.camera_chain``."""

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

RADIUS = 25.0  # mm
GOAL = 2.0  # um, bias and std without speckle
SPECKLE_GOAL = 25.0  # um, of one image with speckle
HALF_ARC = math.radians(60.0)
TIME_GOAL = 25.0  # ms
NEES_GOAL = 0.7, 1.4  # mean squared error over predicted variance
SECTION = LightSection(Camera(RIG.matrix, RIG.distortion, RIG.size), RIG.laser_plane)


def pipe(phi_deg):
    """Return the scene of a pipe tilted along Y, its highest point in the middle of the view."""
    tilt = math.radians(phi_deg)
    return Scene((Tube.of(RADIUS, math.pi / 2, tilt, (0.0, STAND_OFF - RADIUS)),))


def circle_radius(profile):
    """Return the radius of the circle through the 120 deg that face the sensor, by scipy."""
    points = profile.points[np.abs(profile.points[:, 0]) < RADIUS * math.sin(HALF_ARC)]

    def residuals(circle):
        return np.hypot(*(points - circle[:2]).T) - circle[2]

    return least_squares(residuals, (0.0, STAND_OFF - RADIUS, RADIUS)).x[2]


def circle(images=30):
    """Yield the rows of goal G8: a circle fitted to 120 deg of a pipe with phi = 0."""
    for looks, goal in ((0, GOAL), (5, SPECKLE_GOAL)):
        radii = [
            circle_radius(SECTION.profile(rendered(pipe(0.0), seed, speckle_looks=looks).image))
            for seed in range(images)
        ]
        errors = 1e3 * (np.array(radii) - RADIUS)
        name = f"G8 circle, {'speckle' if looks else 'no speckle'}"
        yield Number(f"{name}: |bias|", abs(errors.mean()), high=goal, unit="um")
        yield Number(f"{name}: std", errors.std(), high=goal, unit="um")


def ellipse(images=30):
    """Yield the rows of `measure_cylinders` on the whole visible arc of a tilted pipe."""
    cases = (
        (", blur 0.7 px unstated", 0.7, 0.0),
        (", blur 0.7 px stated", 0.7, 0.7),
        (", blur 0.5 px stated", 0.5, 0.5),
        (", blur 1.0 px stated", 1.0, 1.0),
    )
    for name, blur, stated in cases:
        section = replace(SECTION, line_blur_px=stated)
        cylinders = _measure_pipes(images, section, psf_sigma=blur)
        errors = _errors_um(cylinders)
        predicted = 1e3 * np.mean([cylinder.radius_std for cylinder in cylinders])
        note = f"{len(cylinders)} of {images} found, predicted std {predicted:.1f} um"
        yield Number(f"tilted 20 deg{name}: |bias|", abs(errors.mean()), high=GOAL, unit="um")
        yield Number(f"tilted 20 deg{name}: std", errors.std(), high=GOAL, unit="um", note=note)


def speckled(images=30):
    """Yield the rows of a tilted pipe with speckle of contrast 0.44, the lens's blur stated."""
    cylinders = _measure_pipes(images, replace(SECTION, line_blur_px=0.7), speckle_looks=5)
    errors = _errors_um(cylinders)
    nees = np.mean([((c.radius - RADIUS) / c.radius_std) ** 2 for c in cylinders])
    yield Number("tilted 20 deg, speckle: |bias|", abs(errors.mean()), unit="um")
    yield Number("tilted 20 deg, speckle: std", errors.std(), unit="um")
    yield Number("tilted 20 deg, speckle: NEES", float(nees), *NEES_GOAL)


def _measure_pipes(images, section, **rendering):
    """Return the cylinders in so many images of a pipe with phi = 20 deg."""
    return [
        cylinder
        for seed in range(images)
        for cylinder in chain(rendered(pipe(20.0), seed, **rendering).image, section).cylinders
    ]


def _errors_um(cylinders):
    """Return the errors of the radii in um."""
    return 1e3 * (np.array([cylinder.radius for cylinder in cylinders]) - RADIUS)


def chain(image, section=SECTION):
    """Return the measurement of an image: laser line, profile, cylinders."""
    return measure_cylinders(section.profile(image))


def speed(times=31):
    """Yield the median processor time of an image, because other processes use the machine."""
    cv2.setNumThreads(1)
    for name, looks in (("", 0), (", speckle", 4)):
        image = rendered(pipe_on_floor(), 0, speckle_looks=looks).image
        chain(image)
        milliseconds = []
        for _ in range(times):
            start = time.process_time()
            chain(image)
            milliseconds.append(1e3 * (time.process_time() - start))
        note = f"min {min(milliseconds):.1f}"
        median = float(np.median(milliseconds))
        yield Number(f"image to cylinders{name}", median, high=TIME_GOAL, unit="ms", note=note)


if __name__ == "__main__":
    print_numbers("Circle", circle())
    print_numbers("Whole chain", ellipse())
    print_numbers("Whole chain in speckle", speckled())
    print_numbers("Speed, 1280 x 1024, one core", speed())
