"""Root of the command line: its commands, global options, and errors as one line."""

import io
import re
import signal
import sys
from importlib import import_module
from itertools import islice
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.main import get_group

from lsvision.cli.messages import FAILED, describe_internal_error, format_usage_message, print_error
from lsvision.errors import LsvisionError
from lsvision.files.limited_reading import limit_file_size
from lsvision.files.printable import escape_text

INTERRUPTED = 130
"""Exit code after Ctrl-C, SIGTERM or SIGHUP: that of shells after Ctrl-C."""
MAX_SIZE_LIMIT_BYTES = 1e15
"""Largest --max-size. Units: bytes."""

_COMMANDS = (
    "demo", "measure", "batch", "inspect", "job", "study", "line", "paper", "plan", "scan",
    "simulate", "calibrate",
)  # fmt: skip
"""Commands, and the modules in which they are, in the order of the help; imported when used."""

_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]  # UsageError of click, not exported by typer
_SIZE = re.compile(r"(\d{1,15}(?:\.\d{1,9})?)\s*([kKMGT]?B?)", re.ASCII)
"""A size: a number, and a unit such as GB, G or none."""
_BYTES = {"": 1.0, "b": 1.0} | {
    unit: factor
    for letter, factor in (("k", 1e3), ("m", 1e6), ("g", 1e9), ("t", 1e12))
    for unit in (letter, f"{letter}b")
}
"""Bytes of each unit, in lower case."""


class _OneLineErrors(TyperGroup):
    """Command group that reports an error as one line on stderr; ``--debug`` adds the traceback."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands: Any = dict.fromkeys(_COMMANDS)  # None until `get_command` imports it

    def list_commands(self, _: Any) -> list[str]:
        """Return the names of all commands, imported or not."""
        return list(self.commands)

    def get_command(self, _: Any, cmd_name: str) -> Any:
        """Return a command, after importing it; None if there is none of this name."""
        if cmd_name in self.commands and self.commands[cmd_name] is None:
            self.commands[cmd_name] = _import_command(cmd_name)
        return self.commands.get(cmd_name)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept ``--debug`` and ``--max-size`` before and after the command."""
        end = args.index("--") if "--" in args else len(args)
        global_options, arguments = _split_global_options(args[:end])
        return super().parse_args(ctx, [*global_options, *arguments, *args[end:]])

    def invoke(self, ctx: Any) -> Any:
        """Run the command; a `LsvisionError` ends with exit code 1, an interruption with 130."""
        limit = _parse_size(ctx.params["max_size"])
        try:
            with limit_file_size(limit):
                return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None
        except _USAGE_ERROR as error:
            # A group of commands without a command raises its help, of several lines, as an error.
            if error.ctx is None or error.message != error.ctx.get_help():
                error.message = escape_text(format_usage_message(error))
            raise
        except LsvisionError as error:
            print_error(str(error), debug=ctx.params["debug"])
        except MemoryError:
            print_error(
                "out of memory: use fewer or smaller inputs at once", debug=ctx.params["debug"]
            )
        raise typer.Exit(FAILED)


def _import_command(name: str) -> Any:
    """Import a command, or a group of commands, and return it as the classes of click."""
    command = getattr(import_module(f"lsvision.cli.{name}"), name)
    parent = typer.Typer(rich_markup_mode=None)
    if isinstance(command, typer.Typer):
        parent.add_typer(command)
    else:
        parent.command()(command)
    return get_group(parent).commands[name]


def _split_global_options(args: list[str]) -> tuple[list[str], list[str]]:
    """Return the options ``--debug`` and ``--max-size`` with its value, and the other arguments."""
    global_options: list[str] = []
    arguments: list[str] = []
    remaining = iter(args)
    for argument in remaining:
        if argument == "--debug" or argument.startswith("--max-size="):
            global_options.append(argument)
        elif argument == "--max-size":
            global_options += [argument, *islice(remaining, 1)]
        else:
            arguments.append(argument)
    return global_options, arguments


def _parse_size(text: str) -> int:
    """Return the number of bytes of a size such as ``500MB`` or ``8 GB``."""
    match = _SIZE.fullmatch(text.strip())
    size = float(match[1]) * _BYTES[match[2].lower()] if match else 0.0
    if not 1 <= size <= MAX_SIZE_LIMIT_BYTES:
        raise typer.BadParameter(f"expected --max-size such as 500MB or 8GB, got {text!r}")
    return int(size)


app = typer.Typer(
    cls=_OneLineErrors,
    name="lsvision",
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help needs no import of rich and can be piped
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(requested: bool) -> None:
    """Print the version and exit, if ``--version`` is given."""
    if not requested:
        return
    from lsvision import __version__

    typer.echo(f"lsvision {__version__}")
    raise typer.Exit


@app.callback()
def _global_options(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    max_size: Annotated[
        str,
        typer.Option("--max-size", metavar="SIZE", help="Largest file that is read, such as 8GB."),
    ] = "2GB",
) -> None:
    """Radius and orientation of cylinders from a light section, each with its uncertainty.

    Lengths are in mm and angles in deg; X runs along the laser line, Y towards the sensor.
    lsvision demo measures a shipped profile; lsvision COMMAND --help shows examples. --debug and
    --max-size may follow the command.
    """


def _interrupt(*_: Any) -> NoReturn:
    """Handle a signal as Python handles Ctrl-C."""
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line, and exit.

    Exit code 0, 1 for data and files, 2 for usage, 130 if interrupted; of ``lsvision inspect`` also
    3 for NG and 4 for undecided.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # File names may have characters that the encoding of the stream lacks.
            stream.reconfigure(errors="backslashreplace")
    for name in ("SIGTERM", "SIGHUP"):  # like Ctrl-C: results so far are written
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _interrupt)
    try:
        app(prog_name="lsvision")
    except KeyboardInterrupt:  # before a command runs
        sys.exit(INTERRUPTED)
    except Exception as error:  # noqa: BLE001 - a bug is reported in one line, too
        print_error(describe_internal_error(error), debug="--debug" in sys.argv)
        sys.exit(FAILED)
