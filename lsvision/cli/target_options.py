"""Options of a calibration target, shared by the commands that print or detect one."""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lsvision.calibration.target import Target

TARGETS = ("charuco", "chessboard", "circles", "circles-asymmetric")


@dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """Kind and dimensions of a calibration target."""

    target_name: Annotated[
        str, typer.Option("--target", metavar="NAME", help=f"Kind of target: {', '.join(TARGETS)}.")
    ] = "charuco"
    counts: Annotated[
        str | None,
        typer.Option(
            metavar="NxM",
            help="Squares of a ChArUco board [11x8], inner corners of a chessboard, discs of a "
            "grid.",
        ),
    ] = None
    square: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Edge of a square or spacing of discs [15]: measure it!"),
    ] = None
    marker: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Edge of a marker [11/15 of a square], or a disc's diameter."
        ),
    ] = None
    dictionary: Annotated[
        str, typer.Option(metavar="NAME", help="Dictionary of a ChArUco board's markers.")
    ] = "DICT_4X4_100"

    def parse(self) -> "Target":
        """Return the target that the options describe.

        Raises
        ------
        typer.BadParameter
            For an unknown name, invalid counts, or lengths that contradict each other.
        """
        from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid

        name = self.target_name
        if name not in TARGETS:
            raise typer.BadParameter(f"expected --target {', '.join(TARGETS)}, got {name!r}")
        if name != "charuco" and (self.counts is None or self.square is None):
            raise typer.BadParameter(f"expected --counts NxM and --square MM with --target {name}")
        columns, rows = (11, 8) if self.counts is None else _parse_counts(self.counts)
        edge = 15.0 if self.square is None else self.square
        try:
            if name == "charuco":
                marker = edge * 11 / 15 if self.marker is None else self.marker
                return ChArUco(columns, rows, edge, marker, self.dictionary)
            if name == "chessboard":
                return Chessboard(columns, rows, edge)
            asymmetric = name == "circles-asymmetric"
            default_diameter = edge * (0.8 if asymmetric else 0.5)
            diameter = default_diameter if self.marker is None else self.marker
            return CircleGrid(columns, rows, edge, diameter, asymmetric)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None


def _parse_counts(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if not match:
        raise typer.BadParameter(f"expected --counts NxM, as 11x8, got {text!r}")
    return int(match[1]), int(match[2])
