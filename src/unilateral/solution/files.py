"""A solution as files, by their endings."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unilateral.certificates import export
from unilateral.geometry.files import write_mesh
from unilateral.solution import tables
from unilateral.solution.bounds import compute_error_shares
from unilateral.system import json_records
from unilateral.system.files import check_target, replacing, write_netcdf

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

SOLUTION_ENDINGS = {
    ".vtu": ["meshio"],
    ".csv": [],
    ".nc": ["netCDF4", "xarray"],
    ".json": [],
    ".svg": ["matplotlib"],
    ".png": ["matplotlib"],
    ".pdf": ["matplotlib"],
    ".html": ["plotly"],
}
"""The endings of the files that `Solution.save` writes, and the optional packages that each needs."""


def save_solution(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Writes a file, by its ending. Raises InputError for one that is not of SOLUTION_ENDINGS."""
    check_target(path, SOLUTION_ENDINGS)
    ending = Path(path).suffix
    if ending == ".vtu":
        _write_vtu(solution, path)
        return
    if ending == ".json":
        json_records.write_json(solution.certificate(), path)
        return
    with replacing(path) as temporary:
        if ending == ".csv":
            tables.write_csv(tables.solution_cell_columns(solution), temporary)
        elif ending == ".nc":
            write_netcdf(tables.make_dataset(solution), temporary)
        elif ending == ".html":
            from unilateral.solution.interactive import render_solution_page

            temporary.write_text(render_solution_page(solution), encoding="utf-8", newline="\n")
        else:
            from unilateral.solution.plot import write_figure

            write_figure(solution.plot(), temporary)


def _write_vtu(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Writes u_h, the mean of lambda_H on each boundary edge, and the shares of triangles in the bound."""
    edge_means = solution.partition.means(np.nan_to_num(solution.multiplier), solution.mesh.s)
    edge_means[np.isin(solution.mesh.side, solution.problem.clamped_sides)] = math.nan
    certain = solution.partition.means(solution.contact.certain_cells, solution.mesh.s)
    shares = compute_error_shares(solution)
    triangle_fields = {} if shares is None else {"error_share": shares}
    edge_fields = {"multiplier": edge_means, "certain_contact": certain}
    write_mesh(solution.mesh, path, edge_fields, {"u": solution.u}, triangle_fields)


def save_certificate(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Writes a certificate of the cheap bound. Raises InputError as `make_certificate`."""
    check_target(path, export.CERTIFICATE_ENDINGS)
    judged = export.judge_solution(solution.bounded)
    export.write_certificate(export.make_certificate(solution.problem, judged), path)
