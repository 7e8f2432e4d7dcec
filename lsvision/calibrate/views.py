"""What became of a view that a calibration was given."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RejectedView:
    """A view named with what is wrong with it.

    Parameters
    ----------
    index : int
        Which of the images given, from 0.
    reason : str
        In words and numbers.
    """

    index: int
    reason: str
