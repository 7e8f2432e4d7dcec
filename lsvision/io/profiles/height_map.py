"""Height maps: images whose pixels are heights, one profile per row (TIFF, PNG)."""

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.images import TooManyPixels, decode_image
from lsvision.io.profiles.matrix import profiles_from_matrix
from lsvision.io.profiles.number_cells import floats_from
from lsvision.io.profiles.number_table import NumberTable
from lsvision.io.profiles.settings import RawProfiles, ReadSettings


def read_height_map(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of an image of heights: counts of 16 or 32 bit, or floating point.

    Raises
    ------
    UnreadableFile
        If it is a photograph (8 bit, colours) or damaged, or its spacing or the size of a count
        is not given.
    """
    if settings.dx is None:
        raise UnreadableFile(
            "an image: of a laser line it needs its rig, lsvision measure --light-section "
            "rig.json; of heights it needs --x0, --dx and --z-unit"
        )
    try:
        image = decode_image(content)
    except TooManyPixels as error:
        raise UnreadableFile(f"{error}: cut it, or save its heights as NPY") from None
    if image is None or not image.size:
        raise UnreadableFile("an image that OpenCV cannot decode: save its heights as NPY or CSV")
    if image.ndim != 2 or image.dtype == np.uint8:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise UnreadableFile(
            f"an image of {channels} x {8 * image.dtype.itemsize} bit, no height map: expected one "
            "channel of 16 bit or floating point"
        )
    limits: tuple[float, ...] = ()
    if image.dtype.kind in "iu":
        if settings.z_unit is None and settings.units is None:
            raise UnreadableFile(
                "counts without their size: state the size of one, as --z-unit 0.5um or --units um"
            )
        type_limits = np.iinfo(image.dtype)
        limits = (float(type_limits.min), float(type_limits.max))
    return profiles_from_matrix(NumberTable(floats_from(image), limits=limits), settings)
