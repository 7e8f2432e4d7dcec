"""Which poses to believe: gross errors by random selections, small ones by leave-one-out.

A wrong pose (paired with another profile, read while the arm still moved) spoils every least
squares over all poses. Random selections of few poses, some of them clean, find the gross ones;
the F test of the residual a pose would have, had it not taken part, finds those of a few
sigma. Always whole poses, never points: a pose is wrong for all its points at once.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.calibration.batched_least_squares import search_whitening, solve_least_squares
from lsvision.calibration.errors_in_variables import ErrorsInVariablesFit, fit_errors_in_variables
from lsvision.calibration.observations import Observations, States
from lsvision.geometry import FloatArray

SEARCH_ROBOT_STD_MM = 0.2
"""Robot error assumed while searching. Units: mm."""
GROSS_OUTLIER_FACTOR = 5.0
"""Medians of the trusted poses' residuals beyond which a pose is grossly wrong."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OutlierSettings:
    """How poses are doubted.

    Parameters
    ----------
    max_outlier_fraction : float
        Largest share of poses that may be wrong.
    significance : float
        Chance of calling a good pose wrong, over all poses of a calibration.
    sample_size : int
        Poses in a random selection.
    trials : int
        Random selections; 40 of 7 poses find a clean one among 12 with two wrong ones in
        99.8 %.
    seed : int
        Of the selections.
    """

    max_outlier_fraction: float = 0.3
    significance: float = 0.01
    sample_size: int = 7
    trials: int = 40
    seed: int = 0


@dataclass(frozen=True, eq=False)
class RobustHandEyeFit:
    """Solution on the poses that are believed.

    Parameters
    ----------
    fit : ErrorsInVariablesFit
        Its mask says which poses are believed.
    outlier_p_values : (n,) ndarray
        For poses not believed, the chance of so large a residual in a good one.
    """

    fit: ErrorsInVariablesFit
    outlier_p_values: FloatArray


def fit_with_outlier_rejection(
    sightings: Observations, settings: OutlierSettings, *, min_poses: int, estimate_robot_std: bool
) -> RobustHandEyeFit:
    """Solve without a guess and without trusting every pose.

    Parameters
    ----------
    sightings : Observations
        What was seen.
    settings : OutlierSettings
        See there.
    min_poses : int
        Fewest poses that determine the problem.
    estimate_robot_std : bool
        See `fit_errors_in_variables`.

    Returns
    -------
    RobustHandEyeFit
        With the believed poses in `fit.mask`.
    """
    state = _least_trimmed_squares_guess(sightings, settings, min_poses)
    mask = _reject_gross_outliers(sightings, state)
    refined = fit_errors_in_variables(sightings, state, mask, estimate_robot_std=estimate_robot_std)
    refined = _reject_outliers(
        sightings, refined, settings, need=min_poses, estimate=estimate_robot_std
    )
    refined = _restore_inliers(sightings, refined, settings, estimate=estimate_robot_std)
    return RobustHandEyeFit(refined, _outlier_p_values(refined))


def multi_start(sightings: Observations, mask: FloatArray) -> tuple[States, FloatArray]:
    """Minima from every start over the masked poses, best first, and their costs."""
    masks = mask[None]
    states = sightings.initial_guesses(masks)
    found = solve_least_squares(
        sightings, states, search_whitening(sightings, masks, SEARCH_ROBOT_STD_MM)
    )
    order = np.argsort(found.costs)
    return found.states.select(order), found.costs[order]


def _least_trimmed_squares_guess(
    sightings: Observations, settings: OutlierSettings, need: int
) -> States:
    """State with the least sum of its smallest pose residuals (least trimmed squares)."""
    count = len(sightings.flanges)
    trusted = max(need, count - int(settings.max_outlier_fraction * count))
    masks = _selections(count, settings, need)
    states = sightings.initial_guesses(masks)
    repeated = np.repeat(masks, len(states) // len(masks), axis=0)
    states = solve_least_squares(
        sightings, states, search_whitening(sightings, repeated, SEARCH_ROBOT_STD_MM), 12
    ).states
    states = states.select(np.argsort(_trimmed_inliers(sightings, states, trusted))[:8])
    for _ in range(4):
        order = np.argsort(_pose_residuals(sightings, states), axis=1)
        masks = np.zeros((len(states), count))
        np.put_along_axis(masks, order[:, :trusted], 1.0, axis=1)
        whitening = search_whitening(sightings, masks, SEARCH_ROBOT_STD_MM)
        states = solve_least_squares(sightings, states, whitening).states
    return states.select(np.argsort(_trimmed_inliers(sightings, states, trusted))[:1])


def _selections(count: int, settings: OutlierSettings, need: int) -> FloatArray:
    """All poses, each left out once where few, and random selections; (q, n) of 0 and 1."""
    rng = np.random.default_rng(settings.seed)
    size = min(max(settings.sample_size, need), max(count - 1, need))
    rows = [np.ones(count)]
    for _ in range(settings.trials if count > need else 0):
        row = np.zeros(count)
        row[rng.permutation(count)[:size]] = 1.0
        rows.append(row)
    return np.array(rows)


def _pose_residuals(sightings: Observations, states: States) -> FloatArray:
    """(s, n) length of each pose's residual in rough sigmas."""
    whitening = search_whitening(
        sightings, np.ones((1, len(sightings.flanges))), SEARCH_ROBOT_STD_MM
    )
    white = (whitening @ sightings.linearise(states).residuals[..., None])[..., 0]
    lengths: FloatArray = np.linalg.norm(white, axis=-1)
    return lengths


def _trimmed_inliers(sightings: Observations, states: States, trusted: int) -> FloatArray:
    squares = np.sort(_pose_residuals(sightings, states) ** 2, axis=1)
    total: FloatArray = squares[:, :trusted].sum(axis=1)
    return total


def _reject_gross_outliers(sightings: Observations, state: States) -> FloatArray:
    lengths = _pose_residuals(sightings, state)[0]
    # Residuals below a rough sigma are no gross error, however exact the others are.
    limit = GROSS_OUTLIER_FACTOR * max(float(np.median(lengths)), 0.4)
    mask: FloatArray = (lengths <= limit).astype(np.float64)
    return mask


def _reject_outliers(
    sightings: Observations,
    refined: ErrorsInVariablesFit,
    settings: OutlierSettings,
    *,
    need: int,
    estimate: bool,
) -> ErrorsInVariablesFit:
    fewest = max(need, int(np.ceil(len(refined.mask) * (1 - settings.max_outlier_fraction))))
    while refined.mask.sum() > fewest:
        chances = np.where(refined.mask > 0, _outlier_p_values(refined), 1.0)
        worst = int(chances.argmin())
        if chances[worst] * refined.mask.sum() > settings.significance:
            break
        mask = refined.mask.copy()
        mask[worst] = 0.0
        refined = fit_errors_in_variables(
            sightings, refined.states, mask, estimate_robot_std=estimate
        )
    return refined


def _restore_inliers(
    sightings: Observations,
    refined: ErrorsInVariablesFit,
    settings: OutlierSettings,
    *,
    estimate: bool,
) -> ErrorsInVariablesFit:
    """Take back, best first, poses whose residual a good one could have."""
    while not refined.mask.all():
        chances = np.where(refined.mask > 0, 0.0, _outlier_p_values(refined))
        best = int(chances.argmax())
        if chances[best] * len(refined.mask) <= settings.significance:
            break
        mask = refined.mask.copy()
        mask[best] = 1.0
        refined = fit_errors_in_variables(
            sightings, refined.states, mask, estimate_robot_std=estimate
        )
    return refined


def _outlier_p_values(refined: ErrorsInVariablesFit) -> FloatArray:
    """Chance of so large a residual in a good pose, by the F test of leaving it out."""
    from scipy.special import fdtrc

    size = refined.residuals.shape[1]
    r, counted = refined.residuals[..., None], refined.mask > 0
    inside = np.linalg.solve(refined.redundancy + 1e-12 * np.eye(size), r)
    spread = refined.jacobian @ refined.cofactors @ np.swapaxes(refined.jacobian, -1, -2)
    outside = np.linalg.solve(np.eye(size) + spread, r)
    drop = (r * np.where(counted[:, None, None], inside, outside)).sum(axis=(1, 2))
    rest = np.where(counted, refined.chi2 - drop, refined.chi2)
    dof = np.where(counted, refined.dof - size, refined.dof)
    safe = np.maximum(dof, 1)
    ratio = (drop / size) / np.maximum(rest / safe, 1e-6)
    chances: FloatArray = np.where(dof > 0, fdtrc(size, safe, np.maximum(ratio, 0.0)), 1.0)
    return chances
