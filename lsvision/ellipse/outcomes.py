"""Results of many arcs, where the failure of one does not stop the others."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from lsvision.errors import LsvisionError

T = TypeVar("T")
"""Type of a success."""
Output = TypeVar("Output")


def apply_to_successes(
    step: Callable[[list[T]], Iterable[Output | LsvisionError]],
    outcomes: Sequence[T | LsvisionError],
) -> list[Output | LsvisionError]:
    """Apply a function of a list to the outcomes that are no errors; errors stay where they are.

    Parameters
    ----------
    step : callable
        Function of a list of one or more successes that returns as many results.
    outcomes : sequence
        Outcomes, any of which may be an error.

    Returns
    -------
    list
        For each outcome the result of the function, or the error.

    Examples
    --------
    >>> outcomes = [1, LsvisionError("too short"), 2]
    >>> apply_to_successes(lambda numbers: [-n for n in numbers], outcomes)
    [-1, LsvisionError('too short'), -2]
    """
    successes = [outcome for outcome in outcomes if not isinstance(outcome, LsvisionError)]
    results = iter(step(successes) if successes else ())
    return [
        outcome if isinstance(outcome, LsvisionError) else next(results) for outcome in outcomes
    ]


def replace_some(
    outcomes: list[Output | LsvisionError],
    inputs: Mapping[int, T],
    step: Callable[[list[T]], Iterable[Output | LsvisionError]],
) -> None:
    """Replace some outcomes, in place, by the results of a function of a list of new inputs.

    Parameters
    ----------
    outcomes : list
        Outcomes of which some are replaced.
    inputs : mapping
        Index of the outcome, and input of the function for it.
    step : callable
        Function of a list of one or more inputs that returns as many results.

    Examples
    --------
    >>> outcomes = [1, 2, 3]
    >>> replace_some(outcomes, {0: 10, 2: 30}, lambda numbers: [-n for n in numbers])
    >>> outcomes
    [-10, 2, -30]
    """
    if inputs:
        for index, result in zip(inputs, step(list(inputs.values())), strict=True):
            outcomes[index] = result


def catch_error(step: Callable[..., Output], *arguments: object) -> Output | LsvisionError:
    """Return the result of a function, or the error that it raises.

    Examples
    --------
    >>> catch_error(unwrap, LsvisionError("too short"))
    LsvisionError('too short')
    """
    try:
        return step(*arguments)
    except LsvisionError as error:
        return error


def unwrap(outcome: T | LsvisionError) -> T:
    """Return an outcome; raise it if it is an error.

    Raises
    ------
    LsvisionError
        The outcome.

    Examples
    --------
    >>> unwrap(3)
    3
    """
    if isinstance(outcome, LsvisionError):
        raise outcome
    return outcome
