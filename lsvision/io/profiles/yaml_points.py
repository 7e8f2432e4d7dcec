"""Points in plain YAML as ROS and loggers write it: only keys with numbers and lists.

No aliases, tags or types: what is not understood stays text, so that a malicious file is harmless.
Lists are parsed as JSON, which is much faster than the YAML parser of `lsvision.io.yaml_text`.
"""

import re
from typing import Any

from lsvision.errors import UnreadableFile
from lsvision.files.json_text import parse_json
from lsvision.io.profiles.json_points import profiles_from_document
from lsvision.io.profiles.pose_documents import reject_pose_text
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_heights import add_direction
from lsvision.io.profiles.stated_units import add_units, require_known_unit
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.unit_statements import find_unit_statements

_KEY = re.compile(r"^([^\s#:\[\]{},\"'-][^:#]*):(?:\s+(.*)|)$")
_DOCUMENT_END = re.compile(r"(?m)^(?:---|\.\.\.)\s*$")
# A lost number, in YAML .nan, .inf, null or ~; a key without quotes in a mapping on one line.
_LOST_NUMBER = re.compile(r"(?<![\w.])([-+]?)\.?(nan|inf|infinity|null|~)(?![\w.])", re.IGNORECASE)
_BARE_KEY = re.compile(r"([{,]\s*)([A-Za-z_]\w*)\s*:")
_COMMENT = re.compile(r"(?<!\s)\s+#.*$")


def read_yaml(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a YAML file; several documents are several profiles.

    Raises
    ------
    UnreadableFile
        If no points are found in it (the error names the keys found), a key occurs twice, or a unit
        is not understood.
    """
    parts = [part for part in _DOCUMENT_END.split(decode_text(content)) if part.strip()]
    documents = [document for part in parts if (document := _parse_plain_yaml(part))]
    if not documents:
        raise UnreadableFile("YAML without a key: expected ranges, or lists x and z")
    document = documents[0] if len(documents) == 1 else documents
    try:
        profiles = profiles_from_document(document, settings, "YAML")
    except UnreadableFile:
        reject_pose_text("".join(parts))
        raise
    comments = [line for part in parts for line in part.splitlines() if line.lstrip()[:1] == "#"]
    profiles = add_units(profiles, find_unit_statements(comments), settings)
    require_known_unit(profiles.units, comments, settings)
    return add_direction(profiles, comments, settings)


def _parse_plain_yaml(text: str) -> dict[str, Any] | list[Any]:
    r"""Return the keys of the top level with their numbers, texts and lists; or a list of items.

    Raises
    ------
    UnreadableFile
        If a key occurs twice.

    Examples
    --------
    >>> _parse_plain_yaml("unit: um\nx: [1, 2]\nz:\n- 3\n- .nan\n")["z"]
    [3, nan]
    """
    document: dict[str, Any] = {}
    key: str | None = None
    body: list[str] = []
    for line in [*text.splitlines(), "end:"]:  # the last key completes the one before it
        line = _COMMENT.sub("", line)  # noqa: PLW2901 - the line without its comment
        match = _KEY.match(line)
        if match is None:
            if line.strip() and not line.lstrip().startswith(("#", "%")):
                body.append(line)
            continue
        if key in document:
            raise UnreadableFile(f"YAML with the key {key!r} twice: write one file per profile")
        if key is not None:
            document[key] = _parse_value(body)
        elif body:
            return _parse_items(body)
        key, body = match[1].strip(), [match[2]] if match[2] else []
    return document


def _parse_value(body: list[str]) -> Any:
    """Return the value of the lines under a key: a block list, or a scalar over several lines."""
    if not body:
        return None
    if body[0].lstrip().startswith("- ") or body[0].strip() == "-":
        return _parse_items(body)
    return _parse_scalar(" ".join(line.strip() for line in body))


def _parse_items(body: list[str]) -> list[Any]:
    """Return the items of a block list; an item may be a mapping over several lines."""
    items: list[list[str]] = []
    for line in body:
        text = line.strip()
        if text.startswith("-") and (text == "-" or text[1] == " "):
            items.append([text[1:].strip()])
        elif items:
            items[-1].append(text)
    return [_parse_item(lines) for lines in items]


def _parse_item(lines: list[str]) -> Any:
    """Return the value of one item's lines: a mapping if each is ``key: value``, or a scalar."""
    pairs = [_KEY.match(line) for line in lines]
    if all(pairs):
        return {pair[1].strip(): _parse_scalar(pair[2] or "") for pair in pairs if pair}
    return _parse_scalar(" ".join(lines))


def _parse_scalar(text: str) -> Any:
    """Return a YAML value on one line as number, list, mapping or text."""
    text = text.strip()
    if not text:
        return text
    plain = _LOST_NUMBER.sub("NaN", text)
    plain = re.sub(r"(?<=[0-9])\.(?=[\s,\]}e]|$)", ".0", plain)
    plain = re.sub(r"(?<![0-9])\.(?=[0-9])", "0.", plain)
    for candidate in (plain, _BARE_KEY.sub(r'\1"\2":', plain)):
        try:
            return parse_json(candidate, allow_nan=True)
        except ValueError:
            continue
    return text.strip("\"'")
