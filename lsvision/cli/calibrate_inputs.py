"""Input files of calibrations, their names in messages, and printed values and warnings."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from lsvision.calibration.result_tables import Row, format_rejections
from lsvision.cli.image_options import BayerPattern, Laser, parse_line_settings
from lsvision.cli.image_sources import check_colours
from lsvision.cli.messages import end_on_failures
from lsvision.cli.sources import (
    IMAGE_SUFFIXES,
    find_sources,
    list_suffixes_of_profiles,
    name_profiles,
    read_sources,
)
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import STDIN, exists
from lsvision.files.printable import escape_text
from lsvision.results.tables import format_text_table

if TYPE_CHECKING:
    from lsvision.calibration.intrinsics import CameraCalibration
    from lsvision.calibration.laser_line_on_board import LineOnBoardSettings
    from lsvision.calibration.laser_plane_result import LaserPlaneCalibration
    from lsvision.io.profiles import ReadOptions
    from lsvision.laser_line.line_image import Bayer
    from lsvision.profile import Profile

Report = Annotated[
    Path | None, typer.Option(metavar="F.html", help="Write an HTML page with pictures.")
]


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """Options of the laser line on a board: its colour, and where it is searched."""

    laser: Laser = "grey"
    bayer: BayerPattern = None
    margin: Annotated[
        float,
        typer.Option(
            min=0,
            max=20,  # a wider border may reach the horizon of a tilted board's plane
            metavar="SQUARES",
            help="Width of the flat white border around the board's pattern.",
        ),
    ] = 0.9

    @property
    def pattern(self) -> "Bayer | None":
        """Colours of the sensor's mosaic in the notation of the library."""
        return cast("Bayer | None", self.bayer and self.bayer.upper())

    def read(self, paths: Sequence[Path]) -> list[Any]:
        """Return images of the laser line.

        Raises
        ------
        UnreadableFile
            If the colours of an image contradict those of the options.
        """
        images = read_images(paths)
        for path, image in zip(paths, images, strict=True):
            check_colours(image, self.laser, str(path), self.bayer)
        return images

    def parse(self) -> "LineOnBoardSettings":
        """Return the settings of the detection.

        Raises
        ------
        typer.BadParameter
            For an unknown colour or pattern.
        """
        from lsvision.calibration.laser_line_on_board import LineOnBoardSettings

        extraction = parse_line_settings(self.laser, "derivative", self.bayer)
        return LineOnBoardSettings(extraction=extraction, margin=self.margin)


def find_image_files(names: Sequence[str]) -> list[Path]:
    """Return the image files of names, folders and patterns; print and exit if one has none."""
    return _find(names, IMAGE_SUFFIXES)


def find_profile_files(names: Sequence[str], dx: float | None) -> list[Path]:
    """Return the profile files, as `find_image_files` does; with ``--dx`` also height maps."""
    return _find(names, list_suffixes_of_profiles(dx))


def read_images(paths: Sequence[Path]) -> list[Any]:
    """Return the images of files in their order; an error states the file and the remedy."""
    from lsvision.io.images import read_image

    return [read_image(path) for path in paths]


def read_named_profiles(
    paths: Sequence[Path], options: "ReadOptions"
) -> "tuple[list[Profile], list[str]]":
    """Return the profiles of all files in their order, and a name for each."""
    files = read_sources(paths, options)
    profiles = [profile for file in files for profile in file.profiles]
    names = [name for file in files for name in name_profiles(file, escape_text(file.path.name))]
    return profiles, names


@contextmanager
def add_file_names_to_errors(**names: Sequence[str]) -> Iterator[None]:
    """Add file names to the numbers of images and poses in the message of a `LsvisionError`.

    Parameters
    ----------
    **names : sequence of str
        File names by number: `image` for ``image 3``, `board_image` for ``board image 3``,
        `line_image` for ``line image 3``, and `pose` for ``pose 3``.

    Raises
    ------
    LsvisionError
        The error of the ``with`` block, with the names in its message.
    """
    try:
        yield
    except LsvisionError as error:
        raise LsvisionError(add_file_names(str(error), **names)) from error


def add_file_names(text: str, **names: Sequence[str]) -> str:
    """Return a message with the name of its file after each ``image 3`` or ``pose 3``.

    Examples
    --------
    >>> add_file_names("image 1 is blurred", image=["a.png", "b.png"])
    'image 1 (b.png) is blurred'
    """

    def add_name(match: re.Match[str]) -> str:
        file_names = names.get(match[1].replace(" ", "_"), ())
        number = int(match[2])
        return f"{match[0]} ({file_names[number]})" if number < len(file_names) else match[0]

    return re.sub(r"\b((?:board |line )?image|pose) (\d+)\b", add_name, text)


def _find(names: Sequence[str], suffixes: frozenset[str]) -> list[Path]:
    """Return the files of names, folders and patterns, each folder's in natural order.

    Files that are missing are printed as errors, and end the command.
    """
    files, missing = find_sources(names, suffixes)
    if any(str(file) == STDIN for file in files):
        raise typer.BadParameter("expected files, which are read twice, got - for standard input")
    missing += [
        UnreadableFile(f"{file}: no such file: check the name")
        for file in files
        if not exists(file)
    ]
    end_on_failures(missing)
    return files


def format_value_lines(rows: Sequence[Row]) -> list[str]:
    """Return names and values as lines, with the unit after each value."""
    return format_text_table([(name, f"{value} {unit}") for name, value, unit in rows], left=2)


def format_warning_lines(
    names: Sequence[str], calibration: "CameraCalibration | LaserPlaneCalibration"
) -> list[str]:
    """Return lines on rejected views, outliers and warnings, with the names of the images."""
    lines = format_rejections(calibration.rejected, calibration.outliers, calibration.warnings)
    return [add_file_names(line, image=names) for line in lines]
