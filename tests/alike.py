"""Equality up to symmetry, theta modulo pi and an axis up to its sign; rotations as a series."""

import math

import numpy as np


def turn_between(first, second, period=math.pi):
    """Smallest turn from one direction to another; of lines modulo pi. Units: rad."""
    return (second - first + period / 2) % period - period / 2


def assert_same_ellipse(found, truth, atol):
    """Same within `atol` (mm); theta by how far it moves the tip, so that a circle's is free."""
    np.testing.assert_allclose(found.centre, truth.centre, rtol=0, atol=atol)
    axes = (found.semi_major, found.semi_minor)
    np.testing.assert_allclose(axes, (truth.semi_major, truth.semi_minor), rtol=0, atol=atol)
    turn = turn_between(found.theta, truth.theta)
    assert abs(turn) * (truth.semi_major - truth.semi_minor) <= atol, f"theta off by {turn} rad"


def assert_same_axis(found, truth, atol):
    """Same direction up to its sign, within `atol` (rad)."""
    found, truth = np.asarray(found), np.asarray(truth)
    sine = np.linalg.norm(np.cross(found, truth)) / np.linalg.norm(found) / np.linalg.norm(truth)
    assert sine <= atol, f"axes {sine} rad apart"


def assert_same_pose(found, truth, atol):
    """Same rotation (entries) and translation (mm) within `atol`."""
    np.testing.assert_allclose(found.rotation, truth.rotation, rtol=0, atol=atol)
    np.testing.assert_allclose(found.translation, truth.translation, rtol=0, atol=atol)


def rotation_series(vector, terms=60):
    """Rotation of a vector as the power series of the matrix exponential."""
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    total, term = np.eye(3), np.eye(3)
    for power in range(1, terms):
        term = term @ cross / power
        total = total + term
    return total
