"""A number as people read it beside its sigma."""

import math
import re

DEFAULT_DECIMALS = 4
MAX_DECIMALS = 6
"""Decimals of a number that has no sigma (a radius known exactly), and the most of any."""


_HYPHEN_MINUS = re.compile(r"(?<![\w.)])-(?=\.?\d)")


def with_minus_signs(text: str) -> str:
    """A text for a picture: the hyphen before a number becomes a minus sign, wide as the plus.

    Examples
    --------
    >>> with_minus_signs("centre (-4.22, -450.08) mm, X-ray 3-5")
    'centre (−4.22, −450.08) mm, X-ray 3-5'
    """
    return _HYPHEN_MINUS.sub("\N{MINUS SIGN}", text)


def format_value(value: float, std: float) -> str:
    """A number with its sigma; two digits of the sigma decide the decimals of both.

    Parameters
    ----------
    value : float
        The number, in any unit.
    std : float
        One sigma, in the same unit.

    Examples
    --------
    >>> format_value(19.0234, 0.0512), format_value(359.4, 12.3)
    ('19.023 ± 0.051', '359 ± 12')
    """
    return f"{value:.{decimals_for(std)}f} ± {format_std(std)}"


def format_std(std: float) -> str:
    """A sigma with two digits, the zero at its end too.

    Examples
    --------
    >>> format_std(0.0499), format_std(12.3)
    ('0.050', '12')
    """
    if std == 0:
        return "0"
    return f"{std:.{decimals_for(std)}f}" if math.isfinite(std) else "unknown"


def decimals_for(std: float) -> int:
    """Decimals that show two digits of a sigma; 4 for a number that has none."""
    if not (math.isfinite(std) and std > 0):
        return DEFAULT_DECIMALS
    return min(max(1 - math.floor(math.log10(std)), 0), MAX_DECIMALS)
