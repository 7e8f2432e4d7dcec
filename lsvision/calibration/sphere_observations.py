"""Hand-eye observations of a sphere: the circle in which each section cuts it.

A circle (x, y, r) contains all the information of an arc. With q the sphere's centre in the
section frame, x = q_x, y = q_y and r^2 = R^2 - q_z^2: the side of the centre on which the section
lies need not be known.

The displacements between the robot's poses are shorter than the sensor's range and do not reveal an
error of the scale of the heights (triangulation scales wrong by a few percent occur), which makes
every circle too small and shifts every sphere. The scale of the heights is therefore estimated
together with the radius, as a check of the sensor and because standard deviations that take it as
exact would be too small.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.observations import (
    FlangePoses,
    Linearisation,
    States,
    solve_masked_least_squares,
    transform_to_sensor_frame,
)
from lsvision.calibration.rotations import (
    list_cube_rotations,
    list_dense_rotations,
    rotations_from_columns,
)
from lsvision.errors import CalibrationFailed, DegenerateGeometry
from lsvision.geometry import BoolArray, FloatArray, IntArray, Pose

PLANNED_ARC_ANGLES = np.radians(np.linspace(-60.0, 60.0, 61))
"""Angles of the points of a planned arc, from the section's Y. Units: rad."""
MAX_CUT_OFFSET = 0.95
"""Distance of a planned cut from the sphere's centre, in radii, beyond which the arc is too small
to be found."""
MIN_RMS_OFFSET_RATIO = 0.15
"""Smallest root mean square distance of the sections from the sphere's centre, in radii: cuts
through the centre do not tell on which side of it they lie."""
MAX_RADIUS_RATIO = 1.1
"""Ratio of the largest cut to the given radius, above which the radius is wrong: sensors whose
heights are scaled wrong by several per cent occur."""
MIN_RADIUS_RATIO = 0.3
"""Ratio of the largest cut to the given radius, below which the radius is wrong: the cuts would all
be farther from the centre than `MAX_CUT_OFFSET`."""
MIN_SPREAD_RATIO = 0.05
"""Smallest range of the sphere's positions in the view, in radii of the largest cut."""
HEIGHT_SCALE_PRIOR_STD = 0.1
"""Standard deviation of the prior on the scale of the heights; almost uninformative."""


@dataclass(frozen=True, eq=False)
class SphereObservations:
    """Circles of a sphere (or of several), one for each pose.

    Parameters
    ----------
    circles : (n, 3) ndarray
        Centre x, y and radius, section frame. Units: mm.
    covariances : (n, 3, 3) ndarray
        Covariance of each circle. Units: mm^2.
    height_scale_gradients : (n, 2, 3) ndarray
        Change of each circle when all heights are multiplied by 1 + s about one height common
        to all poses: first row times s plus second row times s^2. Units: mm.
    flanges : FlangePoses
        Flange pose of each observation.
    radius_prior : tuple of float
        Prior mean and standard deviation of the sphere's radius; inf = no prior. Units: mm.
    groups : (n,) ndarray
        Index of the sphere that each pose observes.
    """

    circles: FloatArray
    covariances: FloatArray
    height_scale_gradients: FloatArray
    flanges: FlangePoses
    radius_prior: tuple[float, float]
    groups: IntArray

    @property
    def mm_per_residual(self) -> FloatArray:
        """Factors (3,) that convert residuals to mm: ones."""
        return np.ones(3)

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Prior mean and standard deviation (5,): centre and radius (mm), error of height scale."""
        values = np.array([0, 0, 0, self.radius_prior[0], 0])
        return values, np.array(
            [np.inf, np.inf, np.inf, self.radius_prior[1], HEIGHT_SCALE_PRIOR_STD]
        )

    def linearise(self, states: States) -> Linearisation:
        """Return residuals x - q_x, y - q_y and (r^2 - R^2 + q_z^2) / 2r, with Jacobians.

        The third is the residual of the radius, r - sqrt(R^2 - q_z^2), to first order.
        """
        targets = states.targets[:, self.groups]
        q, mount_jacobian, centre_jacobian, flange_jacobian = transform_to_sensor_frame(
            self.flanges, states, targets[..., :3]
        )
        circles, scale_jacobian = self._fit_circles_at_scales(targets[..., 4:])
        r = circles[..., 2]
        offset_ratio = q[..., 2] / r
        # d residual / d q: -1, -1 and q_z / r.
        slopes = np.stack(
            [-np.ones_like(offset_ratio), -np.ones_like(offset_ratio), offset_ratio], axis=-1
        )
        residuals = circles - q
        residuals[..., 2] = (r**2 - targets[..., 3] ** 2 + q[..., 2] ** 2) / (2 * r)
        radius_jacobian = np.zeros((*q.shape, 1))
        radius_jacobian[..., 2, 0] = -targets[..., 3] / r
        # The height scale changes the circle; d (third residual) / dr is 1 - residual / r.
        scale_jacobian[..., 2] *= 1 - residuals[..., 2] / r
        target_jacobian = np.concatenate(
            [slopes[..., None] * centre_jacobian, radius_jacobian, scale_jacobian[..., None]],
            axis=-1,
        )
        return Linearisation(
            residuals,
            slopes[..., None] * mount_jacobian,
            target_jacobian,
            slopes[..., None] * flange_jacobian,
        )

    def _fit_circles_at_scales(self, scales: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return circles (s, n, 3) at height scales (s, n, 1), and their derivatives."""
        first, second = self.height_scale_gradients[:, 0], self.height_scale_gradients[:, 1]
        return (
            self.circles + scales * first + scales**2 * second,
            first + 2 * scales * second,
        )

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Return centre, radius and error of the height scale after a step (addition)."""
        return targets + steps

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """Return the distance of the centres. Units: mm."""
        return float(np.linalg.norm((first - second)[:3]))

    def estimate_initial_guesses(self, masks: FloatArray) -> States:
        """Return guesses for each selection: a linear solution, and many rotations.

        The rotations are the 24 of a cube, and 192 for a single selection, where no other selection
        leads to a minimum that these miss.

        The linear solution neglects the distance of the sections from the centre: B (X p) - c = 0,
        with B the pose of the mount, X that of the sensor on it, p the circle's centre and c the
        sphere's, is linear in the first two columns of X's rotation, its translation and c. The
        distances average out where they are balanced. It needs four poses; with the rotation given,
        X's translation and c need three.
        """
        linear = self._solve_linear_rotations(masks)[:, None]
        grid = list_dense_rotations() if len(masks) == 1 else list_cube_rotations()
        rotations = np.concatenate([linear, np.tile(grid, (len(masks), 1, 1, 1))], axis=1)
        return self._solve_states_with_rotations(rotations, masks)

    def _solve_linear_rotations(self, masks: FloatArray) -> FloatArray:
        """Return the rotation of the linear solution of each selection."""
        xy, R = self.circles[:, :2], self.flanges.rotations
        columns = [R * xy[:, :1, None], R * xy[:, 1:, None], R, *self._build_centre_columns()]
        design = np.concatenate(columns, axis=-1)
        solution = solve_masked_least_squares(design, -self.flanges.origins, masks)
        return rotations_from_columns(solution[:, :3], solution[:, 3:6])

    def _solve_states_with_rotations(self, rotations: FloatArray, masks: FloatArray) -> States:
        """Return states with given rotations (q, k, 3, 3), all else by linear least squares."""
        count = rotations.shape[1]
        R = self.flanges.rotations
        design = np.concatenate([R, *self._build_centre_columns()], axis=-1)
        centres_in_sensor = np.column_stack([self.circles[:, :2], np.zeros(len(self.circles))])
        centres_in_target_frame = np.einsum("nij,qkjl,nl->qkni", R, rotations, centres_in_sensor)
        rhs = -(self.flanges.origins + centres_in_target_frame).reshape(
            -1, len(centres_in_sensor), 3
        )
        solution = solve_masked_least_squares(design, rhs, np.repeat(masks, count, axis=0))
        groups = int(self.groups.max()) + 1
        radius = (
            self.radius_prior[0] if np.isfinite(self.radius_prior[1]) else self.circles[:, 2].max()
        )
        centres = solution[:, 3:].reshape(-1, groups, 3)
        sizes = np.broadcast_to([radius, 0.0], (*centres.shape[:2], 2))
        targets = np.concatenate([centres, sizes], axis=-1)
        return States(rotations.reshape(-1, 3, 3), solution[:, :3], targets)

    def _build_centre_columns(self) -> list[FloatArray]:
        """Return the columns (n, 3, 3) of the design matrix for the centre of each sphere."""
        groups = range(int(self.groups.max()) + 1)
        return [-np.eye(3) * (self.groups == group)[:, None, None] for group in groups]


def require_distinct_cuts(circles: FloatArray, radius: float | None) -> None:
    """Require cuts off the sphere's centre, and at different positions in the view.

    `circles` (n, 3) are centre x, y and radius of each cut, section frame; without the `radius` of
    the sphere that of the largest circle is used. Units: mm.

    Raises
    ------
    CalibrationFailed
        If the given radius is so small that the cuts seem to pass the centre, or far larger than
        all cuts.
    DegenerateGeometry
        If all cuts pass near the centre, or the sphere is at one position in all profiles.
    """
    measured = float(circles[:, 2].max())
    largest = measured if radius is None else radius
    offset = float(np.sqrt(np.mean(np.clip(1 - (circles[:, 2] / largest) ** 2, 0, None))))
    too_small = offset < MIN_RMS_OFFSET_RATIO and measured > MAX_RADIUS_RATIO * largest
    if too_small or measured < MIN_RADIUS_RATIO * largest:
        raise CalibrationFailed(
            f"cuts of the sphere have radii of up to {measured:.4g} mm, "
            f"{'more' if too_small else 'far less'} than the given radius of {largest:g} mm: check "
            "it, or leave it out to have it estimated"
        )
    if offset < MIN_RMS_OFFSET_RATIO:
        raise DegenerateGeometry(
            f"the cuts pass the sphere's centre at {offset:.2f} radii (rms): the sensor's pose "
            "across its laser plane is not determined; add poses that cut the sphere 0.3 to 0.85 "
            "radii beside its centre, on both sides"
        )
    spread = float(np.linalg.norm(np.ptp(circles[:, :2], axis=0)))
    if spread < MIN_SPREAD_RATIO * largest:
        raise DegenerateGeometry(
            f"the sphere is at the same position in all profiles (to {spread:.2g} mm): "
            "only the cuts determine the sensor's rotation; add poses with the sphere left, "
            "right, near and far in the view"
        )


@dataclass(frozen=True, eq=False)
class SpherePlanningTarget:
    """Sphere to be cut in planned poses.

    Parameters
    ----------
    centre : (3,) ndarray
        Centre of the sphere in the base frame. Units: mm.
    radius : float
        Radius of the sphere. Units: mm.
    circle_std : float
        Standard deviation of a circle's centre along X; along Y and in radius three times that.
        Units: mm.
    max_cut_offset : float
        Largest distance of a proposed cut from the centre, in radii; given poses may cut up to
        `MAX_CUT_OFFSET`.
    """

    centre: FloatArray
    radius: float
    circle_std: float
    max_cut_offset: float

    @property
    def requirement(self) -> str:
        """Requirement on a pose, for an error message."""
        return "cut the sphere"

    @property
    def viewing_rotation(self) -> FloatArray:
        """Rotation from the base's Z to the direction towards the sensor: identity, from above."""
        return np.eye(3)

    @property
    def max_plane_offset(self) -> float:
        """Largest useful distance of the laser plane from the centre. Units: mm."""
        return self.max_cut_offset * self.radius

    @property
    def state(self) -> FloatArray:
        """Centre and radius (mm, base frame) and error of the height scale, (5,)."""
        return np.array([*self.centre, self.radius, 0.0])

    @property
    def prior_std(self) -> tuple[float, ...]:
        """Prior standard deviation of centre and radius (mm) and of the height scale."""
        return (1000.0, 1000.0, 1000.0, 10.0, HEIGHT_SCALE_PRIOR_STD)

    def check_visibility(self, sections: Sequence[Pose]) -> tuple[FloatArray, BoolArray]:
        """Return the centre in each section frame, and whether the cut is large enough."""
        centres_in_sections = np.array([pose.inverse().apply_one(self.centre) for pose in sections])
        centres_in_sections = centres_in_sections.reshape(-1, 3)
        return centres_in_sections, np.abs(centres_in_sections[:, 2]) < MAX_CUT_OFFSET * self.radius

    def predict_observations(
        self, positions: FloatArray, sections: Sequence[Pose], flanges: FlangePoses
    ) -> SphereObservations:
        """Return the circles of the cuts without noise."""
        count = len(sections)
        # Positive also where the laser plane misses the sphere; such poses are not used.
        min_squared_radius = (0.1 * self.radius) ** 2
        circle_radii = np.sqrt(
            np.maximum(self.radius**2 - positions[:, 2] ** 2, min_squared_radius)
        )
        return SphereObservations(
            np.column_stack([positions[:, :2], circle_radii]),
            np.tile(np.diag(self.circle_std**2 * np.array([1.0, 9.0, 9.0])), (count, 1, 1)),
            _predict_height_scale_gradients(positions[:, 1], circle_radii),
            flanges,
            (self.radius, np.inf),
            np.zeros(count, dtype=np.int64),
        )


def _predict_height_scale_gradients(heights: FloatArray, circle_radii: FloatArray) -> FloatArray:
    """Return `SphereObservations.height_scale_gradients` of arcs over `PLANNED_ARC_ANGLES`."""
    # Points r (sin, cos) whose heights grow by s move outwards by s r cos^2; a circle that
    # shifts in y and grows moves its points outwards by y cos + r.
    design = np.column_stack([np.cos(PLANNED_ARC_ANGLES), np.ones(len(PLANNED_ARC_ANGLES))])
    shift, growth = np.linalg.lstsq(design, np.cos(PLANNED_ARC_ANGLES) ** 2, rcond=None)[0]
    gradients = np.zeros((len(circle_radii), 2, 3))
    gradients[:, 0, 1] = shift * circle_radii + heights - heights.mean()
    gradients[:, 0, 2] = growth * circle_radii
    return gradients
