"""Overflows and singular matrices give clear error messages."""

import numpy as np
import pytest

from lsvision.errors import FitFailed
from lsvision.statistics.numerical_failures import report_numerical_failure, require_finite


@pytest.mark.parametrize(
    "failing",
    [
        lambda: np.linalg.inv(np.zeros((2, 2))),
        lambda: (1e200) ** 2,
        lambda: 1 / 0,
        lambda: np.linalg.svd(np.full((2, 2), np.nan)),
    ],
    ids=["singular", "overflow", "division", "nan"],
)
def test_a_numerical_failure_is_a_fit_that_failed(failing):
    with (
        pytest.raises(FitFailed, match=r"a tube cannot be fitted to the points .*check the units"),
        report_numerical_failure("a tube"),
    ):
        failing()


def test_what_is_silent_within_is_found_by_its_numbers():
    with report_numerical_failure("a tube"):
        square = np.array([1e200]) ** 2
    require_finite("a tube", 1.0, [2.0])
    with pytest.raises(FitFailed, match="its numbers are not finite"):
        require_finite("a tube", 1.0, square)
