"""What is given on the sides of a polygon, formulas or values at nodes, as Taylor models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import add

import numpy as np

from unilateral.arrays import Index
from unilateral.formulas.derivative import derivative
from unilateral.formulas.expression import Expression
from unilateral.formulas.taylor import TaylorModel, join_models, number_model
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.geometry.polygon import Polygon
from unilateral.problems.nodal import NodalTrace

SideData = Expression | NodalTrace
"""What is given on a side: a formula, or values at nodes."""


def side_coordinates(polygon: Polygon, side: Index, t: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
    """x and y on intervals of the sides (k,), t the arc length in side lengths."""
    # x = a + t e on the side from a along e
    start_x, start_y = polygon.vertices[side].T
    along_x, along_y = polygon.edges[side].T
    x = number_model(t, start_x) + number_model(t, along_x) * t
    y = number_model(t, start_y) + number_model(t, along_y) * t
    return x, y


def model_side_data(
    data: Sequence[SideData], side: Index, variables: Mapping[str, TaylorModel]
) -> TaylorModel:
    """The data, one per side, on intervals of the sides (k,); equal formulas are evaluated together.

    Formulas are in the `variables`; values at nodes are over t, the arc length in side lengths.
    """
    same: dict[SideData, list[int]] = {}
    for i in np.unique(side).tolist():
        same.setdefault(data[i], []).append(i)
    pieces = []
    for function, sides in same.items():
        rows = np.flatnonzero(np.isin(side, sides))
        models = {name: model.select_boxes(rows) for name, model in variables.items()}
        if isinstance(function, NodalTrace):
            pieces.append((function.value_model(models["t"]), rows))
        else:
            pieces.append((enclose_formula(function, models), rows))
    return join_models(pieces)


def model_side_slopes(data: Sequence[SideData], polygon: Polygon, side: Index, t: TaylorModel) -> TaylorModel:
    """The derivatives by t of the data, formulas in x and y, on intervals of the sides (k,)."""
    pieces = []
    for i in np.unique(side).tolist():
        function = data[i]
        rows = np.flatnonzero(side == i)
        if isinstance(function, NodalTrace):
            pieces.append((function.slope_model(t.select_boxes(rows)), rows))
            continue
        variables = dict(zip("xy", side_coordinates(polygon, side[rows], t.select_boxes(rows)), strict=True))
        along = zip("xy", polygon.edges[i], strict=True)
        # d/dt of F(a + t e) is e_x F_x + e_y F_y
        slopes = (enclose_formula(derivative(function, z), variables).scale(e) for z, e in along)
        pieces.append((reduce(add, slopes), rows))
    return join_models(pieces)
