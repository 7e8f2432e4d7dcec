"""Which poses to believe: gross errors by random selections, small ones by leave-one-out.

A wrong pose (paired with another profile, read while the arm still moved) spoils every least
squares over all poses. Random selections of few poses, some of them clean, find the gross ones;
the F test of the residual a pose would have, had it not taken part, finds those of a few
sigma. Always whole poses, never points: a pose is wrong for all its points at once.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.calibrate.adjustment import adjust, lever_whitening
from lsvision.calibrate.noisy_poses import Refined, refine
from lsvision.calibrate.sightings import Sightings, States
from lsvision.shapes import FloatArray

ROUGH_STD = 0.2
"""Robot error assumed while searching. Units: mm."""
GROSS = 5.0
"""Medians of the trusted poses' residuals beyond which a pose is grossly wrong."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OutlierSettings:
    """How poses are doubted.

    Parameters
    ----------
    max_share : float
        Largest share of poses that may be wrong.
    level : float
        Chance of calling a good pose wrong, over all poses of a calibration.
    selection : int
        Poses in a random selection.
    trials : int
        Random selections; 40 of 7 poses find a clean one among 12 with two wrong ones in
        99.8 %.
    seed : int
        Of the selections.
    """

    max_share: float = 0.3
    level: float = 0.01
    selection: int = 7
    trials: int = 40
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Doubted:
    """Solution on the poses that are believed.

    Parameters
    ----------
    refined : Refined
        Its mask says which poses are believed.
    chances : (n,) ndarray
        For poses not believed, the chance of so large a residual in a good one.
    """

    refined: Refined
    chances: FloatArray


def believe_poses(
    sightings: Sightings, settings: OutlierSettings, *, need: int, estimate: bool
) -> Doubted:
    """Solve without a guess and without trusting every pose.

    Parameters
    ----------
    sightings : Sightings
        What was seen.
    settings : OutlierSettings
        See there.
    need : int
        Fewest poses that determine the problem.
    estimate : bool
        See `refine`.

    Returns
    -------
    Doubted
        With the believed poses in `refined.mask`.
    """
    state = _trusted_start(sightings, settings, need)
    mask = _without_gross(sightings, state)
    refined = refine(sightings, state, mask, estimate=estimate)
    refined = _drop_small(sightings, refined, settings, need=need, estimate=estimate)
    refined = _readmit(sightings, refined, settings, estimate=estimate)
    return Doubted(refined, _chances(refined))


def multi_start(sightings: Sightings, mask: FloatArray) -> tuple[States, FloatArray]:
    """Minima from every start over the masked poses, best first, and their costs."""
    masks = mask[None]
    states = sightings.starts(masks)
    found = adjust(sightings, states, lever_whitening(sightings, masks, ROUGH_STD))
    order = np.argsort(found.costs)
    return found.states.taken(order), found.costs[order]


def _trusted_start(sightings: Sightings, settings: OutlierSettings, need: int) -> States:
    """State with the least sum of its smallest pose residuals (least trimmed squares)."""
    count = len(sightings.flanges)
    trusted = max(need, count - int(settings.max_share * count))
    masks = _selections(count, settings, need)
    states = sightings.starts(masks)
    repeated = np.repeat(masks, len(states) // len(masks), axis=0)
    states = adjust(sightings, states, lever_whitening(sightings, repeated, ROUGH_STD), 12).states
    states = states.taken(np.argsort(_trimmed(sightings, states, trusted))[:8])
    for _ in range(4):
        order = np.argsort(_pose_residuals(sightings, states), axis=1)
        masks = np.zeros((len(states), count))
        np.put_along_axis(masks, order[:, :trusted], 1.0, axis=1)
        whitening = lever_whitening(sightings, masks, ROUGH_STD)
        states = adjust(sightings, states, whitening).states
    return states.taken(np.argsort(_trimmed(sightings, states, trusted))[:1])


def _selections(count: int, settings: OutlierSettings, need: int) -> FloatArray:
    """All poses, each left out once where few, and random selections; (q, n) of 0 and 1."""
    rng = np.random.default_rng(settings.seed)
    size = min(max(settings.selection, need), max(count - 1, need))
    rows = [np.ones(count)]
    for _ in range(settings.trials if count > need else 0):
        row = np.zeros(count)
        row[rng.permutation(count)[:size]] = 1.0
        rows.append(row)
    return np.array(rows)


def _pose_residuals(sightings: Sightings, states: States) -> FloatArray:
    """(s, n) length of each pose's residual in rough sigmas."""
    whitening = lever_whitening(sightings, np.ones((1, len(sightings.flanges))), ROUGH_STD)
    white = (whitening @ sightings.linearised(states).residuals[..., None])[..., 0]
    lengths: FloatArray = np.linalg.norm(white, axis=-1)
    return lengths


def _trimmed(sightings: Sightings, states: States, trusted: int) -> FloatArray:
    squares = np.sort(_pose_residuals(sightings, states) ** 2, axis=1)
    total: FloatArray = squares[:, :trusted].sum(axis=1)
    return total


def _without_gross(sightings: Sightings, state: States) -> FloatArray:
    lengths = _pose_residuals(sightings, state)[0]
    # Residuals below a rough sigma are no gross error, however exact the others are.
    limit = GROSS * max(float(np.median(lengths)), 0.4)
    mask: FloatArray = (lengths <= limit).astype(np.float64)
    return mask


def _drop_small(
    sightings: Sightings, refined: Refined, settings: OutlierSettings, *, need: int, estimate: bool
) -> Refined:
    fewest = max(need, int(np.ceil(len(refined.mask) * (1 - settings.max_share))))
    while refined.mask.sum() > fewest:
        chances = np.where(refined.mask > 0, _chances(refined), 1.0)
        worst = int(chances.argmin())
        if chances[worst] * refined.mask.sum() > settings.level:
            break
        mask = refined.mask.copy()
        mask[worst] = 0.0
        refined = refine(sightings, refined.states, mask, estimate=estimate)
    return refined


def _readmit(
    sightings: Sightings, refined: Refined, settings: OutlierSettings, *, estimate: bool
) -> Refined:
    """Take back, best first, poses whose residual a good one could have."""
    while not refined.mask.all():
        chances = np.where(refined.mask > 0, 0.0, _chances(refined))
        best = int(chances.argmax())
        if chances[best] * len(refined.mask) <= settings.level:
            break
        mask = refined.mask.copy()
        mask[best] = 1.0
        refined = refine(sightings, refined.states, mask, estimate=estimate)
    return refined


def _chances(refined: Refined) -> FloatArray:
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
