"""A case as a folder of files for other solvers: meshes, data, partitions, formulas and a README.

    README.md  problem.json  <case>.yaml  level_0/  level_1/  ...

`LEVEL_FILES` says what is in the folder of a level; `exported_folder` reads them again.
"""

from __future__ import annotations

import errno
import json
import os
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
import yaml

from unilateral.arrays import Array
from unilateral.errors import InputError, StorageError
from unilateral.exchange.boundary_function import has_obstacle, obstacle_at_nodes
from unilateral.exchange.case_formulas import DEFINITIONS, derive_case_formulas
from unilateral.fem.form import Form
from unilateral.fem.p1 import case_moments, load_vector
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ZERO
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import Mesh, refine_uniformly
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.fields import join_sides
from unilateral.problems.problem import Problem
from unilateral.solution.bounds import name_energy_norm
from unilateral.solution.tables import make_cell_columns, write_csv
from unilateral.system.files import check_writable, make_hidden_folder, make_write_error, write_netcdf

LEVEL_FILES = {
    "mesh.msh": "the mesh, for Gmsh's readers",
    "mesh.vtu": "the same, with `side` on its boundary edges",
    "nodes.csv": "node, x, y, f, load, its integral with the P1 hat; on the boundary s (arc length), g, u_D",
    "quadrature.nc": "points, weights and f in the triangles; s, weights and g on the boundary edges",
    "partition.csv": "the cells of T_H by arc length and place, with the mean of g on each",
}
FREE_SIDES_PARAGRAPH = "\nOn the sides {} there is no obstacle: ∂u/∂n = 0. Hand in λ = 0 there.\n"
CLAMPED_SIDES_PARAGRAPH = """
Clamped sides: {sides}. There u = u_D is given, and there is no obstacle and no λ. u_D is {values}.
In P1 u has the values u_D at the nodes of clamped sides, ends included: the column `u_D` of `nodes.csv`.
In the weak form below v ≥ g means v = u_D there, and in the mixed form v = 0.
Hand in λ on the other sides. Values of λ on clamped sides are ignored; they may be 0.
"""
REACTION_TERMS = {
    "u_term": " + u",
    "v_term": " + uv",
    "inequality_term": " + u(v − u)",
    "square_term": " + v²",
}
"""Terms of the README's equations that belong to the reaction term."""


def export_case(case: Problem, coarse: Mesh, H: float, levels: int, folder: str | os.PathLike[str]) -> None:
    """Writes the case on a mesh and its uniform refinements; H is the size of the cells on the finest.

    The whole folder appears or nothing. Raises InputError for a folder that is there, or where none may be
    made, and StorageError for a full disk.
    """
    folder = Path(folder)
    is_there = InputError(f"{folder} exists already; name a new folder")
    if folder.exists():
        raise is_there
    check_writable(folder)
    try:
        # written under another name first, so that the folder appears whole
        with make_hidden_folder(folder) as hidden:
            unfinished = hidden / folder.name
            unfinished.mkdir()
            _write_folder(case, coarse, H, levels, unfinished)
            os.rename(unfinished, folder)
    except StorageError as error:
        raise StorageError(str(error).replace(str(unfinished), str(folder))) from error
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST):  # another export was quicker
            raise is_there from None
        raise make_write_error(folder, error) from error


def _write_folder(case: Problem, coarse: Mesh, H: float, levels: int, folder: Path) -> None:
    """Write all files; both sizes are halved from level to level, so that h/H is the same on all."""
    sizes = []
    for k in range(levels):
        mesh = refine_uniformly(coarse, k)
        partition = partitions.make_uniform_partition(case.polygon, H * 2 ** (levels - 1 - k))
        _write_level(case, mesh, partition, folder / f"level_{k}")
        counts = {"nodes": mesh.n_nodes, "cells": partition.n_cells}
        sizes.append({"folder": f"level_{k}", "h": mesh.h, "H": partition.H, **counts})
    record = _describe_case_in_json(case) | {"levels": sizes}
    (folder / "problem.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8", newline="\n")
    declaration = yaml.safe_dump(dict(case.known_solution().declaration), allow_unicode=True, sort_keys=False)
    (folder / f"{case.name}.yaml").write_text(declaration, encoding="utf-8", newline="\n")
    (folder / "README.md").write_text(_render_readme(case, record), encoding="utf-8", newline="\n")


def _describe_case_in_json(case: Problem) -> dict[str, Any]:
    """Record of the case for problem.json, without the levels."""
    exact = case.known_solution()
    singular = [
        {"side": p.side, "t": p.t, "place": case.polygon.point(p.side, p.t).tolist()}
        for p in exact.flux_singular_points()
    ]
    return {
        "case": case.name,
        "title": case.title,
        "polygon": case.polygon.name,
        "vertices": case.polygon.vertices.tolist(),
        "side": exact.side,
        "free_sides": list(case.free_sides),
        "clamped_sides": list(case.clamped_sides),
        "k": 1,
        "c": int(as_float(case.c)),
        "hypotheses": exact.declaration["hypotheses"],
        "definitions": DEFINITIONS,
        **derive_case_formulas(exact),
        "u_D": [
            str(exact.clamped_values[i]) if i in exact.clamped_values else None
            for i in range(case.polygon.n_sides)
        ],
        "lambda_is_a_fractional_power_at": singular,
        "lambda_in_L2": exact.flux_in_L2,
    }


def _write_level(case: Problem, mesh: Mesh, partition: Partition, folder: Path) -> None:
    folder.mkdir()
    for name in ("mesh.msh", "mesh.vtu"):
        write_mesh(mesh, folder / name)
    _tabulate_nodes(case, mesh).to_csv(folder / "nodes.csv", index=False)
    means = cell_means(case.known_solution(), partition).g_means
    g_mean = np.where(has_obstacle(case, partition.side), means, np.nan)
    write_csv(make_cell_columns(partition, g_mean=g_mean), folder / "partition.csv")
    write_netcdf(_tabulate_quadrature(case, mesh), folder / "quadrature.nc")


def _tabulate_nodes(case: Problem, mesh: Mesh) -> pd.DataFrame:
    """Table with a row per node; s, g and u_D are NaN inside, and on the boundary where there is none."""
    exact = case.known_solution()
    s = np.full(mesh.n_nodes, np.nan)
    g = np.full(mesh.n_nodes, np.nan)
    s[mesh.boundary] = mesh.s[:-1]
    g[mesh.boundary] = obstacle_at_nodes(case, mesh)
    (x, y) = mesh.points.T
    f = exact.source(mesh.points)
    u = exact.value_and_gradient(mesh.points)[0]
    u_D = np.where(Form(clamped=case.clamped_sides).clamped_nodes(mesh), u, np.nan)
    load = load_vector(mesh, case_moments(exact, mesh))
    return pd.DataFrame(
        {"node": np.arange(len(x)), "x": x, "y": y, "f": f, "load": load, "s": s, "g": g, "u_D": u_D}
    )


def _tabulate_quadrature(case: Problem, mesh: Mesh) -> xr.Dataset:
    """Points, weights and values of the rules with which this project integrates f and g."""
    exact = case.known_solution()
    blocks: list[tuple[Array, ...]] = []
    for rule in triangle_rules(mesh, exact):
        count = rule.weight.shape[1]
        f = exact.source(rule.origin, rule.offset)
        hats = rule.barycentric.reshape(-1, 3)
        blocks.append((np.repeat(rule.triangle, count), rule.points, rule.weight.ravel(), hats, f))
    triangle, places, weight, hats, f = map(np.concatenate, zip(*blocks, strict=True))
    edge_rule = boundary_rule(case.polygon, mesh.s, exact.singular_points())
    u, _, gap = exact.trace_flux_and_gap(edge_rule.side, edge_rule.s, edge_rule.nearest_anchor)
    return xr.Dataset(
        {
            "triangle": ("point", triangle.astype(np.int32)),
            "place": (("point", "axis"), places),
            "barycentric": (("point", "corner"), hats),
            "weight": ("point", weight),
            "f": ("point", f),
            "edge": ("boundary_point", edge_rule.interval.astype(np.int32)),
            "side": ("boundary_point", edge_rule.side.astype(np.int32)),
            "s": ("boundary_point", edge_rule.s + case.polygon.starts[edge_rule.side]),
            "boundary_weight": ("boundary_point", edge_rule.weight),
            "g": ("boundary_point", np.where(has_obstacle(case, edge_rule.side), u - gap, np.nan)),
        },
        attrs={"case": case.name, "h": mesh.h},
    )


def _render_readme(case: Problem, record: dict[str, Any]) -> str:
    """Text of the folder's README, from its template and the case's lines."""
    template = resources.files("unilateral.exchange") / "README.template.md"
    columns = "| {folder} | {h:.6g} | {H:.6g} | {nodes} | {cells} |"
    rows = [columns.format(**level) for level in record["levels"]]
    values = [f"`{u}` on side {i}" for i, u in sorted(case.known_solution().clamped_values.items())]
    files = [f"- `{name}`: {description}" for name, description in LEVEL_FILES.items()]
    return template.read_text(encoding="utf-8").format(
        name=case.name,
        title=case.title,
        vertices=", ".join(f"({x:g}, {y:g})" for x, y in case.polygon.vertices.tolist()),
        f=record["f"] or "no closed formula",
        files="\n".join(files),
        levels="\n".join(rows),
        free=FREE_SIDES_PARAGRAPH.format(", ".join(map(str, case.free_sides))) if case.free_sides else "",
        clamped=CLAMPED_SIDES_PARAGRAPH.format(sides=join_sides(case.clamped_sides), values=", ".join(values))
        if values
        else "",
        norm=name_energy_norm(case, "v"),
        **{name: term if case.c != ZERO else "" for name, term in REACTION_TERMS.items()},
    )
