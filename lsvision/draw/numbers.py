"""A number as people read it beside its sigma."""

import math

WITHOUT_SIGMA = 4
MOST = 6
"""Decimals of a number that has no sigma (a radius known exactly), and the most of any."""


def with_sigma(value: float, std: float) -> str:
    """A number with its sigma; two digits of the sigma decide the decimals of both.

    Parameters
    ----------
    value : float
        The number, in any unit.
    std : float
        One sigma, in the same unit.

    Examples
    --------
    >>> with_sigma(19.0234, 0.0512), with_sigma(359.4, 12.3)
    ('19.023 ± 0.051', '359 ± 12')
    """
    return f"{value:.{decimals_for(std)}f} ± {sigma_text(std)}"


def sigma_text(std: float) -> str:
    """A sigma with two digits, the zero at its end too.

    Examples
    --------
    >>> sigma_text(0.0499), sigma_text(12.3)
    ('0.050', '12')
    """
    if std == 0:
        return "0"
    return f"{std:.{decimals_for(std)}f}" if math.isfinite(std) else "unknown"


def decimals_for(std: float) -> int:
    """Decimals that show two digits of a sigma; 4 for a number that has none."""
    if not (math.isfinite(std) and std > 0):
        return WITHOUT_SIGMA
    return min(max(1 - math.floor(math.log10(std)), 0), MOST)
