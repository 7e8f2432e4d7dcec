"""The ways a measurement fails, each saying what, got, need and what to do.

A caller's slip (wrong shape, negative radius) is a ``ValueError`` or ``TypeError``; what the
world did (empty file, no line in the image, too few poses) is a `LsvisionError`; an arc that
is no cylinder is neither: it is a ``Rejection`` in the result.
"""


class LsvisionError(Exception):
    """Root of everything that the world, not the caller, does to a measurement.

    Examples
    --------
    >>> import lsvision as lsv
    >>> try:
    ...     lsv.read_profile("nowhere.csv")
    ... except LsvisionError as error:
    ...     print(error)
    nowhere.csv: no such file: check the name
    """


class TooFewPoints(LsvisionError):
    """Fewer points than the step needs.

    Parameters
    ----------
    what : str
        The thing that is short of points, as the user knows it.
    got, need : int
        Counts.
    hint : str
        What to do about it.
    """

    def __init__(self, what: str, got: int, need: int, hint: str) -> None:
        super().__init__(f"{what} has {got} points and needs {need}: {hint}")
        self.got, self.need = got, need


class UnreadableFile(LsvisionError):
    """A file that cannot be read as what it should be; the message names file and mend."""


class UnwritableFile(LsvisionError):
    """An output that cannot be written; nothing half-written is left behind."""


class FitFailed(LsvisionError):
    """A least-squares problem without a usable minimum."""


class NoLaserLine(LsvisionError):
    """An image in which no laser line was found."""


class DegenerateGeometry(LsvisionError):
    """Data that cannot determine what is asked, whatever their noise; names what is missing."""


class CalibrationFailed(LsvisionError):
    """Views or poses from which no trustworthy calibration follows."""


class InvalidJob(LsvisionError):
    """A job file with slips.

    Parameters
    ----------
    name : str
        Of the file.
    slips : tuple of Slip
        Each with its line and the mend.
    """

    def __init__(self, name: str, slips: tuple[object, ...]) -> None:
        super().__init__(f"{name}: {'; '.join(map(str, slips))}")
        self.slips = slips
