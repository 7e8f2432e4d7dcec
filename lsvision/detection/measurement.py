"""Measurement of one profile: its cylinders and rejected arcs."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from lsvision.detection.arcs import Rejection, arc_from_indices
from lsvision.ellipse.section import CylinderSection, precompute_intervals
from lsvision.ellipse.section_table import format_section_cells
from lsvision.profile import PreparedProfile, Profile
from lsvision.results.picture import draw_svg
from lsvision.results.quantities import Record
from lsvision.results.result import Result
from lsvision.results.summaries import format_count, list_rejections, summarise_cylinders


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Result):
    """Cylinders and rejected arcs of one profile.

    Parameters
    ----------
    cylinders : tuple of CylinderSection
        Sections in ascending order of the x of their centres.
    rejections : tuple of Rejection
        Arcs that are not cylinders, with reasons, in their order along the laser line.
    profile : Profile, optional
        Measured profile, for pictures; ignored in comparisons.

    Examples
    --------
    >>> import lsvision as lsv
    >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
    >>> measurement = lsv.measure_cylinders(section.profile)
    >>> measurement  # doctest: +ELLIPSIS
    <Measurement: 1 cylinder (radius 36.9... ± 0.0... mm), 0 arcs rejected>
    >>> print(str(measurement).splitlines()[0].split("  ")[-1])
    points
    >>> list(measurement.to_dataframe().columns[:2])
    ['radius_mm', 'radius_std_mm']
    """

    cylinders: tuple[CylinderSection, ...]
    rejections: tuple[Rejection, ...]
    profile: Profile | None = field(default=None, compare=False)

    @property
    def reason(self) -> str:
        """Reason why there is no cylinder; empty if there is one.

        It is that of the longest convex arc, or of the longest arc if none is convex.

        Examples
        --------
        >>> Measurement((), ()).reason
        'no valid point'
        """
        if self.cylinders:
            return ""
        longest = max(self.rejections, key=lambda r: (r.convex, len(r.arc)), default=None)
        return "no valid point" if longest is None else longest.reason

    def to_dict(self) -> Record:
        """Return cylinders and rejections as plain numbers and text, ready for JSON.

        Returns
        -------
        dict
            ``cylinders`` and ``rejections``, lists of their `to_dict`; ``lsvision measure
            --json`` writes the same with the profile's source.

        Examples
        --------
        >>> Measurement((), ()).to_dict()
        {'cylinders': [], 'rejections': []}
        """
        precompute_intervals(self.cylinders)
        return {
            "cylinders": [cylinder.to_dict() for cylinder in self.cylinders],
            "rejections": [rejection.to_dict() for rejection in self.rejections],
        }

    def _summarise(self) -> str:
        rejected = format_count(len(self.rejections), "arc")
        return f"{summarise_cylinders(self.cylinders)}, {rejected} rejected"

    def _list_cells(self) -> list[tuple[str, ...]]:
        precompute_intervals(self.cylinders)
        return format_section_cells(self.cylinders)

    def _list_notes(self) -> list[str]:
        if not self.cylinders and not self.rejections:
            return [f"no cylinder found: {self.reason}"]
        return list_rejections(self.rejections, "arc", has_cylinders=bool(self.cylinders))

    def _list_rows(self) -> list[Record]:
        precompute_intervals(self.cylinders)
        return [row for cylinder in self.cylinders for row in cylinder._list_rows()]

    def _draw_picture(self) -> str:
        arcs = [cylinder.fit.problem.points for cylinder in self.cylinders]
        points = np.concatenate([np.zeros((0, 2)), *arcs])
        if self.profile is not None:
            points = self.profile.points
            arcs = [points[cylinder.indices] for cylinder in self.cylinders]
        ellipses = [cylinder.ellipse for cylinder in self.cylinders]
        sections = list(zip(arcs, ellipses, strict=True))
        return draw_svg(
            points, sections, f"a profile with {format_count(len(sections), 'cylinder')}"
        )


def build_measurement(
    cylinders: Iterable[CylinderSection],
    rejections: Iterable[Rejection],
    prepared: PreparedProfile,
    profile: Profile,
) -> Measurement:
    """Return the measurement of a profile, with the indices of the sensor's columns.

    Parameters
    ----------
    cylinders, rejections : iterable
        Cylinders and rejections whose indices and arcs refer to the points of `prepared`.
    prepared : PreparedProfile
        Prepared profile, with the sensor's column of each point.
    profile : Profile
        The measured profile.

    Returns
    -------
    Measurement
        Cylinders in ascending order of the x of their centres.
    """
    columns = prepared.sensor_columns  # not ascending where the points were sorted along the line

    def with_columns(section: CylinderSection) -> CylinderSection:
        indices = columns[section.indices]
        return CylinderSection(section.fit, arc_from_indices(np.sort(indices)), indices)

    rejected = [
        Rejection(arc_from_indices(np.sort(columns[r.arc.start : r.arc.stop])), r.reason, r.convex)
        for r in rejections
    ]
    ordered = sorted(map(with_columns, cylinders), key=lambda section: section.centre[0])
    return Measurement(tuple(ordered), tuple(rejected), profile)
