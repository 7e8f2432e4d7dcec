"""Options that describe a calibration target, for the commands that print or detect one."""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lsvision.calibration.target import Target

TARGETS = ("charuco", "chessboard", "circles", "circles-asymmetric")
"""Values of --target."""
DEFAULT_COUNTS = (11, 8)
"""Default columns and rows of squares of a ChArUco board: those of `ChArUco`."""
DEFAULT_SQUARE_MM = 15.0
"""Default edge of a square, as of `ChArUco`."""
DEFAULT_MARKER_MM = 11.0
"""Default edge of a marker in a square of `DEFAULT_SQUARE_MM`, as of `ChArUco`; in another square
it is scaled with the square."""
DEFAULT_DICTIONARY = "DICT_4X4_100"
"""Default dictionary of the markers, as of `ChArUco`."""
DEFAULT_DISC_RATIO, DEFAULT_ASYMMETRIC_DISC_RATIO = 0.5, 0.8
"""Default diameter of a disc relative to the spacing. In an asymmetric grid, that of `CircleGrid`:
its nearest discs are sqrt(2) spacings apart, so that they may be larger."""


@dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """Options for the kind and the dimensions of a calibration target."""

    target_name: Annotated[
        str, typer.Option("--target", metavar="NAME", help=f"Kind of target: {', '.join(TARGETS)}.")
    ] = "charuco"
    counts: Annotated[
        str | None,
        typer.Option(
            metavar="NxM",
            help="Columns x rows: squares of a ChArUco board [11x8], inner corners of a "
            "chessboard, discs of a grid.",
        ),
    ] = None
    square: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Edge of a square or spacing of discs, as measured on the print [15]; of an "
            "asymmetric grid the spacing of its rows, half that of the discs in a row.",
        ),
    ] = None
    marker: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Edge of a marker [11/15 of a square], or diameter of a disc [0.5 of the "
            "spacing, 0.8 if asymmetric].",
        ),
    ] = None
    dictionary: Annotated[
        str, typer.Option(metavar="NAME", help="Dictionary of a ChArUco board's markers.")
    ] = DEFAULT_DICTIONARY

    def parse(self) -> "Target":
        """Return the target that the options describe; lengths in mm.

        Raises
        ------
        typer.BadParameter
            If the name is unknown, counts or edge are missing, or a value is not possible beside
            the others.
        """
        from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid

        name = self.target_name
        if name not in TARGETS:
            raise typer.BadParameter(f"expected --target {', '.join(TARGETS)}, got {name!r}")
        if name != "charuco" and (self.counts is None or self.square is None):
            raise typer.BadParameter(f"expected --counts NxM and --square MM with --target {name}")
        if name == "chessboard" and self.marker is not None:
            raise typer.BadParameter("expected --marker with markers or discs, got a chessboard")
        if name != "charuco" and self.dictionary != DEFAULT_DICTIONARY:
            raise typer.BadParameter(f"expected --dictionary with --target charuco, got {name}")
        columns, rows = DEFAULT_COUNTS if self.counts is None else _parse_counts(self.counts)
        square = DEFAULT_SQUARE_MM if self.square is None else self.square
        try:
            if name == "charuco":
                default_marker = square * DEFAULT_MARKER_MM / DEFAULT_SQUARE_MM
                marker = default_marker if self.marker is None else self.marker
                return ChArUco(columns, rows, square, marker, self.dictionary)
            if name == "chessboard":
                return Chessboard(columns, rows, square)
            asymmetric = name == "circles-asymmetric"
            ratio = DEFAULT_ASYMMETRIC_DISC_RATIO if asymmetric else DEFAULT_DISC_RATIO
            diameter = square * ratio if self.marker is None else self.marker
            return CircleGrid(columns, rows, square, diameter, asymmetric)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None


def _parse_counts(text: str) -> tuple[int, int]:
    """Return columns and rows from a text such as ``11x8``."""
    match = re.fullmatch(r"(\d{1,3})[xX](\d{1,3})", text.strip())
    if not match:
        raise typer.BadParameter(f"expected --counts NxM up to 999x999, such as 11x8, got {text!r}")
    return int(match[1]), int(match[2])
