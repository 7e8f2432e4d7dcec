"""Read profile files of any known format as profiles in the section frame."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import read_bytes
from lsvision.geometry import FloatArray, Pose
from lsvision.io.file_names import PROFILE_SUFFIXES, find_files
from lsvision.io.profiles.detection import detect_format
from lsvision.io.profiles.fitted_plane import fit_section_plane
from lsvision.io.profiles.gocator import read_gocator, read_gocator_points
from lsvision.io.profiles.json_points import read_json
from lsvision.io.profiles.laser_scan import read_laser_scan
from lsvision.io.profiles.lost_points import (
    AllPointsLost,
    LostMarker,
    note_repeated,
    remove_lost,
)
from lsvision.io.profiles.matrix import read_height_map, read_matrix
from lsvision.io.profiles.numpy_arrays import read_npy, read_npz
from lsvision.io.profiles.opencv_storage import read_opencv_storage
from lsvision.io.profiles.parquet import read_parquet
from lsvision.io.profiles.plain_text import read_keyence, read_keyence_raw, read_plain_text
from lsvision.io.profiles.plausibility import (
    find_extent,
    find_other_problems,
    find_unit_warnings,
    reject_wrapped_numbers,
)
from lsvision.io.profiles.point_clouds import read_pcd, read_ply
from lsvision.io.profiles.ros_bags import read_ros_bag
from lsvision.io.profiles.settings import RawProfiles, ReadOptions, ReadSettings
from lsvision.io.profiles.units import find_mm_per_unit
from lsvision.io.profiles.yaml_points import read_yaml
from lsvision.profile import Profile

_READERS: dict[str, Callable[[bytes, ReadSettings], RawProfiles]] = {
    "text": read_plain_text,
    "matrix": read_matrix,
    "gocator": read_gocator,
    "gocator-points": read_gocator_points,
    "keyence": read_keyence,
    "keyence-raw": read_keyence_raw,
    "npy": read_npy,
    "npz": read_npz,
    "ply": read_ply,
    "pcd": read_pcd,
    "opencv": read_opencv_storage,
    "parquet": read_parquet,
    "json": read_json,
    "yaml": read_yaml,
    "laserscan": read_laser_scan,
    "height-map": read_height_map,
    "rosbag": read_ros_bag,
}
"""Function that reads the content of a file, by the name of its format."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ProfileFile:
    """Profiles of a file, and how they were read.

    Parameters
    ----------
    path : Path
        The file.
    profiles : tuple of Profile
        Profiles in the order of the file, including those without a valid point.
    reader : str
        The format it was read as, one of `FORMATS`.
    units : str
        Unit of its coordinates: ``"mm"``, or ``"mm, um"`` where x and height differ.
    units_assumed : bool
        Whether neither the file nor the caller states the unit of x or that of height: it is then
        assumed to be that of the other, or mm.
    flipped : bool
        Whether the heights of the file grow away from the sensor, so that their sign was changed.
    positions : tuple of float, optional
        Position of each profile along the travel. Units: mm.
    notes : tuple of str
        Remarks on what was guessed, left out or looks wrong.
    unit_warnings : tuple of str
        Those of `notes` that suggest another unit.
    markers : tuple of LostMarker
        Values that mark lost points, in the units of the file.
    attributes : tuple of mapping
        Data of the file on each profile other than its points: part, time, encoder, pose; empty
        if it has none.
    ignored : tuple of str
        Columns that were not used.
    file_from_section : Pose, optional
        The section frame in the frame of the file's points, where their plane was fitted; its Z is
        the plane's normal. Units: mm.
    """

    path: Path
    profiles: tuple[Profile, ...]
    reader: str
    units: str
    units_assumed: bool
    flipped: bool
    positions: tuple[float, ...] | None
    notes: tuple[str, ...]
    unit_warnings: tuple[str, ...] = ()
    markers: tuple[LostMarker, ...] = ()
    attributes: tuple[Mapping[str, float | str], ...] = ()
    ignored: tuple[str, ...] = ()
    file_from_section: Pose | None = None

    @property
    def lost(self) -> int:
        """Number of lost points in all profiles."""
        return sum(profile.lost for profile in self.profiles)

    @property
    def summary(self) -> str:
        """Summary in one line: reader, units, number of profiles, lost points, direction.

        Definition: as ``"text, mm (assumed), 1 profile, 3 of 376 points lost"``, followed by ``"(3
        by -9999)"`` if a value marks them.
        """
        units = f"{self.units} (assumed)" if self.units_assumed else self.units
        count = len(self.profiles)
        total = sum(len(profile) for profile in self.profiles)
        parts = [self.reader, units, f"{count} profile{'s' if count > 1 else ''}"]
        marked = ", ".join(f"{m.count} by {m.text}" for m in self.markers)
        parts.append(f"{self.lost} of {total} points lost{marked and f' ({marked})'}")
        if self.flipped:
            parts.append("heights turned")
        return ", ".join(parts)


def read_profile(path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> Profile:
    r"""Read the one profile of a file.

    Parameters
    ----------
    path : path
        The file, a named pipe, or ``"-"`` for standard input; its format is detected from its
        content.
    **options
        Fields of `ReadSettings`, each of which overrides what the file states.

    Returns
    -------
    Profile
        Section frame, Y towards the sensor. Units: mm.

    Raises
    ------
    UnreadableFile
        If the file cannot be read, holds less than two valid points, or holds several profiles.
    ValueError, TypeError
        If an option is invalid, or `path` is not the name of a file.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "profile.csv"
    >>> _ = path.write_text("x [m], range [m]\n0.000, 0.400\n0.001, 0.399\n")
    >>> read_profile(path).points.tolist()
    [[0.0, -400.0], [1.0, -399.0]]
    """
    profiles = inspect_profiles(path, **options).profiles
    if len(profiles) > 1:
        raise UnreadableFile(
            f"{os.fspath(path)}: it holds {len(profiles)} profiles: read them with read_profiles"
        )
    return profiles[0]


def read_profiles(path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> list[Profile]:
    r"""Read all profiles of a file, a folder, or the files of a pattern.

    Parameters
    ----------
    path : path
        A file; a folder, whose profile files are read in natural order (2 before 10); or a
        pattern, such as ``"logs/**/*.csv"``.
    **options
        Fields of `ReadSettings`, as for `read_profile`.

    Returns
    -------
    list of Profile
        In the order of the files, and within a file in its order.

    Raises
    ------
    UnreadableFile
        If there is no file, or one cannot be read or has less than two valid points; the message
        names it.
    ValueError, TypeError
        As `read_profile`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> for number in (1, 2, 10):
    ...     _ = (folder / f"{number}.csv").write_text(f"x,z\n0,-400\n{number},-399\n")
    >>> [float(profile.points[1, 0]) for profile in read_profiles(folder)]
    [1.0, 2.0, 10.0]
    >>> len(read_profiles(f"{folder}/1*.csv"))
    2
    """
    files = find_files(_build_file_name(path))
    if not files:
        kinds = " ".join(sorted(PROFILE_SUFFIXES))
        raise UnreadableFile(
            f"{os.fspath(path)}: no profile file in it (those are {kinds}): check the folder"
        )
    return [profile for file in files for profile in inspect_profiles(file, **options).profiles]


def inspect_profiles(path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> ProfileFile:
    r"""Read all profiles of one file, with the reader, the units and what was assumed.

    Parameters
    ----------
    path : path
        The file; its format is detected from its content.
    **options
        Fields of `ReadSettings`, as for `read_profile`.

    Returns
    -------
    ProfileFile
        Profiles, and how they were read.

    Raises
    ------
    UnreadableFile
        If the file cannot be read or holds less than two valid points.
    ValueError, TypeError
        As `read_profile`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "profile.csv"
    >>> _ = path.write_text("x [m], range [m]\n0.000, 0.400\n0.001, 0.399\n")
    >>> inspect_profiles(path).summary
    'text, m, 1 profile, 0 of 2 points lost, heights turned'
    """
    settings = ReadSettings(**options)
    file = Path(_build_file_name(path))
    content = read_bytes(file)
    try:
        reader = settings.format or detect_format(content, file.suffix)
        if reader == "matrix" and settings.columns is not None:  # a wide table of points
            reader = "text"
        raw = _READERS[reader](content, settings)
        profile_file = convert_to_section_frame(file, reader, raw, settings)
        require_points(profile_file.profiles)
    except UnreadableFile as error:
        error.args = (f"{file}: {error}",)
        raise error from None
    return profile_file


def _build_file_name(path: Any) -> str:
    if not isinstance(path, str | os.PathLike):
        raise TypeError(
            f"expected the name of a file, got {type(path).__name__}: lsvision.measure_cylinders "
            "takes points as they are"
        )
    return os.fspath(path)


def convert_to_section_frame(
    path: Path, reader: str, raw: RawProfiles, settings: ReadSettings
) -> ProfileFile:
    """Return the profiles of a file in the section frame: mm, Y towards the sensor, NaN where lost.

    Raises
    ------
    UnreadableFile
        If a plane is to be fitted and the points do not determine one, or an option has no effect.
    """
    _require_used_options(reader, raw, settings)
    x_unit, height_unit, assumed = _resolve_units(raw, settings)
    away = raw.away if settings.flip is None else settings.flip
    x_scale, height_scale = find_mm_per_unit(x_unit), find_mm_per_unit(height_unit)
    sections, markers = remove_lost(raw, settings)
    zeros = note_repeated(sections) if settings.lost_values is None else ()
    reject_wrapped_numbers(sections)
    fitted = None
    if settings.plane is not None:  # x, y and z have one unit
        fitted = fit_section_plane(_scale(sections, (x_scale, x_scale, x_scale)), flip=away)
        sections = list(fitted.sections)
    else:
        sections = _scale(sections, (x_scale, -height_scale if away else height_scale))
    profiles = tuple(Profile(section, lost=()) for section in sections)  # markers are removed
    unit_names = tuple(dict.fromkeys((x_unit, height_unit)))
    # A unit other than mm is stated, at least for one axis.
    stated = "" if assumed and unit_names == ("mm",) else ", ".join(unit_names)
    extent = find_extent(profiles)
    unit_warnings = find_unit_warnings(profiles, extent, stated)
    guessed = tuple(marker.note for marker in markers if marker.guessed)
    return ProfileFile(
        path=path,
        profiles=profiles,
        reader=reader,
        units=", ".join(unit_names),
        units_assumed=assumed,
        flipped=away,
        positions=_scale_positions(raw, settings.units or raw.position_unit or x_unit),
        notes=raw.notes
        + guessed
        + zeros
        + ((fitted.note,) if fitted else ())
        + unit_warnings
        + find_other_problems(profiles, extent, assumed=assumed, has_x=not raw.x_in_mm),
        unit_warnings=unit_warnings,
        markers=markers,
        attributes=raw.attributes,
        ignored=raw.ignored,
        file_from_section=fitted.file_from_section if fitted else None,
    )


def _require_used_options(reader: str, raw: RawProfiles, settings: ReadSettings) -> None:
    """Raise UnreadableFile for an option of another kind of file, which would have no effect."""
    has_counts = settings.x_start is not None or settings.x_pitch is not None
    unused = {
        "--dx is for heights without x": settings.dx is not None and not raw.x_in_mm,
        "--x-start and --x-pitch are for raw counts of Keyence": (
            has_counts and reader != "keyence-raw"
        ),
        "--topic is for ROS bags": settings.topic is not None and reader != "rosbag",
    }
    for statement, is_unused in unused.items():
        if is_unused:
            raise UnreadableFile(f"{statement}, got {reader}: leave it out")


def _scale(sections: Sequence[FloatArray], factors: tuple[float, ...]) -> list[FloatArray]:
    """Return the sections with each coordinate multiplied by its factor."""
    if set(factors) == {1.0}:
        return list(sections)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow makes a point lost
        return [section * factors for section in sections]


def _scale_positions(raw: RawProfiles, unit: str) -> tuple[float, ...] | None:
    """Return the positions along the travel, stated in a unit, in mm."""
    return raw.positions and tuple(position * find_mm_per_unit(unit) for position in raw.positions)


def _resolve_units(raw: RawProfiles, settings: ReadSettings) -> tuple[str, str, bool]:
    """Return the units of x and of height, and whether mm, or the unit of the other, is assumed."""
    x_unit = "mm" if raw.x_in_mm else settings.units or raw.units[0]
    height_unit = settings.units or raw.units[1]
    if settings.count_unit is not None and raw.units[1] == settings.count_unit:
        height_unit = raw.units[1]  # more specific than a unit of all coordinates
    assumed = x_unit is None or height_unit is None
    if not raw.x_in_mm:  # the unit of one axis is the best guess of the other
        x_unit, height_unit = x_unit or height_unit, height_unit or x_unit
    return x_unit or "mm", height_unit or "mm", assumed


def require_plausible_units(file: ProfileFile) -> None:
    """Raise UnreadableFile if the units are assumed and the coordinates in mm are implausible."""
    if file.unit_warnings and file.units_assumed:
        marked = [f"{marker.count} by {marker.text}" for marker in file.markers]
        lost = f" (without {file.lost} lost points, {', '.join(marked)})" if marked else ""
        raise UnreadableFile(
            f"{file.path}: {'; '.join(file.unit_warnings)}, or --units {file.units} if it is "
            f"correct{lost}"
        )


def require_points(profiles: Sequence[Profile]) -> None:
    """Raise UnreadableFile (`AllPointsLost`) for profiles without two valid points together."""
    total = sum(len(profile) for profile in profiles)
    valid = total - sum(profile.lost for profile in profiles)
    if valid == 0:
        error = AllPointsLost(
            f"all {total} points are lost: check exposure and range, or --columns"
        )
        error.sections = len(profiles)
        raise error
    if valid == 1:
        raise UnreadableFile("one valid point in it, no profile: check exposure, or --columns")
