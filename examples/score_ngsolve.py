"""Solves exported cases with NGSolve: P1, constraints at the nodes, a primal-dual active set.

    unilateral export natural --h 1/32 --H 1/16 --levels 3 --out natural
    python examples/score_ngsolve.py natural
    unilateral score natural natural_ngsolve_?.csv

The program reads only the exported files, and does not import `unilateral`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

MISSING = 5
"""Exit code if NGSolve is missing."""
try:
    import ngsolve as ng
    import numpy as np
    from netgen.read_gmsh import ReadGmsh
except ImportError:
    print("NGSolve is missing; 'pip install ngsolve' installs it", file=sys.stderr)
    sys.exit(MISSING)


def active_set(A, load: np.ndarray, held: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u (n,) and the reactions (n,), with u >= g at the nodes `held` (k,); the first set is all of `held`."""
    x, r = A.CreateColVector(), A.CreateColVector()
    u, reactions, contact = x.FV().NumPy(), r.FV().NumPy(), np.ones(len(held), dtype=bool)
    u[:] = 0
    for _ in range(100):
        free = ng.BitArray(len(load))
        free.Set()
        for node in held[contact].tolist():
            free.Clear(node)
        u[held[contact]] = g[contact]
        r.data = -A * x
        reactions += load
        x.data += A.Inverse(free, inverse="sparsecholesky") * r
        r.data = A * x
        reactions -= load
        after = np.where(contact, reactions[held] > 0, u[held] < g)
        if np.array_equal(after, contact):
            return u, reactions
        contact = after
    raise RuntimeError("the active set did not settle in 100 steps")


def solved(level: Path) -> np.ndarray:
    """Table x, y, u, reaction (n, 4) of the nodes of a level; Netgen keeps the order of the file's nodes."""
    mesh = ng.Mesh(ReadGmsh(str(level / "mesh.msh")))
    nodes = np.genfromtxt(level / "nodes.csv", delimiter=",", names=True)
    V = ng.H1(mesh, order=1)
    u, v = V.TnT()
    A = ng.BilinearForm((ng.grad(u) * ng.grad(v) + u * v) * ng.dx, symmetric=True).Assemble().mat
    held = np.flatnonzero(np.isfinite(nodes["g"]))
    values, reactions = active_set(A, nodes["load"], held, nodes["g"][held])
    points = np.array([vertex.point for vertex in mesh.vertices])
    on_boundary = np.where(np.isfinite(nodes["s"]), reactions, 0)
    return np.column_stack([points, values, on_boundary])


def main(folder: str) -> None:
    for k, level in enumerate(json.loads((Path(folder) / "problem.json").read_text())["levels"]):
        table = solved(Path(folder) / level["folder"])
        np.savetxt(f"{folder}_ngsolve_{k}.csv", table, "%.17g", ",", header="x,y,u,reaction", comments="")


if __name__ == "__main__":
    main(sys.argv[1])
