"""Figure 16: repeated measurements of one pipe in the same position."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Ellipse, FloatArray, as_readonly_array
from lsvision.measure import measure_cylinders
from lsvision.planning import section_bound
from lsvision.studies.chen_liu_2016.cases import Case, simulate_case
from lsvision.studies.chen_liu_2016.methods import METHODS, get_noise_model
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_BOX_MM, PublishedRow, Triple

POSITION = Case((PublishedRow(0, 1, 19.0, 20.0, 20.0, Triple(0.0, 0.0, 0.0)),))
"""Pipe with the radius of the paper's welded ones and the middle of its angles; the paper does not
state the pipe, and prints no errors of it."""


@dataclass(frozen=True, eq=False)
class Repeatability:
    """Ellipses of repeated measurements of the same pipe.

    Parameters
    ----------
    ellipses : (n, 4) ndarray
        Errors of centre x, y and semi-axes a, b in each measurement with one cylinder. Units: mm.
    missed : int
        Number of measurements that did not report exactly one cylinder.
    bound : (4, 4) ndarray
        Cramer-Rao bound of their covariance. Units: mm^2.
    expected_box_mm : tuple of float
        Mean sides of the bounding box of as many centres with the covariance of the bound.
        Units: mm.
    noise_of_printed_box_mm : float
        Noise at which the larger of these sides is that of the paper's box, 0.6 mm. Units: mm.
    """

    ellipses: FloatArray
    missed: int
    bound: FloatArray
    expected_box_mm: tuple[float, float]
    noise_of_printed_box_mm: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "ellipses", as_readonly_array(self.ellipses, ("n", 4), "ellipses"))
        object.__setattr__(self, "bound", as_readonly_array(self.bound, (4, 4), "bound"))

    @property
    def box_mm(self) -> tuple[float, float]:
        """Sides of the bounding box of all centres. Units: mm."""
        width, height = np.ptp(self.ellipses[:, :2], axis=0).tolist()
        return width, height

    @property
    def stds_mm(self) -> tuple[float, ...]:
        """Standard deviations of centre x, y, a, b. Units: mm."""
        return tuple(self.ellipses.std(axis=0, ddof=1).tolist())

    @property
    def bound_stds_mm(self) -> tuple[float, ...]:
        """Cramer-Rao bound of these standard deviations. Units: mm."""
        return tuple(np.sqrt(np.diag(self.bound)).tolist())


def measure_repeatedly(repeats: int, *, noise_mm: float, seed: int = 0) -> Repeatability:
    """Measure one pipe many times with one section each, from a random seed on.

    The noise is the standard deviation along the ray, in mm.

    Raises
    ------
    ValueError
        If fewer than two measurements report exactly one cylinder.
    """
    poses = METHODS["section"].poses
    (first,) = simulate_case(POSITION, seed, poses, noise_mm=noise_mm)
    true_ellipse = first.truth.tubes[0].ellipse
    errors = []
    for number in range(seed, seed + repeats):
        (section,) = simulate_case(POSITION, number, poses, noise_mm=noise_mm)
        cylinders = measure_cylinders(section.profile, radius=POSITION.radius_mm).cylinders
        if len(cylinders) != 1:
            continue
        errors.append(
            _list_centre_and_axes(cylinders[0].ellipse) - _list_centre_and_axes(true_ellipse)
        )
    if len(errors) < 2:
        raise ValueError(
            f"expected two or more measurements with one cylinder, got {len(errors)} of {repeats}"
        )
    on_pipe = first.truth.labels == 1
    covariances = get_noise_model(first).covariances(first.profile.points)[on_pipe]
    points = first.truth.points[on_pipe]
    bound = section_bound(true_ellipse, points, covariances).covariance[:4, :4]
    sides = compute_expected_range(len(errors)) * np.sqrt(np.diag(bound)[:2])
    return Repeatability(
        ellipses=np.array(errors),
        missed=repeats - len(errors),
        bound=bound,
        expected_box_mm=(float(sides[0]), float(sides[1])),
        noise_of_printed_box_mm=noise_mm * PUBLISHED_BOX_MM / float(sides.max()),
    )


def _list_centre_and_axes(ellipse: Ellipse) -> FloatArray:
    """Return centre x, y and semi-axes a, b (4,). Units: mm."""
    return np.array([*ellipse.centre, ellipse.semi_major, ellipse.semi_minor])


def compute_expected_range(count: int) -> float:
    """Return the mean range (largest minus smallest) of `count` standard normal numbers.

    Definition: integral over x of 1 - F(x)^n - (1 - F(x))^n, with n = `count` and F the standard
    normal distribution function.

    Examples
    --------
    >>> f"{compute_expected_range(2):.3f} {compute_expected_range(1000):.2f}"
    '1.128 6.48'
    """
    from scipy.special import ndtr

    x = np.linspace(-10.0, 10.0, 4001)
    cdf = ndtr(x)
    integrand = 1 - cdf**count - (1 - cdf) ** count
    return float(integrand.sum() * (x[1] - x[0]))


def phi_std_of_axes(axis_std_mm: float, radius_mm: float, phi_deg: float) -> float:
    """Return the std of phi = arccos(b / a) in deg, for equal, independent stds of a and b."""
    phi = math.radians(phi_deg)
    a, b = radius_mm / math.cos(phi), radius_mm
    ratio_std = axis_std_mm * math.hypot(1 / a, b / a**2)
    return math.degrees(ratio_std / math.sin(phi))
