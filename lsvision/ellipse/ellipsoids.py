"""Ellipsoids by which regions {F <= min F + c} are approximated, and points on their surfaces.

The expansion of F (`lsvision.ellipse.cost_expansion`) is at most min F + c in an ellipsoid, whose
shape is the covariance A^-1. Its coordinates are (centre_x, centre_y, m, p, q); d = (p, q) is 0 for
a circle (`lsvision.ellipse.parameters`).
"""

from typing import NamedTuple

import numpy as np

from lsvision.ellipse.cost_expansion import Expansion, multiply_vectors
from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.arrays import TINY
from lsvision.geometry.noisy_points import ComplexArray

MAX_TANGENT_SINE = 0.98
"""Largest sine of half the angle that the ellipse of d subtends at the circle d = 0: from a circle
inside the ellipse there is no tangent to it, and the ellipse is made smaller."""


class Ellipsoids(NamedTuple):
    """k ellipsoids (x - mu)' C^-1 (x - mu) <= rho^2, whose radii rho are given to its methods.

    Whitened coordinates of d are L^-1 d, with the Cholesky factor L of the shape of d: in them the
    projection of an ellipsoid is a circle of radius rho.

    Parameters
    ----------
    centres : (k, 5) ndarray
        Centres mu, minima of the expansion. Units: mm.
    shapes, information : (k, 5, 5) ndarray
        Shapes C, and their inverses. Units: mm^2, 1/mm^2.
    excess : (k,) ndarray
        min F less the minimum of the expansion of F, so that rho^2 = c + excess.
    roots : (3, k) ndarray
        Entries 11, 21 and 22 of L. Units: mm.
    whitened : (k,) complex ndarray
        d of the centres in whitened coordinates.
    """

    centres: FloatArray
    shapes: FloatArray
    information: FloatArray
    excess: FloatArray
    roots: FloatArray
    whitened: ComplexArray

    @classmethod
    def of(cls, expansion: Expansion, min_costs: FloatArray) -> "Ellipsoids":
        """Return the ellipsoids of an expansion of F; `min_costs` (k,) are min F."""
        to_centre = multiply_vectors(expansion.covariance, expansion.gradient)
        centres, shapes = expansion.parameters - to_centre, expansion.covariance
        excess = min_costs - expansion.cost
        excess += (expansion.gradient * to_centre).sum(axis=1)
        first = np.sqrt(np.maximum(shapes[:, 3, 3], TINY))
        mixed = shapes[:, 3, 4] / first
        second = np.sqrt(np.maximum(shapes[:, 4, 4] - mixed * mixed, TINY))
        p = centres[:, 3] / first
        whitened = p + 1j * ((centres[:, 4] - mixed * p) / second)
        roots = np.array([first, mixed, second])
        return cls(centres, shapes, expansion.information, excess, roots, whitened)

    def find_extrema(self, f: FloatArray, rho: FloatArray) -> FloatArray:
        """Return the points (k, 5) where linear functions with gradients f (k, 5) are largest."""
        Cf = multiply_vectors(self.shapes, f)
        scale = rho / np.sqrt(np.maximum((f * Cf).sum(axis=1), TINY))
        extrema: FloatArray = self.centres + scale[:, None] * Cf
        return extrema

    def find_extreme_circles(self, rows: IntArray, rho: FloatArray, f: FloatArray) -> FloatArray:
        """Return the circles at which linear functions are largest, (j, 5).

        The circles in an ellipsoid are an ellipsoid in (x, y, m) about the best circle, whose shape
        is the inverse of the information on (x, y, m).

        Parameters
        ----------
        rows : (j,) int ndarray
            Ellipsoids that contain circles.
        rho : (j,) ndarray
            Radii of the ellipsoids.
        f : (j, 3) ndarray
            Gradients by (x, y, m).
        """
        to_circle, rho_of_circles = self.to_circles(rows)
        circles = self.centres[rows] + multiply_vectors(self.shapes[rows, :, 3:], to_circle)
        shapes = np.asarray(np.linalg.inv(self.information[rows, :3, :3]), dtype=np.float64)
        Cf = multiply_vectors(shapes, f)
        scale = np.sqrt((rho**2 - rho_of_circles**2) / (f * Cf).sum(axis=1))
        circles[:, :3] += scale[:, None] * Cf
        circles[:, 3:] = 0.0
        return circles

    def to_circles(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return f by (p, q), (j, 2), and rho (j,) with which the extremum is the best circle.

        That is the circle with the smallest F; rho is the distance of d of the centres from 0 in
        whitened coordinates.
        """
        whitened = self.whitened[rows]
        return self._gradients(rows, -whitened), np.abs(whitened)

    def find_tangents(
        self, rows: IntArray, rho: FloatArray, sides: FloatArray
    ) -> tuple[FloatArray, FloatArray, ComplexArray]:
        """Return the tangents from d = 0 to the projections of ellipsoids on d.

        In whitened coordinates the point of contact with the circle of radius rho about z is z +
        sin(v) z (-sin(v) +/- i cos(v)), where sin(v) = rho / |z|.

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
            f by (p, q), normal to the tangents.
        rho : (j,) ndarray
            Radii, reduced where d = 0 is inside; see `MAX_TANGENT_SINE`.
        d : (j,) complex ndarray
            Points of contact. Units: mm.
        """
        whitened, (first, mixed, second) = self.whitened[rows], self.roots[:, rows]
        distances = np.maximum(np.abs(whitened), TINY)
        rho = np.minimum(rho, MAX_TANGENT_SINE * distances)
        sines = rho / distances
        steps = sines * whitened * (-sines + 1j * (sides * np.sqrt(1 - sines * sines)))
        contact = whitened + steps
        d = first * contact.real + 1j * (mixed * contact.real + second * contact.imag)
        return self._gradients(rows, steps), rho, d

    def _gradients(self, rows: IntArray, directions: ComplexArray) -> FloatArray:
        """Return gradients by (p, q), (j, 2): L'^-1 times those in whitened coordinates."""
        first, mixed, second = self.roots[:, rows]
        by_q = directions.imag / second
        return np.array([(directions.real - mixed * by_q) / first, by_q]).T
