"""Checkers without one part print bounds below the true error. The checker itself does not.

Each attack is a certificate of one to eight triangles that was made to fool the checker without that part.
The true error is worked out by hand from the u that is named beside it, or bounded from below by a test
function. The checker with all parts refuses the attack, or prints a bound that holds.

Some parts have no attack. A checker without one of them still proves what it prints, or no error is defined:

- The polygon is simple. The theorem holds on the surface that the triangles make, which may overlap itself.
  Without this check the printed vertices may fail to describe a domain.
- Places on a side grow, and the polygon is anticlockwise. Anticlockwise triangles whose edges inside cancel
  cover no point around which the boundary does not wind, so otherwise there is no triangulation.
- Two triangles lie on different sides of an edge. Otherwise v may have two values at a point.
- j is rounded downwards: 3.83170597.. is the best constant.
- u_D does not jump. If it does there is no u.
- c d^2 > k, where a bound by parts is tried. It holds on every triangle.
- By parts f - c v is not rho. They differ by div p, a constant, and (div p, z)_T is the sum of the
  <b_e, mean of z>_e. With rho the <b_e, z - mean of z>_e are left, whose sum is at most G a |||z|||, too.
- The least of two bounds is taken, and of two C. The larger ones hold, too.
- What f is off a quadratic function: polynomials are not. test_formulas.py attacks it.
"""

from fractions import Fraction
from typing import NamedTuple

import pytest
from known_certificates import certificate, checker, polynomial, value, written

GENUINE = checker()
RIGHT = 1
LEFT = 3
"""Sides of a rectangle: side 0 is the bottom."""
NOTHING = polynomial()


def rectangle(sides, length=1, **options):
    """Two triangles on [0, length] x [0, 1]; sides without a condition in `sides` are free, t = 0."""
    corners = [(0, 0), (length, 0), (length, 1), (0, 1)]
    conditions = [sides.get(side, ("free", NOTHING)) for side in range(4)]
    options.setdefault(
        "field", lambda x, y: (x - length, 0)
    )  # leaves through the side on the left only, div b = 1
    return certificate(corners, conditions, triangles=[(0, 1, 2), (0, 2, 3)], **options)


class Attack(NamedTuple):
    """A part of the checker, the edit that removes it, a certificate, and a lower bound on its true error.

    The error is |||u - v||| or, if `is_dual`, the dual norm of k du/dn - p.n.
    """

    checker_part: str
    text: str
    replacement: str
    certificate: dict
    error: float
    is_dual: bool = False


def clamp_polynomial(**coefficients):
    return "clamped", polynomial(**coefficients)


def contact(**coefficients):
    return "contact", polynomial(**coefficients)


def free(**coefficients):
    return "free", polynomial(**coefficients)


def negative_pressure():
    """u = 0 is above g = -1; v = -x is pulled down to g."""
    return rectangle(
        {LEFT: clamp_polynomial(), RIGHT: contact(one=-1)}, v=lambda x, y: -x, p=lambda x, y: (-1, 0)
    )


def penetration():
    """u = x, as g = 1 at x = 1; v = 0 is below g there."""
    return rectangle({LEFT: clamp_polynomial(), RIGHT: contact(one=1)})


def penetration_between_nodes():
    """g = 4 y (1 - y) at x = 1 is 0 at nodes, as v is. |u|_1 >= the integral of u_x >= that of g, 2/3."""
    return rectangle(
        {LEFT: clamp_polynomial(), RIGHT: contact(y=4, yy=-4)},
        trace=lambda x, y: 0,
    )


def cubic_obstacle():
    """g = 64 y (1 - y) (1 - 2 y) at x = 1 is 0 at both nodes and in the middle, as v is.

    For y < 1/2 the integral of u_x is at least that of g, 2; so |u|_1 >= 2 * 2^(1/2) there.
    """
    return rectangle({LEFT: clamp_polynomial(), RIGHT: contact(y=64, yy=-192, yyy=128)})


def hole():
    """u = 1 for f = c = 1; v = 0. The middle of the square has no triangles, and p carries f there.

    On a thin ring |p| is small. The error is taken on the ring alone: the root of its area.
    """
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    inside = [(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)]
    triangles = []
    flux = []
    for i in range(4):
        j = (i + 1) % 4
        # A triangle at the boundary, of area 1/8, and one at the hole, of area 1/16; div p = -1 on both
        triangles += [(i, j, 4 + j), (4 + j, 4 + i, i)]
    outflow = {}
    for i in range(4):
        j = (i + 1) % 4
        outflow[4 + j, i] = -1 / 8  # of the former, through the edge between them
        outflow[4 + j, 4 + i] = -1 / 8 - 1 / 16  # of the latter, into the hole
    mentioned = set()
    for triangle in triangles:
        for i, j in ((1, 2), (2, 0), (0, 1)):
            first = triangle[i]
            last = triangle[j]
            if (last, first) not in mentioned:
                mentioned.add((first, last))
                flux += [outflow.get((first, last), 0.0) / 2] * 2
    return certificate(
        corners, [free()] * 4, f=polynomial(one=1), c=1, inside=inside, triangles=triangles, p=flux
    )


def cut_corners():
    """u = 1 for f = c = 1; v = 0. The mesh covers half of the square."""
    return certificate(
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        [free()] * 4,
        f=polynomial(one=1),
        c=1,
        boundary=[[0.5]] * 4,
        triangles=[(0, 1, 2), (0, 2, 3)],
    )


def fold():
    """u = 0 on a clamped square; v = 1 at the node (5/4, 1/2), so the triangle at the right is clockwise.

    That triangle lies outside the square. On the triangle at the left |grad v| = 4/5, and an area of 3/5 is
    inside. On each of the two others |grad v| = 2, and 1/5 is inside. The squares are 0.384, 0.8 and 0.8.
    """
    return certificate(
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        [clamp_polynomial()] * 4,
        inside=[(1.25, 0.5)],
        triangles=[(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)],
        v=lambda x, y: int(x == Fraction(5, 4)),
        field=lambda x, y: (x - 2, 0),
    )


def pull():
    """u = x, as t = 1 at x = 1; v = 0."""
    return rectangle({LEFT: clamp_polynomial(), RIGHT: free(one=1)})


def soft_pull():
    """k = t = 1/64 at x = 1, so that u = x; v = 0, p = k grad u. |||u||| = S = k^(1/2), but |p| = k."""
    k = Fraction(1, 64)
    return rectangle({LEFT: clamp_polynomial(), RIGHT: free(one=k)}, k=k, p=lambda x, y: (k, 0))


def given_ends():
    """u = x is given at x = 0 and x = 1; v = 0."""
    return rectangle({LEFT: clamp_polynomial(), RIGHT: clamp_polynomial(x=1)}, trace=lambda x, y: 0)


def load(field=lambda x, y: (x - 1, 0)):
    """u = 2 x - x^2, f = 2; v = 0. |u|_1^2 is the integral of (2 - 2 x)^2, 4/3."""
    return rectangle({LEFT: clamp_polynomial()}, f=polynomial(one=2), field=field)


def soft_load():
    """k = 1/100, f = 2, so that u = 100 (2 x - x^2); v = 0. |||u|||^2 = 4/3/k."""
    return rectangle({LEFT: clamp_polynomial()}, f=polynomial(one=2), k=Fraction(1, 100))


def field_through_long_sides():
    """u = 8 x - x^2/2 on a length of 8, f = 1; v = 0. |u|_1^2 = 8^3/3. b = (0, y - 1/2) would make C = 1."""
    return rectangle(
        {LEFT: clamp_polynomial()}, length=8, f=polynomial(one=1), field=lambda x, y: (0, y - Fraction(1, 2))
    )


def waves():
    """f = 1 - 6 x + 6 x^2 has the mean 0 on both triangles; v = 0.

    u = -x^2 (1 - x)^2/2, and |u|_1^2 is the integral of x^2 (1 - x)^2 (1 - 2 x)^2, which is 1/210.
    """
    return rectangle({LEFT: clamp_polynomial()}, f=polynomial(one=1, x=-6, xx=6))


def pressure_in_a_gap():
    """u = 0, g = 0; v = x is 1 above g at x = 1, and p.n = 1/2 there: S^2 = 1/4, B = 1/2, and X^2 = 1."""
    return rectangle(
        {LEFT: clamp_polynomial(), RIGHT: contact()}, v=lambda x, y: x, p=lambda x, y: (Fraction(1, 2), 0)
    )


def make_raised_certificate():
    """u = 0, g = 0; v = x, y = -x and p = (2, 0). D = 1, B = 0, the S of v is 1, that of v + y is 2.

    As du/dn = 0, the dual norm of du/dn - p.n is that of 2 at x = 1: z = x shows that it is at least 2.
    """
    return rectangle(
        {LEFT: clamp_polynomial(), RIGHT: contact()},
        v=lambda x, y: x,
        p=lambda x, y: (2, 0),
        trace=lambda x, y: 0,
    )


def needle():
    """f = 3 x - 2 has the mean 0 on the triangle (0, 0), (1, -1/64), (1, 1/64); no side has a flux; v = 0.

    Let z = x^2/2 - x^3/3. As (x z')' = -x f, (f, z) = |z|_1^2 = 1/64/30. Also ||z|| <= |z|_1. So |||u||| >=
    (f, z)/|||z||| >= |z|_1 (1 + c)^(-1/2), which is 0.99 d/3.8317 ||f||.
    """
    width = Fraction(1, 64)
    corners = [(0, 0), (1, -width), (1, width)]
    load = polynomial(one=-2, x=3)
    return certificate(corners, [free()] * 3, load, c=Fraction(1, 10**6), triangles=[(0, 1, 2)])


def soft_pull_with_reaction():
    """k = t = 1/64 at x = 1, and f = c x, so that u = x; v = 0. S^2 = |||u|||^2 = k + c/3."""
    k = Fraction(1, 64)
    c = Fraction(1, 1000)
    pulled = {LEFT: clamp_polynomial(), RIGHT: free(one=k)}
    return rectangle(pulled, f=polynomial(x=c), k=k, c=c, p=lambda x, y: (k, 0), field=None)


def weak_reaction():
    """u = 100 for f = 1, c = 1/100; v = 0. |||u|||^2 = 100."""
    return rectangle({}, f=polynomial(one=1), c=Fraction(1, 100), field=None)


def strong_reaction():
    """u = 1/2 for f = 2, c = 4; v = 0. |||u|||^2 = 1."""
    return rectangle({}, f=polynomial(one=2), c=4, field=None)


def layer():
    """u = sinh(100 x)/cosh(200), as k = 1/100, c = 100 and t = 1 at x = 2; v = 0.

    |||u|||^2 = <1, u> = tanh 200. p.n = t at x = 2, and 0 on all other edges.
    """
    flux = [1, 1] + [0] * 8
    pulled = {LEFT: clamp_polynomial(), RIGHT: free(one=1)}
    return rectangle(pulled, length=2, k=Fraction(1, 100), c=100, p=flux, field=None)


def small_triangle(side, **options):
    """The triangle with sides of 4, 5 and 3, where p.n = 1 all around; k = 1 and c = 1/20, so c d^2 = 5/4.

    Let R be the residual of v = 0. If |R(1)| = r, then its norm is at least r/|||1||| = r/(6 c)^(1/2).
    """
    corners = [(0, 0), (4, 0), (0, 3)]
    flux = [5, 5, 3, 3, 4, 4]
    return certificate(corners, [side] * 3, c=Fraction(1, 20), triangles=[(0, 1, 2)], p=flux, **options)


def load_and_pull():
    """f = 2, and t = 1 all around; v = 0. |||u||| is the norm of (f, z) + <t, z>, 12 + 12 for z = 1."""
    return small_triangle(free(one=1), f=polynomial(one=2))


def bent():
    """u = 0, f = 0, g = v + y = ((x - 1)^2 + (y - 1)^2 - 10)/2 <= 0, and v interpolates g.

    The circle around (1, 1) with the radius 1 touches all sides, so d(v + y)/dn = 1 = p.n there, and
    2 - c (v + y) is left of the residual of v + y: a bound by parts would miss the 2. The dual norm of
    du/dn - p.n is that of -1, and z = 1 has the integral 12.
    """
    g = polynomial(one=-4, x=-1, y=-1, xx="1/2", yy="1/2")
    return small_triangle(("contact", g), v=lambda x, y: value(g, x, y))


THREE_SIDES = 12 / (6 / 20) ** 0.5
NEEDLE = (1 / 64 / 30 / (1 + 1e-6)) ** 0.5


ATTACKS = [
    Attack("p.n >= 0 on contact sides", "first >= 0 and last >= 0", "True", negative_pressure(), 1),
    Attack("v + y >= g", "require(above,", "require(True,", penetration(), 1),
    Attack(
        "v + y >= g between nodes",
        "(b >= 0 or b * b <= a * c)",
        "True",
        penetration_between_nodes(),
        2 / 3,
    ),
    Attack("degrees along sides", "require(not any(third)", "require(True", cubic_obstacle(), 8**0.5),
    Attack(
        "edges of triangles cancel", "all(edge[::-1] in owner for edge in owner)", "True", hole(), 0.75**0.5
    ),
    Attack("places start at 0", "places[:1] == [0] and ", "", cut_corners(), 1),
    Attack(
        "triangles are anticlockwise",
        "cross(*(self.nodes[i] for i in triangle)) > 0",
        "True",
        fold(),
        1.984**0.5,
    ),
    Attack("t - p.n on free sides", "sum2 += ", "sum2 += 0 * ", pull(), 1),
    Attack(
        "v + y = u_D",
        "w[i], w[j], w[self.mesh.nb + i] = first, last, (first + 2 * bend + last) / 4",
        "pass",
        given_ends(),
        1,
    ),
    Attack("|||y|||", "2 * B + D2)[1]\n        return X", "2 * B)[1]\n        return X", given_ends(), 1),
    Attack(
        "div b >= 1",
        "mesh.D**2 * sum(map(sum, out)) >= self.U * area",
        "True",
        load(lambda x, y: (0, 0)),
        (4 / 3) ** 0.5,
    ),
    Attack("b.n <= 0", "require(inward or", "require(True or", field_through_long_sides(), (8**3 / 3) ** 0.5),
    Attack("mean of rho", " + C * root(M2)[1]", "", load(), (4 / 3) ** 0.5),
    Attack("1/k", "root(A2 / k)[1] + C", "root(A2)[1] + C", soft_pull(), 1 / 8),
    Attack(
        "k in C",
        "self.friedrichs_constant() / root(k)[0]",
        "self.friedrichs_constant()",
        soft_load(),
        (400 / 3) ** 0.5,
    ),
    Attack(
        "rho - mean of rho",
        "o2 = divide_up(",
        "o2 = 0 * divide_up(",
        waves(),
        210**-0.5,
    ),
    Attack("d is the longest edge", "d2 = Q(max(", "d2 = Q(min(", needle(), NEEDLE),
    Attack("j", "J = Q(38317, 10**4)", "J = Q(4)", needle(), NEEDLE),
    Attack(
        "S of v + y",
        "min(root(D2)[1] + X, root(S_w**2",
        "min(root(D2)[1] + X, root(S_v**2",
        make_raised_certificate(),
        2,
        is_dual=True,
    ),
    Attack(
        "|||y||| once more", "min(root(D2)[1] + X, ", "min(X, ", make_raised_certificate(), 2, is_dual=True
    ),
    Attack(
        "B", "2 * B + D2)[1]\n        return X", "0 * B + D2)[1]\n        return X", pressure_in_a_gap(), 1
    ),
    Attack("2 B", "2 * B + D2)[1]\n        return X", "B + D2)[1]\n        return X", pressure_in_a_gap(), 1),
    Attack("c > 0 where C = c^(-1/2)", "min(pair) if c else pair[0]", "min(pair)", load(), (4 / 3) ** 0.5),
    Attack("c in C", "root(1 / c)[1]", "Q(1)", weak_reaction(), 10),
    Attack("1/k beside M^2/c", "A2 * kd * cn", "A2 * kn * cn", soft_pull_with_reaction(), 1 / 8),
    Attack("1/c beside A^2/k", "M2 * cd * kn", "M2 * cn * kn", weak_reaction(), 10),
    Attack("f - c v by parts", "inside2 = ", "inside2 = 0 * ", strong_reaction(), 1),
    Attack(
        "1/c by parts",
        "add_up(rest2, doubt2) * cd, cn",
        "add_up(rest2, doubt2), 1",
        load_and_pull(),
        2 * THREE_SIDES,
    ),
    Attack(
        "norms inside and on edges are added",
        "add_up(inside2, self.edge_terms(X, misfit, kd * N * W))",
        "inside2 + self.edge_terms(X, misfit, kd * N * W)",
        load_and_pull(),
        2 * THREE_SIDES,
    ),
    Attack(
        "a is a sum",
        "math.ceil(a * a *",
        "math.ceil(sum(weight * weight for weight in weights) *",
        load_and_pull(),
        2 * THREE_SIDES,
    ),
    Attack("a_e of each edge", "a = sum(weights)", "a = sum(weights[1:])", layer(), 1),
    Attack("|T| in a_e", ") * 2 * D**2", ") * D**2", layer(), 1),
    Attack("p.n at both ends of e", "p * p + p * q + q * q", "p * q", layer(), 1),
    Attack("R", "R2 * c / k", "0", layer(), 1),
    Attack("R is the largest distance", "R2 = Q(max(", "R2 = Q(min(", layer(), 1),
    Attack("R is measured from x_0", "w * (p - q)", "Q(a, 3) * (p - q)", layer(), 1),
    Attack("1/k in G", "R2 * c / k", "R2 * c", layer(), 1),
    Attack("1/(2 c) in G", "/ (2 * c))", "/ (4 * c))", layer(), 1),
    Attack("v is linear", "is_linear and ratio", "ratio", bent(), THREE_SIDES, is_dual=True),
]


def bound(module, attack):
    """What the module prints of the attack, or None if it refuses."""
    try:
        return module.Certificate(written(attack.certificate)).bounds()[attack.is_dual]
    except module.Refused:
        return None


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.checker_part)
def test_a_checker_without_a_line_prints_a_bound_below_the_error(attack):
    lie = bound(checker((attack.text, attack.replacement)), attack)
    assert lie is not None
    assert lie < 0.99 * attack.error


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.checker_part)
def test_the_checker_itself_refuses_or_its_bound_holds(attack):
    answer = bound(GENUINE, attack)
    assert answer is None or answer >= attack.error


@pytest.mark.parametrize(("rounding", "holds"), [("ROUND_CEILING", True), ("ROUND_FLOOR", False)])
def test_six_digits_are_rounded_upwards(rounding, holds):
    """u = x on a length of 2 and p = grad u, so S is the error of v = 0: 2^(1/2) = 1.414213..."""
    stated = rectangle({LEFT: clamp_polynomial(), RIGHT: free(one=1)}, length=2, p=lambda x, y: (1, 0))
    module = checker(("rounding=decimal.ROUND_CEILING", f"rounding=decimal.{rounding}"))
    printed = module.upward(module.Certificate(written(stated)).bounds()[0])
    assert (Fraction(printed) ** 2 >= 2) == holds
