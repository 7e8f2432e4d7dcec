"""A table of numbers in a file: a list of points, or a matrix of heights."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_cells import InvalidCell
from lsvision.io.profiles.unit_statements import UnitStatement
from lsvision.io.profiles.units import StatedUnit, split_label


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Table of numbers in a file of any format, with what the file states on them.

    Parameters
    ----------
    values : (n, k) ndarray
        NaN where a cell is empty or holds a word for a lost point.
    names : tuple of str
        Lower-case name of each column without its unit; empty where the file has no header.
    units : tuple of (StatedUnit or None)
        Unit that the header states for each column, or None; empty stands for no unit.
    statements : tuple of UnitStatement
        Units that the file states elsewhere.
    texts : mapping of int to sequence of str
        Cells of the columns that hold text.
    invalid_cells : mapping of int to InvalidCell
        First cell that is not a number in each column that has one; `InvalidCell.row` is the
        number of its line in the file.
    lost : tuple of float
        Markers of lost points that the file states.
    notes : tuple of str
        Omissions, as text for users.
    limits : tuple of float
        Limits of the data type in which the numbers were stored.
    mentions : tuple of str
        Lines of text beside the numbers, which may mention a unit in other words.
    """

    values: FloatArray
    names: tuple[str, ...] = ()
    units: tuple[StatedUnit | None, ...] = ()
    statements: tuple[UnitStatement, ...] = ()
    texts: Mapping[int, Sequence[str]] = field(default_factory=dict)
    invalid_cells: Mapping[int, InvalidCell] = field(default_factory=dict)
    lost: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    limits: tuple[float, ...] = ()
    mentions: tuple[str, ...] = ()

    @classmethod
    def of_points(cls, rows: FloatArray, statements: tuple[UnitStatement, ...] = ()) -> Self:
        """Return the table of points x, z or x, y, z; rows of another length have no names."""
        count = rows.shape[1]
        names = {2: ("x", "z"), 3: ("x", "y", "z")}.get(count, ())
        return cls(rows, names, (None,) * count, statements)

    @classmethod
    def of_heights(
        cls, rows: FloatArray, label: str, statements: tuple[UnitStatement, ...] = ()
    ) -> Self:
        """Return the table of rows of heights; the label, with its unit, is that of all columns."""
        name, unit = split_label(label)
        count = rows.shape[1]
        return cls(rows, (name,) * count if name else (), (unit,) * count, statements)

    def label(self, column: int) -> str:
        """Return the name of a column, or its number if it has none."""
        return (self.names[column] if self.names else "") or str(column)
