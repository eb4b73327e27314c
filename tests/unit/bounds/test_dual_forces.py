"""The interval of a force by duality: exact forces lie inside, its order in h, the search for an accuracy.

Exact forces are integrals of the cases' lambda by the boundary's quadrature, or those of a u in closed form.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hand_made import exact_forces

import unilateral as ul
from unilateral.bounds import dual_forces
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.dual_forces import enclose_force
from unilateral.bounds.flux_residuals import residual_parts
from unilateral.bounds.source import zero_source

SEAL = {
    "polygon": [[0, 0], [0.6, 0], [0.6, 0.4], [0, 0.4]],
    "k": 500,
    "c": 0,
    "f": "-50",
    "g": [0, None, None, None],
    "free_sides": [1, 2],
    "u": {3: 0.005},
}
"""A sheet that touches a part of side 0, with a clamped side beside it."""


def interval(solution, sides, **changes):
    """The interval of the force, for the cheap bound with other fields."""
    solved = solution.bounded
    bound = replace(solved.local_bound, **changes)
    return enclose_force(
        solved.data, solved.partition, solved.u_h, solved.lambda_H, solved.form, bound, sides
    )


def half_width(solution, sides):
    bounds = interval(solution, sides)
    return 0.5 * (bounds.upper - bounds.lower)


@pytest.mark.parametrize("n", [4, 16])
@pytest.mark.parametrize("name", ["smooth", "natural", "full_contact", "thirds", "vertex", "obtuse_0.75"])
def test_exact_forces_lie_inside(name, n):
    s = ul.solve(name, h=1 / n, H=2 / n)
    _, *exact = exact_forces(s.problem.exact, s.partition)
    n_sides = s.polygon.n_sides
    for sides in [[*range(n_sides)], [0], [1], [0, n_sides - 1]]:
        force = sum(exact[side] for side in sides)
        bounds = interval(s, sides)
        assert bounds.lower - 1e-12 <= force <= bounds.upper + 1e-12
        assert bounds.lower <= bounds.value <= bounds.upper


def test_a_bound_of_zero_on_the_error_is_noticed():
    """Control: without X S_w and M G the interval is the value, which is not exact."""
    s = ul.solve("natural", h=1 / 16, H=1 / 8)
    exact, *_ = exact_forces(s.problem.exact, s.partition)
    ends = s.bounded.local_bound.clamped_ends._replace(gamma_force_bound=0.0)
    bounds = interval(s, [0, 1, 2, 3], u=0.0, clamped_ends=ends)
    assert not bounds.lower <= exact <= bounds.upper


def problem_in_closed_form(c, u_D):
    """u = x^2 + u_D(y) on the unit square: du/dn = 2 on side 1 in contact, 0 on side 3, which is clamped.

    The flux is given on the sides between.
    """
    u = f"x**2 + {u_D}"
    curved = u_D != "0"
    slope = "3*cos(3*y)/5" if curved else "0"
    f = f"-2 + {'9*sin(3*y)/5' if curved else '0'} + {c}*({u})"
    flux = [f"-({slope})", None, slope, None]
    return ul.Problem(
        [[0, 0], [1, 0], [1, 1], [0, 1]], f, [None, u, None, None], [0, 2], c=c, q=flux, u={3: u}
    )


@pytest.mark.parametrize("c", ["0", "1"])
@pytest.mark.parametrize("u_D", ["0", "sin(3*y)/5"])
def test_reactions_and_forces_of_a_u_in_closed_form_lie_inside(c, u_D):
    """The force is 2, the reaction 0. Where u_D is not linear u_h differs from it on the clamped side."""
    problem = problem_in_closed_form(c, u_D)
    widths = []
    for n in (8, 16):
        s = ul.solve(problem, h=1 / n, H=2 / n)
        force = interval(s, [1])
        reaction = interval(s, [3])
        assert force.lower <= 2 <= force.upper
        assert reaction.lower <= 0 <= reaction.upper
        widths.append(force.upper - force.lower)
    # an error of twice the order: contact is on a whole side
    assert widths[1] < widths[0] / 2**1.8


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("natural", 4 / 3),  # contact has an end
        ("full_contact", 2.0),  # w = 1 and M = 0, if c is 1 and all of the boundary is in contact
    ],
)
def test_the_interval_falls_at_the_order_of_theory(name, order):
    """Supplement, Section S13.4; the rates of both halvings, less 0.15 for coarse meshes."""
    widths = [half_width(ul.solve(name, h=1 / n, H=2 / n), [0, 1, 2, 3]) for n in (16, 32, 64)]
    rates = [math.log2(coarse / fine) for coarse, fine in pairwise(widths)]
    assert min(rates) >= order - 0.15


def test_w_is_at_least_psi_less_what_the_gap_allows(monkeypatch):
    """psi - w <= M (v - g) of Proposition S22, at points between those that the program looks at."""
    s = ul.solve("natural", h=1 / 16, H=1 / 8)
    calls = record_calls(monkeypatch, "_raise_to_psi")
    interval(s, [0, 1])
    assert len(calls) > 4
    places = np.linspace(0, 1, 33)
    lengths = np.diff(s.mesh.s)[:, None]
    arc = s.mesh.s[:-1, None] + places * lengths
    side = np.repeat(s.mesh.side, len(places))
    trace, _, gap = s.problem.exact.trace_flux_and_gap(side, arc.ravel() - s.polygon.starts[side])
    g = (trace - gap).reshape(arc.shape)
    for (primal, psi, _, M), w in calls:
        start = w[s.mesh.boundary][:, None]
        end = np.roll(start, -1, axis=0)
        v, middle = np.split(primal.v_trace, 2)
        bubble = (middle - 0.5 * (v + np.roll(v, -1)))[:, None]
        v_values = v[:, None] * (1 - places) + np.roll(v, -1)[:, None] * places
        v_values += 4 * bubble * places * (1 - places)
        lacking = psi[:, None] - start * (1 - places) - end * places
        # 1e-9 is for g, which is u less the gap here
        assert np.all(lacking <= M * np.maximum(v_values - g, 0.0) + 1e-9 * (1 + M))


def test_s_is_at_most_what_sigma_allows(monkeypatch):
    """s <= M sigma of Proposition S22, for the flux that is equilibrated."""
    s = ul.solve("natural", h=1 / 16, H=1 / 8)
    fluxes = record_calls(monkeypatch, "equilibrate_source")
    factors = record_calls(monkeypatch, "_bound_for_factor")
    interval(s, [0, 1])
    assert len(fluxes) == len(factors) > 4
    for (_, _, flux, _), ((primal, _, _, _, M), _) in zip(
        (arguments for arguments, _ in fluxes), factors, strict=True
    ):
        assert np.all(flux <= M * primal.sigma)


def record_calls(monkeypatch, name):
    """The arguments and results of the calls of a function of `dual_forces` from now on."""
    calls = []
    function = getattr(dual_forces, name)

    def record(*arguments):
        result = function(*arguments)
        calls.append((arguments, result))
        return result

    monkeypatch.setattr(dual_forces, name, record)
    return calls


def enclosed_with(s, **fields):
    """The widths of the interval of the force on side 1, before and after fields of the data are changed."""
    solved = s.bounded
    before = interval(s, [1])
    data = replace(solved.data, **fields)
    after = enclose_force(
        data, solved.partition, solved.u_h, solved.lambda_H, solved.form, solved.local_bound, [1]
    )
    return before.upper - before.lower, after.upper - after.lower


def test_what_the_enclosure_of_f_leaves_is_in_the_interval():
    """E_T = e on every triangle adds e times the sum of |T|^{1/2} to both sides, as |w| is near 1 at most.

    The bound X is not changed. w is at least 1/4 on a quarter of the square.
    """
    s = ul.solve("full_contact", h=1 / 8, H=1 / 4)
    source = s.bounded.data.source
    e = 0.01
    roots = float(np.sqrt(s.mesh.areas).sum())
    before, after = enclosed_with(s, source=replace(source, remainder=source.remainder + e))
    assert 2 * e * roots / 16 < after - before < 2 * e * roots * 1.01


def test_what_the_enclosure_of_g_leaves_is_in_the_interval():
    """An error e of g counts times the integral of |q_w.n|, at least that of w = 1 on the whole boundary."""
    s = ul.solve("full_contact", h=1 / 8, H=1 / 4)
    constraint = s.bounded.data.constraint
    before, after = enclosed_with(s, constraint=replace(constraint, remainder=constraint.remainder + 1e-4))
    assert after - before > 1e-5


def test_what_the_enclosure_of_a_given_flux_leaves_is_in_the_interval():
    """Bounds r on the integrals of rho over 16 edges of free sides, where w is at least 0.1."""
    s = ul.solve(problem_in_closed_form("1", "0"), h=1 / 8, H=1 / 4)
    flux = s.bounded.data.given_flux
    free = np.isin(s.mesh.side, [0, 2])
    integrals = flux.remainder_integrals + 0.01 * free
    before, after = enclosed_with(s, given_flux=flux._replace(remainder_integrals=integrals))
    assert after - before > 2 * 0.01 * 16 * 0.1


def test_a_constant_added_to_u_h_changes_no_estimate():
    """q_w is nearly in equilibrium: (t, w) - <q_w.n, t> is - R_w(t). The bound of the first u_h is taken.

    Without the gap the estimate would change by t (1, w), which is above t / 4.
    """
    s = ul.solve("natural", h=1 / 16, H=1 / 8)
    solved = s.bounded
    t = 1e-5
    bound = solved.local_bound
    sides = [0, 1, 2, 3]
    before = enclose_force(
        solved.data, solved.partition, solved.u_h, solved.lambda_H, solved.form, bound, sides
    )
    after = enclose_force(
        solved.data, solved.partition, solved.u_h + t, solved.lambda_H, solved.form, bound, sides
    )
    assert abs(after.value - before.value) < 0.05 * t


def test_what_u_h_misses_of_u_D_is_in_the_bound():
    """|R_w(u - u_h)| has a part for y: without it the bound is eta S_w."""
    s = ul.solve(problem_in_closed_form("0", "sin(3*y)/5"), h=1 / 8, H=1 / 4)
    solved = s.bounded
    bound = solved.local_bound
    primal = dual_forces._collect_primal(
        solved.data, solved.partition, solved.u_h, solved.lambda_H, solved.form, bound
    )
    residual = residual_parts(zero_source(s.mesh), no_given_flux(s.mesh), s.u, solved.flux, solved.form)
    _, S = residual.dual_norms()
    assert dual_forces._bound_error_residual(primal, residual) > bound.eta * S * (1 + 1e-6)


def test_an_accuracy_of_a_force_is_certified_on_fewer_unknowns_than_by_the_energy():
    """The interval's half-width is within the accuracy, and contains that of an accuracy ten times better."""
    problem = ul.Problem(**SEAL)
    asked = ul.solve(problem, accuracy=0.02, norm="force", sides=[0])
    force = asked.force(sides=[0])
    assert asked.certified
    assert force.upper - force.lower <= 2 * 0.02 * force.lower
    finer = ul.solve(problem, accuracy=0.005, norm="force", sides=[0]).force(sides=[0])
    assert force.lower <= finer.lower <= finer.upper <= force.upper
    # the same mesh without duality knows the force less well
    with pytest.warns(ul.SolutionWarning, match="out of budget"):
        cheap = ul.solve(problem, accuracy=0.001, max_unknowns=asked.mesh.n_nodes).force(sides=[0])
    assert force.upper - force.lower < 0.5 * (cheap.upper - cheap.lower)


def test_a_reaction_has_an_accuracy_too():
    """- int f = 12 is the sum of both, so the reaction is 12 less the force."""
    problem = ul.Problem(**SEAL)
    reaction = ul.solve(problem, accuracy=0.01, norm="force", sides=[3]).force(sides=[3])
    force = ul.solve(problem, accuracy=0.01, norm="force").force(sides=[0])
    assert reaction.lower + force.lower <= 12 <= reaction.upper + force.upper
    assert reaction.upper - reaction.lower <= 2 * 0.01 * reaction.lower


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"norm": "h1", "sides": [0]}, "sides is only for the norm 'force'"),
        ({"norm": "force", "sides": [1]}, "are free sides"),
        ({"norm": "force", "sides": [7]}, "sides"),
        ({"norm": "force", "sides": [0], "accuracy": None, "h": 0.1, "H": 0.2}, "only for an accuracy"),
    ],
)
def test_what_does_not_fit_a_force_is_refused(changes, message):
    arguments = {"accuracy": 0.1} | changes
    with pytest.raises(ul.InputError, match=message):
        ul.solve(ul.Problem(**SEAL), **arguments)
