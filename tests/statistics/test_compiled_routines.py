"""Routines from scipy's compiled modules, beside those of its packages."""

import inspect
import sys

import numpy as np
import numpy.testing as npt
import pytest
import scipy.linalg.lapack
from scipy.optimize import leastsq

from lsvision.statistics import compiled_routines
from lsvision.statistics.compiled_routines import (
    dposv,
    import_compiled_module,
    minimise_by_levenberg_marquardt,
)
from tests.scripts import output_of_python

TIMES = np.linspace(0.0, 3.0, 40)


def _residuals(x):
    return x[0] * np.exp(-x[1] * TIMES) - 5 * np.exp(-0.7 * TIMES) + 0.01 * np.sin(50 * TIMES)


def _jacobian(x):
    decay = np.exp(-x[1] * TIMES)
    return np.column_stack([decay, -x[0] * TIMES * decay])


def test_same_minimum_as_leastsq_to_the_last_bit():
    start = np.array([1.0, 1.0])
    options = {"xtol": 1e-10, "ftol": 1e-10}
    found = minimise_by_levenberg_marquardt(
        _residuals, _jacobian, start, max_evaluations=100, **options
    )
    expected, _ = leastsq(_residuals, start, Dfun=_jacobian, maxfev=100, **options)
    npt.assert_array_equal(found.parameters, expected)
    npt.assert_array_equal(start, [1.0, 1.0])
    assert found.converged


def test_the_first_step_has_the_bound_of_leastsq():
    assert inspect.signature(leastsq).parameters["factor"].default == compiled_routines._STEP_BOUND


def test_too_few_evaluations_are_reported():
    start = np.array([1.0, 1.0])
    found = minimise_by_levenberg_marquardt(
        _residuals, _jacobian, start, xtol=1e-10, ftol=1e-10, max_evaluations=3
    )
    assert not found.converged


def test_fewer_residuals_than_parameters_are_rejected():
    with pytest.raises(ValueError, match="expected at least 2 residuals, got fewer"):
        minimise_by_levenberg_marquardt(
            lambda x: _residuals(x)[:1], lambda x: _jacobian(x)[:1], np.ones(2),
            xtol=1e-9, ftol=1e-9, max_evaluations=9,
        )  # fmt: skip


def test_routines_of_lapack_are_those_of_scipy():
    matrix, rhs = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, 2.0])
    npt.assert_array_equal(dposv(matrix, rhs)[1], scipy.linalg.lapack.dposv(matrix, rhs)[1])


def test_packages_around_them_are_not_imported_and_work_afterwards():
    code = (
        "import sys; from lsvision.statistics import compiled_routines as routines\n"
        "routines.import_compiled_module('scipy.optimize._minpack')\n"
        "print([name for name in ('scipy.linalg', 'scipy.optimize') if name in sys.modules])\n"
        "import numpy, scipy.linalg.lapack, scipy.optimize\n"
        "print(scipy.linalg.lapack.dposv([[4.0]], [2.0])[1])\n"
        "print(scipy.optimize.leastsq(lambda x: x - [2.0], [0.0])[0].round(6))\n"
    )
    assert output_of_python(code).splitlines() == ["[]", "[0.5]", "[2.]"]


def test_module_at_another_place_is_imported_in_the_usual_way(monkeypatch):
    name = "scipy.optimize._minpack"
    monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(compiled_routines.scipy, "__file__", "/nowhere/scipy/__init__.py")
    assert import_compiled_module(name)._lmder is not None
    assert sys.modules[name].__name__ == name
