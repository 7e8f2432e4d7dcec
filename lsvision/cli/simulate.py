"""``lsvision simulate``: random scenes under a profile sensor, written with their truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.messages import print_lines

if TYPE_CHECKING:
    from lsvision.simulate import SimulatedSection, TubeRanges

KIND_HELP = (
    "single, welded_pair, planar, complex, welded_complex, three_stacked, or empty "
    "(clutter without a tube)."
)
"""Kinds of scenes, `SCENE_KINDS`, whose import would import numpy."""


def simulate(
    kind: Annotated[str, typer.Argument(metavar="KIND", help=KIND_HELP)],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Existing folder for the files.")
    ],
    seed: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="Seed of the first scene; each further scene has the next number.",
        ),
    ] = 0,
    count: Annotated[int, typer.Option(metavar="N", min=1, help="Number of scenes.")] = 1,
    noise_mm: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="One sigma along the ray at 400 mm; drawn from 0.02-0.1 mm if not given.",
        ),
    ] = None,
    radius: Annotated[
        str, typer.Option(metavar="MM|MM:MM", help="Radius of the tubes, or min:max, mm.")
    ] = "10:40",
    theta_deg: Annotated[
        str,
        typer.Option(metavar="DEG|DEG:DEG", help="Direction of the major axis from X to Y, deg."),
    ] = "0:180",
    phi_deg: Annotated[
        str, typer.Option(metavar="DEG|DEG:DEG", help="Tilt of the tubes, deg.")
    ] = "0:40",
    lost: Annotated[
        float, typer.Option(metavar="P", min=0, max=1, help="Fraction of columns lost at random.")
    ] = 0.03,
    jumps: Annotated[
        float,
        typer.Option(metavar="P", min=0, max=1, help="Fraction of points with errors of 2-12 mm."),
    ] = 0.02,
) -> None:
    """Write simulated light sections of pipes, each with the truth beside it.

    KIND_0000.csv holds x and z in mm, z growing towards the sensor, one row per column of the
    sensor, nan where it measured nothing. KIND_0000.truth.json holds the radius, theta, phi and
    centre of every tube, the label of every point, the sensor and the seed. The same command
    writes the same bytes.

    \b
    One welded pair:
      lsvision simulate welded_pair --out .
    A hundred pipes of 19 mm among bars and curved sheets, to test settings with:
      mkdir trial && lsvision simulate complex --count 100 --radius 19 --out trial
    A single pipe tilted by 20 to 30 deg, almost without noise:
      lsvision simulate single --phi-deg 20:30 --noise-mm 0.005 --lost 0 --jumps 0 --out .
    """  # noqa: D301 - the backspace makes click keep the line breaks
    from lsvision.files.atomic_files import write_atomic
    from lsvision.simulate import SCENE_KINDS, SectionSettings, random_section
    from lsvision.simulate.text_export import format_profile, format_truth

    if kind not in SCENE_KINDS:
        raise typer.BadParameter(f"expected one of {', '.join(SCENE_KINDS)}, got {kind!r}")
    if noise_mm is not None and not 1e-6 <= noise_mm <= 1000:
        raise typer.BadParameter(
            f"expected --noise-mm above 0, from 1e-6 to 1000, got {noise_mm:g}"
        )
    tubes = _parse_tube_ranges(radius, theta_deg, phi_deg)
    settings = SectionSettings(lost_fraction=lost, jump_fraction=jumps)
    for scene_seed in range(seed, seed + count):
        section = random_section(
            kind, scene_seed, noise_mm=noise_mm, settings=settings, tubes=tubes
        )
        command = _format_command(kind, scene_seed, section, tubes)
        source = {"kind": kind, "seed": scene_seed, "command": command}
        stem = out / f"{kind}_{scene_seed:04d}"
        title = f"simulated light section, {kind}, seed {scene_seed}"
        write_atomic(f"{stem}.csv", format_profile(section, title))
        write_atomic(f"{stem}.truth.json", format_truth(section, source))
    first, last = f"{kind}_{seed:04d}.csv", f"{kind}_{seed + count - 1:04d}.csv"
    names = f"{first} with its" if count == 1 else f"{first} to {last}, each with its"
    print_lines([f"{out}: {names} .truth.json"])


def _parse_tube_ranges(radius: str, theta_deg: str, phi_deg: str) -> "TubeRanges":
    """Return the ranges of the options, or raise a usage error for an impossible one."""
    from lsvision.simulate import TubeRanges

    try:
        return TubeRanges(
            radius_mm=_parse_range(radius, "--radius"),
            theta_deg=_parse_range(theta_deg, "--theta-deg"),
            phi_deg=_parse_range(phi_deg, "--phi-deg"),
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def _parse_range(text: str, option: str) -> tuple[float, float]:
    """Return (smallest, largest) of a range written as ``10:40``, or as ``19`` for both."""
    first, _, second = text.partition(":")
    try:
        smallest, largest = float(first), float(second if ":" in text else first)
    except ValueError:
        raise typer.BadParameter(
            f"expected a number or min:max for {option}, got {text!r}"
        ) from None
    return smallest, largest


def _format_command(kind: str, seed: int, section: "SimulatedSection", tubes: "TubeRanges") -> str:
    """Return the command that writes this scene alone, except --out, which does not change it."""
    ranges = (("radius", tubes.radius_mm), ("theta-deg", tubes.theta_deg),
              ("phi-deg", tubes.phi_deg))  # fmt: skip
    arguments = [f"--{name} {low!r}:{high!r}" for name, (low, high) in ranges]
    settings = section.settings
    arguments.append(f"--noise-mm {section.sensor.range_std!r}")
    arguments.append(f"--lost {settings.lost_fraction!r} --jumps {settings.jump_fraction!r}")
    return f"lsvision simulate {kind} --seed {seed} " + " ".join(arguments)
