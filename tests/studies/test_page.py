"""The page opens from disk, needs nothing else, and says what the JSON says."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from lsvision.studies.chen_liu_2016 import (
    ExperimentSizes,
    format_readme_table,
    format_report_json,
    page,
    render_report_page,
    run_experiments,
)
from lsvision.studies.chen_liu_2016.paper_pitfalls import Check
from lsvision.studies.chen_liu_2016.report_tables import format_significant

VOID = {"meta", "br", "hr", "img", "link", "path", "use", "stop", "rect", "circle"}
PICTURES = ("tables", "recognition", "screening", "smoothing", "repeatability")
UNITS = ("_mm", "_deg", "seconds")
MAX_PAGE_BYTES = 1_500_000  # bytes: a phone opens it at once


def no_pictures(report):
    """In place of the pictures of a page, which take most of its time."""
    return {**dict.fromkeys(PICTURES, ""), "scenes": [""] * len(report.scenes)}


class Outline(HTMLParser):
    """Tags left open, ids, and addresses that would be fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.fetched, self.tags = [], [], [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.tags.append(tag)
        self.ids += [values["id"]] if "id" in values else []
        self.fetched += [
            value
            for name, value in attrs
            if name in ("src", "href", "xlink:href", "srcset") and not value.startswith("#")
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def html(report):
    return render_report_page(report)


@pytest.fixture(scope="module")
def outline(html):
    parser = Outline()
    parser.feed(html)
    return parser


def test_the_page_fetches_nothing_and_runs_nothing(html, outline):
    assert outline.fetched == []
    assert "script" not in outline.tags
    assert not re.search(r"url\((?!#)|@import", html)
    assert len(html.encode()) < MAX_PAGE_BYTES


def test_the_page_is_well_formed_and_its_ids_are_unique(outline):
    assert outline.open == []
    pictures = [name for name in outline.ids if "-" in name]
    assert len(set(pictures)) == len(pictures)


def test_the_page_suits_a_phone(html, outline):
    assert 'name="viewport"' in html
    assert html.count('<div class="scroll"><table>') == outline.tags.count("table")
    assert not re.search(r'<svg[^>]* width="', html)


def test_every_figure_of_the_paper_is_there(html, outline):
    assert outline.tags.count("svg") == 9
    assert html.count('role="img" aria-label="') == 9
    for name in ("Tables 1-4", "Table 5", "Figures 5-10", "Figures 14 and 15", "Figure 16",
                 "Five traps", "What each step is worth", "Where it is not"):  # fmt: skip
        assert name in html


def test_the_page_is_the_same_each_time(report, html):
    assert render_report_page(report) == html


def leaves(value, key=""):
    if isinstance(value, dict):
        for name, item in value.items():
            yield from leaves(item, f"{key}.{name}")
    elif isinstance(value, list):
        for item in value:
            yield from leaves(item, key)
    else:
        yield key, value


def test_the_json_has_the_pages_numbers_with_their_units(report, html):
    document = json.loads(format_report_json(report))
    assert document["schema"] == "lsvision.paper/1"
    row = document["tables_1_to_4"][0]
    assert format_significant(row["spreads"]["section"]["rms"]["theta_deg"]) in html
    plain = (".figure_16.std", ".figure_16.bound", ".figure_16.box", ".figure_16.expected")
    measured = [key for key, _ in leaves(document) if ".spreads." in key or key.startswith(plain)]
    counts = (".runs", ".missed")
    assert all(key.endswith(UNITS) or key.endswith(counts) for key in measured)


def test_missing_results_are_null_in_the_json_and_a_dash_in_the_page(report):
    document = json.loads(format_report_json(report))
    assert document["tables_1_to_4"][0]["spreads"]["paper"]["rms"]["radius_mm"] is None
    assert format_significant(float("nan")) == "–"


def test_text_is_escaped(report, monkeypatch):
    monkeypatch.setattr(page, "_draw_pictures", no_pictures)
    check = Check("<b>", 1.0)
    pitfall = replace(report.pitfalls[0], title="<script>", wording="&", checks=(check,))
    html = render_report_page(replace(report, pitfalls=(pitfall,)))
    assert "<script>" not in html
    assert "<b>" not in html
    assert "&lt;b&gt;" in html
    assert "&amp; Here:" in html


def test_the_readmes_table_has_a_line_for_each_table_and_method(bounds):
    lines = format_readme_table(bounds).splitlines()
    assert len(lines) == 2 + 4 * 6
    assert all(line.count("|") == 6 for line in lines)


@pytest.mark.parametrize("noise_mm", [0.0, -1.0, 0.5, float("nan")])
def test_noise_out_of_range_is_rejected(noise_mm):
    with pytest.raises(ValueError, match=r"expected noise_mm in \[0.001, 0.3\]"):
        run_experiments(ExperimentSizes.quick(), noise_mm=noise_mm)
