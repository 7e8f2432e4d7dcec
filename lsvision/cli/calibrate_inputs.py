"""What the options of a calibration name: images, profiles, poses, the target."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lsvision.cli.image_options import check_colours
from lsvision.cli.messages import FAILED, print_error
from lsvision.cli.sources import (
    IMAGE_SUFFIXES,
    find_sources,
    print_reading_notes,
    read_source,
    suffixes_of_profiles,
)
from lsvision.errors import LsvisionError, UnreadableFile
from lsvision.files.file_kinds import exists
from lsvision.files.limited_reading import STDIN
from lsvision.files.printable import printable

if TYPE_CHECKING:
    from lsvision.geometry import Pose
    from lsvision.io.profiles import ReadOptions
    from lsvision.profile import Profile

Report = Annotated[
    Path | None, typer.Option(metavar="F.html", help="Write a page with pictures for people.")
]


def image_files(words: Sequence[str]) -> list[Path]:
    """Images that words name, in natural order; ends the command if a word names nothing."""
    return _found(words, IMAGE_SUFFIXES)


def profile_files(words: Sequence[str], dx: float | None) -> list[Path]:
    """Profile files that words name, with ``--dx`` height maps as well; see `image_files`."""
    return _found(words, suffixes_of_profiles(dx))


def read_images(paths: Sequence[Path]) -> list[Any]:
    """The images of files, in their order.

    Raises
    ------
    UnreadableFile
        Names the file and the mend.
    """
    from lsvision.io.images import read_image

    return [read_image(path) for path in paths]


def read_line_images(paths: Sequence[Path], laser: str) -> list[Any]:
    """Images of a laser line, checked for the laser's colour.

    Raises
    ------
    UnreadableFile
        If an image has colours and `laser` is none, or the other way round.
    """
    images = read_images(paths)
    for path, image in zip(paths, images, strict=True):
        check_colours(image, laser, str(path))
    return images


def read_named_profiles(
    paths: Sequence[Path], options: "ReadOptions"
) -> "tuple[list[Profile], list[str]]":
    """Profiles of all files in their order, one a pose, and a name for each.

    Raises
    ------
    UnreadableFile
        Names the file and the mend.
    """
    profiles: list[Profile] = []
    names: list[str] = []
    files = [read_source(path, options) for path in paths]
    print_reading_notes(files)
    for path, file in zip(paths, files, strict=True):
        several = len(file.profiles) > 1
        profiles += file.profiles
        names += [
            printable(f"{path.name} profile {number}" if several else path.name)
            for number in range(len(file.profiles))
        ]
    return profiles, names


def read_flanges(path: Path, convention: str, names: Sequence[str]) -> "list[Pose]":
    """Poses of the flange, one for each sighting.

    Raises
    ------
    typer.BadParameter
        For an unknown convention.
    UnreadableFile
        If the file cannot be read, or holds another number of poses than there are sightings.
    """
    from lsvision.io.robot_conventions import CONVENTIONS
    from lsvision.io.robot_poses import read_robot_poses

    if convention not in CONVENTIONS:
        raise typer.BadParameter(
            f"want --convention {', '.join(CONVENTIONS)}, got {convention!r}: the same numbers "
            "mean another pose in each"
        )
    flanges = read_robot_poses(path, convention)
    if len(flanges) != len(names):
        raise UnreadableFile(
            f"{path}: want one pose for each of {len(names)} sightings ({names[0]} to "
            f"{names[-1]}), got {len(flanges)} poses: leave out what has no partner"
        )
    return flanges


@contextmanager
def prefix_file_names(**names: Sequence[str]) -> Iterator[None]:
    """Put file names beside the numbers in a refusal.

    Parameters
    ----------
    **names : sequence of str
        What ``image 3`` (`image`), ``board image 3`` (`board_image`) or ``pose 3`` (`pose`)
        is called by the user.

    Raises
    ------
    LsvisionError
        With the names.
    """
    try:
        yield
    except LsvisionError as error:
        raise LsvisionError(replace_image_numbers(str(error), **names)) from error


def replace_image_numbers(text: str, **names: Sequence[str]) -> str:
    """A message in which ``image 3`` is followed by the file's name.

    Examples
    --------
    >>> replace_image_numbers("image 1 is blurred", image=["a.png", "b.png"])
    'image 1 (b.png) is blurred'
    """
    for kind, every in sorted(names.items(), key=lambda item: -len(item[0])):
        words = kind.replace("_", " ")
        before = r"(?<!board )(?<!line )" if words == "image" else ""

        def told(found: re.Match[str], every: Sequence[str] = every) -> str:
            number = int(found[1])
            return f"{found[0]} ({every[number]})" if number < len(every) else found[0]

        text = re.sub(rf"{before}\b{words} (\d+)\b", told, text)
    return text


def _found(words: Sequence[str], suffixes: frozenset[str]) -> list[Path]:
    files, missing = find_sources(words, suffixes)
    if any(str(file) == STDIN for file in files):
        raise typer.BadParameter("want files, got - for standard input: they are read twice")
    missing += [
        UnreadableFile(f"{file}: no such file: check the name")
        for file in files
        if not exists(file)
    ]
    for failure in missing:
        print_error(str(failure))
    if missing:
        raise typer.Exit(FAILED)
    return files
