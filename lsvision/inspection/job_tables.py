"""Tables of a job file: where profiles come from, how they are measured, parts, relations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

from pydantic import Field, model_validator

from lsvision.geometry.arrays import MAX_COORDINATE_MM
from lsvision.inspection.limits import (
    RELATION_KEYS,
    SCAN_KEYS,
    SECTION_KEYS,
    JobTable,
    Limits,
    Number,
    Positive,
)

Window = tuple[Number, Number]
"""Range (low, high) of a coordinate in which a part lies. Units: mm."""
MAX_NAME_LENGTH = 80
"""Largest number of characters of a name: it heads a row of a table."""
Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME_LENGTH)]
Count = Annotated[int, Field(strict=True, ge=1)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
KnownRadius = Positive | tuple[Positive, NonNegative]
"""A known radius, or (radius, standard uncertainty). Units: mm."""
Vector = tuple[Number, Number, Number]
Coordinate = Annotated[Number, Field(ge=-MAX_COORDINATE_MM, le=MAX_COORDINATE_MM)]
Point = tuple[Coordinate, Coordinate, Coordinate]
PartOrVerdict = TypeVar("PartOrVerdict")


class Source(JobTable):
    """Source of the profiles when the job runs unattended; no command of this version uses it."""

    kind: Literal["folder", "replay", "leuze-lps", "keyence-ljx", "genicam", "camera"]
    path: str | None = None
    address: str | None = None


class Rig(JobTable):
    """Calibration files, and optionally the SHA-256 by which a change of each is detected.

    With a light section images are measured too; `laser` is the colour of the line in them. `poses`
    is the file of robot poses of a scan, `convention` that of its units, axes and rotation angles,
    `flange_from_section` the file of the hand-eye calibration.
    """

    light_section: str | None = None
    light_section_sha256: str | None = None
    laser: Literal["grey", "red", "green", "blue", "white"] = "grey"
    flange_from_section: str | None = None
    flange_from_section_sha256: str | None = None
    poses: str | None = None
    convention: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Rig:
        needs = {"light_section_sha256": "light_section", "laser": "light_section",
                 "flange_from_section_sha256": "flange_from_section"}  # fmt: skip
        for key, need in needs.items():
            if key in self.model_fields_set and getattr(self, need) is None:
                raise ValueError(f"expected {key} with {need}, got {key} without {need}: add it")
        return self


class Scan(JobTable):
    """Motion between the sections of a scan, and its standard uncertainties.

    `feed` is the direction of the motion in the section frame, of any length above 0, and `step_mm`
    the distance of neighbouring sections along it, negative against it; without both, ``poses`` of
    ``[rig]`` are used. `pose_std_mm` is the error of each section's position, `feed_std_deg` that
    of the direction of the feed.
    Without this table each profile is judged by itself.
    """

    feed: Vector | None = None
    step_mm: Number | None = None
    pose_std_mm: NonNegative = 0.0
    feed_std_deg: NonNegative = 0.0

    @model_validator(mode="after")
    def _check(self) -> Scan:
        if (self.feed is None) != (self.step_mm is None):
            raise ValueError("expected feed with step_mm, got one alone: add the other")
        if self.feed is not None and not math.hypot(*self.feed) > 0:
            raise ValueError("expected a non-zero feed, got 0, 0, 0")
        if self.step_mm == 0:
            raise ValueError("expected step_mm other than 0, got 0")
        from lsvision.scan.pose_errors import MAX_FEED_STD, MAX_POSE_STD_MM

        limits = {"pose_std_mm": MAX_POSE_STD_MM, "feed_std_deg": math.degrees(MAX_FEED_STD)}
        for key, largest in limits.items():
            if (std := getattr(self, key)) > largest:
                raise ValueError(f"expected {key} up to {largest:.4g}, got {std:g}")
        return self


class Measure(JobTable):
    """Arguments of `lsvision.measure_cylinders` and `lsvision.measure_scan`."""

    radius_mm: Positive | tuple[Positive, Positive] | None = None
    known_radius_mm: KnownRadius | None = None
    known_phi_deg: NonNegative | tuple[NonNegative, NonNegative] | None = None
    sensor: str | None = None
    range_std_mm: Positive | None = None
    reference_range_mm: Positive = 400.0

    @model_validator(mode="after")
    def _check(self) -> Measure:
        """Raise an error for an unknown sensor, a noise stated twice, or a wrong number."""
        if self.sensor is not None and self.range_std_mm is not None:
            raise ValueError("expected sensor or range_std_mm, got both: leave one out")
        if self.sensor is not None:
            from lsvision.sensors.profile_sensor import find_sensor

            find_sensor(self.sensor)
        if self.range_std_mm is not None:
            from lsvision.sensors.profile_sensor import ProfileSensor

            ProfileSensor(range_std=self.range_std_mm, reference_range=self.reference_range_mm)
        if isinstance(self.radius_mm, tuple) and self.radius_mm[0] >= self.radius_mm[1]:
            raise ValueError(f"radius_mm reversed: expected [min, max], got {list(self.radius_mm)}")
        known = self.known_phi_deg
        for angle in known if isinstance(known, tuple) else (known or 0.0,):  # phi, std
            if angle >= 90:
                raise ValueError(f"expected known_phi_deg below 90, got {angle:g}")
        return self


class Part(JobTable):
    """An expected cylinder: how it is identified among those measured, and its limits.

    It is identified by position (its centre, or in a scan its ``point``, lies in all windows that
    are given; `z_mm` is for scans only), by `order` (from the left, or in the order of the scan),
    or else by radius. `direction_deg` and `position_mm` are the angle to `nominal_direction` and
    the distance of the axis from `nominal_point_mm`; `point_x_mm`, `point_y_mm` and `point_z_mm`
    are the axis point nearest to it (without it, to the first section's origin); `length_seen_mm`
    is the length along the axis between the first and the last measured point.
    """

    name: Name
    x_mm: Window | None = None
    y_mm: Window | None = None
    z_mm: Window | None = None
    order: Count | None = None
    known_radius_mm: KnownRadius | None = None
    nominal_direction: Vector | None = None
    nominal_point_mm: Point | None = None
    radius_mm: Limits | None = None
    diameter_mm: Limits | None = None
    theta_deg: Limits | None = None
    phi_deg: Limits | None = None
    centre_x_mm: Limits | None = None
    centre_y_mm: Limits | None = None
    direction_deg: Limits | None = None
    position_mm: Limits | None = None
    point_x_mm: Limits | None = None
    point_y_mm: Limits | None = None
    point_z_mm: Limits | None = None
    bow_mm: Limits | None = None
    taper_mm_per_m: Limits | None = None
    ovality_percent: Limits | None = None
    length_seen_mm: Limits | None = None

    @model_validator(mode="after")
    def _check(self) -> Part:
        """Raise an error unless the cylinder is identified in one way, and limits have nominals."""
        for axis, window in self.windows.items():
            if window[0] >= window[1]:
                raise ValueError(f"{axis}_mm reversed: expected [min, max], got {[*window]}")
        if self.windows and self.order is not None:
            raise ValueError("expected a position (x_mm, y_mm, z_mm) or an order, got both")
        radius = self.expected_radius
        if not self.windows and self.order is None and (radius is None or radius <= 0):
            got = "nothing" if radius is None else f"a radius of {radius:g} mm"
            raise ValueError(
                f"expected a way to identify the cylinder, got {got}: add x_mm = [min, max], "
                "order = 1, or a radius_mm with a nominal above 0"
            )
        references = {"direction_deg": "nominal_direction", "position_mm": "nominal_point_mm"}
        for key, reference in references.items():
            if getattr(self, key) is not None and getattr(self, reference) is None:
                raise ValueError(f"{key} is measured from {reference}: add {reference}")
        if self.nominal_direction is not None and not math.hypot(*self.nominal_direction) > 0:
            raise ValueError("expected a non-zero nominal_direction, got 0, 0, 0")
        theta = self.theta_deg
        if theta is not None and not 0 < theta.ends[1] - theta.ends[0] < 180:
            raise ValueError("theta_deg is periodic: expected both limits, less than 180 deg apart")
        return self

    @property
    def windows(self) -> dict[str, Window]:
        """Windows of the cylinder's position, by axis. Units: mm."""
        given = {"x": self.x_mm, "y": self.y_mm, "z": self.z_mm}
        return {axis: window for axis, window in given.items() if window is not None}

    @property
    def expected_radius(self) -> float | None:
        """Radius by which the cylinder is distinguished from others. Units: mm."""
        if self.radius_mm is not None and self.radius_mm.middle is not None:
            return self.radius_mm.middle
        if self.diameter_mm is not None and self.diameter_mm.middle is not None:
            return self.diameter_mm.middle / 2
        known = self.known_radius_mm
        return known[0] if isinstance(known, tuple) else known

    @property
    def limits(self) -> dict[str, Limits]:
        """Limits by key, in the order of the rows of printed tables."""
        keys = dict.fromkeys((*SECTION_KEYS, *SCAN_KEYS))
        return {key: limits for key in keys if (limits := getattr(self, key)) is not None}


def find_part(parts: Mapping[str, PartOrVerdict], name: str) -> PartOrVerdict:
    """Return the part with a name, or its verdict; raise ValueError if there is none."""
    if name not in parts:
        raise ValueError(f"expected a part among {', '.join(map(repr, parts))}, got {name!r}")
    return parts[name]


class RelationLimits(JobTable):
    """Limits of the quantities between two parts.

    `up` is the direction, in the base frame, along which flush is measured in a scan; in a profile
    it is Y, towards the sensor.
    """

    between: tuple[Name, Name]
    up: Vector | None = None
    distance_mm: Limits | None = None
    angle_deg: Limits | None = None
    gap_mm: Limits | None = None
    flush_mm: Limits | None = None

    @model_validator(mode="after")
    def _check(self) -> RelationLimits:
        if not self.limits:
            raise ValueError(f"expected a limit among {', '.join(RELATION_KEYS)}, got none")
        if self.up is not None and not math.hypot(*self.up) > 0:
            raise ValueError("expected a non-zero up, got 0, 0, 0")
        return self

    @property
    def limits(self) -> dict[str, Limits]:
        """Limits by key, in the order of the rows of printed tables."""
        return {key: limits for key in RELATION_KEYS if (limits := getattr(self, key)) is not None}


class DecisionRule(JobTable):
    """Rule by which intervals are converted into verdicts.

    `level` is the level of confidence of the intervals, `undecided` the value of a one-bit output
    for an undecided verdict. `additional` states whether cylinders that are not parts are only
    reported ("tell") or make the verdict NG ("ng"). `extra_std` holds standard uncertainties that
    the fit does not contain: one for each key of a quantity, in the unit of that key.
    """

    level: Annotated[float, Field(strict=True, gt=0.5, lt=1)] = 0.95
    undecided: Literal["ng", "ok"] = "ng"
    additional: Literal["tell", "ng"] = "tell"
    extra_std: dict[str, NonNegative] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> DecisionRule:
        known = dict.fromkeys((*SECTION_KEYS, *SCAN_KEYS, *RELATION_KEYS))
        for key in self.extra_std:
            if key not in known:
                raise ValueError(f"extra_std: expected a key among {', '.join(known)}, got {key!r}")
        return self


class Golden(JobTable):
    """Reference part that must be measured within its tolerance at least every `every_hours`.

    Its measurements are recorded in the file `log`.
    """

    radius_mm: Positive
    tolerance_mm: Positive
    every_hours: Positive
    log: str | None = None


class Address(JobTable):
    """Network address on which an output listens, or address of a broker."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(strict=True, ge=1, le=65535)] | None = None
    topic: str | None = None


class Output(JobTable):
    """Destination of the results when the job runs unattended; no command uses it yet."""

    results: str | None = None
    record: str | None = None
    page: Address | None = None
    modbus: Address | None = None
    mqtt: Address | None = None
    tcp: Address | None = None
