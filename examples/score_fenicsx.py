"""Solves exported cases with FEniCSx 0.5: P1, constraints at the nodes, PETSc's SNESVI.

    unilateral export natural --h 1/32 --H 1/16 --levels 3 --out natural
    python examples/score_fenicsx.py natural
    unilateral score natural natural_fenicsx_?.csv

The program reads only the exported files, and does not import `unilateral`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

MISSING = 5
"""Exit code if FEniCSx is missing."""
try:
    import numpy as np
    import ufl
    from dolfinx.fem import FunctionSpace, form
    from dolfinx.fem.petsc import assemble_matrix
    from dolfinx.mesh import create_mesh
    from mpi4py import MPI
    from petsc4py import PETSc
    from scipy.spatial import cKDTree
except ImportError:
    print("FEniCSx is missing; Debian's package python3-dolfinx installs it", file=sys.stderr)
    sys.exit(MISSING)


def triangles(file: Path) -> np.ndarray:
    """Triangles (m, 3) of a text file of Gmsh; `dolfinx.io.gmshio` reads it, too, but needs Gmsh."""
    rows = [line.split() for line in file.read_text().partition("$Elements")[2].splitlines()]
    return np.array([row[-3:] for row in rows if len(row) > 3 and row[1] == "2"], dtype=np.int64) - 1


def variational_inequality(A: PETSc.Mat, b: PETSc.Vec, lower: PETSc.Vec) -> PETSc.Vec:
    """Solution x >= lower of A x >= b, with equality where x > lower."""
    x, residual, upper = A.createVecRight(), A.createVecRight(), A.createVecRight()
    upper.set(PETSc.INFINITY)
    snes = PETSc.SNES().create(MPI.COMM_SELF)
    snes.setType("vinewtonrsls")
    snes.setFunction(lambda _, x, f: (A.mult(x, f), f.axpy(-1.0, b)), residual)
    snes.setJacobian(lambda *_: None, A)
    snes.setVariableBounds(lower, upper)
    snes.setTolerances(rtol=0, atol=1e-11 * b.norm(), stol=0)
    snes.getKSP().setType("preonly")
    snes.getKSP().getPC().setType("lu")
    snes.solve(None, x)
    if snes.getConvergedReason() <= 0:
        raise RuntimeError(f"SNESVI did not converge: reason {snes.getConvergedReason()}")
    return x


def solved(level: Path) -> np.ndarray:
    """Table x, y, u, reaction (n, 4) of the nodes of a level."""
    nodes = np.genfromtxt(level / "nodes.csv", delimiter=",", names=True)
    points = np.column_stack([nodes["x"], nodes["y"]])
    element = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.triangle, 1))
    V = FunctionSpace(
        create_mesh(MPI.COMM_SELF, triangles(level / "mesh.msh"), points, element), ("Lagrange", 1)
    )
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    A = assemble_matrix(form((ufl.inner(ufl.grad(u), ufl.grad(v)) + u * v) * ufl.dx))
    A.assemble()
    of_dof = nodes[cKDTree(points).query(V.tabulate_dof_coordinates()[:, :2])[1]]
    b, lower, reaction = (A.createVecRight() for _ in range(3))
    b.array[:] = of_dof["load"]
    lower.array[:] = np.where(np.isfinite(of_dof["g"]), of_dof["g"], PETSc.NINFINITY)
    x = variational_inequality(A, b, lower)
    A.mult(x, reaction)
    return np.column_stack([of_dof["x"], of_dof["y"], x.array, reaction.array - b.array])


if __name__ == "__main__":
    for k, each in enumerate(json.loads(Path(sys.argv[1], "problem.json").read_text())["levels"]):
        name, table = f"{sys.argv[1]}_fenicsx_{k}.csv", solved(Path(sys.argv[1], each["folder"]))
        np.savetxt(name, table, "%.17g", ",", header="x,y,u,reaction", comments="")
