"""Numbers beside their sigma."""

import math

import pytest

from lsvision.results.number_format import count_decimals, format_value


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (19.02341, 0.0512, "19.023 ± 0.051"),
        (359.4, 12.3, "359 ± 12"),
        (19022.4, 640.0, "19022 ± 640"),
        (-0.01, 2.0, "0.0 ± 2.0"),
        (19.0, 0.0, "19.0000 ± 0"),
        (19.0, math.inf, "19.0000 ± unknown"),
        (19.0, math.nan, "19.0000 ± unknown"),
        (19.02341, 0.0996, "19.02 ± 0.10"),
        (359.4, 9.96, "359 ± 10"),
        (19.0, 1e-12, "19.000000 ± 0.000000"),
    ],
)
def test_two_digits_of_the_sigma_decide_the_decimals(value, std, text):
    assert format_value(value, std) == text
    assert len(text.split(" ")[0].partition(".")[2]) == count_decimals(std)
