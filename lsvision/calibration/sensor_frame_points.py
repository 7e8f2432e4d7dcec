"""Points of the target's frame as the sensor sees them, and the linear starts' least squares."""

import numpy as np

from lsvision.calibration.observations import FlangePoses, States
from lsvision.calibration.rotations import cross_matrices
from lsvision.geometry import FloatArray


def points_in_sensor_frame(
    flanges: FlangePoses, states: States, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points (s, n, 3) of the target's frame in the sensor's, with derivatives.

    By the mount's pose (s, n, 3, 6), the point (s, n, 3, 3) and the flange's pose
    (s, n, 3, 6); rotations act from the left.
    """
    to_mount = np.swapaxes(flanges.rotations, -1, -2)
    to_sensor = np.swapaxes(states.rotations, -1, -2)[:, None]
    offset = points - flanges.origins
    in_mount = (to_mount @ offset[..., None])[..., 0] - states.translations[:, None]
    seen = (to_sensor @ in_mount[..., None])[..., 0]
    by_point = to_sensor @ to_mount
    shape = by_point.shape
    by_mount = np.concatenate(
        [np.broadcast_to(-to_sensor, shape), to_sensor @ cross_matrices(in_mount)], axis=-1
    )
    by_flange = np.concatenate([-by_point, by_point @ cross_matrices(offset)], axis=-1)
    return seen, by_mount, by_point, by_flange


def masked_least_squares(design: FloatArray, right: FloatArray, masks: FloatArray) -> FloatArray:
    """Least squares over the poses of each selection; (n, 3, p), (q or -, n, 3), (q, n) -> (q, p).

    By normal equations with a whiff of ridge: a start need not be exact, only exist.
    """
    scale = np.maximum(np.abs(design).max(axis=(0, 1)), 1e-12)
    scaled = design / scale
    grams = np.einsum("nij,nik->njk", scaled, scaled)
    normal = np.einsum("qn,njk->qjk", masks, grams)
    if right.ndim == 2:
        side = np.einsum("qn,nij,ni->qj", masks, scaled, right)
    else:
        side = np.einsum("qn,nij,qni->qj", masks, scaled, right)
    size = normal.shape[-1]
    ridge = 1e-10 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(size)
    solution: FloatArray = np.linalg.solve(normal + ridge, side[..., None])[..., 0] / scale
    return solution
