"""Pairs of a robot pose and an observation, of which a hand-eye calibration is made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy.typing as npt

from lsvision.calibration.observations import RejectedPose
from lsvision.calibration.plane_line import PlaneLine
from lsvision.calibration.sphere_arc import SphereArc
from lsvision.calibration.views import find_repeated
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.geometry import FloatArray, Pose
from lsvision.profile import Profile, as_profile
from lsvision.results.summaries import format_count

Shape = TypeVar("Shape", SphereArc, PlaneLine)


def require_pairs(observations: int, poses: int, name: str) -> None:
    """Require one pose for each observation."""
    if observations != poses:
        raise ValueError(
            f"expected one pose for each of the {name}, got {observations} {name} and {poses} "
            "poses: a missing pair may shift all pairs that follow it"
        )


def require_pose_count(
    count: int, min_count: int, observation: str, unobserved: list[RejectedPose]
) -> None:
    """Require a number of poses with an observation."""
    if count < min_count:
        reasons = [f" (pose {pose.index}: {pose.reason})" for pose in unobserved[:1]]
        show = "shows" if count == 1 else "show"
        raise CalibrationFailed(
            f"{format_count(count, 'pose')} {show} {observation} and {min_count} are needed, "
            f"better 12: take more{''.join(reasons)}"
        )


def find_shapes(
    profiles: Sequence[Profile | npt.ArrayLike],
    flanges: Sequence[Pose],
    find: Callable[[Profile], Shape],
    name: str,
) -> tuple[list[Shape], list[int], list[RejectedPose]]:
    """Return the shapes found, the indices of their profiles, and the profiles without one.

    A pair that is stored twice counts once. `name` is that of the shape in messages.
    """
    shapes, observed, unobserved = [], [], []
    checked = [as_profile(profile) for profile in profiles]
    repeated = find_repeated_pairs([profile.points for profile in checked], flanges)
    for index, profile in enumerate(checked):
        if index in repeated:
            unobserved.append(reject_repeated_pose(index, repeated[index], "profile"))
            continue
        try:
            shapes.append(find(profile))
            observed.append(index)
        except LsvisionError as error:
            unobserved.append(RejectedPose(index, f"no {name} found: {error}"))
    return shapes, observed, unobserved


def find_repeated_pairs(observed: Sequence[FloatArray], flanges: Sequence[Pose]) -> dict[int, int]:
    """Return the index of each pair that equals an earlier one, with the earlier index."""
    pairs = zip(observed, flanges, strict=True)
    return find_repeated(values.tobytes() + flange.matrix.tobytes() for values, flange in pairs)


def reject_repeated_pose(index: int, earlier: int, observation: str) -> RejectedPose:
    """Return a pose, with the reason, that is stored twice with its `observation`."""
    return RejectedPose(index, f"the same pose and {observation} as pose {earlier}, stored twice")
