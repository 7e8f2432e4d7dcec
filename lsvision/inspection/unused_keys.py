"""Tables and keys of a job that no command of this version uses, or that ``inspect`` rejects."""

from __future__ import annotations

from lsvision.inspection.job import Job
from lsvision.inspection.limits import SCAN_KEYS, SECTION_KEYS

UNATTENDED_TABLES = ("source", "output")
"""Tables for unattended operation: where profiles come from, and where results go."""
KEYS_OF_POSES = ("poses", "flange_from_section", "convention")
"""Keys of ``[rig]`` that give a scan its poses."""
QUANTITIES_BY_REFERENCE = {
    "nominal_direction": ("direction_deg",),
    "nominal_point_mm": ("position_mm", "point_x_mm", "point_y_mm", "point_z_mm"),
}
"""Quantities of a part that are measured from each reference."""


def describe_unused_keys(job: Job) -> str | None:
    """Return a line on all that a job states and no command uses; None if all is used."""
    unused = [
        (
            [f"[{name}]" for name in UNATTENDED_TABLES if getattr(job, name) is not None],
            "for unattended operation, which this version does not have: files and outputs are "
            "named on the command line",
        ),
        (
            []
            if job.scan
            else [*_list_given_keys(job, "rig", KEYS_OF_POSES), *_find_given_up(job)],
            "of a scan: add [scan]",
        ),
        (
            _list_given_keys(job, "measure", ("known_phi_deg",)) if job.scan else [],
            "of single sections: a scan measures the direction",
        ),
        (
            _list_given_keys(job, "measure", ("reference_range_mm",))
            if job.measure.range_std_mm is None
            else [],
            "of range_std_mm: add it",
        ),
        (
            [*_list_extra_stds_without_limits(job), *_list_references_without_limits(job)],
            "of quantities that nothing limits",
        ),
    ]
    texts = [f"{', '.join(names)} ({reason})" for names, reason in unused if names]
    return f"not used: {'; '.join(texts)}" if texts else None


def describe_rejected_keys(job: Job) -> str | None:
    """Return a line on what a job states and ``lsvision inspect`` rejects; None if nothing."""
    allowed = SCAN_KEYS if job.scan else SECTION_KEYS
    other_kind = [
        f"{key} of part {part.name!r}" for part in job.parts for key in part.limits
        if key not in allowed
    ]  # fmt: skip
    key = "known_radius_mm" if job.scan else "z_mm"
    other_kind += [
        f"{key} of part {part.name!r}" for part in job.parts if getattr(part, key) is not None
    ]
    reason = "for profiles: leave it out, or remove [scan]" if job.scan else "for scans: add [scan]"
    has_both = job.scan is not None and job.scan.feed is not None and job.rig.poses is not None
    has_none = job.scan is not None and job.scan.feed is None and job.rig.poses is None
    texts = [f"{', '.join(other_kind)} ({reason})"] if other_kind else []
    texts += ["feed of [scan] beside poses of [rig] (leave one out)"] if has_both else []
    texts += ["[scan] without feed and step_mm, or poses of [rig] (add them)"] if has_none else []
    return f"rejected by inspect: {'; '.join(texts)}" if texts else None


def _find_given_up(job: Job) -> list[str]:
    """Return the key ``up``, with its table, if a relation states it."""
    return ["up of [[relation]]"] if any(limits.up is not None for limits in job.relations) else []


def _list_extra_stds_without_limits(job: Job) -> list[str]:
    """Return the keys of ``extra_std`` whose quantities no part, relation or golden part limits."""
    limited = {key for part in job.parts for key in part.limits}
    limited.update(key for relation in job.relations for key in relation.limits)
    if job.golden is not None or "diameter_mm" in limited:
        limited.add("radius_mm")
    return [f"extra_std of {key}" for key in job.decision.extra_std if key not in limited]


def _list_references_without_limits(job: Job) -> list[str]:
    """Return the nominals of parts and directions of flush from which nothing is measured."""
    unused = [
        f"{key} of part {part.name!r}"
        for part in job.parts
        for key, quantities in QUANTITIES_BY_REFERENCE.items()
        if getattr(part, key) is not None and part.limits.keys().isdisjoint(quantities)
    ]
    if job.scan:
        unused += [
            f"up of {' - '.join(relation.between)}"
            for relation in job.relations
            if relation.up is not None and relation.flush_mm is None
        ]
    return unused


def _list_given_keys(job: Job, table: str, keys: tuple[str, ...]) -> list[str]:
    """Return those of the keys that the job states in a table, the last with the table's name."""
    given = [key for key in keys if key in getattr(job, table).model_fields_set]
    return [*given[:-1], f"{given[-1]} of [{table}]"] if given else []
