"""Check of covariances that a caller gives or a file states."""

import numpy as np
import numpy.typing as npt

MAX_COVARIANCE = 1e9
"""Largest entry of a covariance, in mm and rad; larger ones overflow later."""
SYMMETRY_TOLERANCE = 1e-6
"""Largest asymmetry or negative eigenvalue of a covariance, relative to its largest entry."""


def check_covariance(covariance: npt.NDArray[np.float64]) -> None:
    """Raise ValueError unless a matrix is finite, symmetric and positive semi-definite.

    Rounding errors are tolerated.

    Examples
    --------
    >>> check_covariance(np.diag([1.0, -1.0]))
    Traceback (most recent call last):
        ...
    ValueError: expected a positive semi-definite covariance, got eigenvalues from -1 to 1
    """
    largest = float(np.abs(covariance).max(initial=0.0))
    if not largest <= MAX_COVARIANCE:
        raise ValueError(f"expected covariances below {MAX_COVARIANCE:g}, got {largest:g}")
    asymmetry = float(np.abs(covariance - covariance.T).max(initial=0.0))
    if asymmetry > SYMMETRY_TOLERANCE * largest:
        raise ValueError(f"expected a symmetric covariance, got entries {asymmetry:.3g} apart")
    eigenvalues = np.linalg.eigvalsh(covariance)
    low, high = float(eigenvalues.min(initial=0.0)), float(eigenvalues.max(initial=0.0))
    if low < -SYMMETRY_TOLERANCE * largest:
        raise ValueError(
            "expected a positive semi-definite covariance, got eigenvalues from "
            f"{low:.3g} to {high:.3g}"
        )
