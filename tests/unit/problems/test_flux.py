"""q on free sides: within its doubt of the polynomials, also where it jumps; its least value."""

import mpmath
import numpy as np
import pytest
import sympy

import unilateral as ul
from unilateral.formulas.expression import ZERO
from unilateral.formulas.symbolic import symbolic
from unilateral.geometry.polygon import square
from unilateral.problems.atoms import X, Y
from unilateral.problems.obstacle_and_flux import no_flux

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
FORMULAS = [
    "sin(20*x)",
    "4*exp(-((x - 3/10)*1000)**2) - 1",
    "pos(x - 1/3, 0) - 2*pos(1/2 - x, 0)*x",
    "pos(x - 1/3, 3/2) - pos(x - 1/5, 1)",
    "pos(x - 1/7, 1/2)",
    "pos(x - 1/4, 0) + 2*pos(x - 5/8, 0)",
    "1e6",
]


def on_bottom(q, free=(0,)):
    """q on side 0 of the unit square, from y = 0 to y = 0, where x is the arc length."""
    return ul.Problem(SQUARE, f=0, g=0, free_sides=free, q=[q, None, None, None])


@pytest.mark.parametrize("text", FORMULAS)
def test_q_is_within_its_doubt_of_the_polynomials(text):
    """At random points and next to every end of a piece, with 40 digits; near ends by less than the jump.

    In L2 a millionth of its size is left, where half of a jump is in doubt on two pieces of 1e-12.
    """
    problem = on_bottom(text)
    found = problem.enclosed_flux
    inner = found.points[(found.points > 0) & (found.points < 1)]
    at_ends = [inner + sign * k * found.reach / 4 for sign in (-1, 1) for k in (0, 1, 2, 4)]
    s = np.concatenate([np.random.default_rng(1).random(200), *at_ends])
    piece = found.on(s)
    p, _ = found.at(piece, s)
    value = sympy.lambdify(
        X, symbolic(problem.q[0]), [{"pos": lambda a, k: a**k if a > 0 else mpmath.mpf(0)}, "mpmath"]
    )
    with mpmath.workdps(40):
        pairs = zip(s.tolist(), p.tolist(), strict=True)
        away = np.abs([float(value(mpmath.mpf(at)) - mpmath.mpf(of_p)) for at, of_p in pairs])
    near = np.minimum(np.searchsorted(found.points, s), len(found.points) - 1)
    jumps = np.stack(
        [np.where(np.abs(found.points[k] - s) <= found.reach, found.jumps[k], 0) for k in (near, near - 1)]
    )
    assert np.all(away <= np.maximum(found.doubt[piece], jumps.max(axis=0)) + 1e-15 * np.abs(p))
    square = np.diff(found.points) @ found.doubt**2
    assert np.sqrt(square) <= 1e-6 * np.abs(p).max()
    assert len(found.doubt) <= 1500


@pytest.mark.parametrize("at", ["1/3", "1/2", "1/4", "0.3", "0.191", "0.382", "0.5 + 1e-14"])
def test_a_jump_costs_nothing_but_short_pieces(at):
    """In L2 a millionth of it: half of the jump on a piece of 1e-12. Control: the doubt there is that half.

    The jump itself is told at the piece's ends.
    """
    found = on_bottom(f"3*pos(x - ({at}), 0)").enclosed_flux
    assert found.doubt.max() == pytest.approx(1.5)
    assert found.jumps.max() == pytest.approx(3, rel=1e-9)
    assert np.diff(found.points)[found.doubt > 0.1].sum() <= 1e-12
    assert len(found.doubt) < 100


def test_no_piece_is_shorter_than_places_are_known():
    """On a side of 1e-5 of a perimeter of 4e4 a halving too much would put the jump into a wrong piece."""
    polygon = [(0, 0), (1e4, 0), (1e4, 1e4), (0.4, 1e4), (0, 9999.6)]
    problem = ul.Problem(polygon, f=0, g=0, free_sides=[3], q="pos(x - 0.1, 0)")
    found = problem.enclosed_flux
    assert np.diff(found.points)[found.given].min() >= 2 * found.reach
    assert found.doubt.max() == pytest.approx(0.5)


def test_only_sides_with_a_flux_have_one():
    problem = ul.Problem(SQUARE, f=0, g=0, free_sides=[0, 2], q=["x - 2", None, 0, None])
    found = problem.enclosed_flux
    assert {*found.side[found.given].tolist()} == {0}
    assert found.range(0) == pytest.approx((-2, -1))
    assert found.least == pytest.approx(-2)
    assert no_flux(square()).least == np.inf
    assert not ul.case("natural").enclosed_flux.given.any()


def test_one_formula_is_for_all_free_sides():
    problem = ul.Problem(SQUARE, f=0, g=0, free_sides=[1, 2], q="x*y")
    assert [*map(symbolic, problem.q)] == [0, X * Y, X * Y, 0]
    assert ul.Problem(SQUARE, f=0, g=0, free_sides=[1]).q == (ZERO,) * 4


IDLE = {"f": "1 + x*y", "g": 1 / 2, "free_sides": [2]}


def test_a_flux_into_the_domain_leaves_sides_idle_and_one_out_of_it_does_not():
    """u >= inf f = 1 holds for q >= 0. Control: with q = -4 there is contact on sides that were idle."""
    assert ul.Problem(SQUARE, **IDLE, q="x**2 + 1/10").idle_sides() == (0, 1, 3)
    problem = ul.Problem(SQUARE, **IDLE, q="-4*x")
    assert problem.least == -np.inf
    assert problem.idle_sides() == ()
    found = ul.solve(problem, h=1 / 16, H=1 / 8)
    assert found.u.min() < 0.5 + 1e-9
    assert found.contact.lengths[1] > 0
