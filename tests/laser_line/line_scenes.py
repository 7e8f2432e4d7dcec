"""Scenes under a laser line, as the camera of the goals G1 to G8 sees them."""

import math

import numpy as np

from lsvision.simulate.images import ImageSettings, simulate_image
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.prism import Prism
from lsvision.simulate.scene import Scene
from lsvision.simulate.stray_light import StrayLight
from lsvision.simulate.tube import Tube

RIG = ImagingRig.triangulating()
SMALL_RIG = ImagingRig.triangulating(focal_length=1132.0, size=(640, 320))
STAND_OFF = -259.8  # mm; 300 mm along the view
ACROSS = (0.0, math.sin(math.radians(30)), math.cos(math.radians(30)))  # image v, in the section
CLUTTER = StrayLight(ambient=20, gradient=10, streaks=12, blobs=25, brightness=(200, 400))


def plank(slope=0.03, span=500.0):
    """Faces the camera; turned about the view, so that the line crosses the pixels' rows."""
    ends = [[x, STAND_OFF + slope * x] for x in (-span, span)]
    return Scene((Prism(ends, ACROSS),))


def pipe_on_floor(radius=25.0, phi=math.radians(20)):
    pipe = Tube.of(radius=radius, theta=math.pi / 2, phi=phi, centre=(0.0, STAND_OFF - radius))
    floor = Prism([[x, STAND_OFF - radius - 20] for x in (-500.0, 500.0)], ACROSS)
    return Scene((pipe, floor))


def nothing():
    """Nothing that the laser meets."""
    return Scene((Tube.of(radius=1.0, theta=0.0, phi=0.0, centre=(5000.0, 0.0)),))


def rendered(scene, seed=0, rig=RIG, **settings):
    return simulate_image(scene, rig, ImageSettings(**settings), rng=np.random.default_rng(seed))
