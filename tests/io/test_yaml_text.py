"""YAML of unknown origin becomes text, lists and mappings, or a ValueError in time."""

import pytest

from lsvision.io.yaml_text import MAX_LENGTH, parse_yaml


def test_scalars_stay_text():
    text = '%YAML:1.0\n---\na: [1, 2.5, 2026-11-26, ~, !!int "", yes]\nb: {c: "d"}\n'
    assert parse_yaml(text) == {
        "a": ["1", "2.5", "2026-11-26", "~", "", "yes"],
        "b": {"c": "d"},
    }


def test_only_the_first_document_is_read():
    assert parse_yaml("--- 1\n--- 2\n") == "1"
    assert parse_yaml("") == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x 1\nb: *x", "expected YAML without aliases"),
        ("&x [*x]", "expected YAML without aliases"),
        ("- " * 200_000, "at most 64 levels of nesting, got more"),
        ("[" * 200_000, "nesting"),
        ("{a: " * 200_000, "nesting"),
        ("? [1]\n: 2", "expected keys that are texts"),
        ("a: \0", "not YAML: unacceptable character"),
        ("a: [", "not YAML"),
        ("x" * (MAX_LENGTH + 1), "expected at most 10000000 characters"),
    ],
)
def test_other_text_is_a_value_error(text, message):
    with pytest.raises(ValueError, match=message):
        parse_yaml(text)
