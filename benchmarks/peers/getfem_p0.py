"""GetFEM: this very P1/P0 method, as a Newton method for its augmented Lagrangian, from mesh to mesh.

Bricks as in GetFEM's user documentation: Laplacian and mass bricks, and the basic contact brick with
B_N u <= gap, where the rows of B_N are minus the means over the cells of the boundary. Linear systems by
the solver that GetFEM chooses itself. Each mesh starts from u and the pressure of the mesh before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import getfem as gf
import numpy as np

from benchmarks.peers.driver import Clock, match_nodes, order, report
from benchmarks.peers.nested import Level, interpolation, read_levels

MAX_STEPS = 100


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


def coarsen_means(means: np.ndarray, s: np.ndarray) -> np.ndarray:
    """The means (m / 2,) over pairs of cells, from those over m cells between arc lengths (m + 1,)."""
    lengths = np.diff(s).reshape(-1, 2)
    averages: np.ndarray = (lengths * means.reshape(-1, 2)).sum(axis=1) / lengths.sum(axis=1)
    return averages


def make_space(mesh: Any) -> Any:
    """P1 on a mesh."""
    V = gf.MeshFem(mesh, 1)
    V.set_classical_fem(1)
    return V


def list_means(finest_means: np.ndarray, levels: list[Level], edges: int) -> list[np.ndarray]:
    """The cell means of g on each level, from those on the finest, over cells of that many edges."""
    means = [finest_means]
    for level in levels[:0:-1]:
        means.insert(0, coarsen_means(means[0], level.s[::edges]))
    return means


def renumber_values(values: np.ndarray, dof_of_node: np.ndarray) -> np.ndarray:
    """The values (n,) at nodes in the order of GetFEM's unknowns."""
    renumbered = np.empty(len(values))
    renumbered[dof_of_node] = values
    return renumbered


def build_model(
    mesh: Any,
    V: Any,
    level: Level,
    dof_of_node: np.ndarray,
    means: np.ndarray,
    parameters: Mapping[str, Any],
) -> Any:
    """The problem on a level, with the cell means (m,) of g; node i has the unknown `dof_of_node[i]` (n,)."""
    B = minus_means(dof_of_node[level.boundary], level.s, parameters["H_over_h"], len(dof_of_node))
    rule = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(2)"))
    model = gf.Model("real")
    model.add_fem_variable("u", V)
    model.add_Laplacian_brick(rule, "u")
    model.add_mass_brick(rule, "u")
    model.add_explicit_rhs("u", renumber_values(level.load, dof_of_node))
    model.add_variable("pressure", len(means))
    model.add_initialized_data("r", [parameters["r"]])
    model.add_initialized_data("alpha", [1.0])
    model.add_initialized_data("gap", -means)
    model.add_basic_contact_brick("u", "pressure", "r", B, "gap", "alpha", parameters["version"])
    return model


def solve_from_mesh_to_mesh(
    levels: list[Level],
    meshes: list[Any],
    spaces: list[Any],
    numbers: list[np.ndarray],
    means: list[np.ndarray],
    parameters: Mapping[str, Any],
) -> tuple[np.ndarray, int]:
    """u (n,) at the nodes of the finest mesh, and the steps of Newton's method there.

    On each level node i has the unknown `numbers[k][i]`, and g the cell means `means[k]`.
    """
    u = np.zeros(0)
    pressure = np.zeros(0)
    for k, level in enumerate(levels):
        model = build_model(meshes[k], spaces[k], level, numbers[k], means[k], parameters)
        # the start: u interpolated from the mesh before, and the pressure of each cell in both its halves
        if k:
            model.set_variable("u", renumber_values(interpolation(level) @ u, numbers[k]))
            model.set_variable("pressure", np.repeat(pressure, 2))
        steps, converged = model.solve("max_res", parameters["tolerance"], "max_iter", MAX_STEPS)
        assert converged
        u = model.variable("u")[numbers[k]]
        pressure = model.variable("pressure")
    return u, int(steps)


def main() -> None:
    """A run."""
    data, parameters, path = order()
    points = data["points"]
    edges = parameters["H_over_h"]
    levels = [level for level in read_levels(data) if len(level.boundary) % edges == 0]
    means = list_means(data[f"means_{edges}"], levels, edges)
    clock = Clock()
    meshes = [gf.Mesh("ptND", points[: len(level.load)].T, level.triangles.T) for level in levels]
    spaces = [make_space(mesh) for mesh in meshes]
    clock.lap("mesh")
    # GetFEM numbers nodes anew: an artefact of data that all solvers share, which does not count
    dofs = [V.basic_dof_nodes().T for V in spaces]
    numbers = [match_nodes(points[: len(x)], x) for x in dofs]
    clock.skip()
    u, steps = solve_from_mesh_to_mesh(levels, meshes, spaces, numbers, means, parameters)
    clock.lap("solve")
    result = {"way": parameters["way"], "H_over_h": edges, "phases": clock.only(clock.phases)}
    report(clock, path, points, [{**result, "sets": steps}], [u])


if __name__ == "__main__":
    main()
