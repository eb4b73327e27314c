"""Guaranteed bounds and true errors of solutions of other methods, as another program may hand them in.

These are linear on triangles. Matrices and loads are scikit-fem's. On clamped sides each solution has the
given values at nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import skfem
import xarray as xr
from scipy.sparse.linalg import spsolve
from skfem.models.poisson import laplace, mass

from study import scenes, tables
from unilateral.arrays import Array, Mask
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.reference import boundary_facets
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case import ExactSolution
from unilateral.solution.certification import certify_nodal_values
from unilateral.solution.solver import Solver

SOURCE_RULE_DEGREE = 8
"""The degree of the quadrature of f."""
MAX_NODAL_ACTIVE_SETS = 100
"""The most active sets; a dozen are enough."""


def measure_certify(study: Mapping[str, Any], solutions: str) -> None:
    """Write the table of all cases, sizes and methods."""
    sizes = [parse_real(h, "certify.h") for h in study["h"]]
    case_tables = []
    for case in chain.from_iterable(map(scenes.load_cases, study["scenes"])):
        levels = [measure(case, make_structured_mesh(case.polygon, h), study) for h in sizes]
        case_tables.append(xr.concat(levels, "mesh").assign_coords(case=case.name))
        print(f"{case.name} measured")
    table = xr.concat(case_tables, "case").assign_coords(h=("mesh", sizes))
    tables.save_table(table, solutions, "certify", {"certify": study})


def measure(case: ExactSolution, mesh: Mesh, study: Mapping[str, Any]) -> xr.Dataset:
    """The error and its bound over `scheme`, on one mesh."""
    mixed = Solver(case.problem, mesh=mesh, H=2 * mesh.h)().u
    solutions = {"mixed method": mixed, **solve_by_others(case, mesh, study["penalties"], study["sweeps"])}
    errors = [h1_distance(case, mesh, v) for v in solutions.values()]
    bounds = [
        certify_nodal_values(case.problem, mesh, v, None).bounded.total_bound("h1")
        for v in solutions.values()
    ]
    values = {"certified_error": ("scheme", errors), "certified_bound": ("scheme", bounds)}
    return xr.Dataset(values, coords={"scheme": list(solutions)})


def solve_by_others(
    case: ExactSolution, mesh: Mesh, penalties: Sequence[int], sweeps: int
) -> dict[str, Array]:
    """Values at the nodes (n,) of each method's solution, by its name."""
    linear = assemble_nodal_problem(case, mesh, skfem.ElementTriP1())
    quadratic_solution = solve_nodal_problem(assemble_nodal_problem(case, mesh, skfem.ElementTriP2()))
    # a penalty's force per length, by the trapezoidal rule: each node has half of both edges beside it
    lengths = np.diff(mesh.s)
    half = np.zeros(mesh.n_nodes)
    half[mesh.boundary] = 0.5 * (lengths + np.roll(lengths, 1))
    return {
        "nodal constraints": solve_nodal_problem(linear),
        "P2, interpolated": quadratic_solution[: mesh.n_nodes],  # scikit-fem numbers the nodes first
        **{f"penalty {k}/h": solve_nodal_problem(linear, k / mesh.h * half) for k in penalties},
        "stopped early": iterate_gauss_seidel(linear, sweeps),
        "half the load": solve_nodal_problem(linear._replace(load=linear.load / 2)),
    }


class NodalProblem(NamedTuple):
    """Find x >= g with r = Ax - load >= 0 and r.(x - g) = 0 at unknowns that are not fixed.

    g (n,) is -inf where x is not constrained, and the value of x where it is `fixed` (n,).
    """

    A: sp.csr_array
    load: Array
    g: Array
    fixed: Mask


def assemble_nodal_problem(case: ExactSolution, mesh: Mesh, element: skfem.Element) -> NodalProblem:
    """A case with u >= g at the element's boundary unknowns: nodes, and for P2 the midpoints of edges."""
    skfem_mesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.Basis(skfem_mesh, element, intorder=SOURCE_RULE_DEGREE)
    A = laplace.assemble(basis) + case.c * mass.assemble(basis)

    @skfem.LinearForm
    def source_load(v: Any, w: Any) -> Any:
        """f v at the points of quadrature."""
        return case.source(w.x.reshape(2, -1).T).reshape(w.x.shape[1:]) * v

    g, fixed = _place_obstacle(case, mesh, basis)
    return NodalProblem(A.tocsr(), source_load.assemble(basis), g, fixed)


def _place_obstacle(case: ExactSolution, mesh: Mesh, basis: skfem.Basis) -> tuple[Array, Mask]:
    """The g (n,) of a `NodalProblem`, -inf inside, and which unknowns of the basis are clamped, (n,)."""
    facets = boundary_facets(basis.mesh, mesh)
    clamped = np.isin(mesh.side, case.clamped_sides)
    g = np.full(basis.N, -np.inf)
    fixed = np.zeros(basis.N, dtype=bool)
    ends = [basis.nodal_dofs[0][nodes] for nodes in (mesh.boundary, np.roll(mesh.boundary, -1))]
    places = [(ends[0], 0.0), (ends[1], 1.0), *((dofs[facets], 0.5) for dofs in basis.facet_dofs)]
    for dofs, edge_share in places:
        s = mesh.s[:-1] + edge_share * np.diff(mesh.s) - mesh.polygon.starts[mesh.side]
        u, _, gap = case.trace_flux_and_gap(mesh.side, s)
        np.maximum.at(g, dofs, u - gap)
        fixed[dofs[clamped]] = True
    return g, fixed


def solve_nodal_problem(problem: NodalProblem, springs: Array | None = None) -> Array:
    """The solution (n,) by the primal-dual active set method of Hintermüller, Ito and Kunisch (2002).

    With `springs` (n,) the forces springs (g - x)_+ are in place of the constraint: the penalty method.
    """
    A, load, g, fixed = problem
    diagonal = A.diagonal()
    active = np.isfinite(g) & ~fixed
    for _ in range(MAX_NODAL_ACTIVE_SETS):
        prescribed = fixed | active if springs is None else fixed
        # (A + diag(push)) x = load + push g: the springs of the active nodes; x = g where it is prescribed
        push = np.zeros_like(load) if springs is None else np.where(active, springs, 0.0)
        matrix = (A + sp.diags_array(push)).tocsr()
        x = np.where(prescribed, g, 0.0)
        right_side = load + push * np.where(active, g, 0.0) - matrix @ x
        x[~prescribed] = spsolve(matrix[~prescribed][:, ~prescribed].tocsc(), right_side[~prescribed])
        # next a node is active where the reaction is larger than the gap, times the diagonal
        previous = active
        active = ~fixed & (A @ x - load > diagonal * (x - g))
        if np.array_equal(active, previous):
            break
    return x


def iterate_gauss_seidel(problem: NodalProblem, sweeps: int) -> Array:
    """x after some sweeps of the projected Gauss-Seidel iteration, from g on the boundary and 0 inside."""
    A, load, g, fixed = problem
    diagonal = A.diagonal()
    x = np.where(np.isfinite(g), g, 0.0)
    for node in np.tile(np.flatnonzero(~fixed), sweeps):
        row = slice(A.indptr[node], A.indptr[node + 1])
        # x_i <- max(g_i, x_i + (load - A x)_i / A_ii)
        residual = load[node] - A.data[row] @ x[A.indices[row]]
        x[node] = max(x[node] + residual / diagonal[node], g[node])
    return x
