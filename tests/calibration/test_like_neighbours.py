"""How many points say as much as one: against the spectrum that made the noise."""

import numpy as np
import pytest

from lsvision.calibration.autocorrelation import autocorrelation_time

COUNT, RUNS = 400, 60
ROUGHLY = 0.15  # of the mean over 60 runs; a single one is off by a third


def fitted_noise(length, seed):
    """Decaying noise of unit variance, a parabola taken out as a fit would."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-1 / length) if length else 0.0
    noise, last = np.empty(COUNT), rng.normal()
    for index, step in enumerate(rng.normal(size=COUNT)):
        last = keep * last + np.sqrt(1 - keep**2) * step
        noise[index] = last
    x = np.linspace(-1, 1, COUNT)
    return noise - np.polyval(np.polyfit(x, noise, 2), x)


@pytest.mark.parametrize("length", [0, 2, 5])
def test_decaying_errors_are_counted_as_their_theory_says(length):
    keep = np.exp(-1 / length) if length else 0.0
    truth = (1 + keep) / (1 - keep)
    found = [autocorrelation_time(fitted_noise(length, seed), 3) for seed in range(RUNS)]
    assert np.mean(found) == pytest.approx(truth, rel=ROUGHLY)


def test_exact_points_and_alternating_ones_count_each():
    assert autocorrelation_time(np.zeros(50), 3) == 1.0
    assert autocorrelation_time(np.tile([1.0, -1.0], 40), 3) == 1.0
