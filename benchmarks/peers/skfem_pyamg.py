"""scikit-fem and PyAMG: the nodal Signorini problem by nested iteration.

Matrices by forms, as in scikit-fem's documentation. The preconditioner is a V-cycle of PyAMG with one sweep
of Gauss-Seidel before and after, on the nested meshes themselves (`cycle: geometric`), or PyAMG's own cycle
of each matrix (`cycle: ruge_stuben`, as in scikit-fem's example 9).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyamg
import scipy.sparse as sp
from pyamg.multilevel import MultilevelSolver
from pyamg.relaxation.smoothing import change_smoothers
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP1, MeshTri
from skfem.helpers import dot, grad

from benchmarks.peers.driver import Clock, order, report
from benchmarks.peers.nested import (
    Level,
    Operator,
    interpolation,
    read_levels,
    solve_by_nested_iteration,
)


@BilinearForm
def energy(u, v, w):  # type: ignore[no-untyped-def]
    """The inner product (u, v)_1."""
    return dot(grad(u), grad(v)) + u * v


def keep_free(A: sp.csr_matrix, free: np.ndarray) -> sp.csr_matrix:
    """A with rows and columns of nodes that are not free replaced by their diagonals."""
    if free.all():
        return A
    A = A.copy()
    row_numbers = np.repeat(np.arange(A.shape[0], dtype=np.int32), np.diff(A.indptr))
    A.data[~(free[row_numbers] & free[A.indices]) & (row_numbers != A.indices)] = 0
    return A


def restrict_to_free(
    matrices: Sequence[sp.csr_matrix], interpolations: Sequence[sp.csr_matrix], free: np.ndarray
) -> tuple[list[sp.csr_matrix], list[sp.csr_matrix]]:
    """Matrices and interpolations for the free nodes (n,) of the finest mesh; nodes keep their numbers."""
    restricted = [keep_free(matrices[-1], free)]
    restricted_interpolations: list[sp.csr_matrix] = []
    for A, P in zip(matrices[-2::-1], interpolations[::-1], strict=True):
        free_coarse = free[: A.shape[0]]
        restricted.append(keep_free(A, free_coarse))
        restricted_interpolations.append(
            (sp.diags(free.astype(float)) @ P @ sp.diags(free_coarse.astype(float))).tocsr()
        )
        free = free_coarse
    return restricted[::-1], restricted_interpolations[::-1]


def make_cycle(matrices: Sequence[sp.csr_matrix], interpolations: Sequence[sp.csr_matrix]) -> Operator:
    """A V-cycle on nested meshes, the coarsest first."""
    levels = []
    for A, P in zip(matrices[::-1], [*interpolations[::-1], None], strict=True):
        level = MultilevelSolver.Level()
        level.A = A
        if P is not None:
            level.P = P
            level.R = P.T.tocsr()
        levels.append(level)
    solver = MultilevelSolver(levels, coarse_solver="splu")
    change_smoothers(solver, ("gauss_seidel", {"sweep": "forward"}), ("gauss_seidel", {"sweep": "backward"}))
    return apply_cycle(solver)


def apply_cycle(solver: MultilevelSolver) -> Operator:
    """One V-cycle of a hierarchy, as a preconditioner."""
    multiply: Operator = solver.aspreconditioner("V").matvec
    return multiply


def factorise(A: sp.csr_matrix) -> Operator:
    """Sparse factors, as a preconditioner of the coarsest mesh."""
    solve: Operator = splu(A.tocsc()).solve
    return solve


def assemble_levels(
    clock: Clock, levels: Sequence[Level], points: np.ndarray
) -> tuple[list[sp.csr_matrix], list[sp.csr_matrix]]:
    """The matrices of (u, v)_1 on all meshes, and the interpolations to all but the first."""
    bases = [
        Basis(MeshTri(points[: len(level.load)].T.copy(), level.triangles.T.astype(np.int64)), ElementTriP1())
        for level in levels
    ]
    clock.lap("mesh")
    matrices = [energy.assemble(basis).tocsr() for basis in bases]
    interpolations = [interpolation(level) for level in levels[1:]]
    clock.lap("assembly")
    return matrices, interpolations


def main() -> None:
    """A run."""
    data, parameters, path = order()
    levels = read_levels(data)
    clock = Clock()
    matrices, interpolations = assemble_levels(clock, levels, data["points"])

    def make_preconditioner(k: int, free: np.ndarray) -> Operator:
        """Factors on the coarsest mesh, and a cycle on each other."""
        if k == 0:
            return factorise(keep_free(matrices[0], free))
        if parameters["cycle"] == "geometric":
            return make_cycle(*restrict_to_free(matrices[: k + 1], interpolations[:k], free))
        set_up: Callable[..., MultilevelSolver] = getattr(pyamg, f"{parameters['cycle']}_solver")
        return apply_cycle(set_up(keep_free(matrices[k], free)))

    u, counts = solve_by_nested_iteration(
        levels,
        interpolations,
        [A.dot for A in matrices],
        make_preconditioner,
        parameters["tolerance"] * float(data["error"]),
    )
    clock.lap("solve")
    result = {"way": parameters["way"], "phases": clock.only(clock.phases), **counts}
    report(clock, path, data["points"], [result], [u])


if __name__ == "__main__":
    main()
