"""Consecutive profiles of a file, image, video or camera, as they are measured together."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from lsvision.cli.image_sources import (
    ImageFile,
    ImagingOptions,
    LiveCamera,
    holds_images,
    read_image_source,
)
from lsvision.cli.robot_frame import RobotFrame
from lsvision.cli.sources import iterate_source, read_source
from lsvision.files.limited_reading import MAX_SIZE

if TYPE_CHECKING:
    from lsvision.batch.measure_group import MeasureFunction
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.profile import Profile
    from lsvision.sensors.profile_sensor import ProfileSensor

RANGE_WARNING_FACTOR = 3.0
"""Factor beyond the limits of a sensor's range from which a warning is given."""


@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """Options for reading and measuring files; can be pickled for another process.

    Parameters
    ----------
    measuring : MeasureFunction
        Function that measures profiles, with its options filled in.
    sensor : ProfileSensor, optional
        Sensor whose noise `measuring` uses.
    reading : ReadOptions
        Options of reading profile files.
    imaging : ImagingOptions, optional
        Rig and settings for converting images to profiles; without them an image is an error.
    placing : RobotFrame, optional
        Transformation of cylinders to the robot's frame; None leaves them in the section frame.
    verbose : bool
        Whether to list the rejected arcs, too.
    debug : bool
        Whether to print the tracebacks of exceptions.
    max_size : int
        Largest size of a file, for another process, which does not inherit it. Units: bytes.
    """

    measuring: "MeasureFunction"
    sensor: "ProfileSensor | None" = None
    reading: "ReadOptions" = field(default_factory=dict)  # type: ignore[assignment] # no required key
    imaging: ImagingOptions | None = None
    placing: RobotFrame | None = None
    verbose: bool = False
    debug: bool = False
    max_size: int = MAX_SIZE


@dataclass(frozen=True, eq=False)
class FilePart:
    """Consecutive profiles of a file.

    Parameters
    ----------
    file : ProfileFile or ImageFile
        The file, with the profiles of this part only.
    first : int
        Index of this part's first profile in the whole file, from 0.
    several : bool
        Whether the whole file has several profiles, so that each is printed with its number.
    header : list of str
        Summary of the file, or of a part of a large one, and notes; printed before the results.
    flanges : list of Pose, optional
        ``base_from_flange`` of each profile.
    pictures : list of Path, optional
        File of each profile's picture; None draws none.
    """

    file: "ProfileFile | ImageFile"
    first: int = 0
    several: bool = False
    header: list[str] = field(default_factory=list)
    flanges: "list[Pose] | None" = None
    pictures: list[Path] | None = None

    def __len__(self) -> int:
        return len(self.file.profiles)

    def slices(self, count: int) -> "Iterator[FilePart]":
        """Yield consecutive smaller parts of at most `count` profiles; a part without any as it is.

        The first has the header.
        """
        for start in range(0, max(len(self), 1), count):
            indices = slice(start, start + count)
            yield replace(
                self,
                file=_select_profiles(self.file, indices),
                first=self.first + start,
                header=[] if start else self.header,
                flanges=self.flanges and self.flanges[indices],
                pictures=self.pictures and self.pictures[indices],
            )


def read_parts(source: Path | LiveCamera, options: PartOptions) -> Iterator[FilePart]:
    """Yield the profiles of a file in parts, so that a large one is not in memory as a whole.

    Images, and the frames of a video or camera, are one part.

    Raises
    ------
    LsvisionError
        If the file cannot be read.
    """
    if is_image_source(source, options):
        yield _read_images(source, options)
        return
    # `str` and `Path` change nothing: only the type says that it may be a camera.
    for part in iterate_source(Path(str(source)), options.reading):
        several = part.first > 0 or len(part.file.profiles) > 1
        header = _header(options, part.file, part.first)
        yield FilePart(part.file, part.first, several=several, header=header)


def read_whole(source: Path | LiveCamera, options: PartOptions) -> FilePart:
    """Return all profiles of a file as one part; see `read_parts`."""
    if is_image_source(source, options):
        return _read_images(source, options)
    file = read_source(Path(str(source)), options.reading)
    return FilePart(file, several=len(file.profiles) > 1, header=_header(options, file))


def is_image_source(source: Path | LiveCamera, options: PartOptions) -> bool:
    """Return whether a source is a camera, or a file that is read as images."""
    return isinstance(source, LiveCamera) or holds_images(source, options.imaging, options.reading)


def _read_images(source: Path | LiveCamera, options: PartOptions) -> FilePart:
    """Return the profiles of an image, a video or a camera as one part."""
    images = read_image_source(source, options.imaging)
    return FilePart(images, several=len(images.profiles) > 1, header=_header(options, images))


def _header(options: PartOptions, file: "ProfileFile | ImageFile", first: int = 0) -> list[str]:
    """Return the lines above the results: a summary of the file or part, and notes."""
    valid = (profile for profile in file.profiles if profile.lost < len(profile))
    warnings = filter(None, (_range_warning(profile, options.sensor) for profile in valid))
    notes = [*file.notes, *islice(warnings, 1)]  # the distance differs from profile to profile
    if options.verbose and not isinstance(file, ImageFile) and file.ignored:
        notes.append(f"columns not used: {', '.join(file.ignored)}")
    name = f"{file.path}, from profile {first} on" if first else str(file.path)
    return [f"{name}: {file.summary}", *(f"  note: {note}" for note in notes)]


def _range_warning(profile: "Profile", sensor: "ProfileSensor | None") -> str | None:
    """Return a warning if the profile lies far outside the range of the sensor; else None.

    The noise grows with the distance from the sensor; it is wrong if heights are not measured from
    the sensor, but from the middle of its range, for example.

    Parameters
    ----------
    profile : Profile
        Profile with at least one point.
    sensor : ProfileSensor, optional
        Sensor with its range; None gives no warning.
    """
    if sensor is None:
        return None
    import numpy as np

    distance = float(np.nanmedian(np.hypot(*(profile.points - sensor.origin).T)))
    if (
        sensor.min_range / RANGE_WARNING_FACTOR
        <= distance
        <= sensor.max_range * RANGE_WARNING_FACTOR
    ):
        return None
    return (
        f"the points lie {distance:.0f} mm from the sensor's origin, and its noise is stated for "
        f"{sensor.min_range:g} to {sensor.max_range:g} mm: check this range, and that heights "
        "start at the sensor"
    )


def _select_profiles(file: "ProfileFile | ImageFile", indices: slice) -> "ProfileFile | ImageFile":
    """Return a file with the profiles at some indices only."""
    if isinstance(file, ImageFile):
        return replace(file, profiles=file.profiles[indices], images=file.images[indices])
    return replace(file, profiles=file.profiles[indices], attributes=file.attributes[indices])
