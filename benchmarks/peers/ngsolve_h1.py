"""NGSolve: the nodal Signorini problem by the primal-dual active set.

A linear system on the free nodes by NGSolve's own sparse Cholesky factors (`inverse="sparsecholesky"`), which
its documentation recommends for symmetric matrices. With its algebraic multigrid `h1amg`, which has to be set
up for each set as well, a set takes longer: in two dimensions its factors are that good.
"""

from __future__ import annotations

import netgen.meshing as netgen
import ngsolve as ng
import numpy as np

from benchmarks.peers.driver import Clock, order, report

MOST = 50


def triangulation(points: np.ndarray, triangles: np.ndarray, boundary: np.ndarray) -> ng.Mesh:
    """The given mesh."""
    mesh = netgen.Mesh(dim=2)
    mesh.AddPoints(np.column_stack([points, np.zeros(len(points))]))
    mesh.Add(netgen.FaceDescriptor(bc=1, domin=1, surfnr=1))
    edges = np.column_stack([boundary, np.roll(boundary, -1)]).astype(np.int32)
    mesh.AddElements(dim=2, index=1, data=triangles, base=0)
    mesh.AddElements(dim=1, index=1, data=edges, base=0)
    return ng.Mesh(mesh)


def main() -> None:
    """A run."""
    data, _, path = order()
    points = data["points"]
    triangles = data["triangles"]
    boundary = data["boundary"]
    g = data["obstacle"]
    load = data["load"]
    clock = Clock()
    mesh = triangulation(points, triangles, boundary)
    V = ng.H1(mesh, order=1)
    clock.lap("mesh")
    u, v = V.TnT()
    A = ng.BilinearForm((ng.grad(u) * ng.grad(v) + u * v) * ng.dx, symmetric=True).Assemble().mat
    clock.lap("assembly")
    x = A.CreateColVector()
    r = A.CreateColVector()
    values = x.FV().NumPy()
    residual = r.FV().NumPy()
    contact = np.ones(len(boundary), dtype=bool)
    sets = 0
    values[:] = 0
    while sets < MOST:
        sets += 1
        free = ng.BitArray(V.ndof)
        free.Set()
        for node in boundary[contact].tolist():
            free.Clear(node)
        # u = g on the contact nodes, and A u = load on the others: a correction of the residual there
        values[boundary[contact]] = g[contact]
        r.data = A * x
        residual[:] = load - residual
        x.data += A.Inverse(free, inverse="sparsecholesky") * r
        r.data = A * x
        # A contact node stays where its reaction A u - load is positive, a free one is added where u < g
        after = np.where(contact, (residual - load)[boundary] > 0, values[boundary] < g)
        if np.array_equal(after, contact):
            break
        contact = after
    clock.lap("solve")
    result = {"way": "ngsolve", "phases": clock.only(clock.phases), "sets": sets}
    report(clock, path, points, [result], [values.copy()])


if __name__ == "__main__":
    main()
