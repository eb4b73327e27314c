"""Multigrid and what is condensed to the boundary: the same solutions; which is chosen, in what memory."""

import numpy as np
import pytest
from conftest import DATA
from unilateral.nested import Nested, nested

import unilateral as ul
from unilateral import choice, discrete_solution
from unilateral.discrete import Discrete, discretise
from unilateral.fem.hierarchy import hierarchy
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import h1_norm, load
from unilateral.geometry import mesh as meshes
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.problems import problem_file
from unilateral.solvers.stop import Stop

EXACTLY = Stop(tolerance=1e-11)
KITE = Polygon(np.array([[0, 0], [1.1, -0.3], [1.4, 1.2], [0.2, 0.8]]), "kite")


def sampled():
    """f and g as functions."""
    return ul.Problem(KITE, lambda x, y: np.exp(x) - 4 * y, g=lambda x, y: 0.3 * np.sin(9 * (x + y)) - 0.2)


def of_formulas():
    return problem_file.load(str(DATA / "problems/rectangle_free_sides.yaml"))


def with_fluxes():
    return ul.Problem(
        KITE, "exp(x) - 4*y", g=[None, -0.2, None, -0.2], free_sides=[0, 2], q="3*sin(9*x) - pos(y - 1, 0)"
    )


def sampled_with_fluxes():
    of = "exp(x) - 4*y"
    return ul.Problem(KITE, of, g=-0.2, free_sides=[2], q=lambda x, y: 3 * np.sin(9 * x))


PROBLEMS = {
    "a case": lambda: ul.case("natural"),
    "a case with free sides": lambda: ul.case("thirds", free_sides=[2]),
    "a case on the L-shape": lambda: ul.case("thirds", "lshape", side=2),
    "functions": sampled,
    "formulas, free sides": of_formulas,
    "given fluxes": with_fluxes,
    "given fluxes as functions": sampled_with_fluxes,
}


def sizes(problem, edges):
    """A refined mesh, and cells of that many edges."""
    cells = uniform(problem.polygon, problem.polygon.lengths.max() / 2)
    return meshes.following(cells, edges, 3)


@pytest.mark.parametrize("edges", [2, 3, 4])
@pytest.mark.parametrize("name", PROBLEMS)
def test_both_ways_lead_to_the_same_solution(name, edges):
    """The active set of the condensed problem is independent of multigrid."""
    problem = PROBLEMS[name]()
    mesh, cells = sizes(problem, edges)
    found = nested(problem, mesh, cells).solved(EXACTLY)
    expected = discretise(problem, mesh, cells).solved(Stop(tolerance=1e-11, algorithm="active_set"))
    assert found.result.algorithm == "multigrid"
    assert found.result.converged
    size = max(1.0, np.abs(expected.u_h).max())
    assert np.abs(found.u_h - expected.u_h).max() < 1e-9 * size
    assert np.abs(found.lambda_H - expected.lambda_H).max() < 1e-7 * size
    np.testing.assert_allclose(found.gap, expected.gap, atol=1e-9 * size)
    assert found.force == pytest.approx(expected.force, rel=1e-8)
    assert found.balance < 1e-9 * size
    assert np.all(np.isnan(found.gap) == np.isin(cells.side, problem.free_sides))


def test_f_is_enclosed_once(monkeypatch):
    """The bound has the enclosure that the load is made of."""
    problem = of_formulas()
    found = nested(problem, *sizes(problem, 2)).solved(EXACTLY)
    np.testing.assert_array_equal(
        load(found.discrete.mesh, found.discrete.source.moments), found.discrete.load
    )
    monkeypatch.setattr(discrete_solution, "enclosed", None)
    assert found.bound().u > 0


def test_another_load_is_noticed():
    """The comparison above is not blind: f that is a millionth larger has another solution."""
    problem = sampled()
    mesh, cells = sizes(problem, 2)
    expected = discretise(problem, mesh, cells).solved(EXACTLY)
    other = ul.Problem(KITE, lambda x, y: (1 + 1e-6) * (np.exp(x) - 4 * y), problem.g[0])
    found = nested(other, mesh, cells).solved(EXACTLY)
    assert np.abs(found.u_h - expected.u_h).max() > 1e-8


def test_the_norm_from_below_is_one_from_below_and_not_idle():
    problem = sampled()
    mesh, cells = sizes(problem, 2)
    both = nested(problem, mesh, cells), discretise(problem, mesh, cells)
    for seed in range(3):
        lambda_H = np.random.default_rng(seed).uniform(0, 1, cells.n_cells)
        below, exact = both[0].lambda_norm(lambda_H), np.linalg.norm(both[1].spaces.operator.half @ lambda_H)
        assert 0.5 * exact < below <= exact * (1 + 1e-12)
    assert both[0].lambda_norm(0 * lambda_H) == 0


@pytest.mark.parametrize(("length", "least"), [(1e-5, 0.5), (4.124626382901348e-07, 0.5), (1e-8, 0.0)])
def test_it_is_one_from_below_on_small_domains(length, least):
    """lambda_H = 1: <lambda_H, v> / ||v||_1 is largest for a constant v, up to the square of the length.

    Control: by v . A v, in which the mass is lost, the number is another one.
    """
    problem = ul.Problem(length * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), f="-1", g="0")
    mesh = meshes.similar(structured(square(), 1 / 32), problem.polygon)
    found = nested(problem, mesh, uniform(problem.polygon, length / 16))
    one, exact = np.ones(len(found.cells)), 4 * (1 + length**2)
    assert least * exact <= found.lambda_norm(one) <= exact
    finest = found.grids.grids[-1]
    v = np.ones(mesh.n_nodes) + 1e-3 * np.random.default_rng(1).random(mesh.n_nodes) * length**2
    assert length > 1e-6 or np.sqrt(np.abs(v @ (finest.A @ v))) != pytest.approx(h1_norm(mesh, v), rel=1e-6)


@pytest.mark.parametrize("name", ["natural", "thirds"])
def test_the_default_stop_is_a_hundredth_of_the_error(name):
    """The error by quadrature against the exact solution; its estimate is no bound, and within 20 %."""
    case = ul.case(name)
    s = ul.solve(case, h=1 / 64, H=1 / 32, stop=Stop(algorithm="multigrid"))
    assert s.converged
    assert 100 * s.solved.tolerance == pytest.approx(s.errors.h1, rel=0.2)
    assert s.solved.result.bound <= s.solved.tolerance
    condensed = ul.solve(case, h=1 / 64, H=1 / 32, stop=Stop(algorithm="active_set"))
    assert s.errors.h1 == pytest.approx(condensed.errors.h1, rel=1e-3)
    assert s.errors.hm12_upper == pytest.approx(condensed.errors.hm12_upper, rel=0.1)


def test_it_goes_on_to_a_smaller_tolerance():
    problem = of_formulas()
    mesh, cells = sizes(problem, 2)
    discrete = nested(problem, mesh, cells)
    crude = discrete.iterated(None, Stop(fraction=1))
    fine = crude.improved(1e-8, Stop())
    assert crude.result.bound > 1e-8 >= fine.result.bound
    assert fine.result.iterations > crude.result.iterations


def test_a_tolerance_that_the_bound_meets_at_once_is_reached():
    """For f = g = 1 the solution is 1 and its estimated error 0, which no bound reaches."""
    problem = ul.Problem(square(), "1", g="1")
    sizes = {"h": 1 / 32, "H": 1 / 16}
    with pytest.warns(ul.SolutionWarning, match="did not converge"):
        first = ul.solve(problem, **sizes, stop=Stop(algorithm="multigrid"))
    s = ul.solve(problem, **sizes, stop=Stop(algorithm="multigrid", tolerance=1e-9))
    assert first.solved.result.bound <= 1e-9
    assert (first.converged, s.converged) == (False, True)


def chosen(mesh, H, **stop):
    found = choice.cheapest(ul.case("natural"), mesh, uniform(mesh.polygon, H), Stop(**stop))
    return type(found)


def test_large_refined_meshes_are_for_multigrid(monkeypatch):
    monkeypatch.setattr(choice, "PAYS", 1000)
    small, large = structured(square(), 1 / 16), structured(square(), 1 / 32)
    assert chosen(small, 1 / 8) is Discrete
    assert chosen(large, 1 / 16) is Nested
    assert chosen(small, 1 / 8, algorithm="multigrid") is Nested
    assert chosen(large, 1 / 16, algorithm="newton") is Discrete
    assert chosen(large, 1 / 16, rho=0.1) is Discrete
    assert chosen(large, 1 / 20) is Discrete  # points that are no nodes
    assert chosen(large, 1 / 32) is Discrete  # an edge a cell
    assert chosen(meshes.unstructured(square(), 1 / 32), 1 / 16) is Discrete


def test_multigrid_in_vain_is_refused():
    with pytest.raises(ul.InputError, match="multigrid needs a mesh of 'square' made by refinement"):
        ul.solve(ul.case("natural"), h=1 / 32, H=1 / 32, stop=Stop(algorithm="multigrid"))


@pytest.mark.parametrize("ratio", [2, 3, 4.5])
def test_large_unstructured_meshes_are_refined_ones(monkeypatch, ratio):
    monkeypatch.setattr(choice, "PAYS", 1000)
    monkeypatch.setattr(choice, "COARSE", 200)
    s = ul.solve(ul.case("natural", "square"), h=1 / 40, H=ratio / 40, mesh="unstructured")
    assert s.solved.result.algorithm == "multigrid"
    assert s.mesh.h <= 1 / 40 + 1e-12
    assert ratio / 40 + 1e-12 >= s.partition.H
    assert s.converged


def test_an_accuracy_is_certified_by_multigrid(monkeypatch):
    monkeypatch.setattr(choice, "PAYS", 1000)
    s = ul.solve(ul.case("natural"), accuracy=0.01)
    assert s.certified
    assert s.solved.result.algorithm == "multigrid"
    assert s.errors.h1 <= s.bounds.u
    of_lambda = ul.solve(ul.case("natural"), accuracy=0.1, norm="hm12")
    assert of_lambda.certified  # beta is known for the condensed problem only


def test_more_than_the_memory_is_refused_before_it_is_taken(monkeypatch):
    monkeypatch.setattr(choice, "available_mb", lambda: 0.4)
    with pytest.raises(
        ul.InputError, match=r"h = 0.01 makes 1e\+04 unknowns .* take at least 4 MB.*h >= 0.031"
    ):
        ul.solve(ul.case("natural"), h=1 / 100, H=1 / 50)
    with pytest.raises(
        ul.InputError, match="289 unknowns, 64 of them on the boundary, take about 2 MB without"
    ):
        ul.solve(ul.case("natural"), H=1 / 8, mesh=structured(square(), 1 / 16))


def test_cells_follow_a_refined_mesh_of_gmsh():
    mesh, cells = meshes.following(uniform(named("lshape"), 1 / 3), 3, 2)
    assert cells.n_cells * 3 == len(mesh.boundary)
    assert nested_cells(hierarchy(mesh), cells) is not None
