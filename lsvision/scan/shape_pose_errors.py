"""Effect of the errors of the poses on the shape of a scanned cylinder.

A section that lies beside its stated place makes a straight cylinder look bent, and a feed along
another direction shears a round cylinder to an oval one. Neither shows in the residuals.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.geometry import FloatArray, IntArray, Pose
from lsvision.scan.pose_errors import (
    common_error_jacobian,
    remove_pose_errors,
    section_error_jacobian,
)
from lsvision.scan.scan_result import ScannedCylinder


@dataclass(frozen=True, eq=False, slots=True)
class PoseDisplacements:
    """Displacements of the points of a cylinder along its normals, by the errors of the poses.

    Each is that by an error of one standard deviation, divided by the standard deviation of the
    point, as normalised residuals are.

    Parameters
    ----------
    common : (n, k) ndarray
        By the k errors that are common to all sections, see `common_error_jacobian`.
    own : (n, j) ndarray
        By the j errors of the section of each point, see `section_error_jacobian`.
    point_sections : (n,) int ndarray
        Section of each point.
    """

    common: FloatArray
    own: FloatArray
    point_sections: IntArray

    @classmethod
    def of_cylinder(cls, cylinder: ScannedCylinder) -> Self:
        """Return the displacements of the points of a cylinder."""
        normals = cylinder.cylinder.normals(cylinder.points)
        scale = cylinder.fit.stds[:, None]
        return cls(
            common_error_jacobian(normals, cylinder, cylinder.pose_errors) / scale,
            section_error_jacobian(normals, cylinder, cylinder.pose_errors) / scale,
            cylinder.point_sections,
        )

    def covariance(self, jacobian: FloatArray, inverse: FloatArray) -> FloatArray:
        """Return the covariance (p, p) that the pose errors add to that of a fit.

        Parameters
        ----------
        jacobian : (n, p) ndarray
            Derivatives of the normalised residuals by the parameters.
        inverse : (p, p) ndarray
            Inverse of the information matrix of the fit, in which the poses are taken as exact.
        """
        responses = [jacobian.T @ self.common]
        for section in np.unique(self.point_sections):
            rows = self.point_sections == section
            responses.append(jacobian[rows].T @ self.own[rows])
        response = inverse @ np.hstack(responses)
        covariance: FloatArray = response @ response.T
        return covariance

    def remove_from(self, residuals: FloatArray, jacobian: FloatArray) -> tuple[FloatArray, float]:
        """Return the residuals without the effect of the pose errors; see `remove_pose_errors`."""
        return remove_pose_errors(residuals, jacobian, self.common, self.own, self.point_sections)


def centre_covariances(cylinder: ScannedCylinder, along: FloatArray) -> FloatArray:
    """Return the covariances (k, 2, 2) of the section centres' deviations from the axis, in mm^2.

    They are those by the errors of the poses alone, along e_phi and e_theta (`tangent_basis`). Each
    section moves with its pose as a rigid body, and the axis is the straight line through the
    centres, weighted by the number of points of each section.

    Parameters
    ----------
    cylinder : ScannedCylinder
        Cylinder with the stated errors of its poses.
    along : (k,) ndarray
        Position of each section along the axis, from ``cylinder.point``. Units: mm.
    """
    sections, counts = np.unique(cylinder.point_sections, return_counts=True)
    centres = _Centres(
        cylinder.point + along[:, None] * cylinder.direction, sections, cylinder.poses
    )
    lateral = [np.tile(axis, (len(along), 1)) for axis in cylinder.tangent_basis]
    # (k, 2, errors): displacement of each centre along e_phi and e_theta.
    common, own = (
        np.stack([jacobian(axis, centres, cylinder.pose_errors) for axis in lateral], axis=1)
        for jacobian in (common_error_jacobian, section_error_jacobian)
    )
    line = np.column_stack([np.ones(len(along)), along - along.mean()])
    weighted = line * counts[:, None]
    from_line = np.eye(len(along)) - line @ np.linalg.solve(line.T @ weighted, weighted.T)
    off_line = np.einsum("st,tij->sij", from_line, common)
    covariances: FloatArray = np.einsum("sik,sjk->sij", off_line, off_line)
    covariances += np.einsum("st,tik,tjk->sij", from_line**2, own, own)
    return covariances


@dataclass(frozen=True, eq=False, slots=True)
class _Centres:
    """Centres of sections (k, 3), as points of a scan."""

    points: FloatArray
    point_sections: IntArray
    poses: tuple[Pose, ...]
