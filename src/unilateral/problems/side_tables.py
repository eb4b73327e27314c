"""g, u and q as tables on a side: rows of a distance s along it and a value, linear in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import MAX_INPUT_VALUE, Array, read_floats
from unilateral.errors import InputError, pluralise, quote_input
from unilateral.formulas.taylor import EPS
from unilateral.problems.nodal import NodalTrace
from unilateral.system.columns import MAX_COLUMN_ROWS, read_columns

TABLE_PLACE_ROUNDING = 16 * EPS
"""Places s over the length of a side are rounded by less: s, the length and their quotient are."""
END_TOLERANCE = 1e-5
"""A table's first and last s may be off 0 and the side's length by this part of it, for users who round."""
MIN_ROW_DISTANCE = 1e-9
"""The least distance between two rows, as a part of the side."""
TABLE_NEEDED = "a table is {table: surface.csv}, or in Python (s, values), two arrays of one length"
TABLE_SIDE_NEEDED = "a table is that of one side, as in {1: {table: surface.csv}}"


@dataclass(frozen=True, eq=False)
class SideTable(NodalTrace):
    """The function of a table on a side, whose nodes are the table's rows and are no nodes of a mesh."""


class TableRows(NamedTuple):
    """A table as it is given: its places s (k,) and values (k,), and the `lines` (k,) of its `source`.

    The source is a file, or the place of two arrays, which have no lines.
    """

    s: Array
    values: Array
    source: str
    lines: list[int] | None

    def name_row(self, row: int) -> str:
        """The row, as messages name it."""
        return f"{self.source}, {f'row {row}' if self.lines is None else f'line {self.lines[row]}'}"


def is_table(data: object) -> bool:
    """Whether a table is given: a mapping to a file, or a pair of arrays."""
    return isinstance(data, Mapping) or (isinstance(data, tuple) and len(data) == 2)


def read_table(data: Any, where: str) -> TableRows:
    """The table that is given as {"table": file} or as (s, values). Raises InputError for what is none."""
    if isinstance(data, Mapping):
        if {*data} != {"table"} or not isinstance(data["table"], str | PathLike):
            raise InputError(f"{where}: it is {quote_input(repr(dict(data)))}; {TABLE_NEEDED}")
        rows, lines = read_columns(data["table"], where, "s and a value")
        return TableRows(rows[:, 0], rows[:, 1], str(data["table"]), lines)
    s = read_floats(data[0], f"{where}, s", TABLE_NEEDED)
    values = read_floats(data[1], f"{where}, values", TABLE_NEEDED)
    if s.ndim != 1 or s.shape != values.shape:
        raise InputError(f"{where}: s has the shape {s.shape}, the values {values.shape}; {TABLE_NEEDED}")
    if len(s) > MAX_COLUMN_ROWS:
        raise InputError(f"{where}: it has {len(s)} rows; at most {MAX_COLUMN_ROWS} are read")
    return TableRows(s, values, where, None)


def make_table(table: TableRows, side: int, length: float) -> SideTable:
    """The function of a table on a side of that length. Raises InputError, with the row, for what is none.

    The rows' s have to grow from 0 to the length. A step, two rows at one s, is refused.
    """
    s = table.s
    if len(s) < 2:
        raise InputError(
            f"{table.source}: it has {pluralise(len(s), 'row')}; a table has one at each end of the side"
        )
    for values in (s, table.values):
        wrong = np.flatnonzero(~(np.abs(values) <= MAX_INPUT_VALUE))
        if wrong.size:
            value = values[wrong[0]]
            raise InputError(f"{table.name_row(wrong[0])}: {value:g} is no number up to {MAX_INPUT_VALUE:g}")
    for row, end in ((0, 0.0), (-1, length)):
        if abs(s[row] - end) > END_TOLERANCE * length:
            raise InputError(
                f"{table.name_row(row % len(s))}: it has s = {s[row]:.9g}, but s is the distance along side "
                f"{side} from its first vertex, and has to go from 0 to its length, {length:.9g}"
            )
    t = s / length
    t[0] = 0.0
    t[-1] = 1.0
    close = np.flatnonzero(~(np.diff(t) >= MIN_ROW_DISTANCE))
    if close.size:
        raise InputError(
            f"{table.name_row(close[0] + 1)}: {_explain_close_rows(table, int(close[0]), length)}"
        )
    return SideTable(t, table.values, TABLE_PLACE_ROUNDING)


def _explain_close_rows(table: TableRows, row: int, length: float) -> str:
    """Words on a row whose s does not grow beyond that of the row before."""
    before, after = table.s[row : row + 2].tolist()
    if after < before - MIN_ROW_DISTANCE * length:
        return f"s falls from {before:.9g} to {after:.9g}; the rows have to be in the order of s"
    values = table.values[row : row + 2]
    if values[0] == values[1]:
        return f"s = {after:.9g} is given twice; give it once"
    # a function with a step is not in H^{1/2}, and the trace of no u with a finite energy
    return (
        f"at s = {after:.9g} there is a step from {values[0]:.6g} to {values[1]:.6g}, but data have to be in "
        "H^(1/2), whose functions have no steps; write a steep ramp: move one of the two rows by the width "
        "over which the surface rises, such as the radius of its edge (at least "
        f"{MIN_ROW_DISTANCE * length:.1g})"
    )
