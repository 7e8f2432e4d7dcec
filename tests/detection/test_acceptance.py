"""Each reason for a rejection: a section that is rejected, and a similar one that is not."""

import math
import re
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from lsvision import Ellipse, PointNoise, Profile, ProfileSensor
from lsvision.detection.acceptance import (
    AcceptanceSettings,
    find_rejection_reason,
    find_shape_rejection_reason,
    find_undeterminable_radius_reason,
    suppress_overlapping,
)
from lsvision.detection.profile_preparation import prepare_profile
from lsvision.ellipse.fit import FittingSettings
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import Priors, RadiusPrior
from lsvision.ellipse.refinement import refine_arcs
from lsvision.ellipse.section import CylinderSection
from lsvision.profile import Arc
from tests.detection.scenes import arc_points, circle, exact

RANGE = (5.0, 60.0)
SETTINGS = FittingSettings(reweightings=0, max_evaluations=20, tolerance=1e-6)


def fan(degrees, count=100, middle_deg=90.0):
    """Normals of an arc."""
    return np.exp(1j * np.radians(middle_deg + np.linspace(-degrees / 2, degrees / 2, count)))


def tilted(phi_deg, radius=20.0):
    return Ellipse((0.0, -440.0), radius / math.cos(math.radians(phi_deg)), radius, 0.0)


@pytest.mark.parametrize(
    ("ellipse", "normals", "reason"),
    [
        pytest.param(circle(20), fan(120, 12), None, id="twelve points"),
        pytest.param(circle(20), fan(120, 11), "only 11 points on an ellipse, needs 12",
                     id="eleven points"),
        pytest.param(circle(20), fan(120, middle_deg=5), None, id="a left flank"),
        pytest.param(circle(20), fan(120, middle_deg=-5), "concave towards the sensor",
                     id="concave"),
        pytest.param(circle(20), fan(246, middle_deg=-90), None, id="closed but for a gap"),
        pytest.param(circle(20), fan(220, middle_deg=-90), "concave towards the sensor",
                     id="too open"),
        pytest.param(circle(59), fan(120), None, id="large enough"),
        pytest.param(circle(80), fan(120), "radius 80 mm outside 5 to 60 mm", id="too large"),
        pytest.param(circle(5.1), fan(120), None, id="small enough"),
        pytest.param(circle(4.9), fan(120), "radius 4.9 mm outside 5 to 60 mm", id="too small"),
        pytest.param(tilted(59.5), fan(120), None, id="tilted"),
        pytest.param(tilted(60.6), fan(120), "tilt 61 deg over 60 deg", id="needle"),
        pytest.param(circle(20), fan(38.2), None, id="long enough"),
        pytest.param(circle(20), fan(37.4), "arc covers 37 deg, needs 38 deg", id="short"),
    ],
)  # fmt: skip
def test_each_limit_of_the_shape_has_an_arc_on_either_side(ellipse, normals, reason):
    assert find_shape_rejection_reason(ellipse, normals, RANGE) == reason


def test_limits_of_the_shape_can_be_set():
    strict = AcceptanceSettings(min_points=50, max_tilt_deg=30, min_coverage_deg=100)
    for ellipse, normals in (
        (circle(20), fan(120, 49)), (tilted(31), fan(120)), (circle(20), fan(99)),
    ):  # fmt: skip
        assert find_shape_rejection_reason(ellipse, normals, RANGE) is None
        assert find_shape_rejection_reason(ellipse, normals, RANGE, strict) is not None


@pytest.mark.parametrize("middle_deg", [90.0, 175.0])
def test_coverage_knows_no_cut_at_180_deg(middle_deg):
    reason = find_shape_rejection_reason(circle(20), fan(30, middle_deg=middle_deg), RANGE)
    assert reason == "arc covers 30 deg, needs 38 deg"


def fitted(profile, start_ellipse, rows=None, *, radius=None, phi=None, settings=SETTINGS):
    """The section of some rows of a profile."""
    rows = profile.valid_indices if rows is None else np.asarray(rows)
    std = profile.noise_std if profile.noise_is_estimated else None
    points = profile.noisy_points[rows]
    (fit,) = refine_arcs([points], [start_ellipse], Priors(radius, phi), settings, [std])
    return CylinderSection(fit, Arc(int(rows[0]), int(rows[-1]) + 1), rows)


def reason_of(points, std, rows=None, ellipse=None, **priors):
    profile = exact(points, std)
    section = fitted(profile, circle() if ellipse is None else ellipse, rows, **priors)
    return find_rejection_reason(profile, section, RANGE)


ANGLES = np.arange(-70.0, 70.1, 2.0)  # 71 of them


def test_nothing_speaks_against_a_circle():
    assert reason_of(arc_points(ANGLES), 0.02) is None


def test_the_shape_is_that_of_the_fit():
    assert reason_of(arc_points(ANGLES, radius=80.0), 0.02, ellipse=circle(80)) == (
        "radius 80 mm outside 5 to 60 mm"
    )


def wavy(amplitude, waves=36.0):
    """A circle with waves too short for an ellipse: rms amplitude / sqrt(2)."""
    wave = amplitude * np.sin(np.radians(waves * ANGLES + 20))[:, None]
    return arc_points(ANGLES) + wave * arc_points(ANGLES, 1.0, (0.0, 0.0))


@pytest.mark.parametrize(
    ("rms", "is_rejected"), [(2.5, False), (2.9, False), (3.1, True), (4.0, True)]
)
def test_residuals_of_three_times_the_given_noise_are_too_large(rms, is_rejected):
    """Variances along the normal and across it add up to twice the mean variance."""
    std = 0.1  # 3 std are more than a hundredth of the radius
    reason = reason_of(wavy(2 * std * rms), std, phi=PhiPrior(0.0))
    if is_rejected:
        assert re.fullmatch(
            rf"residual rms {rms:.1f} times the noise, limit 3\.0: check the sensor's noise",
            reason,
        )
    else:
        assert reason is None


def test_residuals_of_a_hundredth_of_the_radius_are_never_too_large():
    """With a radius of 20 mm the limit is 0.2 mm, however small the noise is."""
    std = 0.01
    assert reason_of(wavy(math.sqrt(2) * 0.19), std) is None
    assert "residual rms" in reason_of(wavy(math.sqrt(2) * 0.21), std)


def test_estimated_noise_is_not_blamed_on_the_sensor(rng):
    points = wavy(1.0, waves=9.0) + 0.01 * rng.normal(size=(71, 2))
    profile = prepare_profile(Profile(points), None)
    reason = find_rejection_reason(profile, fitted(profile, circle()), RANGE)
    assert re.fullmatch(r"residual rms \d+\.\d times the noise, limit \d+\.\d", reason)


def test_a_parabola_has_no_best_ellipse():
    """The longer an ellipse, the better it fits a parabola: no fit converges."""
    x = np.linspace(-20, 20, 60)
    points = np.column_stack([x, -400.0 - x**2 / 40])
    profile = exact(points, 0.02)
    few = FittingSettings(reweightings=0, max_evaluations=7, tolerance=1e-6)
    section = fitted(profile, circle(20, (0.0, -420.0)), settings=few)
    wide = AcceptanceSettings(max_tilt_deg=89.0)
    reason = find_rejection_reason(profile, section, (1.0, 1000.0), wide)
    assert re.fullmatch(
        r"no best ellipse: the flatter the .* \(the fit stopped at a tilt of \d\d deg\)",
        reason,
    )


def undeterminable(found):
    """The reason of a rejection whose radius is as little determined as `found` says."""
    return f"radius not determinable: {found}; a longer arc or a known tilt is needed"


def section_of(low, high, *, radius=20.0, std=5.0, phi=0.0, known_radius=None, known_phi=None):
    problem = SimpleNamespace(known_radius=known_radius, known_phi=known_phi)
    return SimpleNamespace(
        fit=SimpleNamespace(
            problem=problem, parameter_covariance=np.diag([0, 0, 1, 0, 0]) * std**2
        ),
        radius=radius,
        phi=phi,
        local_radius_std=std,
        interval=lambda quantity: {"radius": (low, high)}[quantity],
    )


@pytest.mark.parametrize(
    ("low", "high", "is_rejected"),
    [
        (15.0, 30.0, False),
        (10.1, 30.0, False),
        (9.9, 30.0, True),
        (8.0, 30.0, True),
        (15.0, 39.0, False),
        (15.0, 41.0, True),
    ],
)
def test_a_radius_must_be_bounded_within_a_factor_of_two(low, high, is_rejected):
    reason = find_undeterminable_radius_reason(section_of(low, high))
    expected = undeterminable(f"{low:.3g} to {high:.3g} mm (95 %)")
    assert reason == (expected if is_rejected else None)


@pytest.mark.parametrize(
    ("low", "high", "interval"),
    [
        (0.4, 1000.0, "the 95 % interval has no upper end"),
        (15.0, 1000.0, "the 95 % interval from 15 mm has no upper end"),
        (0.4, 30.0, "0 to 30 mm (95 %)"),
    ],
)
def test_an_end_of_the_radius_that_was_not_found_is_not_given_as_a_number(low, high, interval):
    """The limits of an interval are 0.02 and 50 radii."""
    assert find_undeterminable_radius_reason(section_of(low, high)) == undeterminable(interval)


@pytest.mark.parametrize(("seed", "degrees"), [(1, 85), (8, 80)])
def test_the_interval_of_a_short_arc_has_no_upper_end(seed, degrees):
    profile = prepare_profile(Profile(short_arc(seed, degrees)), SENSOR)
    section = fitted(profile, circle(20.0, (0.0, -400.0)))
    reason = find_undeterminable_radius_reason(section)
    assert reason.startswith("radius not determinable: the 95 % interval has no upper end")


@pytest.mark.parametrize("known", [{"known_radius": 20.0}, {"known_phi": 0.0}])
def test_what_is_known_bounds_the_radius(known):
    assert find_undeterminable_radius_reason(section_of(5.0, 100.0, **known)) is None


@pytest.mark.parametrize(
    ("sigmas", "found"),
    [
        (1.5, "20 +/- 13 mm untilted"),
        (2.1, "20 +/- 9.5 mm untilted"),
        (2.3, "5 to 100 mm (95 %)"),
        (5.9, "5 to 100 mm (95 %)"),
        (6.1, None),
        (8.0, None),
    ],
)
def test_a_radius_of_two_to_six_sigma_needs_its_interval(sigmas, found):
    """Only then the interval, which takes time, decides: fewer are too few, more are enough."""
    reason = find_undeterminable_radius_reason(section_of(5.0, 100.0, std=20 / sigmas))
    assert reason == (None if found is None else undeterminable(found))


@pytest.mark.parametrize(("sigmas", "is_rejected"), [(4.2, True), (4.6, False), (9.0, False)])
def test_a_tilt_by_which_a_short_arc_seems_determined_must_not_be_by_chance(sigmas, is_rejected):
    """The untilted cylinder of an arc at 45 deg has twice the radius, and half as many sigmas."""
    section = section_of(15.0, 30.0, std=20 / sigmas, phi=math.pi / 4)
    reason = find_undeterminable_radius_reason(section)
    assert reason == (undeterminable("40 +/- 19 mm untilted") if is_rejected else None)


SENSOR = ProfileSensor(range_std=0.25)


def short_arc(seed, degrees):
    """An arc of a circle of 20 mm under the sensor, with errors along the rays."""
    rng = np.random.default_rng([45, seed])
    points = arc_points(np.linspace(-degrees / 2, degrees / 2, 40), centre=(0.0, -400.0))
    ranges = np.hypot(*points.T)
    return points * (1 + 0.25 * (ranges / 400) ** 2 / ranges * rng.normal(size=40))[:, None]


@pytest.mark.parametrize("sensor", [SENSOR, None], ids=["sensor", "estimated"])
def test_the_radius_of_45_deg_with_noise_is_not_determinable(sensor):
    is_rejected = 0
    for seed in range(12):
        profile = prepare_profile(Profile(short_arc(seed, 45)), sensor)
        start = circle(20.0, (0.0, -400.0))
        reason = find_undeterminable_radius_reason(fitted(profile, start))
        for known in ({"radius": RadiusPrior(20.0)}, {"phi": PhiPrior(0.0)}):
            assert find_undeterminable_radius_reason(fitted(profile, start, **known)) is None
        if reason is not None:
            is_rejected += 1
            assert re.fullmatch(
                r"radius not determinable: (\S+ to \S+ mm \(95 %\)|\S+ \+/- \S+ mm untilted); "
                "a longer arc or a known tilt is needed",
                reason,
            )
    assert is_rejected >= 10


def test_the_radius_of_150_deg_is_determinable():
    for seed in range(5):
        profile = prepare_profile(Profile(short_arc(seed, 150)), SENSOR)
        assert (
            find_undeterminable_radius_reason(fitted(profile, circle(20.0, (0.0, -400.0)))) is None
        )


def test_a_radius_that_needs_no_interval_is_distinguished_from_a_bound_of_its_std():
    for degrees in (60, 100, 160):
        profile = prepare_profile(Profile(short_arc(3, degrees)), SENSOR)
        section = fitted(profile, circle(20.0, (0.0, -400.0)))
        bound = 2 * section.fit.parameter_covariance[2:, 2:].trace()
        assert section.local_radius_std**2 <= bound


def test_points_with_noise_of_their_own_are_judged_by_it():
    """The same residuals are too large for a std of 0.05 mm, but not for one of 0.2 mm."""
    noise = PointNoise(np.tile(0.05**2 * np.eye(2), (71, 1, 1)))
    profile = prepare_profile(Profile(wavy(0.6)), noise)
    section = fitted(profile, circle())
    assert "residual rms" in find_rejection_reason(profile, section, RANGE)
    coarse = PointNoise(np.tile(0.2**2 * np.eye(2), (71, 1, 1)))
    profile = prepare_profile(Profile(wavy(0.6)), coarse)
    assert find_rejection_reason(profile, fitted(profile, circle()), RANGE) is None


@dataclass(frozen=True)
class Found:
    indices: np.ndarray


def spans(*bounds):
    return [Found(np.arange(start, stop)) for start, stop in bounds]


def test_of_two_that_hold_the_same_points_the_larger_stays():
    half, whole = spans((30, 60), (0, 60))
    assert suppress_overlapping([half, whole]) == [whole]


@pytest.mark.parametrize(("common", "both"), [(11, True), (19, True), (21, False), (30, False)])
def test_two_of_which_half_is_common_are_one(common, both):
    left, right = spans((0, 50), (50 - common, 90 - common))
    assert suppress_overlapping([right, left]) == ([left, right] if both else [left])


def test_nothing_is_nothing():
    assert suppress_overlapping([]) == []


@pytest.mark.parametrize(("max_tilt_deg", "ratio_deg"), [(60.0, 70.0), (50.0, 60.0), (85.0, 90.0)])
def test_a_fit_ends_ten_degrees_beyond_the_largest_tilt(max_tilt_deg, ratio_deg):
    settings = AcceptanceSettings(max_tilt_deg=max_tilt_deg)
    expected = math.cos(math.radians(ratio_deg))
    assert settings.min_fitted_axis_ratio == pytest.approx(expected, abs=1e-12)
