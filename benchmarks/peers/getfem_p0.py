"""GetFEM: this very P1/P0 method, as a Newton method for its augmented Lagrangian.

Bricks as in GetFEM's user documentation: Laplacian and mass bricks, and the basic contact brick with
B_N u <= gap, where the rows of B_N are minus the means over the cells of the boundary. Linear systems by
the solver that GetFEM chooses itself.
"""

from __future__ import annotations

import getfem as gf
import numpy as np

from benchmarks.peers.driver import Clock, match_nodes, order, report

MOST = 100


def minus_means(nodes: np.ndarray, s: np.ndarray, edges: int, n: int) -> gf.Spmat:
    """Minus the means (m, n) of the hats over cells of that many edges; nodes (nb,) along the boundary."""
    B = gf.Spmat("empty", len(nodes) // edges, n)
    half = 0.5 * np.diff(s)
    for i, cell in enumerate(np.arange(len(nodes)).reshape(-1, edges)):
        # The integrals of the hats over the cell: half of each edge goes to either end
        weights = np.zeros(edges + 1)
        weights[:-1] += half[cell]
        weights[1:] += half[cell]
        B.assign(
            [i], np.append(nodes[cell], nodes[(cell[-1] + 1) % len(nodes)]), -weights[None] / weights.sum()
        )
    return B


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    triangles = data["triangles"]
    edges = parameters["H_over_h"]
    clock = Clock()
    mesh = gf.Mesh("ptND", points.T, triangles.T)
    V = gf.MeshFem(mesh, 1)
    rule = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(2)"))
    V.set_classical_fem(1)
    clock.lap("mesh")
    dofs = V.basic_dof_nodes().T
    dof_of_node = match_nodes(points, dofs)
    load = np.empty(len(points))
    load[dof_of_node] = data["load"]
    B = minus_means(dof_of_node[data["boundary"]], data["s"], edges, len(points))
    clock.skip()
    model = gf.Model("real")
    model.add_fem_variable("u", V)
    model.add_Laplacian_brick(rule, "u")
    model.add_mass_brick(rule, "u")
    model.add_explicit_rhs("u", load)
    model.add_variable("pressure", B.size()[0])
    model.add_initialized_data("r", [parameters["r"]])
    model.add_initialized_data("alpha", [1.0])
    model.add_initialized_data("gap", -data[f"means_{edges}"])
    model.add_basic_contact_brick("u", "pressure", "r", B, "gap", "alpha", parameters["version"])
    steps, converged = model.solve("max_res", parameters["tolerance"], "max_iter", MOST)
    clock.lap("solve")
    assert converged
    result = {"way": "getfem", "H_over_h": edges, "phases": clock.only(clock.phases), "sets": int(steps)}
    report(clock, path, dofs, [result], [model.variable("u")])


if __name__ == "__main__":
    main()
