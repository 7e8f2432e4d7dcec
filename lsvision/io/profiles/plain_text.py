"""Plain text: x and height (or x, y and z) of one point per line, or lines of heights."""

from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.matrix import MIN_COLUMNS, profiles_from_matrix
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import decode_text, parse_table


def read_plain_text(content: bytes, settings: ReadSettings) -> RawProfiles:
    r"""Return the profiles of a table of points, or of a matrix of heights.

    A table is a matrix if it has at least `MIN_COLUMNS` columns, is to be transposed, or has one
    column whose spacing ``dx`` is given.

    Examples
    --------
    >>> raw = read_plain_text(b"x [mm], range [mm]\n0, 400\n1, 399\n", ReadSettings())
    >>> raw.units, raw.away
    (('mm', 'mm'), True)
    """
    table = parse_table(decode_text(content), settings.lost_words)
    width = table.values.shape[1]
    if settings.columns is None and (
        settings.transpose or width >= MIN_COLUMNS or (width == 1 and settings.dx is not None)
    ):
        return profiles_from_matrix(table, settings)
    return profiles_from_table(table, settings)
