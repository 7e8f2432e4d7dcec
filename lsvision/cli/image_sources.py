"""Images, videos and a live camera as sources of profiles, through a light section."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lsvision.cli.sources import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from lsvision.errors import LsvisionError, NoLaserLine, UnreadableFile
from lsvision.files.file_kinds import STDIN

if TYPE_CHECKING:
    from lsvision.io.profiles import ReadOptions
    from lsvision.laser_line.line import LaserLine
    from lsvision.laser_line.settings import LineSettings
    from lsvision.profile import Profile
    from lsvision.sensors.light_section import LightSection

MIN_NOTED_SECOND_LINE_FRACTION = 0.2
"""Fraction of columns with a second line above which a note is printed."""
MIN_NOTED_SATURATED_FRACTION = 0.2
"""Fraction of saturated points of the line above which a note is printed."""
MIN_UNNOTED_WIDTH_PX = 0.4
"""Median width of a line below which a note says that it is thinner than a pixel: up to there the
correction of its sampling holds. Units: px."""
MAX_GREY_DIFFERENCE = 4
"""Largest difference of a pixel's channels in a grey video, by the rounding of its codec: 2 in
motion JPEG, 3 in MPEG-4. Units: DN of 8 bit."""


@dataclass(frozen=True, kw_only=True)
class ImageRemedies:
    """Remedies in messages on images: the options of a command, or the keys of a job.

    `rig` states the rig, with an example; `line` is for an image without a laser line, `colours`
    for one in colour without a stated laser colour, `no_colours` for a grey one with ``{laser}``
    stated.
    """

    rig: str
    line: str
    colours: str
    no_colours: str


OPTIONS = ImageRemedies(
    rig="--light-section rig.json",
    line="darken the room or subtract an image without the laser (--laser-off), expose until the "
    "line is bright, or name the colour of the laser in a colour image (--laser)",
    colours="name the laser's colour, --laser red, green, blue or white",
    no_colours="leave --laser {laser} out, or, if it is the raw image of a colour camera, name its "
    "pattern (--bayer RGGB)",
)
"""Remedies of commands with options for images."""
JOB = ImageRemedies(
    rig='light_section = "rig.json" in [rig] of the job',
    line="darken the room, expose until the line is bright, or name the colour of the laser in a "
    'colour image, laser = "red" in [rig] of the job',
    colours='name the laser\'s colour, laser = "red" in [rig] of the job, or green, blue or white',
    no_colours='leave laser = "{laser}" out of [rig] of the job',
)
"""Remedies of commands that run a job."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagingOptions:
    """Options for the conversion of images to profiles.

    `laser_off` is an image of the same view without the laser. `surface_std` is the roughness of
    the surface, one sigma, in mm; it is added to the noise of each point in both directions of the
    section. `frames` is the largest number to read from a video, all if None; images are kept for
    pictures.
    """

    light_section: "LightSection"
    line: "LineSettings"
    laser_off: Any = None
    surface_std: float = 0.0
    frames: int | None = None
    keep_images: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class ImageFile:
    """Profiles of an image or of the frames of a video; the counterpart of `ProfileFile`.

    `path` is the file, or the name of a live camera. A profile has no valid points if no line was
    found in its frame; its image is None if they are not kept. `summary` is one line.
    """

    path: Path
    profiles: "tuple[Profile, ...]"
    images: tuple[Any, ...]
    summary: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class LiveCamera:
    """Connected camera as a source.

    Parameters
    ----------
    index : int
        Index of the camera for ``cv2.VideoCapture``.
    frames : int
        Number of frames to take.
    """

    index: int
    frames: int

    def __str__(self) -> str:
        return f"camera-{self.index}"  # in the place of a file's name, also of a picture's


def is_image(source: Path) -> bool:
    """Return whether the suffix of a file is that of an image or a video."""
    return source.suffix.lower() in IMAGE_SUFFIXES or is_video(source)


def is_video(source: Path) -> bool:
    """Return whether the suffix of a file is that of a video."""
    return source.suffix.lower() in VIDEO_SUFFIXES


def holds_images(source: Path, imaging: ImagingOptions | None, reading: "ReadOptions") -> bool:
    """Return whether a file is read as images of a laser line, and not as profiles.

    Standard input holds an image if there is a rig. Without a rig, but with the spacing of columns
    in `reading`, an image is a height map, whose rows are profiles.
    """
    if str(source) == STDIN:
        return imaging is not None
    is_height_map = imaging is None and reading.get("dx") is not None
    return is_image(source) and not is_height_map


def check_colours(
    image: Any,
    laser: str,
    where: str = "it",
    bayer: str | None = None,
    remedies: ImageRemedies = OPTIONS,
) -> None:
    """Raise an error if the stated laser colour does not suit an image in colour or in grey.

    An image with three equal channels is grey, and so is a raw image with a mosaic `bayer`, which
    suits every laser colour. `laser` is "grey" if none is stated; the message begins with `where`.

    Raises
    ------
    UnreadableFile
        If red, green or blue is stated for a grey image, or no colour for a colour image.
    """
    coloured = image.ndim == 3 and bool((image != image[..., :1]).any())
    if coloured and laser == "grey":
        raise UnreadableFile(f"{where} has colours: {remedies.colours}")
    if not coloured and laser not in ("grey", "white") and bayer is None:
        raise UnreadableFile(f"{where} has no colours: {remedies.no_colours.format(laser=laser)}")


def read_image_source(
    source: Path | LiveCamera, imaging: ImagingOptions | None, remedies: ImageRemedies = OPTIONS
) -> ImageFile:
    """Return the profiles of an image, a video or a live camera.

    Raises
    ------
    LsvisionError
        Without a rig, for another size or the wrong colours, or if no frame contains a line; the
        message states the file and the remedy.
    """
    if imaging is None:
        raise UnreadableFile(
            f"{source}: an image needs the rig that took it, {remedies.rig}: make one with "
            "lsvision calibrate laser-plane"
        )
    images = _read_images(source, imaging.frames)
    if imaging.line.channel == "grey" and (isinstance(source, LiveCamera) or is_video(source)):
        images = map(_remove_rounded_colours, images)
        if imaging.laser_off is not None:  # perhaps a frame of the same video
            imaging = replace(imaging, laser_off=_remove_rounded_colours(imaging.laser_off))
    return _read_profiles(Path(str(source)), images, imaging, remedies)


def _read_images(source: Path | LiveCamera, max_frames: int | None) -> Iterable[Any]:
    """Return the image of a file, the frames of a video one by one, or those of a camera."""
    if isinstance(source, LiveCamera):
        from lsvision.io.frames import capture_frames

        return capture_frames(source.index, source.frames)
    if is_video(source):
        from lsvision.io.frames import read_frames

        return islice(read_frames(source), max_frames)
    from lsvision.io.images import read_image

    return [read_image(source)]


def _remove_rounded_colours(image: Any) -> Any:
    """Return a frame of a grey video with three equal channels; one with colours as it is."""
    import cv2
    import numpy as np

    if image.ndim == 2 or np.ptp(image, axis=2).max() > MAX_GREY_DIFFERENCE:
        return image
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)


def _read_profiles(
    source: Path, images: Iterable[Any], imaging: ImagingOptions, remedies: ImageRemedies
) -> ImageFile:
    """Return the profiles of the images of a source; see `read_image_source`.

    A frame without a line has a profile of lost points, unless no frame has a line.
    """
    measured: list[tuple[Profile, Any, LaserLine | None]] = []
    failure: NoLaserLine | None = None
    for number, image in enumerate(images):
        try:
            with _add_prefix_to_errors(
                f"{source}, frame {number}" if number else str(source), remedies
            ):
                measured.append(_measure_image(image, imaging, remedies))
        except NoLaserLine as error:
            failure = failure or error
            measured.append(
                (_build_empty_profile(imaging), image if imaging.keep_images else None, None)
            )
    lines = [line for _, _, line in measured if line is not None]
    if failure is not None and not lines:
        raise failure
    profiles, kept_images, _ = zip(*measured, strict=True)
    summary, notes = (
        _summarise_lines(lines, len(measured)),
        tuple(_list_warnings(lines, len(measured))),
    )
    return ImageFile(
        path=source, profiles=profiles, images=kept_images, summary=summary, notes=notes
    )


def extract_named_line(
    source: Path, image: Any, settings: "LineSettings", laser_off: Any
) -> "LaserLine":
    """Return the laser line of an image; errors state its file.

    Raises
    ------
    LsvisionError
        If there is no line, or a wrong colour; the message states the file and the remedy.
    """
    from lsvision.laser_line.extraction import extract_laser_line

    with _add_prefix_to_errors(str(source), OPTIONS):
        check_colours(image, settings.channel, bayer=settings.bayer)
        return extract_laser_line(image, settings, laser_off)


@contextmanager
def _add_prefix_to_errors(where: str, remedies: ImageRemedies) -> Iterator[None]:
    """Prefix errors with the name of a file, and replace remedies by those of the command."""
    try:
        yield
    except NoLaserLine as error:
        raise NoLaserLine(f"{where}: {error.finding}", error.remedy and remedies.line) from error
    except (LsvisionError, ValueError) as error:  # ValueError: a laser-off frame of another depth
        raise LsvisionError(f"{where}: {error}") from error


def _measure_image(
    image: Any, imaging: ImagingOptions, remedies: ImageRemedies
) -> "tuple[Profile, Any, LaserLine]":
    """Return profile, image (None if it is not kept) and laser line of an image."""
    check_colours(image, imaging.line.channel, bayer=imaging.line.bayer, remedies=remedies)
    line = imaging.light_section.line(image, imaging.line, imaging.laser_off)
    profile = _with_surface_noise(
        imaging.light_section.profile_from_line(line), imaging.surface_std
    )
    return profile, image if imaging.keep_images else None, line


def _with_surface_noise(profile: "Profile", surface_std: float) -> "Profile":
    """Return the profile with the roughness of the surface added to its noise."""
    if not surface_std:
        return profile
    import numpy as np

    from lsvision.profile import PointNoise, Profile

    noise = profile.noise
    if noise is None:
        return profile
    covariances = noise.covariances(profile.points) + surface_std**2 * np.eye(2)
    return Profile(profile.points, PointNoise(covariances))


def _build_empty_profile(imaging: ImagingOptions) -> "Profile":
    """Return a profile of lost points only, one per image column, for a frame without a line."""
    import numpy as np

    from lsvision.profile import Profile

    return Profile(np.full((imaging.light_section.camera.size[0], 2), np.nan))


def _summarise_lines(lines: "list[LaserLine]", frames: int) -> str:
    """Return frames, direction, lost points and median std (px) of the laser lines as text."""
    import numpy as np

    std = float(np.median(np.concatenate([line.std[~np.isnan(line.std)] for line in lines])))
    lost, total = sum(line.lost for line in lines), sum(map(len, lines))
    source = f"{frames} frames" if frames > 1 else "image"
    return f"{source}, line along {lines[0].direction}, {lost} of {total} points lost, {std:.2g} px"


def _list_warnings(lines: "list[LaserLine]", frames: int) -> "list[str]":
    """Return notes on frames without a line, a second line, saturated points and thin lines."""
    import numpy as np

    notes = []
    if len(lines) < frames:
        notes.append(f"{frames - len(lines)} of {frames} frames contain no laser line")
    second_fraction = max(line.second_line_fraction for line in lines)
    if second_fraction > MIN_NOTED_SECOND_LINE_FRACTION:
        notes.append(
            f"a second line runs through {second_fraction:.0%} of the image: lsvision line --plot "
            "shows which one is measured; --laser-off removes lines that are not the laser's"
        )
    saturated = float(np.mean([line.saturated.mean() for line in lines]))
    if saturated > MIN_NOTED_SATURATED_FRACTION:
        notes.append(f"{saturated:.0%} of the line is at full scale: shorten the exposure")
    width = min(float(np.nanmedian(line.width)) for line in lines)
    if width < MIN_UNNOTED_WIDTH_PX:
        notes.append(
            f"the line is {width:.2g} px wide (one sigma), thinner than a pixel, which leaves its "
            "place between two pixels uncertain: defocus the lens until it is 0.6 px"
        )
    return notes
