"""Measurement of profiles and scans with the settings of a job."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lsvision.geometry import Pose
from lsvision.inspection.job import Job
from lsvision.inspection.job_tables import Scan
from lsvision.measure import Measurement, measure_profiles
from lsvision.profile import NoiseModel, Profile
from lsvision.scan import ScanMeasurement, measure_scan
from lsvision.sensors.profile_sensor import ProfileSensor, find_sensor

if TYPE_CHECKING:
    from lsvision.cylinder.robot_frame import SectionMount


def _noise_model_from_job(job: Job) -> NoiseModel | None:
    """Return the noise model that the job names or describes; None if it does neither."""
    measure = job.measure
    if measure.sensor is not None:
        return find_sensor(measure.sensor)
    if measure.range_std_mm is None:
        return None
    return ProfileSensor(range_std=measure.range_std_mm, reference_range=measure.reference_range_mm)


def measure_profiles_of_job(profiles: Sequence[Profile], job: Job) -> list[Measurement]:
    """Measure profiles with the settings of ``[measure]``; see `measure_profiles`."""
    known = job.measure.known_phi_deg
    phi: float | tuple[float, float] | None = None
    if isinstance(known, tuple):
        phi = math.radians(known[0]), math.radians(known[1])
    elif known is not None:
        phi = math.radians(known)
    return measure_profiles(
        profiles,
        radius=job.measure.radius_mm,
        known_radius=job.measure.known_radius_mm,
        known_phi=phi,
        sensor=_noise_model_from_job(job),
    )


def measure_scan_of_job(
    profiles: Sequence[Profile],
    base_from_sections: Sequence[Pose],
    job: Job,
    calibration: SectionMount | None = None,
) -> ScanMeasurement:
    """Measure a scan with the settings of ``[measure]`` and ``[scan]``; see `measure_scan`."""
    scan = job.scan or Scan()
    return measure_scan(
        profiles,
        base_from_sections,
        radius=job.measure.radius_mm,
        known_radius=job.measure.known_radius_mm,
        sensor=_noise_model_from_job(job),
        pose_std=scan.pose_std_mm,
        feed_std=math.radians(scan.feed_std_deg),
        calibration=calibration,
    )
