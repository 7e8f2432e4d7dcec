"""Distance, angle, gap and flush against truth by geometry that the package does not use."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import cKDTree

import lsvision as lsv
from lsvision.cylinder.fit_result import CylinderFit
from lsvision.ellipse.parameters import ellipse_from_parameters
from lsvision.geometry import Cylinder
from lsvision.inspection.axis_relation import ObservedCylinder, angle_between, relate_axes
from lsvision.measure import measure_cylinders
from lsvision.scan import measure_scan
from lsvision.simulate import (
    SCENE_SENSOR,
    Scene,
    SectionSettings,
    Tube,
    random_section,
    simulate_scan,
    simulate_section,
)
from tests.bench.matching import match_tubes

SEEDS = range(520, 536)
SCAN_SEEDS = range(8)
CLEAN = SectionSettings(lost_fraction=0.0, jump_fraction=0.0, noise_factor=0.0)


def least_gap(first, second, count=1500):
    """Shortest distance of two outlines; negative: the longest of a point within the other."""
    turn = np.linspace(0, 2 * math.pi, count)
    one, other = (ellipse.points_at(turn) for ellipse in (first, second))
    return float(cKDTree(one).query(other)[0].min())


def measured_pair(section):
    found = match_tubes(measure_cylinders(section.profile), section.truth).found
    by_label = {label: cylinder for label, cylinder, _ in found}
    return [by_label[1], by_label[2]] if len(by_label) == 2 else None


@pytest.mark.parametrize("theta_deg", [(30.0, 60.0), (20.0, 100.0)])
def test_the_angle_of_a_section_deviates_as_its_std_states(theta_deg):
    tubes = tuple(
        Tube.of(19.0, math.radians(theta), math.radians(30), (x, -400.0))
        for theta, x in zip(theta_deg, (-40.0, 40.0), strict=True)
    )
    angle = math.acos(abs(tubes[0].cylinder.direction @ tubes[1].cylinder.direction))
    rng = np.random.default_rng(3)
    sections = [
        simulate_section(
            Scene(tubes), replace(SCENE_SENSOR, range_std=0.02), SectionSettings(), rng=rng
        )
        for _ in range(24)
    ]
    relations = [lsv.relate(*measured_pair(section)) for section in sections]
    normalised = [(relation.angle - angle) / relation.angle_std for relation in relations]
    assert 0.6 < np.sqrt(np.mean(np.square(normalised))) < 1.4  # 24 values: 1 +- 0.14


def test_a_section_with_few_degrees_of_freedom_has_wider_intervals():
    section = random_section("welded_pair", 520, noise_mm=0.05)
    profile = lsv.Profile(section.profile.points[::3])  # without a noise model
    relation = lsv.relate(*measure_cylinders(profile).cylinders)
    low, high = relation.interval("gap")
    assert (high - low) / 2 > 1.97 * relation.gap_std


def test_without_noise_a_section_gives_the_true_numbers():
    tubes = (
        Tube.of(19.0, 0.4, 0.5, (-25.0, -400.0)),
        Tube.of(14.0, 1.2, 0.3, (20.0, -395.0)),
    )
    section = simulate_section(Scene(tubes), SCENE_SENSOR, CLEAN, rng=np.random.default_rng(1))
    left, right = measured_pair(section)
    relation = lsv.relate(left, right)
    ellipses = [tube.cylinder.section() for tube in tubes]
    assert relation.distance == pytest.approx(math.hypot(45, 5), abs=0.02)
    assert relation.gap == pytest.approx(least_gap(*ellipses), abs=0.02)
    crests = [ellipse.points_at(np.linspace(0, 7, 20001))[:, 1].max() for ellipse in ellipses]
    assert relation.quantities["flush"].value == pytest.approx(crests[1] - crests[0], abs=0.02)
    angles = [math.acos(abs(left.axis_candidates[0] @ other)) for other in right.axis_candidates]
    assert relation.angle == pytest.approx(min(angles), abs=1e-9)


def test_exchanging_both_changes_only_the_sign_of_flush():
    section = random_section("welded_pair", 5, noise_mm=0.02)
    left, right = measured_pair(section)
    there, back = lsv.relate(left, right), lsv.relate(right, left)
    assert (there.distance, there.gap) == pytest.approx((back.distance, back.gap), abs=1e-6)
    assert there.gap_std == pytest.approx(back.gap_std, rel=1e-3)
    flush = [relation.quantities["flush"].value for relation in (there, back)]
    assert flush[0] == pytest.approx(-flush[1], abs=1e-9)


def test_ellipses_that_overlap_have_a_negative_gap():
    section = random_section("welded_pair", 5, noise_mm=0.02)
    left, right = measured_pair(section)
    nearer = _moved(right, 0.4 * np.subtract(left.centre, right.centre))
    assert lsv.relate(left, nearer).gap < 0


def _moved(section, shift):
    parameters = section.fit.parameters + np.array([*shift, 0.0, 0.0, 0.0])
    fit = replace(section.fit, parameters=parameters, ellipse=ellipse_from_parameters(parameters))
    return replace(section, fit=fit)


def test_the_sigmas_of_sections_are_those_of_the_errors():
    errors = {"distance": [], "gap": [], "flush": []}
    angles = []
    for seed in SEEDS:
        section = random_section("welded_pair", seed, noise_mm=0.03)
        pair = measured_pair(section)
        if pair is None:
            continue
        relation = lsv.relate(*pair)
        cylinders = [tube.cylinder for tube in section.truth.tubes[:2]]
        ellipses = [cylinder.section() for cylinder in cylinders]
        crests = [ellipse.points_at(np.linspace(0, 7, 4001))[:, 1].max() for ellipse in ellipses]
        true = {
            "distance": math.dist(ellipses[0].centre, ellipses[1].centre),
            "gap": least_gap(*ellipses),
            "flush": crests[1] - crests[0],
        }
        for name, value in true.items():
            number = relation.quantities[name]
            errors[name].append((number.value - value) / number.std)
        low, high = relation.interval("angle")
        angle = math.acos(min(abs(float(cylinders[0].direction @ cylinders[1].direction)), 1.0))
        angles.append(low <= angle <= high)
    count = len(angles)
    assert count > 10
    assert sum(angles) >= stats.binom.ppf(1e-3, count, 0.95)
    for name, values in errors.items():
        square = float(np.mean(np.square(values)))
        assert stats.chi2.ppf(1e-4, count) / count < square, name
        assert square < stats.chi2.ppf(1 - 1e-4, count) / count, name


CROSSING = (
    Cylinder((-20.0, -400.0, 0.0), (0.02, 0.3, 1.0), 14.0),
    Cylinder((25.0, -405.0, 0.0), (-0.03, -0.25, 1.0), 18.0),
)
_ALONG = np.array([0.3, 0.1, 1.0]) / math.hypot(0.3, 0.1, 1.0)
PARALLEL = (
    Cylinder((-20.0, -400.0, 0.0), _ALONG, 19.0),
    Cylinder((16.0, -405.0, 0.0), _ALONG, 15.0),
)
UP = np.array([0.0, 1.0, 0.0])


def scanned(pair, seed, noise=0.05):
    poses = [lsv.Pose.along((0, 0, 1), 10.0 * k) for k in range(-1, 2)]
    scene = Scene(tuple(Tube(cylinder) for cylinder in pair))
    sensor = replace(SCENE_SENSOR, range_std=noise)
    settings = SectionSettings(jump_fraction=0.0)
    rng = np.random.default_rng(seed)
    sections = simulate_scan(scene, poses, sensor, settings, rng=rng)
    found = measure_scan([section.profile for section in sections], poses).cylinders
    ordered = [min(found, key=lambda tube: abs(tube.radius - true.radius)) for true in pair]
    assert ordered[0] is not ordered[1]
    return ordered


def true_relation(pair):
    first, second = pair
    normal = np.cross(first.direction, second.direction)
    offset = second.point - first.point
    if np.linalg.norm(normal) < 1e-9:
        distance = float(np.linalg.norm(offset - (offset @ first.direction) * first.direction))
    else:
        distance = abs(float(offset @ normal)) / float(np.linalg.norm(normal))
    angle = math.asin(min(float(np.linalg.norm(normal)), 1.0))
    return distance, angle


@pytest.mark.parametrize("pair", [CROSSING, PARALLEL], ids=["crossing", "parallel"])
def test_the_sigmas_of_scans_are_those_of_the_errors(pair):
    distance, angle = true_relation(pair)
    gap = distance - pair[0].radius - pair[1].radius
    errors = []
    for seed in SCAN_SEEDS:
        relation = lsv.relate(*scanned(pair, seed), up=UP)
        assert relation.seam.crossing == (pair is CROSSING)
        errors.append(
            [
                (relation.distance - distance) / relation.distance_std,
                (relation.gap - gap) / relation.gap_std,
                (relation.angle - angle) / relation.angle_std if pair is CROSSING else 0.0,
            ]
        )
        low, high = relation.interval("angle", 0.999)
        assert low <= angle <= high
    squares = np.mean(np.square(errors), axis=0)
    assert (squares < stats.chi2.ppf(1 - 1e-4, 8) / 8).all()
    assert (squares[:2] > stats.chi2.ppf(1e-4, 8) / 8).all()


def test_the_seam_of_a_welded_pair_runs_between_the_pipes_in_the_base_frame():
    first, second = PARALLEL
    across = second.point - first.point
    across = across - (across @ _ALONG) * _ALONG
    length = float(np.linalg.norm(across))
    unit = across / length
    # Middle of the gap, from the first axis.
    middle = (first.radius + (length - second.radius)) / 2
    squares = []
    for seed in SCAN_SEEDS:
        seam = lsv.relate(*scanned(PARALLEL, seed)).seam
        off = seam.point - (first.point + middle * unit)
        off = off - (off @ _ALONG) * _ALONG
        squares.append(float(off @ np.linalg.pinv(seam.point_covariance, rcond=1e-6) @ off))
        turn = math.acos(min(abs(float(seam.direction @ _ALONG)), 1.0))
        assert turn < 5 * seam.direction_std
    assert stats.chi2.ppf(1e-4, 16) < sum(squares) < stats.chi2.ppf(1 - 1e-4, 16)


def test_the_points_of_nearest_approach_of_crossing_pipes_lie_on_their_common_normal():
    first, second = CROSSING
    relation = lsv.relate(*scanned(CROSSING, 3, noise=0.001))
    between = relation.seam.points[1] - relation.seam.points[0]
    assert abs(between @ first.direction) < 0.01
    assert abs(between @ second.direction) < 0.01
    assert np.linalg.norm(between) == pytest.approx(true_relation(CROSSING)[0], abs=0.01)


def test_flush_of_a_scan_is_the_difference_of_the_crests():
    first, second = (Cylinder((x, y, 0.0), (0, 0, 1.0), r) for x, y, r in (
        (-20.0, -400.0, 19.0), (16.0, -405.0, 15.0)))  # fmt: skip
    relation = lsv.relate(*scanned((first, second), 1, noise=0.002), up=(0, 2, 0))
    assert relation.quantities["flush"].value == pytest.approx(-405 + 15 - (-400 + 19), abs=0.02)
    assert "flush" not in lsv.relate(*scanned((first, second), 1)).quantities


def test_the_angle_of_perpendicular_axes_is_at_most_a_right_angle():
    tube, _ = scanned(PARALLEL, 0)
    direction, perpendicular = tube.fit.tangent_basis
    first, second = (
        replace(tube, fit=replace(tube.fit, cylinder=Cylinder((0, 0, 0), axis, 10.0)))
        for axis in (direction, perpendicular)
    )
    low, high = lsv.relate(first, second).interval("angle")
    assert low < high == math.pi / 2
    assert angle_between(first.fit, perpendicular).interval(0.95)[1] == math.pi / 2


# The last three directions have a squared length below 1, by rounding.
@pytest.mark.parametrize("seed", [0, 67, 130, 131])
def test_axes_with_the_same_direction_are_compared_in_the_middle(seed):
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    across = np.cross(direction, (0, 0, 1))
    across /= np.linalg.norm(across)
    tube, _ = scanned(PARALLEL, 0)
    tube = replace(tube, axial_range=(-20.0, 20.0))
    tubes = [
        replace(tube, fit=replace(tube.fit, cylinder=Cylinder(offset * across, direction, 10.0)))
        for offset in (0.0, 25.0)
    ]
    relation = lsv.relate(*tubes)
    assert not relation.seam.crossing
    assert relation.distance == pytest.approx(25)
    assert relation.angle == pytest.approx(0, abs=1e-9)


def test_records_and_tables_name_their_units():
    relation = lsv.relate(*scanned(PARALLEL, 2), up=UP)
    record = relation.to_dict()
    assert {"distance_mm", "angle_deg", "gap_interval_95_mm", "seam_point_mm"} <= set(record)
    assert "middle of the common length" in str(relation)
    assert repr(relation).startswith("<Relation: distance ")


def test_what_cannot_be_compared_is_rejected():
    section = random_section("welded_pair", 5, noise_mm=0.02)
    left, right = measured_pair(section)
    tube, other = scanned(PARALLEL, 0)
    with pytest.raises(TypeError, match="two cylinders of one section or two in space, got one of"):
        lsv.relate(left, tube)
    with pytest.raises(TypeError, match="expected a CylinderSection or a ScannedCylinder, got str"):
        lsv.relate("left", "right")
    with pytest.raises(TypeError, match="expected a CylinderSection or a ScannedCylinder, got str"):
        lsv.relate(left, "right")
    with pytest.raises(ValueError, match="two cylinders, got the same one twice"):
        lsv.relate(left, left)
    with pytest.raises(ValueError, match="expected up as three numbers, not all zero"):
        lsv.relate(tube, other, up=(0, 0, 0))
    with pytest.raises(ValueError, match="expected up as three numbers, not all zero, got 'z'"):
        lsv.relate(tube, other, up="z")
    relation = lsv.relate(left, right)
    with pytest.raises(ValueError, match="expected a quantity among distance, angle, gap, flush"):
        relation.interval("radius")
    with pytest.raises(ValueError, match="expected a quantity among distance, angle, gap, flush"):
        relation.estimate("radius")
    with pytest.raises(ValueError, match="expected a level between 0 and 1, got 95"):
        relation.interval("gap", 95)


def exact(point, direction, radius, stds=(0.05, 0.05, 1e-3, 1e-3, 0.03), ends=(-30.0, 30.0)):
    """A cylinder in space with independent errors of these stds."""
    residuals = np.zeros(10)
    fit = CylinderFit(
        Cylinder(point, direction, radius), np.diag(np.square(stds)), residuals, residuals,
        residuals + 1, residuals == 0, 1.0, math.inf,
    )  # fmt: skip
    return ObservedCylinder(fit, ends)


def test_perpendicular_axes_are_compared_at_their_common_perpendicular():
    """A branch that ends before the run does not change with the sign of a hardly tilted axis."""
    run = exact((0, -400, 0), (0, 0, 1), 10.0)
    relations = [
        relate_axes(run, exact((0, -405, 0), (1, 0, tilt), 8.0, ends=(15.0, 60.0)))
        for tilt in (1e-3, -1e-3)
    ]
    for relation in relations:
        assert relation.seam.crossing
        assert relation.distance == pytest.approx(5, abs=1e-6)
        assert relation.gap == pytest.approx(-13, abs=1e-6)
        assert relation.seam.point == pytest.approx([0, -403.5, 0], abs=1e-6)


def test_the_seam_of_axes_that_intersect_at_a_right_angle_is_not_determined():
    """Small errors exchange the sides, and the bisectors of the axes."""
    seams = [
        relate_axes(
            exact((0, -400, 0), (0, 0, 1), 10.0), exact((0, -400 + error, 0), (1, 0, error), 6.0)
        ).seam
        for error in (1e-3, -1e-3)
    ]
    change = seams[1].point - seams[0].point
    assert np.linalg.norm(change) == pytest.approx(4, abs=0.01)
    for seam in seams:
        assert seam.point_std > 2
        assert seam.direction_std == math.pi / 2


def test_the_gap_of_coaxial_tubes_has_its_coverage(rng):
    stds, draws, misses = np.array([0.05, 0.05, 1e-5, 1e-5, 0.02]), 400, 0
    for _ in range(draws):
        errors = rng.normal(0, 1, (2, 5)) * stds
        pair = [
            exact((x, y, 0), (0, 0, 1), radius + error, stds)
            for radius, (x, y, *_, error) in zip((10, 8), errors, strict=True)
        ]
        low, high = relate_axes(*pair).interval("gap")
        misses += not low <= -18 <= high
    assert misses <= stats.binom.ppf(0.9999, draws, 0.05)


def test_flush_along_an_axis_is_rejected():
    pair = exact((0, 0, 0), (0, 0, 1), 10.0), exact((25, 0, 0), (0, 0.1, 1), 10.0)
    with pytest.raises(ValueError, match="expected up across both axes, got a direction along one"):
        relate_axes(*pair, np.array([0, 0.02, 1]) / math.hypot(0.02, 1))
    assert "flush" in relate_axes(*pair, UP).quantities
