"""Errors of lambda by the method of 1980, by nodal constraints and by a stabilised method.

Each method has functions psi_i that are linear on boundary edges, and finds u_h in V_h and
lambda = sum_i lambda_i psi_i with

    A u_h - B^T lambda = f,   lambda_i >= 0,   d = B u_h + C lambda - g >= 0,   lambda_i d_i = 0.

The method of 1980 on cells of H = 2h or 4h has (psi_i) the indicators of cells, B_ij = <psi_i, phi_j>,
g_i = <psi_i, g>, and C = 0.

Nodal constraints, u_h >= g at the boundary nodes x_i, have the dual basis: <psi_i, phi_j> = 0 for i != j, and
<psi_i, phi_i> = <1, phi_i> (B. Wohlmuth, Acta Numerica 20 (2011) 569-734). The psi_i are not continuous.
g_i = <1, phi_i> g(x_i), and C = 0. So lambda_i is the reaction at x_i over <1, phi_i>.

The stabilised method has the indicators of boundary edges, so H = h. It seeks the saddle point of

    |v|_1^2 / 2 - (f, v) - <mu, v - g> - gamma/2 sum_e |e| ||mu - dv/dn||_{0,e}^2,

with the residual lambda - du/dn = 0 squared (H. J. C. Barbosa, T. J. R. Hughes, Comput. Methods Appl. Mech.
Engrg. 97 (1992) 193-210); |v|_1 is the norm of the form here. On an edge dv_h/dn is constant, N v.

The lambda_i also give linear functions, which are no multipliers of these methods: through the lambda_i at
the midpoints of cells, or at nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import xarray as xr

from study import scenes, tables
from unilateral.arrays import Array, Index
from unilateral.exchange.boundary_function import obstacle_at_nodes
from unilateral.fem.linear_systems import OrderedMatrix, elimination_order
from unilateral.fem.p1 import case_moments, energy_norm, gradients, load_vector, stiffness_and_mass
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import DualOperator
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.functionals import evaluate_on_cells
from unilateral.problems.case import ExactSolution
from unilateral.solvers.uzawa import uzawa

ALGEBRAIC_TOLERANCE = 1e-10
"""The guaranteed bound on the algebraic error of each lambda: far below all errors."""
REFERENCE_EDGES = 4
"""Edges of the reference mesh of the dual norm on each boundary edge."""
NODAL = "nodal reactions"
STABILISED = "stabilised, H = h"
LINEAR = "linear"
ERRORS = ("hm12_error_lower", "hm12_error_upper", "l2_error", "algebraic_bound")
"""The variables over `case` and `scheme`."""


def measure_multipliers(study: Mapping[str, Any], errors: str) -> None:
    """Write the table of all cases, methods and sizes."""
    sizes = [parse_real(h, "multipliers.h") for h in study["h"]]
    cases = list(chain.from_iterable(map(scenes.load_cases, study["scenes"])))
    stabilisation = parse_real(study["stabilisation"], "multipliers.stabilisation")
    levels = []
    for h in sizes:
        mesh = make_structured_mesh(cases[0].polygon, h)
        levels.append(measure(cases, mesh, study["edges_per_cell"], stabilisation))
        print(f"h = {h:g} measured")
    table = xr.concat(levels, "mesh").assign_coords(h=("mesh", sizes))
    tables.save_table(table, errors, "multipliers", {"multipliers": study})


def measure(
    cases: Sequence[ExactSolution], mesh: Mesh, edges_per_cell: Sequence[int], stabilisation: float
) -> xr.Dataset:
    """The errors of lambda over `case` and `scheme`, on one mesh; all cases are on its polygon."""
    edges = Partition(mesh.polygon, mesh.s)
    norm = build_dual_norm(edges, cases, REFERENCE_EDGES)
    methods = discretise(cases, mesh, edges_per_cell, stabilisation)
    rows = []
    for k, case in enumerate(cases):
        multipliers, bounds = solve_methods(methods.values(), k)
        lower, upper = norm.bound_error(case, multipliers, edges)
        rows.append([lower, upper, measure_l2_errors(case, edges, multipliers), bounds])
    named_columns = zip(ERRORS, np.moveaxis(np.array(rows), 1, 0), strict=True)
    values = {name: (("case", "scheme"), column) for name, column in named_columns}
    return xr.Dataset(
        {**values, "multipliers": ("scheme", count_multipliers(methods))},
        coords={"case": [case.name for case in cases], "scheme": list(methods)},
    )


def count_multipliers(methods: Mapping[str, Method]) -> list[int]:
    """How many lambda_i each method has."""
    return [len(method.operator.H_i) for method in methods.values()]


def solve_methods(methods: Iterable[Method], k: int) -> tuple[Array, list[float]]:
    """Each method's multiplier (methods, nb, 2) for case k at the ends of edges, and its algebraic bound."""
    results = [
        (method, uzawa(method.operator, method.offsets[k], ALGEBRAIC_TOLERANCE, method="newton"))
        for method in methods
    ]
    multipliers = np.array([method.evaluate_at_ends(result.lambda_H) for method, result in results])
    return multipliers, [result.bound for _, result in results]


class Method(NamedTuple):
    """A method without u_h: lambda_i >= 0, d = D lambda + q >= 0, and lambda_i d_i = 0.

    D = B A^{-1} B^T + C (m, m) is that of the `operator`, q = B A^{-1} f - g, and the `offsets` (k, m) of k
    cases are q_i over <1, psi_i>. `basis` (2 nb, m) has the values of psi_i at both ends of each
    boundary edge.
    """

    basis: sp.csr_array
    operator: DualOperator
    offsets: Array

    def evaluate_at_ends(self, multiplier: Array) -> Array:
        """The values (nb, 2) of lambda at both ends of each boundary edge, from the lambda_i (m,)."""
        return (self.basis @ multiplier).reshape(-1, 2)


def discretise(
    cases: Sequence[ExactSolution], mesh: Mesh, edges_per_cell: Sequence[int], stabilisation: float
) -> dict[str, Method]:
    """All methods by their names."""
    stiffness, mass = stiffness_and_mass(mesh)
    A = stiffness + mass
    order = elimination_order(A, mesh.boundary)
    loads = np.array([load_vector(mesh, case_moments(case, mesh)) for case in cases])
    # A^{-1} on the boundary and A^{-1} f there serve all methods without C
    inverse, traces = eliminate(A, boundary_trace(mesh), loads, order)
    methods = {}
    for name, (basis, g) in list_bases(cases, mesh, edges_per_cell).items():
        B = basis.T @ pair_with_hats(mesh)
        methods[name] = make_method(mesh, basis, B @ (B @ inverse).T, traces @ B.T - g)
    edge_integrals = integrate_obstacles(cases, Partition(mesh.polygon, mesh.s))
    methods[STABILISED] = stabilise(mesh, A, loads, order, edge_integrals, stabilisation)
    return methods | draw_linear_functions(methods, mesh, edges_per_cell[0])


def stabilise(
    mesh: Mesh, A: sp.csr_array, loads: Array, order: Index, g: Array, stabilisation: float
) -> Method:
    """The stabilised method with a constant on each edge; `g` (k, nb) are the integrals over the edges."""
    # the saddle point has C = gamma |e|^2, and A - N^T C N and B - C N in the places of A and B
    N = normal_derivatives(mesh)
    C = sp.diags_array(stabilisation * np.diff(mesh.s) ** 2)
    basis = indicator_basis(np.arange(len(mesh.boundary)))
    B = basis.T @ pair_with_hats(mesh) @ boundary_trace(mesh) - C @ N
    D, q = eliminate((A - N.T @ C @ N).tocsr(), B, loads, order)
    return make_method(mesh, basis, D + C.toarray(), q - g)


def boundary_trace(mesh: Mesh) -> sp.csr_array:
    """The matrix (nb, n) that takes values at nodes to those at boundary nodes."""
    nb = len(mesh.boundary)
    return sp.csr_array((np.ones(nb), (np.arange(nb), mesh.boundary)), shape=(nb, mesh.n_nodes))


def list_bases(
    cases: Sequence[ExactSolution], mesh: Mesh, edges_per_cell: Sequence[int]
) -> dict[str, tuple[sp.csr_array, Array]]:
    """The psi_i and the g_i (k, m) of the methods without C, by their names."""
    nb = len(mesh.boundary)
    lengths = np.diff(mesh.s)
    bases = {}
    for count in edges_per_cell:
        cells = Partition(mesh.polygon, mesh.s[::count])
        basis = indicator_basis(np.arange(nb) // count)
        bases[f"P0, H = {count}h"] = (basis, integrate_obstacles(cases, cells))
    nodal_obstacles = np.array([obstacle_at_nodes(case.problem, mesh) for case in cases])
    bases[NODAL] = (nodal_basis(nb, 2.0, -1.0), 0.5 * (lengths + np.roll(lengths, 1)) * nodal_obstacles)
    return bases


def draw_linear_functions(
    methods: Mapping[str, Method], mesh: Mesh, edges_per_cell: int
) -> dict[str, Method]:
    """Linear functions by the same lambda_i: through midpoints of cells, and by values at nodes."""
    through_midpoints = midpoint_basis(mesh, Partition(mesh.polygon, mesh.s[::edges_per_cell]))
    cells_name = f"P0, H = {edges_per_cell}h"
    at_nodes = nodal_basis(len(mesh.boundary), 1.0, 0.0)
    return {
        f"{cells_name}, {LINEAR}": methods[cells_name]._replace(basis=through_midpoints),
        f"{NODAL}, {LINEAR}": methods[NODAL]._replace(basis=at_nodes),
    }


def eliminate(A: sp.csr_array, B: sp.csr_array, loads: Array, order: Index) -> tuple[Array, Array]:
    """B A^{-1} B^T (m, m), and B A^{-1} f (k, m) of the loads f (k, n)."""
    products = OrderedMatrix(A, order).inverse_products(sp.hstack([B.T, sp.csc_array(loads.T)], format="csc"))
    m = B.shape[0]
    return products[:m, :m], products[m:, :m]


def integrate_obstacles(cases: Sequence[ExactSolution], cells: Partition) -> Array:
    """The integrals (k, m) of g over the cells."""
    return np.array([cells.lengths * cell_means(case, cells).g_means for case in cases])


def make_method(mesh: Mesh, basis: sp.csr_array, D: Array, q: Array) -> Method:
    """The method with these psi_i, D (m, m) and B A^{-1} f - g (k, m)."""
    # <1, psi_i>, as each psi_i is linear on edges
    weights = basis.T @ np.repeat(0.5 * np.diff(mesh.s), 2)
    norm_of_1 = energy_norm(mesh, np.ones(mesh.n_nodes))
    operator = DualOperator(np.asarray(np.linalg.cholesky(D).T), weights, shift_norm=norm_of_1)
    return Method(basis, operator, q / weights)


def indicator_basis(cell: Index) -> sp.csr_array:
    """The values at the ends of edges of the indicators of cells, from the cell (nb,) of each edge."""
    rows = np.arange(2 * len(cell))
    return sp.csr_array((np.ones(2 * len(cell)), (rows, np.repeat(cell, 2))))


def nodal_basis(nb: int, at_node: float, at_neighbour: float) -> sp.csr_array:
    """The values at the ends of edges of functions (2 nb, nb), one for each node, linear on its two edges.

    They are `at_node` at the node, and `at_neighbour` at the other ends of both edges: 1 and 0 for hats. With
    2 and -1 they are 2 - 3x and 3x - 1 on an edge, the dual basis: the integral of (2 - 3x) x is 0.
    """
    start = np.arange(nb)
    end = (start + 1) % nb
    rows = np.concatenate([2 * start, 2 * start + 1, 2 * start, 2 * start + 1])
    columns = np.concatenate([start, end, end, start])
    return sp.csr_array((np.repeat([at_node, at_neighbour], 2 * nb), (rows, columns)))


def midpoint_basis(mesh: Mesh, cells: Partition) -> sp.csr_array:
    """The values at the ends of edges of functions (2 nb, m) that are linear between midpoints of cells.

    Each is 1 at the midpoint of its cell and 0 at the others. From the last two midpoints of a side, which
    has two cells or more, functions go on to its end. The ends of cells are nodes.
    """
    middles = 0.5 * (cells.points[1:] + cells.points[:-1])
    s = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    side = np.repeat(mesh.side, 2)
    first = np.searchsorted(cells.side, side)
    last = np.searchsorted(cells.side, side, side="right") - 1
    before = np.clip(np.searchsorted(middles, s) - 1, first, last - 1)
    x = (s - middles[before]) / (middles[before + 1] - middles[before])
    rows = np.tile(np.arange(len(s)), 2)
    return sp.csr_array((np.concatenate([1 - x, x]), (rows, np.concatenate([before, before + 1]))))


def pair_with_hats(mesh: Mesh) -> sp.csr_array:
    """P (2 nb, nb): <mu, phi_j> = (P^T mu)_j for mu that is linear on edges, by its values at their ends."""
    # the mass matrix of an edge is |e| / 3 (1 1/2; 1/2 1)
    return sp.diags_array(np.repeat(np.diff(mesh.s) / 3, 2)) @ nodal_basis(len(mesh.boundary), 1.0, 0.5)


def normal_derivatives(mesh: Mesh) -> sp.csr_array:
    """N (nb, n): dv_h/dn = N v on each boundary edge."""
    triangles = mesh.boundary_triangles
    slopes = np.einsum("eid,ed->ei", gradients(mesh)[triangles], mesh.polygon.normals[mesh.side])
    rows = np.repeat(np.arange(len(triangles)), 3)
    shape = (len(triangles), mesh.n_nodes)
    return sp.csr_array((slopes.ravel(), (rows, mesh.triangles[triangles].ravel())), shape=shape)


def measure_l2_errors(case: ExactSolution, edges: Partition, mu: Array) -> Array:
    """||lambda - mu||_0 (k,) of functions by their values (k, nb, 2) at the ends of the edges."""
    rule = boundary_rule(case.polygon, edges.points, case.singular_points())
    flux = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)[1]
    differences = flux[:, None] - evaluate_on_cells(edges, rule, rule.interval, mu)
    return np.sqrt(rule.weight @ differences**2)
