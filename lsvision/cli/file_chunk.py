"""Consecutive profiles of a file, image, video or camera, which are read and measured together."""

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
from lsvision.files.limited_reading import MAX_FILE_BYTES

if TYPE_CHECKING:
    from lsvision.batch.measure_group import MeasureFunction
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ProfileFile, ReadOptions
    from lsvision.profile import Profile
    from lsvision.sensors.profile_sensor import ProfileSensor

MAX_RANGE_RATIO = 3.0
"""Ratio of the distance of a profile to the largest range of the sensor, or of the smallest range
to this distance, above which a warning is given."""


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """Options for reading and measuring files; can be pickled for another process.

    `measure_function` has its options filled in, also the noise of `sensor`. Without `imaging`, the
    rig and the settings for converting images to profiles, an image is an error; without
    `robot_frame` cylinders stay in the section frame. `verbose` lists the rejected arcs, `debug`
    prints tracebacks; `max_size`, in bytes, is for another process, which does not inherit it.
    """

    measure_function: "MeasureFunction"
    sensor: "ProfileSensor | None" = None
    reading: "ReadOptions" = field(default_factory=dict)  # type: ignore[assignment] # no required key
    imaging: ImagingOptions | None = None
    robot_frame: RobotFrame | None = None
    verbose: bool = False
    debug: bool = False
    max_size: int = MAX_FILE_BYTES


@dataclass(frozen=True, eq=False)
class FileChunk:
    """Consecutive profiles of a file: `file` has only those of this chunk.

    `first` is the index, from 0, of the first profile of the chunk in the whole file. If the whole
    file has `several` profiles, each is printed with its number. The lines of the header, a summary
    and notes, are printed before the results. `flanges` are ``base_from_flange`` of each profile of
    the chunk, `pictures` the files into which they are drawn; None draws none.
    """

    file: "ProfileFile | ImageFile"
    first: int = 0
    several: bool = False
    header: list[str] = field(default_factory=list)
    flanges: "list[Pose] | None" = None
    pictures: list[Path] | None = None

    def __len__(self) -> int:
        return len(self.file.profiles)

    def split(self, count: int) -> "Iterator[FileChunk]":
        """Yield consecutive chunks of at most `count` profiles, of which the first has the header.

        A chunk without profiles yields itself, so that its header is printed.
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


def read_chunks(source: Path | LiveCamera, options: FileOptions) -> Iterator[FileChunk]:
    """Yield the profiles of a file in chunks, so that a large one is not in memory as a whole.

    Images, and the frames of a video or camera, are one chunk.

    Raises
    ------
    LsvisionError
        If the file cannot be read.
    """
    if is_image_source(source, options):
        yield _read_images(source, options)
        return
    # The source is a path here; converting it only tells the type checker so.
    for chunk in iterate_source(Path(str(source)), options.reading):
        several = chunk.first > 0 or len(chunk.file.profiles) > 1
        header = _build_header(options, chunk.file, chunk.first)
        yield FileChunk(chunk.file, chunk.first, several=several, header=header)


def read_whole(source: Path | LiveCamera, options: FileOptions) -> FileChunk:
    """Return all profiles of a file as one chunk; see `read_chunks`."""
    if is_image_source(source, options):
        return _read_images(source, options)
    file = read_source(Path(str(source)), options.reading)
    return FileChunk(file, several=len(file.profiles) > 1, header=_build_header(options, file))


def is_image_source(source: Path | LiveCamera, options: FileOptions) -> bool:
    """Return whether a source is a camera, or a file that is read as images."""
    return isinstance(source, LiveCamera) or holds_images(source, options.imaging, options.reading)


def _read_images(source: Path | LiveCamera, options: FileOptions) -> FileChunk:
    """Return the profiles of an image, a video or a camera as one chunk."""
    images = read_image_source(source, options.imaging)
    return FileChunk(
        images, several=len(images.profiles) > 1, header=_build_header(options, images)
    )


def _build_header(
    options: FileOptions, file: "ProfileFile | ImageFile", first: int = 0
) -> list[str]:
    """Return the lines above the results: a summary of the file or chunk, and notes."""
    valid = (profile for profile in file.profiles if profile.lost < len(profile))
    warnings = filter(None, (_find_range_warning(profile, options.sensor) for profile in valid))
    # One warning for all profiles: those of others differ only in the distance that they state.
    notes = [*file.notes, *islice(warnings, 1)]
    if options.verbose and not isinstance(file, ImageFile) and file.ignored:
        notes.append(f"columns not used: {', '.join(file.ignored)}")
    name = f"{file.path}, from profile {first} on" if first else str(file.path)
    return [f"{name}: {file.summary}", *(f"  note: {note}" for note in notes)]


def _find_range_warning(profile: "Profile", sensor: "ProfileSensor | None") -> str | None:
    """Return a warning if the profile lies far outside the sensor's range; None without a sensor.

    The profile has at least one point. The noise grows with the distance from the sensor, and is
    wrong where the distance is: for example, if heights are from the middle of the sensor's range.
    """
    if sensor is None:
        return None
    import numpy as np

    distance = float(np.nanmedian(np.hypot(*(profile.points - sensor.origin).T)))
    if sensor.min_range / MAX_RANGE_RATIO <= distance <= sensor.max_range * MAX_RANGE_RATIO:
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
