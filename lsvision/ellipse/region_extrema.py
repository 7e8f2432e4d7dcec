"""Extrema of five quantities over ellipsoids: the targets of a step towards the ends of intervals.

About parameters (centre_x, centre_y, m, p, q) the region {F <= min F + c} is approximated by an
ellipsoid with centre mu, radius rho and shape C (`lsvision.ellipse.ellipsoids`). The quantities
themselves are not approximated. A linear function with the gradient f has its maximum over the
ellipsoid at

    mu + rho C f / sqrt(f' C f),    where it is f' mu + rho sqrt(f' C f),

and the maximum of each quantity is that of a linear function (at a minimum, of minus the quantity):

- centre: f is an axis;
- radius b = m - h and phi: h = |d| is the maximum of u . d over all unit vectors u. So the largest
  value of h - k m is that of u . d - k m over points and u together. The smallest one is a minimum
  over points of a maximum over u, and equals the maximum over u of the minima over points (minimax
  theorem for |u| <= 1; |u| < 1 at an extremum that is a circle). So +/- (u . d - k m) is maximised,
  and u has the direction of d at the extremum: it is found by Newton's method on its angle. For the
  radius k is 1. For phi, a function of h / m, it is h / m at the extremum (Dinkelbach, On nonlinear
  fractional programming, Management Science 13, 1967);
- theta: f is normal to the tangent from the circle d = 0 to the ellipse of d;
- best circle: f leads from mu to the nearest point with d = 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, multiply_vectors
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.ellipsoids import Ellipsoids
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import PARAMETERS, deviators_from_parameters
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, select_rows
from lsvision.geometry.noisy_points import as_complex, as_vectors

RADIUS_LOW, RADIUS_HIGH, PHI_LOW, PHI_HIGH, RADIUS_LOW_2, PHI_HIGH_2 = range(6)
X_LOW, X_HIGH, Y_LOW, Y_HIGH, THETA_LOW, THETA_HIGH, CIRCLE = range(6, 13)
"""Ends of the intervals of a fit, with second extrema (`SECOND_ENDS`), and its best circle."""
DIRECTED_END_COUNT, END_COUNT = 6, 13
"""Number of ends that have a direction u, which come first, and of all ends of a fit."""
SECOND_ENDS = {RADIUS_LOW: RADIUS_LOW_2, PHI_HIGH: PHI_HIGH_2}
"""The smallest radius and the largest phi may have two local extrema, with opposite d."""
FLATTENING_SIGNS = np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
"""Sign of the maximised function h - k m at each end with a direction: +1 for the smallest radius
and the largest phi, -1 for the largest radius and the smallest phi."""
IS_PHI = np.isin(np.arange(END_COUNT), (PHI_LOW, PHI_HIGH, PHI_HIGH_2))
"""Whether each of the 13 ends is one of phi."""
IS_CENTRE = np.isin(np.arange(END_COUNT), (X_LOW, X_HIGH, Y_LOW, Y_HIGH))
"""Whether each of the 13 ends is one of the centre."""
LINEAR_GRADIENTS = np.zeros((END_COUNT, PARAMETERS))
"""f of the quantities that are linear, centre_x and centre_y; 0 for the other ends."""
LINEAR_GRADIENTS[[X_LOW, X_HIGH, Y_LOW, Y_HIGH], [0, 0, 1, 1]] = -1.0, 1.0, -1.0, 1.0
CIRCLE_GRADIENTS = LINEAR_GRADIENTS[:, :3].copy()
"""f by (x, y, m) among circles, of the quantities whose extremum may be a circle: the largest
radius, which is m there, and with a known radius the centre."""
CIRCLE_GRADIENTS[RADIUS_HIGH, 2] = 1.0

SEARCHED_ANGLES = np.radians(np.arange(0.0, 360.0, 15.0))
"""Directions of d among which the initial ones for radius and phi are searched. Units: rad."""
SEARCHED_GRADIENTS = np.stack(
    [0 * SEARCHED_ANGLES, np.cos(SEARCHED_ANGLES), np.sin(SEARCHED_ANGLES)], axis=1
)
"""Gradients of u . d by (m, p, q) for these directions u."""
MAX_TURN = 0.7
"""Longest Newton step of the direction u. Units: rad."""
MAX_NEWTON_STEPS, DIRECTION_TOLERANCE = 4, 0.02
"""Largest number of Newton steps of the direction u, and step of the angle (rad) and of k below
which they end."""
CENTRE_FLATTENING_FRACTION = 0.5
"""Fraction of |d| at the end of an interval of the centre for which its c is taken, with a known
radius: estimates of |d| near a circle are too large. The 95 % intervals of centre_y of 1500
untilted pipes have a coverage of 92.1 % with 1, 92.9 with 0.7, 93.3 with 0.5, 93.5 with 0.35. With
0 it is 93.7 %, but all intervals get longer, also those of tilted pipes, to a coverage of 97 %."""
CRITICAL_UPDATES = 2
"""Number of updates in an iteration of c of phi, which depends on the phi of the end. With 1, 3 of
1500 intervals of phi of arcs of 60 to 160 deg are wrong by 2 to 180 % of their width."""


class Rows(NamedTuple):
    """Ends that are searched; as a tuple, an index of arrays (s, 13, ...) that selects them.

    Parameters
    ----------
    fit_indices : (k,) int ndarray
        Index of the fit of each end.
    ends : (k,) int ndarray
        Which of the 13 ends each one is: `RADIUS_LOW` to `CIRCLE`.
    """

    fit_indices: IntArray
    ends: IntArray


class Targets(NamedTuple):
    """Targets of a step.

    Parameters
    ----------
    parameters : (k, 5) ndarray
        Extrema over the ellipsoids. Units: mm.
    angles : (k,) ndarray
        Angle of the direction u of d = (p, q); of no meaning for ends without it. Units: rad.
    m_factors : (k,) ndarray
        Factor k of m in the function h - k m of radius or phi.
    critical : (k,) ndarray
        Critical ratios c.
    circle_ratios : (s,) ndarray
        Minimum of F on d = 0 less min F, for each fit.
    """

    parameters: FloatArray
    angles: FloatArray
    m_factors: FloatArray
    critical: FloatArray
    circle_ratios: FloatArray

    def select(self, rows: BoolArray) -> "Targets":
        """Return the targets of some rows."""
        return Targets(*select_rows(self[:4], rows), self.circle_ratios)


@dataclass(frozen=True, eq=False, slots=True)
class Regions:
    """Regions {F <= min F + c} of s fits.

    Parameters
    ----------
    stack : FitStack
        The fits.
    critical_ratios : CriticalRatios
        Their critical ratios c.
    best : Expansion
        Expansion of F about the s estimates.
    """

    stack: FitStack
    critical_ratios: CriticalRatios
    best: Expansion

    def find_targets(self, rows: Rows, expansion: Expansion, last: Targets) -> Targets:
        """Return the extrema over the ellipsoids of the expansion of F about k parameters.

        Angles, factors and c of the `last` targets are the initial guesses of the new ones.
        """
        fit_indices, ends = rows
        ellipsoids = Ellipsoids.of(expansion, self.best.cost[fit_indices])
        angles, m_factors, critical = self._find_directions(rows, ellipsoids, last)
        self._replace_ratios_of_centres(critical, rows, expansion.parameters)
        rho = np.sqrt(np.maximum(ellipsoids.excess + critical, 0.0))
        f = _gradients_of_ends(ends, angles, m_factors)
        theta = np.flatnonzero((ends == THETA_LOW) | (ends == THETA_HIGH))
        if theta.size:
            sides = np.where(ends[theta] == THETA_LOW, -1.0, 1.0)
            tangents = ellipsoids.find_tangents(theta, rho[theta], sides)
            f[theta, 3:], rho[theta], contacts = tangents
            # c of the direction that is found; the next step uses it.
            critical[theta] = self.critical_ratios.compute_for_direction(
                fit_indices[theta], contacts
            )
        circle = np.flatnonzero(ends == CIRCLE)
        if circle.size:
            f[circle, 3:], rho[circle] = ellipsoids.to_circles(circle)
        targets = ellipsoids.find_extrema(f, rho)
        targets[circle, 3:] = 0.0  # without rounding errors
        circle_ratios = last.circle_ratios.copy()
        circle_ratios[fit_indices[circle]] = rho[circle] ** 2 - ellipsoids.excess[circle]
        self._replace_by_circles(rows, targets, expansion, ellipsoids, rho)
        return Targets(targets, angles, m_factors, critical, circle_ratios)

    def _replace_ratios_of_centres(
        self, critical: FloatArray, rows: Rows, parameters: FloatArray
    ) -> None:
        """Replace c of the centre of fits with a known radius, in place.

        With b known, m = b + |d|: near the circle any error of d increases |d|, and so m, and moves
        the centre, as far as it is correlated with m, to the same side. In the squared correlation,
        as a fraction of its variance, the centre is a function of |d| as phi is; in the rest it is
        a normal quantity. c is interpolated between those of both by this fraction.
        """
        i = np.flatnonzero(IS_CENTRE[rows.ends] & self.stack.known_radius[rows.fit_indices])
        if not i.size:
            return
        fit_indices, coordinates = rows.fit_indices[i], (rows.ends[i] >= Y_LOW).astype(int)
        fractions = self._squared_correlations_with_m(fit_indices, coordinates)
        lengths = CENTRE_FLATTENING_FRACTION * np.abs(deviators_from_parameters(parameters[i]))
        near_circle = self.critical_ratios.compute_for_flattening(
            fit_indices, lengths / parameters[i, 2]
        )
        one = self.critical_ratios.one_dof[fit_indices]
        critical[i] = one + fractions * (near_circle - one)

    def _squared_correlations_with_m(
        self, fit_indices: IntArray, coordinates: IntArray
    ) -> FloatArray:
        """Return the squared correlations (k,) of a coordinate of the centre with m - known radius.

        They are those of the points for a given d; 1 where the points do not determine them.
        `coordinates` (k,) are 0 for centre_x, 1 for centre_y.
        """
        information = self.best.information_of_points[fit_indices, :3, :3]
        # Of points at one or two positions it is singular.
        finite = np.nan_to_num(information, posinf=0.0, neginf=0.0)
        covariances = np.linalg.pinv(finite, hermitian=True)
        known = [self.stack.fits[j].problem.known_radius for j in fit_indices]
        k = np.arange(len(known))
        fractions = covariances[k, coordinates, 2] ** 2 / covariances[k, coordinates, coordinates]
        fractions /= covariances[:, 2, 2] + [radius.std**2 if radius else 0.0 for radius in known]
        clipped: FloatArray = np.clip(np.nan_to_num(fractions, nan=1.0), 0.0, 1.0)
        return clipped

    def _replace_by_circles(
        self,
        rows: Rows,
        targets: FloatArray,
        expansion: Expansion,
        ellipsoids: Ellipsoids,
        rho: FloatArray,
    ) -> None:
        """Replace targets whose extremum is a circle, in place.

        The radius b = m - |d| has a kink at d = 0, where its derivatives by d are all vectors -v
        with |v| <= 1. A circle is therefore an extremum of b (and, on the surface b = const of a
        known radius, of any quantity) if F has derivatives by d not longer than that by m: the
        condition of Karush, Kuhn and Tucker. F is that of the points, since a prior on the radius
        is a function of b, and one on phi is stationary at a circle.
        """
        fit_indices, ends = rows
        on_known_radius = self.stack.known_radius[fit_indices] & CIRCLE_GRADIENTS[ends].any(axis=1)
        i = np.flatnonzero(on_known_radius | (ends == RADIUS_HIGH))
        i = i[rho[i] > np.abs(ellipsoids.whitened[i])]  # there are circles in the ellipsoid
        if not i.size:
            return
        circles = ellipsoids.find_extreme_circles(i, rho[i], CIRCLE_GRADIENTS[ends[i]])
        slopes = multiply_vectors(
            expansion.information_of_points[i], circles - expansion.parameters[i]
        )
        slopes += expansion.gradient_of_points[i]
        is_circle = np.hypot(slopes[:, 3], slopes[:, 4]) <= slopes[:, 2]
        targets[i[is_circle]] = circles[is_circle]

    def search_directions(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and factors k (s, 6) near the extrema over the ellipsoids at the estimates.

        Of each end, the best of `SEARCHED_ANGLES`; of a second end, the best of those that are
        more than 90 deg away from it.
        """
        parameters, shapes = self.stack.parameters[:, 2:], self.best.covariance[:, 2:, 2:]
        m_factors = np.ones((len(parameters), DIRECTED_END_COUNT))
        flattenings = np.hypot(parameters[:, 1], parameters[:, 2]) / parameters[:, 0]
        m_factors[:, IS_PHI[:DIRECTED_END_COUNT]] = flattenings[:, None]
        f = np.tile(SEARCHED_GRADIENTS, (*m_factors.shape, 1, 1))
        f[..., 0] = -m_factors[:, :, None]
        variances = ((f @ shapes[:, None]) * f).sum(axis=3)
        stds = np.sqrt(self.critical_ratios.one_dof[:, None, None] * variances)
        # f' mu +/- rho sqrt(f' C f) of the docstring of the module, the largest of which counts.
        extrema = (f * parameters[:, None, None]).sum(axis=3) + FLATTENING_SIGNS[:, None] * stds
        best = extrema.argmax(axis=2)
        is_opposite = np.cos(SEARCHED_ANGLES - SEARCHED_ANGLES[best][..., None]) < 0
        second = list(SECOND_ENDS.values())
        best[:, second] = np.where(is_opposite, extrema, -np.inf)[:, second].argmax(axis=2)
        return SEARCHED_ANGLES[best], m_factors

    def _find_directions(
        self, rows: Rows, ellipsoids: Ellipsoids, last: Targets
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angles, factors k and c (k,); those of ends without a direction are the last."""
        angles, m_factors, critical = (field.copy() for field in last[1:4])
        active = np.flatnonzero(rows.ends < DIRECTED_END_COUNT)
        for _ in range(CRITICAL_UPDATES):
            if not active.size:
                break
            centres, shapes = ellipsoids.centres[active, 2:], ellipsoids.shapes[active, 2:, 2:]
            angles[active], m_factors[active] = _turn_to_extrema(
                rows.ends[active], (centres, shapes),
                ellipsoids.excess[active] + critical[active], angles[active], m_factors[active],
            )  # fmt: skip
            active = active[IS_PHI[rows.ends[active]]]
            new = self.critical_ratios.compute_for_flattening(
                rows.fit_indices[active], m_factors[active]
            )
            changed = new != critical[active]
            critical[active] = new
            active = active[changed]
        return angles, m_factors, critical


def _gradients_of_ends(ends: IntArray, angles: FloatArray, m_factors: FloatArray) -> FloatArray:
    """Return f (k, 5) of centre, radius and phi; 0 for theta and the best circle."""
    f = LINEAR_GRADIENTS[ends]
    directed = np.flatnonzero(ends < DIRECTED_END_COUNT)
    u = np.cos(angles[directed]), np.sin(angles[directed])
    f[directed, 2:] = (FLATTENING_SIGNS[ends[directed]] * [-m_factors[directed], *u]).T
    return f


def _turn_to_extrema(
    ends: IntArray,
    centres_and_shapes: tuple[FloatArray, FloatArray],
    squared_radii: FloatArray,
    angles: FloatArray,
    m_factors: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the angles of u and factors k at extrema of h - k m over ellipsoids of (m, p, q).

    The extremum for a fixed u, S(u) = f' mu +/- rho sqrt(f' C f), is maximised over the angle of u
    by Newton's method. With the unit vector v perpendicular to u, C_vf = v' C f and so on, its
    derivatives are v . d and -u . d +/- rho (C_vv - C_vf^2 / C_ff) / sqrt(C_ff). Where the second
    one is not negative, u is turned to d.
    """
    centres, shapes = centres_and_shapes
    # Mean principal value of the shapes of d, and half their difference times exp(2 i angle).
    pp, pq, qq = shapes[:, 1, 1], shapes[:, 1, 2], shapes[:, 2, 2]
    mean, deviator = (pp + qq) / 2, (pp - qq) / 2 + 1j * pq
    radii = FLATTENING_SIGNS[ends] * np.sqrt(np.maximum(squared_radii, 0.0))
    is_phi, moving = IS_PHI[ends], np.ones(len(ends), dtype=bool)
    for _ in range(MAX_NEWTON_STEPS):
        u = np.exp(1j * angles)
        f = np.empty_like(centres)
        f[:, 0], f[:, 1:] = -m_factors, as_vectors(u)
        Cf = multiply_vectors(shapes, f)
        C_ff = np.maximum((f * Cf).sum(axis=1), TINY)
        scale = radii / np.sqrt(C_ff)
        extrema = centres + scale[:, None] * Cf
        # Components along u (real part) and v (imaginary part).
        u_conj = u.conj()
        d, C_vf = as_complex(extrema[:, 1:]) * u_conj, (as_complex(Cf[:, 1:]) * u_conj).imag
        C_vv = mean - (deviator * u_conj * u_conj).real
        curvatures = d.real - scale * (C_vv - C_vf * C_vf / C_ff)  # minus the second derivative
        turns = np.where(curvatures > 0, d.imag / curvatures, np.angle(d))
        turns = np.minimum(np.maximum(turns, -MAX_TURN), MAX_TURN) * moving
        flattenings = np.minimum(np.maximum(d.real / np.maximum(extrema[:, 0], TINY), 0.0), 1.0)
        new = np.where(is_phi & moving, flattenings, m_factors)
        moving &= np.maximum(np.abs(turns), np.abs(new - m_factors)) >= DIRECTION_TOLERANCE
        angles, m_factors = angles + turns, new
        if not moving.any():
            break
    return angles, m_factors
