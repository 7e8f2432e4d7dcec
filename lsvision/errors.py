"""Errors of the package; each message states the failure, values got and needed, and a remedy.

A wrong argument (shape, negative radius) is a ``ValueError`` or ``TypeError``; data that cannot be
used (empty file, no line in the image, too few poses) are a `LsvisionError`; an arc that is not a
cylinder is not an error: it is a ``Rejection`` in the result.
"""


class LsvisionError(Exception):
    """Base class of the errors caused by data or environment, not by wrong arguments.

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
        Object with too few points, in the user's terms (an arc, a profile).
    got, need : int
        Number of points, and smallest number that is needed.
    hint : str
        Remedy.
    """

    def __init__(self, what: str, got: int, need: int, hint: str) -> None:
        super().__init__(what, got, need, hint)  # for pickle, which calls the class with them
        self.what, self.got, self.need, self.hint = what, got, need, hint

    def __str__(self) -> str:
        points = "1 point" if self.got == 1 else f"{self.got} points"
        return f"{self.what} has {points} and needs {self.need}: {self.hint}"


class UnreadableFile(LsvisionError):
    """A file that cannot be read as expected; the message states file and remedy."""


class UnwritableFile(LsvisionError):
    """An output that cannot be written; the message states file and remedy."""


class FitFailed(LsvisionError):
    """A least-squares problem without a usable minimum."""


class NoLaserLine(LsvisionError):
    """An image in which no laser line was found.

    Parameters
    ----------
    finding : str
        What was found instead, with its numbers.
    remedy : str
        Settings that may find the line; empty if `finding` contains the remedy. The message
        contains both.
    """

    def __init__(self, finding: str, remedy: str = "") -> None:
        super().__init__(f"{finding}; {remedy}" if remedy else finding)
        self.finding, self.remedy = finding, remedy


class DegenerateGeometry(LsvisionError):
    """Data that do not determine the result, even without noise; the message states the remedy."""


class CalibrationFailed(LsvisionError):
    """Images or poses from which no calibration follows: too few, unusable or contradictory."""


class InvalidJob(LsvisionError):
    """A job file with mistakes.

    Parameters
    ----------
    name : str
        Name of the file.
    mistakes : tuple of Mistake
        Mistakes, each with its line and the remedy.
    """

    def __init__(self, name: str, mistakes: tuple[object, ...]) -> None:
        super().__init__(name, mistakes)  # for pickle, which calls the class with them
        self.name, self.mistakes = name, mistakes

    def __str__(self) -> str:
        return f"{self.name}: {'; '.join(map(str, self.mistakes))}"
