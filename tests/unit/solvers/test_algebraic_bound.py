"""The algebraic bounds against solutions of the same matrices with 60 digits, where data nearly cancel."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from flint import acb_mat, arb, arb_mat, ctx
from nested import multilevel

import unilateral as ul
from unilateral.arrays import Array, Mask
from unilateral.discrete.base import DiscreteProblem
from unilateral.discrete.condensed import CondensedProblem, discretise
from unilateral.discrete.multilevel import discretise_on_adapted_mesh
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem import residual_rounding
from unilateral.fem.condense import condense
from unilateral.fem.form import Form
from unilateral.fem.spaces import DualOperator, mixed_spaces
from unilateral.geometry.adapted import refine_and_balance, start_adapted_mesh
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.algebraic_bound import condensed_algebraic_bound
from unilateral.solvers.multigrid_bounds import multilevel_algebraic_bound
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import energy_bound, residual_bound

DIGITS = 60
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]


@pytest.fixture(autouse=True)
def digits():
    before = ctx.dps
    ctx.dps = DIGITS
    yield
    ctx.dps = before


exact = np.vectorize(arb, otypes=[object])
"""Double numbers as they are; arrays of these numbers are added and multiplied with 60 digits."""


def solve(A, b):
    """A^{-1} b, with b (n,)."""
    solution = arb_mat(A.tolist()).solve(arb_mat(b[:, None].tolist()))
    return np.array(solution.entries(), dtype=object)


class System(NamedTuple):
    """A v = load + B^T lambda, B v >= d with lambda, exact; the rows of A add up to the mass.

    v is u - lift, which vanishes on clamped sides.
    """

    A: Array
    load: Array
    B: Array
    d: Array
    lift: Array

    def errors(self, exact_v: Array, exact_lambda: Array, u: Array, lambda_H: Array) -> tuple[arb, arb]:
        """||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h}."""
        e = exact(u) - exact(self.lift) - exact_v
        pull = self.B.T @ (exact(lambda_H) - exact_lambda)
        return (e @ (self.A @ e)).sqrt(), (solve(self.A, pull) @ pull).sqrt()


def error_data(discrete) -> System:
    """That which the bound is for."""
    if isinstance(discrete, CondensedProblem):
        spaces = discrete.spaces
        boundary = discrete.mesh.boundary
        condensed = discrete.spaces.condensed
        B = np.zeros((len(discrete.cells), discrete.mesh.n_nodes))
        B[:, boundary] = spaces.B.toarray()
        (A, sums) = condensed.matrix_and_row_sums
        load = discrete.homogeneous_data[0]
        d = exact(spaces.operator.H_i) * exact(discrete.homogeneous_data[1][discrete.cells])
    else:
        finest = discrete.multigrid.finest
        A = finest.hierarchy.A
        sums = finest.hierarchy.row_sums
        load = finest.load
        B = finest.cells.B.toarray()
        d = exact(finest.d)
    off_diagonal = A.toarray()
    np.fill_diagonal(off_diagonal, 0.0)
    A = exact(off_diagonal)
    np.fill_diagonal(A, exact(sums) - A.sum(axis=1))
    lift = np.broadcast_to(discrete.dirichlet_lift, len(load))
    return System(A, exact(load), exact(B), d, lift)


def solved_exactly(system: System, active: Mask) -> tuple[Array, Array]:
    """v and lambda_H by active sets, the last of which is proved to be right by intervals."""
    n = len(system.load)
    for _ in range(20):
        B = system.B[active]
        full_block = np.block([[system.A, -B.T], [B, exact(np.zeros((len(B), len(B))))]])
        solution = solve(full_block, np.concatenate([system.load, system.d[active]]))
        u = solution[:n]
        lambda_ = exact(np.zeros(len(active)))
        lambda_[active] = solution[n:]
        gap = system.B @ u - system.d
        after = np.where(active, lambda_ > 0, gap < 0).astype(bool)
        if np.array_equal(after, active):
            assert np.all(gap[~active] > 0)
            return u, lambda_
        active = after
    raise AssertionError("the sets do not settle")


def problem(scale: float, c: float = 1, clamped: tuple[int, ...] = ()) -> ul.Problem:
    """u and g are about that large, and differ by about 1; a part of the boundary is in contact."""
    g = [None if side in clamped else f"{scale:.0f}" for side in range(4)]
    u = dict.fromkeys(clamped, f"{scale:.0f}")
    return ul.Problem(SQUARE, f"{c * scale:.0f} + 20*x - 10", g=g, u=u, c=c)


POLYGON = problem(1).polygon
MESH = make_structured_mesh(POLYGON, 1 / 6)
ADAPTED = refine_and_balance(start_adapted_mesh(make_structured_mesh(POLYGON, 1 / 4)), np.arange(0, 32, 3))


def make_discrete(way: str, scale: ul.Problem):
    if way == "adapted":
        return discretise_on_adapted_mesh(scale, ADAPTED)
    cells = make_uniform_partition(POLYGON, 1 / 6 if way == "singular" else 1 / 3)
    return multilevel(scale, MESH, cells) if way == "multigrid" else discretise(scale, MESH, cells)


def solution(way: str, scale: ul.Problem) -> tuple[DiscreteProblem, DiscreteSolution]:
    algorithm = way if way in ("uzawa", "nesterov", "newton", "active_set") else "auto"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        discrete = make_discrete(way, scale)
        return discrete, discrete.iterate(1e-9, Stop(algorithm=algorithm))


def largest_error(discrete: DiscreteProblem, solution: DiscreteSolution) -> float:
    """Of both errors; it is proved that the solution with 60 digits is one."""
    lambda_H = solution.result.lambda_H
    system = error_data(discrete)
    u, lambda_ = solved_exactly(system, lambda_H > 0)
    assert 0 < np.count_nonzero(lambda_ > 0) < len(lambda_H)
    return max(float(error.upper()) for error in system.errors(u, lambda_, solution.u_h, lambda_H))


WAYS = ["uzawa", "nesterov", "newton", "active_set", "singular", "multigrid", "adapted"]


@pytest.mark.parametrize("scale", [1e0, 1e4, 1e8, 1e12])
@pytest.mark.parametrize("way", WAYS)
def test_the_bound_is_one_however_much_cancels(way: str, scale: float) -> None:
    """Nor is it too large: by 1e-12 of u, which is what residuals of some EPS u are over h^2."""
    discrete, solved = solution(way, problem(scale))
    error = largest_error(discrete, solved)
    assert 0 < error <= solved.result.bound
    assert solved.result.converged == (solved.result.bound <= 1e-9)
    if way != "singular":  # its bound is a root of what is rounded
        assert solved.result.bound <= 1e-9 + 1e-12 * scale


@pytest.mark.parametrize(("c", "clamped"), [(0, (1,)), (0, (0, 1)), (1, (1, 2))])
@pytest.mark.parametrize("scale", [1e0, 1e4, 1e8, 1e12])
@pytest.mark.parametrize("way", ["newton", "multigrid", "adapted"])
def test_the_bound_is_one_beside_clamped_sides(
    way: str, scale: float, c: float, clamped: tuple[int, ...]
) -> None:
    """There u_h - lift falls from u to 0 within an element, which costs a digit."""
    discrete, solved = solution(way, problem(scale, c, clamped))
    assert 0 < largest_error(discrete, solved) <= solved.result.bound <= 1e-9 + 1e-11 * scale


@pytest.mark.parametrize("way", ["uzawa", "newton", "active_set", "singular"])
def test_the_bounds_of_the_iteration_alone_are_none(way: str) -> None:
    """Control: for the operator and the offset as they are computed they hold, and for the problem not."""
    discrete, solved = solution(way, problem(1e12))
    operator = discrete.spaces.operator
    mu = solved.result.lambda_H
    single_residual_bound = residual_bound(operator, discrete.offset, mu, 1 / operator.lambda_max)
    if way == "singular":
        single_residual_bound = energy_bound(operator, discrete.offset, mu)
    assert single_residual_bound < 0.1 * largest_error(discrete, solved)


@pytest.mark.parametrize("way", ["newton", "singular", "multigrid", "adapted"])
def test_all_that_is_rounded_is_in_the_bound(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were numbers rounded a million times more, the bound would be nearly that much larger."""
    discrete, solved = solution(way, problem(1e4))

    def bound() -> float:
        if isinstance(discrete, CondensedProblem):
            return discrete.add_rounding_to_bound(
                solved.result, discrete.response(solved.result.lambda_H)
            ).bound
        return multilevel_algebraic_bound(discrete.multigrid.finest, solved.u_h, solved.result.lambda_H)

    before = bound()
    monkeypatch.setattr(residual_rounding, "UNIT_ROUNDOFF", 1e6 * residual_rounding.UNIT_ROUNDOFF)
    power = 0.5 if way == "singular" else 1.0
    assert bound() > 0.1 * 1e6**power * before


@pytest.mark.parametrize("length", [1.0, 1e-2, 2e-3])
def test_the_computed_norm_of_lambda_is_below_the_exact_one(length: float) -> None:
    """On small domains A_3 is known to fewer digits."""
    small = ul.Problem(length * np.array(SQUARE), "-1", g="0")
    mesh = make_structured_mesh(small.polygon, length / 4)
    discrete = discretise(small, mesh, make_uniform_partition(small.polygon, length / 2))
    lambda_H = np.random.default_rng(2).uniform(0, 1, len(discrete.cells))
    system = error_data(discrete)
    pull = system.B.T @ exact(lambda_H)
    norm = float((pull @ solve(system.A, pull)).sqrt().mid())
    assert (1 - 1e-5) * norm < discrete.lambda_norm(lambda_H) < norm


@pytest.mark.parametrize(
    ("f", "g", "hidden"), [("1e12 - 1", "1e12", True), ("1e15", "1e15 - 1", True), ("-1e10", "1e12*x", False)]
)
def test_the_default_stop_is_a_hundredth_of_the_bound_or_what_rounding_leaves(
    f: str, g: str, hidden: bool
) -> None:
    """A tolerance that rounding hides is not reached, and the solution says so."""
    problem_with_sum = ul.Problem(SQUARE, f, g=g)
    sizes = {"h": 1 / 16, "H": 1 / 8}
    solution = ul.solve(problem_with_sum, **sizes)
    result = solution.solved.result
    expected = 0.01 * solution.bounds.u
    assert solution.converged
    assert result.bound <= max(expected, 2 * result.rounding)
    assert (result.bound > expected) == hidden
    with pytest.warns(ul.SolutionWarning, match="did not converge"):
        assert not ul.solve(
            problem_with_sum, **sizes, stop=ul.Stop(tolerance=1e-3 * result.rounding)
        ).converged


def root(P: float, linear: float) -> float:
    """The largest x with x^2 <= P + linear x."""
    return (linear + (linear**2 + 4 * P) ** 0.5) / 2


@pytest.mark.parametrize("share", [1e-5, 1e-2, 1.0, 1e2])
def test_no_number_above_the_bound_fulfils_the_inequality(share: float) -> None:
    """One cell: a = |R| s and b = |R| / (rho s) are known; where b is much larger it is hardly less."""
    dual_operator = DualOperator(np.array([[2.0]]), np.ones(1), 1.0)
    rho = 1.9 / dual_operator.lambda_max
    gap = residual_rounding.Rounded(np.array([-3.0]), np.zeros(1))
    R = rho * 3.0
    a = 2 * R
    b = R / (2 * rho)
    delta = share * b
    algebraic_bound = condensed_algebraic_bound(dual_operator, np.zeros(1), gap, delta, rho)
    minimum = root(b * delta, a + b + delta) + delta
    assert minimum <= algebraic_bound
    single_algebraic_bound = condensed_algebraic_bound(dual_operator, np.zeros(1), gap, 0.0, rho)
    assert single_algebraic_bound == pytest.approx(a + b, rel=2e-6)
    steep = DualOperator(np.array([[1e-3]]), np.ones(1), 1.0)  # a is nothing beside b
    slow = 1e-3 / steep.lambda_max
    b = 3.0 / 1e-3
    algebraic_bound = condensed_algebraic_bound(steep, np.zeros(1), gap, share * 1e-3, slow)
    single_algebraic_bound = condensed_algebraic_bound(steep, np.zeros(1), gap, share * 0.0, slow)
    minimum = root(b * share * 1e-3, slow * 3e-3 + b + share * 1e-3) + share * 1e-3
    assert minimum <= algebraic_bound
    assert algebraic_bound - single_algebraic_bound <= 1.01 * (minimum - root(0, slow * 3e-3 + b)) + 1e-9 * b


@pytest.mark.parametrize("P", [0.0, 1e-4, 1.0])
@pytest.mark.parametrize("delta", [0.0, 1e-4, 1.0])
def test_no_number_above_the_bound_fulfils_the_inequality_of_the_energy(P: float, delta: float) -> None:
    """Of two cells with a singular S on a domain of area 4, one 1/2 below g, one above it with mu > 0."""
    dual_operator = DualOperator(np.array([[1.0, 1.0]]), np.ones(2), shift_norm=2.0)
    assert dual_operator.is_singular
    gap = residual_rounding.Rounded(np.array([-0.5, 0.5]), np.zeros(2))
    mu = np.array([0.0, P])
    algebraic_bound = condensed_algebraic_bound(dual_operator, mu, gap, delta, 1.0)
    q = 0.5 * 2
    minimum = root(P + q * delta, q + delta) + delta
    assert minimum <= algebraic_bound
    if max(P, delta) < 1:  # small beside q: then it is hardly less
        assert algebraic_bound - q <= 1.01 * (minimum - q) + 1e-8


SINGULAR = {
    "large c": (Form(c=1e6), 1 / 4),
    "large k": (Form(k=1e4, c=100.0), 1 / 4),
    "clamped": (Form(c=0.0, clamped=(1, 3), free=(2,), friedrichs=1.0), 1 / 32),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_where_S_is_singular_u_is_raised_by_a_function_with_its_own_norm(name: str) -> None:
    """u = 0 is below g, a constant or, between clamped sides, two bumps of the height 1. One edge is a cell.

    Control: with 1 for that function, as if it were in V and had the norm |Omega|^(1/2).
    """
    form, h = SINGULAR[name]
    spaces = mixed_spaces(
        condense(make_structured_mesh(square(), h), form), make_uniform_partition(square(), h)
    )
    operator = spaces.operator
    x = (np.arange(len(spaces.cells)) + 0.5) * h
    offset = -16 * x * (1 - x) * (2 * x - 1) ** 2 if form.clamped else -np.ones(len(x))
    assert operator.is_singular
    nothing = np.zeros(len(x))
    # relative to the norms, because where S is singular lambda_H has parts that only rounding decides
    exact_multiplier = solve_by_active_set(operator, offset, 1e-3 * operator.shift_norm).lambda_H
    error = float(np.linalg.norm(operator.D_factor @ exact_multiplier))
    gap = residual_rounding.Rounded(offset, nothing)
    bounds = [
        energy_bound(operator, offset, nothing),
        condensed_algebraic_bound(operator, nothing, gap, 0.0, 1.0),
    ]
    assert all(error <= bound < math.inf for bound in bounds)
    constant = replace(operator, shift_norm=1.0, shift_means=1.0)
    assert energy_bound(constant, offset, nothing) < 0.9 * error
    assert condensed_algebraic_bound(constant, nothing, gap, 0.0, 1.0) < 0.9 * error


def test_u_is_raised_by_what_rounding_may_hide() -> None:
    """Two cells with a singular S, on one of which u - g is 0 up to 1/4; the norm of w is 2."""
    dual_operator = DualOperator(np.array([[1.0, 1.0]]), np.ones(2), shift_norm=2.0)
    gap = residual_rounding.Rounded(np.array([0.0, 0.5]), np.array([0.25, 0.0]))
    assert condensed_algebraic_bound(dual_operator, np.zeros(2), gap, 0.0, 1.0) == pytest.approx(
        0.5, rel=1e-8
    )


def test_what_cannot_be_raised_has_no_bound() -> None:
    """Both nodes of the one cell are fixed: the mean of u is that of the given values, whatever mu is."""
    dual_operator = DualOperator(np.array([[0.0]]), np.ones(1), shift_norm=1.0, shift_means=np.zeros(1))
    nothing = np.zeros(1)
    for gap, bound in ((-1.0, math.inf), (1.0, 0.0)):
        rounded = residual_rounding.Rounded(np.array([gap]), nothing)
        assert condensed_algebraic_bound(dual_operator, nothing, rounded, 0.0, 1.0) == bound
        assert energy_bound(dual_operator, np.array([gap]), nothing) == bound


def test_the_least_eigenvalue_is_bounded_from_below() -> None:
    """Against 60 digits, for eigenvalues down to 1e-12 of the largest; control: those found are too large."""
    above = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        q = np.linalg.qr(rng.standard_normal((12, 12)))[0]
        r = np.linalg.qr(rng.standard_normal((12, 12)))[0]
        dual_operator = DualOperator(q @ np.diag(10.0 ** np.linspace(0, -6, 12)) @ r, np.ones(12), 1.0)
        half = exact(dual_operator.D_factor)
        eigenvalues = acb_mat((half.T @ half).tolist()).eig()
        true = min((eigenvalue.real for eigenvalue in eigenvalues), key=lambda item: item.mid())
        assert dual_operator.lambda_min_lower <= float(true.lower())
        above.append(dual_operator.lambda_min > float(true.upper()))
    assert any(above)
