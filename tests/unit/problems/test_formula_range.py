"""Guaranteed ranges of formulas in polygons: against known ranges, and where there are none."""

import numpy as np
import pytest
import sympy
from symbolic import X, plain

from unilateral.formulas.formula import compile_numpy, parse_formula
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.problems import formula_range
from unilateral.problems.formula_range import RANGE_TOLERANCE_PER_SPREAD, range_in_polygon

TRIANGLE = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), "triangle")


@pytest.mark.parametrize(
    ("text", "minimum", "largest"),
    [
        ("x*(1 - x)", 0, 1 / 4),
        ("sin(7*x)", -1, 1),
        ("cos(x - y)", np.cos(1), 1),
        ("(x - 1/2)**2 - (y - 1/3)**4", -((2 / 3) ** 4), 1 / 4),
        ("1/(x**2 - x + 1)", 1, 4 / 3),
        ("exp(-3*x)*y", 0, 1),
        ("pos(x - 1/2, 0)", 0, 1),
        ("pos(x - y, 3/2) - pos(y - x, 1)", -1, 1),
        ("cosh(2*x - 1) + tanh(y) + sinh(-y)", 1 + np.tanh(1) - np.sinh(1), np.cosh(1)),
        ("1e-150*x - 5e-150", -5e-150, -4e-150),
        ("7", 7, 7),
        ("1 - 2*pos(1e-4 - (x - 0.14)**2, 1)*10000", -1, 1),
        ("(16*x*(1-x)*y*(1-y))**6", 0, 1),
        ("((x+y)/2)**100", 0, 1),
        ("1/cosh(10**4*(x-1/3))", 0, 1),
        ("x**2 - 2*x*y + y**2", 0, 1),
        ("exp(36*x)*exp(-60*x**2)*exp(-27/5)", np.exp(-60 * 0.7**2), 1),  # exp(-60 (x - 3/10)^2)
    ],
)
def test_known_ranges_are_enclosed_sharply(text, minimum, largest):
    """On the unit square: not inside the range, and no wider than the stated sharpness."""
    lower, upper = range_in_polygon(square(), parse_formula(text, ("x", "y"), "here"))
    slack = 4 * RANGE_TOLERANCE_PER_SPREAD * (largest - minimum) + 1e-8 * abs(minimum)
    assert minimum - slack <= lower <= minimum
    assert largest <= upper <= largest + slack


def test_samples_alone_miss_a_narrow_well():
    """Control: the narrow well above lies between the points of a grid."""
    formula = parse_formula("1 - 2*pos(1e-4 - (x - 0.14)**2, 1)*10000", ("x", "y"), "here")
    grid = np.linspace(0, 1, 33)
    assert compile_numpy([formula], "xy")(grid, grid)[0].min() == 1


@pytest.mark.parametrize("text", ["1/x", "1/(x - 1/3)", "1/(x - y)**2", "exp(1000*x)**9", "x/(y - 1/7)"])
def test_an_unbounded_formula_has_an_infinite_bound(text):
    """Samples would hardly find it."""
    assert np.inf in np.abs(range_in_polygon(square(), parse_formula(text, ("x", "y"), "here")))


@pytest.mark.parametrize(
    ("polygon", "minimum"), [(TRIANGLE, -1.0), (find_polygon("lshape"), -1.0), (square(), -2.0)]
)
def test_only_the_polygon_counts(polygon, minimum):
    """-x - y, or 1 - x - y at the L-shape's far corner (1, 1), and a pole outside of the triangle."""
    formula = parse_formula("-x - y" if polygon.name != "lshape" else "1 - x - y", ("x", "y"), "here")
    assert range_in_polygon(polygon, formula)[0] == pytest.approx(minimum, abs=2e-2)
    pole = parse_formula("1/(21/20 - x - y)", ("x", "y"), "here")
    assert np.isfinite(range_in_polygon(TRIANGLE, pole)[1])


@pytest.mark.parametrize("beyond", [0.1, 0.02])
def test_a_vertex_that_hardly_reaches_into_a_box_counts(beyond):
    """The first boxes end at 1/2; the peak, of height 1 but for rounding of the vertex, is beyond."""
    position = 0.5 + beyond
    kite = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [position, position], [0.0, 1.0]]), "kite")
    peak = parse_formula(f"exp(-10000*((x - {position})**2 + (y - {position})**2))", ("x", "y"), "here")
    assert range_in_polygon(kite, peak)[1] >= 1 - 1e-12


def test_boxes_that_touch_the_polygon_but_for_rounding_count():
    """A vertex is the corner of each box, far from the origin; the middles of boxes are rounded."""
    polygon = Polygon(square().vertices + 1e6 / 3, "far")
    vertex = polygon.vertices[0]
    sizes = 10.0 ** np.random.default_rng(1).uniform(-9, -2, (500, 2))
    boxes = np.stack([vertex - sizes, np.broadcast_to(vertex, sizes.shape)], axis=2)
    assert formula_range._locate_boxes(polygon, boxes)[0].all()
    half = 0.5 * np.hypot(*(boxes[..., 1] - boxes[..., 0]).T)
    assert np.any(np.hypot(*(boxes.mean(axis=2) - vertex).T) > half)


@pytest.mark.parametrize(("power", "place"), [(2, 100), (4, 20)])
def test_a_bound_is_sharp_where_terms_cancel(power, place):
    """(x - a)^p on [a, a + 1], expanded: its range is [0, 1]."""
    shifted_polygon = Polygon(square().vertices + np.array([place, 0.0]), "moved")
    lower, upper = range_in_polygon(shifted_polygon, plain(sympy.expand((X - place) ** power)))
    assert -3 * RANGE_TOLERANCE_PER_SPREAD <= lower <= 0
    assert 1 <= upper <= 1 + 3 * RANGE_TOLERANCE_PER_SPREAD


def test_many_sides_take_little_memory():
    """1000 sides and boxes in the thousands: never all distances at once."""
    angles = 2 * np.pi * np.arange(1000) / 1000
    wheel = Polygon(np.column_stack([np.cos(angles), np.sin(angles)]), "wheel")
    lower, upper = range_in_polygon(wheel, parse_formula("sin(40*x)*cos(30*y)", ("x", "y"), "here"))
    assert (lower, upper) == (pytest.approx(-1, abs=1e-2), pytest.approx(1, abs=1e-2))
