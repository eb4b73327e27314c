"""g on the sides: within its doubt of the polynomials, peaks and kinks, means, and what costs too much."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from conftest import load

from unilateral.formulas.formula import parse
from unilateral.formulas.symbolic import symbolic
from unilateral.formulas.taylor_functions import evaluate
from unilateral.geometry.polygon import square
from unilateral.problems import piecewise, problem_file
from unilateral.problems.atoms import T
from unilateral.problems.obstacle_and_flux import enclose_obstacle


class OnBottom:
    """g on side 0 of the unit square from a formula in t, 0 elsewhere."""

    polygon = square()

    def __init__(self, text):
        self.formula = parse(text, ("t",), "here")

    def obstacle_model(self, side, t):
        found = evaluate(self.formula, {"t": t})
        assert np.all(side == 0)
        return found


FREE = (1, 2, 3)


def enclosed(of, free, least=-np.inf):
    """g of such an object."""
    return enclose_obstacle(of.polygon, of.obstacle_model, free, least)


FORMULAS = [
    "sin(20*t)",
    "4*exp(-((t - 3/10)*1000)**2) - 1",
    "pos(t - 1/3, 1)*exp(t) + pos(1/2 - t, 3/2)",
    "pos((t - 1/4)*(2/3 - t), 2)",
    "1/3",
    "(t - 1/7)**9",
    "-1e6*pos(2/5 - t, 1) + t/3",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_g_is_within_its_doubt_of_the_polynomials(text):
    """At random points and next to every end of a piece, with 40 digits; the doubt is near round-off."""
    of = OnBottom(text)
    found = enclosed(of, FREE)
    inner = found.points[(found.points > 0) & (found.points < 1)]
    s = np.concatenate([np.random.default_rng(1).random(200), inner[:100] - 1e-12, inner[:100] + 1e-12])
    piece = found.on(s)
    p, _ = found.at(piece, s)
    value = sympy.lambdify(
        T, symbolic(of.formula), [{"pos": lambda a, k: a**k if a > 0 else mpmath.mpf(0)}, "mpmath"]
    )
    with mpmath.workdps(40):
        pairs = zip(s.tolist(), p.tolist(), strict=True)
        g = np.array([float(value(mpmath.mpf(at)) - mpmath.mpf(of_p)) for at, of_p in pairs])
    assert np.all(np.abs(g) <= found.doubt[piece] + 1e-15 * np.abs(p))
    assert np.all((found.lower[piece] <= g + p + 1e-9) & (g + p - 1e-9 <= found.upper[piece]))
    spread = max(np.ptp(p), np.abs(p).max() * 1e-3)
    assert found.doubt.max() <= 1e-9 * spread
    assert len(found.doubt) <= 1500


def test_polynomials_agree_where_they_meet_and_have_their_derivatives():
    found = enclosed(OnBottom("sin(20*t) + pos(t - 1/3, 3/2)"), FREE)
    inner = found.points[1:-1][found.points[1:-1] < 1]
    piece = np.arange(len(inner))
    before, after = found.at(piece, inner)[0], found.at(piece + 1, inner)[0]
    np.testing.assert_allclose(before, after, atol=1e-15)
    s, step = np.linspace(0.011, 0.993, 50), 1e-6
    slope = found.at(found.on(s), s)[1]
    exact = 20 * np.cos(20 * s) + 1.5 * np.sqrt(np.maximum(s - 1 / 3, 0))
    np.testing.assert_allclose(slope, exact, atol=1e-5)
    difference = (found.at(found.on(s), s + step)[0] - found.at(found.on(s), s - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-6)


def test_means_are_those_of_closed_forms():
    """A peak narrower than a cell's hundredth, a kink and a power; cells of thirds."""
    points = np.array([0, 1 / 3, 2 / 3, 1, 4])
    peak = enclosed(OnBottom("exp(-((t - 1/2)*1000)**2)"), FREE).means(points)
    assert peak[:3] == pytest.approx([0, 3 * np.sqrt(np.pi) / 1000, 0], rel=1e-8, abs=1e-10)
    power = enclosed(OnBottom("pos(t - 1/2, 3/2)"), FREE).means(points)
    exact = 3 * np.diff(0.4 * np.maximum(points[:4] - 1 / 2, 0) ** 2.5)
    assert power[:3] == pytest.approx(exact, rel=1e-8, abs=1e-10)


def test_below_what_u_reaches_less_is_known():
    """A dive to -1e10 beside a peak of height 1: with u >= -1 the peak is known to 1e-9."""
    of = OnBottom("exp(-1e8*(t - 0.5123)**2) - 1e10*pos(t - 3/4, 2)")
    found = enclosed(of, FREE, -1.0)
    near = np.abs(0.5 * (found.points[1:] + found.points[:-1]) - 0.5123) < 1e-3
    assert found.doubt[near].max() < 1e-9
    assert found.range(0)[1] == pytest.approx(1, abs=1e-6)
    means = found.means(np.array([0, 0.75, 1, 4]))
    assert means[0] == pytest.approx(np.sqrt(np.pi) * 1e-4 / 0.75, rel=1e-6)
    assert means[1] == pytest.approx(-1e10 * 0.25**2 / 3, rel=1e-8)


def test_what_takes_too_many_pieces_is_known_less_well(monkeypatch):
    """A wave of length 1/1000 with 100 pieces: up to its height; control: with more of them."""
    wave = OnBottom("sin(2000*pi*t)")
    assert enclosed(wave, FREE).doubt.max() < 1e-8
    monkeypatch.setattr(piecewise, "MOST_PIECES", 100)
    assert enclosed(wave, FREE).doubt.max() >= 1


@pytest.mark.parametrize("name", ["thirds", "natural", "vertex", "reentrant", "violates_j", "smooth"])
def test_g_of_a_case_is_that_of_its_formulas(name):
    """u - gap by `Case.boundary`, which is tested elsewhere, on all sides."""
    case = load(name, "lshape" if name in ("reentrant", "violates_j") else "square")
    found, polygon = case.enclosed_obstacle, case.polygon
    s = np.sort(np.random.default_rng(1).random(2000)) * polygon.perimeter
    side = np.searchsorted(polygon.starts, s, side="right") - 1
    u, _, gap = case.boundary(side, s - polygon.starts[side])
    piece = found.on(s)
    p, _ = found.at(piece, s)
    assert np.all(np.abs(u - gap - p) <= found.doubt[piece] + 1e-14 * np.abs(u).max())
    assert found.doubt.max() < 1e-8


def test_free_sides_have_no_g():
    found = enclosed(OnBottom("t"), FREE)
    assert found.side.tolist() == [0, 1, 2, 3]
    assert found.range(2) == (-np.inf, -np.inf)
    assert found.at_vertex(0)[1] == 0


def test_a_place_that_rounding_puts_beyond_a_kink_is_covered(tmp_path):
    """The steep side is tiny and far along the boundary, where arc lengths are rounded by 1e-12 of it."""
    text = (
        "polygon: [[0, 0], [1e4, 0], [1e4, 1e-3], [9999.999, 1e-2], [0, 1e4]]\n"
        "f: 0\ng: pos(1e6*(y - 0.0005), 1)*pos(0.01 - y, 1)\n"
    )
    file = tmp_path / "far.yaml"
    file.write_text(text)
    found = problem_file.load(str(file)).enclosed_obstacle
    for k in np.flatnonzero(found.side == 1):
        for s in found.points[k : k + 2].tolist():
            y = (
                (Fraction(s) - Fraction(found.polygon.starts[1]))
                * Fraction(1e-3)
                / Fraction(found.polygon.lengths[1])
            )
            y = min(max(y, Fraction(0)), Fraction(1e-3))
            g = max(10**6 * (y - Fraction(1, 2000)), 0) * (Fraction(1, 100) - y)
            p, _ = found.at(np.array(k), np.array(s))
            assert abs(g - Fraction(float(p))) <= Fraction(found.doubt[k])
            assert g <= Fraction(found.upper[k])
