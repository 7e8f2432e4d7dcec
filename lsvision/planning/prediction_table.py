"""Predictions as a table: what stands in their records, with two digits of each sigma."""

from lsvision.results.number_format import format_std
from lsvision.results.quantities import Record


def cells_of_stds(record: Record) -> list[tuple[str, ...]]:
    """Cells of a table: a header and one row.

    Examples
    --------
    >>> cells_of_stds({"radius_std_mm": 0.3912, "points": 56})
    [('± radius mm', 'points'), ('0.39', '56')]
    """
    named = [(_heading(key), _number(key, value)) for key, value in record.items()]
    header, row = zip(*named, strict=True)
    return [tuple(header), tuple(row)]


def summary_of_stds(record: Record) -> str:
    """One line with all of it.

    Examples
    --------
    >>> summary_of_stds({"radius_std_mm": 0.3912, "points": 56})
    'one sigma: radius 0.39 mm, points 56'
    """
    words = []
    for key, value in record.items():
        name, *unit = _heading(key).removeprefix("± ").rsplit(" ", 1)
        if not key.endswith(("_mm", "_deg")):
            name, unit = _heading(key), []
        words.append(" ".join([name, _number(key, value), *unit]))
    return f"one sigma: {', '.join(words)}"


def _heading(key: str) -> str:
    name = key.replace("_std_", "_").replace("_", " ")
    return f"± {name}" if "_std_" in key else name


def _number(key: str, value: float) -> str:
    return format_std(value) if "_std_" in key else f"{value:g}"
