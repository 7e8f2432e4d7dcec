"""Options of the commands that extract a laser line from images."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from lsvision.cli.image_sources import ImagingOptions
from lsvision.errors import UnreadableFile

if TYPE_CHECKING:
    from lsvision.io.profiles import ReadOptions
    from lsvision.laser_line.settings import LineSettings

LightSectionFile = Annotated[
    Path | None,
    typer.Option(
        "--light-section",
        metavar="RIG.json",
        help="For images: rig file (camera and laser plane), from lsvision calibrate laser-plane.",
    ),
]
Laser = Annotated[
    str,
    typer.Option(
        "--laser",
        metavar="COLOUR",
        help="Laser colour in colour images: red, green, blue, white; else grey.",
    ),
]
BayerPattern = Annotated[
    str | None,
    typer.Option(
        "--bayer",
        metavar="PATTERN",
        help="Images of a colour camera, raw or interpolated: RGGB, BGGR, GRBG or GBRG; only the "
        "pixels of the laser's colour are used.",
    ),
]
Method = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Method for images: derivative, gaussian (overexposed lines), steger (lines of any "
        "direction).",
    ),
]
LaserOff = Annotated[
    Path | None,
    typer.Option(
        metavar="IMAGE", help="Image of the same view without the laser, which is subtracted."
    ),
]


def parse_line_settings(laser: str, method: str, bayer: str | None = None) -> "LineSettings":
    """Return the settings of the line extraction.

    Raises
    ------
    typer.BadParameter
        For an unknown colour, method or pattern.
    """
    from lsvision.laser_line.settings import LineSettings

    try:
        pattern = cast("Any", bayer and bayer.upper())
        return LineSettings(channel=cast("Any", laser), method=cast("Any", method), bayer=pattern)
    except ValueError as error:
        message = str(error)
        for field, option in (("channel", "--laser"), ("method", "--method"), ("bayer", "--bayer")):
            message = message.replace(field, option)
        raise typer.BadParameter(message) from None


def parse_imaging(
    light_section: Path | None,
    laser: str,
    method: str = "derivative",
    bayer: str | None = None,
    laser_off: Path | None = None,
    **other_options: Any,
) -> ImagingOptions | None:
    """Return the options for converting images to profiles; None without a rig.

    For `laser`, `method` and `bayer` see `LineSettings`; `other_options` are further fields of
    `ImagingOptions`.

    Raises
    ------
    LsvisionError
        If the rig or the laser-off frame cannot be used; the message states the file.
    typer.BadParameter
        If an option of images is given without a rig, or its value is unknown.
    """
    if light_section is None:
        _reject_image_options(laser, method, bayer, laser_off, other_options)
        return None
    from lsvision.sensors.light_section import LightSection

    line = parse_line_settings(laser, method, bayer)
    rig = LightSection.load(light_section)
    laser_off_image = read_laser_off(laser_off, rig.camera.size)
    return ImagingOptions(light_section=rig, line=line, laser_off=laser_off_image, **other_options)


def reject_reading_of_images(reading: "ReadOptions", are_images: Sequence[bool]) -> None:
    """Raise an error for options for reading profiles if there are files, and all are images."""
    if reading and are_images and all(are_images):
        raise typer.BadParameter(
            "expected profiles with options for reading them, such as --units, got images only"
        )


def _reject_image_options(
    laser: str,
    method: str,
    bayer: str | None,
    laser_off: Path | None,
    other_options: Mapping[str, Any],
) -> None:
    """Raise an error for options of images without a rig: they would have no effect."""
    is_given = {
        "--laser": laser != "grey",
        "--bayer": bayer,
        "--method": method != "derivative",
        "--laser-off": laser_off,
        "--surface-std": other_options.get("surface_std"),
        "--frames": other_options.get("frames"),
    }
    names = [name for name, value in is_given.items() if value]
    if names:
        raise typer.BadParameter(
            f"expected --light-section RIG.json with {', '.join(names)}, got none: images need the "
            "rig that took them (lsvision calibrate laser-plane makes one), profiles have no image"
        )


def read_laser_off(path: Path | None, size: tuple[int, int]) -> Any:
    """Return the image without the laser, of width and height `size` in px; None without a path.

    Raises
    ------
    UnreadableFile
        If it is not an image, or of another size.
    """
    if path is None:
        return None
    from lsvision.io.images import read_image

    image = read_image(path)
    height, width = image.shape[:2]
    if (width, height) != tuple(size):
        raise UnreadableFile(
            f"{path}: the laser-off frame is {width} x {height} px, expected {size[0]} x "
            f"{size[1]} px: take it with the camera and the settings of the image"
        )
    return image
