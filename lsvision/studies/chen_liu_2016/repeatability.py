"""Figure 16: one pipe measured again and again from the same place."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, as_readonly_array
from lsvision.measure import measure_cylinders
from lsvision.planning import section_bound
from lsvision.studies.chen_liu_2016.cases import Case, simulate_case
from lsvision.studies.chen_liu_2016.methods import METHODS
from lsvision.studies.chen_liu_2016.published_results import PUBLISHED_BOX_MM, PublishedRow, Triple

POSITION = Case((PublishedRow(0, 1, 19.0, 20.0, 20.0, Triple(0.0, 0.0, 0.0)),))
"""Radius of the paper's welded pipes, middle of its angles; the paper does not say which."""


@dataclass(frozen=True, eq=False)
class Repeatability:
    """Ellipses of repeated measurements of the same pipe.

    Parameters
    ----------
    ellipses : (n, 4) ndarray
        Errors of centre x, y, semi-axes a, b. Units: mm.
    missed : int
        Measurements that did not report the pipe.
    bound : (4, 4) ndarray
        Smallest covariance of the same numbers. Units: mm^2.
    expected_box_mm : tuple of float
        Sides of the box that as many measurements at the bound fill on average. Units: mm.
    noise_of_printed_box_mm : float
        Noise at which the best possible method fills the paper's box of 0.6 mm with as many.
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
        """Sides of the smallest box around all centres. Units: mm."""
        width, height = np.ptp(self.ellipses[:, :2], axis=0).tolist()
        return width, height

    @property
    def stds_mm(self) -> tuple[float, ...]:
        """Standard deviations of centre x, y, a, b. Units: mm."""
        return tuple(self.ellipses.std(axis=0, ddof=1).tolist())

    @property
    def bound_stds_mm(self) -> tuple[float, ...]:
        """The bound of the same. Units: mm."""
        return tuple(np.sqrt(np.diag(self.bound)).tolist())


def measure_repeatedly(repeats: int, *, noise_mm: float, seed: int = 0) -> Repeatability:
    """Measure one pipe many times with one section each.

    Parameters
    ----------
    repeats : int
        How often.
    noise_mm : float
        One sigma along the ray. Units: mm.
    seed : int
        Of the first measurement.
    """
    poses = METHODS["section"].poses
    truth = simulate_case(POSITION, seed, poses, noise_mm=noise_mm)[0]
    wanted = truth.truth.tubes[0].ellipse
    errors = []
    for number in range(seed, seed + repeats):
        (section,) = simulate_case(POSITION, number, poses, noise_mm=noise_mm)
        found = measure_cylinders(section.profile, radius=POSITION.radius_mm).cylinders
        if len(found) != 1:
            continue
        ellipse = found[0].ellipse
        dx, dy = (np.asarray(ellipse.centre) - wanted.centre).tolist()
        a, b = ellipse.semi_major - wanted.semi_major, ellipse.semi_minor - wanted.semi_minor
        errors.append([dx, dy, a, b])
    on_pipe = truth.truth.labels == 1
    noise = truth.profile.noise
    if noise is None:
        raise ValueError("want a section that knows its noise")
    covariances = noise.covariances(truth.profile.points)[on_pipe]
    bound = section_bound(wanted, truth.truth.points[on_pipe], covariances).covariance[:4, :4]
    sides = expected_range(len(errors)) * np.sqrt(np.diag(bound)[:2])
    return Repeatability(
        ellipses=np.array(errors),
        missed=repeats - len(errors),
        bound=bound,
        expected_box_mm=(float(sides[0]), float(sides[1])),
        noise_of_printed_box_mm=noise_mm * PUBLISHED_BOX_MM / float(sides.max()),
    )


def expected_range(count: int) -> float:
    """Mean distance from the smallest to the largest of so many standard normal numbers.

    Definition: integral of 1 - F^n - (1 - F)^n.

    Examples
    --------
    >>> f"{expected_range(2):.3f} {expected_range(1000):.2f}"
    '1.128 6.48'
    """
    from scipy.special import ndtr

    x = np.linspace(-10.0, 10.0, 4001)
    below = ndtr(x)
    inside = 1 - below**count - (1 - below) ** count
    return float(inside.sum() * (x[1] - x[0]))


def phi_std_of_axes(axis_std_mm: float, radius_mm: float, phi_deg: float) -> float:
    """One sigma of phi = arccos(b / a) from independent errors of a and b alike. Units: deg.

    Parameters
    ----------
    axis_std_mm : float
        One sigma of either semi-axis. Units: mm.
    radius_mm, phi_deg : float
        Units: mm, deg.
    """
    phi = math.radians(phi_deg)
    a, b = radius_mm / math.cos(phi), radius_mm
    ratio_std = axis_std_mm * math.hypot(1 / a, b / a**2)
    return math.degrees(ratio_std / math.sin(phi))
