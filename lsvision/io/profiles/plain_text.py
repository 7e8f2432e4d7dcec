"""Plain text: x and height (or x, y and z) of one point per line, or lines of heights."""

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_roles import names_section
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.heights_without_x import only_height
from lsvision.io.profiles.matrix import (
    are_heights,
    profiles_from_matrix,
    profiles_from_text_matrix,
)
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.text_table import parse_table


def read_plain_text(content: bytes, settings: ReadSettings) -> RawProfiles:
    r"""Return the profiles of a table of points, or of a matrix of heights.

    A table is a matrix if it is to be transposed; or if its columns are not named as x and height,
    and it has at least `MIN_COLUMNS` of them, or the spacing ``dx`` of other than 2 or 3. With
    ``dx``, a table whose header names one column of heights or ranges and no x has one profile.

    Raises
    ------
    UnreadableFile
        If it is no table of numbers, or ``dx`` is given for a table of points with x.

    Examples
    --------
    >>> raw = read_plain_text(b"x [mm], range [mm]\n0, 400\n1, 399\n", ReadSettings())
    >>> raw.units, raw.away
    (('mm', 'mm'), True)
    """
    table = parse_table(decode_text(content), settings.lost_words)
    is_matrix = settings.transpose or (
        are_heights(table.values.shape[1], settings) and not names_section(table.names)
    )
    if is_matrix and settings.columns is None:
        return profiles_from_text_matrix(table, settings)
    if settings.dx is not None and settings.columns is None:
        height = only_height(table)
        if height is None:
            raise UnreadableFile(
                f"{table.values.shape[1]} columns, but --dx is for heights without x: leave it out "
                "if the file has x, or write decimals with a point"
            )
        return profiles_from_matrix(height, settings)
    return profiles_from_table(table, settings)
