"""Text of a simulated section: the profile as exported by sensor software, and its truth.

The profile has two columns, x along the laser line and z = height towards the sensor (Y of the
section frame), with one row for each column of the sensor and ``nan`` for lost points. The truth
is JSON with the unit in each name. Computed numbers are rounded, so that both texts are identical
byte for byte on every platform.
"""

import dataclasses
import json
from collections.abc import Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from lsvision.geometry import Pose
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.scene import Scene, TubeSolid, TubeTruth
from lsvision.simulate.section import SectionSettings, SimulatedSection
from lsvision.simulate.solids import BentTube, Tube

TRUTH_SCHEMA = "lsvision.simulated_section/1"
"""Name and version of the truth file of a section."""
SCAN_SCHEMA = "lsvision.simulated_scan/1"
"""Name and version of the truth file of a scan."""
SETTINGS_KEYS = {"jump_pair_fraction": "jump_pair_share"}
"""Keys of the settings in truth files that differ from their names in `SectionSettings`: the names
that they had in the first truth files."""
LABEL_MEANING = "-1 lost or jump, 0 clutter, k >= 1 the k-th tube"
"""Explanation of the labels in a truth file."""
DECIMALS = 6
"""Decimals of mm and rad in the truth; far below the noise of any sensor."""
RAW_DECIMALS = 4
"""Decimals of the profile of a sensor without quantisation."""


def format_profile(section: SimulatedSection, title: str) -> str:
    """Return the profile of a section as comma-separated text; `title` is in its first line.

    Examples
    --------
    >>> from lsvision.simulate import random_section
    >>> section = random_section("single", 1, noise_mm=0.05)
    >>> format_profile(section, "single, seed 1").splitlines()[3]
    'x [mm],z [mm]'
    """
    sensor = section.sensor
    decimals = _count_decimals(sensor.quantum) if sensor.quantum > 0 else RAW_DECIMALS
    lines = [
        f"# {title}",
        f"# sensor: {sensor.name}, noise {_round(sensor.range_std)} mm along the ray at "
        f"{sensor.reference_range:g} mm",
        "# z is the height, growing towards the sensor; nan where nothing was measured",
        "x [mm],z [mm]",
    ]
    lines += [f"{x:.{decimals}f},{y:.{decimals}f}" for x, y in section.profile.points]
    return "\n".join(lines) + "\n"


def _count_decimals(quantum: float) -> int:
    """Return the number of decimals with which multiples of a number are exact."""
    exponent = Decimal(str(quantum)).normalize().as_tuple().exponent
    return max(0, -int(exponent))


def _build_settings_record(settings: SectionSettings) -> dict[str, Any]:
    """Return the settings of a section by their keys in truth files."""
    record = dataclasses.asdict(settings)
    return {SETTINGS_KEYS.get(name, name): value for name, value in record.items()}


def format_truth(section: SimulatedSection, source: dict[str, Any]) -> str:
    """Return the truth of a section, all but the profile, as JSON with one line per key.

    `source` is its origin (kind, seed, command), written first.
    """
    record = {
        "schema": TRUTH_SCHEMA,
        **source,
        "frame": "section: X along the laser line, Y towards the sensor (z of the csv), mm",
        "sensor": _build_sensor_record(section.sensor),
        "settings": _build_settings_record(section.settings),
        "tubes": [_build_tube_record(tube) for tube in section.truth.tubes],
        "label_meaning": LABEL_MEANING,
        "labels": section.truth.labels.tolist(),
    }
    return _format_json_lines(record)


def format_scan_truth(
    scene: Scene,
    base_from_sections: Sequence[Pose],
    sections: Sequence[SimulatedSection],
    source: dict[str, Any],
) -> str:
    """Return the truth of a scan of a scene (base frame) as JSON with one line per key.

    `source` is its origin (seed, command, feed), written first.
    """
    record = {
        "schema": SCAN_SCHEMA,
        **source,
        "frame": "base; a section's own frame has X along the laser line, Y towards the sensor, mm",
        "sensor": _build_sensor_record(sections[0].sensor),
        "settings": _build_settings_record(sections[0].settings),
        "tubes_in_base": [
            {"label": label, **_build_solid_record(tube)}
            for label, tube in enumerate(scene.tubes, 1)
        ],
        "base_from_sections": [
            [[_round(value) for value in row] for row in pose.matrix] for pose in base_from_sections
        ],
        "tubes_by_section": [
            [_build_tube_record(tube) for tube in section.truth.tubes] for section in sections
        ],
        "label_meaning": LABEL_MEANING,
        "labels_by_section": [section.truth.labels.tolist() for section in sections],
    }
    return _format_json_lines(record)


def _format_json_lines(record: dict[str, Any]) -> str:
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in record.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _build_solid_record(tube: TubeSolid) -> dict[str, Any]:
    """Return the parameters of a solid tube, vectors as lists."""
    if isinstance(tube, Tube):
        record = {"point_mm": tube.cylinder.point, "direction": tube.cylinder.direction,
                  "radius_mm": tube.cylinder.radius, "span_mm": tube.span}  # fmt: skip
    elif isinstance(tube, BentTube):
        record = {"bend_centre_mm": tube.bend_centre, "bend_normal": tube.bend_normal,
                  "bend_radius_mm": tube.bend_radius, "radius_mm": tube.radius}  # fmt: skip
    else:
        raise TypeError(f"expected a Tube or a BentTube, got {type(tube).__name__}")
    return {
        key: [_round(component) for component in value] if np.iterable(value) else value
        for key, value in record.items()
    }


def _build_tube_record(tube: TubeTruth) -> dict[str, Any]:
    """Return the truth of a tube as a JSON object."""
    return {
        "label": tube.label,
        "radius_mm": _round(tube.radius),
        "theta_rad": _round(tube.theta),
        "phi_rad": _round(tube.phi),
        "centre_mm": [_round(value) for value in tube.centre],
        "axis": [_round(value) for value in tube.cylinder.direction],
        "points": tube.points,
        "arc_points": tube.arc_points,
        "arc_rad": _round(tube.arc),
        "visible": tube.visible,
    }


def _build_sensor_record(sensor: ProfileSensor) -> dict[str, Any]:
    """Return the data of a sensor as a JSON object."""
    return {
        "name": sensor.name,
        "range_std_mm": _round(sensor.range_std),
        "reference_range_mm": sensor.reference_range,
        "origin_mm": list(sensor.origin),
        "quantum_mm": sensor.quantum,
        "columns": sensor.columns,
        "min_range_mm": sensor.min_range,
        "max_range_mm": sensor.max_range,
        "width_at_max_range_mm": sensor.width_at_max_range,
    }


def _round(value: float) -> float:
    # Adding 0.0 replaces -0.0, which depends on the order of summation, by 0.0.
    return round(float(value), DECIMALS) + 0.0
