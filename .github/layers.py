"""Draw the layers of the packages: ``python .github/layers.py`` writes layers.svg beside itself.

Layers come from the import-linter contract in pyproject.toml, the words below each name from the
first sentence of the package's docstring. A test compares the file with what this script draws.
"""

import ast
import html
import textwrap
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURE = Path(__file__).with_name("layers.svg")
WIDTH, LEFT, GAP, PADDING = 900, 40, 10, 10
NAME_LINE, TEXT_LINE, CHARACTER = 18, 14, 6.1
"""Heights of lines, and mean width of a character of the small text. Units: px."""
STYLE = (
    "text{font-family:sans-serif;font-size:11px;fill:#333}"
    ".name{font-family:monospace;font-size:14px;font-weight:bold;fill:#0072B2}"
    "rect{fill:#f6f8fa;stroke:#8c959f}path{stroke:#57606a;fill:none}"
)


def read_layers() -> list[list[str]]:
    """Names of the packages of each layer, the top one first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [[name.strip().split(".")[1] for name in layer.split("|")] for layer in layers]


def read_purpose(package: str) -> str:
    """First line of the docstring of a package or module, without its markup."""
    path = ROOT / "lsvision" / package / "__init__.py"
    path = path if path.exists() else ROOT / "lsvision" / f"{package}.py"
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return docstring.split("\n\n")[0].replace("\n", " ").replace("``", "")


def draw_layers() -> str:
    """The picture as SVG: a row of boxes for each layer."""
    parts, top = [], PADDING
    for layer in read_layers():
        width = (WIDTH - LEFT - PADDING - GAP * (len(layer) - 1)) / len(layer)
        columns = int((width - 2 * PADDING) / CHARACTER)
        texts = [textwrap.wrap(read_purpose(package), columns) for package in layer]
        height = 2 * PADDING + NAME_LINE + TEXT_LINE * max(map(len, texts)) - 4
        for place, (package, lines) in enumerate(zip(layer, texts, strict=True)):
            left = LEFT + place * (width + GAP)
            parts += _draw_box(package, lines, (left, top, width, height))
        top += height + GAP
    arrow = f"M{LEFT / 2} {PADDING}V{top - GAP}m-6 -10l6 10l6 -10"
    middle = top / 2
    parts.append(f'<path d="{arrow}"/>')
    parts.append(
        f'<text x="{LEFT / 2 - 6}" y="{middle}" transform="rotate(-90 {LEFT / 2 - 6} {middle})" '
        'text-anchor="middle">imports only downwards</text>'
    )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {top}" role="img" '
        'aria-label="Layers of the packages of lsvision">'
    )
    ground = f'<rect width="{WIDTH}" height="{top}" style="fill:#fff;stroke:none"/>'
    return "\n".join([head, f"<style>{STYLE}</style>", ground, *parts, "</svg>", ""])


def _draw_box(package: str, lines: list[str], box: tuple[float, float, float, float]) -> list[str]:
    left, top, width, height = box
    x, y = left + PADDING, top + PADDING + NAME_LINE - 6
    return [
        f'<rect x="{left:.1f}" y="{top}" width="{width:.1f}" height="{height}" rx="4"/>',
        f'<text class="name" x="{x:.1f}" y="{y}">{package}</text>',
        *(
            f'<text x="{x:.1f}" y="{y + TEXT_LINE * number}">{html.escape(line)}</text>'
            for number, line in enumerate(lines, 1)
        ),
    ]


if __name__ == "__main__":
    PICTURE.write_text(draw_layers(), encoding="utf-8")
