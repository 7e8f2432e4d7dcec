"""Conversion of overflow and singular matrices in a fit to `FitFailed`."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from lsvision.errors import FitFailed


@contextmanager
def report_numerical_failure(what: str) -> Iterator[None]:
    """Raise `FitFailed` for a singular matrix or an overflow within the block.

    Floating-point warnings are suppressed within the block: check its results with
    `require_finite`. `what` names in the message what is fitted.

    Raises
    ------
    FitFailed
        Instead of ``LinAlgError``, ``OverflowError`` and ``ZeroDivisionError``.

    Examples
    --------
    >>> with report_numerical_failure("an ellipse"):
    ...     np.linalg.inv(np.zeros((2, 2)))
    Traceback (most recent call last):
        ...
    lsvision.errors.FitFailed: an ellipse cannot be fitted to the points (Singular matrix): ...
    """
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            yield
    except (np.linalg.LinAlgError, OverflowError, ZeroDivisionError) as error:
        raise FitFailed(_describe_failure(what, str(error))) from None


def require_finite(what: str, *numbers: object) -> None:
    """Raise `FitFailed` if one of the numbers or arrays of a fit of `what` is NaN or infinite."""
    for number in numbers:
        if not np.isfinite(np.asarray(number, dtype=np.float64)).all():
            raise FitFailed(_describe_failure(what, "its numbers are not finite"))


def _describe_failure(what: str, reason: str) -> str:
    """Return the message of `FitFailed`, with the remedy."""
    return (
        f"{what} cannot be fitted to the points ({reason}): they do not determine it, or their "
        "coordinates or covariances span too many orders of magnitude; check the units"
    )
