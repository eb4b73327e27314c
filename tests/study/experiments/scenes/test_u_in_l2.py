"""Errors of u in L2 on one pair, against solutions and another quadrature."""

import numpy as np
import pytest
from conftest import exact_errors, load
from numpy.testing import assert_allclose

from study.experiments.scenes.u_in_l2 import tabulate_l2_errors
from unilateral.discrete.condensed import discretise
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.ritz import h1_distance
from unilateral.solvers.stop import Stop

MESH = make_structured_mesh(square(), 1 / 8)
CELLS = make_uniform_partition(square(), 1 / 4)
NAMES = ["full_contact", "natural", "no_contact"]


@pytest.fixture(scope="module")
def l2_errors():
    stop = Stop(fraction=1e-4, algorithm="newton")
    return tabulate_l2_errors(MESH, CELLS, [load(name) for name in NAMES], stop)


def solve(name):
    """The discrete problem of a case and its solution, by active sets."""
    problem = discretise(load(name).problem, MESH, CELLS)
    return problem, problem.solve(Stop(tolerance=1e-11, algorithm="active_set"))


@pytest.mark.parametrize("name", NAMES)
def test_the_error_is_that_of_the_values_at_the_midpoints_of_small_triangles(name, l2_errors):
    """16^2 small triangles in each; the rule of midpoints of edges is exact for quadratics on each."""
    _, solution = solve(name)
    n = 16
    steps = [(i, j) for i in range(n) for j in range(n - i)]
    upward = [[(i + 0.5, j), (i + 0.5, j + 0.5), (i, j + 0.5)] for i, j in steps]
    downward = [[(i + 1, j + 0.5), (i + 0.5, j + 1), (i + 0.5, j + 0.5)] for i, j in steps if i + j < n - 1]
    second, third = np.array(upward + downward).reshape(-1, 2).T / n
    barycentric = np.array([1 - second - third, second, third]).T
    corners = MESH.points[MESH.triangles]
    places = barycentric @ corners
    u = load(name).value_and_gradient(places.reshape(-1, 2))[0].reshape(places.shape[:2])
    u_h = solution.u_h[MESH.triangles] @ barycentric.T
    # equal triangles of the area 1/128, and as many points as parts of it
    expected = np.sqrt(np.mean((u - u_h) ** 2, axis=1).sum() / 128)
    assert float(l2_errors["u_l2_error"].sel(case=name)[0]) == pytest.approx(expected, rel=1e-4)
    assert expected < h1_distance(load(name), MESH, solution.u_h)


def test_what_stands_beside_the_error_is_of_the_same_solution(l2_errors):
    for name in NAMES:
        problem, solution = solve(name)
        row = l2_errors.sel(case=name).isel(mesh=0)
        D = exact_errors(problem, solution).hm12_discrete
        assert_allclose(row["discrete_error"], D, rtol=1e-6, atol=1e-9)
        assert_allclose(row["least_multiplier"], solution.result.lambda_H.min(), atol=1e-9)
        assert float(row["algebraic_bound"]) <= 0.01 * float(row["u_l2_error"])
    assert (l2_errors["least_multiplier"] > 0).values.ravel().tolist() == [True, False, False]
    assert (float(l2_errors["h"][0]), float(l2_errors["H"][0])) == (MESH.h, CELLS.H)
