"""Messages on the terminal: an error is one line on stderr."""

import sys
import traceback
from collections.abc import Iterable

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
    """Write lines on stdout, or on stderr, with what does not print in them escaped."""
    typer.echo("\n".join(printable(line) for line in lines), err=err)


def internal_error(error: Exception) -> str:
    """Return the message of an unexpected exception, a bug."""
    reason = " ".join(str(error).split()) or "no message"
    return f"internal error, {type(error).__name__}: {reason} (--debug shows where; please report)"
