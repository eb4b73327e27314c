"""FEniCSx 0.5 with PETSc: the nodal Signorini problem by PETSc's solver of variational inequalities.

The matrix by compiled forms, as in dolfinx's demos; SNES `vinewtonrsls`, which PETSc's manual recommends for
bounds (section "Variational Inequalities"), with conjugate gradients and hypre's BoomerAMG, which it
recommends for the Laplacian. The forms' code comes from dolfinx's cache, which a first run fills.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx.fem import FunctionSpace, form
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.mesh import create_mesh, create_unit_square
from mpi4py import MPI
from petsc4py import PETSc

from benchmarks.peers.driver import Clock, match_nodes, order, report


def options(rtol: float, atol: float) -> None:
    """Set PETSc's options of SNES and of its linear solver."""
    database = PETSc.Options()
    values = {
        "snes_type": "vinewtonrsls",
        "snes_atol": atol,
        "snes_rtol": 0.0,
        "snes_stol": 0.0,
        "snes_linesearch_type": "basic",
        "ksp_type": "cg",
        "ksp_rtol": rtol,
        "pc_type": "hypre",
        "pc_hypre_type": "boomeramg",
    }
    for name, value in values.items():
        database[name] = value


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    triangles = data["triangles"].astype(np.int64)
    create = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.triangle, 1))
    clock = Clock()
    if parameters["polygon"] == "square":  # its own generator is faster than a mesh from arrays
        mesh = create_unit_square(MPI.COMM_SELF, parameters["n"], parameters["n"])
    else:
        mesh = create_mesh(MPI.COMM_SELF, triangles, points, create)
    clock.lap("mesh")
    V = FunctionSpace(mesh, ("Lagrange", 1))
    u = ufl.TrialFunction(V)
    v = ufl.TestFunction(V)
    A = assemble_matrix(form((ufl.inner(ufl.grad(u), ufl.grad(v)) + u * v) * ufl.dx))
    A.assemble()
    clock.lap("assembly")
    dofs = V.tabulate_dof_coordinates()[:, :2]
    node_of_dof = match_nodes(dofs, points)
    lower = np.full(len(points), PETSc.NINFINITY)
    lower[data["boundary"]] = data["obstacle"]
    b = A.createVecRight()
    low = A.createVecRight()
    high = A.createVecRight()
    x = A.createVecRight()
    b.array[:] = data["load"][node_of_dof]
    low.array[:] = lower[node_of_dof]
    high.set(PETSc.INFINITY)
    x.array[:] = np.maximum(low.array, 0)
    clock.skip()
    snes = PETSc.SNES().create(MPI.COMM_SELF)
    residual = A.createVecRight()

    def function(_: object, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """The residual f = A x - b."""
        A.mult(x, f)
        f.axpy(-1.0, b)

    snes.setFunction(function, residual)
    snes.setJacobian(lambda *_: None, A)
    snes.setVariableBounds(low, high)
    options(parameters["rtol"], parameters["tolerance"] * b.norm())
    snes.setFromOptions()
    snes.solve(None, x)
    clock.lap("solve")
    assert snes.getConvergedReason() > 0, snes.getConvergedReason()
    result = {
        "way": "fenicsx",
        "phases": clock.only(clock.phases),
        "iterations": snes.getLinearSolveIterations(),
        "sets": snes.getIterationNumber(),
    }
    report(clock, path, dofs, [result], [x.array])


if __name__ == "__main__":
    main()
