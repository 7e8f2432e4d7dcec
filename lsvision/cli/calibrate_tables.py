"""Calibrations as text: each number with its sigma, and what was left out with its reason."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.cli.calibrate_inputs import replace_image_numbers
from lsvision.results.tables import text_table

if TYPE_CHECKING:
    from lsvision.calibration.hand_eye_result import HandEye
    from lsvision.calibration.pose_planning import PosePlan
    from lsvision.calibration.result_tables import Row
    from lsvision.calibration.views import RejectedView


def pose_rows(found: "HandEye", names: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Each pose: name, residual, held-out residual, whether it was left out."""
    left_out = {pose.index for pose in found.rejected}
    return [
        (name, _mm(residual), _mm(held_out), "left out" if index in left_out else "")
        for index, (name, residual, held_out) in enumerate(
            zip(names, found.residuals, found.leave_one_out_residuals, strict=True)
        )
    ]


def plan_rows(plan: "PosePlan") -> list[tuple[str, ...]]:
    """Each proposed pose with the accuracy it promises."""
    return [
        (str(number), *(f"{value:.1f}" for value in pose.translation), f"{std:.4f}")
        for number, (pose, std) in enumerate(
            zip(plan.base_from_flanges, plan.predicted_std, strict=True), start=1
        )
    ]


def value_lines(rows: "Sequence[Row]") -> list[str]:
    """Return names and values as lines, with the unit after each value."""
    return text_table([(name, f"{value} {unit}") for name, value, unit in rows], left=2)


def warning_lines(
    names: Sequence[str],
    rejected: "Sequence[RejectedView]",
    outliers: "Sequence[RejectedView]",
    warnings: Sequence[str],
) -> list[str]:
    """What was left out, what fits badly, and what makes the set weak; each by name."""
    lines = [f"left out: {names[view.index]}: {view.reason}" for view in rejected]
    lines += [f"fits badly: {names[view.index]}: {view.reason}" for view in outliers]
    return lines + [f"warning: {replace_image_numbers(text, image=names)}" for text in warnings]


def _mm(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"
