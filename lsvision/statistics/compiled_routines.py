"""LAPACK and MINPACK from scipy's compiled modules, without importing their packages.

``import scipy.optimize`` takes as long as numpy, OpenCV and the measurement of ten profiles
together: it imports all of scipy's linear algebra, special functions, sparse matrices and
transforms. The two compiled modules used here need numpy only. Where a release of scipy has them
at another place, they are imported in the usual way.
"""

import importlib
import importlib.util
import sys
from collections.abc import Callable
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import scipy

from lsvision.geometry import FloatArray

_IMPROPER_INPUT, _MAX_EVALUATIONS_REACHED = 0, 5
"""Values of MINPACK's `info`."""
_STEP_BOUND = 100.0
"""Factor of the bound of the first step, as in `scipy.optimize.leastsq`."""


class LeastSquares(NamedTuple):
    """Parameters at the least sum of squares, and whether the iteration has converged."""

    parameters: FloatArray
    converged: bool


def import_compiled_module(name: str) -> ModuleType:
    """Return a compiled module of scipy, if possible without importing the package that has it.

    Examples
    --------
    >>> import_compiled_module("scipy.linalg._flapack").dposv([[4.0]], [2.0])[1].tolist()
    [0.5]
    """
    if name in sys.modules:
        return sys.modules[name]
    package, _, stem = name.removeprefix("scipy.").rpartition(".")
    spec = PathFinder.find_spec(stem, [str(Path(scipy.__file__).parent / package)])
    if spec is None or spec.origin is None:
        return importlib.import_module(name)
    module_spec = importlib.util.spec_from_file_location(name, spec.origin)
    if module_spec is None or module_spec.loader is None:
        return importlib.import_module(name)
    module = importlib.util.module_from_spec(module_spec)
    module_spec.loader.exec_module(module)
    return module


_flapack = import_compiled_module("scipy.linalg._flapack")
dposv, dpotrf, dsyevd, dtrtrs = (
    _flapack.dposv, _flapack.dpotrf, _flapack.dsyevd, _flapack.dtrtrs
)  # fmt: skip
"""Routines of LAPACK, see `scipy.linalg.lapack`."""


def minimise_by_levenberg_marquardt(
    residuals: Callable[[FloatArray], Any],
    jacobian: Callable[[FloatArray], Any],
    initial_guess: FloatArray,
    *,
    xtol: float,
    ftol: float,
    max_evaluations: int,
) -> LeastSquares:
    """Solve a least-squares problem with MINPACK's lmder, see `scipy.optimize.leastsq`.

    `residuals` and `jacobian` are functions of the parameters (k,) that return the residuals (n,)
    and their derivatives (n, k). The iteration ends, converged, when the relative
    changes of the parameters are below `xtol` or that of the sum of squares is below `ftol`, and
    without convergence after `max_evaluations` of the residuals.

    Raises
    ------
    ValueError
        If there are fewer residuals than parameters.

    Examples
    --------
    >>> points = np.array([1.0, 2.0, 3.0])
    >>> solution = minimise_by_levenberg_marquardt(
    ...     lambda x: x - points, lambda x: np.ones((3, 1)), np.zeros(1),
    ...     xtol=1e-9, ftol=1e-9, max_evaluations=20,
    ... )
    >>> solution.parameters.round(6).tolist(), solution.converged
    ([2.0], True)
    """
    lmder = import_compiled_module("scipy.optimize._minpack")._lmder
    start = np.array(initial_guess, dtype=np.float64)  # which MINPACK writes to
    parameters, _, status = lmder(
        residuals, jacobian, start, (), True, False, ftol, xtol, 0.0, max_evaluations,
        _STEP_BOUND, None,
    )  # fmt: skip
    if status == _IMPROPER_INPUT:
        raise ValueError(f"expected at least {len(initial_guess)} residuals, got fewer")
    return LeastSquares(parameters, status != _MAX_EVALUATIONS_REACHED)
