"""The command `unilateral infsup`: the constants of Lemma 3.1 for a mesh and a partition of one's own."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from unilateral import api
from unilateral.arrays import Array, Index
from unilateral.cli.arguments import is_count
from unilateral.cli.guard import say
from unilateral.cli.own_mesh import own_mesh
from unilateral.discrete.choice import check_condensed, check_size
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
from unilateral.geometry.structured import natural_kind
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
    of = _mesh(mesh, h, domain.polygon if domain else None)
    form = form_of(domain, of)._replace(free=()) if domain else H1
    found = record(of, _cells(of.polygon, cells or "", H), form)
    say(text(found) if json else "\n".join(lines(found)))


def _mesh(file: str | None, h: float | None, polygon: Polygon | None) -> Mesh:
    """The mesh in the file, or else the one of that size."""
    if file is not None:
        return own_mesh(file, polygon)
    if polygon is None or h is None:
        raise InputError("--h needs --polygon")
    check_size(polygon, h)
    return api.KINDS[natural_kind(polygon)](polygon, h)


def _cells(polygon: Polygon, given: str, H: float | None) -> Partition:
    """Equal cells of the size H, or so many on every side as are `given`, or those of a `given` file."""
    if H is not None:
        return partitions.uniform(polygon, H)
    if not is_count(given):
        return read_partition(given, polygon)
    if not 1 <= int(given) <= MOST_CELLS:
        raise InputError(f"argument --cells: {given} must lie between 1 and {MOST_CELLS}")
    return Partition(polygon, polygon.divided(np.full(polygon.n_sides, int(given))))


def record(mesh: Mesh, cells: Partition, form: Form = H1) -> dict[str, Any]:
    """What is found, for programs. Constants by eigenvalues are NaN if there is a reason, `not_solved`.

    There are no multipliers on the sides that the form clamps; the local rule is looked at on all sides.
    """
    constants, reason = InfSup(math.nan, math.nan, math.nan), ""
    multipliers = int(np.count_nonzero(form.held(cells.side)))
    if not multipliers:
        raise InputError(f"all sides of '{mesh.polygon.name}' are clamped, so that there are no multipliers")
    try:
        constants = _by_eigenvalues(mesh, cells, form)
    except InputError as error:
        reason = str(error)
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
        "rule": _rule(mesh, cells),
    }


def _by_eigenvalues(mesh: Mesh, cells: Partition, form: Form) -> InfSup:
    """Raises InputError where more memory is needed than is free, or where gmsh is not installed."""
    check_condensed(mesh, cells)
    return infsup(mixed_spaces(condense(mesh, form), cells).operator, dual_norm(cells, form=form).gram().p0)


def _rule(mesh: Mesh, cells: Partition) -> dict[str, Any]:
    """The local rule, whether it is kept, and which cells and triangles break it."""
    coarse, flat = _coarse(cells, of_cells(mesh, cells)), _flat(mesh, *boundary_angles(mesh))
    return {**RULE._asdict(), "kept": not (coarse or flat), "cells": coarse, "triangles": flat}


def _coarse(cells: Partition, of: OfCells) -> list[dict[str, float]]:
    """The cells with edges that are too long, by their numbers and arc lengths.

    A cell without a node well inside, at least H_i/4 from both ends, is among them.
    """
    wrong = np.flatnonzero(~fine(of.over_longest))
    start, end = cells.points[wrong], cells.points[wrong + 1]
    of_rule = {"edges": of.edges[wrong], "cell_over_edge": of.over_longest[wrong], "delta": of.deltas[wrong]}
    return _rows(cell=wrong, side=cells.side[wrong], start=start, end=end, **of_rule)


def _flat(mesh: Mesh, triangles: Index, angles: Array) -> list[dict[str, float]]:
    """The triangles with small angles, by their numbers and centroids."""
    wrong = np.flatnonzero(~steep(angles))
    x, y = mesh.points[mesh.triangles[triangles[wrong]]].mean(axis=1).T
    return _rows(triangle=triangles[wrong], x=x, y=y, angle=angles[wrong])


def _rows(**columns: Array | Index) -> list[dict[str, float]]:
    """A record for each row of the columns (k,)."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _beta(found: dict[str, Any]) -> str:
    """What eigenvalues say of beta."""
    if found["not_solved"]:
        return f"not computed: {found['not_solved']}"
    if found["beta_upper"] == 0:
        return "0 up to rounding: lambda_H may not be unique; take larger cells or shorter edges"
    return f"{interval(found['beta_lower'], found['beta_upper'], spec='.4f')}, up to rounding"


def _theorem_5(found: dict[str, Any]) -> str:
    """Whether it applies, and the bound that its proof gives here."""
    if found["beta_fortin"] > 0:
        return f"proves beta >= {down(found['beta_fortin'], '.4f')} here, guaranteed"
    no_bound = "applies, but no bound is computed: a node is too near an end, or a triangle too thin"
    return no_bound if found["theorem_5"] else "does NOT apply"


def lines(found: dict[str, Any]) -> Iterator[str]:
    """What is found, in lines for readers."""
    rule, h, H, angle = found["rule"], found["h"], found["H"], found["smallest_angle"]
    beta, beta_0 = _beta(found), f"{found['beta_0']:.4f}"
    constants = f"delta = {found['delta']:.4g}, alpha_1 = {found['alpha_1']:.4g}"
    many = counted(len(rule["cells"]), "cell"), counted(len(rule["triangles"]), "triangle")
    broken = f"BROKEN by {' and '.join(many)}"
    rows = {
        "unknowns": f"{found['unknowns']} and {counted(found['multipliers'], 'multiplier')}",
        "beta in H^(-1/2)": beta,
        "beta_0 in L2": "not computed" if found["not_solved"] else beta_0,
        "edges per cell": f"at least {found['edges_per_cell']:.4g}",
        "cell over edge": f"at least {found['cell_over_edge']:.4g} (rule: at least {rule['cell_over_edge']})",
        "boundary angles": f"at least {angle:.4g} degrees (rule: at least {rule['smallest_angle']})",
        "local rule": "kept" if rule["kept"] else broken,
        "Theorem 5": f"{_theorem_5(found)}: {constants}",
    }
    if found["clamped_sides"]:
        clamped = found["clamped_sides"]
        rows = {"clamped": f"side{'s' * (len(clamped) > 1)} {listed(clamped)}, without multipliers"} | rows
    sides = len(found["vertices"])
    yield f"{found['polygon']}, {sides} sides: h = {h:.6g}, H = {H:.6g}, h/H = {h / H:.4g}"
    yield from (f"  {name:17} {value}" for name, value in rows.items())
    for what, wrong in ((CELL, rule["cells"]), (TRIANGLE, rule["triangles"])):
        yield from (what.format(**each) for each in wrong[:LISTED])
        if len(wrong) > LISTED:
            yield f"    and {len(wrong) - LISTED} more; --json lists all"
