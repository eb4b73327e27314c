"""A solution as tables: the cells of the boundary, and all of it by the CF conventions."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.geometry.partition import Partition
from unilateral.solution.bounds import bound_errors
from unilateral.system.optional import require

if TYPE_CHECKING:
    import xarray as xr

    from unilateral.solution.solution import Solution

TableColumns = Mapping[str, Array | Index]
LONG_NAMES = {
    "u": "u_h at the nodes",
    "x": "x of the nodes",
    "y": "y of the nodes",
    "triangles": "nodes of the triangles, from 0",
    "side": "side of the polygon, from 0",
    "start": "arc length of the start of the cell",
    "end": "arc length of the end of the cell",
    "x_start": "x of the start of the cell",
    "y_start": "y of the start of the cell",
    "x_end": "x of the end of the cell",
    "y_end": "y of the end of the cell",
    "multiplier": "lambda_H on the cell; missing on clamped sides",
    "gap": "mean of u_h - g on the cell",
    "certain": "1 where the exact solution touches for certain, -1 where it does not, else 0",
}


def make_cell_columns(partition: Partition, **values: Array) -> TableColumns:
    """Columns (m,) of the cells: side, the arc lengths and places of both ends, and the `values` on them."""
    s = partition.points
    (start, end) = partition.ends
    return {
        "side": partition.side,
        "start": s[:-1],
        "end": s[1:],
        "x_start": start[:, 0],
        "y_start": start[:, 1],
        "x_end": end[:, 0],
        "y_end": end[:, 1],
        **values,
    }


def write_csv(columns: TableColumns, path: Path) -> None:
    """Writes columns (m,), each number with all its digits, and nothing for NaN."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        # NaN alone differs from itself
        writer.writerows([["" if value != value else value for value in row] for row in rows])


def solution_cell_columns(solution: Solution) -> TableColumns:
    """The columns of the cells of a solution, with lambda_H, the means of u_h - g, and certain contact."""
    return make_cell_columns(
        solution.partition,
        multiplier=solution.multiplier,
        gap=solution.gap,
        certain=solution.contact.certain_cells,
    )


def make_dataset(solution: Solution) -> xr.Dataset:
    """u_h on its mesh, and the columns of the cells, by the CF conventions."""
    require("datasets need", "xarray")
    import xarray as xr

    mesh = solution.mesh
    cell_columns = solution_cell_columns(solution)
    attributes = {"h": mesh.h, "H": solution.partition.H}
    if not solution.solved.is_foreign:
        attributes["algebraic_bound"] = solution.solved.result.bound
    if bounds := bound_errors(solution, sharp=False):
        attributes |= {"h1_bound": bounds.u, "hm12_bound": bounds.multiplier}
    columns = {name: ("cell", column) for name, column in cell_columns.items()}
    dataset = xr.Dataset(
        {
            "u": ("node", solution.u),
            "triangles": (("triangle", "corner"), mesh.triangles.astype(np.int32)),
            **columns,
            "side": ("cell", cell_columns["side"].astype(np.int32)),
        },
        {"x": ("node", mesh.points[:, 0]), "y": ("node", mesh.points[:, 1])},
        attrs={"Conventions": "CF-1.8", "title": "Solution of a unilateral boundary problem", **attributes},
    )
    for name, variable in dataset.variables.items():
        variable.attrs = {"long_name": LONG_NAMES[str(name)], "units": "1"}
        if name not in ("multiplier", "gap"):
            variable.encoding["_FillValue"] = None  # xarray would declare one, though no value is missing
    return dataset
