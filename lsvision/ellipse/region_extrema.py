"""Extrema of five quantities over ellipsoids: the targets of a step towards the ends of intervals.

About parameters (centre_x, centre_y, m, p, q) the region {F <= min F + c} is nearly an ellipsoid
with centre mu, radius rho and shape C: (x - mu)' C^-1 (x - mu) <= rho^2. The quantities are not
approximated: each is linear for a fixed direction of d = (p, q), so its extremum is ``mu + rho C f
/ sqrt(f' C f)``, with f the gradient for that direction (h = |d|):

- centre: f is an axis;
- theta: f is normal to the tangent from the circle d = 0 to the ellipsoid;
- radius and phi: f = +/- (u . d - kappa m), with u the direction of d at the extremum itself, found
  by Newton's method on its angle, and kappa = 1 for the radius, h / m for phi;
- best circle: f leads from the centre to the nearest point with d = 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, multiply_vectors
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import PARAMETERS, deviators_from_parameters
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, select_rows
from lsvision.geometry.noisy_points import ComplexArray, as_complex, as_vectors

RADIUS_LOW, RADIUS_HIGH, PHI_LOW, PHI_HIGH, RADIUS_LOW_2, PHI_HIGH_2 = range(6)
X_LOW, X_HIGH, Y_LOW, Y_HIGH, THETA_LOW, THETA_HIGH, CIRCLE = range(6, 13)
DIRECTED, ENDS = 6, 13
"""Number of ends that have a direction u, which come first, and of all ends of a fit."""
SECOND_ENDS = {RADIUS_LOW: RADIUS_LOW_2, PHI_HIGH: PHI_HIGH_2}
"""The smallest radius and the largest phi may have two local extrema, with opposite d."""
OUTWARD = np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
"""+1 for the ends of largest h, -1 for those of smallest."""
IS_PHI = np.isin(np.arange(ENDS), (PHI_LOW, PHI_HIGH, PHI_HIGH_2))
"""Whether each of the 13 ends is one of phi."""
IS_CENTRE = np.isin(np.arange(ENDS), (X_LOW, X_HIGH, Y_LOW, Y_HIGH))
"""Whether each of them is one of the centre."""
GRADIENTS = np.zeros((ENDS, PARAMETERS))
"""Gradients of the quantities that are linear: centre_x and centre_y, outward at each end."""
GRADIENTS[[X_LOW, X_HIGH, Y_LOW, Y_HIGH], [0, 0, 1, 1]] = -1.0, 1.0, -1.0, 1.0
RIDGE_GRADIENTS = GRADIENTS[:, :3].copy()
"""Gradients by (x, y, m), on d = 0, of the quantities whose extremum may be a circle: radius, and
with a known radius those on the surface b = const."""
RIDGE_GRADIENTS[RADIUS_HIGH, 2] = 1.0

SEARCHED_ANGLES = np.radians(np.arange(0.0, 360.0, 15.0))
"""Initial directions of d for radius and phi. Units: rad."""
SEARCHED = np.stack([0 * SEARCHED_ANGLES, np.cos(SEARCHED_ANGLES), np.sin(SEARCHED_ANGLES)], axis=1)
"""The same as gradients by (m, p, q)."""
MAX_TURN = 0.7
"""Longest Newton step of the direction u. Units: rad."""
MAX_ROUNDS, DIRECTION_TOLERANCE = 4, 0.02
"""Largest number of Newton steps of the direction u, and step of the angle (rad) and of kappa below
which they end."""
NUISANCE_FRACTION = 0.5
"""With a known radius c of the centre is taken for this fraction of |d| at the end of its interval:
estimates of |d| near a circle are too large. With 1, 91 % of the 95 % intervals of centre_y of
untilted pipes hold, with 0.5 93 to 97 %."""
CRITICAL_ROUNDS = 2
"""Number of updates of c of phi in an iteration."""
MAX_TANGENT = 0.98
"""Largest sine of half the angle that the ellipsoid subtends at the circle: a circle inside the
ellipsoid has no tangent to it."""


class Rows(NamedTuple):
    """Ends that are searched; as a tuple, an index of arrays (s, 13, ...) that selects them.

    Parameters
    ----------
    owners : (k,) int ndarray
        Number of the fit of each end.
    ends : (k,) int ndarray
        Which of the 13 ends each one is: `RADIUS_LOW` to `CIRCLE`.
    """

    owners: IntArray
    ends: IntArray


class Targets(NamedTuple):
    """Targets of a step.

    Parameters
    ----------
    parameters : (k, 5) ndarray
        Extrema over the ellipsoids. Units: mm.
    angles : (k,) ndarray
        Angle of the direction u of d = (p, q). Units: rad.
    kappas : (k,) ndarray
        Factor of m in the quantity.
    critical : (k,) ndarray
        Critical ratios c.
    circle_ratios : (s,) ndarray
        Minimum of F on d = 0 less min F, for each fit.
    """

    parameters: FloatArray
    angles: FloatArray
    kappas: FloatArray
    critical: FloatArray
    circle_ratios: FloatArray

    def select(self, rows: BoolArray) -> "Targets":
        """Return the targets of some rows."""
        return Targets(*select_rows(self[:4], rows), self.circle_ratios)


class Ellipsoids(NamedTuple):
    """Projections of k ellipsoids on (m, p, q), and of their centres on (p, q) in sigmas.

    Parameters
    ----------
    centres : (k, 3) ndarray
        Centres mu. Units: mm.
    shapes : (k, 3, 3) ndarray
        Shapes C. Units: mm^2.
    excess : (k,) ndarray
        Squared radii rho^2 less c.
    roots : (3, k) ndarray
        Entries 11, 21 and 22 of the Cholesky factors of the shapes of d. Units: mm.
    whitened : (k,) complex ndarray
        d of the centres in sigmas.
    """

    centres: FloatArray
    shapes: FloatArray
    excess: FloatArray
    roots: FloatArray
    whitened: ComplexArray

    @classmethod
    def of(cls, centres: FloatArray, shapes: FloatArray, excess: FloatArray) -> "Ellipsoids":
        """Return ellipsoids with the Cholesky factors of d."""
        first = np.sqrt(np.maximum(shapes[:, 1, 1], TINY))
        mixed = shapes[:, 1, 2] / first
        second = np.sqrt(np.maximum(shapes[:, 2, 2] - mixed * mixed, TINY))
        p = centres[:, 1] / first
        whitened = p + 1j * ((centres[:, 2] - mixed * p) / second)
        return cls(centres, shapes, excess, np.array([first, mixed, second]), whitened)

    def to_circles(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradients by (p, q) whose extrema have d = 0, (j, 2).

        Also return the distances (j,) of the centres from d = 0, in sigmas.
        """
        whitened = self.whitened[rows]
        return self._gradients(rows, -whitened), np.abs(whitened)

    def find_tangents(
        self, rows: IntArray, rho: FloatArray, sides: FloatArray
    ) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """Return the tangents from d = 0 to the ellipses of d with radii rho (j,).

        Parameters
        ----------
        rows : (j,) int ndarray
            Ellipsoids of the tangents.
        rho : (j,) ndarray
            Radii of the ellipsoids.
        sides : (j,) ndarray
            +1 for the tangent at the larger angle, -1 for the other one.

        Returns
        -------
        gradients : (j, 2) ndarray
            Normals of the tangents by (p, q).
        rho : (j,) ndarray
            Radii, reduced where d = 0 is inside.
        d : (j,) complex ndarray
            Points of contact. Units: mm.
        """
        whitened, (first, mixed, second) = self.whitened[rows], self.roots[:, rows]
        distances = np.maximum(np.abs(whitened), TINY)
        rho = np.minimum(rho, MAX_TANGENT * distances)
        sines = rho / distances
        steps = sines * whitened * (-sines + 1j * (sides * np.sqrt(1 - sines * sines)))
        contact = whitened + steps
        d = first * contact.real + 1j * (mixed * contact.real + second * contact.imag)
        return self._gradients(rows, steps), rho, d

    def _gradients(self, rows: IntArray, directions: ComplexArray) -> FloatArray:
        """Return the gradients by (p, q) of linear functions from those in sigmas, (j, 2)."""
        first, mixed, second = self.roots[:, rows]
        by_q = directions.imag / second
        return np.array([(directions.real - mixed * by_q) / first, by_q]).T


@dataclass(frozen=True, eq=False, slots=True)
class Regions:
    """Regions {F <= min F + c} of the fits; `best` is the expansion at the estimates."""

    stack: FitStack
    ratios: CriticalRatios
    best: Expansion

    def find_targets(
        self, rows: Rows, parameters: FloatArray, expansion: Expansion, last: Targets
    ) -> Targets:
        """Return the extrema over the ellipsoids of the expansion about parameters (k, 5).

        Angles, kappas and c of the `last` targets are the initial guesses of the new ones.
        """
        owners, ends = rows
        to_centre = multiply_vectors(expansion.covariance, expansion.gradient)
        centres = parameters - to_centre
        excess = self.best.cost[owners] - expansion.cost
        excess += (expansion.gradient * to_centre).sum(axis=1)
        ellipsoids = Ellipsoids.of(centres[:, 2:], expansion.covariance[:, 2:, 2:], excess)
        angles, kappas, critical = self._find_directions(rows, ellipsoids, last)
        self._replace_ratios_of_centres(critical, rows, parameters)
        rho = np.sqrt(np.maximum(excess + critical, 0.0))
        f = GRADIENTS[ends]
        directed = np.flatnonzero(ends < DIRECTED)
        u = np.cos(angles[directed]), np.sin(angles[directed])
        f[directed, 2:] = (OUTWARD[ends[directed]] * [-kappas[directed], *u]).T
        theta = np.flatnonzero((ends == THETA_LOW) | (ends == THETA_HIGH))
        if theta.size:
            sides = np.where(ends[theta] == THETA_LOW, -1.0, 1.0)
            tangents = ellipsoids.find_tangents(theta, rho[theta], sides)
            f[theta, 3:], rho[theta], contacts = tangents
            critical[theta] = self.ratios.ratios_for_direction(owners[theta], contacts)
        circle = np.flatnonzero(ends == CIRCLE)
        if circle.size:
            f[circle, 3:], rho[circle] = ellipsoids.to_circles(circle)
        Cf = multiply_vectors(expansion.covariance, f)
        scale = rho / np.sqrt(np.maximum((f * Cf).sum(axis=1), TINY))
        targets = centres + scale[:, None] * Cf
        targets[circle, 3:] = 0.0
        circle_ratios = last.circle_ratios.copy()
        circle_ratios[owners[circle]] = rho[circle] ** 2 - excess[circle]
        self._replace_by_circles(rows, targets, parameters, expansion, (ellipsoids, rho))
        return Targets(targets, angles, kappas, critical, circle_ratios)

    def _replace_ratios_of_centres(
        self, critical: FloatArray, rows: Rows, parameters: FloatArray
    ) -> None:
        """Replace c of the centre of fits with a known radius, in place.

        With b known, m = b + |d|: near the circle any error of d moves the centre to the same side,
        as far as it is correlated with m. Then c is that of d, not of one quantity.
        """
        i = np.flatnonzero(IS_CENTRE[rows.ends] & self.stack.known_radius[rows.owners])
        if not i.size:
            return
        owners, coordinates = rows.owners[i], (rows.ends[i] >= Y_LOW).astype(int)
        information = self.best.information_of_points[owners, :3, :3]
        # Of points at one or two positions it is singular.
        finite = np.nan_to_num(information, posinf=0.0, neginf=0.0)
        covariances = np.linalg.pinv(finite, hermitian=True)
        k, known = np.arange(i.size), [self.stack.fits[j].problem.known_radius for j in owners]
        fractions = covariances[k, coordinates, 2] ** 2 / covariances[k, coordinates, coordinates]
        fractions /= covariances[:, 2, 2] + [radius.std**2 if radius else 0.0 for radius in known]
        fractions = np.clip(np.nan_to_num(fractions, nan=1.0), 0.0, 1.0)
        lengths = NUISANCE_FRACTION * np.abs(deviators_from_parameters(parameters[i]))
        near_circle = self.ratios.ratios_for_flattening(owners, lengths / parameters[i, 2])
        one = self.ratios.one_dof[owners]
        critical[i] = one + fractions * (near_circle - one)

    def _replace_by_circles(
        self,
        rows: Rows,
        targets: FloatArray,
        parameters: FloatArray,
        expansion: Expansion,
        ellipsoids_and_rho: tuple[Ellipsoids, FloatArray],
    ) -> None:
        """Replace targets whose extremum is a circle, in place.

        On d = 0 the radius b = m - |d| has a ridge. The largest radius, and with a known radius any
        extremum on the surface b = const, lies on the ridge if F of the points increases faster
        across it than along m.
        """
        (owners, ends), (ellipsoids, rho) = rows, ellipsoids_and_rho
        on_ridge = self.stack.known_radius[owners] & RIDGE_GRADIENTS[ends].any(axis=1)
        i = np.flatnonzero(on_ridge | (ends == RADIUS_HIGH))
        i = i[rho[i] > np.abs(ellipsoids.whitened[i])]
        if not i.size:
            return
        to_circle, distances = ellipsoids.to_circles(i)
        f, selected = RIDGE_GRADIENTS[ends[i]], select_rows(expansion, i)
        covariances = np.asarray(np.linalg.inv(selected.information[:, :3, :3]), dtype=np.float64)
        Cf = multiply_vectors(covariances, f)
        circles = parameters[i] - multiply_vectors(selected.covariance, selected.gradient)
        circles += multiply_vectors(selected.covariance[:, :, 3:], to_circle)
        lengths = np.sqrt((rho[i] ** 2 - distances**2) / (f * Cf).sum(axis=1))
        circles[:, :3] += lengths[:, None] * Cf
        circles[:, 3:] = 0.0
        slopes = multiply_vectors(selected.information_of_points, circles - parameters[i])
        slopes += selected.gradient_of_points
        is_circle = np.hypot(slopes[:, 3], slopes[:, 4]) <= slopes[:, 2]
        targets[i[is_circle]] = circles[is_circle]

    def search_directions(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and kappas (s, 6) near the extrema over the ellipsoids at the estimates."""
        parameters, shapes = self.stack.parameters[:, 2:], self.best.covariance[:, 2:, 2:]
        kappas = np.ones((len(parameters), DIRECTED))
        of_estimates = np.hypot(parameters[:, 1], parameters[:, 2]) / parameters[:, 0]
        kappas[:, IS_PHI[:DIRECTED]] = of_estimates[:, None]
        f = np.repeat(np.repeat(SEARCHED[None, None], DIRECTED, axis=1), len(kappas), axis=0)
        f[..., 0] = -kappas[:, :, None]
        variances = ((f @ shapes[:, None]) * f).sum(axis=3)
        stds = np.sqrt(self.ratios.one_dof[:, None, None] * variances)
        heights = (f * parameters[:, None, None]).sum(axis=3) + OUTWARD[:, None] * stds
        chosen = heights.argmax(axis=2)
        opposite = np.cos(SEARCHED_ANGLES - SEARCHED_ANGLES[chosen][..., None]) < 0
        second = list(SECOND_ENDS.values())
        chosen[:, second] = np.where(opposite, heights, -np.inf)[:, second].argmax(axis=2)
        return SEARCHED_ANGLES[chosen], kappas

    def _find_directions(
        self, rows: Rows, ellipsoids: Ellipsoids, last: Targets
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angles, kappas and c (k,); those of rows without a direction are the last ones."""
        angles, kappas, critical = (field.copy() for field in last[1:4])
        active = np.flatnonzero(rows.ends < DIRECTED)
        for _ in range(CRITICAL_ROUNDS):
            if not active.size:
                break
            angles[active], kappas[active] = _turn_to_extrema(
                rows.ends[active], (ellipsoids.centres[active], ellipsoids.shapes[active]),
                ellipsoids.excess[active] + critical[active], angles[active], kappas[active],
            )  # fmt: skip
            active = active[IS_PHI[rows.ends[active]]]
            new = self.ratios.ratios_for_flattening(rows.owners[active], kappas[active])
            changed = new != critical[active]
            critical[active] = new
            active = active[changed]
        return angles, kappas, critical


def _turn_to_extrema(
    ends: IntArray,
    centres_and_shapes: tuple[FloatArray, FloatArray],
    squared_radii: FloatArray,
    angles: FloatArray,
    kappas: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return angles of u and kappas at the extrema over ellipsoids, by Newton's method."""
    centres, shapes = centres_and_shapes
    # Mean principal value of the shapes of d, and half their difference times exp(2 i angle).
    pp, pq, qq = shapes[:, 1, 1], shapes[:, 1, 2], shapes[:, 2, 2]
    mean, deviator = (pp + qq) / 2, (pp - qq) / 2 + 1j * pq
    radii = OUTWARD[ends] * np.sqrt(np.maximum(squared_radii, 0.0))
    is_phi, moving = IS_PHI[ends], np.ones(len(ends), dtype=bool)
    for _ in range(MAX_ROUNDS):
        u = np.exp(1j * angles)
        f = np.empty_like(centres)
        f[:, 0], f[:, 1:] = -kappas, as_vectors(u)
        Cf = multiply_vectors(shapes, f)
        variances = np.maximum((f * Cf).sum(axis=1), TINY)
        scale = radii / np.sqrt(variances)
        extrema = centres + scale[:, None] * Cf
        # At the extremum d has the direction u: no component perpendicular to it. The derivative of
        # this component, d.imag below, by the angle of u is -slopes.
        u_conj = u.conj()
        d, C_across = as_complex(extrema[:, 1:]) * u_conj, (as_complex(Cf[:, 1:]) * u_conj).imag
        spread = mean - (deviator * u_conj * u_conj).real
        slopes = d.real - scale * (spread - C_across * C_across / variances)
        turns = np.where(slopes > 0, d.imag / slopes, np.angle(d))
        turns = np.minimum(np.maximum(turns, -MAX_TURN), MAX_TURN) * moving
        new = np.minimum(np.maximum(d.real / np.maximum(extrema[:, 0], TINY), 0.0), 1.0)
        new = np.where(is_phi & moving, new, kappas)
        moving &= np.maximum(np.abs(turns), np.abs(new - kappas)) >= DIRECTION_TOLERANCE
        angles, kappas = angles + turns, new
        if not moving.any():
            break
    return angles, kappas
