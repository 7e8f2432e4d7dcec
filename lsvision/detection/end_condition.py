"""End condition: the line of a cylinder does not continue tangentially beyond the ends of its arc.

It ends where the surface turns away from the sensor, or bends abruptly where the next object
begins. The lines of a bent sheet and of the rounded corner of a tube continue tangentially. The
line of a weld may also begin tangentially, but it is concave towards the sensor at the foot of the
bead, and more curved than the cylinder on the bead itself: it is accepted.
"""

import cmath
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lsvision.detection.arcs import IdentifiedArc, ScreenedArc
from lsvision.geometry import Ellipse, IntArray, orthogonal_residuals
from lsvision.geometry.arrays import rms
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS

MIN_TURN_DEG = 20.0
"""Change of the line's direction at an end, below which it continues tangentially. With 14 the
crests of some waves are taken for pipes, with 28 one of 1345 pipes is lost. Units: deg."""
DIRECTION_POINTS, DIRECTION_FRACTION = 6, 1 / 8
"""Number of points beyond an end from which the line's direction is measured: the larger of this
number and this fraction of the arc's points. A line ends where there are fewer than this number, or
than half of this fraction."""
CURVED_POINTS, MIN_CURVED_POINTS = 12, 6
"""Number of points beyond an end whose curvature is measured: the larger of the first number and
`DIRECTION_FRACTION` of the arc's points. The curvature of fewer than the second is not
significant."""
NEAR_POINTS = 12
"""Number of points of an arc, next to its end, from which its typical step and the direction in
which it leads are determined. With 8 or 17 the same pipes are found."""
MAX_GAP_STEPS = 3.0
"""Largest distance between connected points, in median distances between neighbours of the arc: it
bridges two lost columns. With 2 the same pipes are found, with 4 one less."""
MIN_FILLET_CURVATURE = 1.0
"""Smallest ratio of the curvature of a fillet, the concave foot of a weld bead, to that of the
cylinder: it is 0.9 to 1.6 for the
feet of weld beads, at most 0 beyond a rounded corner, and up to 1 in the valleys of a corrugated
sheet."""
MIN_BEAD_CURVATURE = 2.0
"""Smallest ratio of the curvature of a weld bead, convex towards the sensor, to that of the
cylinder: it is 2 to 8 for the beads beside a pipe, and at most 1 beyond a rounded corner."""


def find_tangential_end_reason(
    profile: PreparedProfile, arc: IdentifiedArc, screened: ScreenedArc
) -> str | None:
    """Return the reason to reject an arc whose line continues tangentially; None if it ends.

    Parameters
    ----------
    profile : PreparedProfile
        Profile of the arc.
    arc : IdentifiedArc
        Arc before screening. The direction of the line is measured beyond the points of both arcs;
        at an end where screening dropped a line that is long enough to distinguish a flat from a
        fillet, beyond those of the screened arc.
    screened : ScreenedArc
        The same arc after screening: a fillet begins at its ends. Its `mixed_points` beyond an end
        are left out: a sensor that smooths along the line has mixed the arc into them, so that each
        line seems to continue tangentially.
    """
    count = max(DIRECTION_POINTS, int(DIRECTION_FRACTION * len(arc.indices)))
    min_count, curved_count = max(DIRECTION_POINTS, count // 2), max(CURVED_POINTS, count)
    longest, mixed_points = np.union1d(arc.indices, screened.indices), screened.mixed_points
    measured = _exclude_dropped_lines(profile, longest, screened, curved_count + mixed_points)
    turns_deg = [
        math.degrees(_measure_end_turn(inner, beyond[mixed_points:], arc.ellipse, min_count))
        for inner, beyond in _split_ends(profile, measured, count + mixed_points)
    ]
    if min(turns_deg) >= MIN_TURN_DEG:
        return None
    welds = _find_welds(profile, longest, screened, curved_count)
    tangential_deg = sorted(
        turn_deg
        for turn_deg, is_weld in zip(turns_deg, welds, strict=True)
        if turn_deg < MIN_TURN_DEG and not is_weld
    )
    if not tangential_deg:
        return None
    turns = " and ".join(f"{turn_deg:.0f}" for turn_deg in tangential_deg)
    if len(tangential_deg) == 1:
        return f"continues tangentially at one end (turns {turns} deg): a rounded corner"
    return f"continues tangentially at both ends (turns {turns} deg)"


def _exclude_dropped_lines(
    profile: PreparedProfile, longest: IntArray, screened: ScreenedArc, count: int
) -> IntArray:
    """Return the indices of an arc without those ends at which screening dropped another line.

    Such a line has `count` points or more, and is beyond the noise from the screened ellipse.
    """
    max_rms = SIGNIFICANT_SIGMAS * _estimate_noise_std(profile, screened)

    def is_line(dropped: IntArray) -> bool:
        points = profile.points[dropped]
        return (
            len(dropped) >= count and rms(orthogonal_residuals(points, screened.ellipse)) > max_rms
        )

    first, last = np.searchsorted(longest, screened.indices[[0, -1]]).tolist()
    start = first if is_line(longest[:first]) else 0
    return longest[start : last + 1 if is_line(longest[last + 1 :]) else len(longest)]


def _estimate_noise_std(profile: PreparedProfile, screened: ScreenedArc) -> float:
    """Return the standard deviation of the points of a screened arc. Units: mm."""
    return profile.noise_std * math.sqrt(screened.variance_factor)


def find_connected_beyond(
    arc_points: Sequence[complex], beyond: Sequence[complex], max_count: int
) -> list[int]:
    """Find the points beyond an arc that are connected to it, each to the one before.

    Parameters
    ----------
    arc_points : sequence of complex
        At least two points x + iy of the arc, towards its end. Units: mm.
    beyond : sequence of complex
        Points x + iy beyond this end, outwards. Units: mm.
    max_count : int
        Largest number of points to return.

    Returns
    -------
    list of int
        Positions of the connected points in `beyond`, ascending.
    """
    near = arc_points[-NEAR_POINTS:]
    steps = sorted([abs(after - before) for before, after in pairwise(near)])
    max_step = MAX_GAP_STEPS * steps[len(steps) // 2]
    last, positions = near[-1], list[int]()
    for i, point in enumerate(beyond):
        if abs(point - last) <= max_step:
            positions.append(i)
            last = point
            if len(positions) == max_count:
                break
    return positions


def _split_ends(
    profile: PreparedProfile, indices: IntArray, count: int
) -> list[tuple[ComplexArray, ComplexArray]]:
    """Return the points near each end of an arc, and up to `count` connected ones beyond it.

    Both are x + iy in mm, ordered outwards.
    """
    z, first, stop = profile.noisy_points.z, int(indices[0]), int(indices[-1]) + 1
    reach = 2 * count  # every other point may be a jump, which is not connected
    sides = [
        (z[indices[:NEAR_POINTS]][::-1], z[max(0, first - reach) : first][::-1]),
        (z[indices[-NEAR_POINTS:]], z[stop : stop + reach]),
    ]
    return [
        (inner, outer[find_connected_beyond(inner.tolist(), outer.tolist(), count)])
        for inner, outer in sides
    ]


def _measure_end_turn(
    inner: ComplexArray, beyond: ComplexArray, ellipse: Ellipse, min_count: int
) -> float:
    """Return the angle between the tangent at the last point and the line beyond it. Units: rad.

    `inner` are the arc's points near its end, `beyond` those beyond it, outwards. The angle is pi
    where the line ends: with fewer than `min_count` points beyond, all of them at one position, or
    with an end of the arc or a line beyond it that faces away from the sensor.
    """
    if len(beyond) < min_count or len(set(beyond.tolist())) == 1:
        return math.pi
    along_major = cmath.rect(1.0, ellipse.theta)
    out = (complex(inner[-1]) - complex(*ellipse.centre)) * along_major.conjugate()
    normal = complex(out.real / ellipse.semi_major**2, out.imag / ellipse.semi_minor**2)
    normal *= along_major
    if normal.imag < 0:
        return math.pi
    tangent = _orient(1j * normal, inner)
    # The angle of the principal axis of complex numbers is half that of the sum of their squares.
    centred = beyond - beyond.sum() / len(beyond)
    direction = _orient(cmath.sqrt(complex((centred * centred).sum())), beyond)
    turn = direction * tangent.conjugate()
    return math.pi if (normal * turn).imag < 0 else abs(cmath.phase(turn))


def _orient(direction: complex, points: ComplexArray) -> complex:
    """Return the direction, reversed if it leads from the last point to the first."""
    forwards = (direction * complex(points[-1] - points[0]).conjugate()).real >= 0
    return direction if forwards else -direction


def _find_welds(
    profile: PreparedProfile, longest: IntArray, screened: ScreenedArc, count: int
) -> list[bool]:
    """Return for each end whether the line beyond it is a fillet or a weld bead.

    The fillet is measured over `count` points beyond the screened arc, and the bead beyond the
    `longest` arc, which may contain the fillet.
    """
    radius, noise_std = screened.ellipse.radius, _estimate_noise_std(profile, screened)
    fillet_curvatures, bead_curvatures = (
        [
            _measure_significant_curvature(beyond, noise_std)
            for _, beyond in _split_ends(profile, indices, count)
        ]
        for indices in (screened.indices, longest)
    )
    return [
        fillet * radius > MIN_FILLET_CURVATURE or bead * radius < -MIN_BEAD_CURVATURE
        for fillet, bead in zip(fillet_curvatures, bead_curvatures, strict=True)
    ]


def _measure_significant_curvature(line: ComplexArray, noise_std: float) -> float:
    """Return the curvature of a line (n,), positive if concave towards the sensor. Units: 1/mm.

    0 if it is not significant, or the line has no chord or fewer than three positions along it.
    `noise_std` (mm) is the standard deviation of a point.
    """
    chord = complex(line[-1] - line[0]) if len(line) >= MIN_CURVED_POINTS else 0j
    if chord == 0:
        return 0.0
    # Height above the chord, positive towards the sensor.
    in_chord_frame = (line - line[0]) * (chord.conjugate() / abs(chord))
    x, height = in_chord_frame.real, in_chord_frame.imag if chord.real > 0 else -in_chord_frame.imag
    if len(set(x.tolist())) < 3:
        return 0.0
    parabola, covariance = np.polyfit(x, height, 2, cov="unscaled")
    residuals = height - np.polyval(parabola, x)
    dof = len(line) - len(parabola)
    scatter = max(noise_std, math.sqrt(float(residuals @ residuals) / dof))
    curvature, std = 2 * float(parabola[0]), 2 * scatter * math.sqrt(float(covariance[0, 0]))
    return curvature if abs(curvature) > SIGNIFICANT_SIGMAS * std else 0.0
