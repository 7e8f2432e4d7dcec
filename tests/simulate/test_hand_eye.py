"""Simulated profiles of hand-eye targets in degenerate views."""

import pytest

from lsvision.geometry import Plane
from lsvision.simulate.hand_eye import SectionView, simulate_plane_profile, simulate_sphere_profile


@pytest.mark.parametrize("distance", [0.0, 5.0])
def test_a_plane_parallel_to_the_section_is_not_measured(distance, rng):
    profile = simulate_plane_profile(Plane((0.0, 0.0, 1.0), distance), SectionView(), rng)
    assert profile.lost == len(profile) == SectionView().columns


def test_correlated_noise_of_a_profile_shorter_than_its_filter(rng):
    view = SectionView(columns=3, width=6.0, correlation=2.0)
    assert simulate_sphere_profile((0.0, -300.0, 0.0), 50.0, view, rng).lost == 0
