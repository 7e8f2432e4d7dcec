"""``lsvision calibrate capture``: pairs of board and laser line from a camera."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lsvision.cli.calibrate_inputs import LineOptions
from lsvision.cli.option_groups import expand_option_groups
from lsvision.cli.sources import IMAGE_SUFFIXES, resolve_path
from lsvision.cli.target_options import TargetOptions
from lsvision.errors import LsvisionError, UnwritableFile

if TYPE_CHECKING:
    from lsvision.calibration.capture_pairs import Pair

DEFAULT_PAIRS = 15
"""Number of pairs that `calibrate camera` and `calibrate laser-plane` recommend."""


@expand_option_groups
def capture(
    *,
    camera: Annotated[
        str,
        typer.Option(
            metavar="N|genicam:ADDRESS|FILE",
            help="Index of a connected camera, a GenICam camera, or a video in its place.",
        ),
    ],
    boards: Annotated[Path, typer.Option(metavar="DIR", help="Folder for board_00.png and so on.")],
    lines: Annotated[Path, typer.Option(metavar="DIR", help="Folder for line_00.png and so on.")],
    target_options: TargetOptions,
    pairs: Annotated[
        int, typer.Option(min=2, metavar="N", help="Number of pairs.")
    ] = DEFAULT_PAIRS,
    line_options: LineOptions,
) -> None:
    """Take the images for calibrate camera and calibrate laser-plane.

    Hold the board in front of the camera: an image is saved once the board is found, at rest and in
    focus; then switch the laser on. The image of the line is saved when the line lies on the
    unmoved board. After each pair the command lists what is still missing: parts of the image,
    tilts, distances.

    \b
      lsvision calibrate capture --camera 0 --boards boards --lines lines
      lsvision calibrate capture --camera genicam:192.168.1.20 --boards boards --lines lines
    """  # noqa: D301 - the backspace makes click keep the line breaks
    board, line = target_options.parse(), line_options.parse()
    if resolve_path(boards) == resolve_path(lines):
        raise typer.BadParameter(
            f"expected different folders for --boards and --lines, got {boards}"
        )
    for folder in (boards, lines):
        _require_empty(folder)
    from lsvision.calibration.capture_pairs import (
        CaptureSettings,
        CaptureState,
        advance_state,
        list_missing_views,
    )
    from lsvision.io.frames import open_camera

    settings, state, printed_instruction = CaptureSettings(line=line), CaptureState(), ""
    for frame in open_camera(camera):
        state, instruction, pair = advance_state(state, frame, board, settings)
        if instruction != printed_instruction:
            typer.echo(instruction)
        printed_instruction = instruction
        if pair is not None:
            _write_pair(pair, len(state.pairs) - 1, boards, lines)
            typer.echo(f"missing: {'; '.join(list_missing_views(state.pairs, pairs)) or 'nothing'}")
        if len(state.pairs) == pairs:
            break
    typer.echo(f"{len(state.pairs)} of {pairs} pairs in {boards} and {lines}")
    if len(state.pairs) < pairs:
        missing = "; ".join(list_missing_views(state.pairs, pairs))
        raise LsvisionError(f"{camera} ended early; still missing: {missing}")


def _require_empty(folder: Path) -> None:
    """Raise an error for a file, and for a folder with images: the pairs would be mixed in."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UnwritableFile(f"{folder}: a file: name a folder that is new or empty")
    images = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    if images:
        raise UnwritableFile(
            f"{folder} holds images ({images[0].name}): name a folder that is new or empty"
        )


def _write_pair(pair: "Pair", number: int, boards: Path, lines: Path) -> None:
    """Write the images of a pair as PNG files with the same number, into both folders."""
    from lsvision.files.atomic_files import write_atomic
    from lsvision.io.images import encode_png

    for folder, name, image in ((boards, "board", pair.board), (lines, "line", pair.line)):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnwritableFile(
                f"{folder}: {error.strerror}: name a folder that can be created"
            ) from None
        write_atomic(folder / f"{name}_{number:02d}.png", encode_png(image))
