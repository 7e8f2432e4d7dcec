"""Messages and progress on the terminal: an error is one line on stderr."""

import re
import shlex
import shutil
import sys
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lsvision.files.file_kinds import exists
from lsvision.files.printable import escape_text

FAILED = 1
"""Exit code for data that cannot be measured, or output that cannot be written; usage is 2."""
_KINDS = {"int": "a whole number", "float": "a number"}
"""What is expected, by the beginning of pydantic's error types, such as ``int_parsing``."""
_BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
"""What is expected, by the names of pydantic's limits."""
BAR_WIDTH = 24
"""Width of the progress bar. Units: characters."""


def print_error(message: str, *, debug: bool = False) -> None:
    """Write one printable line on stderr; with `debug` after the traceback of the current error."""
    if debug and sys.exc_info()[0] is not None:
        traceback.print_exc(file=sys.stderr)
    print_lines([f"lsvision: {' '.join(message.split())}"], err=True)


def end_on_failures(failures: Sequence[Exception]) -> None:
    """Print each failure as an error and end the command, if there are any."""
    for failure in failures:
        print_error(str(failure))
    if failures:
        import typer

        raise typer.Exit(FAILED)


def print_lines(lines: Iterable[str], *, err: bool = False) -> None:
    """Write lines on stdout, or on stderr, with non-printable characters escaped."""
    stream = sys.stderr if err else sys.stdout
    stream.write("".join(f"{escape_text(line)}\n" for line in lines))
    stream.flush()


def print_notes(names_by_note: Mapping[str, Sequence[object]]) -> None:
    """Write each note once on stderr, with the first of the files that it is about."""
    for note, names in names_by_note.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        print_lines([f"{names[0]}{more}: note: {note}"], err=True)


def describe_internal_error(error: Exception) -> str:
    """Return the message of an unexpected exception, a bug."""
    reason = " ".join(str(error).split()) or "no message"
    return f"internal error, {type(error).__name__}: {reason} (--debug shows where; please report)"


def format_usage_message(error: Any) -> str:
    """Return the message of a usage error of click, with what was expected and what was given.

    Where pydantic has rejected the value of an option, both are in the cause of the error only.
    """
    details = getattr(error.__cause__, "errors", None)
    if details is None:
        return str(error.message) + _suggest_measure_command(str(error.message))
    detail = details()[0]
    bounds = [
        f"{bound} {detail['ctx'][key]:g}"
        for key, bound in _BOUNDS.items()
        if key in detail.get("ctx", ())
    ]
    kind = _KINDS.get(detail["type"].partition("_")[0])
    expected = " and ".join(bounds) or kind
    return f"expected {expected}, got {detail['input']!r}" if expected else str(error.message)


def _suggest_measure_command(message: str) -> str:
    """Return a sentence with the command that measures a file, if it was given as a command."""
    match = re.search(r"^No such command '(.+)'\.$", message)
    if match is None or not exists(match[1]):
        return ""
    return f" To measure it: lsvision measure {shlex.quote(match[1])}"


class StatusLine:
    """Line that is overwritten; nothing is shown unless stderr is a terminal."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()

    def write(self, text: str) -> None:
        """Replace the text of the line."""
        if self._shown:
            sys.stderr.write(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}")
            sys.stderr.flush()

    def clear(self) -> None:
        """Erase the line, so that others can be written."""
        self.write("")


class Progress(StatusLine):
    """Progress bar over `total` files; `done` is the number of those that are finished."""

    def __init__(self, total: int) -> None:
        super().__init__()
        self._total = total
        self._start = time.monotonic()
        self.done = 0

    def show(self, done: int, name: str, finished: int = 0, profiles: int = 1) -> None:
        """Draw the bar and the status beside it: `done` files, and `name` of the current one.

        Of the current file, `finished` of `profiles` are finished; 0 of 1 for a file that is
        measured as a whole, or has an unknown number of profiles.
        """
        self.done = done
        if self._total * profiles <= 1:  # nothing to show for a single profile, or without files
            return
        fraction = (done + finished / profiles) / self._total
        current = f", profile {finished} of {profiles}" if profiles > 1 else ""
        self.write(
            f"[{'#' * int(BAR_WIDTH * fraction):.<{BAR_WIDTH}}] {done}/{self._total}{current}"
            f"{_format_time_left(time.monotonic() - self._start, fraction)} {escape_text(name)}"
        )


def _format_time_left(elapsed_s: float, fraction: float) -> str:
    """Return the estimated remaining time as text; "" in the first second, and at the end.

    `fraction` of the work was done in the elapsed time.
    """
    if not 0 < fraction < 1 or elapsed_s < 1:
        return ""
    return f", {format_duration(elapsed_s * (1 - fraction) / fraction)} left"


def format_duration(seconds: float) -> str:
    """Return a duration as text: ``3 min 05 s`` or ``2 h 07 min``."""
    minutes, seconds_left = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min {seconds_left:02} s"
