"""A target to print at true scale: SVG or PDF, vectors only."""

from collections.abc import Sequence

from lsvision.calibration.target import Target
from lsvision.calibration.target_layout import Disc, PageLayout, Rectangle, layout_target

MM_PER_PDF_POINT = 25.4 / 72
"""mm; PDF's unit."""

BEZIER_CIRCLE_FACTOR = 0.5522847498
"""Control length of the cubic that draws a quarter of a circle to 0.03 % of its radius."""


def target_svg(target: Target) -> str:
    """Draw a target as SVG at true scale.

    Parameters
    ----------
    target : Target
        The board.

    Returns
    -------
    str
        An SVG document whose size is given in mm; print it at 100 %, "actual size".

    Examples
    --------
    >>> from lsvision.calibration.target import Chessboard
    >>> svg = target_svg(Chessboard(columns=9, rows=6, square=20.0))
    >>> svg.splitlines()[1].split(" viewBox")[0]
    '<svg xmlns="http://www.w3.org/2000/svg" width="297mm" height="210mm"'
    """
    page = layout_target(target)
    size = f'width="{page.width:g}mm" height="{page.height:g}mm"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {page.width:g} '
        f'{page.height:g}">',
        f'<rect width="{page.width:g}" height="{page.height:g}" fill="white"/>',
        '<g fill="black">',
        *(_svg_disc(shape) for shape in page.shapes if isinstance(shape, Disc)),
        # One path: touching squares drawn one by one would show grey seams.
        f'<path d="{_svg_squares(page)}"/>',
        "</g>",
        f'<text x="{page.text_at[0]:g}" y="{page.text_at[1]:g}" font-family="sans-serif" '
        f'font-size="3.5">{page.text}</text>',
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def target_pdf(target: Target) -> bytes:
    """Draw a target as a PDF page at true scale.

    Parameters
    ----------
    target : Target
        The board.

    Returns
    -------
    bytes
        A PDF of one page; print it at 100 %, "actual size".

    Examples
    --------
    >>> from lsvision.calibration.target import Chessboard
    >>> target_pdf(Chessboard())[:8]
    b'%PDF-1.4'
    """
    page = layout_target(target)
    scale = 1 / MM_PER_PDF_POINT
    # PDF counts from the bottom left: turn y over once for all shapes.
    content = [f"q {scale:.6f} 0 0 {-scale:.6f} 0 {page.height * scale:.4f} cm 0 g"]
    content += [_pdf_disc(shape) for shape in page.shapes if isinstance(shape, Disc)]
    # One path, one fill: squares filled one by one would show grey seams.
    content += [_pdf_square(shape) for shape in page.shapes if isinstance(shape, Rectangle)]
    text = page.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    x, y = page.text_at[0] * scale, (page.height - page.text_at[1]) * scale
    content += ["f Q", f"BT /F1 10 Tf {x:.3f} {y:.3f} Td ({text}) Tj ET"]
    stream = "\n".join(content)
    box = f"[0 0 {page.width * scale:.4f} {page.height * scale:.4f}]"
    return _pdf_file(
        [
            "<< /Type /Catalog /Pages 2 0 R >>",
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
            "/Resources << /Font << /F1 5 0 R >> >> >>",
            f"<< /Length {len(stream)} >>\nstream\n{stream}\nendstream",
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        ]
    )


def _svg_disc(disc: Disc) -> str:
    return f'<circle cx="{disc.x:.6g}" cy="{disc.y:.6g}" r="{disc.radius:.6g}"/>'


def _svg_squares(page: PageLayout) -> str:
    return " ".join(
        f"M{shape.x:.6g} {shape.y:.6g}h{shape.width:.6g}v{shape.height:.6g}h{-shape.width:.6g}z"
        for shape in page.shapes
        if isinstance(shape, Rectangle)
    )


def _pdf_square(shape: Rectangle) -> str:
    return f"{shape.x:.5f} {shape.y:.5f} {shape.width:.5f} {shape.height:.5f} re"


def _pdf_disc(disc: Disc) -> str:
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


def _pdf_file(objects: Sequence[str]) -> bytes:
    """A PDF of numbered objects with its table of byte offsets (PDF 1.4, section 3.4)."""
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
