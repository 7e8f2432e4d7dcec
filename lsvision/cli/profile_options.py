"""Options of the commands that measure profiles: radii, noise, and how files are read."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lsvision.io.profiles import ReadOptions
    from lsvision.sensors.profile_sensor import ProfileSensor

READERS = (
    "text, matrix, gocator, gocator-points, keyence, keyence-raw, npy, npz, ply, pcd, opencv, "
    "parquet, json, yaml, laserscan, height-map, rosbag"
)
"""Values of --format, for its help; `lsvision.io.profiles.settings.FORMATS`, whose import would
import numpy. A test compares both."""
DEFAULT_REFERENCE_MM = 400.0
"""Default of --reference-range: the middle of the range of the paper's sensor."""

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
        help="Radius known beforehand, exactly or with one sigma; reduces the uncertainty of phi "
        "and theta.",
    ),
]
KnownPhi = Annotated[
    str | None,
    typer.Option(
        metavar="DEG|DEG:SIGMA",
        help="Tilt known beforehand, e.g. 0 for a section perpendicular to the axis; reduces the "
        "uncertainty of the radius.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="F", help="Write all results as JSON; - is standard output."),
]
CsvFile = Annotated[
    Path | None,
    typer.Option(
        "--csv", metavar="F", help="Write one cylinder per row as CSV; - is standard output."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Number of processes [1; from 2 MB on the number of cores]."
    ),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Also list what was rejected, and why.")
]


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Options for the noise of the points: that of a known sensor, or one sigma at a range."""

    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="lps36hi|lps36",
            help="Use the noise of this sensor; else it is estimated from the profile.",
        ),
    ] = None
    range_std: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Noise of another sensor: one sigma along the ray..."),
    ] = None
    reference_range: Annotated[
        float | None,
        typer.Option(metavar="MM", help="...at this range, growing with range squared [400]."),
    ] = None

    def parse(self) -> "ProfileSensor | None":
        """Return the sensor that the options name or describe; None without any.

        Raises
        ------
        typer.BadParameter
            For an unknown sensor, a sensor and a noise at once, a range without a noise, or a
            length that is not positive.
        """
        if self.sensor is not None and self.range_std is not None:
            raise typer.BadParameter("expected --sensor or --range-std, got both")
        if self.reference_range is not None and self.range_std is None:
            raise typer.BadParameter("expected --range-std with --reference-range, got none")
        try:
            if self.sensor is not None:
                from lsvision.sensors.profile_sensor import find_sensor

                return find_sensor(self.sensor)
            if self.range_std is not None:
                from lsvision.sensors.profile_sensor import ProfileSensor

                given = self.reference_range
                reference = DEFAULT_REFERENCE_MM if given is None else given
                return ProfileSensor(
                    range_std=self.range_std,
                    reference_range=reference,
                    # For the warning of points far outside of them; they change no result.
                    min_range=reference / 2,
                    max_range=2 * reference,
                )
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        return None


@dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """Options for reading profile files: format, columns, units and lost points."""

    file_format: Annotated[
        str | None,
        typer.Option(
            "--format", metavar="NAME", help=f"Reader; else detected from the content: {READERS}."
        ),
    ] = None
    columns: Annotated[
        str | None, typer.Option(metavar="X,Z", help="Columns of x and height: from 0, or by name.")
    ] = None
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help="Unit of the coordinates: nm um mm cm dm m km mil in ft, or scaled: 0.1mm.",
        ),
    ] = None
    flip: Annotated[
        bool | None,
        typer.Option("--flip/--no-flip", help="Heights grow away from the sensor, or towards it."),
    ] = None
    lost: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE|none",
            help="Height of a lost point, e.g. -9999 or ERR; else guessed from values far from "
            "the rest.",
        ),
    ] = None
    transpose: Annotated[
        bool,
        typer.Option("--transpose", help="Transpose the matrix: each column is a profile."),
    ] = False
    x0: Annotated[
        float | None,
        typer.Option("--x0", metavar="MM", help="Rows of heights: x of the first column."),
    ] = None
    dx: Annotated[
        float | None,
        typer.Option("--dx", metavar="MM", help="Rows or one column of heights: spacing."),
    ] = None
    z_unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT|N",
            help="Size of one count of heights, e.g. 0.5um; Keyence's ZUnit in 0.01 um.",
        ),
    ] = None
    x_start: Annotated[
        float | None, typer.Option(metavar="N", help="Raw Keyence data: XStart, in 0.01 um.")
    ] = None
    x_pitch: Annotated[
        float | None, typer.Option(metavar="N", help="Raw Keyence data: XPitch, in 0.01 um.")
    ] = None
    topic: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Topic of a ROS bag, e.g. /scan, if several contain profiles."
        ),
    ] = None
    plane: Annotated[
        str | None,
        typer.Option(
            metavar="fit",
            help="Points are x, y, z in a tilted plane, as in a camera's frame: a plane is fitted "
            "to them.",
        ),
    ] = None

    def parse(self) -> "ReadOptions":
        """Return the arguments of `read_profiles`, checked before any file is opened.

        Raises
        ------
        typer.BadParameter
            For a value that `ReadSettings` rejects.
        """
        if self == ReadingOptions():
            return {}  # without importing numpy and the readers
        from lsvision.io.profiles import ReadOptions, ReadSettings

        options = ReadOptions(
            format=self.file_format, columns=self.columns, units=self.units, flip=self.flip,
            lost=self.lost, transpose=self.transpose, x0=self.x0, dx=self.dx, z_unit=self.z_unit,
            x_start=self.x_start, x_pitch=self.x_pitch, topic=self.topic, plane=self.plane,
        )  # fmt: skip
        try:
            ReadSettings(**options)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        return options
