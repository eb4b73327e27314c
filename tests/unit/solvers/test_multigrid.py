"""Multigrid on uniform and adapted meshes, against the active set on the condensed problem; its bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from nested import forget_refinement, ritz

from unilateral.discrete.condensed import CondensedProblem, build_condensed_problem
from unilateral.fem import residual_rounding
from unilateral.fem.condense import condense
from unilateral.fem.form import Form
from unilateral.fem.functional_norm import multilevel_dual_norm_bound
from unilateral.fem.hierarchy import FinerSpace, build_hierarchy
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import assemble_load_by_blocks, case_moments
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import adapted as adapted_meshes
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.ritz import ritz_projection
from unilateral.problems import case as cases
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.multigrid import Multigrid, MultigridResult, build_multigrid
from unilateral.solvers.multigrid_bounds import multilevel_algebraic_bound, shift_to_feasible

Array = np.ndarray
Pair = tuple[Mesh, Partition]
SAME = 1e-9
"""Two solutions agree to this: each is known to 1e-11, and the dense solve is rounded by 1e-10."""


@dataclass(frozen=True, eq=False)
class Both:
    """One problem, for multigrid and condensed."""

    grids: Multigrid
    discrete: CondensedProblem

    @cached_property
    def exact(self) -> tuple[Array, Array]:
        """u_h (n,) and lambda_H (m,), by the active set."""
        spaces = self.discrete.spaces
        lambda_H = solve_by_active_set(spaces.operator, self.discrete.offset, 1e-5).lambda_H
        return spaces.response(self.discrete.load, lambda_H), lambda_H

    def norm(self, v: Array) -> float:
        return math.sqrt(max(float(v @ (self.grids.finest.hierarchy.A @ v)), 0.0))

    def errors(self, u: Array, lambda_H: Array) -> tuple[float, float]:
        """||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h}."""
        exact_u, exact_lambda = self.exact
        half = self.discrete.spaces.operator.D_factor
        return self.norm(u - exact_u), float(np.linalg.norm(half @ (lambda_H - exact_lambda)))

    def bound(self, u: Array, lambda_H: Array) -> float:
        return multilevel_algebraic_bound(self.grids.finest, u, lambda_H)


def pose_on_levels(mesh: Mesh, partition: Partition, g: Array, free: tuple[int, ...] = ()) -> Multigrid:
    """The problem with the load `of` and the cell means g (cells,)."""
    levels = build_hierarchy(mesh, form=Form(free=free))
    cells = nested_cells(levels, partition)
    assert cells is not None
    clamped_multiplier = levels.form.has_multiplier(partition.side)
    return build_multigrid(
        levels,
        cells,
        assemble_load_by_blocks(mesh, source_moments),
        (partition.lengths * g)[clamped_multiplier],
    )


def both(mesh: Mesh, partition: Partition, g: Array, free: tuple[int, ...] = ()) -> Both:
    """The same problem in both ways."""
    spaces = mixed_spaces(condense(mesh, Form(free=free)), partition)
    load = assemble_load_by_blocks(mesh, source_moments)
    trace = spaces.condensed.solve(load)[mesh.boundary]
    return Both(pose_on_levels(mesh, partition, g, free), build_condensed_problem(spaces, load, trace, g))


def source_moments(mesh: Mesh) -> Array:
    """Moments (m, 3) of f = -8 exp(x) cos(3 y) with f constant on each triangle."""
    x, y = np.moveaxis(mesh.points[mesh.triangles].mean(axis=1), -1, 0)
    return np.repeat((mesh.areas * -8 * np.exp(x) * np.cos(3 * y) / 3)[:, None], 3, axis=1)


def waves(partition: Partition, zones: float) -> Array:
    """An obstacle with that many waves along the boundary, (cells,)."""
    t = (partition.points[1:] + partition.points[:-1]) / (2 * partition.polygon.perimeter)
    return 0.4 * np.sin(2 * np.pi * zones * t + 0.3) - 0.5


def wide(mesh: Mesh) -> Partition:
    """Cells of two to five edges, at random; each side ends with what is left."""
    rng = np.random.default_rng(0)
    chosen = [0]
    corners = np.searchsorted(mesh.s, mesh.polygon.starts)
    for last in corners[1:].tolist():
        while last - chosen[-1] > 5:
            chosen.append(chosen[-1] + int(rng.integers(2, min(5, last - chosen[-1] - 2) + 1)))
        chosen.append(last)
    return Partition(mesh.polygon, mesh.s[chosen])


def random_polygon(seed: int) -> Polygon:
    """Star-shaped, with five to eight corners."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 9))
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.5, n)) / n
    radius = rng.uniform(0.5, 1, n)
    return Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


@cache
def coarse(name: str, edges: int = 3) -> Mesh:
    """By the name of a polygon and the number of edges, or of random ones with so many edges on the sides."""
    if name.isdigit() or name == "even lshape":
        polygon = random_polygon(int(name)) if name.isdigit() else find_polygon("lshape")
        return meshes.triangulate_from_boundary(
            polygon, polygon.divided(np.full(polygon.n_sides, edges))[:-1]
        )
    if name == "gmsh":
        return meshes.make_unstructured_mesh(find_polygon("lshape"), 0.3)
    polygon_name, n = name.split()
    return make_structured_mesh(find_polygon(polygon_name), 1 / int(n))


def uniform(first: Mesh, refinements: int, edges: int) -> Pair:
    """On cells of that many edges, of two to five for 0."""
    mesh = meshes.refine_uniformly(forget_refinement(first), refinements)
    return mesh, Partition(mesh.polygon, mesh.s[::edges].copy()) if edges else wide(mesh)


def adapted_to(first: Mesh, corner: int, times: int, share: float = 1.0) -> Pair:
    """Refined again and again near a corner of the polygon, so that its cells stay stable."""
    rng = np.random.default_rng(7)
    adapted_mesh = adapted_meshes.start_adapted_mesh(forget_refinement(first))
    place = first.polygon.vertices[corner]
    for k in range(times):
        distance = np.hypot(*(adapted_mesh.mesh.points - place).T)[adapted_mesh.mesh.triangles].min(axis=1)
        near = np.flatnonzero(distance <= 0.3 * first.polygon.diameter / 2**k)
        adapted_mesh = adapted_meshes.refine_and_balance(
            adapted_mesh, rng.choice(near, int(np.ceil(share * len(near))), replace=False)
        )
    return adapted_mesh.mesh, adapted_mesh.partition


UNIFORM = [
    ("square 3", 4, 2, 3, ()),
    ("square 3", 4, 3, 5, ()),
    ("square 3", 4, 4, 1, (1,)),
    ("square 1", 5, 2, 17, (0, 3)),
    ("lshape 2", 4, 4, 9, ()),
    ("lshape 2", 3, 0, 7, (2, 3)),
    ("gmsh", 3, 2, 12, ()),
    ("gmsh", 3, 0, 5, ()),
    ("0", 3, 3, 4, ()),
    ("1", 3, 4, 6, (0,)),
    ("2", 4, 3, 11, ()),
    ("3", 3, 0, 8, ()),
    ("square 12", 0, 3, 2, ()),
]
"""A coarse mesh, refinements, edges in a cell, waves of the obstacle, free sides."""
ADAPTED = [
    ("square 4", 0, 5, 3, ()),
    ("square 4", 2, 10, 5, (1,)),
    ("lshape 2", 2, 8, 9, ()),
    ("even lshape", 2, 6, 7, (2, 3)),
    ("0", 1, 6, 4, (), 0.4),
    ("1", 2, 7, 6, (0,), 0.5),
    ("2", 0, 12, 11, (), 0.7),
]
"""A coarse mesh, a corner, refinements there, waves of the obstacle, free sides, the part that is refined."""
N_UNIFORM = len(UNIFORM)


@cache
def problem(number: int) -> Both:
    """One of UNIFORM, and then of ADAPTED."""
    if number < N_UNIFORM:
        name, refinements, edges, zones, free = UNIFORM[number]
        mesh, cells = uniform(coarse(name), refinements, edges)
    else:
        name, corner, times, zones, free, *share = ADAPTED[number - N_UNIFORM]
        mesh, cells = adapted_to(coarse(name, 4), corner, times, *share)
    return both(mesh, cells, waves(cells, zones), free)


@pytest.mark.parametrize("number", range(N_UNIFORM + len(ADAPTED)))
def test_multigrid_finds_the_solution_of_the_condensed_problem(number: int) -> None:
    """And Ritz values lie between 0 and 1.

    Adapted meshes have one level with cells, which starts from 0 with all of them active.
    """
    problems = problem(number)
    solution = problems.grids.solve(1e-11)
    (u, lambda_H) = problems.exact
    size = max(1.0, float(lambda_H.max()))
    adapted = number >= N_UNIFORM
    assert problems.discrete.mesh.is_adapted == adapted
    assert not adapted or len(problems.grids.grids) == 1
    assert solution.converged
    assert 0 < np.count_nonzero(lambda_H) < len(lambda_H)
    assert np.array_equal(solution.active, lambda_H > 1e-9 * size)
    assert np.abs(solution.u - u).max() < SAME * max(1.0, float(np.abs(u).max()))
    # Down to H^{-1/2} of the tolerance in the dual norm.
    assert np.abs(solution.lambda_H - lambda_H).max() < 10 * SAME * size
    assert solution.lambda_H.min() >= 0
    assert np.all((ritz(solution) > 0) & (ritz(solution) <= 1 + 1e-9))


def test_another_load_has_another_solution() -> None:
    grids = problem(0).grids.grids
    shifted_grid = replace(grids[-1], load=grids[-1].load * (1 + 1e-6))
    solution = Multigrid([*grids[:-1], shifted_grid]).solve(1e-11)
    assert np.abs(solution.u - problem(0).exact[0]).max() > 10 * SAME


@pytest.mark.parametrize("adapted", [False, True])
def test_no_contact_and_full_contact_are_found_and_no_cells_have_no_multiplier(adapted: bool) -> None:
    mesh, partition = adapted_to(coarse("square 4"), 0, 6) if adapted else uniform(coarse("square 3"), 3, 2)
    values = np.ones(partition.n_cells)
    for g, active in ((100 * values, len(values)), (-100 * values, 0)):
        problems = both(mesh, partition, g)
        solution = problems.grids.solve(1e-10)
        (u, lambda_H) = problems.exact
        assert np.count_nonzero(solution.active) == np.count_nonzero(lambda_H) == active
        assert np.abs(solution.u - u).max() < SAME * max(1.0, float(np.abs(u).max()))
    without = pose_on_levels(mesh, partition, values, (0, 1, 2, 3)).solve(1e-10)
    assert without.lambda_H.shape == (0,)
    assert np.abs(without.u - u).max() < SAME


def guesses(problems: Both) -> list[tuple[Array, Array]]:
    """Solved roughly, perturbed, on wrong sets, and what has nothing to do with the solution."""
    rng = np.random.default_rng(2)
    (u, lambda_H) = problems.exact
    discrete = problems.discrete
    lifted = lambda_H + rng.uniform(0, 0.1, len(lambda_H))
    hat = np.zeros_like(u)
    hat[problems.grids.finest.cells.inner_node[lambda_H > 0]] = 1e-3
    rough = problems.grids.solve(1e-2)

    def move_guess(size: float) -> tuple[Array, Array]:
        mu = np.maximum(lambda_H + size * rng.standard_normal(len(lambda_H)), 0)
        return u + size * rng.standard_normal(len(u)), mu

    return [
        (rough.u, rough.lambda_H),
        *(move_guess(size) for size in 10.0 ** np.arange(-6, 2)),
        (move_guess(1e-3)[0], lambda_H),
        (u, move_guess(0.1)[1]),
        (discrete.spaces.response(discrete.load, lifted), lifted),
        (u + hat, lambda_H),
        (u - hat, lambda_H),
        (u, lambda_H[::-1].copy()),
        (np.zeros_like(u), np.zeros_like(lambda_H)),
        (discrete.spaces.response(discrete.load, 0 * lambda_H), 0 * lambda_H),
        (rng.standard_normal(len(u)), rng.uniform(0, 1, len(lambda_H))),
    ]


@pytest.mark.parametrize("number", [0, 1, 5, 6, 9, 11, 13, 16, 18, 19])
def test_the_bound_is_one_for_any_guess(number: int) -> None:
    problems = problem(number)
    for guess in guesses(problems):
        assert max(problems.errors(*guess)) <= problems.bound(*guess) + 1e-12


def test_a_bound_of_half_the_size_or_without_the_defect_is_none() -> None:
    """Without it u - w would be u."""
    problems = problem(0)
    halves = []
    without = []
    finest = problems.grids.finest
    for u, lambda_H in guesses(problems):
        worst = max(problems.errors(u, lambda_H))
        halves.append(0.5 * problems.bound(u, lambda_H) < worst)
        R = finest.hierarchy.A @ u - finest.load - finest.cells.B.T @ lambda_H
        without.append(multilevel_dual_norm_bound(finest.hierarchy, R) < worst)
    assert any(halves)
    assert any(without)


def test_a_gap_at_the_end_of_its_doubt_attains_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but a gap: u = lambda = load = 0. The gap that is computed is -1, the true one is -1 - doubt.

    v is 1 + doubt there and not 1, so ||v||_1 + ||u - v||_1 is 2 (1 + doubt) ||hat||_1. That is attained
    up to rounding; with the doubt counted once it would be missed.
    """
    doubt = 0.25
    A = sp.csr_array(np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]))
    gap = residual_rounding.Rounded(np.array([-1.0]), np.array([doubt]))
    monkeypatch.setattr(residual_rounding, "gap_with_rounding", lambda *_: gap)
    B = sp.csr_array(np.array([[0.0, 1.0, 0.0]]))
    zero = np.zeros(3)
    stub = SimpleNamespace(A=A, row_sums=A.sum(axis=1), nodal_weights=A.sum(axis=1))
    cells = SimpleNamespace(B=B, inner_node=np.array([1]))
    grid = SimpleNamespace(hierarchy=stub, cells=cells, load=zero, d=np.ones(1))
    residual, norm = shift_to_feasible(grid, zero, np.zeros(1))
    dual = np.sqrt(residual.values @ np.linalg.solve(A.toarray(), residual.values))
    assert dual + norm == pytest.approx(2 * (1 + doubt) * np.sqrt(3), rel=1e-6)
    assert dual + norm >= 2 * (1 + doubt) * np.sqrt(3)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("number", [0, 3, 7, 10])
def test_multigrid_ends_by_the_tolerance_and_its_bound_is_not_much_too_large(
    number: int, tolerance: float
) -> None:
    problems = problem(number)
    solution = problems.grids.solve(tolerance)
    true = max(problems.errors(solution.u, solution.lambda_H))
    assert true <= solution.bound + 1e-12 <= tolerance + 1e-12
    assert solution.bound < 15 * max(true, 1e-12)
    assert math.sqrt(solution.rz) <= problems.norm(solution.u - problems.exact[0]) + 1e-12


def solve_on_squares(n: int, zones: float) -> MultigridResult:
    """With h = 1/n and an obstacle on the lower side only; the same for all n."""
    mesh, partition = uniform(coarse("square 4"), int(math.log2(n // 4)), 2)
    t = (partition.points[1:] + partition.points[:-1]) / 2
    g = np.where(t < 1, 0.5 * np.sin(2 * np.pi * zones * t + 0.3) - 0.2, -9.0)
    return pose_on_levels(mesh, partition, g).solve(1e-8)


def iterations(result: MultigridResult) -> int:
    """On the finest level, in all steps."""
    finest = result.iteration_counts[-1][0]
    return sum(count for level, count in result.iteration_counts if level == finest)


def test_iterations_do_not_grow_with_the_mesh() -> None:
    results_by_size = [[solve_on_squares(n, zones) for zones in (1, 37)] for n in (16, 32, 64, 128, 256)]
    first, many = np.array([[iterations(result) for result in results] for results in results_by_size]).T
    assert first.max() <= 12
    assert (
        max(results[0].iteration_counts[-1][1] for results in (results_by_size[0], results_by_size[-1])) <= 9
    )
    assert np.all(many <= 3 * first)
    assert len(results_by_size[-1][1].iteration_counts) <= 30


@cache
def deep(times: int) -> MultigridResult:
    """On the L-shape, refined so often at its corner of 270 degrees, down to 2^-times of the first edges."""
    mesh, partition = adapted_to(coarse("lshape 4"), 2, times)
    return pose_on_levels(mesh, partition, waves(partition, 3)).solve(1e-8)


@pytest.mark.parametrize("times", [10, 20, 30])
def test_iterations_do_not_grow_with_the_depth(times: int) -> None:
    """The eigenvalues stay away from 0."""
    result = deep(times)
    assert result.converged
    assert ritz(result)[0] > 0.3
    assert np.all(ritz(result) <= 1 + 1e-9)
    assert result.iteration_counts[-1][1] <= deep(10).iteration_counts[-1][1] + 2
    assert result.iteration_counts[-1][0] >= times


def test_iterations_grow_without_smoothing_on_coarser_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control: with the finest and the coarsest level only, the least eigenvalue falls with the depth."""

    def skip_smoothing(level: FinerSpace, S: object, r: Array) -> tuple[Array, Array]:
        k = level.n if level.smoothed_nodes is None else len(level.smoothed_nodes)
        return np.zeros(k), np.zeros(k)

    monkeypatch.setattr(FinerSpace, "sweep_down", skip_smoothing)
    monkeypatch.setattr(FinerSpace, "sweep_up", lambda *arguments: None)
    assert ritz(deep.__wrapped__(10))[0] < 0.3


def test_multigrid_goes_on_from_what_was_found() -> None:
    """On the set of the solution it takes one step, from all cells active it takes more."""
    grids = problem(0).grids
    first = grids.solve(1e-3)
    cold = grids.solve(1e-10)
    second = grids.solve(1e-10, (first.u, first.active))
    assert second.converged
    assert len(second.iteration_counts) == 1 < len(cold.iteration_counts)
    assert iterations(second) < iterations(cold)
    assert np.abs(second.u - problem(0).exact[0]).max() < SAME


@pytest.mark.parametrize("tolerance", [0, 1e-20])
def test_a_tolerance_below_rounding_is_not_reached_and_said_so(tolerance: float) -> None:
    solution = problem(0).grids.solve(tolerance)
    assert not solution.converged
    assert max(problem(0).errors(solution.u, solution.lambda_H)) < 1e-10
    assert 1e-20 < solution.bound < 1e-10
    assert iterations(solution) < 40


def test_a_load_that_is_no_number_ends_at_once() -> None:
    finest = problem(0).grids.finest
    solution = Multigrid([replace(finest, load=np.full_like(finest.load, np.nan))]).solve(1e-8)
    assert not solution.converged
    assert iterations(solution) == 0


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_scaled_data_have_the_scaled_solution(factor: float) -> None:
    grids = problem(0).grids
    scaled = Multigrid([replace(g, load=factor * g.load, d=factor * g.d) for g in grids.grids])
    expected = grids.solve(1e-10)
    solution = scaled.solve(1e-10 * factor)
    assert solution.iteration_counts == expected.iteration_counts
    assert np.array_equal(solution.active, expected.active)
    assert np.allclose(solution.u, factor * expected.u, rtol=0, atol=1e-13 * factor)


@pytest.mark.parametrize("name", ["natural", "smooth"])
def test_loads_of_cases_are_those_of_the_condensed_problem(name: str) -> None:
    case = cases.load_solution(name, square(), 0)
    mesh = meshes.refine_uniformly(coarse("square 4"), 3)
    load = assemble_load_by_blocks(mesh, partial(case_moments, case))
    expected = ritz_projection(case, condense(mesh)).load
    assert np.abs(load - expected).max() < 1e-13 * np.abs(expected).max()
    assert np.abs(load - assemble_load_by_blocks(mesh, source_moments)).max() > 1e-3 * np.abs(expected).max()
