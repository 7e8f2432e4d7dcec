"""Options of the commands that measure profiles: what is looked for, its noise, the files."""

from pathlib import Path
from typing import Annotated

import typer

READERS = (
    "text, matrix, gocator, gocator-points, keyence, keyence-raw, npy, npz, ply, pcd, opencv, "
    "parquet, json, yaml, laserscan, height-map, rosbag"
)
"""Written out, because the reader's own list comes with numpy; a test compares the two."""

Radius = Annotated[
    str | None,
    typer.Option(
        metavar="MM|MM:MM", help="Search range of the radius, or its nominal value (+/- 20 %)."
    ),
]
KnownRadius = Annotated[
    str | None,
    typer.Option(
        metavar="MM|MM:SIGMA",
        help="Radius known beforehand, exactly or with one sigma; sharpens phi and theta.",
    ),
]
SensorName = Annotated[
    str | None,
    typer.Option(
        metavar="lps36hi|lps36", help="Noise of this sensor; else estimated from the profile."
    ),
]
RangeStd = Annotated[
    float | None,
    typer.Option(metavar="MM", help="Noise of another sensor: one sigma along the ray..."),
]
ReferenceRange = Annotated[
    float | None,
    typer.Option(metavar="MM", help="...at this range, growing with range squared [400]."),
]
PoseFile = Annotated[
    Path | None,
    typer.Option("--poses", metavar="F", help="Poses of the robot's flange, one a profile."),
]
Convention = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Of the poses, never guessed: ur, kuka, fanuc, abb, ros, matrix, ..."
    ),
]
HandEyeFile = Annotated[
    Path | None,
    typer.Option(
        "--flange-from-section",
        metavar="F",
        help="Hand-eye file, its errors carried through; else the poses are the section's own.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="F", help="Write all results as JSON; - is standard output."),
]
FileFormat = Annotated[
    str | None,
    typer.Option(
        "--format", metavar="NAME", help=f"Reader; else detected from the content: {READERS}."
    ),
]
Columns = Annotated[
    str | None, typer.Option(metavar="X,Z", help="Columns of x and height: from 0, or by name.")
]
Units = Annotated[
    str | None,
    typer.Option(
        metavar="UNIT", help="Of coordinates: nm um mm cm dm m km mil in ft, or scaled: 0.1mm."
    ),
]
Lost = Annotated[
    str | None,
    typer.Option(
        metavar="VALUE|none",
        help="What marks a lost point, as -9999 or ERR; else told from values far from the rest.",
    ),
]
Transpose = Annotated[
    bool, typer.Option("--transpose", help="Rows and columns change places: profiles in columns.")
]
FirstX = Annotated[
    float | None,
    typer.Option("--x0", metavar="MM", help="Rows of heights: x of the first column."),
]
Spacing = Annotated[
    float | None,
    typer.Option("--dx", metavar="MM", help="Rows of heights: spacing of the columns."),
]
CountUnit = Annotated[
    str | None,
    typer.Option(
        metavar="UNIT|N",
        help="Rows of heights: what one count is, as 0.5um; Keyence's ZUnit in 0.01 um.",
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Of a ROS bag, where several hold profiles, as /scan."),
]
Flip = Annotated[
    bool | None,
    typer.Option("--flip/--no-flip", help="Heights grow away from the sensor, or towards it."),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Also say what was refused, and why.")
]
