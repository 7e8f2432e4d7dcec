"""Settings as short text: the values that differ from the defaults."""

from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any


class ShowsChanges:
    """Repr of a settings dataclass that names only the values which are not the defaults.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, repr=False)
    ... class Settings(ShowsChanges):
    ...     min_points: int = 3
    ...     max_points: int = 9
    >>> Settings(), Settings(max_points=8)
    (Settings(), Settings(max_points=8))
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return _format_changes(self)


def _format_changes(settings: Any) -> str:
    """Return ``Name(field=value)`` with the fields that are not defaults, also of nested ones."""
    texts = []
    for field in fields(settings):
        value = getattr(settings, field.name)
        if value != _get_default(field):
            text = _format_changes(value) if is_dataclass(value) else repr(value)
            texts.append(f"{field.name}={text}")
    return f"{type(settings).__name__}({', '.join(texts)})"


def _get_default(field: "Field[Any]") -> Any:
    """Return the default of a field of a dataclass, MISSING if it has none."""
    if field.default_factory is not MISSING:
        return field.default_factory()
    return field.default
