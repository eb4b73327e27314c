"""Solves exported cases with GetFEM: P1, constraints on means over cells, an augmented Lagrangian.

    unilateral export natural --h 1/32 --H 1/16 --levels 3 --out natural
    python examples/score_getfem.py natural
    unilateral score natural natural_getfem_?.csv --multiplier natural_getfem_0_cells.csv \
        --multiplier natural_getfem_1_cells.csv --multiplier natural_getfem_2_cells.csv

The program reads only the exported files, and does not import `unilateral`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

MISSING = 5
"""Exit code if GetFEM is missing."""
try:
    import getfem as gf
    import numpy as np
    from scipy.spatial import cKDTree
except ImportError:
    print("GetFEM is missing; Debian's package python3-getfem installs it", file=sys.stderr)
    sys.exit(MISSING)


def means(nodes: np.ndarray, cells: np.ndarray, dof: np.ndarray, perimeter: float) -> gf.Spmat:
    """Means (m, n) of the hat functions over the cells; `dof` (n,) has the column of each node."""
    order = np.argsort(nodes["s"])[: np.isfinite(nodes["s"]).sum()]  # along the boundary
    s, B = nodes["s"][order], gf.Spmat("empty", len(cells), len(nodes))
    after = np.append(s[1:], perimeter)
    for i, (start, end) in enumerate(zip(cells["start"], cells["end"], strict=True)):
        a, b = np.maximum(s, start), np.minimum(after, end)
        for edge in np.flatnonzero(b > a):
            weight = (b - a)[edge] / (end - start)
            at = (0.5 * (a + b) - s)[edge] / (after - s)[edge]
            B.add(i, dof[order[edge]], weight * (1 - at))
            B.add(i, dof[order[(edge + 1) % len(s)]], weight * at)
    return B


def solved(level: Path) -> tuple[np.ndarray, np.ndarray]:
    """Table x, y, u (n, 3) of the nodes of a level, and table start, end, multiplier (m, 3) of its cells."""
    nodes, cells = (
        np.genfromtxt(level / f"{name}.csv", delimiter=",", names=True) for name in ("nodes", "partition")
    )
    held = np.isfinite(cells["g_mean"])  # cells on sides that are not free
    mesh = gf.Mesh("import", "gmsh", str(level / "mesh.msh"))
    V, rule = gf.MeshFem(mesh, 1), gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(2)"))
    V.set_classical_fem(1)
    points = V.basic_dof_nodes().T
    node = cKDTree(np.column_stack([nodes["x"], nodes["y"]])).query(points)[1]
    B = means(nodes, cells[held], np.argsort(node), cells["end"][-1])
    B.scale(-1.0)
    gf.util_trace_level(0)
    model = gf.Model("real")
    model.add_fem_variable("u", V)
    model.add_Laplacian_brick(rule, "u")
    model.add_mass_brick(rule, "u")
    model.add_explicit_rhs("u", nodes["load"][node])
    model.add_variable("force", held.sum())  # B u <= gap: on each cell, mean u >= mean g
    model.add_initialized_data("r", [1.0])
    model.add_initialized_data("gap", -cells["g_mean"][held])
    model.add_initialized_data("alpha", [1.0])
    model.add_basic_contact_brick("u", "force", "r", B, "gap", "alpha", 2)
    if not model.solve("max_res", 1e-10, "max_iter", 100)[1]:
        raise RuntimeError("Newton's method did not converge in 100 steps")
    pressure = np.zeros(len(cells))
    pressure[held] = -model.variable("force") / (cells["end"] - cells["start"])[held]
    multiplier = np.column_stack([cells["start"], cells["end"], pressure])
    return np.column_stack([points, model.variable("u")]), multiplier


if __name__ == "__main__":
    for k, each in enumerate(json.loads(Path(sys.argv[1], "problem.json").read_text())["levels"]):
        tables = solved(Path(sys.argv[1], each["folder"]))
        for table, end, names in zip(tables, ("", "_cells"), ("x,y,u", "start,end,multiplier"), strict=True):
            np.savetxt(f"{sys.argv[1]}_getfem_{k}{end}.csv", table, "%.17g", ",", header=names, comments="")
