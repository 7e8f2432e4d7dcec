"""The least-squares problem of one arc, in parameters that stay regular at a circle.

The ellipse is ``c + E w`` for all unit vectors w, with the symmetric matrix
``E = [[m + p, q], [q, m - p]]``; so ``a = m + h``, ``b = m - h``, ``h = |(p, q)|`` and
``theta = atan2(q, p) / 2``. In (a, b, theta) a circle (a pipe seen square on) is a singular
point; in (m, p, q) it is a point like any other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.errors import FitFailed, TooFewPoints
from lsvision.fitting.known_phi import KnownPhi
from lsvision.shapes import Ellipse, FloatArray, Points
from lsvision.shapes.ellipse import foot_directions

PARAMETERS = 5
MOST_EVALUATIONS = 40
"""Arcs of pipes need 5 to 26; what needs more runs off to a needle, and is refused."""
NEEDLE = 1e-3
"""Thinner than this an ellipse is a straight line that lost its way."""
EXACT_RADIUS_STD = 1e-6
"""Share of a known radius that stands for "exactly": small beside any noise, not singular."""


@dataclass(frozen=True, slots=True)
class KnownRadius:
    """What is known of a radius before the measurement: a prior on b.

    Parameters
    ----------
    radius, std : float
        Units: mm. ``std = 0`` means exactly known.
    """

    radius: float
    std: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"want a positive known radius in mm, got {self.radius}")
        if not (math.isfinite(self.std) and self.std >= 0):
            raise ValueError(f"want a known radius with std >= 0 mm, got {self.std}")

    @property
    def weight_std(self) -> float:
        """One sigma as the fit uses it. Units: mm."""
        return max(self.std, EXACT_RADIUS_STD * self.radius)


@dataclass(frozen=True, eq=False, slots=True)
class ArcProblem:
    """Least-squares problem of one arc with its weights held fixed.

    Parameters
    ----------
    points : (n, 2) ndarray
        Section frame. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each residual. Units: mm.
    known_radius : KnownRadius or None
        Prior on b.
    residual : {"orthogonal", "radial"}
        See `FittingSettings`.
    known_phi : KnownPhi, optional
        Prior on the tilt.
    """

    points: Points
    stds: FloatArray
    known_radius: KnownRadius | None
    residual: str
    known_phi: KnownPhi | None = None

    @property
    def prior_rows(self) -> int:
        """How many residuals are not of points."""
        tilt = 0 if self.known_phi is None else self.known_phi.count
        return tilt + (self.known_radius is not None)

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals over their standard deviations, and their derivative.

        Returns
        -------
        residuals : (n + k,) ndarray
            The last k are those of the priors.
        jacobian : (n + k, 5) ndarray
            Units: 1/mm.
        """
        compare = orthogonal_comparison if self.residual == "orthogonal" else radial_comparison
        signed, n, w = compare(self.points, parameters)
        nx, ny, wx, wy = n[:, 0], n[:, 1], w[:, 0], w[:, 1]
        count = len(signed)
        rows = count + self.prior_rows
        residuals, jacobian = np.empty(rows), np.empty((rows, PARAMETERS))
        body = jacobian[:count]
        body[:, 0], body[:, 1], body[:, 2] = nx, ny, nx * wx + ny * wy
        body[:, 3], body[:, 4] = nx * wx - ny * wy, nx * wy + ny * wx
        if self.residual == "radial":
            # The ray turns as the centre moves: n counts where it meets the ellipse, and the
            # rest of the residual lies along the ray.
            ray = self.points - parameters[:2]
            share = (signed / (ray[:, 0] ** 2 + ray[:, 1] ** 2))[:, None]
            body[:, :2] += share * (ray - n * np.hypot(ray[:, 0], ray[:, 1])[:, None])
        body /= -self.stds[:, None]
        residuals[:count] = signed / self.stds
        if self.known_phi is not None:
            tilt = slice(count, count + self.known_phi.count)
            residuals[tilt], jacobian[tilt] = self.known_phi.rows(parameters)
        if self.known_radius is not None:
            prior = self.known_radius
            residuals[-1] = (semi_minor(parameters) - prior.radius) / prior.weight_std
            jacobian[-1] = semi_minor_gradient(parameters) / prior.weight_std
        return residuals, jacobian


def orthogonal_comparison(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed distance to the nearest point c + E w, and n, w there, with d' = -n d(c + E w).

    Returns
    -------
    signed : (n,) ndarray
        Positive outside. Units: mm.
    normals, w : (n, 2) ndarray
        Outward unit normal and unit vector of the nearest point.
    """
    a, b, cos, sin = axes_of(parameters)
    dx, dy = points[:, 0] - parameters[0], points[:, 1] - parameters[1]
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    wu, wv = foot_directions(u, v, a, b)
    nu, nv = wu / a, wv / b
    length = np.hypot(nu, nv)
    nu /= length
    nv /= length
    signed = (u - a * wu) * nu + (v - b * wv) * nv
    return signed, turned_back(nu, nv, cos, sin), turned_back(wu, wv, cos, sin)


def radial_comparison(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same along the ray from the centre: the paper's r_j (Eq. 4).

    Returns
    -------
    signed : (n,) ndarray
        Units: mm.
    normals, w : (n, 2) ndarray
        The normal divided by its cosine with the ray, so that -n d(c + E w) is again the
        derivative of the residual; unit vector of the point on the ray.
    """
    a, b, cos, sin = axes_of(parameters)
    d = points - parameters[:2]
    u, v = d[:, 0] * cos + d[:, 1] * sin, d[:, 1] * cos - d[:, 0] * sin
    rho, scaled = np.hypot(u, v), np.hypot(u / a, v / b)
    wu, wv = u / a / scaled, v / b / scaled
    gu, gv = wu / a, wv / b
    along_ray = (gu * u + gv * v) / rho
    nu, nv = gu / along_ray, gv / along_ray
    return rho - rho / scaled, turned_back(nu, nv, cos, sin), turned_back(wu, wv, cos, sin)


def turned_back(u: FloatArray, v: FloatArray, cos: float, sin: float) -> FloatArray:
    """Vectors of the ellipse's own frame in the section frame: (n, 2)."""
    turned = np.empty((len(u), 2))
    turned[:, 0] = cos * u - sin * v
    turned[:, 1] = sin * u + cos * v
    return turned


def parameters_of(ellipse: Ellipse) -> FloatArray:
    """(centre_x, centre_y, m, p, q) of an ellipse. Units: mm."""
    m = (ellipse.semi_major + ellipse.semi_minor) / 2
    h = (ellipse.semi_major - ellipse.semi_minor) / 2
    p, q = h * math.cos(2 * ellipse.theta), h * math.sin(2 * ellipse.theta)
    return np.array([*ellipse.centre, m, p, q])


def ellipse_of(parameters: FloatArray) -> Ellipse:
    """Ellipse of (centre_x, centre_y, m, p, q).

    Raises
    ------
    FitFailed
        If the parameters are no ellipse: not finite, or an axis of no length.
    """
    a, b, cos, sin = axes_of(parameters)
    if not is_ellipse(parameters):
        raise FitFailed(
            f"the points have no ellipse (semi-axes {a:.3g} and {b:.3g} mm): they lie on a "
            "straight line or on two; leave them out"
        )
    centre = (float(parameters[0]), float(parameters[1]))
    return Ellipse(centre, a, b, math.atan2(sin, cos))


def is_ellipse(parameters: FloatArray) -> bool:
    """Whether parameters are finite and of an ellipse that is no needle."""
    a, b, _, _ = axes_of(parameters)
    return bool(np.isfinite(parameters).all()) and NEEDLE * a < b <= a


def semi_minor(parameters: FloatArray) -> float:
    """Semi-minor axis b = m - h. Units: mm."""
    return float(parameters[2]) - math.hypot(parameters[3], parameters[4])


def semi_minor_gradient(parameters: FloatArray) -> FloatArray:
    """Derivative of b by the parameters, (5,); at a circle in the direction p > 0."""
    direction = _deviator_direction(parameters)
    return np.array([0.0, 0.0, 1.0, -direction[0], -direction[1]])


def semi_major_gradient(parameters: FloatArray) -> FloatArray:
    """Derivative of a by the parameters, (5,); at a circle in the direction p > 0."""
    direction = _deviator_direction(parameters)
    return np.array([0.0, 0.0, 1.0, direction[0], direction[1]])


def minimise(problem: ArcProblem, start: FloatArray) -> FloatArray:
    """Parameters of least squares, by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Raises
    ------
    FitFailed
        If the iteration leaves the finite numbers.
    """
    rows = len(problem.points) + problem.prior_rows
    if rows < PARAMETERS:
        raise TooFewPoints("an arc", rows, PARAMETERS, "scan slower or nearer")
    parameters = least_squares(problem.evaluate, start)
    if not np.isfinite(parameters).all():
        raise FitFailed("the ellipse fit left the finite numbers: the points lie on no ellipse")
    return parameters


Evaluation = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def least_squares(evaluate: Evaluation, start: FloatArray) -> FloatArray:
    """Parameters of least squares by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Parameters
    ----------
    evaluate : callable
        Parameters to residuals (n,) and Jacobian (n, k).
    start : (k,) ndarray
        Where to begin.
    """
    from scipy.optimize import leastsq

    remembered = remembering_last(evaluate)
    with np.errstate(all="ignore"):
        found, *_ = leastsq(
            lambda x: remembered(x)[0], start, Dfun=lambda x: remembered(x)[1],
            xtol=1e-7, ftol=1e-10, maxfev=MOST_EVALUATIONS, full_output=True,
        )  # fmt: skip
    parameters: FloatArray = found
    return parameters


def remembering_last(evaluate: Evaluation) -> Evaluation:
    """MINPACK asks for residuals and Jacobian apart, at the same point; compute both once."""
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def remembered(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = parameters.tobytes()
        if key not in last:
            last.clear()
            last[key] = evaluate(parameters)
        return last[key]

    return remembered


def axes_of(parameters: FloatArray) -> tuple[float, float, float, float]:
    """a, |b| in mm, cos theta, sin theta of (centre_x, centre_y, m, p, q)."""
    m, p, q = float(parameters[2]), float(parameters[3]), float(parameters[4])
    h = math.hypot(p, q)
    theta = 0.5 * math.atan2(q, p)
    return abs(m + h), max(abs(m - h), 1e-12), math.cos(theta), math.sin(theta)


def _deviator_direction(parameters: FloatArray) -> tuple[float, float]:
    h = math.hypot(parameters[3], parameters[4])
    if h == 0:
        return 1.0, 0.0
    return float(parameters[3]) / h, float(parameters[4]) / h
