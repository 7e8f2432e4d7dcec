"""Groups of options: each field is an option of the command, which gets them as one dataclass."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from lsvision.cli.option_groups import expand_option_groups


@dataclass(frozen=True, kw_only=True)
class Grid:
    rows: Annotated[int, typer.Option("--rows", "-r")]
    columns: Annotated[int, typer.Option(min=1)] = 2

    def __post_init__(self):
        if self.rows > self.columns:
            raise typer.BadParameter("expected at most as many rows as columns")


@pytest.fixture
def invoke():
    app = typer.Typer()

    @app.command()
    @expand_option_groups
    def draw(*, name: Annotated[str, typer.Argument()], grid: Grid, bold: bool = False) -> None:
        """Draw a grid."""
        typer.echo(f"{name} {grid} {bold}")

    return lambda *words: CliRunner().invoke(app, words)


def test_command_gets_its_options_as_one_group(invoke):
    assert invoke("a", "-r", "1", "--bold").stdout == "a Grid(rows=1, columns=2) True\n"
    assert invoke("a", "--rows", "3", "--columns", "4").stdout == (
        "a Grid(rows=3, columns=4) False\n"
    )


def test_field_without_default_is_a_required_option(invoke):
    result = invoke("a")
    assert result.exit_code == 2
    assert "--rows" in result.stderr


@pytest.mark.parametrize("words", [("--rows", "0", "--columns", "0"), ("--rows", "9")])
def test_invalid_group_is_a_usage_error(invoke, words):
    assert invoke("a", *words).exit_code == 2


def test_docstring_is_the_help(invoke):
    assert "Draw a grid." in invoke("--help").stdout
