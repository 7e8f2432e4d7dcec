"""The few pieces of HTML that the page is made of."""

import math
from collections.abc import Sequence
from html import escape

STYLE = """
:root{color-scheme:light}
body{margin:0 auto;max-width:44rem;padding:1rem;font:16px/1.5 system-ui,sans-serif;
color:#1a1a1a;background:#fff;overflow-wrap:break-word}
h1{font-size:1.7rem;line-height:1.2}h2{margin-top:2.4rem;border-top:2px solid #ddd;
padding-top:1rem;font-size:1.3rem}h3{font-size:1.05rem;margin-top:1.6rem}
figure{margin:1rem 0}figure svg{width:100%;max-width:36rem;height:auto;display:block;margin:auto}
figcaption{font-size:.9rem;color:#444}
.scroll{overflow-x:auto;margin:0 0 1rem}
table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
p.caption{font-weight:600;font-size:.92rem;margin:1rem 0 .3rem}
th,td{padding:.25rem .55rem;border-bottom:1px solid #ddd;text-align:right;vertical-align:top}
th{background:#f3f3f3;font-weight:600}
td{white-space:nowrap}
td.words,th.words{text-align:left;white-space:normal;min-width:6.5rem}
tr.group th{text-align:left;background:#e9eef3}
td.bad{color:#a33b00;font-weight:600}td.good{color:#00644a;font-weight:600}
.note{background:#f6f4ea;padding:.6rem .9rem;border-left:4px solid #c9b458}
dt{font-weight:600}dd{margin:0 0 .5rem 1rem}code{font-size:.9em}
"""


def page(title: str, body: Sequence[str]) -> str:
    """A whole document that needs nothing but itself.

    Parameters
    ----------
    title : str
        Of the window and the first heading.
    body : sequence of str
        Pieces of HTML, in order.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def heading(text: str, level: int = 2) -> str:
    """A heading; its anchor is its first word."""
    anchor = escape("".join(c for c in text.lower() if c.isalnum() or c == " ").replace(" ", "-"))
    return f'<h{level} id="{anchor}">{escape(text)}</h{level}>'


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def note(text: str) -> str:
    """A paragraph that stands out."""
    return f'<p class="note">{escape(text)}</p>'


def bullets(items: Sequence[tuple[str, str]]) -> str:
    """A list, the first words of each item in bold."""
    rows = [f"<li><strong>{escape(head)}</strong> {escape(text)}</li>" for head, text in items]
    return "<ul>\n" + "\n".join(rows) + "\n</ul>"


def definitions(items: Sequence[tuple[str, str]]) -> str:
    """Words and what they mean."""
    rows = [f"<dt>{escape(word)}</dt><dd>{escape(text)}</dd>" for word, text in items]
    return "<dl>\n" + "\n".join(rows) + "\n</dl>"


def figure(svg: str, caption: str) -> str:
    """A picture with its caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """A table that scrolls by itself where the screen is narrow.

    Parameters
    ----------
    caption : str
        Above it.
    head : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells; a row of one cell is a heading across all columns. A cell that starts with
        ``+`` or ``!`` and a space is marked good or bad.
    words : int
        How many columns, from the left, hold words.
    """
    top = "".join(_cell("th", text, "words" if n < words else "") for n, text in enumerate(head))
    lines = [_row(row, len(head), words) for row in rows]
    return (
        # The caption stands outside what scrolls, so that a phone breaks its lines.
        f'<p class="caption">{escape(caption)}</p><div class="scroll"><table>'
        f"<thead><tr>{top}</tr></thead><tbody>\n" + "\n".join(lines) + "\n</tbody></table></div>"
    )


def digits(value: float, count: int = 2) -> str:
    """A number with so many significant digits and no exponent; a dash where there is none.

    Examples
    --------
    >>> digits(0.01234), digits(12.6), digits(123.4), digits(float("nan"))
    ('0.012', '13', '123', '–')
    """
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    places = max(count - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{places}f}"


def _row(row: Sequence[str], columns: int, words: int) -> str:
    if len(row) == 1:
        return f'<tr class="group"><th colspan="{columns}">{escape(row[0])}</th></tr>'
    cells = [_cell("td", text, "words" if n < words else "") for n, text in enumerate(row)]
    return "<tr>" + "".join(cells) + "</tr>"


def _cell(tag: str, text: str, kind: str) -> str:
    marks = {"! ": "bad", "+ ": "good"}
    if text[:2] in marks:
        kind, text = marks[text[:2]], text[2:]
    return (
        f'<{tag} class="{kind}">{escape(text)}</{tag}>'
        if kind
        else f"<{tag}>{escape(text)}</{tag}>"
    )
