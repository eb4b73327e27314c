"""FEniCSx 0.5 with PETSc: the nodal Signorini problem by nested iteration.

Matrices by compiled forms, as in dolfinx's demos; their code comes from dolfinx's cache, which a first run
fills. `method: active_set` is that of `nested.py` with a cycle of PCMG on the nested meshes, or of hypre's
BoomerAMG. `method: snesvi` is PETSc's `vinewtonrsls`, which its manual recommends for bounds (section
"Variational Inequalities"), from the u of the mesh before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from dolfinx.fem import FunctionSpace, form
from dolfinx.fem.petsc import assemble_matrix
from dolfinx.mesh import create_mesh, create_unit_square
from mpi4py import MPI
from petsc4py import PETSc

from benchmarks.peers.driver import Clock, match_nodes, order, report
from benchmarks.peers.nested import (
    Level,
    Operator,
    interpolation,
    read_levels,
    renumber,
    solve_by_nested_iteration,
)

CYCLE = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_ksp_norm_type": "none",
    "mg_levels_pc_type": "sor",
    "mg_coarse_pc_type": "lu",
}
"""PCMG with one sweep of SOR before and after."""
SNESVI = {
    "snes_type": "vinewtonrsls",
    "snes_rtol": 0.0,
    "snes_stol": 0.0,
    "snes_linesearch_type": "basic",
    "snes_max_it": 100,
    "ksp_type": "cg",
    "ksp_rtol": 0.1,
    "pc_type": "hypre",
    "pc_hypre_type": "boomeramg",
}


COARSE_TOLERANCE = 1e-3
"""SNESVI's tolerance on all meshes but the finest."""


def set_options(values: dict[str, Any]) -> None:
    """Set PETSc's options."""
    database = PETSc.Options()
    for name, value in values.items():
        database[name] = value


def make_space(level: Level, points: np.ndarray, is_uniform_square: bool) -> FunctionSpace:
    """P1 on a level's mesh; of the square by dolfinx's own generator, which is faster."""
    if is_uniform_square:
        n = round(len(level.load) ** 0.5) - 1
        mesh = create_unit_square(MPI.COMM_SELF, n, n)
    else:
        element = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.triangle, 1))
        nodes = points[: len(level.load)]
        mesh = create_mesh(MPI.COMM_SELF, level.triangles.astype(np.int64), nodes, element)
    return FunctionSpace(mesh, ("Lagrange", 1))


def assemble(V: FunctionSpace) -> PETSc.Mat:
    """The matrix of (u, v)_1."""
    u = ufl.TrialFunction(V)
    v = ufl.TestFunction(V)
    A = assemble_matrix(form((ufl.inner(ufl.grad(u), ufl.grad(v)) + u * v) * ufl.dx))
    A.assemble()
    return A


def as_operator(apply: Any, n: int) -> Operator:
    """What PETSc applies to its vectors, for arrays (n,)."""
    x = PETSc.Vec().createSeq(n)
    y = PETSc.Vec().createSeq(n)

    def multiply(values: np.ndarray) -> np.ndarray:
        """The result in an array of its own."""
        x.array[:] = values
        apply(x, y)
        return y.array.copy()

    return multiply


def keep_free(A: PETSc.Mat, free: np.ndarray) -> PETSc.Mat:
    """A with 0 in rows and columns of nodes that are not free, and 1 on their diagonals."""
    A = A.copy()
    A.zeroRowsColumns(np.flatnonzero(~free).astype(np.int32), diag=1.0)
    return A


def make_cycle(
    preconditioner: str,
    matrices: Sequence[PETSc.Mat],
    interpolations: Sequence[sp.csr_matrix],
    k: int,
    free: np.ndarray,
) -> Operator:
    """Factors on the coarsest mesh, and a cycle on each other, for the free nodes (n,) of mesh k."""
    pc = PETSc.PC().create(MPI.COMM_SELF)
    A = keep_free(matrices[k], free)
    pc.setOperators(A)
    if k == 0:
        pc.setType("lu")
    elif preconditioner == "mg":
        set_options(CYCLE)
        pc.setType("mg")
        pc.setMGLevels(k + 1)
        pc.getMGSmoother(k).setOperators(A)
        for j in range(k, 0, -1):
            # A coarse node is free if the same node of the finer mesh is: its row has one entry, 1
            P = interpolations[j - 1]
            same = np.flatnonzero(np.diff(P.indptr) == 1)
            free_coarse = np.empty(P.shape[1], bool)
            free_coarse[P.indices[P.indptr[same]]] = free[same]
            P = (sp.diags(free.astype(float)) @ P @ sp.diags(free_coarse.astype(float))).tocsr()
            pc.setMGInterpolation(j, PETSc.Mat().createAIJ(P.shape, csr=(P.indptr, P.indices, P.data)))
            pc.getMGSmoother(j - 1).setOperators(keep_free(matrices[j - 1], free_coarse))
            free = free_coarse
    else:
        pc.setType("hypre")
        pc.setHYPREType("boomeramg")
    pc.setFromOptions()
    pc.setUp()
    return as_operator(pc.apply, A.getSize()[0])


def solve_by_snesvi(
    levels: Sequence[Level],
    interpolations: Sequence[sp.csr_matrix],
    matrices: Sequence[PETSc.Mat],
    tolerance: float,
) -> tuple[np.ndarray, dict[str, int]]:
    """u (n,) on the finest mesh, where the residual's norm is at most `tolerance` times the load's."""
    set_options(SNESVI)
    u = np.maximum(levels[0].obstacle, 0.0)
    for k, (level, A) in enumerate(zip(levels, matrices, strict=True)):
        if k:
            u = np.maximum(interpolations[k - 1] @ u, level.obstacle)
        x = A.createVecRight()
        b = A.createVecRight()
        low = A.createVecRight()
        high = A.createVecRight()
        residual = A.createVecRight()
        x.array[:] = u
        b.array[:] = level.load
        low.array[:] = level.obstacle
        high.set(PETSc.INFINITY)
        snes = PETSc.SNES().create(MPI.COMM_SELF)

        def evaluate(_: object, x: PETSc.Vec, f: PETSc.Vec, A: PETSc.Mat = A, b: PETSc.Vec = b) -> None:
            """The residual f = A x - b."""
            A.mult(x, f)
            f.axpy(-1.0, b)

        snes.setFunction(evaluate, residual)
        snes.setJacobian(lambda *_: None, A)
        snes.setVariableBounds(low, high)
        snes.setFromOptions()
        relative = tolerance if k + 1 == len(levels) else COARSE_TOLERANCE
        snes.setTolerances(atol=relative * b.norm())
        snes.solve(None, x)
        assert snes.getConvergedReason() > 0, (k, snes.getConvergedReason())
        u = x.array.copy()
    return u, {"iterations": snes.getLinearSolveIterations(), "sets": snes.getIterationNumber()}


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    levels = read_levels(data)
    clock = Clock()
    is_uniform_square = parameters["polygon"] == "square" and parameters["flat"] == 1
    spaces = [make_space(level, points, is_uniform_square) for level in levels]
    clock.lap("mesh")
    matrices = [assemble(V) for V in spaces]
    interpolations = [interpolation(level) for level in levels[1:]]
    clock.lap("assembly")
    # dolfinx numbers nodes anew: an artefact of data that all solvers share, which does not count
    dofs = [V.tabulate_dof_coordinates()[:, :2] for V in spaces]
    nodes = [match_nodes(x, points[: len(x)]) for x in dofs]
    levels = renumber(levels, nodes)
    interpolations = [
        P[fine][:, coarse].sorted_indices()
        for P, coarse, fine in zip(interpolations, nodes[:-1], nodes[1:], strict=True)
    ]
    clock.skip()
    if parameters["method"] == "snesvi":
        u, counts = solve_by_snesvi(levels, interpolations, matrices, parameters["tolerance"])
    else:
        u, counts = solve_by_nested_iteration(
            levels,
            interpolations,
            [as_operator(A.mult, A.getSize()[0]) for A in matrices],
            lambda k, free: make_cycle(parameters["preconditioner"], matrices, interpolations, k, free),
            parameters["tolerance"] * float(data["error"]),
        )
    clock.lap("solve")
    result = {"way": parameters["way"], "phases": clock.only(clock.phases), **counts}
    report(clock, path, dofs[-1], [result], [u])


if __name__ == "__main__":
    main()
