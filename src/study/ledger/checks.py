"""Checks that a claim writes as an expression: the worst value that tables give, against a bound.

    check: ledger.worst
    parameters:
      table: "{scene}/infsup"
      scenes: [square, lshape]
      value: beta_lower / beta_upper
      where: h_over_H < 1
      rows: "{scene}, H = {H:g}"
      at_least: 0.5
      quantity: the smallest quotient

An expression is Python over a table's variables and coordinates, and numpy as `np`; xarray evaluates it, with
`and`, `or` and `not` element by element. It can do whatever Python can, and so it stands in files of this
package, in no user's. A check that is more than an expression is a function of its experiment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from study import evidence
from study import tables as stored
from study.evidence import Evidence, Tables, name_values, named_dimensions
from unilateral.errors import InputError


def worst(
    tables: Tables,
    table: str,
    value: str | Sequence[str] | Mapping[str, str],
    quantity: str,
    at_least: float | None = None,
    at_most: float | None = None,
    scenes: Sequence[str] = ("",),
    cases: Sequence[str] | None = None,
    select: Mapping[str, Any] | None = None,
    H_over_h: float | None = None,
    let: Mapping[str, str] | None = None,
    where: str = "",
    left_out: bool = False,
    rows: str = "{scene}",
) -> Evidence:
    """The smallest of the values against `at_least`, or the largest against `at_most`.

    `value` may be several expressions by names, which the coordinate `variable` then has. It is taken of the
    `table` of each scene: of those of the `cases` that are in it, sorted; at the labels of `select`; over
    `run`, the levels with that H/h. `let` gives names to expressions.

    `rows` names the values by coordinates and by `scene`, which is the table's name if there are no scenes.
    In a row the worst value counts of those that are known and are not excluded by `where`. If there is none
    the row is not known; if all are excluded it may be `left_out`. Raises InputError without a bound.
    """
    smallest, required = (True, at_least) if at_most is None else (False, at_most)
    if required is None:
        raise InputError(f"the check of {value!r} has no bound; it needs at_least or at_most")
    named: dict[str, float] = {}
    for scene in scenes:
        name = table.format(scene=scene)
        data = _define_variables(_select_data(tables[name], cases, select, H_over_h), let or {})
        values = _evaluate(data, value)
        counts = _evaluate(data, where) if where else xr.ones_like(values, dtype=bool)
        row_values, has_values = _find_worst_by_row(values, counts, rows, smallest)
        worst_by_row = name_values(row_values, rows, scene or name)
        counted = name_values(has_values, rows, scene or name)
        named |= {row: worst_by_row[row] for row in worst_by_row if counted[row] or not left_out}
    return evidence.pick_worst(named, quantity, required, smallest)


def _find_worst_by_row(
    values: xr.DataArray, counts: xr.DataArray, rows: str, smallest: bool
) -> tuple[xr.DataArray, xr.DataArray]:
    """The worst of the values that count in each row, and whether any does; `rows` names the coordinates."""
    # What is excluded is NaN, which min and max pass over; a row of these alone is NaN
    values, counts = xr.broadcast(values.where(counts), counts)
    row_dims = [dim for dim in values.dims if dim not in named_dimensions(values, rows)]
    row_values = values.min(row_dims) if smallest else values.max(row_dims)
    return row_values, counts.any(row_dims)


def all_of(tables: Tables, statements: Sequence[Mapping[str, Any]], **shared: Any) -> Evidence:
    """The evidence for a statement in parts, each as for `worst`; they share the other parameters."""
    return evidence.require_all(*(worst(tables, **{**shared, **statement}) for statement in statements))


def _select_data(
    table: xr.Dataset, cases: Sequence[str] | None, select: Mapping[str, Any] | None, H_over_h: float | None
) -> xr.Dataset:
    """The part of a table that a check is about."""
    if cases is not None:
        table = table.sel(case=sorted(set(cases) & set(table["case"].values)))
    if select is not None:
        table = table.sel(select)
    return table if H_over_h is None else stored.select_ratio(table, 1 / H_over_h)


def _define_variables(data: xr.Dataset, expressions: Mapping[str, str]) -> xr.Dataset:
    """The data with the values of expressions by their names; each may use those before it."""
    for variable, text in expressions.items():
        data = data.assign({variable: _evaluate(data, text)})
    return data


def _evaluate(data: xr.Dataset, value: str | Sequence[str] | Mapping[str, str]) -> xr.DataArray:
    if isinstance(value, str):
        return xr.DataArray(data.eval(value))
    expressions = value if isinstance(value, Mapping) else dict(zip(value, value, strict=True))
    return xr.Dataset({name: _evaluate(data, text) for name, text in expressions.items()}).to_dataarray()
