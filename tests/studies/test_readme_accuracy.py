"""The accuracy table beside the README is the one that the experiments make."""

import re
from pathlib import Path

import pytest

from lsvision.studies.chen_liu_2016 import format_readme_table
from lsvision.studies.chen_liu_2016.report_tables import README_HEAD

PAGE = Path(__file__).parents[2] / ".github" / "ACCURACY.md"
FIRST = "| " + " | ".join(README_HEAD) + " |"
EFFICIENT = (0.6, 1.7)  # rms over bound: welded pairs 1.5, theta near its largest 0.7


def readme_rows():
    if not PAGE.exists() or FIRST not in PAGE.read_text(encoding="utf-8"):
        pytest.skip("the page has no accuracy table yet")
    below = PAGE.read_text(encoding="utf-8").split(FIRST, 1)[1].splitlines()[1:]
    rows = below[: next((n for n, line in enumerate(below) if not line.startswith("|")), None)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in rows[1:]]


def bound(cell):
    """The figure in brackets, or what stands there instead."""
    found = re.search(r"\(([\d.]+)\)", cell)
    return found.group(1) if found else cell


def test_the_readme_has_the_bounds_and_printed_errors_of_the_experiments(bounds):
    wanted = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in format_readme_table(bounds).splitlines()[2:]
    ]
    shown = readme_rows()
    assert [row[:2] for row in shown] == [row[:2] for row in wanted]
    assert [[bound(c) for c in row[2:]] for row in shown] == [
        [bound(c) for c in row[2:]] for row in wanted
    ]


def test_the_errors_in_the_readme_are_what_an_efficient_method_has():
    low, high = EFFICIENT
    for row in readme_rows():
        for cell in row[2:]:
            measured = re.fullmatch(r"([\d.]+) \(([\d.]+)\)", cell)
            if measured and not row[1].startswith("(a)"):
                error, best = (float(number) for number in measured.groups())
                assert low < error / best < high, row
