"""Solves exported cases with scikit-fem: P1, constraints at the nodes, a primal-dual active set.

Sides may be clamped, and c may be 0.

    unilateral export natural --h 1/32 --H 1/16 --levels 3 --out natural
    python examples/score_scikit_fem.py natural
    unilateral score natural natural_level_?.csv

The program reads only the exported files, and does not import `unilateral`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import scipy.sparse.linalg as spl
import xarray as xr
from skfem import Basis, BilinearForm, ElementTriP1, MeshTri, condense, solve
from skfem.helpers import dot, grad


@BilinearForm
def form(u, v, w):
    """Bilinear form (grad u, grad v) + c (u, v)."""
    return dot(grad(u), grad(v)) + w.c * u * v


def load(level: Path, triangles: np.ndarray, n: int) -> np.ndarray:
    """Load (f, phi_i) (n,) of the nodes, by the exported quadrature."""
    rule = xr.load_dataset(level / "quadrature.nc")
    weighted = (rule.weight * rule.f).values[:, None] * rule.barycentric.values
    return np.bincount(triangles[rule.triangle.values].ravel(), weighted.ravel(), n)


def signorini(A, f: np.ndarray, g: np.ndarray, u_D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u (n,) and the reactions (n,), with u >= g at nodes that have g, and u = u_D at those that have u_D."""
    boundary, clamped = (np.flatnonzero(np.isfinite(each)) for each in (g, u_D))
    active, scale = boundary, A.diagonal()
    for _ in range(100):
        given, fixed = np.append(active, clamped), np.zeros(len(f))
        fixed[active], fixed[clamped] = g[active], u_D[clamped]
        u = solve(*condense(A, f, x=fixed, D=given)) if len(given) else spl.spsolve(A.tocsc(), f)
        reaction = np.zeros(len(f))
        reaction[active] = (A @ u - f)[active]
        now = boundary[(reaction - scale * (u - g))[boundary] > 0]
        if np.array_equal(now, active):
            return u, reaction
        active = now
    raise RuntimeError("the active set did not settle in 100 steps")


def solved(level: Path, c: float) -> pd.DataFrame:
    """Table of x, y, u and reaction at the nodes of a level."""
    mesh, nodes = MeshTri.load(level / "mesh.vtu"), pd.read_csv(level / "nodes.csv")
    triangles = meshio.read(level / "mesh.vtu").cells_dict["triangle"]  # scikit-fem turns some triangles
    A = form.assemble(Basis(mesh, ElementTriP1()), c=c)
    u, reaction = signorini(A, load(level, triangles, len(nodes)), nodes.g.to_numpy(), nodes.u_D.to_numpy())
    return pd.DataFrame({"x": mesh.p[0], "y": mesh.p[1], "u": u, "reaction": reaction})


def main(folder: str) -> None:
    problem = json.loads((Path(folder) / "problem.json").read_text())
    for level in problem["levels"]:
        table = solved(Path(folder) / level["folder"], problem["c"])
        table.to_csv(f"{folder}_{level['folder']}.csv", index=False)


if __name__ == "__main__":
    main(sys.argv[1])
