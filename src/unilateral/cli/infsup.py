"""The command `unilateral infsup`: the constants of Lemma 3.1 for a mesh and a partition of one's own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.cli.arguments import is_count
from unilateral.cli.guard import print_result
from unilateral.cli.mesh_options import make_mesh_of_size, read_mesh_option
from unilateral.discrete.choice import check_condensing_memory
from unilateral.discrete.problem_data import problem_form
from unilateral.errors import InputError, pluralise
from unilateral.fem.condense import condense
from unilateral.fem.form import H1, Form
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.decimals import format_down, format_interval
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import read_partition
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.fortin import beta_lower_bound
from unilateral.norms.infsup import InfSup, infsup_constants
from unilateral.norms.resolution import (
    RULE,
    CellResolution,
    boundary_angles,
    cell_resolution,
    is_fine_enough,
    is_wide_enough,
    resolution,
)
from unilateral.problems.fields import join_sides
from unilateral.problems.problem_file import load_domain
from unilateral.system.json_records import encode_json

MAX_LISTED_ROWS = 10
"""At most this many cells, and triangles, that break the rule are named in the text."""
MAX_CELLS_PER_SIDE = 100_000
"""A side has at most this many cells."""
CELL_ROW_FORMAT = (
    "    cell {cell} on side {side}, s = {start:.6g} to {end:.6g}: "
    "edges = {edges:.4g}, cell over longest edge = {cell_over_edge:.4g}, delta = {delta:.3g}"
)
TRIANGLE_ROW_FORMAT = "    triangle {triangle} at ({x:.6g}, {y:.6g}): {angle:.4g} degrees"


def run_infsup(
    mesh: str | None, h: float | None, polygon: str | None, cells: str | None, H: float | None, json: bool
) -> None:
    """Print the stability constants and the local rule of a mesh and a partition."""
    domain = load_domain(polygon) if polygon else None
    if mesh is not None:
        triangulation = read_mesh_option(mesh, domain.polygon if domain else None)
    elif domain is None or h is None:
        raise InputError("--h needs --polygon")
    else:
        triangulation = make_mesh_of_size(domain.polygon, h)
    form = problem_form(domain, triangulation)._replace(free=()) if domain else H1
    stability = make_stability_record(
        triangulation, _make_partition(triangulation.polygon, cells or "", H), form
    )
    print_result(encode_json(stability) if json else "\n".join(describe_stability(stability)))


def _make_partition(polygon: Polygon, cells: str, H: float | None) -> Partition:
    """Equal cells of the size H, or a number of `cells` on every side, or the cells in a file."""
    if H is not None:
        return partitions.make_uniform_partition(polygon, H)
    if not is_count(cells):
        return read_partition(cells, polygon)
    if not 1 <= int(cells) <= MAX_CELLS_PER_SIDE:
        raise InputError(f"argument --cells: {cells} must lie between 1 and {MAX_CELLS_PER_SIDE}")
    return Partition(polygon, polygon.divided(np.full(polygon.n_sides, int(cells))))


def make_stability_record(mesh: Mesh, partition: Partition, form: Form = H1) -> dict[str, Any]:
    """Record of the stability constants, by Lemma 3.1 and Theorem 5, and of the local rule.

    Constants by eigenvalues are NaN if there is a reason, `not_solved`. There are no multipliers on the sides
    that the form clamps; the local rule is looked at on all sides.
    """
    multipliers = int(np.count_nonzero(form.has_multiplier(partition.side)))
    if not multipliers:
        raise InputError(f"all sides of '{mesh.polygon.name}' are clamped, so that there are no multipliers")
    try:
        # (3.4): beta^2 is the least eigenvalue of D x = beta^2 G x, G the Gram matrix of ||.||_-1/2
        check_condensing_memory(mesh, partition)
        operator = mixed_spaces(condense(mesh, form), partition).operator
        constants = infsup_constants(operator, build_dual_norm(partition, form=form).gram().p0)
        reason = ""
    except InputError as error:  # more memory is needed than is free, or gmsh is not installed
        constants = InfSup(math.nan, math.nan, math.nan)
        reason = str(error)
    coarse = _list_coarse_cells(partition, cell_resolution(mesh, partition))
    flat = _list_flat_triangles(mesh, *boundary_angles(mesh))
    return {
        "polygon": mesh.polygon.name,
        "vertices": mesh.polygon.vertices.tolist(),
        "h": mesh.h,
        "H": partition.H,
        "unknowns": mesh.n_nodes,
        "multipliers": multipliers,
        "clamped_sides": [*form.clamped],
        "beta_fortin": beta_lower_bound(mesh, partition, form),
        **constants._asdict(),
        "not_solved": reason,
        **resolution(mesh, partition)._asdict(),
        "theorem_5": bool(cell_resolution(mesh, partition).deltas.all()),
        "rule": RULE._asdict() | {"kept": not (coarse or flat), "cells": coarse, "triangles": flat},
    }


def _list_coarse_cells(partition: Partition, cell_sizes: CellResolution) -> list[dict[str, float]]:
    """The cells with edges that are too long, by their numbers and arc lengths.

    A cell without a node well inside, at least H_i/4 from both ends, is among them.
    """
    wrong = np.flatnonzero(~is_fine_enough(cell_sizes.cell_over_edge))
    return _make_row_records(
        cell=wrong,
        side=partition.side[wrong],
        start=partition.points[wrong],
        end=partition.points[wrong + 1],
        edges=cell_sizes.edges[wrong],
        cell_over_edge=cell_sizes.cell_over_edge[wrong],
        delta=cell_sizes.deltas[wrong],
    )


def _list_flat_triangles(mesh: Mesh, triangles: Index, angles: Array) -> list[dict[str, float]]:
    """The triangles with small angles, by their numbers and centroids."""
    wrong = np.flatnonzero(~is_wide_enough(angles))
    x, y = mesh.points[mesh.triangles[triangles[wrong]]].mean(axis=1).T
    return _make_row_records(triangle=triangles[wrong], x=x, y=y, angle=angles[wrong])


def _make_row_records(**columns: Array | Index) -> list[dict[str, float]]:
    """A record for each row of the columns (k,)."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _describe_beta(stability: dict[str, Any]) -> str:
    """Words on the bounds of beta by eigenvalues."""
    if stability["not_solved"]:
        return f"not computed: {stability['not_solved']}"
    if stability["beta_upper"] == 0:
        return "0 up to rounding: lambda_H may not be unique; take larger cells or shorter edges"
    return f"{format_interval(stability['beta_lower'], stability['beta_upper'], spec='.4f')}, up to rounding"


def _describe_theorem_5(stability: dict[str, Any]) -> str:
    """Whether it applies, and the bound that its proof gives here."""
    if stability["beta_fortin"] > 0:
        return f"proves beta >= {format_down(stability['beta_fortin'], '.4f')} here, guaranteed"
    no_bound = "applies, but no bound is computed: a node is too near an end, or a triangle too thin"
    return no_bound if stability["theorem_5"] else "does NOT apply"


def describe_stability(stability: dict[str, Any]) -> Iterator[str]:
    """A record, in lines for readers."""
    rule = stability["rule"]
    clamped = stability["clamped_sides"]
    h = stability["h"]
    H = stability["H"]
    sides = len(stability["vertices"])
    cells = pluralise(len(rule["cells"]), "cell")
    triangles = pluralise(len(rule["triangles"]), "triangle")
    rows = {}
    if clamped:
        rows["clamped"] = f"side{'s' * (len(clamped) > 1)} {join_sides(clamped)}, without multipliers"
    rows |= {
        "unknowns": f"{stability['unknowns']} and {pluralise(stability['multipliers'], 'multiplier')}",
        "beta in H^(-1/2)": _describe_beta(stability),
        "beta_0 in L2": "not computed" if stability["not_solved"] else f"{stability['beta_0']:.4f}",
        "edges per cell": f"at least {stability['edges_per_cell']:.4g}",
        "cell over edge": f"at least {stability['cell_over_edge']:.4g} "
        f"(rule: at least {rule['cell_over_edge']})",
        "boundary angles": f"at least {stability['smallest_angle']:.4g} degrees "
        f"(rule: at least {rule['smallest_angle']})",
        "local rule": "kept" if rule["kept"] else f"BROKEN by {cells} and {triangles}",
        "Theorem 5": f"{_describe_theorem_5(stability)}: delta = {stability['delta']:.4g}, "
        f"alpha_1 = {stability['alpha_1']:.4g}",
    }
    yield f"{stability['polygon']}, {sides} sides: h = {h:.6g}, H = {H:.6g}, h/H = {h / H:.4g}"
    yield from (f"  {name:17} {value}" for name, value in rows.items())
    for line, wrong in ((CELL_ROW_FORMAT, rule["cells"]), (TRIANGLE_ROW_FORMAT, rule["triangles"])):
        yield from (line.format(**row) for row in wrong[:MAX_LISTED_ROWS])
        if len(wrong) > MAX_LISTED_ROWS:
            yield f"    and {len(wrong) - MAX_LISTED_ROWS} more; --json lists all"
