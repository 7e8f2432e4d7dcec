"""Numbers as text, with the digits that their standard deviation justifies."""

import math
import re
from collections.abc import Sequence

DEFAULT_DECIMALS = 4
"""Decimals of a number without std, such as a radius known exactly."""
MAX_DECIMALS = 6
"""Largest number of decimals of a number with std."""

_HYPHEN_MINUS = re.compile(r"(?<![\w.)])-(?=\.?\d)")
"""Hyphen before a number, but not directly after a number, a word or a closing parenthesis."""


def with_minus_signs(text: str) -> str:
    """Return a text in which the hyphen before a number is a minus sign, as wide as a plus.

    Examples
    --------
    >>> with_minus_signs("centre (-4.22, -450.08) mm, X-ray 3-5")
    'centre (−4.22, −450.08) mm, X-ray 3-5'
    """
    return _HYPHEN_MINUS.sub("\N{MINUS SIGN}", text)


def format_value(value: float, std: float) -> str:
    """Return a number with the decimals of `count_decimals`, and its std as by `format_std`.

    Examples
    --------
    >>> format_value(19.0234, 0.0512), format_value(359.4, 12.3), format_value(-0.01, 2.0)
    ('19.023 ± 0.051', '359 ± 12', '0.0 ± 2.0')
    """
    return f"{value:z.{count_decimals(std)}f} ± {format_std(std)}"


def format_std(std: float) -> str:
    """Return a std with the decimals of `count_decimals`; "0" for 0, "unknown" if not finite.

    Examples
    --------
    >>> format_std(0.0499), format_std(12.3), format_std(math.inf)
    ('0.050', '12', 'unknown')
    """
    if std == 0:
        return "0"
    return f"{std:.{count_decimals(std)}f}" if math.isfinite(std) else "unknown"


def count_decimals(std: float) -> int:
    """Return the number of decimals that shows two digits of a std.

    It is 0 from a std of 10 on, at most `MAX_DECIMALS`, and `DEFAULT_DECIMALS` for a std that is 0
    or not finite.
    """
    if not (math.isfinite(std) and std > 0):
        return DEFAULT_DECIMALS
    exponent = int(f"{std:.1e}".partition("e")[2])  # after rounding: 0.0996 is 0.10
    return min(max(1 - exponent, 0), MAX_DECIMALS)


def format_ranges(sections: Sequence[int]) -> str:
    """Return ascending indices as text, with consecutive ones as ranges.

    Examples
    --------
    >>> format_ranges((0, 1, 2, 3, 4, 7))
    '0-4, 7'
    """
    runs: list[list[int]] = []
    for section in sections:
        if runs and section == runs[-1][1] + 1:
            runs[-1][1] = section
        else:
            runs.append([section, section])
    return ", ".join(f"{low}-{high}" if high > low else str(low) for low, high in runs)
