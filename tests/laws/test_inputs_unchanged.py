"""No step changes what it was given. One table, every step."""

import copy
import pickle

import numpy as np
import pytest

from lsvision import Ellipse, Profile, ProfileSensor, measure_cylinders
from lsvision.detection.acceptance import find_rejection_reason, find_shape_rejection_reason
from lsvision.detection.arcs import Rejection
from lsvision.detection.candidates import find_candidates, fit_seed_ellipse
from lsvision.detection.end_condition import find_connected_beyond, find_tangential_end_reason
from lsvision.detection.end_points import (
    EndPoints,
    Prediction,
    compute_departure_free_probability,
    find_end_inliers,
)
from lsvision.detection.identification import Seed, find_connected_inliers, grow_arcs, identify_arcs
from lsvision.detection.line_order import order_along_line
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.detection.range_image import build_range_image, find_connected_components
from lsvision.detection.rejections import complete_rejections
from lsvision.detection.screening import screen_arcs
from lsvision.detection.windows import Windows, fit_window_circles
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.homogenising import homogenise_arcs
from lsvision.ellipse.problem import Priors
from lsvision.ellipse.refinement import refine_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.ellipse.smoothing import smooth_arcs, smooth_residuals
from lsvision.geometry import orthogonal_residuals, radial_residuals
from lsvision.geometry.ellipse import find_foot_points
from lsvision.geometry.noisy_points import as_complex
from lsvision.profile import Arc
from lsvision.statistics.correlation import autocorrelation_time, estimate_correlation
from lsvision.studies.chen_liu_2016.paper_pipeline import (
    homogenise_profile_paper,
    smooth_profile_paper,
)
from tests.detection.scenes import dome, flat, line
from tests.ellipse.arcs import SENSOR, pipe, upper_arc

RANGE = (5.0, 60.0)
PREPARED = line(flat(-50, -20), dome(0, 20), flat(20, 50))
COMPONENTS = find_connected_components(build_range_image(PREPARED), 10)
(CANDIDATES,) = find_candidates([PREPARED], [COMPONENTS], [RANGE])
SEEDS = [Seed(PREPARED, CANDIDATES[0], PREPARED.valid_indices)]
((ARC, NORMALS),) = grow_arcs(SEEDS)
(SCREENED,) = screen_arcs([PREPARED], [ARC])
POINTS = upper_arc(pipe(30.0))
COVARIANCES = SENSOR.covariances(POINTS)
CIRCLE = Ellipse((5.0, -400.0), 19.0, 19.0, 0.0)
LENGTH = np.linspace(0, 50, 70)
END = EndPoints(
    0.02 * np.sin(LENGTH[None, :12]), np.full((1, 12), 4e-4),
    np.cos(np.outer(np.arange(5), LENGTH[:12]))[None], np.ones((1, 12), dtype=bool),
    LENGTH[None, :12],
)  # fmt: skip
PREDICTION = Prediction(
    np.full((1, 5), 1e-3), 1e-4 * np.eye(5)[None], np.array([1.5]), np.array([20.0])
)
TO_REFINE = (
    [SCREENED.points], [SCREENED.ellipse], Priors(None, None), FittingSettings(), [0.02],
)  # fmt: skip
(FIT,) = refine_arcs(*TO_REFINE)

STEPS = {
    "prepare_profile": (prepare_profile, Profile(POINTS), ProfileSensor()),
    "order_along_line": (order_along_line, POINTS[::2]),
    "build_range_image": (build_range_image, PREPARED),
    "find_connected_components": (find_connected_components, build_range_image(PREPARED), 10),
    "find_candidates": (find_candidates, [PREPARED], [COMPONENTS], [RANGE]),
    "fit_seed_ellipse": (fit_seed_ellipse, PREPARED, CANDIDATES[0]),
    "grow_arcs": (grow_arcs, SEEDS),
    "find_connected_inliers": (find_connected_inliers, np.sin(LENGTH) > 0, np.arange(20, 30)),
    "identify_arcs": (identify_arcs, [PREPARED], [CANDIDATES], [RANGE]),
    "screen_arcs": (screen_arcs, [PREPARED], [ARC]),
    "find_end_inliers": (find_end_inliers, END, PREDICTION),
    "compute_departure_free_probability": (
        compute_departure_free_probability, END, PREDICTION, np.arange(10)[None] < 7,
        np.arange(10)[None] >= 7,
    ),
    "find_tangential_end_reason": (find_tangential_end_reason, PREPARED, ARC, SCREENED),
    "find_connected_beyond": (find_connected_beyond, np.arange(9) + 0j, np.arange(9, 12) + 0j, 3),
    "smooth_arcs": (smooth_arcs, [SCREENED.points], [SCREENED.ellipse]),
    "smooth_residuals": (
        smooth_residuals, LENGTH[None], np.sin(LENGTH)[None], np.ones((1, 70)), LENGTH[None, ::7],
        np.ones((1, 70), dtype=bool),
    ),
    "homogenise_arcs": (homogenise_arcs, smooth_arcs([SCREENED.points], [SCREENED.ellipse])),
    "refine_arcs": (refine_arcs, *TO_REFINE),
    "find_shape_rejection_reason": (find_shape_rejection_reason, ARC.ellipse, NORMALS, RANGE),
    "find_rejection_reason": (
        find_rejection_reason, PREPARED, CylinderSection(FIT, ARC.arc, SCREENED.indices), RANGE,
    ),
    "complete_rejections": (
        complete_rejections, PREPARED, COMPONENTS, [ARC], [Rejection(Arc(0, 20), "flat")], RANGE,
    ),
    "fit_window_circles": (
        fit_window_circles, as_complex(POINTS)[None],
        Windows(np.array([0]), np.array([0]), np.array([70])),
    ),
    "smooth_profile_paper": (smooth_profile_paper, POINTS),
    "homogenise_profile_paper": (homogenise_profile_paper, POINTS[POINTS[:, 0].argsort()]),
    "fit_ellipse": (fit_ellipse, POINTS, CIRCLE, COVARIANCES),
    "autocorrelation_time": (autocorrelation_time, np.sin(LENGTH)),
    "estimate_correlation": (estimate_correlation, np.sin(LENGTH)),
    "find_foot_points": (find_foot_points, POINTS, 20.0, 15.0),
    "radial_residuals": (radial_residuals, POINTS, CIRCLE),
    "orthogonal_residuals": (orthogonal_residuals, POINTS, CIRCLE),
    "measure_cylinders": (measure_cylinders, Profile(PREPARED.points)),
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
