"""Results printed in the paper's Tables 1-5 and section 4.3."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Triple:
    """Numbers for radius, theta and phi: errors, standard deviations or bounds.

    Parameters
    ----------
    radius_mm : float
        Number for the radius. Units: mm.
    theta_deg, phi_deg : float
        Numbers for both angles. Units: deg.
    """

    radius_mm: float
    theta_deg: float
    phi_deg: float


QUANTITIES = ("radius_mm", "theta_deg", "phi_deg")
"""Fields of a `Triple`, in their order."""


@dataclass(frozen=True, slots=True)
class PublishedRow:
    """A row of Tables 1-4.

    Parameters
    ----------
    table : int
        Number of the table, 1 to 4.
    number : int
        Number of the pipe, column "No.".
    radius_mm, theta_deg, phi_deg : float
        True values of the pipe. Units: mm, deg.
    errors : Triple
        Printed errors of one measurement.
    """

    table: int
    number: int
    radius_mm: float
    theta_deg: float
    phi_deg: float
    errors: Triple


@dataclass(frozen=True, slots=True)
class PublishedTime:
    """A row of Table 5.

    Parameters
    ----------
    condition : str
        Condition in the paper's words.
    kind : str
        Corresponding kind of simulated scene, a key of `SCENE_KINDS`.
    pipes : int
        Number of pipes.
    seconds : float
        Time of one measurement in Matlab; the paper does not state the computer. Units: s.
    """

    condition: str
    kind: str
    pipes: int
    seconds: float


_RADII = (15.0, 16.0, 18.5, 29.0)  # of the pipes in each of Tables 1-3, mm
_WELDED_RADIUS = 19.0  # of the pipes in Table 4, mm
_ANGLES = ((10.0, 30.0), (20.0, 20.0), (30.0, 10.0))  # theta, phi in Tables 1, 2 and 3, deg
# Errors of radius (mm), theta and phi (deg): Tables 1, 2 and 3, one line per pipe.
_SINGLE = (
    (
        (-0.2457, -0.1493, 0.0530),
        (-0.1193, 0.1130, 0.1040),
        (-0.1110, 0.1706, -0.0651),
        (-0.3966, -0.1137, -0.1253),
    ),
    (
        (-0.2631, 0.1233, 0.1270),
        (-0.3730, -0.1493, -0.1238),
        (-0.1004, 0.1077, -0.1626),
        (-0.0715, -0.1614, 0.1383),
    ),
    (
        (-0.2260, 0.1347, 0.1887),
        (-0.3893, 0.0804, 0.1678),
        (-0.0040, -0.1479, -0.2140),
        (-0.1670, -0.1719, 0.1884),
    ),
)
# Table 4: one line per pair of welded pipes.
_WELDED = (
    ((-0.0928, 0.2417, 0.1787), (-0.0797, -0.1057, -0.1379)),
    ((-0.1389, 0.1903, -0.4406), (-0.0897, -0.1169, 0.1129)),
    ((-0.0777, 0.2043, -0.1895), (-0.0640, -0.1048, -0.2825)),
)


def _parse_rows() -> tuple[PublishedRow, ...]:
    """Return the rows of Tables 1-4."""
    rows = []
    for table, (angles, errors) in enumerate(zip(_ANGLES, _SINGLE, strict=True), 1):
        for number, (radius, error) in enumerate(zip(_RADII, errors, strict=True), 1):
            rows.append(PublishedRow(table, number, radius, *angles, Triple(*error)))
    for angles, pair in zip(_ANGLES, _WELDED, strict=True):
        for number, error in enumerate(pair, 1):
            rows.append(PublishedRow(4, number, _WELDED_RADIUS, *angles, Triple(*error)))
    return tuple(rows)


PUBLISHED_ROWS = _parse_rows()
"""Tables 1-4; pipes 1 and 2 of a pair of Table 4 follow each other."""

PUBLISHED_TIMES = (
    PublishedTime("Single", "single", 1, 1.201),
    PublishedTime("Welded together", "welded_pair", 2, 2.526),
    PublishedTime("Single with planar interference", "planar", 1, 1.343),
    PublishedTime("Single with complex interference", "complex", 1, 1.471),
    PublishedTime("Welded together with complex interference", "welded_complex", 2, 2.981),
)
"""Table 5."""

PUBLISHED_BOX_MM = 0.6
"""Section 4.3: side of the box that contains the centres of repeated measurements. Units: mm."""
PUBLISHED_AXIS_MM = 0.25
"""Section 4.3: the ellipse's axes vary by less. Units: mm."""
