"""Orientation of boards that look the same after a turn, resolved by the robot's poses.

An image does not show from which end such a board is numbered. The robot's poses do: the relative
rotation of two boards in the camera has the angle of the relative rotation of the flange, whatever
the pose of the camera on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.rotations import build_cross_matrices, vectors_from_rotations
from lsvision.calibration.target import Chessboard, CircleGrid, Target
from lsvision.errors import CalibrationFailed
from lsvision.geometry import FloatArray, IntArray, Pose

MAX_ANGLE_DIFFERENCE = np.radians(10.0)
"""Limit to which differences of two angles are clipped, so that a wrong pose has limited influence.
Units: rad."""
MIN_MARGIN = np.radians(2.0)
"""Smallest amount by which the mean angle difference of every other turn of a view must be larger;
errors of robots and boards are tenths of a degree. Units: rad."""
MAX_SWEEPS = 20
"""Maximum number of sweeps over the views; two or three are needed."""


def list_pattern_turns(target: Target) -> tuple[Pose, ...]:
    """Return the turns of a board after which its pattern looks the same.

    ``board_from_turned`` about the middle of the board: half a turn, or a quarter, half and three
    quarters of a turn; empty for a board that has one orientation only.

    Examples
    --------
    >>> [len(list_pattern_turns(Chessboard(columns, 7, 10.0))) for columns in (6, 9)]
    [0, 1]
    """
    match target:
        case Chessboard():
            is_unique = (target.columns + target.rows) % 2 == 1
            # With an odd number of corners per side, a quarter of a turn swaps black and white.
            has_quarters = target.columns == target.rows and target.columns % 2 == 0
        case CircleGrid():
            is_unique, has_quarters = target.asymmetric, target.columns == target.rows
        case _:
            is_unique, has_quarters = True, False
    if is_unique:
        return ()
    middle = (target.points.min(axis=0) + target.points.max(axis=0)) / 2
    angles_deg = (90, 180, 270) if has_quarters else (180,)
    return tuple(_turn_about(middle, angle_deg) for angle_deg in angles_deg)


def _turn_about(middle: FloatArray, angle_deg: float) -> Pose:
    """Return the turn about the normal through a point of the board, by a multiple of 90 deg."""
    cos, sin = np.round(np.cos(np.radians(angle_deg))), np.round(np.sin(np.radians(angle_deg)))
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    return Pose(rotation, middle - rotation @ middle)


@dataclass(frozen=True, eq=False)
class TurnedBoards:
    """Board poses of n views, numbered from the same end.

    Parameters
    ----------
    poses : tuple of Pose
        ``camera_from_board`` of each view.
    jacobians : (n, 6, 6) ndarray
        Derivatives of `poses` by the original poses: origin (mm), left perturbation (rad).
    turned : tuple of int
        Indices of the views that were numbered from another end than most.
    """

    poses: tuple[Pose, ...]
    jacobians: FloatArray
    turned: tuple[int, ...]

    def covariances(self, original: FloatArray) -> FloatArray:
        """Return the covariances (n, 6, 6) of `poses` from those of the original poses."""
        return self.jacobians @ original @ np.swapaxes(self.jacobians, 1, 2)

    def compute_shifts(self, original: FloatArray) -> FloatArray:
        """Return shifts (m, n, 6) of `poses`, by m errors, from those of the original poses."""
        shifts: FloatArray = np.einsum("nij,mnj->mni", self.jacobians, original)
        return shifts

    @property
    def warning(self) -> str:
        """Warning that the board looks the same after a turn, with the views that were turned."""
        finding = "the robot's poses show that all views are numbered from the same end"
        if self.turned:
            names = ", ".join(f"pose {index}" for index in self.turned)
            finding = (
                f"the robot's poses show that {names} are numbered from another end; corrected"
            )
        return (
            f"the board looks the same after a turn: {finding}; a board with one even and one odd "
            "count of inner corners needs no such check"
        )


def turn_boards(
    camera_from_boards: Sequence[Pose], flanges: Sequence[Pose], turns: Sequence[Pose]
) -> TurnedBoards:
    """Return the board poses of all views, numbered from the same end by the robot's poses.

    The boards are numbered from either end; `flanges` are ``base_from_flange`` of each view, the
    inverse where the board is on the flange, and `turns` those of `list_pattern_turns`. Fewer than
    two views are returned as they are.

    Raises
    ------
    CalibrationFailed
        If the poses do not determine the numbering of a view.
    ValueError
        If there are not as many boards as flanges.
    """
    if len(camera_from_boards) != len(flanges):
        raise ValueError(
            f"expected as many boards as flanges, got {len(camera_from_boards)} and {len(flanges)}"
        )
    if len(flanges) < 2:
        return TurnedBoards(tuple(camera_from_boards), np.tile(np.eye(6), (len(flanges), 1, 1)), ())
    group = [Pose(), *turns]
    costs = _subtract_angles(camera_from_boards, flanges, group)
    # The label of a view is the index of its turn in the group. Each view in turn is the one from
    # which the initial labels of the others follow.
    views = np.arange(len(flanges))
    labels = min(
        (_find_consistent_labels(costs, costs[view].argmin(axis=1)) for view in views),
        key=lambda labels: _compute_label_costs(costs, labels)[views, labels].sum(),
    )
    _require_certain(costs, labels)
    # The turns are a cyclic group, in the order of their angles.
    labels = (labels - int(np.bincount(labels).argmax())) % len(group)
    poses, jacobians = [], []
    for pose, label in zip(camera_from_boards, labels, strict=True):
        poses.append(pose @ group[label])
        lever_arm = pose.rotation @ group[label].translation
        jacobian = np.eye(6)
        jacobian[:3, 3:] = -build_cross_matrices(lever_arm)
        jacobians.append(jacobian)
    return TurnedBoards(tuple(poses), np.array(jacobians), tuple(np.flatnonzero(labels).tolist()))


def _subtract_angles(
    boards: Sequence[Pose], flanges: Sequence[Pose], group: Sequence[Pose]
) -> FloatArray:
    """Return the clipped differences (n, n, g) of two angles between views i and j. Units: rad.

    One is the angle by which the flange rotates between the views, the other that by which the
    board does if it is turned in view j by the g-th turn relative to view i.
    """
    board = np.array([pose.rotation for pose in boards])
    flange = np.array([pose.rotation for pose in flanges])
    flange_angles = _angles(np.einsum("iba,jbc->ijac", flange, flange))
    turned = np.einsum("jab,gbc->jgac", board, np.array([turn.rotation for turn in group]))
    board_angles = _angles(np.einsum("iab,jgcb->ijgac", board, turned))
    differences = np.minimum(np.abs(board_angles - flange_angles[:, :, None]), MAX_ANGLE_DIFFERENCE)
    diagonal = np.arange(len(board))
    differences[diagonal, diagonal] = 0.0
    return differences


def _angles(rotations: FloatArray) -> FloatArray:
    """Return the angles of rotations (..., 3, 3). Units: rad."""
    angles: FloatArray = np.linalg.norm(vectors_from_rotations(rotations), axis=-1)
    return angles


def _compute_label_costs(costs: FloatArray, labels: IntArray) -> FloatArray:
    """Return the mean cost (n, g) of each turn of each view, the others turned by `labels`."""
    count, _, size = costs.shape
    others = np.arange(count)
    sums = [
        [costs[others, view, (turn - labels) % size].sum() for turn in range(size)]
        for view in range(count)
    ]
    mean_costs: FloatArray = np.array(sums) / (count - 1)  # the cost of a view with itself is 0
    return mean_costs


def _find_consistent_labels(costs: FloatArray, labels: IntArray) -> IntArray:
    """Return the turns after sweeps in which each view takes the turn that fits the others."""
    for _ in range(MAX_SWEEPS):
        previous = labels.copy()
        for view in range(len(labels)):
            labels[view] = _compute_label_costs(costs, labels)[view].argmin()
        if np.array_equal(previous, labels):
            break
    return labels


def _require_certain(costs: FloatArray, labels: IntArray) -> None:
    """Raise an error unless every other turn of every view fits worse by `MIN_MARGIN`."""
    label_costs, views = _compute_label_costs(costs, labels), np.arange(len(labels))
    selected_costs = label_costs[views, labels]
    label_costs[views, labels] = np.inf
    margins = label_costs.min(axis=1) - selected_costs
    if margins.min() < MIN_MARGIN:
        raise CalibrationFailed(
            f"pose {int(margins.argmin())}: the board looks the same after a turn, and the robot's "
            "poses do not determine its orientation (the best two differ by "
            f"{np.degrees(margins.min()):.1f} deg): use a board with one even and one odd count of "
            "inner corners, or a ChArUco board, or take poses with larger tilts"
        )
