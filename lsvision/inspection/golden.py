"""Golden part: a reference part that must be measured correctly before other parts are judged."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

from lsvision.errors import LsvisionError
from lsvision.inspection.decision import Decision, decide, widen_interval
from lsvision.inspection.job import Job
from lsvision.inspection.job_tables import Golden
from lsvision.inspection.relate import MeasuredCylinder
from lsvision.results.quantities import Record

LOG_SUFFIX = ".golden.jsonl"
"""Suffix of the log's default name, after that of the job file."""

Calibration = Mapping[str, Mapping[str, str | None]]
"""Date and hash of each calibration file, by its key in ``[rig]``."""
NO_CALIBRATION: Calibration = {}
"""Calibration of a job that names no calibration files."""


def build_golden_log_path(job: Job, job_path: Path) -> Path:
    """Return the path of the golden part's log: that of the job, else one beside the job file."""
    if job.golden is not None and job.golden.log is not None:
        return job_path.parent / job.golden.log
    return job_path.with_name(job_path.name + LOG_SUFFIX)


def check_golden(
    cylinders: Sequence[MeasuredCylinder],
    job: Job,
    source: str,
    now: datetime.datetime,
    calibration: Calibration = NO_CALIBRATION,
) -> Record:
    """Return the record of a measurement of the golden part, compared with its known radius.

    The golden part is the cylinder nearest to the known radius. ``passed`` is true only if the
    interval of the radius lies within the tolerance: an undecided check does not pass. `now` has a
    time zone; `calibration` is from `check_calibration_files`.

    Raises
    ------
    LsvisionError
        If the job names no golden part.
    """
    golden = job.golden
    if golden is None:
        raise LsvisionError("the job names no golden part: add a [golden] table to it")
    record: Record = {"time": now.isoformat(timespec="seconds"), "source": source}
    record |= {"job_hash": job.hash, "reference_radius_mm": golden.radius_mm}
    record |= {"measured_by": _collect_measuring_settings(job, calibration)}
    if not cylinders:
        return record | {"passed": False, "reason": "no cylinder was measured"}
    nearest = min(cylinders, key=lambda cylinder: abs(cylinder.radius - golden.radius_mm))
    level, extra_std = _get_decision_rule(job)
    interval = nearest.interval("radius", level)
    low, high = widen_interval(nearest.radius, interval, extra_std, level)
    ends = _compute_limits(golden)
    decision = decide((low, high), ends)
    reason = f"radius {low:.4f} .. {high:.4f} mm, limits {ends[0]:g} .. {ends[1]:g}"
    measured = {"radius_mm": float(nearest.radius), "low_mm": float(low), "high_mm": float(high)}
    rule = {"level": level, "extra_std_mm": extra_std}
    return record | measured | rule | {"passed": decision == Decision.OK, "reason": reason}


def _compute_limits(golden: Golden) -> tuple[float, float]:
    """Return the smallest and largest permissible radius of the golden part. Units: mm."""
    return golden.radius_mm - golden.tolerance_mm, golden.radius_mm + golden.tolerance_mm


def _get_decision_rule(job: Job) -> tuple[float, float]:
    """Return the level of the golden part's interval, and its further standard uncertainty (mm)."""
    return job.decision.level, job.extra_std("radius_mm")


def find_blocking_reason(
    job: Job,
    log: Sequence[Record],
    now: datetime.datetime,
    calibration: Calibration = NO_CALIBRATION,
) -> str:
    """Return the reason why the golden part blocks all decisions; empty if it does not.

    The log has the records of `check_golden`, the oldest first; all those of the last run, which
    have the same time, must have passed. `now` has a time zone; `calibration` is that of the job at
    present, from `check_calibration_files`.
    """
    if job.golden is None:
        return ""
    if not log:
        return "golden part never measured: lsvision inspect JOB --golden FILE"
    last_run = takewhile(lambda record: record["time"] == log[-1]["time"], reversed(log))
    failures = (_find_blocking_reason_of_check(record, job.golden) for record in last_run)
    return (
        next(filter(None, failures), "")
        or _find_blocking_reason_of_rule(log[-1], job)
        or _find_blocking_reason_of_settings(log[-1], _collect_measuring_settings(job, calibration))
        or _find_blocking_reason_of_age(log[-1], job.golden, now)
    )


def _find_blocking_reason_of_check(last: Record, golden: Golden) -> str:
    """Return the reason why the last check failed, or would by the present limits; else empty."""
    if not last["passed"]:
        return f"golden part failed at {last['time']}: {last['reason']}"
    reference = last["reference_radius_mm"]
    if reference != golden.radius_mm:
        return (
            f"golden part of radius {reference:g} mm measured, expected "
            f"{golden.radius_mm:g} mm: lsvision inspect JOB --golden FILE"
        )
    interval, ends = (last["low_mm"], last["high_mm"]), _compute_limits(golden)
    if decide(interval, ends) != Decision.OK:  # the tolerance was changed after the check
        return (
            f"golden part of radius {interval[0]:.4f} .. {interval[1]:.4f} mm measured, limits are "
            f"now {ends[0]:g} .. {ends[1]:g}: lsvision inspect JOB --golden FILE"
        )
    return ""


def _find_blocking_reason_of_rule(last: Record, job: Job) -> str:
    """Return the reason if the present job widens the interval of the last check; else empty."""
    level, extra_std = _get_decision_rule(job)
    checked_level, checked_std = last.get("level", level), last.get("extra_std_mm", extra_std)
    if level <= checked_level and extra_std <= checked_std:
        return ""
    return (
        f"golden part measured with level {checked_level:g} and extra_std {checked_std:g} mm, now "
        f"{level:g} and {extra_std:g} mm: lsvision inspect JOB --golden FILE"
    )


def _collect_measuring_settings(job: Job, calibration: Calibration) -> Record:
    """Return what a measured radius depends on: settings of the job, hashes of calibrations."""
    scan = {} if job.scan is None else job.scan.model_dump(mode="json", exclude_defaults=True)
    return {
        "[measure]": job.measure.model_dump(mode="json", exclude_defaults=True),
        "[scan]": scan,
        "[rig]": {"laser": job.rig.laser, "convention": job.rig.convention},
        "calibration files": {key: file["sha256"] for key, file in calibration.items()},
    }


def _find_blocking_reason_of_settings(last: Record, settings: Record) -> str:
    """Return the reason if settings or calibrations were changed after the last check."""
    before = last.get("measured_by", settings)  # not in logs of earlier versions
    changed = [name for name, values in settings.items() if before.get(name) != values]
    if not changed:
        return ""
    return (
        f"golden part measured with another state of {' and '.join(changed)}: lsvision inspect JOB "
        "--golden FILE"
    )


def _find_blocking_reason_of_age(last: Record, golden: Golden, now: datetime.datetime) -> str:
    """Return the reason if the last check is overdue, or after the present time; else empty."""
    hours = (now - datetime.datetime.fromisoformat(last["time"])).total_seconds() / 3600
    if hours < 0:
        return f"golden part measured at {last['time']}, after the present time: set the clock"
    if hours > golden.every_hours:
        return (
            f"golden part overdue: measured {hours:.1f} h ago, expected every "
            f"{golden.every_hours:g} h"
        )
    return ""
