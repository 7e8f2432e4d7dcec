"""Read profile files of many makers and formats as profiles in the section frame."""

from lsvision.io.profiles.reading import (
    ProfileFile,
    inspect_profiles,
    read_profile,
    read_profiles,
)
from lsvision.io.profiles.settings import FORMATS, ReadOptions, ReadSettings
from lsvision.io.profiles.units import MM_PER_UNIT

__all__ = [
    "FORMATS",
    "MM_PER_UNIT",
    "ProfileFile",
    "ReadOptions",
    "ReadSettings",
    "inspect_profiles",
    "read_profile",
    "read_profiles",
]
