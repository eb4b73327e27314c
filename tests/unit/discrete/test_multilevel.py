"""Multigrid and what is condensed to the boundary: the same solutions on uniform and on adapted meshes.

Which of them is chosen, in what memory; and solutions that follow one another on ever finer meshes.
"""

from functools import cache, partial

import numpy as np
import pytest
import sentences
from conftest import DATA, interior_point
from nested import forget_refinement, multilevel

import unilateral as ul
from unilateral.bounds import boundary_flux, enclosed_data, equilibrated_flux
from unilateral.bounds.flux_residuals import residual_parts
from unilateral.bounds.source import enclose_function
from unilateral.discrete import choice
from unilateral.discrete.condensed import CondensedProblem, discretise
from unilateral.discrete.multilevel import MultilevelProblem, discretise_on_adapted_mesh, solve_refinements
from unilateral.fem.p1 import energy_norm, load_vector
from unilateral.geometry import mesh as meshes
from unilateral.geometry.adapted import refine_and_balance, start_adapted_mesh
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import problem_file
from unilateral.problems.build import put_on_mesh
from unilateral.solution.evaluation import evaluate_u_h, locate_points
from unilateral.solvers import multigrid_bounds
from unilateral.solvers.multigrid_bounds import multilevel_algebraic_bound
from unilateral.solvers.stop import Stop

EXACTLY = Stop(tolerance=1e-11)
KITE = Polygon(np.array([[0, 0], [1.1, -0.3], [1.4, 1.2], [0.2, 0.8]]), "kite")
FORMULAS = {
    "one's own": lambda: ul.Problem(KITE, "exp(x) - 4*y - 2", g="0.3*sin(9*(x + y)) - 0.2"),
    "free sides": lambda: problem_file.load_problem(str(DATA / "problems/rectangle_free_sides.yaml")),
    "given fluxes": lambda: ul.Problem(
        KITE,
        "exp(x) - 4*y",
        g=[None, -0.2, None, -0.2],
        free_sides=[0, 2],
        q="2*sin(9*x) - 4*pos(x - 1/2, 0) - pos(y - 1, 0)",
    ),
    "no contact": lambda: ul.Problem(KITE, "1 + x", g="-10"),
    "full contact": lambda: ul.Problem(KITE, "1 + x", g="10 + x"),
}
PROBLEMS = {
    **FORMULAS,
    "a case": lambda: ul.case("natural"),
    "a case with free sides": lambda: ul.case("thirds", free_sides=[2]),
    "a case on the L-shape": lambda: ul.case("thirds", "lshape", side=2),
    "functions": lambda: ul.Problem(
        KITE, lambda x, y: np.exp(x) - 4 * y - 2, g=lambda x, y: 0.3 * np.sin(9 * (x + y)) - 0.2
    ),
    "given fluxes as functions": lambda: ul.Problem(
        KITE, "exp(x) - 4*y", g=-0.2, free_sides=[2], q=lambda x, y: 3 * np.sin(9 * x)
    ),
}


@cache
def load_problem(name):
    return PROBLEMS[name]()


def discretise_on_uniform_mesh(problem, edges=2):
    """On a refined mesh, and cells of that many edges."""
    cells = make_uniform_partition(problem.polygon, problem.polygon.lengths.max() / 2)
    mesh, cells = meshes.triangulate_from_cells(cells, edges, 3)
    return multilevel(put_on_mesh(problem, mesh), mesh, cells)


def mesh_for(problem, times=3, seed=None):
    """Refined in an ever smaller part at a vertex, or where random triangles were chosen there."""
    cells = make_uniform_partition(problem.polygon, problem.polygon.lengths.max() / 2)
    adapted_mesh = start_adapted_mesh(meshes.triangulate_from_cells(cells, 2)[0])
    rng = np.random.default_rng(seed)
    for k in range(times):
        centre = (
            adapted_mesh.mesh.points[adapted_mesh.mesh.triangles].mean(axis=1) - problem.polygon.vertices[1]
        )
        chosen = np.flatnonzero(np.hypot(*centre.T) < problem.polygon.diameter / 2 ** (k + 1))
        if seed is not None:
            chosen = rng.choice(chosen, len(chosen) // 3 + 1, replace=False)
        adapted_mesh = refine_and_balance(adapted_mesh, chosen)
    return adapted_mesh


def discretise_on_random_mesh(problem, times=3, seed=None):
    return discretise_on_adapted_mesh(problem, mesh_for(problem, times, seed))


ON_MESHES = [
    *((name, discretise_on_uniform_mesh, (edges,)) for name in PROBLEMS for edges in (2, 3, 4)),
    *(
        (name, discretise_on_random_mesh, seed)
        for name in FORMULAS
        for seed in ((3, None), (6, 0), (6, 1), (6, 2))
    ),
]
"""Problems, on meshes with so many edges in a cell, or refined so often, at random with a seed."""
on_both_meshes = pytest.mark.parametrize(
    "discretise_on_mesh", [discretise_on_uniform_mesh, discretise_on_random_mesh]
)


def solve_by_condensation(problem, discrete):
    """The same discrete problem, condensed, and its solution by Lawson's and Hanson's active sets."""
    second = discretise(put_on_mesh(problem, discrete.mesh), discrete.mesh, discrete.partition)
    return second, second.solve(Stop(tolerance=1e-11, algorithm="active_set"))


@pytest.mark.parametrize(("name", "discretise_on_mesh", "arguments"), ON_MESHES)
def test_both_ways_lead_to_the_same_solution(name, discretise_on_mesh, arguments):
    """By active sets and by clarabel, both independent of these sets and steps."""
    problem = load_problem(name)
    discrete = discretise_on_mesh(problem, *arguments)
    reference, expected = solve_by_condensation(problem, discrete)
    solved = discrete.solve(EXACTLY)
    assert discrete.mesh.is_adapted == (discretise_on_mesh is discretise_on_random_mesh)
    assert solved.result.algorithm == "multigrid"
    assert solved.result.converged
    assert solved.result.bound <= 1e-11
    size = max(1.0, np.abs(expected.u_h).max())
    assert np.abs(solved.u_h - expected.u_h).max() < 1e-9 * size
    assert np.abs(solved.lambda_H - expected.lambda_H).max() < 1e-7 * size
    half = reference.spaces.operator.D_factor
    for other_multiplier in (
        half @ expected.result.lambda_H,
        interior_point(reference.spaces.operator, reference.offset),
    ):
        assert np.linalg.norm(half @ solved.result.lambda_H - other_multiplier) < 1e-7
    np.testing.assert_allclose(solved.gap, expected.gap, rtol=0, atol=1e-9 * size)
    assert solved.force == pytest.approx(expected.force, rel=1e-8)
    assert discrete.balance(solved) < 1e-9 * size
    free = np.isin(discrete.partition.side, problem.free_sides)
    assert np.all(np.isnan(solved.gap) == free)
    assert np.all(solved.lambda_H[free] == 0)
    assert np.all(solved.lambda_H >= 0)
    assert (solved.lambda_H.max() > 0) == (name != "no contact")
    # On the finest cells of uniform meshes a corner is free.
    assert discretise_on_mesh is discretise_on_uniform_mesh or (solved.lambda_H.min() > 0) == (
        name == "full contact"
    )


def test_the_comparison_notices_another_load_and_a_cell_that_is_left_out():
    """f that is a millionth larger has another solution."""
    discrete = discretise_on_uniform_mesh(load_problem("functions"))
    second, expected = solve_by_condensation(load_problem("functions"), discrete)
    larger = ul.Problem(
        KITE, lambda x, y: (1 + 1e-6) * (np.exp(x) - 4 * y - 2), g=load_problem("functions").g[0]
    )
    assert np.abs(discretise_on_uniform_mesh(larger).solve(EXACTLY).u_h - expected.u_h).max() > 1e-8
    lambda_H = discrete.solve(EXACTLY).result.lambda_H
    values = np.where(lambda_H == lambda_H.max(), 0, lambda_H)
    assert np.linalg.norm(second.spaces.operator.D_factor @ (values - expected.result.lambda_H)) > 1e-3


@on_both_meshes
def test_f_is_enclosed_once(monkeypatch, discretise_on_mesh):
    """The bound has the enclosure that the load is made of: with another one its patches are not balanced."""
    problem = load_problem("one's own")
    discrete = discretise_on_mesh(problem)
    solved = discrete.solve(EXACTLY)
    source = discrete.data.source
    np.testing.assert_array_equal(load_vector(discrete.mesh, source.moments()), discrete.load)
    np.testing.assert_array_equal(source.moments(), enclose_function(discrete.mesh, problem.source).moments())
    monkeypatch.setattr(enclosed_data, "enclose_source", None)
    monkeypatch.setattr(equilibrated_flux, "PATCH_REACTION_RATIO", 1e100)
    monkeypatch.setattr(boundary_flux, "EDGE_REACTION_RATIO", 1e100)
    components = residual_parts(source, discrete.data.given_flux, solved.u_h, solved.flux, solved.form)
    assert np.linalg.norm(components.mean) <= 1e-9
    assert solved.bound().u >= np.linalg.norm(components.misfit) > 0.01


@on_both_meshes
def test_the_norm_from_below_is_one_from_below_and_not_idle(discretise_on_mesh):
    problem = load_problem("one's own")
    discrete = discretise_on_mesh(problem)
    half = discretise(problem, discrete.mesh, discrete.partition).spaces.operator.D_factor
    for seed in range(3):
        lambda_H = np.random.default_rng(seed).uniform(0, 1, len(discrete.cells))
        below = discrete.lambda_norm(lambda_H)
        exact = np.linalg.norm(half @ lambda_H)
        assert 0.99 * exact < below <= exact * (1 + 1e-12)
    assert discrete.lambda_norm(0 * lambda_H) == 0


@pytest.mark.parametrize("peak", [0.0, 0.25, 1.0])
def test_the_norm_from_below_is_that_of_a_coarse_level_where_that_is_enough(monkeypatch, peak):
    """Not where finer levels add to it: at a peak all of them add about the same."""
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 64)
    cells = make_uniform_partition(find_polygon("lshape"), 1 / 32)
    discrete = multilevel(ul.Problem(mesh.polygon, "x", 0), mesh, cells)
    asked = []
    below = multigrid_bounds.functional_norm_lower_bound
    monkeypatch.setattr(
        multigrid_bounds,
        "functional_norm_lower_bound",
        lambda hierarchy, R: asked.append(hierarchy.n) or below(hierarchy, R),
    )
    lambda_H = np.ones(cells.n_cells)
    lambda_H[11] += peak * cells.n_cells
    norm = discrete.lambda_norm(lambda_H)
    finest = discrete.multigrid.finest
    assert norm > 0.99 * below(finest.hierarchy, finest.cells.B.T @ lambda_H)
    assert asked == sorted(asked)
    assert (asked[-1] < mesh.n_nodes) == (peak == 0)


UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def discretise_on_small_square(problem):
    mesh = make_structured_mesh(problem.polygon, problem.polygon.lengths[0] / 32)
    return multilevel(problem, mesh, make_uniform_partition(problem.polygon, problem.polygon.lengths[0] / 16))


@pytest.mark.parametrize(
    ("discretise_on_mesh", "length", "minimum"),
    [
        (discretise_on_small_square, 1e-5, 0.99),
        (discretise_on_small_square, 4.124626382901348e-07, 0.99),
        (discretise_on_small_square, 1e-8, 0.0),
        (discretise_on_random_mesh, 1e-5, 0.99),
        (discretise_on_random_mesh, 1e-7, 0.99),
    ],
)
def test_the_norm_from_below_is_one_from_below_on_small_domains(discretise_on_mesh, length, minimum):
    """lambda_H = 1: <lambda_H, v> / ||v||_1 is largest for a constant v, up to the square of the length.

    Control: by v . A v, in which the mass is lost, the number is another one.
    """
    discrete = discretise_on_mesh(ul.Problem(length * UNIT_SQUARE, f="-1", g="0"))
    values = np.ones(len(discrete.cells))
    exact = 4 * (1 + length**2)
    assert minimum * exact <= discrete.lambda_norm(values) <= exact
    A = discrete.multigrid.finest.hierarchy.A
    mesh = discrete.mesh
    v = np.ones(mesh.n_nodes) + 1e-3 * np.random.default_rng(1).random(mesh.n_nodes) * length**2
    if length <= 1e-6 and not mesh.is_adapted:
        assert np.sqrt(np.abs(v @ (A @ v))) != pytest.approx(energy_norm(mesh, v), rel=1e-6)


@pytest.mark.parametrize("name", ["natural", "thirds"])
def test_the_default_stop_is_a_hundredth_of_the_error(name):
    """The error by quadrature against the exact solution; its estimate is no bound, and within 20 %."""
    case = ul.case(name)
    s = ul.solve(case, h=1 / 48, H=1 / 24, stop=Stop(algorithm="multigrid"))
    assert s.converged
    assert 100 * s.solved.tolerance == pytest.approx(s.errors.h1, rel=0.2)
    assert s.solved.result.bound <= s.solved.tolerance
    condensed = ul.solve(case, h=1 / 48, H=1 / 24, stop=Stop(algorithm="active_set"))
    assert s.errors.h1 == pytest.approx(condensed.errors.h1, rel=1e-3)
    assert s.errors.hm12_upper == pytest.approx(condensed.errors.hm12_upper, rel=0.1)


@on_both_meshes
def test_the_iteration_stops_where_it_is_told_and_goes_on(discretise_on_mesh):
    """Steps are counted. Without a tolerance it stops at a hundredth of the error or of its bound."""
    discrete = discretise_on_mesh(load_problem("one's own"))
    crude = discrete.iterate(None, Stop(fraction=1))
    assert 0 < crude.result.bound <= crude.tolerance
    fine = discrete.improve(crude, 1e-8, Stop())
    assert fine.result.bound <= 1e-8 < crude.result.bound
    assert fine.result.iterations > crude.result.iterations
    assert fine.result.operator_applications > crude.result.operator_applications
    solved = discrete.solve(Stop())
    assert 0 < solved.result.bound <= 0.01 * solved.total_bound("h1")


def test_without_a_tolerance_no_less_than_rounding_is_wanted():
    """For f = g = 1 the solution is 1, its norm 1, and its estimated error 0, which no bound reaches."""
    problem = ul.Problem(square(), "1", g="1")
    sizes = {"h": 1 / 32, "H": 1 / 16}
    first = ul.solve(problem, **sizes, stop=Stop(algorithm="multigrid"))
    assert first.converged
    assert first.solved.tolerance == pytest.approx(1e-10)
    assert 0 < first.solved.result.bound <= 1e-10
    with pytest.warns(ul.SolutionWarning, match="did not converge"):
        assert not ul.solve(problem, **sizes, stop=Stop(algorithm="multigrid", tolerance=1e-17)).converged
    s = ul.solve(problem, **sizes, stop=Stop(algorithm="multigrid", tolerance=1e-9))
    assert s.converged


def cheapest(problem, mesh, cells, stop):
    return choice.discretise_on_spaces(problem, choice.choose_spaces(problem, mesh, cells, stop))


def chosen(mesh, H, **stop):
    return type(cheapest(ul.case("natural"), mesh, make_uniform_partition(mesh.polygon, H), Stop(**stop)))


def test_large_refined_meshes_are_for_multigrid(monkeypatch):
    monkeypatch.setattr(choice, "MIN_MULTIGRID_UNKNOWNS", 1000)
    small = make_structured_mesh(square(), 1 / 16)
    large = make_structured_mesh(square(), 1 / 32)
    assert chosen(small, 1 / 8) is CondensedProblem
    assert chosen(large, 1 / 16) is MultilevelProblem
    assert chosen(small, 1 / 8, algorithm="multigrid") is MultilevelProblem
    assert chosen(large, 1 / 16, algorithm="newton") is CondensedProblem
    assert chosen(large, 1 / 16, rho=0.1) is CondensedProblem
    assert chosen(large, 1 / 20) is CondensedProblem  # points that are no nodes
    assert chosen(large, 1 / 32) is CondensedProblem  # an edge a cell
    assert chosen(meshes.make_unstructured_mesh(square(), 1 / 32), 1 / 16) is CondensedProblem


def test_multigrid_in_vain_is_refused():
    with sentences.raises(ul.InputError, "multigrid"):
        ul.solve(ul.case("natural"), h=1 / 32, H=1 / 32, stop=Stop(algorithm="multigrid"))


@pytest.mark.parametrize("ratio", [2, 3, 4.5])
def test_large_unstructured_meshes_are_refined_ones(monkeypatch, ratio):
    monkeypatch.setattr(choice, "MIN_MULTIGRID_UNKNOWNS", 1000)
    monkeypatch.setattr(choice, "COARSE_MESH_UNKNOWNS", 200)
    s = ul.solve(ul.case("natural", "square"), h=1 / 40, H=ratio / 40, mesh="unstructured")
    assert s.solved.result.algorithm == "multigrid"
    assert s.mesh.h <= 1 / 40 + 1e-12
    assert ratio / 40 + 1e-12 >= s.partition.H
    assert s.converged


def test_an_accuracy_is_certified_by_multigrid(monkeypatch):
    monkeypatch.setattr(choice, "MIN_MULTIGRID_UNKNOWNS", 1000)
    s = ul.solve(ul.case("natural"), accuracy=0.02)
    assert s.certified
    assert s.solved.result.algorithm == "multigrid"
    assert s.errors.h1 <= s.bounds.u
    lambda_solution = ul.solve(ul.case("natural"), accuracy=0.1, norm="hm12")
    assert lambda_solution.certified  # beta is known for the condensed problem only


def test_more_than_the_memory_is_refused_before_it_is_taken(monkeypatch):
    monkeypatch.setattr(choice, "available_mb", lambda: 0.4)
    with sentences.raises(ul.InputError, "h = 0.01", "4 MB", "h >= 0.031"):
        ul.solve(ul.case("natural"), h=1 / 100, H=1 / 50)
    with sentences.raises(ul.InputError, "289 unknowns", "2 MB"):
        ul.solve(ul.case("natural"), H=1 / 8, mesh=make_structured_mesh(square(), 1 / 16))


def test_most_of_the_total_bound_is_not_algebraic():
    """On edges down to 1e-4: the default stop leaves the bound within 1 % of that of the exact solution.

    Control: where the residual is not asked to be small in the sum over nodes, too, it is large, and the
    algebraic bound a hundredth of it at once.
    """
    discrete = discretise_on_random_mesh(load_problem("one's own"), 14)
    assert np.diff(discrete.mesh.s).min() < 1e-4
    solved = discrete.solve(Stop())
    best = discrete.solve(EXACTLY).total_bound("h1")
    assert solved.result.bound <= 0.01 * solved.total_bound("h1") <= 0.01 * (1.01 * best)
    at_zero = multilevel_algebraic_bound(
        discrete.multigrid.finest, np.zeros(discrete.mesh.n_nodes), np.zeros(len(discrete.cells))
    )
    crude = discrete.improve_to_fraction(
        discrete._convert_result(discrete.multigrid.solve(at_zero, max_residual_norm=1e9)), Stop()
    )
    assert crude.result.bound <= 0.01 * crude.total_bound("h1")
    assert crude.total_bound("h1") > 100 * best


def test_refinements_are_the_solutions_on_ever_finer_meshes():
    """Each as from nothing; of a mesh two triangles are refined here, and no mesh has too many unknowns."""
    problem = load_problem("one's own")
    asked = []

    def two(solution):
        asked.append(solution)
        return np.array([0, 1])

    first = meshes.triangulate_from_cells(make_uniform_partition(problem.polygon, 0.8), 2)[0]
    refinements = list(solve_refinements(problem, first, Stop(), two, first.n_nodes + 60))
    unknowns = [refinement.mesh.n_nodes for refinement in refinements]
    assert unknowns[0] == first.n_nodes
    assert np.all(np.diff(unknowns) > 0)
    assert len(unknowns) > 3
    assert unknowns[-1] <= first.n_nodes + 60
    assert asked == refinements
    for entry in refinements:
        assert entry.result.bound <= 0.01 * entry.total_bound("h1")
    last = refinements[-1]
    discrete = multilevel(problem, last.mesh, last.partition)
    anew = discrete.solve(EXACTLY)
    shifted = anew.u_h - last.u_h
    assert np.sqrt(shifted @ (discrete.multigrid.finest.hierarchy.A @ shifted)) <= last.result.bound + 1e-9
    np.testing.assert_allclose(last.data.source.moments(), anew.data.source.moments(), rtol=1e-12)


@pytest.mark.parametrize("steps", [1, 2])
def test_what_is_known_of_a_coarser_mesh_is_taken_over(steps):
    """Its levels, f, and u_h, whose values at new nodes are those of the piecewise linear function."""
    problem = load_problem("one's own")
    mesh = mesh_for(load_problem("one's own"), 2)
    before = discretise_on_adapted_mesh(problem, mesh)
    last = before.solve(EXACTLY)
    for k in range(steps):
        mesh = refine_and_balance(mesh, np.arange(k, len(mesh.mesh.triangles), 7))
    known_hierarchy = before.spaces.hierarchy
    adapted_mesh = discretise_on_adapted_mesh(problem, mesh, before, last)
    levels = adapted_mesh.spaces.hierarchy
    assert levels.coarse_factors is known_hierarchy.coarse_factors
    assert all(level is old for level, old in zip(levels.levels, known_hierarchy.levels[:-1], strict=False))
    places = locate_points(last.mesh, mesh.mesh.points)
    np.testing.assert_allclose(
        adapted_mesh.start_u, places.evaluate(partial(evaluate_u_h, last.mesh, last.u_h)), rtol=0, atol=1e-12
    )
    start = last.partition.means(last.lambda_H, adapted_mesh.partition.points)[adapted_mesh.cells]
    solved = adapted_mesh.iterate(1e-10, Stop(), start)
    anew = discretise_on_adapted_mesh(problem, mesh).solve(EXACTLY)
    assert np.abs(solved.u_h - anew.u_h).max() < 1e-9
    assert energy_norm(mesh.mesh, adapted_mesh.start_u - anew.u_h) < energy_norm(mesh.mesh, anew.u_h)


def test_a_start_is_the_set_to_begin_with():
    """That of the solution leaves one step."""
    discrete = discretise_on_random_mesh(load_problem("one's own"))
    cold = discrete.multigrid.solve(1e-8)
    again = discrete.iterate(1e-8, Stop(), cold.lambda_H)
    warm = discrete.multigrid.solve(1e-8, (discrete.start_u, cold.active))
    assert again.result.iterations == sum(count for _, count in warm.iteration_counts)
    np.testing.assert_allclose(again.u_h, cold.u, rtol=0, atol=1e-8)


def test_the_residual_is_small_against_the_total_bound():
    """In the sum over nodes, which the cheap bound sees. Control: not so without that."""
    problem = load_problem("one's own")
    discrete = discretise_on_random_mesh(problem, 10)
    total = discrete.solve(Stop()).total_bound("h1")
    loose = 10 * discrete.multigrid.finest.hierarchy.n**0.5 * total

    def weighted_norm(solved):
        hierarchy = discrete.multigrid.finest.hierarchy
        finest = discrete.multigrid.finest
        r = finest.load + finest.cells.B.T @ solved.result.lambda_H - hierarchy.A @ solved.u_h
        return np.sqrt(np.sum(r**2 / hierarchy.nodal_weights))

    small = 1e-6 * total
    assert (
        weighted_norm(discrete.iterate(loose, Stop(), predicted_total=small))
        <= 0.1 * small
        < weighted_norm(discrete.iterate(loose, Stop()))
    )


def test_a_mesh_of_one_s_own_goes_the_condensed_way(monkeypatch):
    """It has no levels. The same triangles, made by refinement, have; the solutions differ as f's p do."""
    monkeypatch.setattr(choice, "MIN_MULTIGRID_UNKNOWNS", 10)
    problem = load_problem("one's own")
    discretised = mesh_for(load_problem("one's own"))
    original = meshes.from_arrays(problem.polygon, discretised.mesh.points, discretised.mesh.triangles)
    assert not original.is_adapted
    assert multilevel(problem, original, discretised.partition) is None
    assert multilevel(problem, forget_refinement(discretised.mesh), discretised.partition) is None
    problems = [
        cheapest(problem, mesh, discretised.partition, EXACTLY) for mesh in (original, discretised.mesh)
    ]
    assert [type(discrete_problem) for discrete_problem in problems] == [CondensedProblem, MultilevelProblem]
    solution = problems[0].solve(Stop(tolerance=1e-11, algorithm="active_set"))
    other_solution = problems[1].solve(EXACTLY)
    unknown = sum(discrete_problem.data.source.remainder_norm for discrete_problem in problems)
    assert energy_norm(original, solution.u_h - other_solution.u_h) <= unknown + 1e-9
    assert unknown < 1e-4 * energy_norm(original, solution.u_h)
