"""Checks of the arguments of `fit_cylinder`, and of the number of points that its result needs."""

import numpy as np
import numpy.typing as npt

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.problem import PARAMETERS
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import FloatArray, Points, as_readonly_array
from lsvision.geometry.arrays import require_coordinates, require_covariances

MIN_EXTENT_MM = 1e-9
"""Smallest extent of points to which a cylinder is fitted: far below the resolution of any sensor.
Units: mm."""
COPLANARITY_TOLERANCE = 1e-7
"""Ratio of thickness to extent of points, below which they are in a plane or on a straight line."""
MIN_DEGREES_OF_FREEDOM = 3
"""Smallest number of degrees of freedom from which the noise is estimated."""
MAX_EXACT_RMS_RADII = 1e-6
"""Largest rms residual of points that are calculated, such as those of a reference data set: far
below the accuracy of any sensor. Unit: radius."""


def validate_points(
    points: npt.ArrayLike, covariances: npt.ArrayLike | None
) -> tuple[Points, FloatArray | None]:
    """Return points and covariances as read-only arrays; raise the errors of `fit_cylinder`."""
    points = as_readonly_array(points, ("n", 3), "points")
    if len(points) <= PARAMETERS:
        raise TooFewPoints("a cylinder", len(points), PARAMETERS + 1, "measure a longer arc")
    if not np.isfinite(points).all():
        raise ValueError("expected finite points, got NaN or infinity: leave lost points out")
    require_coordinates(points)
    if np.ptp(points, axis=0).max() < MIN_EXTENT_MM:
        raise DegenerateGeometry(
            f"all {len(points)} points lie within {MIN_EXTENT_MM:g} mm, and any cylinder there "
            "fits them: measure an arc of the cylinder, or check the units"
        )
    if covariances is None:
        return points, None
    covariances = as_readonly_array(covariances, (len(points), 3, 3), "covariances")
    require_covariances(covariances)
    return points, covariances


def require_not_degenerate(centred: Points, *, has_initial_guess: bool) -> None:
    """Raise DegenerateGeometry for points on a line, or in a plane without an initial guess."""
    extents = np.linalg.svd(centred, compute_uv=False)
    if not extents[1] > COPLANARITY_TOLERANCE * extents[0]:
        raise DegenerateGeometry(
            f"all {len(centred)} points lie on one straight line, and many cylinders along it fit "
            "them: measure an arc of the cylinder"
        )
    if not has_initial_guess and not extents[2] > COPLANARITY_TOLERANCE * extents[0]:
        raise DegenerateGeometry(
            f"all {len(centred)} points lie in one plane, and two cylinders, the twins, fit one "
            "section: add a second section, or pass an initial guess near the right one"
        )


def require_type(value: object, expected: type, name: str) -> None:
    """Raise TypeError if a value is not of a type; it says what was expected for `name`."""
    if not isinstance(value, expected):
        raise TypeError(
            f"expected {name} as lsvision.{expected.__name__}, got {type(value).__name__}"
        )


def require_noise_estimate(fit: CylinderFit, known_radius: RadiusPrior | None) -> None:
    """Raise TooFewPoints if a fit without covariances has less than 3 degrees of freedom.

    Student's t has no variance then, so that no standard uncertainty can be stated. Points that are
    calculated to lie on the cylinder have none.
    """
    points = int(fit.inliers.sum())
    needed = PARAMETERS + MIN_DEGREES_OF_FREEDOM - (known_radius is not None)
    if points < needed and fit.rms > MAX_EXACT_RMS_RADII * fit.radius:
        raise TooFewPoints(
            "a cylinder without covariances", points, needed, "pass covariances, or add points"
        )
