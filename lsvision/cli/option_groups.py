"""Options that several commands share as fields of a dataclass; groups of commands."""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from typing import Any, get_type_hints

import typer


def expand_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that takes the fields of its dataclass parameters as options.

    Typer makes an option of each parameter of a function. ``def scan(files: ..., reading:
    ReadingOptions)`` becomes a command with an option for each field of `ReadingOptions`, whose
    values the function gets as one `ReadingOptions`.
    """
    signature = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {
        name: parameter.annotation
        for name, parameter in signature.parameters.items()
        if is_dataclass(parameter.annotation)
    }

    @wraps(command)
    def run(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        command(**values)

    options: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        keyword = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        options += _list_options(groups[name]) if name in groups else [keyword]
    run.__signature__ = signature.replace(parameters=options)  # type: ignore[attr-defined] # read by inspect.signature
    return run


def build_command_group(name: str, summary: str) -> typer.Typer:
    """Return a group of commands; without a command it prints its help."""
    return typer.Typer(name=name, no_args_is_help=True, rich_markup_mode=None, help=summary)


def _list_options(group: Any) -> list[inspect.Parameter]:
    """Return a keyword parameter for each field of a dataclass."""
    hints = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    ]
