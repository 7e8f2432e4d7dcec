"""What poses show of a sphere: the circle in which each section cuts it.

A circle (x, y, r) holds all that an arc knows. With q the sphere's centre in the section frame,
x = q_x, y = q_y and r^2 = R^2 - q_z^2: which side of the centre the section lies on never has
to be decided.

Nothing in the robot's poses is as long as the sensor's range: an error of scale of its heights
(a triangulation that is calibrated by a few per cent too long has been seen) makes every circle
too small and every sphere stand elsewhere. So the heights' scale is found along with the rest,
like the radius: as a check, and because sigmas that took it for granted would be too small.
"""

from dataclasses import dataclass, replace

import numpy as np

from lsvision.calibration.observations import FlangePoses, Linearisation, States
from lsvision.calibration.rotations import cube_rotations, nearest_rotations
from lsvision.calibration.sensor_frame_points import masked_least_squares, points_in_sensor_frame
from lsvision.geometry import FloatArray, IntArray

HEIGHT_SCALE_PRIOR_STD = 0.1
"""One sigma of the heights' scale beforehand: next to nothing is taken for granted."""


@dataclass(frozen=True, eq=False)
class SphereObservations:
    """Circles of a sphere (or of several), one a pose.

    Parameters
    ----------
    circles : (n, 3) ndarray
        Centre x, y and radius, section frame. Units: mm.
    covariances : (n, 3, 3) ndarray
        Units: mm^2.
    height_scale_gradients : (n, 2, 3) ndarray
        Change of each circle when all heights are multiplied by 1 + s about one height common
        to all poses: first row times s plus second row times s^2. Units: mm.
    flanges : FlangePoses
        One a circle.
    radius : tuple of float
        The sphere's radius beforehand and its one sigma; inf = free. Units: mm.
    groups : (n,) ndarray
        Which sphere each pose saw.
    """

    circles: FloatArray
    covariances: FloatArray
    height_scale_gradients: FloatArray
    flanges: FlangePoses
    radius: tuple[float, float]
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """All three residuals are millimetres."""
        return np.ones(3)

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Centre free, radius as stated, heights next to free."""
        values = np.array([0, 0, 0, self.radius[0], 0])
        return values, np.array([np.inf, np.inf, np.inf, self.radius[1], HEIGHT_SCALE_PRIOR_STD])

    def linearise(self, states: States) -> Linearisation:
        """Residuals x - q_x, y - q_y and (r^2 - R^2 + q_z^2) / 2r, with derivatives."""
        targets = states.targets[:, self.groups]
        q, by_mount, by_centre, by_flange = points_in_sensor_frame(
            self.flanges, states, targets[..., :3]
        )
        circles, by_scale = self._stretched(targets[..., 4:])
        r = circles[..., 2]
        height = q[..., 2] / r
        # d residual / d q: -1, -1 and q_z / r.
        slopes = np.stack([-np.ones_like(height), -np.ones_like(height), height], axis=-1)
        residuals = circles - q
        residuals[..., 2] = (r**2 - targets[..., 3] ** 2 + q[..., 2] ** 2) / (2 * r)
        by_radius = np.zeros((*q.shape, 1))
        by_radius[..., 2, 0] = -targets[..., 3] / r
        by_scale[..., 2] *= 1 - residuals[..., 2] / r
        by_target = np.concatenate(
            [slopes[..., None] * by_centre, by_radius, by_scale[..., None]], axis=-1
        )
        return Linearisation(
            residuals, slopes[..., None] * by_mount, by_target, slopes[..., None] * by_flange
        )

    def _stretched(self, scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Circles (s, n, 3) at scales (s, n, 1), and their derivatives."""
        first, second = self.height_scale_gradients[:, 0], self.height_scale_gradients[:, 1]
        return (
            self.circles + scales * first + scales**2 * second,
            first + 2 * scales * second,
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Centre, radius and scale after a step; plain addition."""
        return targets + steps

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """Only radius and scale have a prior; the free numbers' weights are zero."""
        return targets - self.target_prior[0]

    def with_groups(self, groups: IntArray) -> "SphereObservations":
        """The same circles, of several spheres of one radius each."""
        return replace(self, groups=groups)

    def with_flange_poses(self, flanges: FlangePoses) -> "SphereObservations":
        """The same circles, had the flange stood elsewhere."""
        return replace(self, flanges=flanges)

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Between the centres. Units: mm."""
        return float(np.linalg.norm((first - second)[:3]))

    def initial_guesses(self, masks: FloatArray) -> States:
        """25 starts for each selection: the linear solution and the 24 rotations of a cube.

        The linear solution ignores how far each section lies from the centre: B (X p) - c = 0
        with p the circle's centre is linear in the first two columns of X's rotation, its
        translation and c, and averages the offsets out where they are balanced. It needs
        four poses; a cube's rotation with translation and c solved for needs three.
        """
        linear = self._linear_rotations(masks)[:, None]
        cube = np.broadcast_to(cube_rotations(), (len(masks), 24, 3, 3))
        rotations = np.concatenate([linear, cube], axis=1)
        return self._states_of(rotations, masks)

    def _linear_rotations(self, masks: FloatArray) -> FloatArray:
        xy, R = self.circles[:, :2], self.flanges.rotations
        eye = np.eye(3)[None]
        columns = [R * xy[:, :1, None], R * xy[:, 1:, None], R, *self._minus_centres(eye)]
        design = np.concatenate(columns, axis=-1)
        solution = masked_least_squares(design, -self.flanges.origins, masks)
        first, second = solution[:, 0:3], solution[:, 3:6]
        raw = np.stack([first, second, np.cross(first, second)], axis=-1)
        length = np.linalg.norm(raw, axis=(1, 2))[:, None, None]
        return nearest_rotations(raw / np.maximum(length, 1e-12))

    def _states_of(self, rotations: FloatArray, masks: FloatArray) -> States:
        """Translation and centre that go with each rotation; (q, k, 3, 3) -> q k states."""
        count = rotations.shape[1]
        eye = np.eye(3)[None]
        R = self.flanges.rotations
        design = np.concatenate([R, *self._minus_centres(eye)], axis=-1)
        seen = np.column_stack([self.circles[:, :2], np.zeros(len(self.circles))])
        turned = np.einsum("nij,qkjl,nl->qkni", R, rotations, seen)
        right = -(self.flanges.origins + turned).reshape(-1, len(seen), 3)
        solution = masked_least_squares(design, right, np.repeat(masks, count, axis=0))
        groups = int(self.groups.max()) + 1
        radius = self.radius[0] if np.isfinite(self.radius[1]) else self.circles[:, 2].max()
        centres = solution[:, 3:].reshape(-1, groups, 3)
        sizes = np.broadcast_to([radius, 0.0], (*centres.shape[:2], 2))
        targets = np.concatenate([centres, sizes], axis=-1)
        return States(rotations.reshape(-1, 3, 3), solution[:, :3], targets)

    def _minus_centres(self, eye: FloatArray) -> list[FloatArray]:
        groups = range(int(self.groups.max()) + 1)
        return [-eye * (self.groups == group)[:, None, None] for group in groups]
