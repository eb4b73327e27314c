"""Roots of what is above 0, and irrational numbers in the arguments of pos, against closed forms."""

import mpmath
import numpy as np
import pytest
import sentences
import skfem

import unilateral as ul
from unilateral.bounds import source
from unilateral.bounds.source_ancestors import TARGET_REMAINDER_RATIO
from unilateral.errors import InputError
from unilateral.formulas.formula import parse_formula
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.problem import zero_curve

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("f", "integral"),
    [
        ("-2*pos(x - pi/4, 0)", -2 * (1 - np.pi / 4)),
        ("pos(sqrt(3)*x - y, 0)", 1 - 0.5 / np.sqrt(3)),
        ("pos(1/pi - (x - 1)**2 - (y - 1)**2, 0)", 1 / 4),
        ("sqrt(1 + x**2)", (np.sqrt(2) + np.arcsinh(1)) / 2),
        ("(x + 1/50)**(-1/3)", 1.5 * (1.02 ** (2 / 3) - 0.02 ** (2 / 3))),
        ("log(2)*pos(x, 0)", np.log(2)),
    ],
)
def test_the_integral_of_f_is_the_closed_form(f, integral):
    """A quarter of the disc of area 1 is 1/4. Control: a number that is off by 1e-4.

    The remainder that is wanted is TARGET_REMAINDER_RATIO h times what f varies by, at most 1/2 for powers.
    """
    enclosure = source.enclose_function(
        make_structured_mesh(square(), 1 / 8), ul.Problem(SQUARE, f=f, g=-9).source
    )
    assert enclosure.remainder_norm <= TARGET_REMAINDER_RATIO / 8 / 2
    assert enclosure.moments().sum() == pytest.approx(integral, abs=enclosure.remainder_norm + 1e-14)
    if "pos" in f:
        assert enclosure.remainder_norm <= 1e-10
        assert enclosure.moments().sum() != pytest.approx(integral + 1e-4, abs=enclosure.remainder_norm)


@pytest.mark.filterwarnings("error")
def test_the_integral_over_a_jump_beside_a_root_is_the_closed_form():
    """With d = 1/1000, H'' = (t^2 + d)^(1/2): the integral is H(2/3) - H(0) + H(1) - H(1/3).

    On a piece that x = y crosses the terms of (x - y)^2, multiplied out, may be as small as -2.
    """
    enclosure = source.enclose_function(
        make_structured_mesh(square(), 1 / 2),
        ul.Problem(SQUARE, f="pos(x - 1/3, 0)*sqrt(x**2 - 2*x*y + y**2 + 1/1000)", g=-9).source,
    )
    d = 1e-3

    def H(t):
        root = np.sqrt(t**2 + d)
        return root**3 / 6 + d / 2 * (t * np.arcsinh(t / np.sqrt(d)) - root)

    assert enclosure.remainder_norm <= 1e-4
    assert enclosure.moments().sum() == pytest.approx(
        H(2 / 3) - H(0) + H(1) - H(1 / 3), abs=enclosure.remainder_norm
    )


@pytest.mark.parametrize(
    ("a", "exact"),
    [
        ("x - pi/4", lambda m: (1, 0, -m.pi / 4)),
        ("sqrt(3)*x - y", lambda m: (m.sqrt(3), -1, 0)),
        ("pi*x + sqrt(2)*y - exp(1)", lambda m: (m.pi, m.sqrt(2), -m.e)),
        ("x/pi - 1000*y/sqrt(7)", lambda m: (1 / m.pi, -1000 / m.sqrt(7), 0)),
    ],
)
def test_a_line_with_irrational_numbers_is_the_line_up_to_rounding(a, exact):
    """Its distance from points of the square, by mpmath with 50 digits: within 4 units of 2^-52."""
    (kink,) = zero_curve(parse_formula(a, "xy", "f"))
    points = np.random.default_rng(1).random((20, 2))
    with mpmath.workdps(50):
        slope_x, slope_y, constant = map(mpmath.mpf, exact(mpmath))
        size = mpmath.hypot(slope_x, slope_y)
        distances = [float((slope_x * x + slope_y * y + constant) / size) for x, y in points.tolist()]
    assert kink.signed_distances(points) == pytest.approx(distances, abs=4 * 2.0**-52)


def test_a_bound_holds_where_f_and_u_on_clamped_sides_are_roots():
    """u = (1 + x)^(1/2), -lap u = (1 + x)^(-3/2)/4; its error by quadrature of degree 8.

    Control: the distance from another root is larger than the bound.
    """
    problem = ul.Problem(SQUARE, f="(1 + x)**(-3/2)/4", c=0, u=dict.fromkeys(range(4), "sqrt(1 + x)"))
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    mesh = skfem.MeshTri(s.mesh.points.T.copy(), s.mesh.triangles.T.copy())
    basis = skfem.Basis(mesh, skfem.ElementTriP1(), intorder=8)
    x = np.asarray(basis.global_coordinates())[0]
    slope = basis.interpolate(s.u).grad

    def distance(u_x):
        return np.sqrt(np.sum(((slope[0] - u_x) ** 2 + slope[1] ** 2) * basis.dx))

    error = distance(0.5 / np.sqrt(1 + x))
    assert error <= s.bounds.u <= 2 * error
    assert distance(0.5 / np.sqrt(1.1 + x)) > s.bounds.u


def test_a_root_is_taken_of_what_is_above_0_however_little():
    """The ranges of roots decide it, not that of what is below them: 1e-6 is a millionth of the largest."""
    for f in ("sqrt(x**2 + y**2 + 1e-6)", "sqrt(x + 1e-6)"):
        assert ul.Problem(SQUARE, f=f, g=-9).range_of_f[0] == pytest.approx(1e-3, abs=2e-3)
    with sentences.raises(InputError):
        ul.Problem(SQUARE, f="sqrt(x - 1e-6)", g=-9)


def test_a_positive_part_that_is_offered_is_read():
    """Its value is that of the root where there is one."""
    with sentences.raises(InputError):
        ul.Problem(SQUARE, f="sqrt(x - y)", g=-9)
    assert ul.Problem(SQUARE, f="pos(x - y, 1/2)", g=-9).range_of_f[1] >= 1
