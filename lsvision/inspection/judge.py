"""`judge`: verdict on a measurement by the limits of a job."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lsvision.detection.acceptance import UNDETERMINABLE
from lsvision.detection.arcs import Rejection
from lsvision.ellipse.fit import refit_with_known_radius
from lsvision.ellipse.prior_check import find_contradicting_radius
from lsvision.ellipse.problem import Priors
from lsvision.ellipse.section import CylinderSection
from lsvision.inspection.decision import Decision, QuantityVerdict, judge_quantity, widen_interval
from lsvision.inspection.job import Job
from lsvision.inspection.job_tables import Part, RelationLimits
from lsvision.inspection.limits import POSSIBLE_RANGES, quantity_from_key
from lsvision.inspection.matching import Matching, match_parts
from lsvision.inspection.quantities import KEYS_OF_RADIUS, measure_quantity
from lsvision.inspection.relate import MeasuredCylinder, relate
from lsvision.inspection.verdict import ItemVerdict, Provenance, Verdict
from lsvision.measure import Measurement
from lsvision.results.quantities import Estimate
from lsvision.scan.scan_result import ScanMeasurement, ScannedCylinder

HALF_TURN_DEG = 180.0
"""Period of theta: opposite directions are the same axis. Units: deg."""
MAX_REASONS = 2
"""Largest number of rejected arcs whose reasons are given for a missing part."""


def judge(
    measurement: Measurement | ScanMeasurement,
    job: Job,
    *,
    blocked: str = "",
    calibration: Mapping[str, Mapping[str, str | None]] | None = None,
) -> Verdict:
    """Judge a measurement by a job: OK, NG or undecided, each with its reason.

    A quantity is OK where its interval at the job's level lies inside the limits, NG where it lies
    completely outside, else undecided (the guard band of ISO 14253-1): with level 0.95 a quantity
    outside its limits is judged OK, and one inside its limits NG, with a probability of at most
    2.5 % each. The job's ``extra_std`` is added to both half widths in quadrature. The decision on
    a part or a relation is the worst of its quantities, that on the whole the worst of all, NG >
    undecided > OK.

    Parameters
    ----------
    measurement : Measurement or ScanMeasurement
        Result of `lsvision.measure_cylinders` or `lsvision.measure_scan`.
    job : Job
        Parts, relations and their limits.
    blocked : str
        Reason why nothing can be decided now, such as an overdue golden part (see
        `lsvision.inspection.golden`); the whole, every part and every relation are then undecided.
    calibration : mapping, optional
        Name, date and hash of each calibration file, for the record.

    Returns
    -------
    Verdict
        A missing part is NG, with the reasons of rejected arcs; a part whose arc was found, but
        whose radius is not determinable, or whose cylinder is assigned to another part, is
        undecided, and so is a quantity that is not determinable. `Verdict.decision` equals
        ``"OK"``, ``"NG"`` or ``"undecided"``. A known radius that a part's points contradict is not
        used; a note names the part. Radius and diameter are judged as measured without it.

    Raises
    ------
    TypeError
        If the arguments are not a measurement and a job.
    ValueError
        If the job limits a quantity that a measurement of this kind does not have: for flush in a
        scan `up` is needed, across both axes; known radii of parts are for profiles only, windows
        in z for scans only.
    FitFailed
        If the fit with a part's known radius overflows or is not an ellipse.

    Examples
    --------
    >>> import lsvision as lsv
    >>> job = lsv.Job.from_text('''
    ... name = "tube"
    ... [[part]]
    ... name = "left"
    ... order = 1
    ... radius_mm = { min = 36.9, max = 37.0 }
    ... ''')
    >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
    >>> lsv.judge(lsv.measure_cylinders(section.profile), job).decision
    <Decision.UNDECIDED: 'undecided'>
    """
    if not isinstance(measurement, Measurement | ScanMeasurement) or not isinstance(job, Job):
        raise TypeError(
            "expected judge(measurement, job) with a result of measure_cylinders or measure_scan "
            f"and a Job (Job.load reads one), got {type(measurement).__name__} and "
            f"{type(job).__name__}"
        )
    if isinstance(measurement, Measurement):
        _reject_windows_in_z(job)
    matching = match_parts(job.parts, measurement.cylinders)
    measured = {name: measurement.cylinders[index] for name, index in matching.cylinders.items()}
    cylinders = {
        name: _apply_known_radius(cylinder, job.part(name)) for name, cylinder in measured.items()
    }
    parts = [
        _judge_part(measured, cylinders, part, job, matching)
        if part.name in cylinders
        else _judge_missing(part, measurement, matching)
        for part in job.parts
    ]
    verdict = Verdict(
        parts=tuple(parts),
        relations=tuple(_judge_relation(relation, cylinders, job) for relation in job.relations),
        additional=matching.additional,
        notes=(
            *_describe_additional(matching, measurement.cylinders),
            *_find_exchanged_parts(parts, measured, job),
            *_describe_contradicted_radii(matching, measurement, cylinders, job),
        ),
        provenance=_collect_provenance(job, calibration or {}),
        additional_is_ng=job.decision.additional == "ng",
        undecided_passes=job.decision.undecided == "ok",
    )
    return _block(verdict, blocked) if blocked else verdict


def _reject_windows_in_z(job: Job) -> None:
    """Raise an error if a part of a profile is identified by z, which a profile does not have."""
    for part in job.parts:
        if part.z_mm is not None:
            raise ValueError(
                f"z_mm of part {part.name!r} is for scans: leave it out, or add [scan] to the job"
            )


def _collect_provenance(
    job: Job, calibration: Mapping[str, Mapping[str, str | None]]
) -> Provenance:
    from lsvision import __version__

    return Provenance(job.name, job.revision, job.hash, __version__, calibration)


def _apply_known_radius(cylinder: MeasuredCylinder, part: Part) -> MeasuredCylinder:
    """Return the cylinder with a part's known radius as a prior, unless the points contradict."""
    prior = Priors.from_values(part.known_radius_mm, None).radius
    if prior is None:
        return cylinder
    if not isinstance(cylinder, CylinderSection):
        raise ValueError(
            f"known_radius_mm of part {part.name!r} is for profiles: for a scan write it under "
            "[measure]"
        )
    fit = refit_with_known_radius(cylinder.fit, prior)
    return replace(cylinder, fit=fit) if find_contradicting_radius(fit) is None else cylinder


def _describe_contradicted_radii(
    matching: Matching,
    measurement: Measurement | ScanMeasurement,
    cylinders: Mapping[str, MeasuredCylinder],
    job: Job,
) -> list[str]:
    """Return a note on each part whose known radius is not used."""
    # `_apply_known_radius` then returns the measured cylinder itself.
    return [
        f"{name}: known_radius_mm is not used: the points contradict it"
        for name, index in matching.cylinders.items()
        if job.part(name).known_radius_mm is not None
        and cylinders[name] is measurement.cylinders[index]
    ]


def _judge_part(
    measured: Mapping[str, MeasuredCylinder],
    cylinders: Mapping[str, MeasuredCylinder],
    part: Part,
    job: Job,
    matching: Matching,
) -> ItemVerdict:
    """Return the verdict of a part that was found.

    `cylinders` are those `measured`, fitted with the known radius of their parts.
    """
    quantities = []
    for key, limits in part.limits.items():
        # With its known radius the radius would be within its limits, whatever the points say.
        found = measured if key in KEYS_OF_RADIUS else cylinders
        estimate = measure_quantity(found[part.name], part, key, job.decision.level)
        quantities.append(_judge_estimate(estimate, key, limits.ends, job))
    return ItemVerdict(part.name, tuple(quantities), matching.cylinders[part.name])


def _judge_estimate(
    estimate: Estimate, key: str, limits: tuple[float, float], job: Job
) -> QuantityVerdict:
    """Return the verdict of a quantity, including the job's extra uncertainty."""
    level, extra = job.decision.level, job.extra_std(key)
    low, high = widen_interval(estimate.value, estimate.interval, extra, level)
    smallest, largest = POSSIBLE_RANGES.get(key, (-math.inf, math.inf))
    estimate = replace(
        estimate,
        std=math.hypot(estimate.std, extra),
        interval=(max(low, smallest), min(high, largest)),
    )
    if key == "theta_deg":
        return _judge_periodic_angle(estimate, limits, level)
    return judge_quantity(estimate, limits, level)


def _judge_periodic_angle(
    estimate: Estimate, limits: tuple[float, float], level: float
) -> QuantityVerdict:
    """Return the verdict of an angle with a period of half a turn, shifted next to its limits.

    Undecided instead of NG if the interval reaches the limits shifted by half a turn.
    """
    half_turns = round((sum(limits) / 2 - estimate.value) / HALF_TURN_DEG)
    shift = half_turns * HALF_TURN_DEG
    low, high = (end + shift for end in estimate.interval)
    shifted = replace(estimate, value=estimate.value + shift, interval=(low, high))
    verdict = judge_quantity(shifted, limits, level)
    reaches_limits = low <= limits[1] - HALF_TURN_DEG or high >= limits[0] + HALF_TURN_DEG
    if verdict.decision == Decision.NG and reaches_limits:
        reason = f"{shifted.interval_text} deg reaches the limits half a turn away"
        return replace(verdict, decision=Decision.UNDECIDED, reason=reason)
    return verdict


def _judge_relation(
    limits: RelationLimits, cylinders: Mapping[str, MeasuredCylinder], job: Job
) -> ItemVerdict:
    """Return the verdict on the relation of two parts; undecided if one was not found."""
    name = " - ".join(limits.between)
    missing = [part for part in limits.between if part not in cylinders]
    if missing:
        reason = f"without {' and '.join(missing)} there is nothing to compare"
        return ItemVerdict(name, decided=Decision.UNDECIDED, reason=reason)
    first, second = (cylinders[part] for part in limits.between)
    relation = relate(first, second, up=limits.up)
    # Of the twins of a tube in one section `relate` takes the first.
    determined = not any(
        isinstance(cylinder, ScannedCylinder) and cylinder.ambiguous for cylinder in (first, second)
    )
    quantities = []
    for key, ends in limits.limits.items():
        quantity = quantity_from_key(key).name
        if quantity not in relation.quantities:
            raise ValueError(
                f"flush_mm of {name!r} needs a direction in a scan: add up = [x, y, z] to the "
                "relation"
            )
        estimate = replace(relation.estimate(quantity, job.decision.level), determined=determined)
        quantities.append(_judge_estimate(estimate, key, ends.ends, job))
    return ItemVerdict(name, tuple(quantities))


def _judge_missing(
    part: Part, measurement: Measurement | ScanMeasurement, matching: Matching
) -> ItemVerdict:
    """Return the verdict of a part without a cylinder.

    NG; undecided if the radius of an arc there was not determinable, or its cylinder is assigned to
    another part.
    """
    if part.name in matching.owners:
        reason = f"the cylinder there is assigned to {matching.owners[part.name]!r}"
        return ItemVerdict(part.name, decided=Decision.UNDECIDED, reason=reason)
    reasons = [reason for reason in _list_rejection_reasons_at(part, measurement) if reason]
    undeterminable = next((reason for reason in reasons if reason.startswith(UNDETERMINABLE)), None)
    if undeterminable is not None:
        return ItemVerdict(
            part.name, decided=Decision.UNDECIDED, reason=f"rejected: {undeterminable}"
        )
    listed = "; ".join(reasons[:MAX_REASONS])
    reason = f"missing; rejected there: {listed}" if listed else "missing: no arc was found there"
    return ItemVerdict(part.name, decided=Decision.NG, reason=reason)


def _list_rejection_reasons_at(part: Part, measurement: Measurement | ScanMeasurement) -> list[str]:
    """Return the reasons of the arcs rejected where the part should be, the longest arc first.

    If the part has no window in x, or the profile is not known, or in a scan, all rejected arcs
    count. See `_list_rejection_reasons_of_scan`.
    """
    if isinstance(measurement, ScanMeasurement):
        return _list_rejection_reasons_of_scan(measurement)

    def in_window(rejection: Rejection) -> bool:
        if measurement.profile is None or "x" not in part.windows:
            return True
        points = measurement.profile.points[rejection.arc.start : rejection.arc.stop]
        points = points[np.isfinite(points[:, 0])]
        # The centre of a rejected arc is not known; its x is about the mean x of the points, which
        # are on the side towards the sensor.
        low, high = part.windows["x"]
        return bool(len(points)) and low <= float(points[:, 0].mean()) <= high

    arcs = sorted(
        measurement.rejections, key=lambda rejection: rejection.arc.start - rejection.arc.stop
    )
    return [rejection.reason for rejection in arcs if in_window(rejection)]


def _list_rejection_reasons_of_scan(scan: ScanMeasurement) -> list[str]:
    """Return the reasons of the joint fit, then those of arcs whose radius is not determinable.

    The latter count if more than half of the profiles have such an arc.
    """
    tracks = sorted(scan.rejections, key=lambda rejection: -len(rejection.sections))
    # Clutter looks like such an arc in some profiles, a cylinder in nearly all.
    in_profiles = [
        next((r.reason for r in profile.rejections if r.reason.startswith(UNDETERMINABLE)), "")
        for profile in scan.measurements
    ]
    undeterminable = list(filter(None, in_profiles))
    reasons = undeterminable if 2 * len(undeterminable) > len(in_profiles) else []
    return [*(track.reason for track in tracks), *reasons]


def _describe_additional(matching: Matching, cylinders: Sequence[MeasuredCylinder]) -> list[str]:
    return [
        f"additional: cylinder {index + 1}, radius {cylinders[index].radius:.4g} mm, is not a part"
        for index in matching.additional
    ]


def _find_exchanged_parts(
    parts: Sequence[ItemVerdict], cylinders: Mapping[str, MeasuredCylinder], job: Job
) -> list[str]:
    """Return a note for each pair of NG parts that would not be NG with exchanged cylinders.

    Only the limits of radius and diameter count.
    """

    def fits(name: str, part_name: str) -> bool:
        """Return whether the cylinder of part `name` is not NG by the size limits of another."""
        part = job.part(part_name)
        keys = [key for key in KEYS_OF_RADIUS if key in part.limits]
        verdicts = [
            _judge_estimate(
                measure_quantity(cylinders[name], part, key, job.decision.level),
                key, part.limits[key].ends, job,
            )
            for key in keys
        ]  # fmt: skip
        return bool(keys) and all(verdict.decision != Decision.NG for verdict in verdicts)

    failed = [
        item.name for item in parts if item.decision == Decision.NG and item.name in cylinders
    ]
    return [
        f"exchanged: {first!r} and {second!r} have each other's size"
        for number, first in enumerate(failed)
        for second in failed[number + 1 :]
        if not fits(first, first) and not fits(second, second)
        if fits(first, second) and fits(second, first)
    ]


def _block(verdict: Verdict, reason: str) -> Verdict:
    """Return the verdict with every part and relation undecided for a given reason.

    The verdicts on their quantities remain, for information.
    """

    def as_undecided(item: ItemVerdict) -> ItemVerdict:
        return replace(item, decided=Decision.UNDECIDED, reason=reason)

    return replace(
        verdict,
        parts=tuple(map(as_undecided, verdict.parts)),
        relations=tuple(map(as_undecided, verdict.relations)),
        blocked=reason,
    )
