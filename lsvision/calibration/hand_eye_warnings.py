"""Warnings about a hand-eye calibration: residuals, heights of the sensor, size of the board."""

import math

Scale = tuple[float, float]
"""Factor and its standard deviation."""

LARGE_RESIDUAL_MM = 3.0
"""Root mean square residual above which a warning is given. Units: mm."""
SCALE_SIGMAS = 4.0
"""Standard deviations from 1 above which a scale is significant."""
MIN_HEIGHT_SCALE_ERROR = 0.005
"""Deviation of the height scale from 1 above which a warning is given."""
MIN_BOARD_SCALE_ERROR = 0.003
"""Deviation of a board's scale from 1 above which a warning is given; the error of a camera's
focal length may be as large."""


def hand_eye_warnings(
    residual_rms: float,
    robot_std: tuple[float, float],
    height_scale: Scale | None,
    target_scale: Scale | None,
    *,
    radius_is_given: bool,
) -> tuple[str, ...]:
    """Return the warnings about a calibration, with numbers and remedy; empty for a good one.

    See `HandEye` for the parameters; `radius_is_given` is that of a sphere.
    """
    warnings = []
    if residual_rms > LARGE_RESIDUAL_MM:
        warnings.append(_describe_residuals(residual_rms, robot_std))
    if height_scale and is_wrong_scale(height_scale, MIN_HEIGHT_SCALE_ERROR):
        warnings.append(_describe_height_scale(height_scale, radius_is_given=radius_is_given))
    if target_scale and is_wrong_scale(target_scale, MIN_BOARD_SCALE_ERROR):
        warnings.append(describe_board_scale(target_scale))
    return tuple(warnings)


def is_wrong_scale(scale: Scale, min_error: float) -> bool:
    """Return whether a scale, with its standard deviation, differs from 1 significantly."""
    factor, std = scale
    return abs(factor - 1) >= max(SCALE_SIGMAS * std, min_error)


def describe_board_scale(scale: Scale) -> str:
    """Return the message on a board whose size was stated wrong, with the remedy.

    Examples
    --------
    >>> describe_board_scale((0.99, 0.0004)).split(":")[0]
    "by the robot's motion the size of the board must be multiplied by 0.9900 +/- 0.0004"
    """
    factor, std = scale
    return (
        "by the robot's motion the size of the board must be multiplied by "
        f"{factor:.4f} +/- {std:.4f}: measure its squares, and give the same size here and to the "
        "calibration of the camera"
    )


def _describe_residuals(residual_rms: float, robot_std: tuple[float, float]) -> str:
    position, rotation = robot_std
    return (
        f"the residuals are {residual_rms:.2g} mm rms, as with a robot of {position:.2g} mm and "
        f"{math.degrees(rotation):.2g} deg per axis: if the robot is more accurate, check the size "
        "of the target, the convention of the poses, and that the robot stood still"
    )


def _describe_height_scale(scale: Scale, *, radius_is_given: bool) -> str:
    factor, std = scale
    radius = "the given radius (calibrate without it, it is estimated then), " * radius_is_given
    return (
        f"the sensor's heights must be multiplied by {factor:.3f} +/- {std:.3f}: check {radius}"
        "their unit and the sensor's own calibration; away from the working point, positions and "
        "radii have the same relative error"
    )
