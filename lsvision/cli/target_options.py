"""Options that describe a calibration target, shared by the commands that print or see one."""

import re
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lsvision.calibration.target import Target

TARGETS = ("charuco", "chessboard", "circles", "circles-asymmetric")

TargetName = Annotated[str, typer.Option("--target", metavar="NAME", help=f"{', '.join(TARGETS)}.")]
Counts = Annotated[
    str | None,
    typer.Option(
        metavar="NxM",
        help="Squares of a ChArUco board [11x8], inner corners of a chessboard, discs of a grid.",
    ),
]
Square = Annotated[
    float | None,
    typer.Option(metavar="MM", help="Edge of a square or spacing of discs [15]: measure it!"),
]
Marker = Annotated[
    float | None,
    typer.Option(metavar="MM", help="Edge of a marker [11/15 of a square], or a disc's diameter."),
]
Dictionary = Annotated[str, typer.Option(metavar="NAME", help="Of a ChArUco board's markers.")]


def parse_target(
    name: str, counts: str | None, square: float | None, marker: float | None, dictionary: str
) -> "Target":
    """The target that the options describe.

    Parameters
    ----------
    name : str
        One of `TARGETS`.
    counts : str, optional
        ``11x8``: squares of a ChArUco board, inner corners of a chessboard, discs of a grid.
    square : float, optional
        Edge of a square, or spacing of the discs. Units: mm.
    marker : float, optional
        Edge of a marker, or diameter of a disc. Units: mm.
    dictionary : str
        Of a ChArUco board's markers.

    Raises
    ------
    typer.BadParameter
        For an unknown name, counts that are none, or lengths that do not go together.
    """
    from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid

    if name not in TARGETS:
        raise typer.BadParameter(f"want --target {', '.join(TARGETS)}, got {name!r}")
    if name != "charuco" and (counts is None or square is None):
        raise typer.BadParameter(f"want --counts NxM and --square MM beside --target {name}")
    columns, rows = (11, 8) if counts is None else _counts(counts)
    edge = 15.0 if square is None else square
    try:
        if name == "charuco":
            inner = edge * 11 / 15 if marker is None else marker
            return ChArUco(columns, rows, edge, inner, dictionary)
        if name == "chessboard":
            return Chessboard(columns, rows, edge)
        disc = edge * (0.8 if name == "circles-asymmetric" else 0.5) if marker is None else marker
        return CircleGrid(columns, rows, edge, disc, name == "circles-asymmetric")
    except ValueError as slip:
        raise typer.BadParameter(str(slip)) from None


def _counts(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)[xX](\d+)", text.strip())
    if not found:
        raise typer.BadParameter(f"want --counts NxM, as 11x8, got {text!r}")
    return int(found[1]), int(found[2])
