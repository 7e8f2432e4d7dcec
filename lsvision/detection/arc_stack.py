"""Stack of identified arcs: both ends and the middle part of each, padded to arrays.

The middle part determines an ellipse with which accurate screening compares the points at the ends
(paper section 3.2.2).
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lsvision.detection.arcs import MIN_POINTS, IdentifiedArc
from lsvision.detection.end_points import POINTS_BEYOND, PREDECESSORS
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.geometry.arrays import pad_rows, stack_padded, stack_with_mask
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

MIDDLE_FRACTION = 0.7
"""Fraction of the arc's points in its middle part, which determines the screening ellipse. With 0.5
three of 1345 pipes are lost; with 0.98 points of the surfaces beside a pipe are part of it, and
93.3 instead of 93.8 % of the 95 % intervals contain the radius."""
MAX_END_POINTS = 100
"""Largest number of the arc's points at an end: the computing time of the Kalman filter (see
`lsvision.detection.end_points`) increases with the cube of this number."""


class SplitArc(NamedTuple):
    """Arc split into its middle part, and the points on both sides of it.

    Parameters
    ----------
    number : int
        Position of the arc among those that are screened together.
    profile : PreparedProfile
        Profile of the arc.
    ellipse : Ellipse
        Ellipse of the identified arc. Units: mm, rad.
    middle : (j,) int ndarray
        Indices of the middle part, ascending.
    ends : pair of (m + 2,) int ndarray
        Indices of the outermost two points of the middle part, then of the m points beyond them,
        outwards; m differs between the ends.
    members : pair of (m,) bool ndarray
        Which of these m points belong to the identified arc.
    """

    number: int
    profile: PreparedProfile
    ellipse: Ellipse
    middle: IntArray
    ends: tuple[IntArray, IntArray]
    members: tuple[BoolArray, BoolArray]

    def may_continue(self, members: BoolArray) -> bool:
        """Return whether the outermost point of an end is an inlier, and the profile continues.

        `members` (2, m) are the masks of the inliers of both ends, which may be padded. False
        unless the ends have more inliers than points of the identified arc.
        """
        if np.count_nonzero(members) <= sum(map(np.count_nonzero, self.members)):
            return False
        last = len(self.profile.points) - 1
        return any(
            count > 0 and end[-1] not in (0, last) and bool(mask[count - 1])
            for end, mask, count in zip(self.ends, members, map(len, self.members), strict=True)
        )


class ArcStack(NamedTuple):
    """Points of k arcs, one arc per row: those of both ends, outwards, then the middle part.

    Parameters
    ----------
    arcs : list of SplitArc
        The arcs.
    indices : (k, n) int ndarray
        Indices of the points in the profile of the arc.
    points : NoisyPoints
        Points (k, n); shorter ends and middle parts are padded with their last point. Units: mm.
    ends_valid : (k, 2, m + 2) bool ndarray
        False for the padding of the ends.
    middle_valid : (k, j) bool ndarray or None
        False for the padding of the middle parts; None if there is no padding.
    members : (k, 2, m) bool ndarray
        Inliers of both ends so far, among the m points beyond the two of the middle part.
    parameters : (k, 5) ndarray
        Ellipses of the arcs. Units: mm.
    end_size : int
        Number of columns of an end, m + 2.
    """

    arcs: list[SplitArc]
    indices: IntArray
    points: NoisyPoints
    ends_valid: BoolArray
    middle_valid: BoolArray | None
    members: BoolArray
    parameters: FloatArray
    end_size: int

    @classmethod
    def of(cls, arcs: list[SplitArc]) -> "ArcStack":
        """Return the stack of one or more arcs."""
        count = len(arcs)
        all_ends = [end for arc in arcs for end in arc.ends]
        positions, ends_valid = pad_rows(list(map(len, all_ends)))
        ends = stack_padded(all_ends, positions)
        middles, middle_valid = stack_with_mask([arc.middle for arc in arcs])
        end_size = ends.shape[1]
        members = np.zeros((2 * count, end_size - PREDECESSORS), dtype=bool)
        for row, mask in zip(members, (m for arc in arcs for m in arc.members), strict=True):
            row[: len(mask)] = mask
        indices = np.concatenate([ends.reshape(count, -1), middles], axis=1)
        pairs = zip(arcs, indices, strict=True)
        points, _ = NoisyPoints.stack([arc.profile.noisy_points[row] for arc, row in pairs])
        parameters = np.array([parameters_from_ellipse(arc.ellipse) for arc in arcs])
        masks = ends_valid.reshape(count, 2, -1), middle_valid, members.reshape(count, 2, -1)
        return cls(arcs, indices, points, *masks, parameters, end_size)

    @property
    def middle(self) -> slice:
        """Columns of the middle part."""
        return slice(2 * self.end_size, None)

    def take_ends(self, columns: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the ends of (k, n) or (k, j, n) values, as (k, 2, m + 2) or (k, 2, j, m + 2)."""
        size = self.end_size
        ends = columns[..., : 2 * size].reshape(*columns.shape[:-1], 2, size)
        return ends.swapaxes(1, -2)  # without effect on (k, 2, m + 2)

    def select_inliers(self, arc: int, members: BoolArray) -> tuple[IntArray, NoisyPoints]:
        """Return the indices and points of an arc's middle part and of the inliers of its ends.

        `arc` is the row of the arc, `members` (2, m) are the masks of the inliers of both ends. The
        indices (j,) are ascending.
        """
        first, second = (mask.nonzero()[0] + PREDECESSORS for mask in members)
        middle = self.middle.start + np.arange(len(self.arcs[arc].middle))
        columns = np.concatenate([first[::-1], middle, second + self.end_size])
        return self.indices[arc][columns], self.points[arc, columns]


def split_arc(number: int, profile: PreparedProfile, arc: IdentifiedArc) -> SplitArc | None:
    """Split an arc into middle part and ends; None if the middle has fewer than `MIN_POINTS`."""
    count = len(arc.indices)
    size = min(max(2, round((1 - MIDDLE_FRACTION) / 2 * count)), MAX_END_POINTS)
    middle = arc.indices[size : count - size]
    if len(middle) < MIN_POINTS:
        return None
    first, last = int(middle[0]), int(middle[-1])
    span = arc.arc
    begin = max(0, span.start - POINTS_BEYOND)
    stop = min(span.stop + POINTS_BEYOND, len(profile.points))
    left, right = np.arange(first - 1, begin - 1, -1), np.arange(last + 1, stop)
    members = np.zeros(len(left), dtype=bool), np.zeros(len(right), dtype=bool)
    # Positions of the arc's points among those of each end, outwards from the middle part.
    members[0][first - 1 - arc.indices[:size]] = True
    members[1][arc.indices[count - size :] - (last + 1)] = True
    ends = (
        np.concatenate([middle[:PREDECESSORS][::-1], left]),
        np.concatenate([middle[-PREDECESSORS:], right]),
    )
    return SplitArc(number, profile, arc.ellipse, middle, ends, members)
