"""The command `unilateral infsup`: the constants of Lemma 3.1 for a mesh and a partition of one's own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.cli.arguments import is_count
from unilateral.cli.guard import say
from unilateral.cli.own_mesh import mesh_of_size, own_mesh
from unilateral.discrete.choice import check_condensed
from unilateral.discrete.loads import form_of
from unilateral.errors import InputError, counted
from unilateral.fem.condense import condense
from unilateral.fem.form import H1, Form
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.decimals import down, interval
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import read_partition
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.dual import dual_norm
from unilateral.norms.fortin import beta_below
from unilateral.norms.infsup import InfSup, infsup
from unilateral.norms.resolution import RULE, OfCells, boundary_angles, fine, of_cells, resolution, steep
from unilateral.problems.fields import listed
from unilateral.problems.problem_file import domain_of
from unilateral.system.as_json import text

LISTED = 10
"""At most this many cells, and triangles, that break the rule are named in the text."""
MOST_CELLS = 100_000
"""A side has at most this many cells."""
CELL = (
    "    cell {cell} on side {side}, s = {start:.6g} to {end:.6g}: "
    "edges = {edges:.4g}, cell over longest edge = {cell_over_edge:.4g}, delta = {delta:.3g}"
)
TRIANGLE = "    triangle {triangle} at ({x:.6g}, {y:.6g}): {angle:.4g} degrees"


def run(
    mesh: str | None, h: float | None, polygon: str | None, cells: str | None, H: float | None, json: bool
) -> None:
    """Print what is found."""
    domain = domain_of(polygon) if polygon else None
    if mesh is not None:
        triangulation = own_mesh(mesh, domain.polygon if domain else None)
    elif domain is None or h is None:
        raise InputError("--h needs --polygon")
    else:
        triangulation = mesh_of_size(domain.polygon, h)
    form = form_of(domain, triangulation)._replace(free=()) if domain else H1
    stability = record(triangulation, _partition(triangulation.polygon, cells or "", H), form)
    say(text(stability) if json else "\n".join(lines(stability)))


def _partition(polygon: Polygon, cells: str, H: float | None) -> Partition:
    """Equal cells of the size H, or a number of `cells` on every side, or the cells in a file."""
    if H is not None:
        return partitions.uniform(polygon, H)
    if not is_count(cells):
        return read_partition(cells, polygon)
    if not 1 <= int(cells) <= MOST_CELLS:
        raise InputError(f"argument --cells: {cells} must lie between 1 and {MOST_CELLS}")
    return Partition(polygon, polygon.divided(np.full(polygon.n_sides, int(cells))))


def record(mesh: Mesh, cells: Partition, form: Form = H1) -> dict[str, Any]:
    """What is found, for programs. Constants by eigenvalues are NaN if there is a reason, `not_solved`.

    There are no multipliers on the sides that the form clamps; the local rule is looked at on all sides.
    """
    multipliers = int(np.count_nonzero(form.held(cells.side)))
    if not multipliers:
        raise InputError(f"all sides of '{mesh.polygon.name}' are clamped, so that there are no multipliers")
    try:
        check_condensed(mesh, cells)
        operator = mixed_spaces(condense(mesh, form), cells).operator
        constants = infsup(operator, dual_norm(cells, form=form).gram().p0)
        reason = ""
    except InputError as error:  # more memory is needed than is free, or gmsh is not installed
        constants = InfSup(math.nan, math.nan, math.nan)
        reason = str(error)
    coarse = _coarse_cells(cells, of_cells(mesh, cells))
    flat = _flat_triangles(mesh, *boundary_angles(mesh))
    return {
        "polygon": mesh.polygon.name,
        "vertices": mesh.polygon.vertices.tolist(),
        "h": mesh.h,
        "H": cells.H,
        "unknowns": mesh.n_nodes,
        "multipliers": multipliers,
        "clamped_sides": [*form.clamped],
        "beta_fortin": beta_below(mesh, cells, form),
        **constants._asdict(),
        "not_solved": reason,
        **resolution(mesh, cells)._asdict(),
        "theorem_5": bool(of_cells(mesh, cells).deltas.all()),
        "rule": RULE._asdict() | {"kept": not (coarse or flat), "cells": coarse, "triangles": flat},
    }


def _coarse_cells(cells: Partition, sizes: OfCells) -> list[dict[str, float]]:
    """The cells with edges that are too long, by their numbers and arc lengths.

    A cell without a node well inside, at least H_i/4 from both ends, is among them.
    """
    wrong = np.flatnonzero(~fine(sizes.over_longest))
    return _rows(
        cell=wrong,
        side=cells.side[wrong],
        start=cells.points[wrong],
        end=cells.points[wrong + 1],
        edges=sizes.edges[wrong],
        cell_over_edge=sizes.over_longest[wrong],
        delta=sizes.deltas[wrong],
    )


def _flat_triangles(mesh: Mesh, triangles: Index, angles: Array) -> list[dict[str, float]]:
    """The triangles with small angles, by their numbers and centroids."""
    wrong = np.flatnonzero(~steep(angles))
    x, y = mesh.points[mesh.triangles[triangles[wrong]]].mean(axis=1).T
    return _rows(triangle=triangles[wrong], x=x, y=y, angle=angles[wrong])


def _rows(**columns: Array | Index) -> list[dict[str, float]]:
    """A record for each row of the columns (k,)."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _beta(stability: dict[str, Any]) -> str:
    """What eigenvalues say of beta."""
    if stability["not_solved"]:
        return f"not computed: {stability['not_solved']}"
    if stability["beta_upper"] == 0:
        return "0 up to rounding: lambda_H may not be unique; take larger cells or shorter edges"
    return f"{interval(stability['beta_lower'], stability['beta_upper'], spec='.4f')}, up to rounding"


def _theorem_5(stability: dict[str, Any]) -> str:
    """Whether it applies, and the bound that its proof gives here."""
    if stability["beta_fortin"] > 0:
        return f"proves beta >= {down(stability['beta_fortin'], '.4f')} here, guaranteed"
    no_bound = "applies, but no bound is computed: a node is too near an end, or a triangle too thin"
    return no_bound if stability["theorem_5"] else "does NOT apply"


def lines(stability: dict[str, Any]) -> Iterator[str]:
    """A record, in lines for readers."""
    rule = stability["rule"]
    clamped = stability["clamped_sides"]
    h = stability["h"]
    H = stability["H"]
    sides = len(stability["vertices"])
    cells = counted(len(rule["cells"]), "cell")
    triangles = counted(len(rule["triangles"]), "triangle")
    rows = {}
    if clamped:
        rows["clamped"] = f"side{'s' * (len(clamped) > 1)} {listed(clamped)}, without multipliers"
    rows |= {
        "unknowns": f"{stability['unknowns']} and {counted(stability['multipliers'], 'multiplier')}",
        "beta in H^(-1/2)": _beta(stability),
        "beta_0 in L2": "not computed" if stability["not_solved"] else f"{stability['beta_0']:.4f}",
        "edges per cell": f"at least {stability['edges_per_cell']:.4g}",
        "cell over edge": f"at least {stability['cell_over_edge']:.4g} "
        f"(rule: at least {rule['cell_over_edge']})",
        "boundary angles": f"at least {stability['smallest_angle']:.4g} degrees "
        f"(rule: at least {rule['smallest_angle']})",
        "local rule": "kept" if rule["kept"] else f"BROKEN by {cells} and {triangles}",
        "Theorem 5": f"{_theorem_5(stability)}: delta = {stability['delta']:.4g}, "
        f"alpha_1 = {stability['alpha_1']:.4g}",
    }
    yield f"{stability['polygon']}, {sides} sides: h = {h:.6g}, H = {H:.6g}, h/H = {h / H:.4g}"
    yield from (f"  {name:17} {value}" for name, value in rows.items())
    for line, wrong in ((CELL, rule["cells"]), (TRIANGLE, rule["triangles"])):
        yield from (line.format(**each) for each in wrong[:LISTED])
        if len(wrong) > LISTED:
            yield f"    and {len(wrong) - LISTED} more; --json lists all"
