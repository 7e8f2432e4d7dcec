"""Messages on the terminal: an error is one line on stderr."""

import sys
import traceback
from collections.abc import Iterable, Mapping, Sequence

import typer

from lsvision.files.printable import printable

FAILED = 1
"""Exit code for data that cannot be measured, or output that cannot be written; usage is 2."""


def print_error(message: str, *, debug: bool = False) -> None:
    """Write one printable line on stderr; with `debug` the traceback of the exception before."""
    if debug and sys.exc_info()[0] is not None:
        traceback.print_exc(file=sys.stderr)
    typer.echo(f"lsvision: {printable(' '.join(message.split()))}", err=True)


def print_lines(lines: Iterable[str], *, err: bool = False) -> None:
    """Write lines on stdout, or on stderr, with non-printable characters escaped."""
    typer.echo("\n".join(printable(line) for line in lines), err=err)


def print_notes(names_by_note: Mapping[str, Sequence[object]]) -> None:
    """Write each note once on stderr, with the first of the files that it is about."""
    for note, names in names_by_note.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        print_lines([f"{names[0]}{more}: note: {note}"], err=True)


def internal_error(error: Exception) -> str:
    """Return the message of an unexpected exception, a bug."""
    reason = " ".join(str(error).split()) or "no message"
    return f"internal error, {type(error).__name__}: {reason} (--debug shows where; please report)"
