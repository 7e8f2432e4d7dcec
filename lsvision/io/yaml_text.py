"""Untrusted YAML as mappings, lists and texts: no aliases, no types, limited depth."""

import re
from typing import Any

import yaml

from lsvision.files.json_text import MAX_DEPTH, NestedTooDeep

MAX_LENGTH = 10_000_000
"""Longest text; 10^5 poses. Units: characters."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same events, 20 times faster
_DIRECTIVE = re.compile(r"\A\s*%YAML[: ][^\n]*\n")  # OpenCV writes %YAML:1.0, which is not YAML

Yaml = str | list[Any] | dict[str, Any]


def parse_yaml(text: str) -> Yaml:
    """Return the first document of a YAML text; every scalar stays text.

    Only the events of the parser are used: nothing is converted, so that no conversion can fail
    and no type is constructed.

    Parameters
    ----------
    text : str
        The whole text.

    Returns
    -------
    str or list or dict
        The document; an empty one is an empty text.

    Raises
    ------
    ValueError
        If the text is not YAML, nests deeper than `MAX_DEPTH`, is longer than `MAX_LENGTH`, or
        contains an alias, a key that is not text, or a key twice in a mapping.

    Examples
    --------
    >>> parse_yaml("poses: [[1, 2.5], [2026-11-26, !!int x]]")
    {'poses': [['1', '2.5'], ['2026-11-26', 'x']]}
    """
    if len(text) > MAX_LENGTH:
        raise ValueError(f"expected at most {MAX_LENGTH} characters of YAML, got {len(text)}")
    builder = _Builder()
    try:
        for event in yaml.parse(_DIRECTIVE.sub("", text), Loader=_LOADER):
            if isinstance(event, yaml.DocumentEndEvent):
                break
            builder.add(event)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {' '.join(str(error).split())[:200]}") from None
    return builder.document


class _Builder:
    """Builds the document from events, without recursion: deep nesting cannot exhaust the stack."""

    def __init__(self) -> None:
        self.document: Yaml = ""
        self._open: list[tuple[list[Any] | dict[str, Any], str | None]] = []

    def add(self, event: Any) -> None:
        """Add the next event of the parser."""
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("expected YAML without aliases (*name), got one: write it out")
        if isinstance(event, yaml.ScalarEvent):
            self._add_value(event.value)
        elif isinstance(event, yaml.SequenceStartEvent | yaml.MappingStartEvent):
            if len(self._open) == MAX_DEPTH:
                raise NestedTooDeep
            value: Any = [] if isinstance(event, yaml.SequenceStartEvent) else {}
            self._add_value(value)
            self._open.append((value, None))
        elif isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
            self._open.pop()

    def _add_value(self, value: Any) -> None:
        """Add a value to the innermost open list or mapping, there as a key or its value."""
        if not self._open:
            self.document = value
            return
        parent, key = self._open[-1]
        if isinstance(parent, list):
            parent.append(value)
        elif key is not None:
            if key in parent:
                raise ValueError(f"expected each key once, got {key[:40]!r} twice in one mapping")
            parent[key] = value
            self._open[-1] = (parent, None)
        elif isinstance(value, str):
            self._open[-1] = (parent, value)
        else:
            raise ValueError("expected keys that are texts, got a list or mapping as a key")
