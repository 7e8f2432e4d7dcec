"""Tables of regular rows, read at once, and the same files read line by line: equal results."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lsvision.errors import UnreadableFile
from lsvision.io.profiles import text_table
from lsvision.io.profiles.regular_rows import find_regular_rows
from lsvision.io.profiles.text_table import parse_table
from tests.strategies import PROPERTY

_NUMBERS = st.one_of(
    st.floats(-1e4, 1e4).map(lambda x: f"{x:.4f}"),
    st.floats(allow_nan=False).map(repr),
    st.integers(-70000, 70000).map(str),
    st.sampled_from(["2", "-0", "+1.5", ".5", "7.", "1e3", "-9999", "0"]),
)
_ODD_CELLS = (
    *("", " ", "nan", "NaN", "-nan", "NA", "-", "--", "1e", "e5", "1.2.3", "+-3", "1e400", "inf"),
    *("six", '"4"', "1,5", "1 2", "1_000", "1d5", "\u22125", "0x1F", "# 4", "4 # note", "1\x0c"),
)
_HEADERS = (
    *("", "x,z\n", "x [um];z [um]\n", "# unit: m\n", "3\n", "2 5\n", "400\n", "x z\n\n"),
    *("ACME\nX, Z\n", "\ufeffx,z\n", "x,y,z\n1,2\n", "nan,nan\n", "x\tz\n-\t-\n", "2,330\n"),
    "invalid value: -9999\n",
)
_ENDS = ("", "\n", "\n\n", "\r\n \n", "\n# end\n", "\n3\n", "\n330\n", "\nmean;2\n")
_LINES_BETWEEN = ("", " ", "# 1", "1", "5 6")


@st.composite
def _texts(draw):
    """Tables of a few rows, written often, with now and then a cell that is no plain number."""
    width = draw(st.integers(1, 4))
    mark = draw(st.sampled_from([",", ", ", ";", "\t", " ", "  ", "|"]))
    cells = st.lists(_NUMBERS, min_size=width, max_size=width).map(mark.join)
    rows = draw(st.lists(cells, min_size=1, max_size=6)) * draw(st.sampled_from([1, 1, 3, 110]))
    for cell in draw(st.lists(st.sampled_from(_ODD_CELLS), max_size=2)):
        place = draw(st.integers(0, len(rows) - 1))
        broken = rows[place].split(mark)
        broken[draw(st.integers(0, len(broken) - 1))] = cell
        rows[place] = mark.join(broken)
    if draw(st.integers(0, 9)) == 0:
        line = draw(st.sampled_from(_LINES_BETWEEN))
        rows.insert(draw(st.integers(0, len(rows))), line)
    line_end = draw(st.sampled_from(["\n", "\n", "\r\n", "\r", "\r\r\n"]))
    header, end = draw(st.sampled_from(_HEADERS)), draw(st.sampled_from(_ENDS))
    return header + line_end.join(rows) + end


def _table(text):
    """All that is read of a text, comparable, or the message."""
    try:
        table = parse_table(text, frozenset(["six"]))
    except UnreadableFile as error:
        return str(error)
    invalid = {
        column: (cell.row, cell.text, cell.reason) for column, cell in table.invalid_cells.items()
    }
    return (
        table.values.shape, table.values.tobytes(), table.names, table.units, table.statements,
        dict(table.texts), invalid, table.lost, table.notes,
        [line for line in table.mentions if line.strip()],
    )  # fmt: skip


@settings(PROPERTY, max_examples=100)
@given(_texts())
def test_equal_results_at_once_and_line_by_line(text):
    at_once = _table(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_table, "find_regular_rows", lambda text: None)
        assert at_once == _table(text)


@cache
def _lines(count, separator=","):
    points = np.random.default_rng(8).normal(0, 90, (count, 2)).round(3)
    return points, "".join(f"{x}{separator}{z}\n" for x, z in points.tolist())


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
@pytest.mark.parametrize("count", [2, 400, 30_000])
@pytest.mark.parametrize("header", ["", "x [mm],z [mm]\n", "# made by hand\n\n"])
def test_plain_files_are_read_at_once(separator, count, header):
    points, lines = _lines(count, separator)
    np.testing.assert_array_equal(find_regular_rows(header + lines).values, points)


@pytest.mark.parametrize("lost", ["nan", "NaN", ""])
def test_lost_points_are_read_at_once(lost):
    points, lines = _lines(400)
    text = lines + f"{lost},{lost}\n" + lines + f"1,{lost}\n"
    expected = np.vstack([points, [[np.nan, np.nan]], points, [[1, np.nan]]])
    np.testing.assert_array_equal(find_regular_rows(text).values, expected)


@pytest.mark.parametrize(
    "slip",
    ["1,2,3\n", "1\n", "\n", "# 1,2\n", "1;2\n", "six,2\n", '"1","2"\n', "1\r,2\n", "1,2 3\n"],
)
@pytest.mark.parametrize("place", [0, 5000])
def test_other_rows_are_left_to_the_reader_of_lines(slip, place):
    _, lines = _lines(400)
    _, later = _lines(place)
    assert find_regular_rows(lines + later + slip + lines) is None


def test_blanks_that_align_columns_are_no_empty_cells():
    with pytest.raises(UnreadableFile, match="line 2 has 2 cells, expected 3"):
        parse_table("0 1 2\n 3 4\n5 6 7\n")


def test_beginning_that_states_the_size_is_left_to_the_reader_of_lines():
    _, lines = _lines(400, " ")
    assert parse_table("2 400\n" + lines).values.shape == (400, 2)
    assert parse_table("2 399\n" + lines).values.shape == (401, 2)


def test_numbers_cut_at_their_commas_are_rejected_wherever_they_begin():
    lines = "".join(f"{k},5,-{k},25\n" for k in range(600))
    with pytest.raises(UnreadableFile, match="numbers seem to be split at their commas"):
        parse_table(lines + "1,05,-2,05\n" + lines)
