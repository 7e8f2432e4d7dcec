"""Titles of figures: every character has a glyph, and no glyph is left out."""

import pytest

from lsvision.draw.figures import create_figure, make_printable, render_figure


@pytest.mark.parametrize("title", ["Rohr – links.csv", "„Ø 40 €“ ≥ 3 → A…", "φ µm ×", "труба.csv"])
def test_characters_of_the_font_are_kept(title):
    assert make_printable(title) == title


@pytest.mark.parametrize("title", ["管.csv", "a\u200eb", "\udcff", "a\nb"])
def test_characters_without_a_glyph_are_question_marks(title):
    shown = make_printable(title)
    assert len(shown) == len(title)
    assert shown.count("?") == 1


def test_all_characters_are_drawn_without_a_warning():
    """A warning of a missing glyph is an error here."""
    figure = create_figure((4.0, 3.0))
    for first in range(0x20, 0x3000, 512):
        text = "".join(make_printable(chr(code)) for code in range(first, first + 512))
        figure.text(0.0, 0.5, text, parse_math=False)
    assert render_figure(figure, "png").startswith(b"\x89PNG")
