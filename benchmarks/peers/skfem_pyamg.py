"""scikit-fem and PyAMG: the nodal Signorini problem by the primal-dual active set.

Matrices by forms and contact nodes by `condense`, as in scikit-fem's documentation; linear systems by
conjugate gradients with a PyAMG hierarchy, as its example 9 has it, from the u of the set before. The set is
looked at after every factor `rtol` of the residual: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13
(2002) 865-888.
"""

from __future__ import annotations

import numpy as np
import pyamg
from skfem import Basis, BilinearForm, ElementTriP1, MeshTri, condense
from skfem.helpers import dot, grad

from benchmarks.peers.driver import Clock, order, report

MOST = 50


@BilinearForm
def energy(u, v, w):  # type: ignore[no-untyped-def]
    """The inner product (u, v)_1."""
    return dot(grad(u), grad(v)) + u * v


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    triangles = data["triangles"].astype(np.int64)
    b = data["load"]
    boundary = data["boundary"]
    g = np.full(len(points), -np.inf)
    g[boundary] = data["obstacle"]
    clock = Clock()
    basis = Basis(MeshTri(points.T.copy(), triangles.T.copy()), ElementTriP1())
    clock.lap("mesh")
    A = energy.assemble(basis)
    clock.lap("assembly")
    u = np.where(np.isfinite(g), g, 0.0)
    contact = np.sort(boundary)
    sets = 0
    iterations = 0
    small = parameters["tolerance"] * np.linalg.norm(b)
    while True:
        u[contact] = g[contact]
        sets = sets + 1
        A_II, b_I, _, inner = condense(A, b, x=u, D=contact)
        hierarchy = getattr(pyamg, f"{parameters['hierarchy']}_solver")(A_II)
        after = contact
        r = b_I - A_II @ u[inner]
        while np.array_equal(after, contact) and np.linalg.norm(r) > small:
            residuals: list[float] = []
            u[inner] += hierarchy.solve(r, tol=parameters["rtol"], accel="cg", residuals=residuals)
            r = b_I - A_II @ u[inner]
            iterations = iterations + len(residuals) - 1
            # Next: contact nodes with a positive reaction A u - b, and boundary nodes with u < g
            pressed = contact[A[contact] @ u > b[contact]]
            after = np.union1d(pressed, boundary[u[boundary] < g[boundary]])
        if np.array_equal(after, contact) or sets == MOST:
            break
        contact = after
    clock.lap("solve")
    result = {"way": "skfem", "phases": clock.only(clock.phases), "iterations": iterations, "sets": sets}
    report(clock, path, points, [result], [u])


if __name__ == "__main__":
    main()
