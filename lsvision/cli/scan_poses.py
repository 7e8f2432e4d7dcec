"""Where each section of a scan stands: an encoder axis, or a robot's poses."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lsvision.errors import LsvisionError, UnreadableFile

if TYPE_CHECKING:
    from lsvision.shapes import Pose


@dataclass(frozen=True)
class Encoder:
    """``--feed`` and ``--step``."""

    direction: tuple[float, float, float]
    step: float


@dataclass(frozen=True)
class Robot:
    """``--poses``, ``--convention`` and ``--flange-from-section``."""

    path: Path
    convention: str
    hand_eye: Path | None


def pose_options(
    feed: str | None,
    step: float | None,
    poses: Path | None,
    convention: str | None,
    hand_eye: Path | None,
) -> Encoder | Robot:
    """What the options say of the motion.

    Raises
    ------
    typer.BadParameter
        If they say too little, both ways at once, or numbers that are none.
    """
    if poses is not None:
        if feed is not None or step is not None:
            raise typer.BadParameter("want --feed with --step, or --poses, got both")
        return _robot(poses, convention, hand_eye)
    if convention is not None or hand_eye is not None:
        raise typer.BadParameter("want --poses beside --convention and --flange-from-section")
    if feed is None or step is None:
        raise typer.BadParameter(
            "want --feed X,Y,Z and --step MM, or --poses F and --convention NAME: without "
            "poses sections cannot be joined"
        )
    if not (math.isfinite(step) and step != 0):
        raise typer.BadParameter(f"want --step in mm other than 0, got {step:g}")
    return Encoder(_direction(feed), step)


def scan_poses(motion: Encoder | Robot, count: int) -> "list[Pose]":
    """``base_from_section`` of each profile.

    Parameters
    ----------
    motion : Encoder or Robot
        From `pose_options`.
    count : int
        Number of profiles.

    Raises
    ------
    LsvisionError
        If a file cannot be read, or there are not as many poses as profiles.
    """
    from lsvision.io.robot_poses import encoder_poses, read_robot_poses

    if isinstance(motion, Encoder):
        return encoder_poses(count, motion.direction, motion.step)
    flanges = read_robot_poses(motion.path, motion.convention)
    if len(flanges) != count:
        raise UnreadableFile(
            f"{motion.path}: want one pose a profile, got {len(flanges)} poses for {count} "
            "profiles: leave out what has no partner"
        )
    if motion.hand_eye is None:
        return flanges
    flange_from_section = _flange_from_section(motion.hand_eye)
    return [base_from_flange @ flange_from_section for base_from_flange in flanges]


def _robot(poses: Path, convention: str | None, hand_eye: Path | None) -> Robot:
    from lsvision.io.robot_conventions import CONVENTIONS

    if convention not in CONVENTIONS:
        raise typer.BadParameter(
            f"want --convention {', '.join(CONVENTIONS)} beside --poses, got {convention}"
        )
    return Robot(poses, convention, hand_eye)


def _direction(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"want --feed X,Y,Z, as 0,0,1, got {text!r}") from None
    if not 0 < math.hypot(x, y, z) < math.inf:
        raise typer.BadParameter(f"want a --feed with a length, got {text!r}")
    return x, y, z


def _flange_from_section(path: Path) -> "Pose":
    from lsvision.io.hand_eye_file import load_hand_eye

    try:
        return load_hand_eye(path).flange_from_section
    except (AttributeError, ValueError) as error:
        raise LsvisionError(f"{path}: {error}") from error
