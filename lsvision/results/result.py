"""Base class of results: short repr, table, notebook view, records and data frames."""

import json
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from lsvision.geometry.equality import ComparedByValue
from lsvision.results.html import build_html_environment
from lsvision.results.quantities import Record, flatten_record
from lsvision.results.tables import Cells, format_text_table

if TYPE_CHECKING:
    import pandas as pd


class Result(ComparedByValue, ABC):
    """Base class of results, which have the same numbers on screen, in a notebook and in files.

    ``repr(result)`` is one line, ``print(result)`` writes a table; a notebook shows the table and,
    for measurements, a small picture. Results of one class are equal if their fields are equal,
    arrays number by number.
    """

    __slots__ = ()

    @abstractmethod
    def to_dict(self) -> Record:
        """Return the result as plain numbers and text, ready for JSON.

        Returns
        -------
        dict
            The key of a number that has a unit ends in it: ``*_mm``, ``*_deg``, ``*_px``. A number
            that is not finite, such as an infinite standard deviation, is None.

        Examples
        --------
        >>> import lsvision as lsv
        >>> lsv.plan_section(19.0, 0.3, 0.35).to_dict()["points"]
        97
        """

    def to_json(self, indent: int | None = None) -> str:
        """Return `to_dict` as JSON text.

        Parameters
        ----------
        indent : int, optional
            Number of spaces by which nested levels are indented; None writes one line.

        Returns
        -------
        str
            JSON (RFC 8259: without NaN and infinity).

        Raises
        ------
        TypeError
            If `indent` is not an integer, such as the name of a file.

        Examples
        --------
        >>> import json
        >>> import lsvision as lsv
        >>> json.loads(lsv.plan_section(19.0, 0.3, 0.35).to_json())["points"]
        97
        """
        if not (indent is None or isinstance(indent, int)):
            raise TypeError(
                f"expected indent as a number of spaces, got {indent!r}: "
                "pathlib.Path(name).write_text(result.to_json()) writes a file"
            )
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the numbers as a pandas data frame, one row for each cylinder (or other item).

        Returns
        -------
        pandas.DataFrame
            Columns with the names of the keys of `to_dict`; of a `Measurement` and a `Verdict` they
            are columns of ``--csv``. An interval has two, ``*_low_95_*`` and ``*_high_95_*``; in a
            study ``*_low`` and ``*_high``, at its level.

        Raises
        ------
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> import lsvision as lsv
        >>> lsv.plan_section(19.0, 0.3, 0.35).to_dataframe().shape
        (1, 6)
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError(
                "to_dataframe needs pandas, which is not installed: pip install "
                "'lsvision[dataframe]'"
            ) from error
        return pd.DataFrame(self._list_rows())

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._summarise()}>"

    def __str__(self) -> str:
        return "\n".join(self._format_lines())

    def _repr_html_(self) -> str:
        """Return the table and a small picture, for notebooks."""
        return (
            build_html_environment()
            .get_template("result.html.j2")
            .render(rows=self._list_cells(), notes=self._list_notes(), picture=self._draw_picture())
        )

    @abstractmethod
    def _summarise(self) -> str:
        """Return the text of the repr after the name of the class."""

    @abstractmethod
    def _list_cells(self) -> Cells:
        """Return the rows of the table, the first its header; empty or only that if it has none."""

    def _list_notes(self) -> list[str]:
        """Return the lines below the table."""
        return []

    def _format_lines(self) -> list[str]:
        """Return the printed lines: the table, and the notes below it."""
        rows = self._list_cells()
        return [*(format_text_table(rows) if len(rows) > 1 else []), *self._list_notes()]

    def _list_rows(self) -> list[Record]:
        """Return the rows of the data frame."""
        return [flatten_record(self.to_dict())]

    def _draw_picture(self) -> str:
        """Return an ``<svg>`` element, or an empty text if there is nothing to draw."""
        return ""
