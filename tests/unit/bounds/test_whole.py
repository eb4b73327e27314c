"""f on the triangles of coarser levels: what is known there holds on the mesh, and is not asked for again."""

import tracemalloc
from dataclasses import replace
from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest
from test_source import FORMULAS, Source

from unilateral.bounds import projection, source
from unilateral.bounds.projection import halved
from unilateral.bounds.source import enclosed
from unilateral.bounds.whole import whole
from unilateral.fem.quadrature import symmetric
from unilateral.fem.splitting import quarter
from unilateral.formulas.taylor import EPS, basis
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

KITE = np.array([[0, 0], [1.1, -0.3], [1.4, 1.2], [0.2, 0.8]])
MESHES = {
    "square": lambda: structured(square(), 1 / 32),
    "lshape": lambda: structured(named("lshape"), 1 / 16),
    "kite": lambda: meshes.refine(meshes.unstructured(Polygon(KITE, "kite"), 1 / 3), 3),
    "far": lambda: meshes.refine(meshes.unstructured(Polygon(KITE + 1e5 / 3, "far"), 1 / 3), 3),
}
SMOOTH = "x*y*sin(3*x) - 1"


class Counted(Source):
    """f from a formula, which counts the pieces on which it is looked at."""

    pieces = 0

    def source_model(self, x, y, steps):
        self.pieces += len(x.rad)
        return super().source_model(x, y, steps)


def alone(mesh):
    """The mesh as if it had not been refined."""
    return replace(mesh, coarse=None, halvings=0)


def points(mesh, barycentric):
    """(m, q, 2) the points of every triangle."""
    return barycentric @ mesh.points[mesh.triangles]


def formulas(rng, steepest=60):
    """Smooth functions, steep peaks, roots away from 0, and jumps along lines and circles."""
    for _ in range(3):
        a, b, c = rng.uniform(0.1, 0.9, 3).round(3)
        k = int(rng.integers(2, steepest))
        yield f"sin({k}*x + {a})*exp({b}*y) - {c}"
        yield f"exp(-{k**2}*((x - {a})**2 + (y - {b})**2))"
        yield f"pos(x + {c}*y + {2 + a}, 1/2)*cos({k}*y)"
        yield f"pos(x - {a}*y - {b}, 0)*exp({c}*x)"
        yield f"{a}*x - pos({b**2 / 4} - (x - {a})**2 - (y - {c})**2, 0)"


@pytest.mark.parametrize("name", ["square", "lshape", "kite"])
def test_p_of_a_coarser_level_holds_on_every_triangle(name):
    """|f - p| <= rad at 12 random points of every triangle; f itself is computed up to 16 units.

    Control: with the children of a triangle in another order it does not hold.
    """
    mesh, rng = MESHES[name](), np.random.default_rng(1)
    barycentric = rng.dirichlet([1, 1, 1], 12)
    n, at, controls = len(mesh.triangles), points(mesh, barycentric), []
    for text in formulas(rng):
        of = Source(text)
        value = of.value(*np.moveaxis(at, 2, 0))[0]
        slack = 16 * EPS * np.abs(value).max()
        for k in range(mesh.halvings + 1):
            found = whole(mesh, np.arange(n >> 2 * k), k, of)
            p, rad = values(found, barycentric), np.repeat(found.rad, 4**k)[:, None]
            assert np.all(np.abs(value - p) <= rad + slack), (text, k)
        wrong = p.reshape(-1, 4, 12)[:, ::-1].reshape(p.shape)
        controls.append(np.any(np.abs(value - wrong) > rad + slack))
    assert np.any(controls)


def values(found, barycentric):
    """(m, q) p on the triangles of the mesh."""
    parts = np.empty((len(found.triangle), 4**found.halvings, len(barycentric)))
    for first in range(3):
        at, sigma = found.first == first, 2 * np.roll(barycentric, -first, axis=1)[:, 1:] - 1
        monomials = np.prod(sigma ** basis(2, 4).exponents[:, None], axis=2)
        c = halved(found.c[:, at].T, found.halvings, first)
        parts[at] = (c @ monomials).reshape(-1, *parts.shape[1:])
    return parts.reshape(-1, len(barycentric))


def mean_of(i, j):
    """That of sigma_1^i sigma_2^j on a triangle, exactly: 2 a! b! / (a + b + 2)! for hats to the a and b."""
    terms = (
        (a, b, Fraction(2 * factorial(a) * factorial(b), factorial(a + b + 2)))
        for a in range(i + 1)
        for b in range(j + 1)
    )
    return sum(comb(i, a) * comb(j, b) * 2 ** (a + b) * (-1) ** (i + j - a - b) * of for a, b, of in terms)


def to_hats(first):
    """[of each monomial] its L2 projection to linear functions at the corners, exactly."""
    m = basis(2, 4).exponents.tolist()
    hats = [[mean_of(i, j), mean_of(i + 1, j), mean_of(i, j + 1)] for i, j in m]
    own = [[-(b + c), one + b, one + c] for one, b, c in hats]  # twice the means with hats
    found = [[6 * x - Fraction(3, 2) * sum(of) for x in of] for of in own]
    return [[*of[3 - first :], *of[: 3 - first]] for of in found]


@pytest.mark.parametrize("halvings", [1, 2])
def test_the_rounding_of_projections_is_below_its_allowance(halvings):
    """In rational arithmetic; and a hundredth of it would be too little."""
    rng, first = np.random.default_rng(5), 1
    c = rng.standard_normal((3, 15)) * 10.0 ** rng.uniform(-3, 3, (3, 15))
    halving, exact = projection._halving(first), [[Fraction(x) for x in row] for row in c.tolist()]
    columns = [[(i, Fraction(x)) for i, x in enumerate(of) if x] for of in halving.T.tolist()]
    for _ in range(halvings):
        all_parts = [[sum(of[i] * x for i, x in column) for column in columns] for of in exact]
        exact = [of[15 * part : 15 * part + 15] for of in all_parts for part in range(4)]
    to_f_h = to_hats(first)
    f_h = projection.projected(halved(c, halvings, first), first)[0]
    allowed = np.repeat(projection.rounding(c.T, halvings), 4**halvings)
    off = [
        [
            abs(Fraction(value) - sum(x * of[corner] for x, of in zip(row, to_f_h, strict=True)))
            for corner, value in enumerate(at)
        ]
        for row, at in zip(exact, f_h.tolist(), strict=True)
    ]
    worst = (np.array(off, dtype=float).max(axis=1) / allowed).max()
    assert 0.01 < worst <= 1


@pytest.mark.parametrize("first", range(3))
def test_constants_are_as_exact_as_their_rounding_says(first):
    """As `rounding` says: those of halving are sixteenths, in sum 1; the others at most 1, up to 8 units."""
    halving, m = projection._halving(first), basis(2, 4).exponents.tolist()
    np.testing.assert_array_equal(16 * halving, np.round(16 * halving))
    np.testing.assert_array_equal(np.abs(halving).reshape(15, 4, 15).sum(axis=2), 1)
    to_f_h, rest = np.split(projection._projection(first).T, [3])
    exact = np.array(to_hats(first), dtype=float).T
    assert np.abs(exact).max() <= 1
    np.testing.assert_allclose(to_f_h, exact, rtol=0, atol=8 * EPS)
    gram = np.array([[float(mean_of(a + c, b + d)) for c, d in m] for a, b in m])
    mass = np.array([[2, 1, 1], [1, 2, 1], [1, 1, 2]]) / 12
    np.testing.assert_allclose(rest.T @ rest + exact.T @ mass @ exact, gram, rtol=0, atol=8 * EPS)


@pytest.mark.parametrize("name", MESHES)
def test_polynomials_are_taken_from_the_coarsest_level(name):
    """Degree 4: moments with hats by a rule of degree 6, ||f - f_h|| by one of degree 8, both exact.

    Up to 1e-12 of ||f|| or, far away, to as many units of rounding as the largest coordinate has.
    """
    mesh = MESHES[name]()
    x, y = (f"({z} - {c!r})" for z, c in zip("xy", mesh.polygon.vertices[0].tolist(), strict=True))
    of = Counted(f"3*{x}**4 - 2*{x}*{y}**3 + {y}**2 - 5*{x} + 7")
    found = enclosed(mesh, of)
    if name != "far":
        assert of.pieces == len(mesh.triangles) >> 2 * mesh.halvings
    size = 30 * max(1e-12, 64 * EPS * np.abs(mesh.points).max())
    hats, weights = symmetric(6)
    value = of.value(*np.moveaxis(points(mesh, hats), 2, 0))[0]
    moments = mesh.areas[:, None] * ((value * weights) @ hats)
    assert np.all(np.abs(found.moments - moments) <= size * mesh.areas[:, None])
    hats, weights = symmetric(8)
    rest = of.value(*np.moveaxis(points(mesh, hats), 2, 0))[0] - found.f_h @ hats.T
    norms = np.sqrt(mesh.areas * (rest**2 @ weights))
    assert np.all(np.abs(norms - found.oscillation) <= size * np.sqrt(mesh.areas))
    assert np.all(found.rest <= size * np.sqrt(mesh.areas))


@pytest.mark.parametrize("name", MESHES)
def test_the_same_with_and_without_coarser_levels(name):
    """Both f_h are those of p's that differ by both rests at most; at a jump that holds for the means.

    What coarser levels leave of f is at most what is wanted of them.
    """
    mesh = MESHES[name]()
    shift = np.round(mesh.polygon.vertices[0], 3).tolist()
    for text in [*FORMULAS, SMOOTH]:
        here = text.replace("exp", "E").replace("x", f"(x - {shift[0]})").replace("y", f"(y - {shift[1]})")
        of = Source(here.replace("E", "exp"))
        found, expected = enclosed(mesh, of), enclosed(alone(mesh), of)
        assert found.resolved == expected.resolved
        most = np.sqrt(mesh.areas) * (found.rest + expected.rest)
        moved = found.moments - expected.moments
        assert np.all(np.abs(moved.sum(axis=1)) <= most)
        if "pos" not in text:
            assert np.all(np.abs(moved) <= most[:, None])
            d, value = found.f_h - expected.f_h, of.value(*mesh.points.T)[0]
            assert np.all(
                mesh.areas * (np.sum(d**2, axis=1) + d.sum(axis=1) ** 2) <= 12 * most**2 / mesh.areas
            )
            wanted = source.ABOVE * source.ENOUGH * mesh.h * np.ptp(value)
            assert found.unknown**2 <= wanted**2 * mesh.areas.sum() + (1 + 1e-6) * expected.unknown**2


@pytest.mark.parametrize("name", ["square", "lshape", "kite"])
def test_what_is_left_of_f_is_bounded(name):
    """By a rule of degree 8 on 16 parts of each triangle; those at a jump are tested without refinement.

    1e-9 is for the rule's error, the ninth derivative on parts of h/4 <= 1/48 of what varies over 1/20.
    """
    mesh, (rule, weights) = MESHES[name](), symmetric(8)
    hats = (quarter(quarter(np.eye(3)[None])).transpose(0, 2, 1) @ rule.T).transpose(0, 2, 1).reshape(-1, 3)
    at, root, weights = points(mesh, hats), np.sqrt(mesh.areas), np.tile(weights, 16) / 16
    for text in formulas(np.random.default_rng(2), 20):
        of = Source(text)
        found = enclosed(mesh, of)
        away = np.ones(len(root), dtype=bool)
        for kink in of.jumps.values():
            away &= np.abs(kink.level(mesh.circles[0])) > mesh.longest_edges
        rest = of.value(*np.moveaxis(at, 2, 0))[0] - found.f_h @ hats.T
        norms, integrals = np.sqrt(mesh.areas * (rest**2 @ weights)), mesh.areas * (rest @ weights)
        assert np.all((norms <= found.oscillation + found.rest + 1e-9 * root)[away]), text
        assert np.all((np.abs(integrals) <= found.rest * root + 1e-9 * mesh.areas)[away]), text


def test_how_often_f_is_looked_at():
    """rad falls with the fifth power of a piece's size s, and is wanted to fall with h: s^-2 ~ h^(-2/5).

    Control: without coarser levels the number is that of the triangles, 16 times as large for h/4.
    """
    counts = []
    for n in (128, 512):
        of = Counted(SMOOTH)
        enclosed(structured(square(), 1 / n), of)
        counts.append(of.pieces)
    assert counts[1] <= 4 ** (2 / 5) * counts[0]


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4])
def test_no_peak_between_the_points_of_coarser_levels_is_missed(width, monkeypatch):
    """The integral of exp(-|x - c|^2/w^2) is pi w^2; c lies off all lines of the mesh.

    Control: where p is taken for f it is missed.
    """
    of, mesh = Source(f"exp(-((x - 409/1000)**2 + (y - 397/1000)**2)*{1 / width**2:.0f})"), MESHES["square"]()

    def missed():
        found = enclosed(mesh, of)
        return abs(found.moments.sum() - np.pi * width**2) - found.rest @ np.sqrt(mesh.areas)

    assert missed() <= 0
    monkeypatch.setattr(source, "whole", lambda *given: whole(*given)._replace(rad=0 * whole(*given).rad))
    assert missed() > 0.5 * np.pi * width**2


def test_memory_is_proportional_to_the_mesh():
    """The result has 64 bytes a triangle; with numbers of blocks and of the last coarser level 300."""
    mesh = structured(square(), 1 / 256)
    assert mesh.areas.size == mesh.longest_edges.size
    tracemalloc.start()
    enclosed(mesh, Source(SMOOTH))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= 300 * len(mesh.triangles)
