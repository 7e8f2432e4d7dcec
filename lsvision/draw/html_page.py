"""A page of HTML that holds all it shows: no network, no script, pictures as inline SVG."""

import html
from collections.abc import Sequence

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem;
  padding: 0 1rem; color: #1b1b1b; background: #fff }
h1 { font-size: 1.5rem; margin-bottom: .2rem } h2 { font-size: 1.1rem; margin-top: 2rem }
table { border-collapse: collapse } td, th { padding: .15rem 1rem .15rem 0; text-align: left }
td:nth-child(n+2) { font-variant-numeric: tabular-nums }
tr { border-bottom: 1px solid #ddd }
.doubt { border-left: 4px solid #d55e00; padding: .2rem .8rem; background: #fff4ec }
.fine { border-left: 4px solid #009e73; padding: .2rem .8rem; background: #eefaf5 }
figure { margin: 1rem 0 } figcaption { color: #444 } svg { max-width: 100%; height: auto }
footer { margin-top: 2rem; color: #555; font-size: .85rem; overflow-wrap: anywhere }
"""


def html_page(title: str, parts: Sequence[str]) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
        Plain text.
    parts : sequence of str
        HTML, as the other functions of this module make it.

    Examples
    --------
    >>> html_page("A < B", [paragraph("so & so")]).splitlines()[-2]
    '<p>so &amp; so</p>'
    """
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width">',
            f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>",
            f"<h1>{html.escape(title)}</h1>",
            *parts,
            "</body></html>",
            "",
        ]
    )


def heading(text: str) -> str:
    """A heading of plain text."""
    return f"<h2>{html.escape(text)}</h2>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text; `kind` is ``doubt``, ``fine`` or nothing."""
    marked = f' class="{kind}"' if kind else ""
    return f"<p{marked}>{html.escape(text)}</p>"


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = ()) -> str:
    """A table of plain text."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    lines = [f"<tr>{head}</tr>"] if header else []
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>")
    return "\n".join(["<table>", *lines, "</table>"])


def picture(svg: bytes, caption: str) -> str:
    """An SVG file as a part of the page, with a caption of plain text."""
    text = svg.decode("utf-8")
    drawing = text[text.index("<svg") :]
    return f"<figure>{drawing}<figcaption>{html.escape(caption)}</figcaption></figure>"


def footer(lines: Sequence[str]) -> str:
    """Small print of plain text."""
    return "<footer>" + "<br>".join(html.escape(line) for line in lines) + "</footer>"
