"""The bound of one section: five unknowns of an ellipse from points on an arc of it."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import Ellipse, FloatArray, Points, as_readonly_array
from lsvision.planning.information import UNIFORM_THETA, information, invert_information


@dataclass(frozen=True, eq=False)
class SectionPrediction:
    """One-sigma errors to expect from one section; what an efficient fit reaches.

    Parameters
    ----------
    radius_std : float
        Units: mm.
    theta_std : float
        At most 52 deg, the spread of an angle in [0, pi) about which nothing is known. Units: rad.
    phi_std : float
        At most sqrt(2 sd(b/a)): near phi = 0, phi = arccos(b/a) is a square root and the
        linear bound sd(b/a) / sin(phi) grows without limit, the real spread does not. The cap
        acts where sin(phi) < sqrt(sd(b/a) / 2), and is an order of magnitude, no bound.
        Units: rad.
    centre_x_std, centre_y_std : float
        Units: mm.
    covariance : (5, 5) ndarray
        The linear bound, never capped: order centre_x, centre_y, semi_major, semi_minor, theta
        (mm, rad). For a circle the last variance is inf, its covariances 0.
    points : int
        Number of points it rests on.
    """

    radius_std: float
    theta_std: float
    phi_std: float
    centre_x_std: float
    centre_y_std: float
    covariance: FloatArray
    points: int

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (5, 5), "covariance")
        )


def section_bound(
    ellipse: Ellipse,
    points: Points,
    covariances: FloatArray,
    known_radius_std: float | None = None,
) -> SectionPrediction:
    """Cramer-Rao bound of radius, theta, phi and centre from points of one section.

    Parameters
    ----------
    ellipse : Ellipse
        The true section.
    points : (n, 2) ndarray
        Noise-free points on it, section frame; NaN rows count as lost. Units: mm.
    covariances : (n, 2, 2) ndarray
        Covariance of each point's error. Only n' Sigma n, the part across the curve, counts:
        for noise along the ray that is exactly the information of the measured ranges.
        Units: mm^2.
    known_radius_std : float, optional
        One sigma of a radius known beforehand; 0 = exactly. Units: mm.

    Returns
    -------
    SectionPrediction
        One sigma of each number.

    Raises
    ------
    TooFewPoints
        If fewer than two points are left.
    DegenerateGeometry
        If the points leave the ellipse undetermined (fewer than five, or a vanishing arc).
    ValueError
        If shapes do not match or a variance is not positive.

    Notes
    -----
    Fisher information in (centre, a, b, eta) with eta = (a - b) theta in mm, which unlike theta
    stays regular for a circle; then the linear map to theta and to phi = arccos(b / a).

    Examples
    --------
    >>> pipe = Ellipse((0.0, -400.0), semi_major=20.22, semi_minor=19.0, theta=0.35)
    >>> points = pipe.points_at(np.linspace(0.0, 2.4, 70))
    >>> sigma = section_bound(pipe, points, np.tile(0.01 * np.eye(2), (70, 1, 1)))
    >>> f"radius {sigma.radius_std:.2f} mm, phi {math.degrees(sigma.phi_std):.1f} deg"
    'radius 0.47 mm, phi 2.2 deg'
    """
    points = as_readonly_array(points, ("n", 2), "points")
    covariances = as_readonly_array(covariances, (len(points), 2, 2), "covariances")
    seen = np.isfinite(points).all(axis=1)
    gradients, normals = _gradients(ellipse, points[seen])
    variances = np.einsum("ni,nij,nj->n", normals, covariances[seen], normals)
    known = None if known_radius_std is None else (3, known_radius_std)
    bound = invert_information(information(gradients, variances), known)
    return _prediction(ellipse, bound, int(seen.sum()))


def _gradients(ellipse: Ellipse, points: Points) -> tuple[FloatArray, FloatArray]:
    """Change of the signed distance by (centre, a, b, eta), and the outward normals."""
    a, b = ellipse.semi_major, ellipse.semi_minor
    u, v = ellipse.to_ellipse_frame(points).T
    t = np.arctan2(v / b, u / a)
    cos, sin = np.cos(t), np.sin(t)
    length = np.hypot(b * cos, a * sin)
    own_normals = np.column_stack([b * cos, a * sin]) / length[:, None]
    normals = ellipse.from_ellipse_frame(own_normals) - ellipse.centre
    by_a, by_b = own_normals[:, 0] * cos, own_normals[:, 1] * sin
    by_eta = (a + b) * sin * cos / length
    return np.column_stack([normals, by_a, by_b, by_eta]), normals


def _prediction(ellipse: Ellipse, bound: FloatArray, points: int) -> SectionPrediction:
    a, b = ellipse.semi_major, ellipse.semi_minor
    centre_x_std, centre_y_std, _, radius_std, eta_std = np.sqrt(np.diag(bound))
    by_axes = np.array([-b / a**2, 1 / a])
    ratio_std = math.sqrt(by_axes @ bound[2:4, 2:4] @ by_axes)
    gap, sin_phi = a - b, math.sin(ellipse.phi)
    covariance = bound.copy()
    covariance[4, :4] = covariance[:4, 4] = bound[4, :4] / gap if gap > 0 else 0.0
    covariance[4, 4] = (eta_std / gap) ** 2 if gap > 0 else math.inf
    phi_linear = ratio_std / sin_phi if sin_phi > 0 else math.inf
    return SectionPrediction(
        radius_std=float(radius_std),
        theta_std=min(math.sqrt(covariance[4, 4]), UNIFORM_THETA),
        phi_std=min(phi_linear, math.sqrt(2 * ratio_std)),
        centre_x_std=float(centre_x_std),
        centre_y_std=float(centre_y_std),
        covariance=covariance,
        points=points,
    )
