"""Nested iteration of the drivers: its meshes, and its solution beside one by sparse factors alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks import plan, problem
from benchmarks.peers import nested
from unilateral.fem.edge_matrix import assemble_by_edges
from unilateral.geometry.mesh import from_arrays
from unilateral.geometry.polygon import find_polygon

N = 64


@pytest.fixture(scope="module", params=["three_zones", "lshape"])
def data(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The data of a problem on three meshes."""
    path = tmp_path_factory.mktemp("data") / "data.npz"
    declared = plan.read(plan.FOLDER / "benchmarks.yaml")
    problem.prepare({**plan.order_of(declared, request.param, N), "H_over_h": 2}, path)
    return dict(np.load(path)) | {"polygon": find_polygon(declared["problems"][request.param]["polygon"])}


def matrices_of(data: dict[str, np.ndarray], levels: list[nested.Level]) -> list[sp.csr_matrix]:
    """The matrix of each mesh, by this project."""
    points = data["points"]
    meshes = [from_arrays(data["polygon"], points[: len(level.load)], level.triangles) for level in levels]
    return [assemble_by_edges(mesh.triangulation, mesh.points)[0].tocsr() for mesh in meshes]


def test_interpolation_reproduces_linear_functions_and_coarse_matrices(data: dict[str, np.ndarray]) -> None:
    """P A P is the coarse matrix where the spaces are nested: so it is, up to rounding."""
    levels = nested.read_levels(data)
    assert len(levels) == int(data["n_levels"]) >= 2
    matrices = matrices_of(data, levels)
    for k in range(1, len(levels)):
        P = nested.interpolation(levels[k])
        linear = data["points"] @ (2.0, -3.0)
        assert P @ linear[: P.shape[1]] == pytest.approx(linear[: P.shape[0]], abs=1e-14)
        galerkin = P.T @ matrices[k] @ P
        assert abs(galerkin - matrices[k - 1]).max() < 1e-12
        assert P.T @ levels[k].load == pytest.approx(levels[k - 1].load, abs=1e-14)


def solve_by_factors(A: sp.csr_matrix, level: nested.Level) -> np.ndarray:
    """The nodal solution, by the active set from contact everywhere."""
    is_boundary = np.isfinite(level.obstacle)
    contact = is_boundary
    while True:
        u = np.where(contact, level.obstacle, 0.0)
        free = np.flatnonzero(~contact)
        u[free] = splu(A[free][:, free].tocsc()).solve((level.load - A @ u)[free])
        following = np.where(contact, A @ u > level.load, is_boundary & (u < level.obstacle))
        if np.array_equal(following, contact):
            return u
        contact = following


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_the_solution_is_that_by_sparse_factors(data: dict[str, np.ndarray], tolerance: float) -> None:
    """In the energy norm, which the preconditioner by factors estimates exactly for the last set."""
    levels = nested.read_levels(data)
    matrices = matrices_of(data, levels)

    def factorise(k: int, free: np.ndarray) -> nested.Operator:
        keep = sp.diags(free.astype(float))
        return splu((keep @ matrices[k] @ keep + sp.diags((~free).astype(float))).tocsc()).solve

    interpolations = [nested.interpolation(level) for level in levels[1:]]
    u, counts = nested.solve_by_nested_iteration(
        levels, interpolations, [A.dot for A in matrices], factorise, tolerance
    )
    difference = u - solve_by_factors(matrices[-1], levels[-1])
    # The first set of a mesh may differ from the last one in a few nodes: then the estimate is no equality
    assert np.sqrt(difference @ (matrices[-1] @ difference)) <= 2 * tolerance
    assert np.all(
        u[np.isfinite(levels[-1].obstacle)] >= levels[-1].obstacle[np.isfinite(levels[-1].obstacle)]
    )
    assert counts["sets"] >= 1


def test_a_start_from_the_coarse_mesh_takes_fewer_sets(data: dict[str, np.ndarray]) -> None:
    """Control: the same on the finest mesh alone, from contact everywhere."""
    levels = nested.read_levels(data)
    matrices = matrices_of(data, levels)

    def factorise(k: int, free: np.ndarray) -> nested.Operator:
        return splu((matrices[k]).tocsc()).solve

    interpolations = [nested.interpolation(level) for level in levels[1:]]
    multiply = [A.dot for A in matrices]
    _, from_coarse = nested.solve_by_nested_iteration(levels, interpolations, multiply, factorise, 1e-6)
    _, counts_alone = nested.solve_by_nested_iteration(
        levels[-1:], [], multiply[-1:], lambda _, free: factorise(len(levels) - 1, free), 1e-6
    )
    assert from_coarse["sets"] < counts_alone["sets"]
