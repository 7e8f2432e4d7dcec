"""The other way round: the scan that an accuracy needs."""

import math
from dataclasses import dataclass, replace

from lsvision.errors import DegenerateGeometry
from lsvision.planning.plan import plan_scan
from lsvision.planning.scan_bound import Feed, ScanPrediction
from lsvision.planning.sensor_view import SensorView

MAX_SECTIONS = 2048
"""Longest scan that `sections_needed` tries."""


@dataclass(frozen=True, kw_only=True)
class AccuracyTarget:
    """One-sigma errors that a scan has to reach; those not given may be anything.

    Parameters
    ----------
    radius_std : float
        Units: mm.
    theta_std, phi_std, direction_std : float
        Units: rad.

    Raises
    ------
    ValueError
        If none is given, or one is not positive.
    """

    radius_std: float = math.inf
    theta_std: float = math.inf
    phi_std: float = math.inf
    direction_std: float = math.inf

    def __post_init__(self) -> None:
        values = (self.radius_std, self.theta_std, self.phi_std, self.direction_std)
        if not all(value > 0 for value in values) or min(values) == math.inf:
            raise ValueError(f"want at least one target, all of them positive, got {self}")

    def met_by(self, prediction: ScanPrediction) -> bool:
        """Whether every error is at most its target."""
        return (
            prediction.radius_std <= self.radius_std
            and prediction.theta_std <= self.theta_std
            and prediction.phi_std <= self.phi_std
            and prediction.direction_std <= self.direction_std
        )


def sections_needed(  # noqa: PLR0913 - what `plan_scan` asks, and the target
    radius: float,
    theta: float,
    phi: float,
    *,
    target: AccuracyTarget,
    view: SensorView | None = None,
    feed: Feed | None = None,
    known_radius_std: float | None = None,
) -> ScanPrediction:
    """Shortest scan at the feed's spacing that reaches an accuracy.

    Parameters
    ----------
    radius, theta, phi, view, known_radius_std
        As in `plan_section`.
    target : AccuracyTarget
        One sigma of each number that matters.
    feed : Feed, optional
        As in `plan_scan`; its number of sections is not used.

    Returns
    -------
    ScanPrediction
        What that scan reaches; its `sections` and `length` are the answer.

    Raises
    ------
    DegenerateGeometry
        If 2048 sections do not reach the target.
    TooFewPoints, ValueError
        As in `plan_scan`.

    Examples
    --------
    >>> target = AccuracyTarget(phi_std=math.radians(0.05))
    >>> scan = sections_needed(19.0, math.radians(20), math.radians(20), target=target)
    >>> f"{scan.sections} sections over {scan.length:g} mm"
    '13 sections over 12 mm'
    """
    feed = Feed() if feed is None else feed

    def plan(sections: int) -> ScanPrediction:
        scan = replace(feed, sections=sections)
        return plan_scan(
            radius, theta, phi, view=view, feed=scan, known_radius_std=known_radius_std
        )

    few, many = 0, 1
    while not target.met_by(reached := plan(many)):
        few, many = many, 2 * many
        if many > MAX_SECTIONS:
            raise DegenerateGeometry(_unreachable(reached))
    # Errors fall with the number of sections, so the least one lies in (few, many].
    while many - few > 1:
        middle = (few + many) // 2
        tried = plan(middle)
        if target.met_by(tried):
            many, reached = middle, tried
        else:
            few = middle
    return reached


def _unreachable(reached: ScanPrediction) -> str:
    return (
        f"{reached.sections} sections over {reached.length:g} mm reach radius "
        f"{reached.radius_std:.2g} mm, direction {math.degrees(reached.direction_std):.2g} deg, "
        f"phi {math.degrees(reached.phi_std):.2g} deg, theta {math.degrees(reached.theta_std):.2g}"
        " deg and not the target: widen the spacing, or know the poses better"
    )
