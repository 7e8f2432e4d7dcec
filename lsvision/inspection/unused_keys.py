"""Tables and keys of a job that the commands of this version do not use."""

from __future__ import annotations

from lsvision.inspection.job import Job

UNATTENDED_TABLES = ("source", "output")
"""Tables for unattended operation: where profiles come from, and where results go."""
KEYS_OF_POSES = ("poses", "flange_from_section", "convention")
"""Keys of ``[rig]`` that give a scan its poses."""


def describe_unused_keys(job: Job) -> str | None:
    """Return a message on all that a job states and no command uses; None if all is used.

    Parameters
    ----------
    job : Job
        Job, already validated.

    Returns
    -------
    str or None
        One line: the tables and keys, each with the reason.
    """
    unused = [
        (
            [f"[{name}]" for name in UNATTENDED_TABLES if getattr(job, name) is not None],
            "for unattended operation, which this version does not have: files and outputs are "
            "named on the command line",
        ),
        (
            [] if job.scan else _given_keys(job, "rig", KEYS_OF_POSES),
            "of a scan: add [scan]",
        ),
        (
            _given_keys(job, "measure", ("known_phi_deg",)) if job.scan else [],
            "of single sections: a scan measures the direction",
        ),
        (
            _given_keys(job, "measure", ("reference_range_mm",))
            if job.measure.range_std_mm is None
            else [],
            "of range_std_mm: add it",
        ),
    ]
    texts = [f"{', '.join(names)} ({reason})" for names, reason in unused if names]
    return f"not used: {'; '.join(texts)}" if texts else None


def _given_keys(job: Job, table: str, keys: tuple[str, ...]) -> list[str]:
    """Return those of the keys that the job states in a table, the last with the table's name."""
    given = [key for key in keys if key in getattr(job, table).model_fields_set]
    return [*given[:-1], f"{given[-1]} of [{table}]"] if given else []
