"""Result of a scan: cylinders in the base frame, and rejected arcs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.cylinder.fit_result import (
    AXIS_HEADER,
    AxisQuantity,
    CylinderFit,
    build_axis_record,
    build_axis_row,
    format_axis_cells,
)
from lsvision.geometry import Cylinder, FloatArray, IntArray, Points, Pose
from lsvision.geometry.cylinder import WithCylinder
from lsvision.measure import Measurement
from lsvision.results.number_format import format_ranges
from lsvision.results.picture import draw_space_svg
from lsvision.results.quantities import Record, convert_numbers_to_json
from lsvision.results.result import Result
from lsvision.results.summaries import format_count, list_rejections, summarise_cylinders
from lsvision.scan.pose_errors import PoseErrors

RING_POINTS = 49
"""Points of the circle at each end of a drawn cylinder; enough that its polygon looks round."""


@dataclass(frozen=True, eq=False, repr=False)
class ScannedCylinder(WithCylinder, Result):
    """Cylinder measured jointly from the sections of a scan.

    Parameters
    ----------
    fit : CylinderFit
        Fit to the points of all `sections`, in the base frame. Its point is the axis point
        nearest to the origin of the first section. Its direction is positive along the feed
        (from the first profile's origin to the last's; if the feed is zero or perpendicular to
        the axis, along the first section's Z). Its covariance includes the errors of the poses
        and of the hand-eye calibration, if given.
    sections : tuple of int
        Indices of the profiles with points of the cylinder.
    points : (n, 3) ndarray
        Points to which the cylinder was fitted, base frame. Units: mm.
    point_sections, indices : (n,) int ndarray
        Index of each point's profile, and index of the point in that profile.
    axial_range : tuple of float
        Positions along the axis, from `point` along `direction`, of the first and the last
        point; the cylinder may extend beyond the scan. Units: mm.
    axial_range_std : tuple of float
        Standard uncertainty of `axial_range`. Units: mm.
    twin : Cylinder or None
        The other cylinder that fits equally well: of one section, of two that cross in the
        cylinder, or of short arcs on opposite sides, then with another radius.
    includes_calibration : bool
        Whether the covariance includes the errors of a hand-eye calibration; otherwise the
        sensor mount is taken as exact.
    axial_range_covariance : float
        Covariance of both ends of `axial_range`: errors of poses and calibration that displace
        both do not change the length. Units: mm^2.
    poses : tuple of Pose
        ``base_from_section`` of each profile of the scan.
    pose_errors : PoseErrors
        Stated uncertainty of the poses, which the shape of the cylinder takes into account.

    Examples
    --------
    >>> import lsvision as lsv
    >>> scene = lsv.simulate.Scene((lsv.simulate.Tube.of(19.0, 0.3, 0.35, (0.0, -400.0)),))
    >>> poses = [lsv.Pose.along((0, 0, 1), 10.0 * k) for k in range(3)]
    >>> sections = lsv.simulate.simulate_scan(
    ...     scene, poses, lsv.simulate.SCENE_SENSOR, lsv.simulate.SectionSettings(),
    ...     rng=np.random.default_rng(1),
    ... )
    >>> (pipe,) = lsv.measure_scan([section.profile for section in sections], poses).cylinders
    >>> low, high = pipe.interval("radius", level=0.999)
    >>> low < 19 < high
    True
    >>> pipe.to_dict()["sections"]
    [0, 1, 2]
    """

    fit: CylinderFit
    sections: tuple[int, ...]
    points: Points
    point_sections: IntArray
    indices: IntArray
    axial_range: tuple[float, float]
    axial_range_std: tuple[float, float]
    twin: Cylinder | None = None
    includes_calibration: bool = False
    axial_range_covariance: float = 0.0
    poses: tuple[Pose, ...] = ()
    pose_errors: PoseErrors = PoseErrors()

    @property
    def cylinder(self) -> Cylinder:
        """Cylinder in the base frame."""
        return self.fit.cylinder

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm."""
        return self.fit.radius_std

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction. Units: rad."""
        return self.fit.direction_std

    @property
    def position_std(self) -> float:
        """Root mean square distance of `point` from the true axis. Units: mm."""
        return self.fit.position_std

    @property
    def covariance(self) -> FloatArray:
        """Covariance (5, 5): point (mm) and direction (rad), along e_phi and e_theta; radius (mm).

        e_phi and e_theta are the rows of ``fit.tangent_basis``.
        """
        return self.fit.covariance

    def interval(self, quantity: AxisQuantity, level: float = 0.95) -> tuple[float, float]:
        """Return the interval that contains the true value with probability `level`, base frame.

        Parameters
        ----------
        quantity : {"radius", "point_x", ..., "point_z", "direction_x", ..., "direction_z"}
            Radius or point coordinate (mm), or component of the unit direction vector.
        level : float
            Level of confidence, between 0 and 1.

        Returns
        -------
        low, high : float
            From Student's t; includes the errors of poses and calibration that were given.

        Raises
        ------
        ValueError
            If the quantity is unknown, or the level is not between 0 and 1.
        """
        return self.fit.interval(quantity, level)

    @property
    def ambiguous(self) -> bool:
        """Whether there is a `twin`, which fits equally well."""
        return self.twin is not None

    @property
    def twin_has_other_radius(self) -> bool:
        """Whether there is a `twin` of another radius: of short arcs on opposite sides."""
        return self.twin is not None and not math.isclose(self.twin.radius, self.radius)

    @property
    def section_residuals(self) -> FloatArray:
        """Mean and rms of the residuals of each of `sections`, (k, 2). Units: mm."""
        residuals = [self.fit.residuals[self.point_sections == s] for s in self.sections]
        return np.array([[r.mean(), np.sqrt(np.mean(r * r))] for r in residuals])

    def to_dict(self) -> Record:
        """Return the cylinder with its diagnostics as plain numbers, ready for JSON.

        Returns
        -------
        dict
            Base frame; lengths in ``*_mm``, angles in ``*_deg``.
        """
        residuals, basis = self.section_residuals, self.fit.tangent_basis
        return build_axis_record(self.fit) | {
            "includes_calibration": self.includes_calibration,
            "e_phi": convert_numbers_to_json(basis[0]),
            "e_theta": convert_numbers_to_json(basis[1]),
            "ends_mm": list(self.axial_range),
            "ends_std_mm": list(self.axial_range_std),
            "sections": list(self.sections),
            "section_residuals_mean_mm": convert_numbers_to_json(residuals[:, 0]),
            "section_residuals_rms_mm": convert_numbers_to_json(residuals[:, 1]),
            "points": len(self.points),
            "rms_mm": self.fit.rms,
            "twin_direction": None
            if self.twin is None
            else convert_numbers_to_json(self.twin.direction),
            "twin_radius_mm": None if self.twin is None else self.twin.radius,
        }

    def _summarise(self) -> str:
        _, radius, direction, angle, *_, sections, points = format_cylinder_cells([self])[1]
        twin = ", one of two twins" if self.ambiguous else ""
        return (
            f"radius {radius} mm, direction ({direction}) ± {angle} deg, sections {sections}, "
            f"{points} points{twin}"
        )

    def _list_cells(self) -> list[tuple[str, ...]]:
        return format_cylinder_cells([self])

    def _list_notes(self) -> list[str]:
        return list_twin_notes([self])

    def _list_rows(self) -> list[Record]:
        """Return the row of the cylinder for tables."""
        record = self.to_dict()
        start, stop = record["ends_mm"]
        return [
            build_axis_row(record, self.interval("radius"))
            | {"start_mm": start, "stop_mm": stop, "sections": len(self.sections)}
            | {key: record[key] for key in ("points", "rms_mm", "includes_calibration")}
            | {"ambiguous": self.ambiguous}
        ]

    def _draw_picture(self) -> str:
        return _draw_in_space([self])


@dataclass(frozen=True, eq=False, repr=False)
class ScanRejection(Result):
    """Arcs of a scan that were rejected, with the reason.

    Parameters
    ----------
    sections : tuple of int
        Indices of the profiles with the arcs.
    reason : str
        Quantity and limit that it exceeds, or error of the fit.
    """

    sections: tuple[int, ...]
    reason: str

    def to_dict(self) -> Record:
        """Return sections and reason, ready for JSON.

        Returns
        -------
        dict
            ``sections`` and ``reason``.

        Examples
        --------
        >>> ScanRejection((3, 4), "residual rms 5.1 times the noise, limit 4.0").to_dict()
        {'sections': [3, 4], 'reason': 'residual rms 5.1 times the noise, limit 4.0'}
        """
        return {"sections": list(self.sections), "reason": self.reason}

    def _summarise(self) -> str:
        return f"sections {format_ranges(self.sections)}: {self.reason}"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return []

    def _list_notes(self) -> list[str]:
        return [self._summarise()]

    def _list_rows(self) -> list[Record]:
        return [{"sections": format_ranges(self.sections), "reason": self.reason}]


@dataclass(frozen=True, eq=False, repr=False)
class ScanMeasurement(Result):
    """Result of `measure_scan`.

    Parameters
    ----------
    cylinders : tuple of ScannedCylinder
        Ordered by the first section with their points, then by ascending x in it.
    rejections : tuple of ScanRejection
        Arcs that were detected in a profile and rejected by the joint fit.
    measurements : tuple of Measurement
        Measurement of each profile by itself, in the order of the profiles.

    Examples
    --------
    >>> ScanMeasurement((), (), ())
    <ScanMeasurement: 0 cylinders, 0 profiles>
    """

    cylinders: tuple[ScannedCylinder, ...]
    rejections: tuple[ScanRejection, ...]
    measurements: tuple[Measurement, ...]

    @property
    def reason(self) -> str:
        """Reason why there is no cylinder; empty if there is one.

        It is the reason of the longest rejected track, or else of the first section. If several
        sections show arcs, but no two of them form a track, the poses are probably wrong, and the
        reason lists what to check.

        Examples
        --------
        >>> ScanMeasurement((), (), (Measurement((), ()),)).reason
        'no valid point'
        """
        if self.cylinders:
            return ""
        if self.rejections:
            sections = {section for track in self.rejections for section in track.sections}
            longest = max(self.rejections, key=lambda track: len(track.sections))
            if len(longest.sections) > 1 or len(sections) < 2:
                return longest.reason
            return (
                f"{len(sections)} sections show an arc, and no two of them lie on one cylinder: "
                "check that the poses (their order, unit and convention, the hand-eye file), or "
                "feed and step, belong to these profiles"
            )
        # Without cylinders and rejections no section has a cylinder.
        return self.measurements[0].reason if self.measurements else "no profile was measured"

    def to_dict(self) -> Record:
        """Return cylinders and rejections as plain numbers and text, ready for JSON.

        Returns
        -------
        dict
            Base frame; ``lsvision scan --json`` writes the same with the profiles' sources and
            the shape of each cylinder.

        Examples
        --------
        >>> ScanMeasurement((), (), ()).to_dict()["cylinders"]
        []
        """
        return {
            "frame": "base",
            "cylinders": [cylinder.to_dict() for cylinder in self.cylinders],
            "rejections": [rejection.to_dict() for rejection in self.rejections],
            "cylinders_by_section": [
                len(measurement.cylinders) for measurement in self.measurements
            ],
        }

    def _summarise(self) -> str:
        profiles = format_count(len(self.measurements), "profile")
        return f"{summarise_cylinders(self.cylinders)}, {profiles}"

    def _list_cells(self) -> list[tuple[str, ...]]:
        return format_cylinder_cells(self.cylinders)

    def _list_notes(self) -> list[str]:
        if not self.cylinders and not self.rejections:
            return [f"no cylinder found: {self.reason}"]
        rejected = list_rejections(self.rejections, "track", has_cylinders=bool(self.cylinders))
        return [*list_twin_notes(self.cylinders), *rejected]

    def _list_rows(self) -> list[Record]:
        return [row for cylinder in self.cylinders for row in cylinder._list_rows()]

    def _draw_picture(self) -> str:
        return _draw_in_space(self.cylinders) if self.cylinders else ""


def _draw_in_space(cylinders: Sequence[ScannedCylinder]) -> str:
    """Return an SVG picture of the points and cylinders, Z of the base frame upwards."""
    angles = np.linspace(0.0, 2 * np.pi, RING_POINTS)
    drawn = [
        (
            cylinder.points,
            [cylinder.cylinder.ring(end, angles) for end in cylinder.axial_range],
            cylinder.point + np.outer(cylinder.axial_range, cylinder.direction),
        )
        for cylinder in cylinders
    ]
    return draw_space_svg(drawn, f"{format_count(len(cylinders), 'cylinder')} in the base frame")


def format_cylinder_cells(cylinders: Sequence[ScannedCylinder]) -> list[tuple[str, ...]]:
    """Return the cells of a table: a header and one row per cylinder, numbers with one sigma."""
    rows: list[tuple[str, ...]] = [("", *AXIS_HEADER, "sections", "points")]
    for number, cylinder in enumerate(cylinders, 1):
        sections, points = format_ranges(cylinder.sections), str(len(cylinder.points))
        rows.append((str(number), *format_axis_cells(cylinder.fit), sections, points))
    return rows


def list_twin_notes(cylinders: Sequence[ScannedCylinder]) -> list[str]:
    """Return a numbered line for each cylinder that has a twin."""
    return [
        f"  {number}: {describe_twin(cylinder, cylinder.twin)}"
        for number, cylinder in enumerate(cylinders, 1)
        if cylinder.twin is not None
    ]


def describe_twin(cylinder: ScannedCylinder, twin: Cylinder) -> str:
    """Return a line with the other possible direction of a cylinder, and radius if different."""
    direction = " ".join(f"{component:+z.4f}" for component in twin.direction)
    radius = f", radius {twin.radius:.5g} mm," if cylinder.twin_has_other_radius else ""
    return f"its twin ({direction}){radius} fits equally well; a further section decides"
