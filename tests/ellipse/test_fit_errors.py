"""Points without an ellipse are rejected with a message, whatever overflows on the way."""

import numpy as np
import pytest

from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.errors import FitFailed
from lsvision.geometry import Ellipse

START = Ellipse((0.0, -400.0), 22.0, 20.0, 0.3)
ARC = START.points_at(np.linspace(0.2, 2.8, 40))
ALIKE = np.tile(np.eye(2) * 0.01, (40, 1, 1))


@pytest.mark.parametrize(
    ("points", "covariances", "message"),
    [
        (ARC[:, 0], None, r"expected points of shape \(n, 2\), got \(40,\)"),
        (np.where(ARC > 0, np.nan, ARC), None, "expected finite coordinates"),
        (ARC * 1e12, None, r"expected finite coordinates within 1e\+09 mm"),
        (ARC, ALIKE[:9], r"expected covariances of shape \(40, 2, 2\)"),
        (ARC, ALIKE * np.nan, r"expected finite covariances up to 1e\+18 mm\^2, got nan"),
        (ARC, ALIKE * 1e30, "expected finite covariances"),
        (ARC, -ALIKE, "expected symmetric positive semi-definite covariances other than zero"),
        (ARC, 0 * ALIKE, "expected symmetric positive semi-definite covariances other than zero"),
        (ARC, ALIKE + np.eye(2, k=1), "expected symmetric positive semi-definite covariances"),
    ],
)
def test_arrays_that_are_no_points_are_a_value_error(points, covariances, message):
    with pytest.raises(ValueError, match=message):
        fit_ellipse(points, START, covariances)


def test_an_overflow_is_a_fit_that_failed():
    huge = Ellipse((1e200, 0.0), 1e200, 1e190, 0.0)
    with pytest.raises(FitFailed):
        fit_ellipse(ARC, huge, ALIKE)


@pytest.mark.parametrize("wrong", [{"residual": "radail"}, {"variance": "known"}])
def test_an_unknown_option_of_the_fit_is_a_value_error(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=f"expected {name} '.*' or '.*', got "):
        FittingSettings(**wrong)
