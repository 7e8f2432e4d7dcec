"""Jacobians of every kind of observation against difference quotients."""

from dataclasses import replace

import numpy as np
import pytest

from lsvision.calibration.board_observations import BoardObservations
from lsvision.calibration.observations import (
    FlangePoses,
    States,
    solve_masked_least_squares,
    stack_flange_poses,
)
from lsvision.calibration.plane_observations import PlaneObservations
from lsvision.calibration.rotations import rotations_from_vectors
from lsvision.calibration.sphere_observations import SphereObservations
from tests.calibration.hand_eye_scenes import MOUNT, RADIUS, TARGET, sphere_scene

STEP = 1e-4  # mm and rad: truncation 1e-8 of the second derivative, rounding 1e-9
TOLERANCE = 2e-4  # of the largest derivative, about 1000 mm/rad
COUNT = 4
GROUPS = np.zeros(COUNT, dtype=np.int64)
FLANGES = stack_flange_poses(sphere_scene(1, COUNT)[1], "eye_in_hand", (0.05, 1e-4))


def sphere():
    rng = np.random.default_rng(0)
    circles = np.column_stack([rng.normal(size=(COUNT, 2)), np.full(COUNT, 15.0)])
    stretches = rng.normal(size=(COUNT, 2, 3))
    covariances = np.tile(np.eye(3), (COUNT, 1, 1))
    observations = SphereObservations(
        circles, covariances, stretches, FLANGES, (20, np.inf), GROUPS
    )
    return observations, np.array([*TARGET, RADIUS, 0.1])


def plane():
    """Seen just where expected: derivatives leave out what is of the residuals' own order."""
    normal, distance = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0]), 300.0
    seen = (FLANGES.rotations @ MOUNT.rotation).transpose(0, 2, 1) @ normal
    origins = FLANGES.rotations @ MOUNT.translation + FLANGES.origins
    flat = seen * (1, 1, 0)
    widths = np.linalg.norm(flat, axis=1)[:, None]
    middles = flat * ((distance - origins @ normal)[:, None] / widths**2)
    directions = np.cross(flat / widths, (0, 0, 1))
    sizes, covariances = np.full(COUNT, 20.0), np.tile(np.eye(2), (COUNT, 1, 1))
    observations = PlaneObservations(middles, directions, sizes, covariances, FLANGES, GROUPS)
    return observations, np.append(normal, distance)


def board():
    """Seen just where expected: the orientation's derivative is that of small residuals."""
    rotation = rotations_from_vectors(np.array([0.2, -0.1, 0.4]))
    base_from_mount = FLANGES.rotations @ MOUNT.rotation
    origins = FLANGES.rotations @ MOUNT.translation + FLANGES.origins
    seen = np.swapaxes(base_from_mount, -1, -2)
    at = (seen @ (TARGET - origins)[..., None])[..., 0]
    covariances = np.tile(np.eye(6), (COUNT, 1, 1))
    observations = BoardObservations(seen @ rotation, at, covariances, FLANGES, GROUPS)
    return observations, np.concatenate([TARGET, rotation.ravel()])


def state_of(target):
    return States(MOUNT.rotation[None], MOUNT.translation[None], target[None, None])


def moved_mount(state, step):
    rotation = rotations_from_vectors(step[3:]) @ state.rotations
    return States(rotation, state.translations + step[:3], state.targets)


def moved_flanges(step):
    rotations = rotations_from_vectors(step[3:]) @ FLANGES.rotations
    return FlangePoses(rotations, FLANGES.origins + step[:3], FLANGES.covariances)


def differences(residuals_after, size):
    columns = []
    for axis in range(size):
        step = np.zeros(size)
        step[axis] = STEP
        columns.append((residuals_after(step) - residuals_after(-step)) / (2 * STEP))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("kind", [sphere, plane, board])
def test_jacobians_equal_difference_quotients(kind):
    observations, target = kind()
    state = state_of(target)
    lin = observations.linearise(state)
    by_mount = differences(lambda s: observations.linearise(moved_mount(state, s)).residuals, 6)
    by_flange = differences(
        lambda s: replace(observations, flanges=moved_flanges(s)).linearise(state).residuals, 6
    )
    by_target = differences(
        lambda s: (
            observations.linearise(
                States(
                    state.rotations,
                    state.translations,
                    observations.update_targets(state.targets, s[None, None]),
                )
            ).residuals
        ),
        lin.target_jacobian.shape[-1],
    )
    for found, expected in (
        (lin.mount_jacobian, by_mount),
        (lin.flange_jacobian, by_flange),
        (lin.target_jacobian, by_target),
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def test_an_empty_selection_has_the_solution_zero():
    design, rhs = np.ones((4, 3, 2)), np.ones((4, 3))
    assert (solve_masked_least_squares(design, rhs, np.zeros((1, 4))) == 0).all()
