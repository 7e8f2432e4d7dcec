"""Limits of the checks of a hand-eye calibration."""

import numpy as np
import pytest

from lsvision.calibration.hand_eye_checks import BoardScale, is_wrong_scale
from lsvision.errors import CalibrationFailed

STD = 0.01


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_scale_is_wrong_from_four_standard_deviations_on(sign):
    assert not is_wrong_scale((1 + sign * 3.5 * STD, STD), min_error=0.0)
    assert is_wrong_scale((1 + sign * 4.5 * STD, STD), min_error=0.0)
    assert not is_wrong_scale((1 + sign * 4.5 * STD, STD), min_error=0.05)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_board_is_rejected_from_a_size_of_two_percent_off_on(sign):
    BoardScale(1 + sign * 0.018, 1e-4, np.zeros(6)).require_plausible()
    with pytest.raises(CalibrationFailed, match="size of the board must be multiplied by"):
        BoardScale(1 + sign * 0.022, 1e-4, np.zeros(6)).require_plausible()


def test_a_size_that_is_hardly_determined_is_not_rejected():
    BoardScale(1.05, 0.02, np.zeros(6)).require_plausible()
