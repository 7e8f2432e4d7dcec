"""JSON of unknown origin: what is read is finite and shallow; all else is a ValueError."""

import math

import pytest

from lsvision.files.json_text import MAX_DEPTH, MAX_DIGITS, parse_json


def test_plain_json_is_read():
    assert parse_json('{"a": [1, -2.5, true, null, "x"]}') == {"a": [1, -2.5, True, None, "x"]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 200_000, "levels of nesting, got more"),
        ('{"a":' * 200_000, "levels of nesting, got more"),
        ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "levels of nesting, got more"),
        ('{"a":' * MAX_DEPTH + "[]" + "}" * MAX_DEPTH, "levels of nesting, got more"),
        ("[NaN]", "expected finite numbers, got NaN"),
        ("[-Infinity]", "expected finite numbers, got -Infinity"),
        ("[1e999]", "expected numbers below 1.8e308, got 1e999"),
        ("9" * 5000, "at most 300 digits, got one of 5000"),
        ("{", "Expecting property name"),
        ("", "Expecting value"),
    ],
)
def test_other_text_is_a_value_error(text, message):
    with pytest.raises(ValueError, match=message):
        parse_json(text)


@pytest.mark.parametrize("sign", [1, -1])
def test_integers_up_to_the_limit_are_read(sign):
    largest = sign * (10**MAX_DIGITS - 1)
    assert parse_json(f"{largest}") == largest
    with pytest.raises(ValueError, match=f"at most {MAX_DIGITS} digits, got one of 301"):
        parse_json(f"{sign * 10**MAX_DIGITS}")


def test_nesting_up_to_the_limit_is_read():
    parse_json("[" * MAX_DEPTH + "]" * MAX_DEPTH)
    parse_json("[" * MAX_DEPTH + "1" + "]" * MAX_DEPTH)


def test_measured_points_may_be_lost():
    assert math.isnan(parse_json("[NaN]", allow_nan=True)[0])
