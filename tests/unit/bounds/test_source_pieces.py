"""Pieces of triangles, cut at jumps: f is known at the places, not at the rounded ones, and on slivers."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from sources import HATS, Source, mean
from sympy import Rational

from unilateral.bounds import source_pieces
from unilateral.bounds.source import enclose_function
from unilateral.bounds.source_pieces import SOURCE_DEGREE, hat_means
from unilateral.formulas.expression import Primitive
from unilateral.formulas.taylor import TaylorModel, monomial_basis
from unilateral.geometry import mesh as meshes
from unilateral.geometry.curves import Kink, area_in_disc
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_structured_mesh

K = 40


def test_corners_whose_coordinates_cancel_are_off_by_their_rounding():
    """f = x on pieces near x = 0 of a large triangle; their barycentric corners are exact, sums of 2^-40.

    x at the corners, by rational numbers, is within the bound of |f - p|. Control: p is off by more than the
    rounding of numbers as small as that.
    """
    x = np.array([-1e6 / 3, 1e6 / 3 + 0.1, 0.3])
    y = np.array([-1e6 / 7, -1e6 / 7, 1e6 / 3])
    points = np.column_stack([x, y])
    unit = 2.0**-40
    mesh = meshes.from_arrays(Polygon(points, "large"), points, [[0, 1, 2]])
    corner_values = x[mesh.triangles[0]].tolist()
    first = 1 / 3 + 1e-7 * np.random.default_rng(1).uniform(-1, 1, (K, 2))
    first = unit * np.round(first / unit)
    first = np.column_stack([first, 1 - first.sum(axis=1)])
    corners = np.stack([first, first + 9e4 * unit * np.array([1, -1, 0]), first], axis=1)
    corners[:, 2] += 9e4 * unit * np.array([0, 1, -1])
    assert np.all(corners.sum(axis=2) == 1)
    block = source_pieces.enclose_block(mesh, corners, np.zeros(K, dtype=int), Source("x"))
    worst = 0.0
    for k, expected in enumerate(np.sqrt(block.remainder_squares / block.outer_area)):
        c, *slopes = [Fraction(float(coefficient)) for coefficient in block.c[:3, k]]
        at_corners = (c - slopes[0] - slopes[1], c - slopes[0] + slopes[1], c + slopes[0] - slopes[1])
        for p, weights in zip(at_corners, block.corners[k].tolist(), strict=True):
            exact = sum(
                Fraction(b) * Fraction(value) for b, value in zip(weights, corner_values, strict=True)
            )
            assert abs(p - exact) <= expected
            worst = max(worst, float(abs(p - exact)))
    assert worst > 1e-12


def test_the_rounding_of_sums_over_p_is_known():
    """Of its means with hats, against rational numbers."""
    basis = monomial_basis(2, SOURCE_DEGREE)
    rng = np.random.default_rng(1)
    c = rng.standard_normal((len(basis.degrees), 50)) * 10.0 ** rng.uniform(-3, 3, 50)
    zero = np.zeros(c.shape[1])
    known_remainder_bound = source_pieces._remainder_bound(TaylorModel(basis, c, zero, (zero, zero)))
    _, x, y = HATS
    monomials = [(2 * x - 1) ** i * (2 * y - 1) ** j for i, j in basis.exponents.tolist()]
    displaced = []
    for hat, values in zip(HATS, hat_means() @ c, strict=True):
        weights = [mean(hat * monomial) for monomial in monomials]
        for value, column, at_most in zip(values, c.T.tolist(), known_remainder_bound, strict=True):
            exact = sum(w * Rational(item) for w, item in zip(weights, column, strict=True))
            displaced.append(abs(Rational(float(value)) - exact) / Rational(float(at_most)))
    assert 1e-3 < max(displaced) <= 1


def test_where_rounding_hides_the_side_of_a_curve_a_step_may_have_both_values():
    """Points on a circle far from the origin but for rounding, each a piece; it puts them on either side."""
    kink = Kink((1e6 / 3, 1e6 / 7), 0.3)
    angle = np.random.default_rng(1).uniform(0, 2 * np.pi, 500)
    points = np.array(kink.centre) + 0.3 * np.column_stack([np.cos(angle), np.sin(angle)])
    _, wrong = source_pieces.step_values(
        np.repeat(points[:, None], 3, axis=1), {Primitive("step"): kink}, 1e6
    )
    assert not np.isnan(wrong[Primitive("step")]).any()
    level = kink.signed_distances(points)
    assert (level > 0).any()
    assert (level < 0).any()


def test_the_bound_counts_two_jumps_that_are_wrong_at_once():
    """f is 1 in both of two discs that are nearly the same, on a small triangle that their arcs cross.

    In pieces beside the chords p is 0, and each step alone changes nothing; ||f - p|| by points of a grid.
    """
    near = "pos(1/16 - (x - 1/2 - 1/{})**2 - (y - 1/2)**2, 0)"
    source = Source(f"{near.format(10**9)}*{near.format(10**5)}")
    triangle = np.array([[0.74, 0.49], [0.76, 0.49], [0.75, 0.51]])
    mesh = meshes.from_arrays(Polygon(triangle, "small"), triangle, [[0, 1, 2]])
    pieces, _ = source_pieces.enclose_pieces(mesh, np.eye(3)[None], np.zeros(1, dtype=int), source)
    u = (np.stack(np.meshgrid(*2 * [np.arange(1000)]), axis=-1).reshape(-1, 2) + 0.5) / 1000
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
    hats = np.column_stack([1 - u.sum(axis=1), u])
    values = (
        source.value(*(hats @ corners @ triangle).T)[0] for corners in pieces.corners
    )  # a piece at a time
    squares = np.array([np.mean((f - p) ** 2) for f, p in zip(values, pieces.c[0], strict=True)])
    norms = np.sqrt(squares * pieces.area)
    areas = pieces.area
    assert np.all(norms <= np.sqrt(pieces.remainder_squares) + pieces.jump_norm + 1e-3 * np.sqrt(areas))
    assert np.any((norms > 3e-3 * np.sqrt(areas)) & (pieces.c[0] == 0))


def test_areas_in_a_disc_are_those_by_sums_over_points():
    """Of random triangles, against sums over 250000 points; of one that holds the disc and one inside it."""
    rng = np.random.default_rng(1)
    vertices = rng.uniform(-1.5, 1.5, (40, 3, 2))
    areas = area_in_disc(vertices, 0.8)
    u = rng.random((250_000, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
    for triangle, area in zip(vertices, areas, strict=True):
        edges = triangle[1:] - triangle[0]
        points = triangle[0] + u @ edges
        full = 0.5 * abs(np.linalg.det(edges))
        assert area == pytest.approx(full * np.mean(np.hypot(*points.T) < 0.8), abs=4e-3 * full + 1e-12)
    shape = np.array([[[-1, -1], [1, -1], [0, 1.0]]])
    assert area_in_disc(10 * shape, 0.8) == pytest.approx(np.pi * 0.64, rel=1e-13)
    assert area_in_disc(0.1 * shape, 0.8) == pytest.approx(0.02, rel=1e-13)


@pytest.mark.parametrize("kink", [Kink((0.3017, 0.4), 0.0, (0.6, 0.8)), Kink((0.5, 0.5), 0.25)])
def test_pieces_cut_at_a_curve_are_the_triangle_again(kink):
    """Areas add up; every piece lies on one side of a line, and of a circle up to d^2/4R, d its diameter."""
    mesh = make_structured_mesh(square(), 1 / 64)
    corners = np.broadcast_to(np.eye(3), (len(mesh.triangles), 3, 3))
    pieces, owner = source_pieces.split_at_jumps(
        mesh, corners, np.arange(len(corners)), {Primitive("step"): kink}
    )
    shares = np.abs(np.linalg.det(pieces))
    np.testing.assert_allclose(np.bincount(owner, shares), 1, rtol=1e-12)
    assert len(pieces) > len(corners)
    vertices = pieces @ mesh.points[mesh.triangles[owner]]
    level = kink.signed_distances(vertices.reshape(-1, 2)).reshape(-1, 3)
    near = 2 / 64**2 / (4 * kink.radius) if kink.radius else 1e-14
    assert np.all((level.min(axis=1) > -near) | (level.max(axis=1) < near))


def test_a_piece_whose_centroid_lies_on_a_circle_is_on_one_side():
    """The integral by a strip quadrature to 12 digits; the same with the step written the other way."""
    corners = np.array([[1023 / 1024, -1 / 16], [1 + 2 / 1024, 0], [1023 / 1024, 1 / 16]])
    assert np.hypot(*corners.mean(axis=0)) == 1
    mesh = meshes.from_arrays(Polygon(corners, "sliver"), corners, [[0, 1, 2]])
    for text in ("pos(x**2 + y**2 - 1, 0) + y", "1 - pos(1 - x**2 - y**2, 0) + y"):
        enclosure = enclose_function(mesh, Source(text))
        assert enclosure.moments().sum() == pytest.approx(0.000125569401688, abs=1e-13)


def test_pieces_count_for_the_gaps_between_them():
    """Corners at 1e6 are rounded by 1e-10, a tenth of what a piece of 1e-9 is wide."""
    corners = 1e6 + 1e-9 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    mesh = meshes.from_arrays(
        Polygon(1e6 * square().vertices, "large"), 1e6 * square().vertices, [[0, 1, 2], [0, 2, 3]]
    )
    inside = (corners - 1e6) / 1e6
    bary = np.stack([1 - inside[:, 0], inside[:, 0] - inside[:, 1], inside[:, 1]], axis=1)
    pieces = source_pieces.enclose_block(mesh, bary[None], np.array([0]), Source("x"))
    assert pieces.outer_area[0] > 1.2 * pieces.area[0]


SLOPE = 50
CORNERS = np.array([[0.98, -0.03], [1.02, -0.02], [0.99, 0.05]])


def integrate_in_disc(y):
    """The integral of 1 + SLOPE x along y in the triangle with CORNERS and the unit disc."""
    ends = []
    for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        t = (y - a[1]) / (b[1] - a[1])
        if 0 <= t <= 1:
            ends.append(a[0] + t * (b[0] - a[0]))
    low = min(ends)
    high = min(max(ends), np.sqrt(1 - y**2))
    return (high - low) + SLOPE / 2 * (high**2 - low**2) if high > low else 0.0


def test_slivers_between_chords_and_a_circle_count_in_the_integral():
    """Of f = 1 + 50 x in a disc, 0 outside, on a triangle that the circle cuts, by strips.

    The jump is not constant along the circle, so that the slivers' share is known up to its variation only.
    """
    mesh = meshes.from_arrays(Polygon(CORNERS, "triangle"), CORNERS, [[0, 1, 2]])
    enclosure = enclose_function(mesh, Source(f"pos(1 - x**2 - y**2, 0)*(1 + {SLOPE}*x)"))
    cuts = np.linspace(-0.03, 0.05, 401)
    exact = sum(quad(integrate_in_disc, a, b, epsabs=1e-16)[0] for a, b in pairwise(cuts))
    away = abs(exact - enclosure.moments().sum())
    assert 1e-12 < away <= enclosure.remainder[0] * np.sqrt(mesh.areas[0])
