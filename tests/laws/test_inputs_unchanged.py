"""No step changes what it was given. One table, every step."""

import copy
import pickle

import numpy as np
import pytest

from lsvision import Ellipse, Profile, ProfileSensor, measure_cylinders
from lsvision.detection.acceptance import (
    Rejection,
    neighbourhood_rejection_reason,
    rejection_reason,
)
from lsvision.detection.arc_detection import identify_arcs
from lsvision.detection.candidates import find_candidates, seed_ellipse
from lsvision.detection.identification import IdentifiedArc, identify_arc
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import connected_components, rasterise
from lsvision.detection.rejections import complete_rejections
from lsvision.detection.screening import screen_arc
from lsvision.detection.windows import fit_window_circles
from lsvision.ellipse.conditioning import condition_arc
from lsvision.ellipse.fit import fit_ellipse
from lsvision.ellipse.homogenising import homogenise, homogenise_profile_paper
from lsvision.ellipse.smoothing import smooth_profile_paper, smooth_residual
from lsvision.profile import Arc
from lsvision.shapes import orthogonal_residuals, radial_residuals
from lsvision.shapes.ellipse import foot_points
from lsvision.shapes.noisy_points import NoisyPoints
from lsvision.statistics.correlation import autocorrelation_time
from tests.detection.scenes import dome, flat, line
from tests.ellipse.arcs import SENSOR, pipe, upper_arc

RANGE = (5.0, 60.0)
WEIGHED = line(flat(-50, -20), dome(0, 20), flat(20, 50))
COMPONENTS = connected_components(rasterise(WEIGHED), 10)
CANDIDATES = find_candidates(WEIGHED, COMPONENTS, RANGE)
ARC = identify_arc(WEIGHED, CANDIDATES[0], WEIGHED.valid_indices)
POINTS = upper_arc(pipe(30.0))
COVARIANCES = SENSOR.covariances(POINTS)
CIRCLE = Ellipse((5.0, -400.0), 19.0, 19.0, 0.0)
LENGTH = np.linspace(0, 50, 70)

STEPS = {
    "prepare_profile": (prepare_profile, Profile(POINTS), ProfileSensor()),
    "rasterise": (rasterise, WEIGHED),
    "connected_components": (connected_components, rasterise(WEIGHED), 10),
    "find_candidates": (find_candidates, WEIGHED, COMPONENTS, RANGE),
    "seed_ellipse": (seed_ellipse, WEIGHED, CANDIDATES[0]),
    "identify_arc": (identify_arc, WEIGHED, CANDIDATES[0], WEIGHED.valid_indices.copy()),
    "identify_arcs": (identify_arcs, WEIGHED, CANDIDATES, RANGE),
    "screen_arc": (screen_arc, WEIGHED, ARC),
    "rejection_reason": (rejection_reason, WEIGHED, ARC, RANGE),
    "neighbourhood_rejection_reason": (neighbourhood_rejection_reason, WEIGHED, ARC),
    "complete_rejections": (
        complete_rejections, WEIGHED, COMPONENTS,
        [IdentifiedArc(ARC.arc, ARC.indices, ARC.ellipse)],
        [Rejection(Arc(0, 20), "flat")], RANGE,
    ),
    "fit_window_circles": (fit_window_circles, POINTS, np.array([0]), np.array([70])),
    "condition_arc": (condition_arc, NoisyPoints.of(POINTS, COVARIANCES), CIRCLE),
    "smooth_residual": (smooth_residual, LENGTH, np.sin(LENGTH), np.ones(70)),
    "homogenise": (homogenise, LENGTH, POINTS[:, 1]),
    "smooth_profile_paper": (smooth_profile_paper, POINTS),
    "homogenise_profile_paper": (homogenise_profile_paper, POINTS[POINTS[:, 0].argsort()]),
    "fit_ellipse": (fit_ellipse, POINTS, CIRCLE, COVARIANCES),
    "autocorrelation_time": (autocorrelation_time, np.sin(LENGTH)),
    "foot_points": (foot_points, POINTS, 20.0, 15.0),
    "radial_residuals": (radial_residuals, POINTS, CIRCLE),
    "orthogonal_residuals": (orthogonal_residuals, POINTS, CIRCLE),
    "measure_cylinders": (measure_cylinders, Profile(WEIGHED.points)),
}  # fmt: skip


@pytest.mark.parametrize("name", STEPS)
def test_a_step_leaves_its_input_untouched(name):
    step, *given = STEPS[name]
    given = copy.deepcopy(given)
    before = pickle.dumps(given)
    step(*given)
    assert pickle.dumps(given) == before


@pytest.mark.parametrize("name", STEPS)
def test_a_step_gives_the_same_twice(name):
    step, *given = STEPS[name]
    assert pickle.dumps(step(*given)) == pickle.dumps(step(*given))
