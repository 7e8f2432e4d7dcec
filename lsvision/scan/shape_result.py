"""Result of `measure_shape`: bow, taper and ovality of a cylinder, in numbers and text."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.equality import ComparedByValue
from lsvision.results.number_format import format_value
from lsvision.results.quantities import Record, convert_numbers_to_json, replace_nonfinite
from lsvision.results.result import Result

SIGNIFICANCE = 0.01
"""p-value below which a form deviation is called significant."""


@dataclass(frozen=True, eq=False)
class SectionCentres(ComparedByValue):
    """Circle fitted to the points of each section, projected along the axis of the cylinder.

    Parameters
    ----------
    sections : (k,) ndarray of int
        Indices of the profiles.
    along : (k,) ndarray
        Mean position of each section's points along the axis, from ``ScannedCylinder.point``.
        Units: mm.
    deviations : (k, 2) ndarray
        Deviation of the centre of a circle with the cylinder's mean radius from the straight axis,
        along e_phi and e_theta. Units: mm.
    deviation_covariances : (k, 2, 2) ndarray
        Covariances of `deviations`, with the error of the mean radius, which is common to all
        sections: it displaces all centres in nearly the same way. Units: mm^2.
    radii : (k,) ndarray
        Radius of each section when fitted together with its centre. Units: mm.
    radii_std : (k,) ndarray
        Standard uncertainty of `radii`, large because one section determines a radius poorly.
        Units: mm.
    """

    sections: IntArray
    along: FloatArray
    deviations: FloatArray
    deviation_covariances: FloatArray
    radii: FloatArray
    radii_std: FloatArray

    @property
    def deviations_std(self) -> FloatArray:
        """Standard uncertainty of `deviations`, (k, 2). Units: mm."""
        return np.sqrt(np.diagonal(self.deviation_covariances, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class FormDeviation(ComparedByValue):
    """One deviation of a cylinder from a straight circular one.

    Parameters
    ----------
    values : (k,) ndarray
        Components of the deviation. Units: mm.
    covariance : (k, k) ndarray
        Covariance of `values`. Units: mm^2.
    p_value : float
        Probability of a deviation at least as large if the cylinder has none.
    """

    values: FloatArray
    covariance: FloatArray
    p_value: float

    @property
    def size(self) -> float:
        """Norm of `values`. Units: mm."""
        return float(np.linalg.norm(self.values))

    @property
    def size_std(self) -> float:
        """Standard uncertainty of `size`, along the direction of `values`. Units: mm.

        That of the first component if all values are zero.
        """
        unit = self.values / self.size if self.size > 0 else np.eye(len(self.values))[0]
        return math.sqrt(float(unit @ self.covariance @ unit))

    def is_significant(self, level: float = SIGNIFICANCE) -> bool:
        """Return whether the p-value is below a significance level."""
        return self.p_value < level


@dataclass(frozen=True, eq=False, repr=False)
class CylinderShape(Result):
    """Form deviations of a cylinder along its axis.

    Parameters
    ----------
    centres : SectionCentres
        Centre and radius of each section relative to the straight axis.
    bow : FormDeviation
        Deviation from straightness: distance of the axis from its tangent in the middle, at
        both ends of the measured length, along e_phi and e_theta of the fit.
    taper : FormDeviation
        Increase of the radius from the middle to the end of the measured length.
    ovality_terms : FormDeviation
        Amplitudes o1, o2 of the radius r + o1 cos 2 psi + o2 sin 2 psi, with the angle psi about
        the axis from e_phi towards e_theta. Units: mm.
    radius : float
        Mean radius of the deviating cylinder. Units: mm.
    half_length : float
        Half of the measured length along the axis. Units: mm.
    """

    centres: SectionCentres
    bow: FormDeviation
    taper: FormDeviation
    ovality_terms: FormDeviation
    radius: float
    half_length: float

    @property
    def bow_radius(self) -> float:
        """Radius of curvature of the axis: (half_length^2 + bow^2) / (2 bow). Units: mm."""
        bow = self.bow.size
        return (self.half_length**2 + bow**2) / (2 * bow) if bow > 0 else math.inf

    @property
    def bow_radius_std(self) -> float:
        """Standard uncertainty of `bow_radius`. Units: mm.

        Propagated linearly, for a bow that is small compared with `half_length`.
        """
        return self.bow_radius * self.bow.size_std / self.bow.size if self.bow.size else math.inf

    @property
    def ovality(self) -> float:
        """(Largest - smallest diameter) / mean diameter = 2 |o| / r."""
        return 2 * self.ovality_terms.size / self.radius

    @property
    def ovality_std(self) -> float:
        """Standard uncertainty of `ovality`; on a round cylinder, `ovality` is about as large."""
        return 2 * self.ovality_terms.size_std / self.radius

    @property
    def taper_slope(self) -> float:
        """Increase of the radius per length along the direction. Units: mm/mm."""
        return float(self.taper.values[0]) / self.half_length

    def to_dict(self) -> Record:
        """Return bow, taper, ovality and the line of centres, ready for JSON.

        Returns
        -------
        dict
            Lengths in ``*_mm``; ``bow_radius_mm`` is None for a straight axis.
        """
        centres = self.centres
        return {
            "bow_mm": self.bow.size,
            "bow_std_mm": self.bow.size_std,
            "bow_p_value": self.bow.p_value,
            "bow_radius_mm": replace_nonfinite(self.bow_radius),
            "taper_mm_per_mm": self.taper_slope,
            "taper_p_value": self.taper.p_value,
            "ovality": self.ovality,
            "ovality_std": self.ovality_std,
            "ovality_p_value": self.ovality_terms.p_value,
            "sections": [int(section) for section in centres.sections],
            "along_mm": convert_numbers_to_json(centres.along),
            "deviations_mm": [convert_numbers_to_json(row) for row in centres.deviations],
            "deviations_std_mm": [convert_numbers_to_json(row) for row in centres.deviations_std],
            "radii_mm": convert_numbers_to_json(centres.radii),
            "radii_std_mm": convert_numbers_to_json(centres.radii_std),
        }

    def _summarise(self) -> str:
        return ", ".join(format_shape_lines(self))

    def _list_cells(self) -> list[tuple[str, ...]]:
        return []  # no table: the notes contain everything

    def _list_notes(self) -> list[str]:
        return format_shape_lines(self)

    def _list_rows(self) -> list[Record]:
        """Return a row per section: its centre relative to the straight axis, and its radius."""
        record = self.to_dict()
        columns = {"section": record["sections"], "along_mm": record["along_mm"]}
        for name in ("deviations", "deviations_std"):
            for index, axis in enumerate(("phi", "theta")):
                columns[f"{name}_{axis}_mm"] = [row[index] for row in record[f"{name}_mm"]]
        columns |= {"radius_mm": record["radii_mm"], "radius_std_mm": record["radii_std_mm"]}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def format_shape_lines(shape: CylinderShape) -> list[str]:
    """Return a line for bow, taper and ovality each: value, standard uncertainty, significance."""
    bow = (
        f"{format_value(shape.bow.size, shape.bow.size_std)} mm over {2 * shape.half_length:.0f} mm"
    )
    if shape.bow.is_significant():
        bow += f", a radius of {format_value(shape.bow_radius / 1e3, shape.bow_radius_std / 1e3)} m"
    slope = 1e3 * shape.taper_slope
    slope_std = 1e3 * shape.taper.size_std / shape.half_length
    ovality = format_value(100 * shape.ovality, 100 * shape.ovality_std)
    return [
        f"bow {bow} ({_describe_significance(shape.bow)})",
        f"taper {format_value(slope, slope_std)} mm/m ({_describe_significance(shape.taper)})",
        f"ovality {ovality} % ({_describe_significance(shape.ovality_terms)})",
    ]


def _describe_significance(deviation: FormDeviation) -> str:
    """Return whether a deviation is significant, in words."""
    return "significant" if deviation.is_significant() else "not significant"
