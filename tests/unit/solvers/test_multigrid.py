"""Multigrid, against the active set and Uzawa on the condensed problem; its bound, against true errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import pytest
from nested import Nested, alone, levels_of, refined

from unilateral.discrete.condensed import CondensedProblem, with_load
from unilateral.fem.condense import condense
from unilateral.fem.hierarchy import FinerSpace
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import by_parts, case_moments
from unilateral.fem.residual import dual_norm
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import adapted as adapted_meshes
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.norms.ritz import ritz_projection
from unilateral.problems import case as cases
from unilateral.solvers.active_set import active_set
from unilateral.solvers.multigrid import Found, Multigrid, multigrid
from unilateral.solvers.uzawa import uzawa

Array = np.ndarray
SAME = 1e-9
"""Of two solutions to 1e-11, one of them by a dense least-distance problem, whose rounding is 1e-10."""


@dataclass(frozen=True, eq=False)
class Both:
    """One problem, for multigrid and condensed."""

    nested: Nested
    grid: Multigrid
    discrete: CondensedProblem

    @property
    def cells(self) -> Array:
        return self.discrete.spaces.cells

    def exact(self) -> tuple[Array, Array]:
        """u_h (n,) and lambda_H (m,), by the active set."""
        spaces = self.discrete.spaces
        lambda_H = active_set(spaces.operator, self.discrete.offset, 1e-5).lambda_H
        return spaces.response(self.discrete.load, lambda_H), lambda_H

    def norm(self, v: Array) -> float:
        return math.sqrt(max(float(v @ (self.nested.of.A @ v)), 0.0))


def both(nested: Nested, partition: Partition, load: Array, g: Array, free: tuple[int, ...] = ()) -> Both:
    """The problem with the load (n,) and the cell means g (cells,)."""
    cells = nested_cells(nested.of, partition, free)
    assert cells is not None
    spaces = mixed_spaces(condense(nested.mesh), partition, free)
    grid = multigrid(nested.of, cells, load, (partition.lengths * g)[spaces.cells])
    trace = spaces.condensed.solve(load)[nested.mesh.boundary]
    return Both(nested, grid, with_load(spaces, load, trace, g))


def of(mesh: Mesh) -> Array:
    """Moments (m, 3) of f = -8 exp(x) cos(3 y) with f constant on each triangle."""
    x, y = np.moveaxis(mesh.points[mesh.triangles].mean(axis=1), -1, 0)
    return np.repeat((mesh.areas * -8 * np.exp(x) * np.cos(3 * y) / 3)[:, None], 3, axis=1)


def waves(partition: Partition, zones: float) -> Array:
    """An obstacle with that many waves along the boundary, (cells,)."""
    t = (partition.points[1:] + partition.points[:-1]) / (2 * partition.polygon.perimeter)
    return 0.4 * np.sin(2 * np.pi * zones * t + 0.3) - 0.5


def wide(level_s: Array, polygon: Polygon, seed: int) -> Partition:
    """Cells of two to five edges, at random; each side ends with what is left."""
    rng = np.random.default_rng(seed)
    chosen = [0]
    corners = np.searchsorted(level_s, polygon.starts)
    for last in corners[1:].tolist():
        while last - chosen[-1] > 5:
            chosen.append(chosen[-1] + int(rng.integers(2, min(5, last - chosen[-1] - 2) + 1)))
        chosen.append(last)
    return Partition(polygon, level_s[chosen])


def random_polygon(seed: int) -> Polygon:
    """Star-shaped, with five to eight corners."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 9))
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.5, n)) / n
    radius = rng.uniform(0.5, 1, n)
    return Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


@cache
def coarse(name: str) -> Mesh:
    if name.isdigit():
        polygon = random_polygon(int(name))
        return meshes.with_boundary(polygon, polygon.divided(np.full(polygon.n_sides, 3))[:-1])
    if name == "gmsh":
        return meshes.unstructured(named("lshape"), 0.3)
    polygon_name, n = name.split()
    return structured(named(polygon_name), 1 / int(n))


@cache
def problem(
    name: str, refinements: int, edges: int, zones: float, free: tuple[int, ...] = (), seed: int = 0
) -> Both:
    """On cells of that many edges, of two to five for 0."""
    nested = refined(coarse(name), refinements)
    s, polygon = nested.mesh.s, nested.mesh.polygon
    partition = Partition(polygon, s[::edges].copy()) if edges else wide(s, polygon, seed)
    return both(nested, partition, by_parts(nested.mesh, of), waves(partition, zones), free)


def adapted_to(mesh: Mesh, corner: int, times: int, share: float = 1.0) -> Nested:
    """Refined again and again near a corner of the polygon, so that its cells stay stable."""
    rng, of = np.random.default_rng(7), adapted_meshes.adapted(alone(mesh))
    place, all_of = mesh.polygon.vertices[corner], [of]
    for k in range(times):
        distance = np.hypot(*(of.mesh.points - place).T)[of.mesh.triangles].min(axis=1)
        near = np.flatnonzero(distance <= 0.3 * mesh.polygon.diameter / 2**k)
        of = adapted_meshes.refined(of, rng.choice(near, int(np.ceil(share * len(near))), replace=False))
        all_of.append(of)
    return levels_of([each.mesh for each in all_of])


def cells_of_adapted(mesh: Mesh) -> Partition:
    """Those of a mesh made by `adapted_to`: an edge's place is its length as a part of a first one."""
    first = mesh.coarse or mesh
    at = np.interp(mesh.s, first.s, np.arange(len(first.s))) * adapted_meshes.UNIT
    return adapted_meshes.AdaptedMesh(mesh, np.rint(at).astype(np.int64)).partition


@cache
def adapted_problem(
    name: str, corner: int, times: int, zones: float, free: tuple[int, ...] = (), share: float = 1.0
) -> Both:
    first = pairs_of_edges(name)
    nested = adapted_to(first, corner, times, share)
    partition = cells_of_adapted(nested.mesh)
    return both(nested, partition, by_parts(nested.mesh, of), waves(partition, zones), free)


def pairs_of_edges(name: str) -> Mesh:
    """A mesh whose sides have an even number of equal edges."""
    if name.isdigit() or name == "gmsh":
        polygon = random_polygon(int(name)) if name.isdigit() else named("lshape")
        return meshes.with_boundary(polygon, polygon.divided(np.full(polygon.n_sides, 4))[:-1])
    return coarse(name)


ADAPTED = [
    ("square 4", 0, 5, 3, ()),
    ("square 4", 2, 10, 5, (1,)),
    ("lshape 2", 2, 8, 9, ()),
    ("gmsh", 2, 6, 7, (2, 3)),
    ("0", 1, 6, 4, (), 0.4),
    ("1", 2, 7, 6, (0,), 0.5),
    ("2", 0, 12, 11, (), 0.7),
]

PROBLEMS = [
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


@pytest.mark.parametrize(("name", "refinements", "edges", "zones", "free"), PROBLEMS)
def test_it_finds_the_solution_of_the_condensed_problem(
    name: str, refinements: int, edges: int, zones: float, free: tuple[int, ...]
) -> None:
    check_solution(problem(name, refinements, edges, zones, free))


def check_solution(of_both: Both) -> None:
    found, (u, lambda_H) = of_both.grid.solve(1e-11), of_both.exact()
    size = max(1.0, float(lambda_H.max()))
    assert found.converged
    assert 0 < np.count_nonzero(lambda_H) < len(lambda_H)
    assert np.array_equal(found.active, lambda_H > 1e-9 * size)
    assert np.abs(found.u - u).max() < SAME * max(1.0, float(np.abs(u).max()))
    # Down to H^{-1/2} of the tolerance in the dual norm.
    assert np.abs(found.lambda_H - lambda_H).max() < 10 * SAME * size
    assert found.lambda_H.min() >= 0


@pytest.mark.parametrize("case", ADAPTED)
def test_nor_does_it_matter_how_the_mesh_was_refined(case: tuple) -> None:
    """Adapted meshes have one level with cells, which starts from 0 with all of them active."""
    of_both = adapted_problem(*case)
    assert of_both.nested.mesh.adapted
    assert len(of_both.grid.grids) == 1
    check_solution(of_both)


def test_another_load_has_another_solution() -> None:
    of_both = problem("square 3", 4, 2, 3)
    finest = of_both.grid.grids[-1]
    moved = replace(finest, load=finest.load * (1 + 1e-6))
    found = replace(of_both.grid, grids=[*of_both.grid.grids[:-1], moved]).solve(1e-11)
    u, _ = of_both.exact()
    assert np.abs(found.u - u).max() > 10 * SAME


def test_it_agrees_with_uzawa() -> None:
    of_both = problem("square 3", 3, 4, 3)
    spaces, offset = of_both.discrete.spaces, of_both.discrete.offset
    expected = uzawa(spaces.operator, offset, 1e-11)
    found = of_both.grid.solve(1e-11)
    distance = np.linalg.norm(spaces.operator.half @ (found.lambda_H - expected.lambda_H))
    assert distance <= found.bound + expected.bound + 1e-13
    assert np.array_equal(found.active, expected.lambda_H > 0)


def test_no_contact_full_contact_and_no_cells() -> None:
    nested = refined(coarse("square 3"), 3)
    partition = Partition(square(), nested.of.s[::2].copy())
    load, one = by_parts(nested.mesh, of), np.ones(partition.n_cells)
    free = both(nested, partition, load, -100 * one)
    assert not free.grid.solve(1e-10).active.any()
    assert both(nested, partition, load, 100 * one).grid.solve(1e-10).active.all()
    without = both(nested, partition, load, one, (0, 1, 2, 3)).grid.solve(1e-10)
    assert without.lambda_H.shape == (0,)
    assert np.abs(without.u - free.grid.solve(1e-10).u).max() < SAME


def test_no_contact_and_full_contact_on_adapted_meshes() -> None:
    nested = adapted_to(coarse("square 4"), 0, 6)
    partition = cells_of_adapted(nested.mesh)
    load, one = by_parts(nested.mesh, of), np.ones(partition.n_cells)
    for g, active in ((-100 * one, 0), (100 * one, len(one))):
        of_both = both(nested, partition, load, g)
        found, (u, lambda_H) = of_both.grid.solve(1e-10), of_both.exact()
        assert np.count_nonzero(found.active) == np.count_nonzero(lambda_H) == active
        assert np.abs(found.u - u).max() < SAME * max(1.0, float(np.abs(u).max()))
    without = both(nested, partition, load, one, (0, 1, 2, 3)).grid.solve(1e-10)
    assert without.lambda_H.shape == (0,)
    assert np.abs(without.u - both(nested, partition, load, -100 * one).exact()[0]).max() < SAME


def errors(of_both: Both, u: Array, lambda_H: Array) -> tuple[float, float]:
    """||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h}."""
    exact_u, exact_lambda = of_both.exact()
    half = of_both.discrete.spaces.operator.half
    return of_both.norm(u - exact_u), float(np.linalg.norm(half @ (lambda_H - exact_lambda)))


def guesses(of_both: Both) -> list[tuple[Array, Array]]:
    """Solved roughly, perturbed, on wrong sets, and what has nothing to do with the solution."""
    rng = np.random.default_rng(2)
    u, lambda_H = of_both.exact()
    finest = of_both.grid.grids[-1]
    lifted, hat = lambda_H + rng.uniform(0, 0.1, len(lambda_H)), np.zeros_like(u)
    hat[finest.cells.inside[lambda_H > 0]] = 1e-3
    response = of_both.discrete.spaces.response(of_both.discrete.load, lifted)
    rough = of_both.grid.solve(1e-2)
    return [
        (rough.u, rough.lambda_H),
        (u + 1e-3 * rng.standard_normal(len(u)), lambda_H),
        (u, np.maximum(lambda_H + 0.1 * rng.standard_normal(len(lambda_H)), 0)),
        (response, lifted),
        (u + hat, lambda_H),
        (u - hat, lambda_H),
        (u, lambda_H[::-1].copy()),
        (np.zeros_like(u), np.zeros_like(lambda_H)),
        (of_both.discrete.spaces.response(of_both.discrete.load, 0 * lambda_H), 0 * lambda_H),
        (rng.standard_normal(len(u)), rng.uniform(0, 1, len(lambda_H))),
    ]


@pytest.mark.parametrize("case", [0, 1, 5, 6, 9, 11])
def test_the_bound_is_one_for_any_guess(case: int) -> None:
    of_both = problem(*PROBLEMS[case])
    for u, lambda_H in guesses(of_both):
        bound, found = of_both.grid.bound(u, lambda_H), errors(of_both, u, lambda_H)
        assert max(found) <= bound + 1e-12


@pytest.mark.parametrize("case", [0, 3, 5, 6])
def test_so_it_is_on_adapted_meshes(case: int) -> None:
    of_both = adapted_problem(*ADAPTED[case])
    for u, lambda_H in guesses(of_both):
        bound, found = of_both.grid.bound(u, lambda_H), errors(of_both, u, lambda_H)
        assert max(found) <= bound + 1e-12


def without_defect(of_both: Both, u: Array, lambda_H: Array) -> float:
    """The bound, had u - w been u."""
    finest = of_both.grid.grids[-1]
    R = finest.of.A @ u - finest.load - finest.cells.B.T @ lambda_H
    return dual_norm(finest.of, R)


def test_a_bound_of_half_the_size_or_without_the_defect_is_none() -> None:
    of_both = problem(*PROBLEMS[0])
    halves, without = [], []
    for u, lambda_H in guesses(of_both):
        worst = max(errors(of_both, u, lambda_H))
        halves.append(0.5 * of_both.grid.bound(u, lambda_H) < worst)
        without.append(without_defect(of_both, u, lambda_H) < worst)
    assert any(halves)
    assert any(without)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("case", [0, 3, 7, 10])
def test_it_ends_by_the_tolerance_and_the_bound_is_not_much_too_large(case: int, tolerance: float) -> None:
    of_both = problem(*PROBLEMS[case])
    found = of_both.grid.solve(tolerance)
    true = max(errors(of_both, found.u, found.lambda_H))
    assert true <= found.bound + 1e-12 <= tolerance + 1e-12
    assert found.bound < 15 * max(true, 1e-12)
    assert math.sqrt(found.rz) <= of_both.norm(found.u - of_both.exact()[0]) + 1e-12


def test_ritz_values_lie_between_0_and_1() -> None:
    for case in PROBLEMS:
        ritz = problem(*case).grid.solve(1e-10).ritz
        assert np.all((ritz > 0) & (ritz <= 1 + 1e-9))
    for case in ADAPTED:
        ritz = adapted_problem(*case).grid.solve(1e-10).ritz
        assert np.all((ritz > 0) & (ritz <= 1 + 1e-9))


def on_squares(n: int, zones: float, edges: int = 2) -> Found:
    """With h = 1/n and an obstacle on the lower side only; the same for all n."""
    refinements = int(math.log2(n // 4))
    nested = refined(coarse("square 4"), refinements)
    partition = Partition(square(), nested.of.s[::edges].copy())
    cells = nested_cells(nested.of, partition)
    assert cells is not None
    t = (partition.points[1:] + partition.points[:-1]) / 2
    g = np.where(t < 1, 0.5 * np.sin(2 * np.pi * zones * t + 0.3) - 0.2, -9.0)
    return multigrid(nested.of, cells, by_parts(nested.mesh, of), partition.lengths * g).solve(1e-8)


def iterations(found: Found) -> int:
    """On the finest level, in all steps."""
    finest = found.counts[-1][0]
    return sum(count for level, count in found.counts if level == finest)


def test_iterations_do_not_grow_with_the_mesh() -> None:
    counts = {n: [iterations(on_squares(n, zones)) for zones in (1, 37)] for n in (16, 32, 64, 128, 256)}
    one, many = np.array(list(counts.values())).T
    assert one.max() <= 12
    assert max(each.counts[-1][1] for each in (on_squares(n, 1) for n in (16, 256))) <= 9
    assert np.all(many <= 3 * one)
    assert len(on_squares(256, 37).counts) <= 30


RE_ENTRANT = 2


@cache
def deep(times: int) -> Found:
    """On the L-shape, refined so often at its corner of 270 degrees, down to 2^-times of the first edges."""
    nested = adapted_to(coarse("lshape 4"), RE_ENTRANT, times)
    partition = cells_of_adapted(nested.mesh)
    cells = nested_cells(nested.of, partition)
    assert cells is not None
    g = partition.lengths * waves(partition, 3)
    return multigrid(nested.of, cells, by_parts(nested.mesh, of), g).solve(1e-8)


@pytest.mark.parametrize("times", [10, 20, 30])
def test_iterations_do_not_grow_with_the_depth(times: int) -> None:
    """The eigenvalues stay away from 0."""
    found = deep(times)
    assert found.converged
    assert found.ritz[0] > 0.3
    assert np.all(found.ritz <= 1 + 1e-9)
    assert found.counts[-1][1] <= deep(10).counts[-1][1] + 2
    assert found.counts[-1][0] >= times


def test_they_grow_without_smoothing_on_coarser_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control: with the finest and the coarsest level only, the least eigenvalue falls with the depth."""

    def unsmoothed(level: FinerSpace, S: object, r: Array) -> tuple[Array, Array]:
        k = level.n if level.smoothed is None else len(level.smoothed)
        return np.zeros(k), np.zeros(k)

    deep(10)
    monkeypatch.setattr(FinerSpace, "sweep_down", unsmoothed)
    monkeypatch.setattr(FinerSpace, "sweep_up", lambda *given: None)
    deep.cache_clear()
    assert deep(10).ritz[0] < 0.3
    deep.cache_clear()


def test_it_goes_on_from_what_was_found() -> None:
    of_both = problem("square 3", 4, 2, 3)
    first = of_both.grid.solve(1e-3)
    second = of_both.grid.solve(1e-10, (first.u, first.active))
    assert second.converged
    assert len(second.counts) == 1
    assert iterations(second) < iterations(of_both.grid.solve(1e-10))
    assert np.abs(second.u - of_both.exact()[0]).max() < SAME


@pytest.mark.parametrize("tolerance", [0, 1e-20])
def test_a_tolerance_below_rounding_is_not_reached_and_said_so(tolerance: float) -> None:
    of_both = problem("square 3", 4, 2, 3)
    found = of_both.grid.solve(tolerance)
    assert not found.converged
    assert max(errors(of_both, found.u, found.lambda_H)) < 1e-10
    assert 1e-20 < found.bound < 1e-10
    assert iterations(found) < 40


def test_a_load_that_is_no_number_ends_at_once() -> None:
    of_both = problem("square 3", 4, 2, 3)
    finest = of_both.grid.grids[-1]
    spoilt = replace(of_both.grid, grids=[replace(finest, load=np.full_like(finest.load, np.nan))])
    found = spoilt.solve(1e-8)
    assert not found.converged
    assert iterations(found) == 0


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_scaled_data_have_the_scaled_solution(factor: float) -> None:
    of_both = problem("square 3", 4, 2, 3)
    grids = [replace(g, load=factor * g.load, d=factor * g.d) for g in of_both.grid.grids]
    found, scaled = of_both.grid.solve(1e-10), replace(of_both.grid, grids=grids).solve(1e-10 * factor)
    assert scaled.counts == found.counts
    assert np.array_equal(scaled.active, found.active)
    assert np.allclose(scaled.u, factor * found.u, rtol=0, atol=1e-13 * factor)


@pytest.mark.parametrize("name", ["natural", "smooth"])
def test_loads_of_cases_are_those_of_the_condensed_problem(name: str) -> None:
    case = cases.load(name, square(), 0)
    nested = refined(coarse("square 4"), 3)
    found = by_parts(nested.mesh, partial(case_moments, case))
    expected = ritz_projection(case, condense(nested.mesh)).load
    assert np.abs(found - expected).max() < 1e-13 * np.abs(expected).max()
    assert np.abs(found - by_parts(nested.mesh, of)).max() > 1e-3 * np.abs(expected).max()
