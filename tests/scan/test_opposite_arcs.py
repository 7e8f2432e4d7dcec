"""Short arcs on opposite sides of a tube, in different planes: two cylinders fit them."""

import numpy as np
import pytest

from lsvision.geometry import Pose
from lsvision.inspection.job_tables import Part
from lsvision.inspection.quantities import measure_quantity
from lsvision.scan import measure_scan
from lsvision.sensors.profile_sensor import ProfileSensor

RADIUS, GAP, DISTANCE = 25.0, 10.0, 400.0  # mm
NOISE = 0.02  # mm
SIGMAS = 4.0
TURNED = np.diag([-1.0, -1.0, 1.0])  # a half turn about the feed: the sensor looks up


def arc(rng: np.random.Generator, arc_deg: float) -> np.ndarray:
    """Profile of a tube across the laser plane, with errors along the rays; section frame."""
    turns = np.radians(np.linspace(-arc_deg, arc_deg, int(arc_deg))) / 2
    exact = np.column_stack([RADIUS * np.sin(turns), RADIUS * np.cos(turns) - DISTANCE])
    rays = exact / np.linalg.norm(exact, axis=1, keepdims=True)
    return exact + rng.normal(0, NOISE, (len(exact), 1)) * rays


def opposite(seed: int, arc_deg: float, planes: tuple[float, ...]) -> tuple[list, list[Pose]]:
    """Profiles of sensors above and below in turn, and their poses."""
    rng = np.random.default_rng(seed)
    profiles = [arc(rng, arc_deg) for _ in planes]
    poses = [
        Pose(TURNED if k % 2 else np.eye(3), (0.0, -DISTANCE if k % 2 else DISTANCE, z))
        for k, z in enumerate(planes)
    ]
    return profiles, poses


@pytest.mark.parametrize("sensor", [None, ProfileSensor(range_std=NOISE)])
def test_short_opposite_arcs_have_a_twin_of_another_radius(sensor) -> None:
    for seed in range(6):
        scan = measure_scan(*opposite(seed, 60.0, (0.0, GAP)), radius=(15, 40), sensor=sensor)
        for tube in scan.cylinders:
            assert tube.twin_has_other_radius
            radii = sorted([tube.radius, tube.twin.radius])
            assert radii[0] == pytest.approx(RADIUS, abs=0.2)
            assert radii[1] == pytest.approx(np.hypot(RADIUS, GAP / 2), abs=0.05)
        assert scan.cylinders or scan.rejections


def test_the_twin_of_another_radius_is_shown_and_leaves_radius_and_axis_open() -> None:
    scan = measure_scan(*opposite(1, 60.0, (0.0, GAP)), radius=(15, 40))
    (tube,) = scan.cylinders
    assert f"radius {tube.twin.radius:.5g} mm, fits equally well" in str(scan)
    assert tube.to_dict()["twin_radius_mm"] == tube.twin.radius
    part = Part(name="tube", order=1, nominal_direction=(0.0, 0.0, 1.0))
    for key in ("radius_mm", "diameter_mm", "direction_deg"):
        assert not measure_quantity(tube, part, key, 0.95).determined


@pytest.mark.parametrize(
    ("arc_deg", "planes"), [(130.0, (0.0, GAP)), (60.0, (0.0, GAP, 2 * GAP, 3 * GAP))]
)
def test_longer_arcs_or_further_sections_decide(arc_deg, planes) -> None:
    for seed in range(4):
        (tube,) = measure_scan(*opposite(seed, arc_deg, planes), radius=(15, 40)).cylinders
        assert not tube.ambiguous
        assert abs(tube.radius - RADIUS) < SIGMAS * tube.radius_std


def test_a_known_radius_decides() -> None:
    for seed in range(4):
        profiles, poses = opposite(seed, 60.0, (0.0, GAP))
        for tube in measure_scan(profiles, poses, known_radius=(RADIUS, 0.02)).cylinders:
            assert not tube.ambiguous
            assert tube.direction[2] > np.cos(SIGMAS * tube.direction_std)
