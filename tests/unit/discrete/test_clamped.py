"""Problems with clamped sides: true errors of manufactured ones are below the bounds, on every path."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import scipy.sparse.linalg as spla
import sentences
import sympy
from symbolic import X, Y, compile_numpy, plain, pos

import unilateral as ul
from unilateral.adaptive.level import contradict
from unilateral.bounds import feasible, local_bounds
from unilateral.bounds.clamped_ends import find_conflicts, no_reactions
from unilateral.bounds.constraint import build_constraint
from unilateral.bounds.flux_residuals import misfit
from unilateral.discrete import problem_data
from unilateral.errors import InputError
from unilateral.fem.form import Form, decouple_nodes
from unilateral.fem.p1 import gradients, stiffness_and_mass
from unilateral.fem.quadrature import symmetric_rule
from unilateral.formulas.expression import ZERO
from unilateral.geometry.mesh import make_unstructured_mesh, refine_uniformly
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import laplacian

POLYGONS = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "lshape": [(-1, -1), (0, -1), (0, 0), (1, 0), (1, 1), (-1, 1)],
    "triangle": [(0, 0), (1, 0), (0.25, 0.75)],
    "trapezoid": [(0, 0), (1.5, 0), (1, 0.75), (0.25, 0.75)],
}
COEFFICIENTS = [(1, 0), (1, 1), ("7/3", 0), ("7/3", "1/1000"), (1_000_000, 0), ("1/1000000", 0)]
EXTREME = [(1_000_000, 1_000_000), ("1/1000000", 1), (1, 1_000_000), (1_000_000, "1/1000000")]
PATHS = ("condensed", "nested", "adapted", "foreign", "unstructured")
TIMES = int(os.environ.get("UNILATERAL_FUZZ", "0")) // 6 or 1
"""`make fuzz` sets how many times the problems are tried."""


def wide_coefficients(seed: int) -> tuple[int, str, str]:
    """A seed, k from 1e-12 to 1e12, and c = 0 or in the same range."""
    rng = np.random.default_rng([48, seed])
    k_power, c_power = rng.integers(-12, 13, 2)
    k = f"1e{k_power}"
    c = f"1e{c_power}"
    return seed, k, c if rng.random() < 0.9 else "0"


WIDE = [wide_coefficients(seed) for seed in range(20 * TIMES)]
OF_RANDOM = [(seed, *pair) for seed, pair in enumerate((COEFFICIENTS * 8 + EXTREME * 5) * TIMES)]


class Manufactured(NamedTuple):
    """A problem, its coefficients, and its exact u, u_x and u_y as one function of x and y."""

    problem: object
    exact: Callable
    k: float
    c: float
    contact: list[int]


@cache
def random_problem(seed: int, k: object, c: object) -> Manufactured:
    """A u with a transition on side 0 or without; sides are clamped, free, or in contact where du/dn > 0."""
    rng = np.random.default_rng(seed)
    corners = POLYGONS[sorted(POLYGONS)[seed % 4]]
    n = len(corners)
    k = sympy.Rational(k)
    c = sympy.Rational(c)
    a = [sympy.Rational(int(index), 4) for index in rng.integers(-6, 7, 6)]
    (x0, y0), (x1, _) = corners[:2]
    end = sympy.Rational(x0) + sympy.Rational(x1 - x0) * sympy.Rational(int(rng.integers(1, 8)), 8)
    u = -(Y - y0) * pos(X - end, 2) * (1 + a[0] ** 2) + a[1] * X**2 + a[2] * (Y - y0) ** 2 * X
    u += sympy.cos(X + a[3]) + a[4] * (Y - y0) ** 2
    slopes = sympy.diff(u, X), sympy.diff(u, Y)
    exact = compile_numpy([u, *slopes], (X, Y))
    gaps = [None] * n
    u_there = {}
    fluxes = [None] * n
    contact = [0]
    gaps[0] = str(u - pos(end - X, 2) / 2)
    for side in range(1, n):
        (ax, ay) = [sympy.Rational(z) for z in corners[side % n]]
        (bx, b_y) = [sympy.Rational(z) for z in corners[(side + 1) % n]]
        dx = sympy.Rational(1) * (bx - ax)
        dy = sympy.Rational(1) * (b_y - ay)
        flux = (slopes[0] * dy - slopes[1] * dx) / sympy.sqrt(dx**2 + dy**2)
        t = np.linspace(0, 1, 401)
        _, u_x, u_y = exact(float(ax) + t * float(dx), float(ay) + t * float(dy))
        values = (u_x * float(dy) - u_y * float(dx)) / math.hypot(dx, dy)
        slanted = dx != 0 and dy != 0
        if rng.random() < 0.4 or side == n - 1 or slanted:
            u_there[side] = str(u)
        elif values.min() > 1e-9 and side not in (1, n - 1):
            gaps[side] = str(u)
            contact.append(side)
        else:
            fluxes[side] = str(k * flux)
    free = [side for side in range(n) if fluxes[side] is not None]
    f = plain(c) * plain(u) - plain(k) * laplacian(plain(u), "x", "y")
    problem = ul.Problem(
        corners, str(f), gaps, free, k=str(k), c=str(c), q=fluxes if free else None, u=u_there
    )
    return Manufactured(problem, exact, float(k), float(c), contact)


def solve_by_path(manufactured: Manufactured, path: str):
    h = 1 / 8
    if path == "nested":
        return ul.solve(manufactured.problem, h=h, H=2 * h, stop=ul.Stop(algorithm="multigrid"))
    if path == "adapted":
        return ul.solve(manufactured.problem, accuracy=0.1, max_unknowns=2000)
    if path == "foreign":
        polygon = Polygon(manufactured.problem.polygon.vertices, "own")
        original = make_unstructured_mesh(polygon, 2 * h)
        return ul.solve(
            manufactured.problem, H=2 * h, mesh=ul.mesh(original.points, original.triangles, halvings=1)
        )
    return ul.solve(manufactured.problem, h=h, H=2 * h, mesh=path if path == "unstructured" else "")


def error(manufactured: Manufactured, s) -> float:
    """(k |u - u_h|_1^2 + c ||u - u_h||_0^2)^(1/2), by a rule of degree 8."""
    mesh = s.mesh
    (hats, weights) = symmetric_rule(8)
    x, y = np.moveaxis(np.einsum("qb,tbd->tqd", hats, mesh.points[mesh.triangles]), -1, 0)
    slope = np.einsum("tid,ti->dt", gradients(mesh), s.u[mesh.triangles])[..., None]
    u, u_x, u_y = manufactured.exact(x, y)
    squares = manufactured.c * (u - s.u[mesh.triangles] @ hats.T) ** 2
    squares += manufactured.k * ((u_x - slope[0]) ** 2 + (u_y - slope[1]) ** 2)
    return math.sqrt(float(mesh.areas @ (squares @ weights)))


def dual_error(manufactured: Manufactured, s) -> float:
    """A lower bound on the dual norm of lambda - lambda_H: the supremum over P1 on the mesh, refined once."""
    mesh = refine_uniformly(s.mesh)
    clamped = s.problem.clamped_sides
    K, M = stiffness_and_mass(mesh)
    fixed = Form(c=0.0, clamped=clamped).clamped_nodes(mesh)
    load = np.zeros(mesh.n_nodes)
    x, w = np.polynomial.legendre.leggauss(6)
    x = 0.5 * (x + 1)
    w = 0.5 * w
    lengths = np.diff(mesh.s)
    for edge in np.flatnonzero(np.isin(mesh.side, manufactured.contact)):
        side = mesh.side[edge]
        ends = mesh.boundary[[edge, (edge + 1) % len(mesh.boundary)]]
        places = mesh.points[ends[0]] + x[:, None] * (mesh.points[ends[1]] - mesh.points[ends[0]])
        normal = mesh.polygon.normals[side]
        _, u_x, u_y = manufactured.exact(*places.T)
        flux = manufactured.k * (u_x * normal[0] + u_y * normal[1])
        t = mesh.s[edge] - mesh.polygon.starts[side] + x * lengths[edge]
        weighted = lengths[edge] * w * (flux - s.lambda_at(side, t))
        load[ends] += [weighted @ (1 - x), weighted @ x]
    load[fixed] = 0.0
    v = spla.spsolve(decouple_nodes((manufactured.k * K + manufactured.c * M).tocsr(), fixed).tocsc(), load)
    return math.sqrt(max(float(v @ load), 0.0))


@pytest.mark.parametrize(("seed", "k", "c"), OF_RANDOM)
def test_bounds_are_above_the_true_errors(seed: int, k: object, c: object) -> None:
    """u is in H^2. Each path has its turn with each pair of coefficients."""
    problem = random_problem(seed, k, c)
    s = solve_by_path(problem, PATHS[seed % len(PATHS)])
    u_error = error(problem, s)
    lambda_error = dual_error(problem, s)
    for bounds in (s.bounds, s.sharp_bounds):
        assert u_error <= bounds.u
        assert lambda_error <= bounds.multiplier


@pytest.mark.parametrize(("seed", "k", "c"), WIDE)
def test_bounds_do_not_mind_coefficients(seed: int, k: str, c: str) -> None:
    """They are above the errors, for c/k from 0 to 1e24, and at most 10 and 5 times that of u.

    These limits were set before any of these problems was solved. Before the flux and the norm of its
    residual knew c/k, the quotient for a smooth u was like h (c/k)^(1/2).
    """
    problem = random_problem(seed, k, c)
    s = solve_by_path(problem, PATHS[seed % len(PATHS)])
    u_error = error(problem, s)
    lambda_error = dual_error(problem, s)
    assert u_error <= s.bounds.u <= 10 * u_error
    assert u_error <= s.sharp_bounds.u <= 5 * u_error
    assert lambda_error <= min(s.bounds.multiplier, s.sharp_bounds.multiplier)


@pytest.fixture(scope="module")
def solution_without_reaction() -> ul.Solution:
    """The adapted solution of a problem with c = 0, beside which tiny reactions are put."""
    return solve_by_path(random_problem(67, 1_000_000, 0), "adapted")


@pytest.mark.parametrize("c", [f"1/{10**n}" for n in (3, 6, 9, 24)])
def test_a_tiny_reaction_costs_no_accuracy(c, solution_without_reaction) -> None:
    """c u is next to nothing beside f. One per cent is room for what the terms with c add."""
    s = solve_by_path(random_problem(67, 1_000_000, c), "adapted")
    assert s.search.certified
    assert len(s.u) == len(solution_without_reaction.u)
    assert s.bounds.u == pytest.approx(solution_without_reaction.bounds.u, rel=0.01)


@pytest.mark.parametrize(("clamped", "report"), [((), True), ((3,), False)])
def test_levels_beside_clamped_sides_are_compared_by_norms_alone(clamped, report) -> None:
    """Integrals that are apart say nothing of u - u_h that does not vanish there. Norms do: the control."""

    def level(u_norm: float, u_integral: float) -> SimpleNamespace:
        expected = {"u_norm": u_norm, "u_integral": u_integral, "force": 0.0}
        partition = SimpleNamespace(polygon=SimpleNamespace(area=1.0))
        mesh = SimpleNamespace(exact_mesh_factor=1.0)
        solved = SimpleNamespace(form=Form(clamped=clamped), mesh=mesh, **expected)
        bound = SimpleNamespace(u=0.1, lambda_=0.1)
        return SimpleNamespace(solved=solved, partition=partition, bound=bound, force=None)

    assert contradict(level(1.0, 0.0), level(1.0, 1.0)) == report
    assert contradict(level(1.0, 0.0), level(2.0, 0.0))
    assert not contradict(level(1.0, 0.0), level(1.1, 0.1))


def test_a_mesh_without_a_node_in_contact_is_refused() -> None:
    """Side 2 is one edge between two clamped sides."""
    g = ["-1" if side == 2 else None for side in range(6)]
    problem = ul.Problem(POLYGONS["lshape"], -1, g, [0, 4, 5], u={1: 0, 3: 0})
    with sentences.raises(ul.InputError):
        ul.solve(problem, h=1, H=1)
    assert ul.solve(problem, h=1 / 2, H=1).solved.result.converged


def test_most_bounds_are_near_the_errors() -> None:
    """The median of the cheap bound over the error is below 1.3 on meshes that resolve u."""
    indices = []
    for seed, (k, c) in enumerate(COEFFICIENTS * 2):
        problem = random_problem(seed, k, c)
        s = ul.solve(problem.problem, h=1 / 16, H=1 / 8)
        indices.append(s.bounds.u / error(problem, s))
    assert statistics.median(indices) < 1.3


WAVE = "sin(8*pi*x)"


def make_unseen_problem(c: object) -> object:
    """A problem whose u_D is 0 at the nodes of a mesh with h = 1/4: u_h = 0."""
    return ul.Problem(POLYGONS["square"], 0, [-2, -2, None, -2], u={2: WAVE}, c=c)


@pytest.mark.parametrize("c", [0, 1])
def test_what_nodes_do_not_see_of_u_on_a_clamped_side_is_in_the_bounds(c, monkeypatch) -> None:
    """u is about sin(8 pi x) exp(8 pi (y - 1)), whose squared norm is 4 pi. Control: without the lifting."""
    s = ul.solve(make_unseen_problem(c), h=1 / 4, H=1 / 2)
    assert np.abs(s.u).max() < 1e-12
    for bounds in (s.bounds, s.sharp_bounds):
        assert math.sqrt(4 * math.pi) * 0.999 < bounds.u < 3 * math.sqrt(4 * math.pi)
    short = feasible._edge_shortfalls

    def drop_clamped_shortfall(g, form, v, touching, flux):
        squares, *remaining = short(g, form, v, touching, flux)
        return np.where(g.clamped_edges, 0.0, squares), *remaining

    monkeypatch.setattr(feasible, "_edge_shortfalls", drop_clamped_shortfall)
    s = ul.solve(make_unseen_problem(c), h=1 / 4, H=1 / 2)
    assert s.bounds.u < math.sqrt(4 * math.pi)


def test_a_kink_beside_which_places_are_rounded_counts() -> None:
    """Where pieces meet u_D' jumps by 1e6; within units in the last place either may be meant.

    Control: without that.
    """
    corners = [(0.1, 0.1), (1.1, 0.1), (1.1, 0.8), (0.1, 0.8)]
    problem = ul.Problem(corners, 0, [None, -1e9, None, None], [0, 2], u={3: "1e6*pos(y - 1/2, 1)"}, c=0)
    kinked = problem.enclosed_obstacle
    mesh = make_unstructured_mesh(problem.polygon, 1 / 8)
    expected = replace(kinked, slope_remainder=np.zeros_like(kinked.slope_remainder))

    def norm(functional) -> float:
        return build_constraint(
            functional, mesh, Form(c=0.0, clamped=(3,), free=(0, 1, 2))
        ).slope_remainder.max()

    minimum = 1e6 * math.sqrt(2 * 8 * np.spacing(problem.polygon.perimeter))
    assert minimum <= norm(expected) <= norm(kinked)
    assert norm(replace(expected, end_slope_remainder=expected.slope_remainder)) < 0.1 * minimum


@pytest.mark.parametrize(("c", "square"), [(0, 1 / 3), (1, 1 - math.tanh(1))])
@pytest.mark.parametrize("share", [1.0, 0.01])
def test_divergence_counts_by_friedrichs_constant(c, square, share, monkeypatch) -> None:
    """u_h = 0 is no solution: ||u||^2 is the `square`. Control: with a hundredth of the constant.

    u = x(2 - x)/2, or 1 - cosh(1 - x)/cosh(1), and ||u||^2 is its integral.
    """
    problem = ul.Problem(POLYGONS["square"], 1, -1, [0, 1, 2], c=c, u={3: 0})
    solved = ul.solve(problem, h=1 / 4, H=1 / 2).solved
    form = solved.form
    weaker = form._replace(friedrichs=share * form.friedrichs)
    monkeypatch.setattr(
        local_bounds, "equilibrate_flux", lambda mesh, *_: np.zeros((2, len(mesh.triangulation.ends)))
    )
    bound = replace(solved, form=weaker, u_h=np.zeros_like(solved.u_h)).local_bound.u
    assert (bound >= math.sqrt(square)) == (share == 1.0)


@pytest.mark.parametrize("c", [0, 1e-30, 1])
def test_with_a_reaction_friedrichs_constant_may_be_unknown(c, monkeypatch) -> None:
    """u = x(2 - x)/2 for c = 0, and nearly so for the tiny c. Control: c = 0 needs the constant."""

    def hide(mesh, clamped):
        raise InputError("rounding hides it")

    problem = ul.Problem(POLYGONS["square"], 1, -1, [0, 1, 2], c=c, u={3: 0})
    monkeypatch.setattr(problem_data, "friedrichs_constant", hide)
    if c == 0:
        with pytest.raises(InputError, match="rounding hides it"):
            ul.solve(problem, h=1 / 4, H=1 / 2)
    else:
        assert math.isfinite(ul.solve(problem, h=1 / 4, H=1 / 2).bounds.u)


def exact_reactions() -> tuple[object, dict[int, float]]:
    """u = x^2 + y: clamped at x = 0, in contact at x = 1 with lambda = 2, given fluxes -1 and 1."""
    problem = ul.Problem(
        POLYGONS["square"], -2, [None, "1 + y", None, None], [0, 2], c=0, u={3: "y"}, q=[-1, None, 1, None]
    )
    return problem, {1: 2.0, 3: 0.0}


@pytest.mark.parametrize("sharp", [False, True])
def test_forces_and_reactions_lie_in_their_intervals(sharp) -> None:
    problem, exact = exact_reactions()
    s = ul.solve(problem, h=1 / 16, H=1 / 8)
    forces = s.forces(sharp)
    for force, true in (
        (forces.sides[1], exact[1]),
        (forces.reactions[3,], exact[3]),
        (forces.whole, exact[1]),
    ):
        assert force.lower <= true <= force.upper
        assert force.upper - force.lower < 0.2
    pair = s.force(sharp, sides=[1, 3])
    assert pair.lower <= 2.0 <= pair.upper


def test_forces_and_reactions_of_a_function_are_those_of_its_formula() -> None:
    """f and u are linear, and so the functions between nodes."""
    side_data = {"free_sides": [0, 2], "c": 0, "u": {3: "y"}, "q": [-1, None, 1, None]}
    pair = [
        ul.Problem(POLYGONS["square"], f, [None, "1 + y", None, None], **side_data)
        for f in (-2, lambda x, y: 0 * x - 2)
    ]
    expected, computed = [
        ul.solve(problem, h=1 / 8, H=1 / 4, stop=ul.Stop(tolerance=1e-10)).forces() for problem in pair
    ]
    assert computed.whole.value == pytest.approx(expected.whole.value, abs=1e-8)
    np.testing.assert_allclose(computed.whole, expected.whole, rtol=0, atol=1e-7)
    np.testing.assert_allclose(computed.reactions[3,], expected.reactions[3,], rtol=0, atol=1e-7)


def test_reactions_without_the_flux_through_the_side_are_noticed(monkeypatch) -> None:
    """Control: u = x(1 - x/2) has the reaction -1 at x = 0."""
    problem = ul.Problem(POLYGONS["square"], 1, [None, -1, None, None], [0, 2], c=0, u={3: 0})
    s = ul.solve(problem, h=1 / 16, H=1 / 8)
    assert s.forces().reactions[3,].lower <= -1 <= s.forces().reactions[3,].upper
    monkeypatch.setattr(local_bounds, "outflows", lambda mesh, *_: np.zeros((2, mesh.polygon.n_sides)))
    again = ul.solve(problem, h=1 / 16, H=1 / 8)
    assert again.forces().reactions[3,].lower > -1


def test_where_flow_through_a_side_cancels_its_rounding_counts(monkeypatch) -> None:
    """As if 1e17 had flown in and out: units in its last place are 16. The width without it is < 1.

    g > 0, as below the least u that the data allow lambda is known to be 0.
    """
    problem = ul.Problem(POLYGONS["square"], 1, [None, 0.1, None, None], [0, 2], c=0, u={3: 0})
    known_outflows = local_bounds.outflows
    before = ul.solve(problem, h=1 / 16, H=1 / 8).forces().reactions[3,]
    assert before.upper - before.lower < 1
    extra = np.array([[0.0], [1e17]])
    monkeypatch.setattr(local_bounds, "outflows", lambda *arguments: known_outflows(*arguments) + extra)
    force = ul.solve(problem, h=1 / 16, H=1 / 8).forces().reactions[3,]
    assert min(force.value - force.lower, force.upper - force.value) > np.spacing(1e17)


def test_where_a_clamped_side_meets_contact_the_gap_says_whether_a_force_has_a_bound() -> None:
    """With u = g at the vertex none is possible for one side alone; the sum of force and reaction has one."""
    apart = ul.solve(
        ul.Problem(POLYGONS["square"], 0, [0, None, None, None], [1, 2], u={3: 1}, c=0), h=1 / 16, H=1 / 8
    )
    joined = ul.solve(
        ul.Problem(POLYGONS["square"], 0, ["1 - x", None, None, None], [1, 2], u={3: 1}, c=0),
        h=1 / 16,
        H=1 / 8,
    )
    assert apart.forces().sides[0].upper < 1
    assert joined.forces().sides[0].upper == math.inf
    assert joined.forces().reactions[3,].lower == -math.inf
    assert joined.force(sides=[0, 3]).upper < 1
    with sentences.raises(ul.InputError):
        ul.solve(unseen_row(), h=1 / 4, H=1 / 2).force(sides=[2])


def unseen_row() -> object:
    return ul.Problem(POLYGONS["square"], 0, [0, 0, None, None], u={2: 1, 3: 1}, c=0)


def test_a_membrane_clamped_at_one_side_rests_on_a_bump_at_the_other() -> None:
    """Held for tests: all paths agree within their guaranteed errors, and contact is where the bump is."""
    problem = ul.Problem(
        POLYGONS["square"], -1, [None, "-1/10 - (y - 1/2)**2", None, None], [0, 2], c=0, u={3: 0}
    )
    solution = ul.solve(problem, h=1 / 32, H=1 / 16)
    nested = ul.solve(problem, h=1 / 32, H=1 / 16, stop=ul.Stop(algorithm="multigrid"))
    adapted = ul.solve(problem, accuracy=0.02)
    assert adapted.certified
    for s in (nested, adapted):
        force = s.forces().sides[1]
        other_side = solution.forces().sides[1]
        assert force.lower <= other_side.upper
        assert other_side.lower <= force.upper
    (interval,) = solution.contact.intervals
    assert interval.side == 1
    assert interval.start + interval.end == pytest.approx(1, abs=1 / 8)
    assert np.abs(nested.u - solution.u).max() < 1e-4


@pytest.mark.parametrize(("c", "f"), [(0, "0"), (1, "x - 2*y + 1")])
@pytest.mark.parametrize("clamped", [[0, 1, 2, 3], [0, 1], [3]])
def test_a_linear_u_that_is_clamped_costs_nothing(c, f, clamped) -> None:
    """u = x - 2 y + 1 lies in V_h, and its gradient among the fluxes, whichever sides are clamped."""
    u = "x - 2*y + 1"
    fluxes = [2, 1, -2, -1]
    free = [side for side in range(4) if side not in clamped]
    problem = ul.Problem(
        POLYGONS["square"],
        f,
        [None] * 4,
        free,
        c=c,
        q=[fluxes[side] if side in free else None for side in range(4)] if free else None,
        u=dict.fromkeys(clamped, u),
    )
    for kind in ("structured", "unstructured"):
        s = ul.solve(problem, h=1 / 4, H=1 / 2, mesh=kind)
        assert np.abs(s.u - (s.mesh.points @ [1, -2] + 1)).max() < 1e-12
        assert s.sharp_bounds.u < 1e-9 + (c == 1)
        assert np.abs(misfit(s.mesh, s.u, s.solved.flux, slice(None))).max() < 1e-9


def test_matrices_have_the_equations_of_all_other_nodes() -> None:
    """In units with k = 7/3 and c = 0; D is B A^{-1} B^T on the nodes that are not clamped."""
    problem = ul.Problem(
        POLYGONS["square"], "x - 1", [None, "-1/9", None, None], [0, 2], k="7/3", c=0, u={3: "y*(1 - y)/3"}
    )
    solver = ul.Solver(problem, h=1 / 8, H=1 / 4, stop=ul.Stop(tolerance=1e-10))
    s = solver()
    matrices = solver.matrices()
    free = ~Form(c=0.0, clamped=(3,)).clamped_nodes(s.mesh)
    remaining = matrices.A @ s.u - matrices.B.T @ s.multiplier[matrices.cells] - matrices.F
    assert np.abs(remaining[free]).max() < 1e-9
    assert np.abs(remaining[~free]).max() > 1e-3
    B = matrices.B.toarray()[:, free]
    exact = B @ np.linalg.solve(matrices.A.toarray()[np.ix_(free, free)], B.T)
    assert np.allclose(matrices.D, exact, rtol=1e-10, atol=0)


def test_a_solver_of_a_case_with_other_data_keeps_its_clamped_sides() -> None:
    case = ul.case("clamped")
    s = ul.Solver(case, h=1 / 8, H=1 / 4)(f=0, g=-9)
    assert s.problem.clamped_sides == (2,)
    assert s.problem.c == ZERO
    x = s.mesh.points[np.isclose(s.mesh.points[:, 1], 1), 0]
    assert np.allclose(s.u_at(np.column_stack([x, np.ones_like(x)])), np.cos(np.pi * x) / 2, atol=1e-12)


def test_errors_name_the_norm_that_they_are_in() -> None:
    """|u - u_h|_1 where c = 0, as the bounds and the command line have it; control: c = 1."""
    without = ul.solve("clamped", h=1 / 8, H=1 / 4).true_errors(dual=False)
    with_c = ul.solve("natural", h=1 / 8, H=1 / 4).true_errors(dual=False)
    assert repr(without).startswith("Errors: |u - u_h|_1 = ")
    assert repr(with_c).startswith("Errors: ||u - u_h||_1 = ")


@pytest.mark.parametrize(
    ("component", "free", "computed"),
    [
        ([3], [], [(0, 0), (3, 0)]),
        ([0], [], [(0, 1)]),
        ([2], [], [(3, 1)]),
        ([2, 3], [], [(0, 0)]),
        ([2, 3], [0], []),
        ([3, 0, 2], [], []),
        ([1], [], []),
    ],
)
def test_one_bound_conflicts_where_a_part_ends_between_clamp_and_contact(component, free, computed) -> None:
    """On a square clamped at side 3; vertex 0 is where sides 3 and 0 meet.

    w = 1 on the part. If that is the clamp, w is too large beside it for the bound below; if it is the side
    with contact, w = 0 on the clamp is too small for the one above. Free sides have no force.
    """
    clamps = no_reactions(4)._replace(form=Form(c=0.0, clamped=(3,), free=tuple(free)))
    assert find_conflicts(np.array(component), clamps) == computed
