"""NGSolve: the nodal Signorini problem by nested iteration.

The preconditioner of a mesh is NGSolve's sparse Cholesky factors (`inverse="sparsecholesky"`) of the first
set, which its documentation recommends for symmetric matrices. Its algebraic multigrid `h1amg` took longer:
in two dimensions the factors are that good.
"""

from __future__ import annotations

from typing import Any

import netgen.meshing as netgen
import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from benchmarks.peers.driver import Clock, order, report
from benchmarks.peers.nested import Level, Operator, interpolation, read_levels, solve_by_nested_iteration


def make_mesh(level: Level, points: np.ndarray) -> ng.Mesh:
    """A level's mesh."""
    nodes = points[: len(level.load)]
    mesh = netgen.Mesh(dim=2)
    mesh.AddPoints(np.column_stack([nodes, np.zeros(len(nodes))]))
    mesh.Add(netgen.FaceDescriptor(bc=1, domin=1, surfnr=1))
    edges = np.column_stack([level.boundary, np.roll(level.boundary, -1)]).astype(np.int32)
    mesh.AddElements(dim=2, index=1, data=level.triangles, base=0)
    mesh.AddElements(dim=1, index=1, data=edges, base=0)
    return ng.Mesh(mesh)


def as_operator(A: Any, matrix: Any) -> Operator:
    """A matrix of NGSolve, or an inverse, for arrays (n,)."""
    x = matrix.CreateColVector()
    y = matrix.CreateColVector()

    def multiply(values: np.ndarray) -> np.ndarray:
        """The result in an array of its own."""
        x.FV().NumPy()[:] = values
        y.data = A * x
        return y.FV().NumPy().copy()

    return multiply


def factorise(matrix: Any, free: np.ndarray) -> Operator:
    """Sparse Cholesky factors for the free nodes (n,), and the diagonal for those in contact."""
    nodes = ng.BitArray(len(free))
    nodes.Set()
    contact_nodes = np.flatnonzero(~free)
    for node in contact_nodes.tolist():
        nodes.Clear(node)
    solve = as_operator(matrix.Inverse(nodes, inverse="sparsecholesky"), matrix)
    diagonal = sp.csr_matrix(matrix.CSR()).diagonal()[contact_nodes]

    def precondition(values: np.ndarray) -> np.ndarray:
        """A contact node of the first set may be a free node of the next one."""
        result = solve(values)
        result[contact_nodes] = values[contact_nodes] / diagonal
        return result

    return precondition


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    levels = read_levels(data)
    clock = Clock()
    spaces = [ng.H1(make_mesh(level, points), order=1) for level in levels]
    clock.lap("mesh")
    matrices = []
    for V in spaces:
        u, v = V.TnT()
        form = ng.BilinearForm((ng.grad(u) * ng.grad(v) + u * v) * ng.dx, symmetric=True)
        matrices.append(form.Assemble().mat)
    interpolations = [interpolation(level) for level in levels[1:]]
    clock.lap("assembly")
    values, counts = solve_by_nested_iteration(
        levels,
        interpolations,
        [as_operator(A, A) for A in matrices],
        lambda k, free: factorise(matrices[k], free),
        parameters["tolerance"] * float(data["error"]),
    )
    clock.lap("solve")
    result = {"way": parameters["way"], "phases": clock.only(clock.phases), **counts}
    report(clock, path, points, [result], [values])


if __name__ == "__main__":
    main()
