"""Truncated V-cycles on uniform and adapted meshes, against dense matrices."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from nested import (
    Nested,
    forget_refinement,
    grade_mesh_levels,
    prolongation,
    refine_at_random,
    refine_mesh_levels,
)
from scipy.linalg import eigh

from unilateral.fem.hierarchy import FinerSpace, build_hierarchy
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solvers.v_cycle import MIN_ENERGY_SHARE, TruncatedCycle

MESHES = ["uniform", "at random", "at a corner"]
CASES = ["nothing", "a strip", "islands", "the boundary"]
ALL = [(mesh, case) for mesh in MESHES for case in CASES]


@cache
def make_hierarchy(mesh: str) -> Nested:
    first = forget_refinement(make_structured_mesh(find_polygon("lshape"), 1))
    if mesh == "at random":
        return refine_at_random(meshes.make_unstructured_mesh(find_polygon("lshape"), 0.7), 4, 2, 0.4)
    return refine_mesh_levels(first, 3) if mesh == "uniform" else grade_mesh_levels(first, 2, 9)


def choose_fixed_nodes(mesh: str, case: str) -> np.ndarray:
    boundary = make_hierarchy(mesh).hierarchy.boundary.astype(np.intp)
    chosen = {"nothing": slice(0), "a strip": slice(9, 16), "islands": slice(0, None, 3)}
    return np.sort(boundary[chosen.get(case, slice(None))])


def truncated_products(mesh: str, case: str) -> list[np.ndarray]:
    """(T P)^T A (T P) and so on, from the finest level down."""
    hierarchy = make_hierarchy(mesh).hierarchy
    S = hierarchy.A.toarray()
    matrices = []
    S[choose_fixed_nodes(mesh, case)] = 0
    S[:, choose_fixed_nodes(mesh, case)] = 0
    for level in hierarchy.levels[::-1]:
        P = prolongation(level).toarray()
        S = P.T @ S @ P
        matrices.append(S)
    return matrices


def nodes_of(level: FinerSpace) -> tuple[np.ndarray, np.ndarray]:
    """Those of its rows, and of their columns."""
    every = np.arange(level.n)
    return (every, every) if level.columns is None else (level.smoothed_nodes, level.columns)


@pytest.mark.parametrize(("mesh", "case"), ALL)
def test_matrices_are_those_of_the_truncated_functions(mesh: str, case: str) -> None:
    hierarchy = make_hierarchy(mesh).hierarchy
    cycle = TruncatedCycle(make_hierarchy(mesh).hierarchy, choose_fixed_nodes(mesh, case))
    cut_away = 0
    products = truncated_products(mesh, case)
    for S, matrix, level in zip(products, cycle.matrices[::-1], hierarchy.levels[-2::-1], strict=False):
        rows, columns = nodes_of(level)
        before = level.rows.diagonal() if level.columns is None else level.rows[:, : len(rows)].diagonal()
        expected = np.zeros_like(S)
        gone = np.diag(S)[rows] < 1e-10 * before
        expected[rows, rows] = np.where(gone, before, 0)
        assert np.abs(matrix.toarray() - (S + expected)[np.ix_(rows, columns)]).max() < 1e-12
        outside = np.setdiff1d(np.arange(level.n), columns)
        assert np.abs(S[np.ix_(rows, outside)]).max(initial=0) < 1e-12
        cut_away += np.count_nonzero(gone)
    # Hats of corners with a single triangle.
    if mesh == "uniform":
        assert (cut_away > 0) == (case == "the boundary")


@pytest.mark.parametrize(("mesh", "case"), ALL)
def test_the_coarsest_matrix_is_solved_with_exactly(mesh: str, case: str) -> None:
    S = truncated_products(mesh, case)[-1]
    hierarchy = make_hierarchy(mesh).hierarchy
    S = S + np.diag(np.where(np.diag(S) < 1e-10 * hierarchy.A_0.diagonal(), hierarchy.A_0.diagonal(), 0))
    b = np.random.default_rng(1).standard_normal(len(S))
    assert np.allclose(
        S @ TruncatedCycle(hierarchy, choose_fixed_nodes(mesh, case)).coarse_factors.solve(b),
        b,
        rtol=0,
        atol=1e-10,
    )


@pytest.mark.parametrize("mesh", MESHES)
def test_the_levels_matrices_stay_as_they_are(mesh: str) -> None:
    hierarchy = make_hierarchy(mesh).hierarchy
    before = [level.rows.data.copy() for level in hierarchy.levels[:-1]]
    TruncatedCycle(hierarchy, choose_fixed_nodes(mesh, "the boundary"))
    assert all(
        np.array_equal(level.rows.data, entries)
        for level, entries in zip(hierarchy.levels[:-1], before, strict=True)
    )


def correction(mesh: str, case: str) -> np.ndarray:
    """T P C P^T T (n, n)."""
    hierarchy = make_hierarchy(mesh).hierarchy
    cycle = TruncatedCycle(hierarchy, choose_fixed_nodes(mesh, case))
    columns = []
    for r in np.eye(hierarchy.n):
        z = np.zeros(hierarchy.n)
        cycle.correct(hierarchy.A, z, r)
        columns.append(z)
    return np.column_stack(columns)


@pytest.mark.parametrize(("mesh", "case"), ALL)
def test_corrections_are_symmetric_and_never_too_long(mesh: str, case: str) -> None:
    C = correction(mesh, case)
    A = make_hierarchy(mesh).hierarchy.A.toarray()
    assert np.abs(C - C.T).max() < 1e-12
    assert np.abs(C[choose_fixed_nodes(mesh, case)]).max(initial=0) == 0
    # Of C A, in exact arithmetic between 0 and 1; the others belong to what coarse functions do not reach.
    values = eigh(A @ C @ A, A, eigvals_only=True)
    assert values[0] > -1e-11
    assert 0.9 < values[-1] < 1 + 1e-11


@pytest.mark.parametrize("mesh", MESHES)
def test_corrections_reach_what_coarse_functions_do(mesh: str) -> None:
    """Without truncation, of functions of the level before nothing is lost but what smoothing leaves."""
    hierarchy = make_hierarchy(mesh).hierarchy
    C = correction(mesh, "nothing")
    A = hierarchy.A.toarray()
    P = prolongation(hierarchy.levels[-1]).toarray()
    inner = P.T @ A @ P
    values = eigh(P.T @ A @ C @ A @ P, inner, eigvals_only=True)
    assert values[0] > 0.2
    assert np.linalg.matrix_rank(C, 1e-8) == P.shape[1]


@pytest.mark.parametrize("mesh", MESHES)
def test_a_correction_starts_from_z(mesh: str) -> None:
    hierarchy = make_hierarchy(mesh).hierarchy
    cycle = TruncatedCycle(hierarchy, choose_fixed_nodes(mesh, "islands"))
    A = hierarchy.A
    rng = np.random.default_rng(1)
    z, r = rng.standard_normal((2, hierarchy.n))
    expected = np.zeros_like(z)
    computed = z.copy()
    cycle.correct(A, expected, r - A @ z)
    cycle.correct(A, computed, r)
    assert np.allclose(computed, z + expected)
    assert not np.allclose(computed, z)


def test_hats_that_are_one_after_they_were_cut_are_no_obstacle() -> None:
    """A square of two triangles, halved: of its hats only those at the diagonal's ends are left, both half of
    the hat in the middle. What they make of it is exact up to CUT_AWAY.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    hierarchy = build_hierarchy(
        meshes.refine_uniformly(meshes.from_arrays(find_polygon("square"), corners, [[0, 1, 2], [0, 2, 3]]))
    )
    cycle = TruncatedCycle(hierarchy, np.sort(hierarchy.boundary))
    middle = np.setdiff1d(np.arange(hierarchy.n), hierarchy.boundary)
    z = np.zeros(hierarchy.n)
    u = np.zeros(hierarchy.n)
    u[middle] = 1
    cycle.correct(hierarchy.A, z, hierarchy.A @ u)
    assert len(middle) == 1
    assert np.allclose(z, u, rtol=0, atol=10 * MIN_ENERGY_SHARE)
