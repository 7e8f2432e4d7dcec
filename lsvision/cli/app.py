"""The frame of the command line: the commands, and how a failure reaches the shell."""

import io
import sys
import warnings
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from lsvision.cli.calibrate import calibrate
from lsvision.cli.demo import demo
from lsvision.cli.line import line
from lsvision.cli.measure import measure
from lsvision.cli.messages import FAILED, internal_error, print_error
from lsvision.cli.paper import paper
from lsvision.cli.plan import plan
from lsvision.cli.scan import scan
from lsvision.cli.simulate import simulate
from lsvision.errors import LsvisionError


class _OneLineErrors(TyperGroup):
    """Turns what a command raises into one line on stderr; ``--debug`` adds the traceback."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take ``--debug`` wherever it stands, also behind the command."""
        options = args[: args.index("--")] if "--" in args else args
        if "--debug" in options:
            args = ["--debug", *(word for word in args if word != "--debug")]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; known failures end with exit code 1."""
        try:
            return super().invoke(ctx)
        except LsvisionError as error:
            print_error(str(error), debug=ctx.params["debug"])
        except MemoryError:
            print_error("out of memory: measure fewer files at once", debug=ctx.params["debug"])
        raise typer.Exit(FAILED)


app = typer.Typer(
    cls=_OneLineErrors,
    name="lsvision",
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help needs no import of rich and can be piped
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if not wanted:
        return
    from lsvision import __version__

    typer.echo(f"lsvision {__version__}")
    raise typer.Exit


@app.callback()
def _frame(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Radius and orientation of cylinders from a light section, each with its uncertainty.

    Lengths are in mm and angles in deg; X runs along the laser line, Y towards the sensor.
    lsvision demo measures a shipped profile; lsvision COMMAND --help shows examples.
    """


app.command()(demo)
app.command()(measure)
app.command()(line)
app.command()(paper)
app.command()(plan)
app.command()(scan)
app.command()(simulate)
app.add_typer(calibrate)


def main() -> None:
    """Run the command line; exit code 0, 1 for data and files, 2 for usage."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file name may hold what they cannot show
            stream.reconfigure(errors="backslashreplace")
    # The reader has told of odd units, in a line of its own; --units mm means what it says.
    warnings.filterwarnings("ignore", "expected a profile in mm", UserWarning)
    try:
        app(prog_name="lsvision")
    except Exception as error:  # noqa: BLE001 - the last place that can turn a bug into a line
        print_error(internal_error(error), debug="--debug" in sys.argv)
        sys.exit(FAILED)
