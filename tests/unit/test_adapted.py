"""The problem on adapted meshes: the solutions of independent codes, and that what is guaranteed holds."""

import numpy as np
import pytest
from conftest import DATA, interior_point

import unilateral as ul
from unilateral import adapted as problems
from unilateral.bounds.source import enclosed
from unilateral.discrete import discretise
from unilateral.fem.rounded import dual_norm
from unilateral.geometry import mesh as meshes
from unilateral.geometry.adapted import adapted, refined
from unilateral.geometry.partition import uniform
from unilateral.problems import problem_file
from unilateral.solvers import descent
from unilateral.solvers.stop import ALGORITHMS, Stop

EXACTLY = Stop(tolerance=1e-9)
KITE = [[0, 0], [1.1, -0.3], [1.4, 1.2], [0.2, 0.8]]
PROBLEMS = {
    "one's own": lambda: ul.Problem(KITE, "exp(x) - 4*y - 2", g="0.3*sin(9*(x + y)) - 0.2"),
    "free sides": lambda: problem_file.load(str(DATA / "problems/rectangle_free_sides.yaml")),
    "given fluxes": lambda: ul.Problem(
        KITE, "exp(x) - 4*y", g=[None, -0.2, -0.2, -0.2], free_sides=[0], q="2*sin(9*x) - 4*pos(x - 1/2, 0)"
    ),
    "no contact": lambda: ul.Problem(KITE, "1 + x", g="-10"),
}


def mesh_for(problem, times=3):
    """Refined in an ever smaller part at a vertex."""
    cells = uniform(problem.polygon, problem.polygon.lengths.max() / 2)
    of = adapted(meshes.following(cells, 2)[0])
    for k in range(times):
        centre = of.mesh.points[of.mesh.triangles].mean(axis=1) - problem.polygon.vertices[1]
        chosen = np.flatnonzero(np.hypot(*centre.T) < problem.polygon.diameter / 2 ** (k + 1))
        of, _ = refined(of, chosen, np.zeros(of.mesh.n_nodes))
    return of


def on(problem, times=3):
    of = mesh_for(problem, times)
    return problems.adapted(problem, of, np.zeros(of.mesh.n_nodes))


@pytest.fixture(params=["direct", "conjugate gradients"])
def way(request, monkeypatch):
    monkeypatch.setattr(descent, "DIRECT", 0 if "gradients" in request.param else 10**6)


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_finds_the_solution_of_the_condensed_problem(name, way):
    """By Lawson's and Hanson's active sets, and by clarabel, both independent of these sets and steps."""
    problem = PROBLEMS[name]()
    found, other = on(problem), discretise(problem, mesh_for(problem).mesh, mesh_for(problem).partition)
    solved = found.solved(EXACTLY)
    expected = other.solved(Stop(tolerance=1e-11, algorithm="active_set"))
    assert solved.result.converged
    assert solved.result.algorithm in ALGORITHMS  # as it may be asked for, too
    assert solved.result.bound <= 1e-9
    assert np.abs(solved.u_h - expected.u_h).max() < 1e-8
    operator = other.spaces.operator
    for lambda_H in (expected.result.lambda_H, None):
        half = interior_point(operator, other.offset) if lambda_H is None else operator.half @ lambda_H
        assert np.linalg.norm(operator.half @ solved.result.lambda_H - half) < 1e-7
    assert np.all(solved.lambda_H >= 0)
    assert np.all(solved.lambda_H[np.isin(found.partition.side, problem.free_sides)] == 0)
    assert solved.balance < 1e-8
    assert (solved.lambda_H.max() > 0) == (name != "no contact")


def test_the_comparison_notices_a_cell_that_is_left_out():
    problem = PROBLEMS["one's own"]()
    found = on(problem)
    solved, other = found.solved(EXACTLY), discretise(problem, found.mesh, found.partition)
    expected = other.solved(Stop(tolerance=1e-11, algorithm="active_set")).result.lambda_H
    lost = np.where(solved.result.lambda_H == solved.result.lambda_H.max(), 0, solved.result.lambda_H)
    assert np.linalg.norm(other.spaces.operator.half @ (lost - expected)) > 1e-3


def test_the_algebraic_bound_holds_for_any_pair():
    """u_h and lambda_H with noise of many sizes: both distances, in exact discrete norms, are below it."""
    problem, rng = PROBLEMS["one's own"](), np.random.default_rng(4)
    found = on(problem)
    exact, operator = found.solved(EXACTLY), discretise(problem, found.mesh, found.partition).spaces.operator
    lambda_H, A = exact.result.lambda_H, found.system.A
    for size in np.repeat(10.0 ** np.arange(-6, 2), 5):
        moved = size * rng.standard_normal(found.mesh.n_nodes)
        mu = np.maximum(lambda_H + size * rng.standard_normal(len(lambda_H)), 0)
        bound = found.system.bound(exact.u_h + moved, mu)
        assert np.sqrt(moved @ (A @ moved)) <= bound + 1e-8
        assert np.linalg.norm(operator.half @ (mu - lambda_H)) <= bound + 1e-8


@pytest.mark.parametrize("kind", ["noise", "a constant", "one node"])
def test_the_dual_norm_is_bounded(kind):
    """Against (R . A^{-1} R)^(1/2); of a constant, 1 everywhere, it is nearly |Omega|^(1/2), seen twofold."""
    system, n = on(PROBLEMS["one's own"]()).system, 0
    n = len(system.load)
    R = {
        "noise": np.random.default_rng(0).standard_normal(n),
        "a constant": system.mass,
        "one node": np.eye(n)[9],
    }
    exact = np.sqrt(R[kind] @ np.linalg.solve(system.A.toarray(), R[kind]))
    assert exact <= dual_norm(R[kind], system.mass)
    if kind == "a constant":
        assert dual_norm(R[kind], system.mass) == pytest.approx(2 * exact, rel=0.01)


def test_lambda_s_norm_is_one_from_below_and_not_idle(way):
    problem = PROBLEMS["one's own"]()
    found = on(problem)
    exact = discretise(problem, found.mesh, found.partition)
    for seed in range(3):
        lambda_H = np.random.default_rng(seed).uniform(0, 1, len(found.cells))
        below, norm = found.lambda_norm(lambda_H), np.linalg.norm(exact.spaces.operator.half @ lambda_H)
        assert 0.99 * norm < below <= norm * (1 + 1e-12)
    assert found.lambda_norm(0 * lambda_H) == 0


@pytest.mark.parametrize("length", [1e-5, 1e-7])
def test_it_is_one_from_below_on_small_domains(length):
    """lambda_H = 1: <lambda_H, v> / ||v||_1 is largest for a constant v, up to the square of the length.

    Control: by v . A v, in which the mass is lost, the number would be too large.
    """
    sides = length * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    found = on(ul.Problem(sides, f="-1", g="0"))
    one, exact = np.ones(len(found.cells)), 4 * (1 + length**2)
    assert 0.99 * exact < found.lambda_norm(one) <= exact
    R = found.system.B.T @ one
    v = problems.riesz(found.system, R, problems.ROUGH * dual_norm(R, found.system.mass))
    lost = v @ (found.system.A @ v)
    assert length > 1e-6 or not 0.99 * exact < R @ v / np.sqrt(np.abs(lost)) <= exact


def test_it_stops_where_it_is_told_and_goes_on(monkeypatch):
    """By conjugate gradients; steps are counted. Without a tolerance at a hundredth of the total bound."""
    monkeypatch.setattr(descent, "DIRECT", 0)
    found = on(PROBLEMS["one's own"]())
    crude = found.iterated(None, Stop())
    assert 0 < crude.result.bound <= crude.tolerance
    fine = crude.improved(1e-7, Stop())
    assert fine.result.bound <= 1e-7 < crude.result.bound
    assert fine.result.operator_applications > crude.result.operator_applications
    solved = found.solved(Stop())
    assert 0 < solved.result.bound <= 0.01 * solved.total("h1")


def test_it_goes_on_where_the_total_bound_was_mostly_algebraic(monkeypatch):
    """On edges down to 1e-4 the algebraic bound of a crude start is large, and the total one is with it."""
    monkeypatch.setattr(descent, "DIRECT", 0)
    found = on(PROBLEMS["one's own"](), 14)
    assert np.diff(found.mesh.s).min() < 1e-4
    crude = found.iterated(None, Stop())
    assert crude.total("h1") > 10 * found.solved(Stop()).total("h1")
    once = crude.improved(0.01 * crude.total("h1"), Stop())
    assert once.result.bound > 0.01 * once.total("h1")  # control
    solved = found.solved(Stop())
    assert solved.result.bound <= 0.01 * solved.total("h1")


def test_refinements_are_the_solutions_on_ever_finer_meshes():
    """Each as from nothing; of a mesh two triangles are refined here, and no mesh has too many unknowns."""
    problem, asked = PROBLEMS["one's own"](), []

    def two(solution):
        asked.append(solution)
        return np.array([0, 1])

    first = meshes.following(uniform(problem.polygon, 0.8), 2)[0]
    found = list(problems.refinements(problem, first, Stop(), two, first.n_nodes + 30))
    unknowns = [each.discrete.mesh.n_nodes for each in found]
    assert unknowns[0] == first.n_nodes
    assert np.all(np.diff(unknowns) > 0)
    assert len(unknowns) > 3
    assert unknowns[-1] <= first.n_nodes + 30
    assert asked == found
    for each in found:
        assert each.result.bound <= 0.01 * each.total("h1")
    last, n = found[-1], unknowns[-1]
    alone = problems.adapted(problem, last.discrete.of, np.zeros(n)).solved(EXACTLY)
    moved = alone.u_h - last.u_h
    assert np.sqrt(moved @ (last.discrete.system.A @ moved)) <= last.result.bound + 1e-9
    np.testing.assert_allclose(last.discrete.source.moments, alone.discrete.source.moments, rtol=1e-12)


def test_a_good_start_leaves_one_system():
    """The set of the solution itself; from all cells active it takes more."""
    found = on(PROBLEMS["one's own"]())
    cold = found.iterated(1e-8, Stop())
    warm = found.iterated(1e-8, Stop(), cold.result.lambda_H)
    assert warm.result.iterations == 1 < cold.result.iterations
    np.testing.assert_allclose(warm.u_h, cold.u_h, atol=1e-12)


def test_the_load_is_that_of_the_enclosure():
    """Which the bound takes, too: with another one its patches would not be balanced."""
    problem = PROBLEMS["one's own"]()
    found = on(problem)
    np.testing.assert_array_equal(found.source.moments, enclosed(found.mesh, problem).moments)
    solved = found.solved(EXACTLY)
    assert solved.bound().residual <= 1e-9
    assert solved.bound().u >= solved.bound().flux > 0.01
