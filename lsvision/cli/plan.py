"""``lsvision plan``: predicted accuracy of a measurement, before it is made."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.results.tables import format_text_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lsvision.planning import (
        AccuracyTarget,
        Feed,
        ScanPrediction,
        SectionPrediction,
        SensorView,
    )

SPACINGS_MM = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Spacings for which a scan is proposed if a target is given without --spacing: each about twice
the one before."""

UNDETERMINED_DEG = 50.0
"""Standard deviation from which theta is reported as not determinable: a direction guessed at
random has 52 deg (180 deg / sqrt(12))."""

MAX_SECTIONS = 2048
"""Largest --sections, as of `sections_needed`: memory and time grow with them."""

DEFAULT_PITCH_MM = 0.6
"""Default of --pitch with --range-std: the point spacing of the paper's sensor."""

MAX_STANDOFF_PITCHES = 1e5
"""Largest ratio of --standoff to --pitch: memory grows with it; no sensor has as many points."""


def plan(
    *,
    radius_mm: Annotated[float, typer.Option("--radius", metavar="MM", help="Radius of the pipe.")],
    theta_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="Direction of the section's major axis, from X towards Y."
        ),
    ] = 0.0,
    phi_deg: Annotated[
        float,
        typer.Option(metavar="DEG", help="Angle of the pipe's axis from the laser plane's normal."),
    ] = 20.0,
    standoff: Annotated[
        float, typer.Option(metavar="MM", help="Distance of the sensor from the pipe's centre.")
    ] = 400.0,
    sensor: Annotated[
        str | None, typer.Option(metavar="lps36hi|lps36", help="Model of the sensor [lps36hi].")
    ] = None,
    range_std: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Noise of any other sensor: one sigma along the ray at the standoff.",
        ),
    ] = None,
    pitch: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Spacing of the points in X at the standoff [the sensor's; 0.6 with --range-std].",
        ),
    ] = None,
    sections: Annotated[
        int | None,
        typer.Option(
            max=MAX_SECTIONS, metavar="N", help="Number of parallel sections fitted jointly [1]."
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Distance between sections [1; several if a target is given]."
        ),
    ] = None,
    feed_std_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG", help="One sigma of the direction in which the sensor is moved."
        ),
    ] = 0.0,
    pose_std: Annotated[
        float, typer.Option(metavar="MM", help="One sigma of each section's position, per axis.")
    ] = 0.0,
    known_radius: Annotated[
        bool, typer.Option("--known-radius", help="Assume that the radius is known exactly.")
    ] = False,
    target_phi_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Find the fewest sections for this sigma of phi."),
    ] = None,
    target_radius: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Find the fewest sections for this sigma of the radius."),
    ] = None,
) -> None:
    """Predict the one-sigma errors of a pipe's radius and direction, without measuring.

    Without errors of the poses (--pose-std, --feed-std-deg) they are Cramer-Rao bounds: no unbiased
    fit has smaller ones. The effect of pose errors on a fit that takes the poses as exact is added.

    \b
    One section of a 19 mm pipe under an LPS 36 HI:
      lsvision plan --radius 19 --theta-deg 20 --phi-deg 20 --standoff 400
    Twenty sections, 1 mm apart, any sensor with 0.1 mm noise along the ray:
      lsvision plan --radius 19 --range-std 0.1 --sections 20 --spacing 1
    Number of sections, and length of the scan, for a phi within 0.05 deg:
      lsvision plan --radius 19 --phi-deg 20 --target-phi-deg 0.05
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.planning import Feed

    try:
        view = _build_view(sensor, range_std, standoff=standoff, pitch=pitch)
        if known_radius and target_radius is not None:
            raise ValueError("expected --known-radius or --target-radius, got both")
        target = _build_target(target_phi_deg, target_radius)
        if (sections is None or sections == 1) and target is None:
            _reject_scan_options(
                {"--spacing": spacing, "--feed-std-deg": feed_std_deg, "--pose-std": pose_std}
            )
        feed = Feed(
            sections=1 if sections is None else sections,
            spacing=1.0 if spacing is None else spacing,
            pose_std=pose_std,
            feed_std=math.radians(feed_std_deg),
        )
        request = _PlanRequest(
            pipe=(radius_mm, math.radians(theta_deg), math.radians(phi_deg)),
            view=view,
            known_radius_std=0.0 if known_radius else None,
        )
        predictions = request.predict(feed)
        spacings = SPACINGS_MM if spacing is None else (spacing,)
        scans = [] if target is None else request.find_shortest_scans(target, feed, spacings)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(
        f"pipe of radius {radius_mm:g} mm, theta {theta_deg:g} deg, phi {phi_deg:g} deg, "
        f"under {view.sensor.name} at {standoff:g} mm; errors are one sigma"
    )
    typer.echo(_format_table(predictions))
    if scans:
        typer.echo("fewest sections that reach the target accuracy, for each spacing:")
        typer.echo(_format_table(scans))


def _reject_scan_options(values: "Mapping[str, float | None]") -> None:
    """Raise an error for options of a scan beside one section: they would have no effect."""
    names = [name for name, value in values.items() if value]
    if names:
        raise ValueError(
            f"expected --sections of 2 or more, or a target, with {', '.join(names)}, got neither"
        )


@dataclass(frozen=True)
class _PlanRequest:
    """Measurement whose accuracy is predicted.

    `pipe` is radius (mm), theta and phi (rad); the std of a known radius, in mm, is None if it is
    unknown.
    """

    pipe: tuple[float, float, float]
    view: "SensorView"
    known_radius_std: float | None

    def predict(self, feed: "Feed") -> "list[SectionPrediction | ScanPrediction]":
        """Return the prediction for one section, then that for the scan if it has several."""
        from lsvision.planning import plan_scan, plan_section

        section = plan_section(*self.pipe, view=self.view, known_radius_std=self.known_radius_std)
        if feed.sections == 1:
            return [section]
        scan = plan_scan(
            *self.pipe, view=self.view, feed=feed, known_radius_std=self.known_radius_std
        )
        return [section, scan]

    def find_shortest_scans(
        self, target: "AccuracyTarget", feed: "Feed", spacings: tuple[float, ...]
    ) -> "list[SectionPrediction | ScanPrediction]":
        """Return the prediction of the shortest scan that reaches the target at each spacing."""
        from lsvision.planning import sections_needed

        return [
            sections_needed(
                *self.pipe,
                target=target,
                view=self.view,
                feed=replace(feed, spacing=spacing),
                known_radius_std=self.known_radius_std,
            )
            for spacing in spacings
        ]


def _build_view(
    sensor: str | None, range_std: float | None, *, standoff: float, pitch: float | None
) -> "SensorView":
    """Return the view of a named sensor, or of a generic one with the given noise; lengths in mm.

    Raises
    ------
    ValueError
        If both are given, one is invalid, or the pitch is too fine.
    """
    from lsvision.planning import SensorView
    from lsvision.sensors.profile_sensor import ProfileSensor, find_sensor

    stated_pitch = DEFAULT_PITCH_MM if pitch is None and range_std is not None else pitch
    if stated_pitch is not None and 0 < MAX_STANDOFF_PITCHES * stated_pitch < standoff:
        raise ValueError(
            f"expected a --pitch of at least {standoff / MAX_STANDOFF_PITCHES:g} mm with "
            f"--standoff {standoff:g}, got {stated_pitch:g}"
        )
    if range_std is None:
        return SensorView(sensor=find_sensor(sensor or "lps36hi"), standoff=standoff, pitch=pitch)
    if sensor is not None:
        raise ValueError("expected --sensor or --range-std, got both")
    # Its measuring range is unknown: a wide one, so that it limits the view as little as possible.
    generic_sensor = ProfileSensor(
        name=f"a sensor with {range_std:g} mm noise",
        range_std=range_std,
        reference_range=standoff,
        min_range=standoff / 10,
        max_range=2 * standoff,
        width_at_max_range=2 * standoff,
    )
    return SensorView(sensor=generic_sensor, standoff=standoff, pitch=stated_pitch)


def _build_target(phi_deg: float | None, radius_mm: float | None) -> "AccuracyTarget | None":
    """Return the target with these standard deviations; None if neither is given."""
    from lsvision.planning import AccuracyTarget

    for option, value in (("--target-phi-deg", phi_deg), ("--target-radius", radius_mm)):
        if value is not None and not 0 < value < math.inf:
            raise ValueError(f"expected {option} above 0, got {value:g}")
    if phi_deg is None and radius_mm is None:
        return None
    return AccuracyTarget(
        phi_std=math.inf if phi_deg is None else math.radians(phi_deg),
        radius_std=math.inf if radius_mm is None else radius_mm,
    )


_HEADER = ("sections", "spacing mm", "length mm", "points", "radius mm", "theta deg", "phi deg")
"""Header of the table; the last three columns are standard deviations."""


def _format_table(predictions: "list[SectionPrediction | ScanPrediction]") -> str:
    """Return a table with one row per prediction."""
    return "\n".join(format_text_table([_HEADER, *map(_format_row, predictions)]))


def _format_row(prediction: "SectionPrediction | ScanPrediction") -> tuple[str, ...]:
    """Return the cells of a prediction under `_HEADER`; a section has no spacing."""
    from lsvision.planning import ScanPrediction
    from lsvision.results.number_format import format_std

    sections, length = 1, 0.0
    if isinstance(prediction, ScanPrediction):
        sections, length = prediction.sections, prediction.length
    spacing = f"{length / (sections - 1):g}" if sections > 1 else "-"
    theta_deg = math.degrees(prediction.theta_std)
    return (
        str(sections),
        spacing,
        f"{length:g}",
        str(prediction.points),
        format_std(prediction.radius_std),
        format_std(theta_deg) if theta_deg < UNDETERMINED_DEG else "not determinable",
        format_std(math.degrees(prediction.phi_std)),
    )
