"""Comparison of two measurements of the same profile."""

import numpy as np

from tests.tolerances import CONVERGED


def assert_same_measurement(found, expected):
    """The same arcs, points and reasons; ellipses up to the end of an iteration, in mm."""
    assert found.rejections == expected.rejections
    assert len(found.cylinders) == len(expected.cylinders)
    for one, other in zip(found.cylinders, expected.cylinders, strict=True):
        np.testing.assert_array_equal(one.indices, other.indices)
        np.testing.assert_allclose(one.fit.parameters, other.fit.parameters, atol=CONVERGED)
        covariances = one.fit.parameter_covariance, other.fit.parameter_covariance
        np.testing.assert_allclose(*covariances, rtol=CONVERGED, atol=CONVERGED**2)
