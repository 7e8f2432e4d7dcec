"""What every kind of target must say of what the poses showed of it.

Each kind (`sphere_poses`, `plane_poses`, `board_poses`) reduces what a pose shows to a few
numbers with a covariance and says how those would change with the sensor's pose, the target
and the robot's own pose; `adjustment`, `noisy_poses` and `pose_outliers` work on any of them.
"""

from dataclasses import dataclass
from typing import Protocol, Self

from lsvision.shapes import FloatArray, IntArray


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

    def taken(self, order: IntArray) -> "FlangePoses":
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

    def taken(self, order: IntArray) -> "States":
        """The starts in another order, or a part of them."""
        return States(self.rotations[order], self.translations[order], self.targets[order])


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals (seen minus expected) of s starts and n poses, and their derivatives.

    Parameters
    ----------
    residuals : (s, n, m) ndarray
        In the sighting's own units.
    by_mount : (s, n, m, 6) ndarray
        By the sensor's translation (mm) and left-hand rotation (rad) in the mount frame.
    by_target : (s, n, m, d) ndarray
        By the step of `Sightings.moved`.
    by_flange : (s, n, m, 6) ndarray
        By the flange's translation and left-hand rotation.
    """

    residuals: FloatArray
    by_mount: FloatArray
    by_target: FloatArray
    by_flange: FloatArray


class Sightings(Protocol):
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
    def levers(self) -> FloatArray:
        """(m,) factors that make millimetres of the residuals."""
        ...

    @property
    def target_prior(self) -> tuple[FloatArray, FloatArray]:
        """Value and one sigma of each of the target's d steps' coordinates; inf = free."""
        ...

    def linearised(self, states: States) -> Linearised:
        """Residuals and derivatives."""
        ...

    def moved(self, targets: FloatArray, steps: FloatArray) -> FloatArray:
        """Targets (s, g, k) after steps (s, g, d)."""
        ...

    def prior_residuals(self, targets: FloatArray) -> FloatArray:
        """(s, g, d) target minus prior."""
        ...

    def apart(self, first: FloatArray, second: FloatArray) -> float:
        """How far two targets (k,) are apart. Units: mm."""
        ...

    def starts(self, masks: FloatArray) -> States:
        """Starts without any guess, a fixed number for each of (q, n) selections of poses."""
        ...

    def regrouped(self, groups: IntArray) -> Self:
        """The same sightings, of several targets."""
        ...

    def with_flanges(self, flanges: FlangePoses) -> Self:
        """The same sightings, had the flange stood elsewhere."""
        ...
