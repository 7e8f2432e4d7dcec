"""Lost points written as zeros or another height of the profile: lost if sure, else noted."""

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


@pytest.mark.parametrize("marker", [0.0, -1.0, 5.0])
@pytest.mark.parametrize("share", [0.05, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_a_marker_within_the_heights_interrupts_the_surface(tmp_path, seed, share, marker):
    z, lost = heights(seed, low=-8.0), np.random.default_rng(seed).random(len(X)) < share
    z[lost] = marker
    file = read(tmp_path, z)
    found = np.isnan(file.profiles[0].points[:, 1])
    assert found[lost].all()
    assert np.abs(heights(seed, low=-8.0)[found & ~lost] - marker).max(initial=0.0) < 1e-3
    assert any(f"{marker:g} occurs in" in note and "interrupts the" in note for note in file.notes)
    assert read(tmp_path, z, lost="none").lost == 0


@pytest.mark.parametrize("low", [-2.0, -8.0])
@pytest.mark.parametrize("marker", [0.0, -1.0, 60.0])
@pytest.mark.parametrize("at", [slice(0, 40), slice(260, 300)])
def test_a_height_that_none_else_has_so_often_is_noted(tmp_path, at, marker, low):
    z = heights(7, low=low)
    z[at] = marker
    file = read(tmp_path, z)
    possible_notes = [f"the height is {marker:g} in 40 points", f"{marker:g} occurs in 40 points"]
    assert any(text in note for note in file.notes for text in possible_notes)
    assert read(tmp_path, z, lost=marker).lost == 40


@pytest.mark.parametrize("decimals", [3, 2])
def test_a_run_of_equal_heights_is_noted(tmp_path, decimals):
    z = np.round(heights(7, low=-0.02), decimals)
    z[20:50] = 0.0
    assert any("the height is 0 in" in note for note in read(tmp_path, z).notes)


@pytest.mark.parametrize("decimals", [4, 2, 1])
@pytest.mark.parametrize("shape", ["thread", "slots", "wires", "rough"])
def test_regular_objects_have_no_markers(tmp_path, shape, decimals):
    random = np.random.default_rng(decimals)
    z = {
        "thread": np.abs((X / 1.5) % 1 - 0.5) * 1.7,
        "slots": np.where(X % 3 < 0.5, -5.0, 0.0) + 0.002 * X**2,
        "wires": np.where(X % 5 < 0.6, 1.0, 0.0),
        "rough": 0.05 * random.standard_t(2, len(X)),
    }[shape] + random.normal(0, 0.02, len(X))
    assert read(tmp_path, np.round(z, decimals)).lost == 0


def test_a_flat_floor_with_noise_is_not_noted(tmp_path):
    for low in (0.0, -8.0):
        for decimals in (3, 2):
            assert not read(tmp_path, np.round(heights(9, low=low), decimals)).notes
