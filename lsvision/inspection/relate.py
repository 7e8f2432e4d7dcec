"""Distance, angle, gap and flush of two measured cylinders, in a section or in space."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import FloatArray
from lsvision.inspection.axis_relation import ObservedCylinder, relate_axes
from lsvision.inspection.relation import Relation
from lsvision.inspection.section_relation import relate_sections
from lsvision.scan.scan_result import ScannedCylinder

MeasuredCylinder = CylinderSection | ScannedCylinder
"""Cylinder measured in one section, or jointly in several."""


def relate(
    a: MeasuredCylinder, b: MeasuredCylinder, *, up: npt.ArrayLike | None = None
) -> Relation:
    """Return distance, angle, gap and flush of two cylinders, each with its uncertainty.

    Gap is the distance between the surfaces, flush the height of b's crest over a's.

    Parameters
    ----------
    a, b : CylinderSection or ScannedCylinder
        Both of one section, or both in one base frame. Their errors are taken as independent:
        errors of a pose or a calibration that are common to both are then counted twice. An
        ambiguous one, such as of a scan with one section, is taken as it is, without its twin.
    up : (3,) array_like, optional
        In space: direction along which flush is measured, across both axes, base frame, of any
        length. Not used in a section, where flush is along Y.

    Returns
    -------
    Relation
        In a section: distance of the centres, gap and flush of the ellipses in its plane; the angle
        between the axes has a wide interval, because the signs of both tilts are unknown. In space:
        all quantities (flush only with `up`) at the common perpendicular of the axes, or in the
        middle of the common observed length if the perpendicular lies outside and the angle is at
        most 70 deg, as for parallel pipes; and the seam, which is the point midway between both
        surfaces and the direction of a weld there.

    Raises
    ------
    TypeError
        If one is measured in a section and the other in space, or one is not a cylinder.
    ValueError
        If both are the same cylinder; in space, if `up` is not three finite numbers, all are zero,
        or it is along an axis.

    Examples
    --------
    >>> import lsvision as lsv
    >>> section = lsv.simulate.random_section("welded_pair", 5, noise_mm=0.02)
    >>> left, right = lsv.measure_cylinders(section.profile).cylinders
    >>> truth = [np.array(tube.centre) for tube in section.truth.tubes]
    >>> relation = lsv.relate(left, right)
    >>> low, high = relation.interval("distance", level=0.999)
    >>> bool(low < np.linalg.norm(truth[1] - truth[0]) < high)
    True
    """
    if a is b:
        raise ValueError("expected two cylinders, got the same one twice")
    for cylinder in (a, b):
        if not isinstance(cylinder, CylinderSection | ScannedCylinder):
            raise TypeError(
                f"expected a CylinderSection or a ScannedCylinder, got {type(cylinder).__name__}"
            )
    if isinstance(a, CylinderSection) and isinstance(b, CylinderSection):
        return relate_sections(a, b)
    if isinstance(a, CylinderSection) or isinstance(b, CylinderSection):
        raise TypeError(
            "expected two cylinders of one section or two in space, got one of each: "
            "lsv.measure_scan gives both in space"
        )
    first, second = (ObservedCylinder(cylinder.fit, cylinder.axial_range) for cylinder in (a, b))
    return relate_axes(first, second, None if up is None else _as_unit_vector(up))


def _as_unit_vector(up: npt.ArrayLike) -> FloatArray:
    """Return the direction of flush as a unit vector, (3,)."""
    try:
        direction = np.asarray(up, dtype=np.float64)
        length = math.hypot(*direction) if direction.shape == (3,) else math.nan
    except (TypeError, ValueError):
        length = math.nan
    if not (math.isfinite(length) and length > 0):
        raise ValueError(f"expected up as three numbers, not all zero, got {up!r}")
    unit: FloatArray = direction / length
    return unit
