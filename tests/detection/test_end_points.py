"""The posterior of the points at an end, against slow formulas that are written out here.

The constants of the model stand here once more as plain numbers: a changed one is a failed test.
"""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from lsvision.detection.end_points import EndInliers, EndPoints, Prediction
from lsvision.detection.end_points import (
    compute_departure_free_probability as departure_free_probabilities,
)
from lsvision.detection.end_points import find_end_inliers as find_inliers_of_ends

OUTLIERS = 0.05
SEEDS = range(12)
MATCHES = 1e-3  # an excluded jump of 100 sigma keeps 1e-6 of its weight: 1e-4 sigma of the ellipse


def stacked(ends):
    """Stack ends, or their predictions."""
    return type(ends[0])(*(np.stack(field) for field in zip(*ends, strict=True)))


def find_end_inliers(end, prediction):
    """Positions, log odds and leverages of the inliers of one end."""
    members, *others = (
        field[0] for field in find_inliers_of_ends(stacked([end]), stacked([prediction]))
    )
    return EndInliers(np.flatnonzero(members), *(field[members] for field in others))


def compute_departure_free_probability(end, prediction, members, following):
    """Probability for each position of `members` of one end."""
    masks = np.zeros((2, 1, len(end.residuals) - 2), dtype=bool)
    masks[0, 0, members] = masks[1, 0, following] = True
    ends = stacked([end]), stacked([prediction])
    return departure_free_probabilities(*ends, *masks)[0][members]


def circle_end(rng, count=24, *, radius=20.0, std=0.05, start_deg=40.0, step_deg=1.5, time=1.0):
    """Return the points of a circle beyond `start_deg` from its top, and the fit of the others."""
    inner = np.radians(np.linspace(-start_deg, start_deg, 60))
    known = rows_of(inner) / std**2 @ rows_of(inner).T + np.diag([0, 0, 0, 1.0, 1.0])
    angles = math.radians(start_deg) + np.radians(step_deg) * np.arange(-2, count)
    angles[2:] += np.radians(step_deg) * np.cumsum(rng.uniform(0, 1.5, count))  # uneven steps
    offset = rng.multivariate_normal(np.zeros(5), np.linalg.inv(known))
    rows = rows_of(angles)
    variances = std**2 * rng.uniform(0.5, 2.0, len(angles))
    residuals = np.sqrt(variances) * rng.normal(size=len(angles))
    cosines = rng.uniform(0.06, 1.0, len(angles))
    end = EndPoints(residuals, variances, rows, cosines, radius * (angles - angles[0]))
    return end, Prediction(offset, np.linalg.inv(known), time, radius)


def rows_of(angles):
    """Derivative of the distance from a circle by centre_x, centre_y, m, p and q."""
    return np.array([np.sin(angles), np.cos(angles), np.ones(len(angles)),
                     -np.cos(2 * angles), np.sin(2 * angles)])  # fmt: skip


def spoiled(rng, end, *, jumps=0.15, leaves_at=None):
    """Return the end with jumps, points that face away, and a line that leaves the circle."""
    residuals, cosines = end.residuals.copy(), end.incidence_cosines.copy()
    jump = rng.random(len(residuals)) < jumps
    jump[:2] = False
    residuals[jump] += rng.choice([-1, 1], jump.sum()) * rng.uniform(0.2, 5, jump.sum())
    if leaves_at is not None:
        beyond = np.maximum(end.positions - end.positions[leaves_at + 1], 0.0)
        residuals += 0.4 * beyond + 0.03 * beyond**2
    cosines[-3:] = rng.choice([-1.0, 0.04, 0.06, 1.0], 3)
    return end._replace(residuals=residuals, incidence_cosines=cosines)


def kalman_oracle(end, prediction):
    """Plain Kalman filter, point after point: members, log odds and leverages."""
    offset, covariance, time, radius = prediction
    state, own_covariance = offset.copy(), covariance.copy()
    cumulated, largest, gains, odds, totals = 0.0, 0.0, [], [], []
    for i in range(2, len(end.residuals)):
        h, v = end.jacobian[:, i], end.variances[i]
        log_outlier = outlier_density(end, i, radius)
        prior = log_in(end.residuals[i] - h @ offset, v + h @ covariance @ h)
        innovation = end.residuals[i] - h @ state
        s = h @ own_covariance @ h
        seen = end.incidence_cosines[i] > 0.05
        inlier = log_in(innovation, s + v) if seen else -math.inf
        odds.append(inlier - log_outlier)
        totals.append((s + v) / v)
        cumulated += (np.logaddexp(inlier, log_outlier) - other_line(end, i, radius)) / time
        gains.append(cumulated)
        largest = max(largest, cumulated)
        if seen and prior > log_outlier:
            gain = own_covariance @ h / (s + time * v)
            state = state + gain * innovation
            own_covariance = own_covariance - np.outer(gain, h @ own_covariance)
    good = [value > 0 for value in odds]
    ends = [i for i, g in enumerate(gains) if g >= largest - math.log(20) and good[i]]
    members = [i for i in range(ends[-1] + 1 if ends else 0) if good[i]]
    return members, [odds[i] for i in members], [totals[i] for i in members]


def log_in(residual, variance):
    return math.log(1 - OUTLIERS) + norm.logpdf(residual, scale=math.sqrt(variance))


def outlier_density(end, i, radius):
    """Return the log density of an outlier: an error of up to a radius along the ray."""
    return math.log(OUTLIERS / (2 * radius * max(end.incidence_cosines[i], 0.05)))


def other_line(end, i, radius):
    """Return the log density of a point on the line through the two before, or of an outlier."""
    (e0, e1, e2), (v0, v1, v2) = end.residuals[i - 2 : i + 1], end.variances[i - 2 : i + 1]
    before, step = np.diff(end.positions[i - 2 : i + 1])
    ratio = min(step / before, 5.0)
    bend = step * (step + before) / 2 / radius
    variance = v2 + v1 * (1 + ratio) ** 2 + v0 * ratio**2 + bend**2
    return np.logaddexp(
        log_in(e2 - e1 - ratio * (e1 - e0), variance), outlier_density(end, i, radius)
    )


def assert_same_inliers(end, prediction):
    members, log_odds, leverages = kalman_oracle(end, prediction)
    found = find_end_inliers(end, prediction)
    np.testing.assert_array_equal(found.members, members)
    np.testing.assert_allclose(found.log_odds, log_odds, rtol=MATCHES, atol=MATCHES)
    np.testing.assert_allclose(found.leverages, leverages, rtol=MATCHES)
    return members


@pytest.mark.parametrize("time", [1.0, 2.7])
@pytest.mark.parametrize("leaves_at", [None, 3, 9, 15])
@pytest.mark.parametrize("seed", SEEDS)
def test_inliers_are_those_of_a_plain_kalman_filter(seed, leaves_at, time):
    rng = np.random.default_rng([seed, leaves_at or 0])
    end, prediction = circle_end(rng, time=time)
    assert_same_inliers(spoiled(rng, end, leaves_at=leaves_at), prediction)


@pytest.mark.parametrize("scale", [1.0, 1e9])
def test_points_at_one_position_of_the_ellipse_are_judged_without_breaking(scale):
    end, prediction = circle_end(np.random.default_rng(3))
    positions = scale * end.positions
    positions[4:7] = positions[4]
    found = find_end_inliers(end._replace(positions=positions), prediction)
    assert np.isfinite(found.log_odds).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_inliers_of_a_coarse_and_quiet_line_are_those_of_the_filter_as_well(seed):
    """The other line may be as curved as the circle, which is seen where steps are long."""
    rng = np.random.default_rng([72, seed])
    end, prediction = circle_end(rng, std=0.003, step_deg=3.0, count=16)
    beyond = np.maximum(end.positions - end.positions[10], 0.0)
    residuals = end.residuals + rng.uniform(0, 1 / 20) * beyond**2 / 2
    assert_same_inliers(end._replace(residuals=residuals), prediction)


# Of 200 seeds those where a limit of 6.5 or of 3.5 steps would choose another end.
@pytest.mark.parametrize("seed", [6, 48, 73, 75, 83, 98, 104, 143, 153, 189])
def test_behind_a_gap_the_other_line_is_extrapolated_over_five_steps_at_the_most(seed):
    rng = np.random.default_rng([71, seed])
    end, prediction = circle_end(rng, count=14, step_deg=0.3)
    gaps = np.zeros(16)
    gaps[5::3] = 1.0
    leaving = rng.uniform(0, 0.08) * np.maximum(np.arange(16) - 8, 0.0)
    end = end._replace(positions=end.positions + gaps.cumsum(), residuals=end.residuals + leaving)
    assert_same_inliers(end, prediction)


def test_no_points_beyond_have_no_inliers(rng):
    end, prediction = circle_end(rng, count=0)
    found = find_end_inliers(end, prediction)
    assert [len(part) for part in found] == [0, 0, 0]


def certain(residuals, *, std=1.0, radius=100.0, positions=None, cosines=1.0):
    """Return an end and an exact prediction: each point is judged by its own residual alone."""
    residuals = np.concatenate([[0.0, 0.0], residuals])
    count = len(residuals)
    steps = np.arange(count, dtype=float) if positions is None else np.asarray(positions, float)
    rows = rows_of(np.linspace(0.5, 1.0, count))
    end = EndPoints(residuals, np.full(count, std**2), rows, np.broadcast_to(cosines, count), steps)
    return end, Prediction(np.zeros(5), np.zeros((5, 5)), 1.0, radius)


def largest_inlier(std, radius, cosine=1.0):
    """Residual at which both densities are alike, .95 N(e; 0, std^2) = .05 / (2 radius cosine)."""
    width = 2 * radius * cosine
    return std * math.sqrt(2 * math.log(0.95 / 0.05 * width / (std * math.sqrt(2 * math.pi))))


@pytest.mark.parametrize(("std", "radius"), [(0.02, 5.0), (0.1, 30.0), (1.0, 100.0)])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("cosine", [1.0, 0.2])
def test_an_outlier_lies_where_the_flat_density_is_higher(std, radius, sign, cosine):
    limit = largest_inlier(std, radius, cosine)
    for share, expected in ((0.999, [0, 1, 2, 3]), (1.001, [0, 1, 3])):
        residuals = [0, 0, sign * share * limit, 0]
        end, prediction = certain(residuals, std=std, radius=radius, cosines=cosine)
        np.testing.assert_array_equal(find_end_inliers(end, prediction).members, expected)


def test_the_odds_are_the_ratio_of_the_densities():
    end, prediction = certain([0.0, 1.5], std=1.0, radius=100.0)
    odds = np.exp(find_end_inliers(end, prediction).log_odds)
    flat = 0.05 / 200
    assert odds[0] == pytest.approx(0.95 * 0.3989423 / flat, rel=1e-6)
    assert odds[1] == pytest.approx(0.95 * 0.3989423 * math.exp(-(1.5**2) / 2) / flat, rel=1e-6)


def test_a_point_that_the_sensor_cannot_see_is_no_inlier():
    end, prediction = certain([0, 0, 0, 0], cosines=[1, 1, 1, 0.051, 0.049, -1])
    np.testing.assert_array_equal(find_end_inliers(end, prediction).members, [0, 1])


def test_the_correlation_of_errors_delays_the_end():
    """Many points detect a line that leaves slowly; correlated points count as fewer."""
    leaving = np.concatenate([np.zeros(6), 0.8 * np.arange(1, 9)])
    end, prediction = certain(leaving, std=1.0, radius=1e4)
    last = [
        find_end_inliers(end, prediction._replace(autocorrelation_time=time)).members[-1]
        for time in (1.0, 4.0)
    ]
    assert last[0] < last[1]


def departure_oracle(end, prediction, members, following):
    """Return the probabilities from the full covariance with each departure."""
    members, following = list(members), list(following)[:8]
    rows = np.array(members + following) + 2
    offset, covariance, time, radius = prediction
    jacobian = end.jacobian[:, rows]
    residuals = end.residuals[rows] - offset @ jacobian
    base = jacobian.T @ covariance @ jacobian + np.diag(time * end.variances[rows])
    first = max(0, len(members) - 8)
    before = np.concatenate([[end.positions[1]], end.positions[rows]])
    onsets = list(range(first, len(rows)))
    likelihoods = []
    for onset in onsets:
        beyond = np.maximum(end.positions[rows] - before[onset], 0.0)
        turn, bend = 0.5 * beyond, 2.0 * beyond**2 / (2 * radius)
        total = base + np.outer(turn, turn) + np.outer(bend, bend)
        likelihoods.append(multivariate_normal(cov=total).logpdf(residuals))
    none = multivariate_normal(cov=base).logpdf(residuals)
    weights = 0.5 / len(onsets) * np.exp(np.array(likelihoods) - none)
    total = weights.sum() + 0.5
    return [
        (0.5 + sum(w for w, onset in zip(weights, onsets, strict=True) if onset > i)) / total
        for i in range(len(members))
    ]


@pytest.mark.parametrize("time", [1.0, 2.2])
@pytest.mark.parametrize("count", [5, 26])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_departure_is_as_likely_as_full_covariances_say(seed, count, time):
    rng = np.random.default_rng([5, seed, count])
    end, prediction = circle_end(rng, count=count + 10, time=time, step_deg=0.4)
    # As weld beads leave: so gently that the point where they do is not known.
    start = end.positions[count - 2]
    foot = rng.uniform(0, 0.06) * np.maximum(end.positions - start, 0.0) ** 2
    end = end._replace(residuals=end.residuals + foot)
    members = np.flatnonzero(rng.random(count) > 0.1)
    following = count + np.arange(min(seed, 8))
    probability = compute_departure_free_probability(end, prediction, members, following)
    expected = departure_oracle(end, prediction, members, following)
    np.testing.assert_allclose(probability, expected, rtol=1e-6, atol=1e-9)


def test_a_line_that_goes_on_as_it_should_has_most_likely_not_departed():
    end, prediction = certain(np.zeros(20), std=0.05, radius=20.0)
    probability = compute_departure_free_probability(
        end, prediction, np.arange(12), np.arange(12, 20)
    )
    assert probability.min() > 0.9


def test_what_follows_shows_that_the_last_inliers_have_left_already():
    beyond = np.maximum(np.arange(-8.0, 10.0), 0.0)
    end, prediction = certain(0.03 * beyond**2, std=0.05, radius=20.0)
    members, following = np.arange(12), np.arange(12, 18)
    alone = compute_departure_free_probability(end, prediction, members[:10], members[:0])
    followed = compute_departure_free_probability(end, prediction, members, following)
    assert alone[9] > 0.5
    assert followed[9] < 0.5
    assert followed[:7].min() > 0.99  # the eighth point is the first that has left
    assert (np.diff(followed) <= 1e-12).all()
