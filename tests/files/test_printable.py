"""Names and messages come out as text that gives no orders."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lsvision.files.printable import escape_cell, escape_name, escape_text
from tests.strategies import PROPERTY


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("profile 1.csv", "profile 1.csv"),
        ("Höhe µ 管.csv", "Höhe µ 管.csv"),
        ("a\nb\r\tc", r"a\nb\r\tc"),
        ("\x1b[2J\x07\x9b", r"\x1b[2J\x07\x9b"),
        ("gpj\u202egnp.csv", r"gpj\u202egnp.csv"),
        ("\udcff\ud800", r"\xff\ud800"),
        ("a\u2028b\x85\ufeff", r"a\u2028b\x85\ufeff"),
    ],
)
def test_what_does_not_print_is_escaped(text, shown):
    assert escape_text(text) == shown


@pytest.mark.parametrize("mark", "=+-@")
def test_a_name_that_a_spreadsheet_takes_for_a_formula_gets_its_folder(mark):
    assert escape_name(f"{mark}1.csv") == f"./{mark}1.csv"
    assert escape_name(f"/data/{mark}1.csv") == f"/data/{mark}1.csv"


@pytest.mark.parametrize("text", ["-E5", "+e5", "-A1", "=1", "@x", "-.e5"])
def test_a_text_that_a_spreadsheet_takes_for_a_formula_is_marked_as_text(text):
    assert escape_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", ["-", "+1", "-1.5", "+1,5e-3", "-.5", "-5.", "x", ""])
def test_numbers_and_other_texts_are_unchanged(text):
    assert escape_cell(text) == text


@PROPERTY
@given(st.text(st.characters()))
def test_any_name_is_one_line_of_utf_8(text):
    shown = escape_name(text)
    assert shown.encode().decode() == shown
    assert len((shown + "x").splitlines()) == 1
    assert "\x1b" not in shown
    stream = io.StringIO()
    csv.writer(stream).writerow([shown, 1])
    assert next(csv.reader(io.StringIO(stream.getvalue())))[0] == shown
