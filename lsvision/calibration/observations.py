"""What every kind of target must say of what the poses showed of it.

Each kind (`sphere_observations`, `plane_observations`, `board_observations`) reduces what a pose
shows to a few numbers with a covariance and says how those would change with the sensor's pose,
the target and the robot's own pose; `batched_least_squares`, `errors_in_variables` and
`pose_outliers` work on any of them.
"""

from dataclasses import dataclass
from typing import Protocol, Self

from lsvision.geometry import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FlangePoses:
    """Flange poses as stacks, with the covariance a unit robot error gives each.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
        Mount (the frame that carries the sensor) to the target's frame.
    origins : (n, 3) ndarray
        Units: mm.
    covariances : (n, 6, 6) ndarray
        Of translation (mm) and left-hand rotation (rad), for the stated or nominal robot.
    """

    rotations: FloatArray
    origins: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.origins)

    def select(self, order: IntArray) -> "FlangePoses":
        """The poses in another order, or a part of them."""
        return FlangePoses(self.rotations[order], self.origins[order], self.covariances[order])


@dataclass(frozen=True, eq=False)
class States:
    """Sensor poses and targets, one a start.

    Parameters
    ----------
    rotations : (s, 3, 3) ndarray
        Sensor to mount.
    translations : (s, 3) ndarray
        Sensor's origin in the mount frame. Units: mm.
    targets : (s, g, k) ndarray
        What each kind of sighting keeps of its target; `g` targets, one but for a diagnosis.
    """

    rotations: FloatArray
    translations: FloatArray
    targets: FloatArray

    def __len__(self) -> int:
        return len(self.translations)

    def select(self, order: IntArray) -> "States":
        """The starts in another order, or a part of them."""
        return States(self.rotations[order], self.translations[order], self.targets[order])


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals (seen minus expected) of s starts and n poses, and their derivatives.

    Parameters
    ----------
    residuals : (s, n, m) ndarray
        In the sighting's own units.
    mount_jacobian : (s, n, m, 6) ndarray
        By the sensor's translation (mm) and left-hand rotation (rad) in the mount frame.
    target_jacobian : (s, n, m, d) ndarray
        By the step of `Observations.update_targets`.
    flange_jacobian : (s, n, m, 6) ndarray
        By the flange's translation and left-hand rotation.
    """

    residuals: FloatArray
    mount_jacobian: FloatArray
    target_jacobian: FloatArray
    flange_jacobian: FloatArray


class Observations(Protocol):
    """What all poses showed of one kind of target."""

    @property
    def flanges(self) -> FlangePoses:
        """Where the flange stood at each sighting."""
        ...

    @property
    def groups(self) -> IntArray:
        """(n,) which target each pose saw; all 0 unless a moved target is suspected."""
        ...

    @property
    def covariances(self) -> FloatArray:
        """(n, m, m) of what was seen."""
        ...

    @property
    def mm_per_residual(self) -> FloatArray:
        """(m,) factors that make millimetres of the residuals."""
        ...

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Value and one sigma of each of the target's d steps' coordinates; inf = free."""
        ...

    def linearise(self, states: States) -> Linearisation:
        """Residuals and derivatives."""
        ...

    def update_targets(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Targets (s, g, k) after steps (s, g, d)."""
        ...

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """(s, g, d) target minus prior."""
        ...

    def target_distance(self, first: FloatArray, second: FloatArray) -> float:
        """How far two targets (k,) are apart. Units: mm."""
        ...

    def initial_guesses(self, masks: FloatArray) -> States:
        """Starts without any guess, a fixed number for each of (q, n) selections of poses."""
        ...

    def with_groups(self, groups: IntArray) -> Self:
        """The same sightings, of several targets."""
        ...

    def with_flange_poses(self, flanges: FlangePoses) -> Self:
        """The same sightings, had the flange stood elsewhere."""
        ...
