"""The netCDF schema of the study's tables and their files, which are deterministic, complete and checked.

Dimensions are `case`, `mesh` (levels, coarse to fine) and `partition` (coarse to fine), the full tensor
grid; what was not computed is NaN, or the empty string. A file ends with a line that holds the SHA-256 of
all before it, which other readers of netCDF pass over.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Hashable, Mapping, Sequence
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study import table_origin
from unilateral import __version__
from unilateral.errors import InputError, StorageError
from unilateral.system.declarations import read_stored_yaml
from unilateral.system.files import replacing, write_netcdf

SOURCE = (
    "J. Haslinger, J. Lovíšek: Mixed variational formulation of unilateral problems. "
    "Comment. Math. Univ. Carolin. 21 (1980), No. 2, 231-246"
)
CONVENTIONS = "CF-1.11"
STAMPED_LIBRARIES = ("numpy", "scipy", "scikit-fem", "gmsh", "xarray", "netCDF4")
CSV_DIGITS = 4
NEGLIGIBLE_COLUMN_SHARE = 1e-12

VARIABLES: dict[str, list[str]] = read_stored_yaml(resources.files("study") / "variables.yaml")
"""The long name and the units of each variable, and the paper's equation or a definition."""


ERROR_NORMS = ("h1", "hm12", "l2")
ZERO_ERROR_SHARE = 1e-12
"""An error of at most this fraction of ||u||_1 counts as 0: it is rounding."""


def error_in_norm(
    table: xr.Dataset, norm: str, bound: str | None = None, quantity: str = "error"
) -> xr.DataArray:
    """The error in a norm, or D ("discrete"); in hm12 its "lower" or "upper" bound or their r.m.s. mean.

    The mean is 10 to 100 times closer to the error than the bounds are, but not guaranteed. `quantity` is the
    quantity in the variables' names, such as error or norm.
    """
    if norm != "hm12":
        return table[f"{norm}_{quantity}"]
    if bound:
        return table[f"hm12_{quantity}_{bound}"]
    square = 0.5 * (table[f"hm12_{quantity}_lower"] ** 2 + table[f"hm12_{quantity}_upper"] ** 2)
    return square**0.5


def errors_in_all_norms(table: xr.Dataset) -> xr.DataArray:
    """The error in every norm, over the dimension `norm`; in hm12 it is the r.m.s. mean."""
    return xr.Dataset({norm: error_in_norm(table, norm) for norm in ERROR_NORMS}).to_dataarray("norm")


def select_ratio(table: xr.Dataset, h_over_H: float) -> xr.Dataset:
    """The runs with that h/H, over `run`, coarse to fine."""
    mesh, partition = np.nonzero(np.isclose(table["h_over_H"].values, h_over_H, rtol=1e-9))
    return table.isel(mesh=xr.DataArray(mesh, dims="run"), partition=xr.DataArray(partition, dims="run"))


def save_table(
    table: xr.Dataset, path: str | os.PathLike[str], scene: str, parameters: Mapping[str, Any] | None = None
) -> None:
    """Write a table as netCDF with its variables described, what it belongs to, and no time stamp.

    `parameters` are the fields of the configuration that made it, by their paths; see `table_origin`.
    """
    table = table.copy()
    for name, variable in table.variables.items():
        if name in VARIABLES:
            long_name, units, equation = VARIABLES[str(name)]
            variable.attrs = {"long_name": long_name, "units": units, "equation": equation}
    libraries = ", ".join(f"{name} {version(name)}" for name in STAMPED_LIBRARIES)
    table.attrs = {
        "Conventions": CONVENTIONS,
        "title": f"unilateral problems, verified: {scene}",
        "history": f"made by unilateral {__version__}",
        "scene": scene,
        **table_origin.origin_attributes(path, parameters),
        "unilateral": __version__,
        "python": platform.python_version(),
        "libraries": libraries,
        "source": SOURCE,
    }
    # Whole numbers have 32 bits, and coordinates no number for missing values, as CF demands
    encoding: dict[Hashable, dict[str, Any]] = {name: {} for name in table.variables}
    for name, variable in table.variables.items():
        if variable.dtype.kind in "iu":
            encoding[name]["dtype"] = "int32"
        if name in table.coords:
            encoding[name]["_FillValue"] = None
    with replacing(path) as temporary:
        write_netcdf(table, temporary, encoding=encoding)
        content = temporary.read_bytes()
        temporary.write_bytes(content + _seal_line(content))


def load_table(path: str | os.PathLike[str], study: Mapping[str, Any] | None = None) -> xr.Dataset:
    """A table, read whole.

    Raises InputError where there is none, StorageError for one that is damaged or belongs to another place
    and, where the configuration `study` is given, for one that was made with another one.
    """
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"there is no table {path}; run 'make', or 'snakemake -j2 {path}'") from None
    except OSError as error:
        raise StorageError(f"{path} cannot be read: {error.strerror}") from None
    content = data[:-SEAL_BYTES]
    seal = data[-SEAL_BYTES:]
    if seal != _seal_line(content):
        raise StorageError(
            f"{path} is damaged or no table of the study; 'snakemake -j2 -f {path}' makes it anew"
        )
    table = xr.load_dataset(path, engine="netcdf4")
    if why := table_origin.origin_fault(path, table.attrs, study):
        raise StorageError(f"{path} {why}; 'snakemake -j2 -f {path}' makes it anew")
    return table


def _seal_line(content: bytes) -> bytes:
    """The last line of a file with this content."""
    return f"\nsha256 {hashlib.sha256(content).hexdigest()}\n".encode()


SEAL_BYTES = len(_seal_line(b""))


def join_levels(levels: Sequence[xr.Dataset]) -> xr.Dataset:
    """One table from those of single levels, coarse to fine.

    What does not depend on the mesh is taken from the first level that has it.
    """
    table = xr.concat(
        levels,
        "mesh",
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="exact",
        combine_attrs="drop",
    )
    common = [name for name, variable in table.data_vars.items() if "mesh" not in variable.dims]
    for level in levels[1:]:
        table = table.assign(table[common].fillna(level[common]))
    return table


def tabulate_levels(rows: Sequence[Mapping[str, float]]) -> xr.Dataset:
    """The rows as one table over (level), coarse to fine; NaN where a row lacks a name."""
    names = dict.fromkeys(name for row in rows for name in row)
    values = {name: ("level", [float(row.get(name, np.nan)) for row in rows]) for name in names}
    return xr.Dataset(values, coords={"level": np.arange(len(rows))})


def save_csv(frame: pd.DataFrame, path: str | os.PathLike[str]) -> None:
    """Write a table to draw from, rounded so that another machine's last bits do not show."""
    rounded = {name: _round_column(column) for name, column in frame.items()}
    with replacing(path) as temporary:
        pd.DataFrame(rounded).to_csv(temporary, index=False, lineterminator="\n")


def _round_column(column: pd.Series) -> pd.Series:
    if not pd.api.types.is_float_dtype(column):
        return column
    negligible = NEGLIGIBLE_COLUMN_SHARE * column.abs().max()
    cleaned = column.where(column.isna() | (column.abs() > negligible), 0.0)
    return cleaned.map(lambda x: "" if np.isnan(x) else f"{x:.{CSV_DIGITS}g}")
