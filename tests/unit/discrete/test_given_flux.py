"""Given fluxes, from the problem to the certificate: known solutions, rates, all solvers, and controls."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
import sentences
from known_solutions import fluxes, h1_errors
from symbolic import X, Y, compile_numpy, symbolic

import unilateral as ul
from unilateral.adaptive.level import contradict
from unilateral.bounds import enclosed_data
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.discrete import multilevel
from unilateral.fem.p1 import energy_norm
from unilateral.formulas.formula import parse_formula
from unilateral.geometry.adapted import start_adapted_mesh

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
LSHAPE = [(-1, -1), (0, -1), (0, 0), (1, 0), (1, 1), (-1, 1)]
KITE = [(0, 0), (1.125, -0.25), (1.5, 1.25), (0.25, 0.75)]


@dataclass(frozen=True)
class Known:
    """u on a polygon, of which some sides are held up by g = u - gap; du/dn is given on all others."""

    polygon: list
    u: str
    gaps: dict
    k: int = 1
    c: int = 1

    @cached_property
    def formula(self):
        return symbolic(parse_formula(self.u, ("x", "y"), "u"))

    @cached_property
    def fluxes(self):
        """k du/dn on all sides, exact."""
        return [self.k * u for u in fluxes(self.formula, self.polygon)]

    @cached_property
    def problem(self):
        u = self.formula
        f = -self.k * (u.diff(X, 2) + u.diff(Y, 2)) + self.c * u
        sides = range(len(self.polygon))
        g = [f"{self.u} - ({self.gaps[i]})" if i in self.gaps else None for i in sides]
        q = [None if i in self.gaps else str(self.fluxes[i]) for i in sides]
        free = [i for i in sides if i not in self.gaps]
        return ul.Problem(self.polygon, str(f), g, free, k=self.k, c=self.c, q=q)

    def error(self, computed):
        """(k |u - u_h|_1^2 + c ||u - u_h||_0^2)^(1/2)."""
        return h1_errors(self.formula, computed.mesh, [computed.u], k=self.k, c=self.c)[0]

    def force(self, side):
        """The integral of k du/dn over a side, by Gauss's rule of 20 points."""
        t, w = np.polynomial.legendre.leggauss(20)
        start = np.array(self.polygon[side % len(self.polygon)], dtype=float)
        end = np.array(self.polygon[(side + 1) % len(self.polygon)], dtype=float)
        x, y = (start + 0.5 * (t[:, None] + 1) * (end - start)).T
        flux = compile_numpy([self.fluxes[side]], (X, Y))(x, y)[0]
        return 0.5 * np.hypot(*(end - start)) * (w @ flux)


PROBLEMS = {
    "into the domain": Known(SQUARE, "cosh(x - 0.4) + cosh(y - 0.4)", {0: "0", 3: "0"}),
    "of both signs, beside contact": Known(SQUARE, "y**2 - y + sin(2*x)", {0: "0"}),
    "out of the domain": Known(SQUARE, "-3*x*y + y*exp(-x) - y", {0: "0"}),
    "no contact": Known(SQUARE, "1 - x**2/2 - (y - 1)**2*y*x**2", {3: "x + 1"}),
    "a kite": Known(KITE, "exp(x)*cos(y) - 2*y", {0: "0"}),
    "beside a re-entrant corner": Known(LSHAPE, "x**2 + y**2 + x*y/3", {0: "0", 4: "0", 5: "0"}),
    "with k and c": Known(SQUARE, "x**2 + exp(y) - 2*y", {0: "0", 2: "0", 1: "0"}, k=4, c=9),
}
"""lambda > 0 where the gap is 0: by inspection, and tested below."""


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_solutions_solve_their_problems(name):
    """lambda >= 0, gap >= 0, one of both 0, in points of the sides that are held."""
    problem = PROBLEMS[name]
    t = np.linspace(0, 1, 101)[:, None]
    for side, gap in problem.gaps.items():
        start = np.array(problem.polygon[side % len(problem.polygon)], dtype=float)
        end = np.array(problem.polygon[(side + 1) % len(problem.polygon)], dtype=float)
        x, y = (start + t * (end - start)).T
        flux, apart = compile_numpy(
            [problem.fluxes[side], symbolic(parse_formula(gap, ("x", "y"), "gap"))], (X, Y)
        )(x, y)
        assert np.all((flux >= -1e-14) & (apart >= 0))
        assert np.all((np.abs(flux) <= 1e-14) | (apart == 0))


def imbalance(computed):
    """|c int u_h - int f - int q - int lambda_H|, which is 0 by (2.1) with v = 1."""
    solved = computed.solved
    load = enclose_data(computed.problem, solved.mesh, solved.form).load
    return abs(solved.form.c * solved.u_integral - load.sum() - solved.force)


@pytest.mark.parametrize("name", PROBLEMS)
def test_errors_fall_as_proved_below_both_bounds(name):
    """Rate 1 for u in H2 (Th. 4.1), less 0.1 on coarse meshes; the cheap bound is at most twice the error.

    So is the sharp bound of lambda against the cheap one, which is of lower order. Forces lie between the
    numbers that are guaranteed, exact ones by quadrature.
    """
    problem = PROBLEMS[name]
    errors = []
    for n in (8, 16, 32):
        solution = ul.solve(problem.problem, h=1 / n, H=2 / n)
        errors.append(problem.error(solution))
        assert errors[-1] <= solution.sharp_bounds.u
        assert errors[-1] <= solution.bounds.u <= 2 * errors[-1]
        assert imbalance(solution) <= 1e-10
        for side, force in enumerate(solution.forces(sharp=True).sides):
            assert force.lower <= (problem.force(side) if side in problem.gaps else 0.0) + 1e-12
            assert force.upper >= (problem.force(side) if side in problem.gaps else 0.0) - 1e-12
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) >= 0.9)
    assert solution.sharp_bounds.multiplier <= solution.bounds.multiplier / 2


def test_without_the_flux_in_the_load_the_error_stays(monkeypatch):
    """Control of the rates: u_h does not converge. The bound, which has the flux from the data, says so."""
    problem = PROBLEMS["of both signs, beside contact"]
    monkeypatch.setattr(enclosed_data, "edge_load", lambda mesh, _: np.zeros(mesh.n_nodes))
    errors = []
    for n in (8, 16):
        solution = ul.solve(problem.problem, h=1 / n, H=2 / n)
        errors.append(problem.error(solution))
        assert errors[-1] <= solution.bounds.u
    assert errors[1] > 0.9 * errors[0] > 0.1


WAVE = Known(SQUARE, "cos(16*pi*x)*exp(-16*pi*y)/(16*pi)", {1: "1", 2: "1", 3: "1"})
"""The flux is a wave on side 0, and 0 on the sides beside; through side 2 it is exp(-16 pi)."""


def test_a_wave_that_edges_do_not_see_is_in_the_bounds(monkeypatch):
    """With edges of 1/4 the linear part of the flux is 0 but for rounding, and so is u_h.

    Its error is the norm of u. Control: without what is left of the flux both bounds are far below it.
    """
    solution = ul.solve(WAVE.problem, h=1 / 4, H=1 / 2)
    error = WAVE.error(solution)
    assert np.abs(solution.u).max() < 1e-3 * error
    assert error <= solution.sharp_bounds.u
    assert error <= solution.bounds.u

    def linear(flux, mesh):
        return no_given_flux(mesh)._replace(end_values=right(flux, mesh).end_values)

    right = enclosed_data.project_given_flux
    monkeypatch.setattr(enclosed_data, "project_given_flux", linear)
    solution = ul.solve(WAVE.problem, h=1 / 4, H=1 / 2)
    assert solution.bounds.u < 0.7 * error
    assert solution.sharp_bounds.u < 0.7 * error


@pytest.mark.parametrize(
    "q", ["-4*pos(x - 1/3, 0)", "9*pos(x - 1/2, 0)", "30*exp(-40000*(x - 0.3)**2)", "-9*pos(x - 0.3, 1/2)"]
)
def test_bounds_hold_where_the_flux_is_not_smooth(q):
    """No solution is known: the distance from one on a mesh of 1/64 is at most the sum of both bounds.

    And the bound on that of 1/8 is at most three times the distance: a third of it would be too small.
    """
    problem = ul.Problem(SQUARE, f="1 - 3*x", g=[None, -0.1, -0.1, -0.1], free_sides=[0], q=q)
    coarse = ul.solve(problem, h=1 / 8, H=2 * (1 / 8), mesh="structured")
    fine = ul.solve(problem, h=1 / 64, H=2 * (1 / 64), mesh="structured")
    distance = energy_norm(fine.mesh, fine.u - coarse.u_at(fine.mesh.points))
    for kind in ("bounds", "sharp_bounds"):
        coarse_bound = getattr(coarse, kind).u
        fine_bound = getattr(fine, kind).u
        assert distance <= coarse_bound + fine_bound
        assert fine_bound < coarse_bound <= 3 * distance


def test_an_accuracy_is_reached_on_adapted_meshes():
    """A peak of du/dn of width 0.02 on a side: five times as many nodes as alike are near it."""
    known_solution = Known(
        SQUARE,
        "exp(-1600*((x - 0.3)**2 + (y + 0.01)**2)) + 2*(x - 1/2)**2 + 2*(y - 1/2)**2",
        {1: "0", 2: "0", 3: "0"},
    )
    solution = ul.solve(known_solution.problem, accuracy=0.1)
    assert solution.certified
    assert known_solution.error(solution) <= solution.bounds.u
    near = np.hypot(solution.mesh.points[:, 0] - 0.3, solution.mesh.points[:, 1]) < 0.15
    assert near.mean() > 5 * np.pi * 0.15**2 / 2
    assert all(not contradict(a, b) for a in solution.search.levels for b in solution.search.levels)


def test_a_jump_of_the_flux_is_refined_for():
    """Edges at the jump, x = 1/3, have at most a quarter of the longest there; no levels contradict."""
    problem = ul.Problem(SQUARE, f=0, g=-0.1, free_sides=[0], q="-4*pos(x - 1/3, 0)")
    solution = ul.solve(problem, accuracy=0.05)
    assert solution.certified
    lengths = np.diff(solution.mesh.s)
    node = np.searchsorted(solution.mesh.s, 1 / 3) - 1
    assert lengths[node] <= lengths[solution.mesh.side == 0].max() / 4
    assert all(not contradict(a, b) for a in solution.search.levels for b in solution.search.levels)


FIELDS = {"f": "x - y - 1", "g": [None, "-y/10", "-1/10", "-y/10"], "free_sides": [0]}
FLUX = "sin(5*x) - 2*pos(x - 1/3, 0)"


def solutions(problem):
    """By elimination, by multigrid and on an adapted mesh that is not adapted yet: one discrete problem."""
    mesh = ul.solve(problem, h=1 / 16, H=1 / 8, mesh="unstructured", stop=ul.Stop(algorithm="multigrid")).mesh
    exactly = {"tolerance": 1e-11}
    for name in ("multigrid", "active_set", "uzawa"):
        yield ul.solve(problem, mesh=mesh, H=1 / 8, stop=ul.Stop(algorithm=name, **exactly)).solved
    yield multilevel.discretise_on_adapted_mesh(problem, start_adapted_mesh(mesh)).solve(ul.Stop(**exactly))


def test_all_solvers_have_the_flux():
    """Control: a solver without it finds another solution."""
    problem = ul.Problem(SQUARE, **FIELDS, q=FLUX)
    first, *alternatives = solutions(problem)
    assert first.result.algorithm == "multigrid"
    for alternative in alternatives:
        np.testing.assert_allclose(alternative.u_h, first.u_h, rtol=0, atol=1e-8)
    without = next(solutions(ul.Problem(SQUARE, **FIELDS)))
    assert np.abs(without.u_h - first.u_h).max() > 0.1


def test_functions_give_the_same_solution():
    """A linear flux, which its values at nodes are. With k and c they are scaled alike."""
    for units in ({}, {"k": 4, "c": 9}):
        formula = ul.Problem(SQUARE, **FIELDS, q="1 - 3*x", **units)
        function = ul.Problem(SQUARE, **FIELDS, q=lambda x, y: 1 - 3 * x, **units)
        per_side = ul.Problem(SQUARE, **FIELDS, q=[lambda x, y: 1 - 3 * x, None, None, None], **units)
        sizes = {"h": 1 / 16, "H": 1 / 8, "stop": ul.Stop(tolerance=1e-12)}
        exact = ul.solve(formula, **sizes)
        for problem in (function, per_side):
            solution = ul.solve(problem, **sizes)
            assert solution.u == pytest.approx(exact.u, abs=1e-10)
            assert solution.bounds.u == pytest.approx(exact.bounds.u, rel=1e-6)
            assert imbalance(solution) < 1e-10


@pytest.mark.parametrize(
    "q",
    [
        [None, lambda x, y: x, None, None],
        [lambda x, y: x],
        lambda x, y: np.where(x > 0.5, np.nan, 1.0),
    ],
)
def test_functions_are_refused_likewise(q):
    with sentences.raises(ul.InputError):
        ul.solve(ul.Problem(SQUARE, **FIELDS, q=q), h=1 / 4, H=1 / 2)


def test_no_flux_is_a_flux_of_0():
    """Bit for bit."""
    for problem in (FIELDS, {**FIELDS, "k": 2, "c": 3}):
        first = ul.solve(ul.Problem(SQUARE, **problem), h=1 / 8, H=1 / 4)
        alternatives = [
            ul.solve(ul.Problem(SQUARE, **problem, q=q), h=1 / 8, H=1 / 4) for q in (0, [0, None, None, None])
        ]
        for alternative in alternatives:
            assert np.array_equal(alternative.u, first.u)
            assert alternative.bounds == first.bounds
            assert alternative.sharp_bounds == first.sharp_bounds
