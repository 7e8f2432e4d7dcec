"""Shape of a board that is not flat: bowed along x, along y, and twisted.

z = b1 (1 - X^2) + b2 (1 - Y^2) + b3 X Y with X, Y = -1 to 1 over the corners, z away from the
camera: the two-parameter bow of mrcal, and the twist of a sheet that lies on two opposite corners.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, Points

SHAPE_TERMS = 3
"""Number of parameters: bow along x, bow along y, twist."""
MIN_REPORTED_MM = 0.02
"""Bow or twist below which no warning is given. Units: mm."""


@dataclass(frozen=True, eq=False)
class BoardShape:
    """Heights of a bent board as functions of its parameters.

    Parameters
    ----------
    middle, half_extent : (2,) ndarray
        Middle and half of the extent of the corners, board plane. Units: mm.

    Examples
    --------
    >>> shape = BoardShape.of(np.array([[0.0, 0.0, 0.0], [40.0, 20.0, 0.0]]))
    >>> points = np.array([[20.0, 10.0], [40.0, 20.0]])
    >>> shape.compute_heights(points, np.array([0.1, 0.2, 0.5])).tolist()
    [0.30000000000000004, 0.5]
    """

    middle: FloatArray
    half_extent: FloatArray

    @classmethod
    def of(cls, corners: Points) -> "BoardShape":
        """Return the shape over corners (n, 2) or (n, 3)."""
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        return cls((low + high) / 2, (high - low) / 2)

    def evaluate_terms(self, points: Points) -> FloatArray:
        """Return the derivatives (n, 3) of the heights at points (n, 2) by the parameters."""
        scaled = (points - self.middle) / self.half_extent
        return np.column_stack([1 - scaled**2, scaled.prod(axis=1)])

    def compute_heights(self, points: Points, parameters: FloatArray) -> FloatArray:
        """Return z of the board at points (n, 2). Units: mm."""
        return self.evaluate_terms(points) @ parameters

    def compute_slopes(self, points: Points, parameters: FloatArray) -> FloatArray:
        """Return dz/dx and dz/dy of the board at points (n, 2)."""
        scaled = (points - self.middle) / self.half_extent
        scaled_slopes = -2 * parameters[:2] * scaled + parameters[2] * scaled[:, ::-1]
        slopes: FloatArray = scaled_slopes / self.half_extent
        return slopes

    def bend(self, corners: Points, parameters: FloatArray) -> Points:
        """Return corners (n, 3) of the flat pattern, moved to the bent board. Units: mm."""
        bent = corners.copy()
        bent[:, 2] += self.compute_heights(corners[:, :2], parameters)
        return bent


def is_shape_determined(corners: Points) -> bool:
    """Return whether corners (n, 3) determine all parameters: not those of two rows or columns."""
    terms = BoardShape.of(corners).evaluate_terms(corners[:, :2])
    return bool(np.linalg.matrix_rank(terms) == SHAPE_TERMS)


def list_bow_warnings(parameters: FloatArray, std: FloatArray) -> list[str]:
    """Return the warning about a board that is not flat, in a list; empty if it may be flat.

    `parameters` and `std` (3,) are bow along x, along y, and twist, with standard deviations, in
    mm.
    """
    if not np.any((np.abs(parameters) > MIN_REPORTED_MM) & (np.abs(parameters) > 3 * std)):
        return []
    along_x, along_y, twist = parameters
    return [
        f"the board is bowed by {along_x:+.3f} mm along x and {along_y:+.3f} mm along y, and "
        f"twisted by {twist:+.3f} mm at its corners; the result is corrected for it, a flat board "
        "is better"
    ]
