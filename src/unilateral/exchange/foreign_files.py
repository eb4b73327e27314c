"""What is in the files of other solvers: nodal values, values on cells of the boundary or on line cells."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError

NODAL = ("u", "multiplier", "reaction")


class Handed(NamedTuple):
    """`points` (k, 2) with `nodal` values (k,); `cells`: start, end, value (m,); `edges`: ends (e, 2), value.

    What the file does not have is None or not there.
    """

    points: Array | None
    nodal: dict[str, Array]
    cells: tuple[Array, Array, Array] | None = None
    edges: tuple[Index, Array] | None = None


def handed(file: str) -> Handed:
    """What a file holds, by its ending: .csv, .nc, or one of meshio's.

    Raises InputError if it cannot be read.
    """
    if not Path(file).is_file():
        raise InputError(f"there is no file {file}")
    try:
        if Path(file).suffix == ".csv":
            return _of_csv(file)
        return _of_netcdf(file) if Path(file).suffix == ".nc" else _of_mesh(file)
    except (Exception, SystemExit) as error:
        raise InputError(f"{file}: it cannot be read ({str(error) or type(error).__name__})") from error


def _of_csv(file: str) -> Handed:
    import pandas as pd

    return _of_columns(pd.read_csv(file, skipinitialspace=True))


def _of_netcdf(file: str) -> Handed:
    import xarray as xr

    with xr.open_dataset(file) as found:
        return _of_columns({str(name): values.to_numpy() for name, values in found.variables.items()})


def _of_columns(columns: Mapping[str, Any]) -> Handed:
    found = {
        str(name): np.asarray(columns[name], dtype=float)
        for name in ("x", "y", "start", "end", *NODAL)
        if name in columns
    }
    cells = None
    if {"start", "end", "multiplier"} <= set(found):
        cells = found["start"], found["end"], found.pop("multiplier")
    if "x" not in found or "y" not in found:
        return Handed(None, {}, cells)
    nodal = {name: found[name] for name in NODAL if name in found}
    return Handed(np.column_stack([found["x"], found["y"]]), nodal, cells)


def _of_mesh(file: str) -> Handed:
    import meshio

    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        content = meshio.read(file)
    nodal = {
        name: np.ravel(content.point_data[name]).astype(float) for name in NODAL if name in content.point_data
    }
    triangles = [block.data.ravel() for block in content.cells if block.type == "triangle"]
    if not triangles:
        raise InputError("it has no triangles; u is needed at the nodes of a level's mesh")
    used = np.unique(np.concatenate(triangles))
    number = np.full(len(content.points), -1)
    number[used] = np.arange(len(used))
    edges = None
    if "multiplier" in content.cell_data and "line" in content.cells_dict:
        values = np.ravel(content.cell_data_dict["multiplier"]["line"]).astype(float)
        edges = number[content.cells_dict["line"]], values
    return Handed(
        content.points[used, :2].astype(float), {name: of[used] for name, of in nodal.items()}, None, edges
    )
