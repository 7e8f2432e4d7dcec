"""``lsvision line``: the laser line of an image, to see whether the right one is found."""

from pathlib import Path
from typing import Annotated

import typer

from lsvision.cli.image_options import (
    BayerPattern,
    Laser,
    LaserOff,
    Method,
    parse_line_settings,
    read_laser_off,
)
from lsvision.cli.messages import print_lines
from lsvision.cli.outputs import check_outputs, check_picture, write_output
from lsvision.files.file_kinds import STDOUT
from lsvision.files.printable import escape_text


def line(
    image_file: Annotated[Path, typer.Argument(metavar="IMAGE", help="Image of a laser line.")],
    plot: Annotated[
        Path | None,
        typer.Option(metavar="F.png|F.svg", help="Draw the line on the image, with its std."),
    ] = None,
    csv_file: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            metavar="F",
            help="Write u, v, std, width and more, one point per row; - is standard output.",
        ),
    ] = None,
    laser: Laser = "grey",
    bayer: BayerPattern = None,
    method: Method = "derivative",
    laser_off: LaserOff = None,
) -> None:
    """Extract the laser line of an image to a fraction of a pixel, one point per column or row.

    A check before calibration or measurement: whether the laser's line was found, whether it is
    saturated (then shorten the exposure), and whether its std is small. Needs no rig.

    \b
    See the line of an image:
      lsvision line fixtures/images/clutter.png --plot line.png
    Its points, from an overexposed line of a red laser in a colour image:
      lsvision line photo.jpg --laser red --method gaussian --csv line.csv
    """  # noqa: D301 - the backspace makes click keep the line breaks
    check_picture(plot)
    settings = parse_line_settings(laser, method, bayer)
    inputs = [image_file, *filter(None, [laser_off])]
    check_outputs((plot,), inputs, streams=(csv_file,))
    from lsvision.cli.image_sources import extract_named_line
    from lsvision.draw import draw_laser_line, summarise_line
    from lsvision.draw.figures import write_figure
    from lsvision.io.images import read_image
    from lsvision.io.laser_lines import format_line_csv

    image = read_image(image_file)
    height, width = image.shape[:2]
    laser_line = extract_named_line(
        image_file, image, settings, read_laser_off(laser_off, (width, height))
    )
    if csv_file is not None:
        write_output(csv_file, format_line_csv(laser_line))
    print_lines([f"{image_file}: {summarise_line(laser_line)}"], err=csv_file == STDOUT)
    if plot is not None:
        write_figure(plot, draw_laser_line(image, laser_line, title=escape_text(str(image_file))))
