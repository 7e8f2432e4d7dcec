"""Lost points written as zeros near heights of 20 to 70 mm: read as lost if sure, else reported."""

import numpy as np
import pytest

from lsvision.io.profiles import inspect_profiles

NOTE = "apart from all others: read as points (use --lost 0"
X = np.linspace(-25, 25, 300)


def heights(seed, low=20.0):
    """A pipe on a floor at the height `low`; the zeros are up to two spans from it."""
    pipe = low - 4 + np.sqrt(np.maximum(16.0**2 - X**2, 0))
    noise = np.random.default_rng(seed).normal(0, 0.03, len(X))
    return np.where(np.abs(X) < 15, np.maximum(pipe, low), low) + noise


def read(tmp_path, z, **options):
    path = tmp_path / "zeros.csv"
    np.savetxt(path, np.column_stack([X, z]), fmt="%.3f", delimiter=",")
    return inspect_profiles(path, **options)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(3))
def test_zeros_that_interrupt_the_surface_are_lost_points(tmp_path, seed, sign):
    z, lost = sign * heights(seed), np.random.default_rng(seed).random(len(X)) < 0.06
    z[lost] = 0.0
    file = read(tmp_path, z)
    np.testing.assert_array_equal(np.isnan(file.profiles[0].points[:, 1]), lost)
    assert any("0 occurs in" in note and "--lost none" in note for note in file.notes)


@pytest.mark.parametrize("at", [slice(0, 40), slice(100, 140), slice(260, 300)])
def test_other_zeros_are_noted(tmp_path, at):
    z = heights(5)
    z[at] = 0.0
    file = read(tmp_path, z)
    assert file.lost == 0
    assert any(NOTE in note and "0 in 40 points" in note for note in file.notes)
    stated = read(tmp_path, z, lost=0.0)
    assert stated.lost == 40
    assert not stated.notes


def test_a_floor_at_zero_between_pipes_is_kept(tmp_path):
    z = np.zeros(len(X))
    for centre in (-18, -9, 0, 9, 18):
        near = np.abs(X - centre) < 3.5
        z[near] = 3.5 + np.sqrt(3.5**2 - (X[near] - centre) ** 2)
    file = read(tmp_path, z)
    assert file.lost == 0


def test_a_measured_floor_near_zero_is_not_noted(tmp_path):
    assert not read(tmp_path, heights(4, low=0.0)).notes
