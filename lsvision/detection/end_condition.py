"""What the line does beyond the ends of an arc: a cylinder's does not go on tangentially.

The line of a cylinder ends at its own horizon, or in a kink at the next thing. The crest of a bent
sheet, or the rounded corner of a tube, goes on tangentially. The exception is a fillet, such as
the foot of a weld bead: it leaves tangentially too, but curves away from the cylinder.
"""

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals
from lsvision.geometry import Ellipse, IntArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import upper_median

if TYPE_CHECKING:
    from lsvision.detection.screening import ScreenedArc

MIN_TURN_DEG = 20.0
"""An end that turns less goes on tangentially. Units: deg."""
MIN_TURN_EITHER_END_DEG = 35.0
"""Where both ends turn less the arc is the crest of a bent or corrugated sheet. Units: deg."""
HORIZON_NORMAL_Y = -0.2
"""Component towards the sensor of the normal at an end: below, the end is beyond the horizon, and
what follows is the far side of the same ring."""
MIN_POINTS_BEYOND = 6
"""Points beyond an end over which its turn is measured: so many, or this share of the arc's."""
BEYOND_FRACTION = 1 / 8
MAX_GAP_STEPS = 3.0
"""A next point further away than so many of the arc's own steps is not connected."""
STEP_POINTS = 12
"""Points of the arc whose steps count for that."""
FILLET_WINDOWS = (6, 9, 14, 20)
"""Points beyond an end whose curvature may show a fillet: a fillet is short, and noise hides it
over too few points."""
FILLET_SIGMAS = 3.0
"""Standard deviations by which its curvature must be concave."""
MIN_FILLET_CURVATURE = 0.5
"""Its curvature over that of the cylinder; feet of weld beads have 0.9 to 1.6, the line beyond a
rounded corner at most 0."""
MIN_DOUBLE_FILLET_CURVATURE = 1.5
"""The same where both ends go on tangentially: the valleys of a corrugated sheet have up to 1."""


def tangential_end_reason(
    profile: PreparedProfile, arc: IdentifiedArc, screened: "ScreenedArc", noise_std: float
) -> str | None:
    """Why the line beyond the ends shows that an arc is none of a cylinder; None if it does not.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        Before screening: the turn is measured at the outer ends, because screening may cut them
        short.
    screened : ScreenedArc
        After screening: fillets begin at its ends.
    noise_std : float
        Standard deviation of a point. Units: mm.
    """
    ahead = max(MIN_POINTS_BEYOND, int(BEYOND_FRACTION * len(arc.indices)))
    widest = np.union1d(arc.indices, screened.indices)
    points = profile.noisy_points[widest]
    turns_deg = [
        math.degrees(_end_turn(points[::side], beyond, arc.ellipse, max(5, ahead // 2)))
        for side, beyond in zip((-1, 1), _lines_beyond(profile, widest, ahead), strict=True)
    ]
    if min(turns_deg) >= MIN_TURN_DEG and max(turns_deg) >= MIN_TURN_EITHER_END_DEG:
        return None
    both = max(turns_deg) < MIN_TURN_EITHER_END_DEG
    curvature = MIN_DOUBLE_FILLET_CURVATURE if both else MIN_FILLET_CURVATURE
    curvature /= screened.ellipse.radius
    lines = _lines_beyond(profile, screened.indices, FILLET_WINDOWS[-1])
    fillets = [_is_fillet(line, curvature, noise_std) for line in lines]
    if both and not all(fillets):
        first, second = sorted(turns_deg)
        return f"goes on tangentially at both ends (turns {first:.0f} and {second:.0f} deg)"
    for turn_deg, fillet in zip(turns_deg, fillets, strict=True):
        if turn_deg < MIN_TURN_DEG and not fillet:
            return f"goes on tangentially at one end (turns {turn_deg:.0f} deg): a rounded corner"
    return None


def connected_beyond(own: ComplexArray, beyond: ComplexArray, most: int) -> IntArray:
    """Positions of the points that follow an arc, each within reach of the one before.

    Parameters
    ----------
    own : (k,) complex ndarray
        Points of the arc, towards its end; at least two. Units: mm.
    beyond : (n,) complex ndarray
        Points beyond that end, outwards. Units: mm.
    most : int
        Of them that are looked for.
    """
    own = own[-STEP_POINTS:]
    reach = MAX_GAP_STEPS * upper_median(np.abs(own[1:] - own[:-1]))
    last, chain = complex(own[-1]), []
    for i, point in enumerate(beyond.tolist()):
        if abs(point - last) <= reach:
            chain.append(i)
            last = point
            if len(chain) == most:
                break
    return np.array(chain, dtype=int)


def _lines_beyond(
    profile: PreparedProfile, indices: IntArray, count: int
) -> tuple[ComplexArray, ComplexArray]:
    """The connected points before the start and after the end of an arc, outwards."""
    valid, z = profile.valid_indices, profile.noisy_points.z
    first, last = np.searchsorted(valid, indices[[0, -1]]).tolist()
    before = z[valid[max(0, first - 2 * count) : first][::-1]]
    after = z[valid[last + 1 : last + 1 + 2 * count]]
    return (
        before[connected_beyond(z[indices[:STEP_POINTS]][::-1], before, count)],
        after[connected_beyond(z[indices[-STEP_POINTS:]], after, count)],
    )


def _end_turn(points: NoisyPoints, beyond: ComplexArray, ellipse: Ellipse, fewest: int) -> float:
    """Angle between the tangent at the last point and the line beyond it. Units: rad.

    pi where fewer than `fewest` points follow, or only the far side of a ring: nothing goes on.
    """
    if len(beyond) < fewest:
        return math.pi
    compared = ellipse_residuals(points[-1:], parameters_from_ellipse(ellipse))
    normal = complex(compared.normals[0])
    if normal.imag < HORIZON_NORMAL_Y:
        return math.pi
    tangent = 1j * normal
    ahead = complex(points.z[-1] - points.z[-min(len(points), 6)])
    if (tangent * ahead.conjugate()).real < 0:
        tangent = -tangent
    # The principal axis of points has half the angle of the sum of their squares.
    centred = beyond - beyond.sum() / len(beyond)
    direction = cmath.sqrt(complex((centred * centred).sum()))
    if (direction * complex(beyond[-1] - beyond[0]).conjugate()).real < 0:
        direction = -direction
    return abs(cmath.phase(direction * tangent.conjugate()))


def _is_fillet(line: ComplexArray, min_curvature: float, noise_std: float) -> bool:
    """Whether the line beyond an end is significantly concave to the sensor, over any window."""
    for count in FILLET_WINDOWS:
        if len(line) < count:
            break
        curvature, std = _curvature(line[:count], noise_std)
        if curvature > max(FILLET_SIGMAS * std, min_curvature):
            return True
    return False


def _curvature(line: ComplexArray, noise_std: float) -> tuple[float, float]:
    """Curvature of a line, positive where concave towards +Y, and its standard deviation. 1/mm."""
    chord = complex(line[-1] - line[0])
    turned = (line - line[0]) * (chord.conjugate() / abs(chord))
    height = turned.imag if chord.real > 0 else -turned.imag
    design = np.vander(turned.real, 3, increasing=True)
    covariance = np.linalg.pinv(design.T @ design)
    coefficients = covariance @ (design.T @ height)
    misfit = height - design @ coefficients
    scatter = max(noise_std, math.sqrt(float(misfit @ misfit) / (len(line) - 3)))
    return 2 * float(coefficients[2]), 2 * scatter * math.sqrt(float(covariance[2, 2]))
