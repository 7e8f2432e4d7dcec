"""Printable files of a target at true scale: page layout in mm, drawn as SVG or PDF."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lsvision.calibration.target import ChArUco, Chessboard, CircleGrid, Target
from lsvision.geometry.arrays import BoolArray

MM_PER_PDF_POINT = 25.4 / 72
"""Unit of PDF. Units: mm."""

BEZIER_CIRCLE_FACTOR = 0.5522847498
"""Distance of the control points of a cubic from its ends, in radii, with which it approximates a
quarter circle to 0.03 % of the radius."""

MARGIN = 10.0
"""White border around the pattern, which the detection needs; beyond it the background may be dark.
Units: mm."""

BAR_LENGTH = 100.0
"""Length of the bar for checking the printer's scale. Units: mm."""

FOOTER_HEIGHT = 14.0
"""Additional height of the border below the pattern, in which bar and text are. The text keeps 5 mm
from the edge of the sheet, on which most printers cannot print. Units: mm."""

PAPERS = ((210.0, 297.0), (297.0, 420.0), (420.0, 594.0), (594.0, 841.0), (841.0, 1189.0))
"""Short and long side of A4 to A0; printers scale a page that is not of a paper size. Units: mm."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Black rectangle; (x, y) is its top left corner. Units: mm."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Disc:
    """Black disc around (x, y). Units: mm."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class PageLayout:
    """Page of black shapes on white; y points down.

    Parameters
    ----------
    width, height : float
        Size of the page. Units: mm.
    shapes : tuple of Rectangle or Disc
        Black shapes.
    text : str
        Line of text below the pattern.
    text_position : tuple of float
        (x, y) of the start of the text's base line. Units: mm.
    """

    width: float
    height: float
    shapes: tuple[Rectangle | Disc, ...]
    text: str
    text_position: tuple[float, float]


def render_target_svg(target: Target) -> str:
    """Return a target as an SVG document at true scale: print it at 100 %, "actual size".

    Examples
    --------
    >>> from lsvision.calibration.target import Chessboard
    >>> svg = render_target_svg(Chessboard(columns=9, rows=6, square=20.0))
    >>> svg.splitlines()[1].split(" viewBox")[0]
    '<svg xmlns="http://www.w3.org/2000/svg" width="297mm" height="210mm"'
    """
    page = lay_out_target(target)
    text_x, text_y = page.text_position
    size = f'width="{page.width:g}mm" height="{page.height:g}mm"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {page.width:g} '
        f'{page.height:g}">',
        f'<rect width="{page.width:g}" height="{page.height:g}" fill="white"/>',
        '<g fill="black">',
        *(
            f'<circle cx="{shape.x:.6g}" cy="{shape.y:.6g}" r="{shape.radius:.6g}"/>'
            for shape in page.shapes
            if isinstance(shape, Disc)
        ),
        # One path: touching squares drawn separately show grey seams.
        f'<path d="{_format_svg_rectangles(page)}"/>',
        "</g>",
        f'<text x="{text_x:g}" y="{text_y:g}" font-family="sans-serif" '
        f'font-size="3.5">{page.text}</text>',
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def render_target_pdf(target: Target) -> bytes:
    """Return a target as a PDF page at true scale; see `render_target_svg`.

    Examples
    --------
    >>> from lsvision.calibration.target import Chessboard
    >>> render_target_pdf(Chessboard())[:8]
    b'%PDF-1.4'
    """
    page = lay_out_target(target)
    scale = 1 / MM_PER_PDF_POINT
    # The origin of PDF is at the bottom left: flip y once for all shapes.
    content = [f"q {scale:.6f} 0 0 {-scale:.6f} 0 {page.height * scale:.4f} cm 0 g"]
    content += [_format_pdf_disc(shape) for shape in page.shapes if isinstance(shape, Disc)]
    # One path, one fill: squares filled separately show grey seams.
    content += [
        f"{shape.x:.5f} {shape.y:.5f} {shape.width:.5f} {shape.height:.5f} re"
        for shape in page.shapes
        if isinstance(shape, Rectangle)
    ]
    text = page.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    x, y = page.text_position[0] * scale, (page.height - page.text_position[1]) * scale
    content += ["f Q", f"BT /F1 10 Tf {x:.3f} {y:.3f} Td ({text}) Tj ET"]
    stream = "\n".join(content)
    box = f"[0 0 {page.width * scale:.4f} {page.height * scale:.4f}]"
    return _build_pdf_file(
        [
            "<< /Type /Catalog /Pages 2 0 R >>",
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
            "/Resources << /Font << /F1 5 0 R >> >> >>",
            f"<< /Length {len(stream)} >>\nstream\n{stream}\nendstream",
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        ]
    )


def _format_svg_rectangles(page: PageLayout) -> str:
    """Return the SVG path of all rectangles."""
    return " ".join(
        f"M{shape.x:.6g} {shape.y:.6g}h{shape.width:.6g}v{shape.height:.6g}h{-shape.width:.6g}z"
        for shape in page.shapes
        if isinstance(shape, Rectangle)
    )


def _format_pdf_disc(disc: Disc) -> str:
    """Return the PDF path of a disc: four cubics."""
    x, y, r = disc.x, disc.y, disc.radius
    k = r * BEZIER_CIRCLE_FACTOR
    quarters = [
        (x + r, y + k, x + k, y + r, x, y + r),
        (x - k, y + r, x - r, y + k, x - r, y),
        (x - r, y - k, x - k, y - r, x, y - r),
        (x + k, y - r, x + r, y - k, x + r, y),
    ]
    curves = " ".join(" ".join(f"{value:.5f}" for value in q) + " c" for q in quarters)
    return f"{x + r:.5f} {y:.5f} m {curves} f"


def _build_pdf_file(objects: Sequence[str]) -> bytes:
    """Return a PDF of numbered objects with its table of byte offsets (PDF 1.4, section 3.4)."""
    file, offsets = b"%PDF-1.4\n", []
    for number, text in enumerate(objects, start=1):
        offsets.append(len(file))
        file += f"{number} 0 obj\n{text}\nendobj\n".encode("latin-1")
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    tail = (
        f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}"
        f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(file)}\n%%EOF\n"
    )
    return file + tail.encode("latin-1")


def lay_out_target(target: Target) -> PageLayout:
    """Return the page of a target of this package, else TypeError, with a bar of 100 mm.

    The bar serves to check the print.
    """
    match target:
        case ChArUco():
            shapes = _list_charuco_squares(target)
            size = (target.squares_x * target.square, target.squares_y * target.square)
            text = (
                f"ChArUco {target.squares_x} x {target.squares_y}, square {target.square:g} mm, "
                f"marker {target.marker:g} mm, {target.dictionary}"
            )
        case Chessboard():
            shapes = _list_checker_squares(target.columns + 1, target.rows + 1, target.square)
            size = ((target.columns + 1) * target.square, (target.rows + 1) * target.square)
            text = (
                f"chessboard {target.columns} x {target.rows} corners, square {target.square:g} mm"
            )
        case CircleGrid():
            points, radius = target.points[:, :2] + target.spacing, target.diameter / 2
            shapes = [Disc(float(x), float(y), radius) for x, y in points]
            size = tuple((points.max(axis=0) + target.spacing).tolist())
            kind = "asymmetric" if target.asymmetric else "symmetric"
            text = (
                f"{kind} circles {target.columns} x {target.rows}, spacing "
                f"{target.spacing:g} mm, diameter {target.diameter:g} mm"
            )
        case _:
            raise TypeError(f"expected a ChArUco, Chessboard or CircleGrid, got {target!r}")
    return _lay_out_page(shapes, size, text)


def _lay_out_page(
    shapes: Sequence[Rectangle | Disc], size: tuple[float, float], text: str
) -> PageLayout:
    """Return the shapes centred on the smallest paper, with bar and text below."""
    width, height = _select_smallest_paper(
        max(size[0], BAR_LENGTH) + 2 * MARGIN, size[1] + 2 * MARGIN + FOOTER_HEIGHT
    )
    left, top = (width - size[0]) / 2, (height - size[1] - FOOTER_HEIGHT) / 2
    centred = [replace(shape, x=shape.x + left, y=shape.y + top) for shape in shapes]
    bar_top = top + size[1] + MARGIN
    bar = [
        Rectangle(MARGIN, bar_top + 2, BAR_LENGTH, 0.4),
        Rectangle(MARGIN, bar_top, 0.2, 4.4),
        Rectangle(MARGIN + BAR_LENGTH - 0.2, bar_top, 0.2, 4.4),
    ]
    text = f"{text}. Print at 100 %; the bar is 100 mm."
    return PageLayout(width, height, (*centred, *bar), text, (MARGIN, bar_top + 8))


def _select_smallest_paper(width: float, height: float) -> tuple[float, float]:
    """Return the smallest paper that fits, either way up; the size itself beyond A0. Units: mm."""
    for short, long in PAPERS:
        for sheet in ((short, long), (long, short)):
            if width <= sheet[0] and height <= sheet[1]:
                return sheet
    return width, height


def _list_checker_squares(
    columns: int, rows: int, edge: float, *, first_is_black: bool = True
) -> list[Rectangle | Disc]:
    """Return the black squares of a chessboard whose top left square is black or white."""
    return [
        Rectangle(column * edge, row * edge, edge, edge)
        for row in range(rows)
        for column in range(columns)
        if ((row + column) % 2 == 0) == first_is_black
    ]


def _list_charuco_squares(target: ChArUco) -> list[Rectangle | Disc]:
    """Return the black squares, and the black cells of the markers in the white ones."""
    board = target.board
    # In the legacy pattern with an even number of rows the top left square is white.
    first_is_black = not (target.legacy and target.squares_y % 2 == 0)
    shapes = _list_checker_squares(
        target.squares_x, target.squares_y, target.square, first_is_black=first_is_black
    )
    dictionary = board.getDictionary()
    cells = dictionary.markerSize + 2  # with the black border of one cell
    edge = target.marker / cells
    for number, corners in zip(board.getIds().ravel(), board.getObjPoints(), strict=True):
        left, top = np.asarray(corners)[:, :2].min(axis=0)
        bits = cv2.aruco.generateImageMarker(dictionary, int(number), cells)
        for row, column, width in _find_black_runs(bits == 0):
            shapes.append(
                Rectangle(float(left) + column * edge, float(top) + row * edge, width * edge, edge)
            )
    return shapes


def _find_black_runs(black: BoolArray) -> list[tuple[int, int, int]]:
    """Return row, column and length of each horizontal run of black cells."""
    runs = []
    for row, line in enumerate(black):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        runs += [(row, int(a), int(b - a)) for a, b in edges.reshape(-1, 2)]
    return runs
