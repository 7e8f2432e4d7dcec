"""The line of centres of a tube: each section for itself, beside the common axis."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray

GAUSS_NEWTON_ITERATIONS = 6
"""Gauss-Newton steps for a centre; a millimetre off, four are enough."""


@dataclass(frozen=True, eq=False, slots=True)
class SectionCentres:
    """Where each section's circle lies, seen along the axis of the whole tube.

    Parameters
    ----------
    sections : (k,) ndarray of int
        Indices of the profiles.
    along : (k,) ndarray
        Mean place of each section's points along the axis, from the scanned cylinder's point.
        Units: mm.
    deviations : (k, 2) ndarray
        Centre beside the straight axis, along e_phi and e_theta, of a circle of the tube's
        mean radius. Units: mm.
    deviation_covariances : (k, 2, 2) ndarray
        Units: mm^2.
    radii : (k,) ndarray
        Radius of each section where its centre is left free as well. Units: mm.
    radii_std : (k,) ndarray
        One sigma; wide, as one section's are. Units: mm.
    """

    sections: IntArray
    along: FloatArray
    deviations: FloatArray
    deviation_covariances: FloatArray
    radii: FloatArray
    radii_std: FloatArray

    @property
    def deviations_std(self) -> FloatArray:
        """(k, 2) one sigma along e_phi and e_theta. Units: mm."""
        return np.sqrt(np.diagonal(self.deviation_covariances, axis1=1, axis2=2))


def fit_section_centres(
    owners: IntArray, places: FloatArray, stds: FloatArray, radius: float
) -> SectionCentres:
    """Fit a circle to the points of each section as seen along the axis.

    Parameters
    ----------
    owners : (n,) int ndarray
        Section of each point.
    places : (3, n) ndarray
        Points from the axis, along e_phi and e_theta, and along the axis. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each point's distance from the axis. Units: mm.
    radius : float
        Of the tube. Units: mm.
    """
    sections, place = np.unique(owners, return_inverse=True)
    across, along = places[:2], places[2]
    fixed, fixed_covariances = _fit_circles(across, stds, place, radius, free=2)
    free, free_covariances = _fit_circles(across, stds, place, radius, free=3)
    count = np.bincount(place)
    return SectionCentres(
        sections=sections,
        along=np.bincount(place, along) / count,
        deviations=fixed[:, :2],
        deviation_covariances=fixed_covariances,
        radii=radius + free[:, 2],
        radii_std=np.sqrt(free_covariances[:, 2, 2]),
    )


def _fit_circles(
    across: FloatArray, stds: FloatArray, place: IntArray, radius: float, *, free: int
) -> tuple[FloatArray, FloatArray]:
    """(centre_1, centre_2, radius - common radius) of each section, and their covariances."""
    count = int(place.max()) + 1
    unknowns = np.zeros((count, 3))
    # An arc too short for its own circle says nothing: it keeps the tube's, within its radius.
    prior = np.eye(free) / radius**2
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        from_centre = across - unknowns[place, :2].T
        distance = np.hypot(*from_centre)
        design = np.column_stack([(from_centre / distance).T, np.ones(len(stds))])[:, :free]
        design /= stds[:, None]
        misfit = (distance - radius - unknowns[place, 2]) / stds
        information = np.tile(prior, (count, 1, 1))
        np.add.at(information, place, design[:, :, None] * design[:, None, :])
        pull = np.zeros((count, free))
        np.add.at(pull, place, design * misfit[:, None])
        covariances = np.asarray(np.linalg.inv(information), dtype=np.float64)
        unknowns[:, :free] += (covariances @ pull[..., None])[..., 0]
    return unknowns, covariances
