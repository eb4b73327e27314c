"""Discrete solutions and what is measured on them: exact identities, exact cases, another code's numbers."""

import csv
import math
from functools import cache

import numpy as np
import pytest
import sentences
from conftest import DATA, couple_structured_mesh, discrete, exact_errors
from scipy.linalg import eigh
from scipy.sparse.linalg import spsolve

from unilateral.discrete.condensed import build_condensed_problem, discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.fem.quadrature import boundary_rule
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import project_case
from unilateral.norms.ritz import h1_distance
from unilateral.problems import case as cases
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import uzawa

NAMES = ["full_contact", "natural", "no_contact", "smooth", "thirds"]
WITH_LAMBDA = ["full_contact", "natural", "smooth", "thirds"]
on_every_case = pytest.mark.parametrize("name", NAMES)


@cache
def solve_case(name, n=16, m=8):
    return solve_condensed_problem(discrete(name, n, m))


ON_POLYGONS = [(name, "square") for name in NAMES]
ON_POLYGONS += [(name, "lshape") for name in ("full_contact", "no_contact", "smooth", "thirds")]


@pytest.mark.parametrize(("name", "polygon"), ON_POLYGONS)
def test_h1_error_is_the_distance(name, polygon):
    """The identities against quadrature of u - u_h itself."""
    n = {"square": 16, "lshape": 8}[polygon]
    discrete_problem = discrete(name, n, n // 2, polygon)
    ritz = discrete_problem.exact.ritz
    solution = solve_condensed_problem(discrete_problem)
    distance = h1_distance(ritz.case, discrete_problem.mesh, solution.u_h)
    error = exact_errors(discrete_problem, solution).h1
    assert error == pytest.approx(distance, rel=1e-8, abs=1e-10 * ritz.u_norm)
    assert not math.isclose(error, ritz.ritz_error + 0.01 * distance, rel_tol=1e-8)


def split_defect(sample, solution, sign=1.0):
    """The defect of ||u - u_h||^2 = ||u - z_h||^2 + ||lambda - lambda_H||^2_{-1/2,h}, and ||u - u_h||^2.

    z_h and the discrete norm by solves with the whole matrix, u's distances by quadrature.
    """
    problem = sample.exact.ritz
    mesh = sample.exact.ritz.condensed.mesh
    A = sample.exact.ritz.condensed.A.tocsc()
    extended = np.zeros(mesh.n_nodes)
    total = problem.load.copy()
    extended[mesh.boundary] = problem.multiplier_load - sign * (sample.spaces.B.T @ solution.lambda_H)
    total[mesh.boundary] += problem.multiplier_load
    z_h = spsolve(A, total)
    dual_square = extended @ spsolve(A, extended)
    u = h1_distance(problem.case, mesh, solution.u_h) ** 2
    z = h1_distance(problem.case, mesh, z_h) ** 2
    return abs(u - z - dual_square), u


@on_every_case
def test_the_error_splits_exactly(name):
    """To rounding where the quadrature of smooth u leaves only that, else to its share."""
    discrete_problem = discrete(name, 16, 8)
    solution = solve_case(name)
    defect, square_of_error = split_defect(discrete_problem, solution)
    smooth = name in ("full_contact", "no_contact")
    assert defect <= (1e-10 * discrete_problem.exact.ritz.u_norm**2 if smooth else 1e-4 * square_of_error)
    share = exact_errors(discrete_problem, solution).quadrature_share
    assert defect / square_of_error == pytest.approx(share, rel=1e-3, abs=1e-10)
    assert share <= 1e-4


@pytest.mark.parametrize("name", WITH_LAMBDA)
def test_a_sign_error_in_the_coupling_breaks_the_split(name):
    defect, square_of_error = split_defect(discrete(name, 16, 8), solve_case(name), sign=-1.0)
    assert defect > 1e-2 * square_of_error


@pytest.mark.parametrize("name", ["smooth", "thirds"])
def test_quadratures_share_shrinks_with_the_degree(name):
    problems = [discrete(name, 16, 8, degree=degree) for degree in (4, 8, 16)]
    shares = [
        exact_errors(problem, solve_condensed_problem(problem)).quadrature_share for problem in problems
    ]
    assert shares[2] < 0.5 * shares[1] < 0.25 * shares[0]


def test_no_contact_has_no_multiplier():
    assert not np.any(solve_case("no_contact").lambda_H)


@pytest.mark.parametrize("start", [0.0, 2.0])
def test_a_constant_that_touches_the_obstacle_needs_no_force(start):
    """f = 1 = g: u_h = 1 touches the obstacle and lambda_H = 0."""
    spaces = couple_structured_mesh("square", 16, 8)
    condensed = spaces.condensed
    lengths = spaces.partition.lengths
    load = condensed.A @ np.ones(condensed.mesh.n_nodes)
    condensed_problem = build_condensed_problem(
        spaces, load, condensed.solve(load)[condensed.mesh.boundary], np.ones(len(lengths))
    )
    result = uzawa(spaces.operator, condensed_problem.offset, 1e-12, start=np.full(len(lengths), start))
    root = math.sqrt(spaces.operator.lambda_min)
    np.testing.assert_allclose(result.lambda_H, 0, rtol=0, atol=1e-12 / (root * math.sqrt(lengths.min())))
    np.testing.assert_allclose(condensed_problem.response(result.lambda_H), 1, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ratio", [1, 2, 4])
@on_every_case
def test_the_solution_is_balanced_globally(name, ratio):
    """v = 1 in (2.1): int u_h - int f = int lambda_H, here from u_h's own integral too."""
    discrete_problem = discrete(name, 16, 16 // ratio)
    solution = solve_case(name, 16, 16 // ratio)
    mesh = discrete_problem.exact.ritz.condensed.mesh
    integral = mesh.areas @ solution.u_h[mesh.triangles].mean(axis=1)
    force = discrete_problem.exact.cell_means.partition.lengths @ solution.lambda_H
    assert abs(integral - discrete_problem.exact.ritz.load.sum() - force) < 1e-10
    assert discrete_problem.balance(solution) < 1e-10


@pytest.mark.parametrize("name", WITH_LAMBDA)
def test_the_l2_error_of_lambda_is_that_by_quadrature(name):
    cells = discrete(name, 16, 8).exact.cell_means
    solution = solve_case(name)
    case = discrete(name, 16, 8).exact.ritz.case
    rule = boundary_rule(case.polygon, cells.partition.points, case.singular_points())
    _, flux, _ = case.trace_flux_and_gap(rule.side, rule.s)
    direct = math.sqrt(rule.weight @ (flux - solution.lambda_H[rule.interval]) ** 2)
    error = exact_errors(discrete(name, 16, 8), solution).l2
    assert error == pytest.approx(direct, rel=1e-12)
    assert error != pytest.approx(cells.projection_error, rel=1e-6)


def getfem():
    """lambda_H of GetFEM in the order of T_H: the file lists the sides anticlockwise."""
    text = (DATA / "getfem_natural_n32_H2h.csv").read_text()
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    order = {"bottom": 0, "right": 1, "top": 2, "left": 3}
    rows.sort(key=lambda row: (order[row["side"]], float(row["start"])))
    return np.array([float(row["lambda_H"]) for row in rows])


@pytest.mark.parametrize("stop", [Stop(tolerance=1e-11), Stop(tolerance=1e-9, algorithm="active_set")])
def test_natural_as_getfem_has_it(stop):
    """1e-8 is the stop's 1e-11 over lambda_min(S)^(1/2) H^(1/2), and GetFEM's own residual."""
    solution = solve_condensed_problem(discrete("natural", 32, 16), stop)
    np.testing.assert_allclose(solution.lambda_H, getfem(), rtol=0, atol=1e-8)


def test_a_wrong_power_is_not_what_getfem_has(case_like):
    atom = {"atom": "harmonic", "side": 0, "at": "1/2", "alpha": "0.6", "times": "3/2"}
    case = case_like("natural", u=[atom, cases.read_case_declaration("natural")[0]["u"][1]])
    spaces = couple_structured_mesh("square", 32, 16)
    assert (
        np.abs(
            solve_condensed_problem(discretise_case(spaces, project_case(case, spaces))).lambda_H - getfem()
        ).max()
        > 1e-3
    )


@on_every_case
def test_the_algebraic_error_is_a_hundredth_of_each_error(name):
    """Divided by the norm equivalences of the L2 and the H^(-1/2) norm; ||.||_{-1/2} >= ||.||_{-1/2,h}."""
    discrete_problem = discrete(name, 16, 8)
    solution = solve_case(name)
    bound = solution.result.bound
    lambda_min = discrete_problem.spaces.operator.lambda_min
    assert solution.result.converged
    errors = exact_errors(discrete_problem, solution)
    assert bound <= 0.01 * errors.h1
    if name != "no_contact":
        assert bound / math.sqrt(lambda_min) <= 0.01 * errors.l2
        assert bound / discrete_problem.spaces.beta <= 0.01 * errors.hm12_discrete


def test_auto_takes_plain_uzawa_where_beta_is_positive():
    assert solve_case("natural").result.algorithm == "uzawa"


def test_auto_takes_the_active_set_where_beta_is_zero():
    """At H = h, where lambda is not judged and its errors are NaN."""
    solution = solve_case("natural", 16, 16)
    assert solution.result.algorithm == "active_set"
    errors = exact_errors(discrete("natural", 16, 16), solution)
    assert math.isnan(errors.l2)
    assert math.isnan(errors.hm12_discrete)
    known_exact_errors = exact_errors(discrete("natural", 16, 8), solve_case("natural"))
    assert errors.h1 == pytest.approx(known_exact_errors.h1, rel=0.2)


def test_auto_accelerates_where_too_many_steps_are_predicted():
    discrete_problem = discrete("natural", 16, 8)
    plain = solve_case("natural")
    fast = solve_condensed_problem(discrete_problem, Stop(max_steps=int(plain.result.iterations) // 2))
    assert fast.result.algorithm == "nesterov"
    assert fast.result.converged
    assert fast.result.iterations < plain.result.iterations / 3
    errors = [exact_errors(discrete_problem, solution).h1 for solution in (fast, plain)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-3)


def test_an_unconverged_run_warns():
    with pytest.warns(RuntimeWarning, match="uzawa stopped after 3 steps with the algebraic bound"):
        solution = solve_condensed_problem(discrete("natural", 16, 8), Stop(max_steps=3, algorithm="uzawa"))
    assert not solution.result.converged


@pytest.mark.parametrize(
    "stop",
    [
        {"algorithm": "simplex"},
        {"algorithm": "newton"},
        {"algorithm": "active_set", "rho": 1.0},
    ],
)
def test_what_cannot_be_done_is_refused(stop):
    """At H = h, where beta is 0."""
    with sentences.raises(InputError):
        solve_condensed_problem(discrete("natural", 16, 16), Stop(**stop))


@pytest.mark.parametrize("algorithm", ["newton", "barzilai_borwein", "nesterov", "uzawa"])
def test_every_algorithm_finds_the_active_set_s_multiplier(algorithm):
    """The bound is guaranteed, so 1e-9 of it separates any two of them by no more than 2e-9 in the energy."""
    discrete_problem = discrete("natural", 16, 8)
    expected = solve_condensed_problem(discrete_problem, Stop(tolerance=1e-9, algorithm="active_set")).result
    result = solve_condensed_problem(discrete_problem, Stop(tolerance=1e-9, algorithm=algorithm)).result
    assert result.algorithm == algorithm
    assert (
        np.linalg.norm(discrete_problem.spaces.operator.D_factor @ (result.lambda_H - expected.lambda_H))
        <= 2e-9
    )


def test_the_algebraic_error_of_lambda_is_the_bound_over_beta():
    """Of all mu with the discrete norm of the bound one has the largest norm, at least in its lower bound."""
    discrete_problem = discrete("natural", 16, 8)
    gram = build_dual_norm(make_uniform_partition(square(), 1 / 8)).gram()
    solved = discrete_problem.iterate(1e-3, Stop())
    ratios, vectors = eigh(gram.p0.lower, discrete_problem.spaces.operator.D)
    mu = solved.result.bound * vectors[:, -1]
    assert np.linalg.norm(discrete_problem.spaces.operator.D_factor @ mu) == pytest.approx(
        solved.result.bound
    )
    norm = math.sqrt(ratios[-1]) * solved.result.bound
    assert 1.05 * solved.result.bound < norm <= solved.algebraic_bound("hm12")
    assert solved.algebraic_bound("h1") == solved.result.bound
