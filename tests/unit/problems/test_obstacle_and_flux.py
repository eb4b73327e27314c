"""g and q on the sides: within their doubt of the polynomials, at peaks, kinks and jumps, and rounded."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from conftest import load
from symbolic import T, X, Y, symbolic

import unilateral as ul
from unilateral.formulas.expression import ZERO
from unilateral.formulas.formula import parse_formula
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.geometry.polygon import Polygon, square
from unilateral.problems import piecewise
from unilateral.problems.obstacle_and_flux import enclose_given_flux, enclose_obstacle
from unilateral.problems.piecewise import PIECE_DEGREE, IntervalPieces, Piecewise
from unilateral.problems.problem import Problem

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
IN_40_DIGITS = {"pos": lambda a, k: a**k if a > 0 else mpmath.mpf(0)}


def beyond(formula, symbol, s, p):
    """(k,) values of a formula at s (k,) less p (k,), with 40 digits."""
    value = sympy.lambdify(symbol, symbolic(formula), [IN_40_DIGITS, "mpmath"])
    with mpmath.workdps(40):
        pairs = zip(s.tolist(), p.tolist(), strict=True)
        return np.array([float(value(mpmath.mpf(place)) - mpmath.mpf(p_value)) for place, p_value in pairs])


def pieces(rng, k=40):
    """On one side of a square, with ends that are no sums of powers of 2, and coefficients of many sizes."""
    start = np.concatenate([[0.0], np.sort(rng.uniform(0, 1, k - 1))])
    c = rng.standard_normal((PIECE_DEGREE + 1, k)) * 10.0 ** rng.uniform(-3, 3, (PIECE_DEGREE + 1, k))
    zero = np.zeros(k)
    side = np.zeros(k, dtype=np.intp)
    return IntervalPieces(side, start, np.append(start[1:], 1.0), c, zero, zero, zero)


def errors_over_bounds(seed):
    """At random places, known exactly by their shares of the side."""
    rng = np.random.default_rng(seed)
    polygon = Polygon(np.array([[0, 0], [1 / 3, 1 / 7], [0.1, 0.9]]))
    random_pieces = pieces(rng)
    length = float(polygon.lengths[0])
    points = random_pieces.arc_lengths(polygon)
    points[-1] = length
    bound = random_pieces.rounding_errors(points)
    piecewise = Piecewise(
        polygon, points, random_pieces.side, random_pieces.c, *np.zeros((3, len(random_pieces.side)))
    )
    for i, (start, end) in enumerate(
        zip(random_pieces.start.tolist(), random_pieces.end.tolist(), strict=True)
    ):
        t = Fraction(start) + (Fraction(end) - Fraction(start)) * Fraction(rng.uniform(0.01, 0.99))
        value = piecewise.evaluate(np.array([i]), np.array([float(t * Fraction(length))]))[0].item()
        sigma = 2 * (t - Fraction(start)) / (Fraction(end) - Fraction(start)) - 1
        exact = sum(Fraction(x) * sigma**k for k, x in enumerate(random_pieces.c[:, i].tolist()))
        yield float(abs(Fraction(value) - exact)) / bound[i]


def test_values_are_off_by_no_more_than_is_allowed():
    """Control: a thousandth of that would be too little."""
    worst = max(max(errors_over_bounds(seed)) for seed in range(5))
    assert 1e-3 < worst <= 1


def sampled_places(seed, per_side=6):
    """Errors of sigma at Gauss points over the bounds on them, for pieces and edges on all sides.

    As p = sigma, a bound is that of a place, and 16 EPS, which is little on pieces as short as these.
    """
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(7) + rng.uniform(0, 0.9, 7)) / 7
    polygon = Polygon(10.0 ** rng.uniform(-3, 3) * np.column_stack([np.cos(angles), np.sin(angles)]))
    side = np.repeat(np.arange(7), per_side + 1)
    cuts = np.sort(rng.uniform(0, 1, (7, 1)) + rng.uniform(-1e-3, 1e-3, (7, per_side)), axis=1)
    cuts = np.clip(cuts, 1e-4, 1 - 1e-4)
    start = np.column_stack([np.zeros(7), cuts]).ravel()
    end = np.column_stack([cuts, np.ones(7)]).ravel()
    keep = end > start
    side = side[keep]
    start = start[keep]
    end = end[keep]
    zero = np.zeros(len(side))
    c = np.zeros((PIECE_DEGREE + 1, len(side)))
    c[1] = 1.0
    interval_pieces = IntervalPieces(side, start, end, c, zero, zero, zero)
    points = interval_pieces.arc_lengths(polygon)
    pieces = Piecewise(polygon, points, side, c, zero, zero, zero)
    nodes = np.polynomial.legendre.leggauss(PIECE_DEGREE + 1)[0].tolist()
    cut_edges = polygon.divided(rng.integers(1, 300, 7))
    samples = pieces.sample(cut_edges)
    ends = [Fraction(x) for x in np.union1d(cut_edges, points).tolist()]
    starts = [Fraction(x) for x in polygon.starts.tolist()]
    bound = interval_pieces.rounding_errors(points)
    for j, piece in enumerate(samples.piece.tolist()):
        i = side[piece]
        a = Fraction(start[piece])
        b = Fraction(end[piece])
        for x, value in zip(nodes, samples.value[j].tolist(), strict=True):
            s = (ends[j] + ends[j + 1]) / 2 + (ends[j + 1] - ends[j]) / 2 * Fraction(x)
            # supplement, F.2: s divides the side as it divides the interval between the stored arc lengths
            t = (s - starts[i]) / (starts[i + 1] - starts[i])
            sigma = (2 * t - a - b) / (b - a)
            # next to an end of a piece an interval may be one of rounding alone
            if abs(sigma) <= 1:
                yield float(abs(Fraction(value) - sigma)) / bound[piece]


def test_places_are_off_by_no_more_than_is_allowed():
    """In exact arithmetic. Control: a quarter of that would be too little."""
    worst = max(max(sampled_places(seed)) for seed in (1, 3))
    assert 0.25 < worst <= 1


def test_large_constants_are_rounded_as_sums_are():
    """At a place that is exact, of a large constant with a little more, which a shift hardly changes."""
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(50):
        c = rng.standard_normal((PIECE_DEGREE + 1, 1))
        c[0] *= 1e6
        interval_pieces = IntervalPieces(
            np.zeros(1, dtype=np.intp), *np.array([[0.0], [1.0]]), c, *np.zeros((3, 1))
        )
        polygon = Polygon(np.array([[0, 0], [1, 0], [0, 1]]))
        piecewise = Piecewise(polygon, np.array([0.0, 1.0]), interval_pieces.side, c, *np.zeros((3, 1)))
        value = piecewise.evaluate(np.array([0]), np.array([0.75]))[0].item()
        exact = sum(Fraction(x) / 2**k for k, x in enumerate(c[:, 0].tolist()))
        allowed = interval_pieces.rounding_errors(np.array([0.0, 1.0])).item()
        worst = max(worst, float(abs(Fraction(value) - exact)) / allowed)
    assert 1e-3 < worst <= 1


def g_on_bottom(text, minimum=-np.inf):
    """g on side 0 of the unit square from a formula in t, enclosed; the other sides are free."""
    formula = parse_formula(text, ("t",), "here")

    def model(side, t):
        assert np.all(side == 0)
        return enclose_formula(formula, {"t": t})

    return enclose_obstacle(square(), model, (1, 2, 3), minimum)


OF_G = [
    "sin(20*t)",
    "4*exp(-((t - 3/10)*1000)**2) - 1",
    "pos(t - 1/3, 1)*exp(t) + pos(1/2 - t, 3/2)",
    "pos((t - 1/4)*(2/3 - t), 2)",
    "1/3",
    "(t - 1/7)**9",
    "-1e6*pos(2/5 - t, 1) + t/3",
]


@pytest.mark.parametrize("text", OF_G)
def test_g_is_within_its_doubt_of_the_polynomials(text):
    """At random points and next to every end of a piece, with 40 digits; the doubt is near round-off."""
    constraint = g_on_bottom(text)
    inner = constraint.points[(constraint.points > 0) & (constraint.points < 1)]
    s = np.concatenate([np.random.default_rng(1).random(200), inner[:100] - 1e-12, inner[:100] + 1e-12])
    piece = constraint.find_pieces(s)
    p, _ = constraint.evaluate(piece, s)
    g = beyond(parse_formula(text, ("t",), "here"), T, s, p)
    assert np.all(np.abs(g) <= constraint.remainder[piece] + 1e-15 * np.abs(p))
    assert np.all((constraint.lower[piece] <= g + p + 1e-9) & (g + p - 1e-9 <= constraint.upper[piece]))
    spread = max(np.ptp(p), np.abs(p).max() * 1e-3)
    assert constraint.remainder.max() <= 1e-9 * spread
    assert len(constraint.remainder) <= 1500


U_AND_SLOPE = [("sin(20*t)", "20*cos(20*t)"), ("exp(t) + 1e6*t**7", "exp(t) + 7e6*t**6"), ("1/3", "0")]


def u_on_bottom(text, slope, length=1.0):
    """u on the clamped side 0, of that length, of a rectangle, with its derivative; the others are free."""
    u_formula = parse_formula(text, ("t",), "here")
    slope_formula = parse_formula(slope, ("t",), "here")
    rectangle = Polygon(np.array([[0, 0], [length, 0], [length, 1], [0, 1]]))
    return enclose_obstacle(
        rectangle,
        lambda _, t: enclose_formula(u_formula, {"t": t}),
        (1, 2, 3),
        clamped=(0,),
        slope_model=lambda _, t: enclose_formula(slope_formula, {"t": t}),
    )


def test_clamped_sides_without_the_derivative_are_refused():
    """A remainder of 0 would say that p' is u'. Control: with it, or without clamped sides, all is well."""
    formula = parse_formula("sin(20*t)", ("t",), "here")
    with pytest.raises(AssertionError, match="without its derivative"):
        enclose_obstacle(square(), lambda _, t: enclose_formula(formula, {"t": t}), (1, 2, 3), clamped=(0,))
    assert u_on_bottom("sin(20*t)", "20*cos(20*t)").slope_remainder.any()
    assert not g_on_bottom("sin(20*t)").slope_remainder.any()


def off(u, text, length):
    """(k,) how far the derivatives of the polynomials are from that of u at places inside the pieces."""
    t = sympy.Symbol("t")
    slope = sympy.lambdify(t, sympy.diff(sympy.sympify(text, rational=True), t), "mpmath")
    errors = []
    for k in np.flatnonzero(u.side == 0):
        start, end = u.points[k : k + 2]
        half = (mpmath.mpf(end) - start) / 2
        powers = u.c[:, k].tolist()
        errors.append(
            max(
                abs(sum(n * c * x ** (n - 1) for n, c in enumerate(powers) if n) / half - slope(s) / length)
                for x in map(mpmath.mpf, (-0.875, -0.25, 0.375, 0.9375))
                for s in [(start + half * (1 + x)) / length]
            )
        )
    return np.array(errors, dtype=float)


@pytest.mark.parametrize("length", [1.0, 8.0])
@pytest.mark.parametrize(("text", "slope"), U_AND_SLOPE)
def test_the_derivative_of_u_is_within_its_doubt_of_the_polynomials(text, slope, length):
    """Derivatives by sympy, at places in mpmath; that a wrong one is noticed is the control."""
    u = u_on_bottom(text, slope, length)
    on_side = u.side == 0
    error = off(u, text, length)
    assert np.all(error <= u.slope_remainder[on_side])
    assert np.all(u.slope_remainder[~on_side] == 0)
    assert np.all(off(u, f"{text} + t/1000", length) > u.slope_remainder[on_side])


def test_polynomials_agree_where_they_meet_and_have_their_derivatives():
    g = g_on_bottom("sin(20*t) + pos(t - 1/3, 3/2)")
    inner = g.points[1:-1][g.points[1:-1] < 1]
    piece = np.arange(len(inner))
    before = g.evaluate(piece, inner)[0]
    after = g.evaluate(piece + 1, inner)[0]
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-15)
    s = np.linspace(0.011, 0.993, 50)
    step = 1e-6
    slope = g.evaluate(g.find_pieces(s), s)[1]
    exact = 20 * np.cos(20 * s) + 1.5 * np.sqrt(np.maximum(s - 1 / 3, 0))
    np.testing.assert_allclose(slope, exact, rtol=0, atol=1e-5)
    piece = g.find_pieces(s)
    difference = (g.evaluate(piece, s + step)[0] - g.evaluate(piece, s - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-6)


def test_means_are_those_of_closed_forms():
    """A peak narrower than a cell's hundredth, a kink and a power; cells of thirds."""
    points = np.array([0, 1 / 3, 2 / 3, 1, 4])
    peak = g_on_bottom("exp(-((t - 1/2)*1000)**2)").means(points)
    assert peak[:3] == pytest.approx([0, 3 * np.sqrt(np.pi) / 1000, 0], rel=1e-8, abs=1e-10)
    power = g_on_bottom("pos(t - 1/2, 3/2)").means(points)
    exact = 3 * np.diff(0.4 * np.maximum(points[:4] - 1 / 2, 0) ** 2.5)
    assert power[:3] == pytest.approx(exact, rel=1e-8, abs=1e-10)


def test_below_what_u_reaches_less_is_known():
    """A dive to -1e10 beside a peak of height 1: with u >= -1 the peak is known to 1e-9."""
    g = g_on_bottom("exp(-1e8*(t - 0.5123)**2) - 1e10*pos(t - 3/4, 2)", -1.0)
    near = np.abs(0.5 * (g.points[1:] + g.points[:-1]) - 0.5123) < 1e-3
    assert g.remainder[near].max() < 1e-9
    assert g.range(0)[1] == pytest.approx(1, abs=1e-6)
    means = g.means(np.array([0, 0.75, 1, 4]))
    assert means[0] == pytest.approx(np.sqrt(np.pi) * 1e-4 / 0.75, rel=1e-6)
    assert means[1] == pytest.approx(-1e10 * 0.25**2 / 3, rel=1e-8)


def test_what_takes_too_many_pieces_is_known_less_well(monkeypatch):
    """A wave of length 1/1000 with 100 pieces: up to its height; control: with more of them."""
    wave = "sin(2000*pi*t)"
    assert g_on_bottom(wave).remainder.max() < 1e-8
    monkeypatch.setattr(piecewise, "MAX_SIDE_PIECES", 100)
    assert g_on_bottom(wave).remainder.max() >= 1


@pytest.mark.parametrize("name", ["thirds", "natural", "vertex", "reentrant", "violates_j", "smooth"])
def test_g_of_a_case_is_that_of_its_formulas(name):
    """u - gap by `ExactSolution.trace_flux_and_gap`, which is tested elsewhere, on all sides."""
    case = load(name, "lshape" if name in ("reentrant", "violates_j") else "square")
    enclosed_obstacle = case.problem.enclosed_obstacle
    polygon = case.polygon
    s = np.sort(np.random.default_rng(1).random(2000)) * polygon.perimeter
    side = np.searchsorted(polygon.starts, s, side="right") - 1
    u, _, gap = case.trace_flux_and_gap(side, s - polygon.starts[side])
    piece = enclosed_obstacle.find_pieces(s)
    p, _ = enclosed_obstacle.evaluate(piece, s)
    assert np.all(np.abs(u - gap - p) <= enclosed_obstacle.remainder[piece] + 1e-14 * np.abs(u).max())
    assert enclosed_obstacle.remainder.max() < 1e-8


def test_free_sides_have_no_g():
    g = g_on_bottom("t")
    assert g.side.tolist() == [0, 1, 2, 3]
    assert g.range(2) == (-np.inf, -np.inf)
    assert g.ends[1, 0] == 0
    assert not g.ends[:, 2:].any()


def test_a_place_that_rounding_puts_beyond_a_kink_is_covered():
    """The steep side is tiny and far along the boundary, where arc lengths are rounded by 1e-12 of it."""
    polygon = [(0, 0), (1e4, 0), (1e4, 1e-3), (9999.999, 1e-2), (0, 1e4)]
    problem = ul.Problem(polygon, f=0, g="pos(1e6*(y - 0.0005), 1)*pos(0.01 - y, 1)")
    enclosed_obstacle = problem.enclosed_obstacle
    for k in np.flatnonzero(enclosed_obstacle.side == 1):
        for s in enclosed_obstacle.points[k : k + 2].tolist():
            y = (
                (Fraction(s) - Fraction(enclosed_obstacle.polygon.starts[1]))
                * Fraction(1e-3)
                / Fraction(enclosed_obstacle.polygon.lengths[1])
            )
            y = min(max(y, Fraction(0)), Fraction(1e-3))
            g = max(10**6 * (y - Fraction(1, 2000)), 0) * (Fraction(1, 100) - y)
            p, _ = enclosed_obstacle.evaluate(np.array(k), np.array(s))
            assert abs(g - Fraction(float(p))) <= Fraction(enclosed_obstacle.remainder[k])
            assert g <= Fraction(enclosed_obstacle.upper[k])


OF_Q = [
    "sin(20*x)",
    "4*exp(-((x - 3/10)*1000)**2) - 1",
    "pos(x - 1/3, 0) - 2*pos(1/2 - x, 0)*x",
    "pos(x - 1/3, 3/2) - pos(x - 1/5, 1)",
    "pos(x - 1/7, 1/2)",
    "pos(x - 1/4, 0) + 2*pos(x - 5/8, 0)",
    "1e6",
]


def q_on_bottom(q):
    """q on side 0 of the unit square, from y = 0 to y = 0, where x is the arc length."""
    return ul.Problem(SQUARE, f=0, g=0, free_sides=[0], q=[q, None, None, None])


@pytest.mark.parametrize("text", OF_Q)
def test_q_is_within_its_doubt_of_the_polynomials(text):
    """At random points and next to every end of a piece, with 40 digits; near ends by less than the jump.

    In L2 a millionth of its size is left, where half of a jump is in doubt on two pieces of 1e-12.
    """
    problem = q_on_bottom(text)
    enclosed_flux = problem.enclosed_flux
    inner = enclosed_flux.points[(enclosed_flux.points > 0) & (enclosed_flux.points < 1)]
    at_ends = [inner + sign * k * enclosed_flux.reach / 4 for sign in (-1, 1) for k in (0, 1, 2, 4)]
    s = np.concatenate([np.random.default_rng(1).random(200), *at_ends])
    piece = enclosed_flux.find_pieces(s)
    p, _ = enclosed_flux.evaluate(piece, s)
    away = np.abs(beyond(problem.q[0], X, s, p))
    near = np.minimum(np.searchsorted(enclosed_flux.points, s), len(enclosed_flux.points) - 1)
    jumps = np.stack(
        [
            np.where(np.abs(enclosed_flux.points[k] - s) <= enclosed_flux.reach, enclosed_flux.jumps[k], 0)
            for k in (near, near - 1)
        ]
    )
    assert np.all(away <= np.maximum(enclosed_flux.remainder[piece], jumps.max(axis=0)) + 1e-15 * np.abs(p))
    square = np.diff(enclosed_flux.points) @ enclosed_flux.remainder**2
    assert np.sqrt(square) <= 1e-6 * np.abs(p).max()
    assert len(enclosed_flux.remainder) <= 1500


@pytest.mark.parametrize("position", ["1/3", "1/2", "1/4", "0.3", "0.191", "0.382", "0.5 + 1e-14"])
def test_a_jump_costs_nothing_but_short_pieces(position):
    """In L2 a millionth of it: half of the jump on a piece of 1e-12. Control: the doubt there is that half.

    The jump itself is told at the piece's ends.
    """
    enclosed_flux = q_on_bottom(f"3*pos(x - ({position}), 0)").enclosed_flux
    assert enclosed_flux.remainder.max() == pytest.approx(1.5)
    assert enclosed_flux.jumps.max() == pytest.approx(3, rel=1e-9)
    assert np.diff(enclosed_flux.points)[enclosed_flux.remainder > 0.1].sum() <= 1e-12
    assert len(enclosed_flux.remainder) < 100


def test_no_piece_is_shorter_than_places_are_known():
    """On a side of 1e-5 of a perimeter of 4e4 a halving too much would put the jump into a wrong piece."""
    polygon = [(0, 0), (1e4, 0), (1e4, 1e4), (0.4, 1e4), (0, 9999.6)]
    problem = ul.Problem(polygon, f=0, g=0, free_sides=[3], q="pos(x - 0.1, 0)")
    enclosed_flux = problem.enclosed_flux
    assert np.diff(enclosed_flux.points)[enclosed_flux.is_given].min() >= 2 * enclosed_flux.reach
    assert enclosed_flux.remainder.max() == pytest.approx(0.5)


def test_only_sides_with_a_flux_have_one():
    problem = ul.Problem(SQUARE, f=0, g=0, free_sides=[0, 2], q=["x - 2", None, 0, None])
    enclosed_flux = problem.enclosed_flux
    assert {*enclosed_flux.side[enclosed_flux.is_given].tolist()} == {0}
    assert enclosed_flux.range(0) == pytest.approx((-2, -1))
    assert enclosed_flux.lower_bound == pytest.approx(-2)
    assert enclose_given_flux(square(), lambda _, t: t, ()).lower_bound == np.inf
    assert not ul.case("natural").enclosed_flux.is_given.any()


def test_one_formula_is_for_all_free_sides():
    problem = ul.Problem(SQUARE, f=0, g=0, free_sides=[1, 2], q="x*y")
    assert [*map(symbolic, problem.q)] == [0, X * Y, X * Y, 0]
    assert ul.Problem(SQUARE, f=0, g=0, free_sides=[1]).q == (ZERO,) * 4


IDLE = {"f": "1 + x*y", "g": 1 / 2, "free_sides": [2]}


def test_a_flux_into_the_domain_leaves_sides_idle_and_one_out_of_it_does_not():
    """u >= inf f = 1 holds for q >= 0. Control: with q = -4 there is contact on sides that were idle."""
    assert ul.Problem(SQUARE, **IDLE, q="x**2 + 1/10").idle_sides() == (0, 1, 3)
    problem = ul.Problem(SQUARE, **IDLE, q="-4*x")
    assert problem.u_lower_bound == -np.inf
    assert problem.idle_sides() == ()
    solution = ul.solve(problem, h=1 / 16, H=1 / 8)
    assert solution.u.min() < 0.5 + 1e-9
    assert solution.contact.lengths[1] > 0


def test_a_function_is_known_as_well_as_its_own_side_asks_for():
    """sin(40 x) beside a side with -1e9. Control: to 1e-12 of that it was known to a thousandth only."""
    sides = [parse_formula(text, ("x", "y"), "here") for text in ("sin(40*x)", "0", "-1e9", "0")]
    for flux in (
        Problem("here", square(), ZERO, tuple(sides), (1, 3), clamped_sides=(0,)).enclosed_obstacle,
        Problem("here", square(), ZERO, (ZERO,) * 4, (0, 1, 2, 3), q=tuple(sides)).enclosed_flux,
    ):
        assert flux.remainder[flux.side == 0].max() < 1e-11
        assert flux.remainder[flux.side == 2].max() < 1e-11 * 1e9
