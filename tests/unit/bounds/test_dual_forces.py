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
from unilateral.bounds.dual_forces import enclose_force

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


@pytest.mark.parametrize("c", ["0", "1"])
@pytest.mark.parametrize("u_D", ["0", "sin(3*y)/5"])
def test_reactions_and_forces_of_a_u_in_closed_form_lie_inside(c, u_D):
    """u = x^2 + u_D(y) on the unit square, with du/dn = 2 on side 1 in contact, and clamped at x = 0.

    The flux is given on the sides between. There is no force but on side 1, where it is 2, and the reaction
    on side 3 is 0. u_D is not linear: u_h differs from it on the clamped side.
    """
    u = f"x**2 + {u_D}"
    f = f"-2 + {'9*sin(3*y)/5' if u_D != '0' else '0'} + {c}*({u})"
    slope = "3*cos(3*y)/5" if u_D != "0" else "0"
    flux = [f"-({slope})", None, slope, None]
    problem = ul.Problem(
        [[0, 0], [1, 0], [1, 1], [0, 1]], f, [None, u, None, None], [0, 2], c=c, q=flux, u={3: u}
    )
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


def test_w_is_at_least_psi_less_what_the_gap_allows_and_s_at_most_what_sigma_allows(monkeypatch):
    """The two conditions of Proposition S22, at points between those that the program looks at."""
    s = ul.solve("natural", h=1 / 16, H=1 / 8)
    raised = []
    raise_to_psi = dual_forces._raise_to_psi

    def recorded(primal, psi, w, M):
        result = raise_to_psi(primal, psi, w, M)
        raised.append((primal, psi, M, result))
        return result

    monkeypatch.setattr(dual_forces, "_raise_to_psi", recorded)
    interval(s, [0, 1])
    boundary = s.mesh.boundary
    t = np.linspace(0, 1, 33)
    for primal, psi, M, w in raised:
        nodes = len(boundary)
        v, middle = np.split(primal.v_trace, 2)
        bubble = middle - 0.5 * (v + np.roll(v, -1))
        for edge in range(nodes):
            start, end = w[boundary[edge]], w[boundary[(edge + 1) % nodes]]
            w_values = start * (1 - t) + end * t
            v_values = v[edge] * (1 - t) + v[(edge + 1) % nodes] * t + 4 * bubble[edge] * t * (1 - t)
            place = s.mesh.s[edge] + t * (s.mesh.s[edge + 1] - s.mesh.s[edge])
            side = s.mesh.side[edge]
            trace, _, gap = s.problem.exact.trace_flux_and_gap(side, place - s.polygon.starts[side])
            gap = np.maximum(v_values - (trace - gap), 0.0)
            assert np.all(psi[edge] - w_values <= M * gap + 1e-9 * (1 + M))


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
    given = {"accuracy": 0.1} | changes
    with pytest.raises(ul.InputError, match=message):
        ul.solve(ul.Problem(**SEAL), **given)
