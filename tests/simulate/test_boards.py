"""Boards of a calibration, in random poses that the laser line crosses."""

from dataclasses import replace

import numpy as np
import pytest

from lsvision.simulate.boards import MAX_DRAWS, BoardScene, _draw_crossed_pose, simulate_boards


def test_a_laser_that_crosses_no_board_is_rejected(rng):
    far = replace(BoardScene(), distance=3000.0)  # the laser plane passes 1.5 m above it
    with pytest.raises(ValueError, match=f"got none in {MAX_DRAWS} poses; move the laser"):
        simulate_boards(far, 1, rng=rng)


def test_the_line_crosses_each_board_from_its_first_column_to_its_last(rng):
    scene = BoardScene()
    for _ in range(20):
        _, line = _draw_crossed_pose(scene, rng)
        assert np.ptp(line[:, 0]) == pytest.approx((scene.columns - 1) * scene.square)
