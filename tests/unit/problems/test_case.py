"""Cases: what is derived against independent computations, the certificate, and what it refuses."""

import math
import re
from functools import cache

import numpy as np
import pytest
import sentences
from conftest import case_file, load, load_certificate

from unilateral.errors import InputError
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.formulas.formula import parse_formula
from unilateral.geometry.curves import Kink
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import case as cases
from unilateral.problems.atoms import SidePoints, SmoothAtom
from unilateral.problems.case_certificate import certify_case

POLYGONS = {"square": square(), "lshape": find_polygon("lshape")}
PLACES = [("natural", "square", 0)] + [
    (name, polygon, side)
    for name in ("full_contact", "no_contact", "smooth", "thirds")
    for polygon in POLYGONS
    for side in (range(POLYGONS[polygon].n_sides) if name in ("smooth", "thirds") else [0])
]
GAPS_WITH_KINKS = (
    *(f"borderline_{alpha}" for alpha in (0.25, 0.1, 0.05)),
    "rough",
    "singular",
    "violates_jj",
)
IRREGULAR = {  # the polygon, and whether (j), (jj) and (jjj) hold
    **{
        name: ("square", (True, True, True))
        for name in ("borderline_0.25", "borderline_0.1", "borderline_0.05")
    },
    "vertex": ("square", (True, True, True)),
    "violates_j": ("lshape", (False, True, True)),
    "violates_jj": ("square", (True, False, True)),
    "singular": ("square", (False, False, True)),
    "reentrant": ("lshape", (False, False, True)),
    "reentrant_full": ("lshape", (False, False, True)),
    "rough": ("square", (False, False, True)),
}
on_every_place = pytest.mark.parametrize(("name", "polygon", "side"), PLACES)


def inside(polygon, n):
    """(n, 2) pseudo-random points of the polygon, by rejection from the centroids of a fine mesh."""
    mesh = make_structured_mesh(polygon, 1 / 64)
    centroids = mesh.points[mesh.triangles].mean(axis=1)
    return np.random.default_rng(1).permutation(centroids)[:n]


def differences(f, points, step):
    """Central differences of fourth order: the gradient (k, 2) and the Laplacian (k,)."""
    gradient = np.zeros_like(points)
    laplacian = np.zeros(len(points))
    centre = f(points)
    for axis in range(2):
        e = np.zeros(2)
        e[axis] = step
        m2 = f(points + (-2) * e)
        m1 = f(points + (-1) * e)
        p1 = f(points + 1 * e)
        p2 = f(points + 2 * e)
        gradient[:, axis] = (m2 - 8 * m1 + 8 * p1 - p2) / (12 * step)
        laplacian += (-m2 + 16 * m1 - 30 * centre + 16 * p1 - p2) / (12 * step**2)
    return gradient, laplacian


@on_every_place
def test_derivatives_are_those_of_u(name, polygon, side):
    """Fourth-order differences, step 1e-3, 0.02 away from kinks and singular points: errors below 1e-4."""
    case = load(name, polygon, side)
    step = 1e-3
    points = inside(case.polygon, 400)
    level = [np.abs(kink.signed_distances(points)) for kink in case.kinks()]
    singular = case.singular_points()
    position = case.polygon.at(
        np.array([p.side for p in singular], dtype=np.intp),
        np.array([p.t * case.polygon.lengths[p.side] for p in singular]),
    )
    away = [np.hypot(*(points - p).T) for p in position]
    points = points[np.min([np.ones(len(points)), *level, *away], axis=0) > 0.02]
    assert len(points) > 100
    u, gradient = case.value_and_gradient(points)
    by_differences, laplacian = differences(lambda p: case.value_and_gradient(p)[0], points, step)
    scale = max(1.0, np.abs(case.source(points)).max())
    np.testing.assert_allclose(gradient, by_differences, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(case.source(points), u - laplacian, rtol=0, atol=1e-4 * scale)
    assert not np.allclose(case.source(points), u + laplacian, rtol=0, atol=1e-4 * scale)
    for together, single in zip(case.value_gradient_and_source(points), (u, gradient), strict=False):
        np.testing.assert_allclose(together, single, rtol=0, atol=1e-12 * scale)


PLACED = [
    *PLACES,
    *((name, position[0], 0) for name, position in IRREGULAR.items()),
    ("violates_jjj", "square", 0),
]


@pytest.mark.parametrize(("name", "polygon", "side"), PLACED)
def test_where_a_case_is_said_to_vanish_it_does(name, polygon, side):
    """At the vertices and in the centroids of triangles; somewhere, unless an atom has no cutoff."""
    case = load(name, polygon, side)
    mesh = make_structured_mesh(POLYGONS[polygon], 1 / 32)
    zero = case.vanishes_in_circles(*mesh.enclosing_circles)
    corners = mesh.points[mesh.triangles[zero]]
    points = np.concatenate([corners.reshape(-1, 2), corners.mean(axis=1)])
    for values in (*case.value_and_gradient(points), case.source(points)):
        assert not values.any()
    everywhere = name in ("natural", "full_contact", "no_contact", "violates_j", "reentrant_full")
    assert zero.any() != everywhere


@pytest.mark.parametrize(("inside", "radius", "zero"), [(0.26, 0.009, True), (0.26, 0.011, False)])
@pytest.mark.parametrize(("name", "reach"), [("thirds", 1 / 4), ("smooth", 1 / 3)])
@pytest.mark.parametrize("size", [1.0, 10.0])
def test_a_case_vanishes_on_a_circle_beyond_its_cutoff(name, reach, inside, radius, zero, size):
    """By hand, on a square of that size: the distance from the cutoff's end is 0.01."""
    case = cases.load_solution(name, Polygon(size * square().vertices, "large"))
    centre = size * np.array([[1 / 3, inside + reach - 1 / 4]])
    assert case.vanishes_in_circles(centre, np.array([size * radius])).tolist() == [zero]


ROOT_FLUXES = [  # the case, where it is put, the start and the cutoff of the flux, and its rounding
    *((*place, 1 / 3, 1 / 4, 1e-14) for place in PLACES if place[0] == "thirds"),
    *(
        ("vertex", *position, 0, 5 / 12, 1e-12)
        for position in (("square", 0), ("square", 3), ("lshape", 0), ("lshape", 5))
    ),
]


@pytest.mark.parametrize(("name", "polygon", "side", "start", "cutoff", "rounding"), ROOT_FLUXES)
def test_the_flux_of_a_root_is_its_closed_form_on_its_own_side(name, polygon, side, start, cutoff, rounding):
    """lambda = s_+^(1/2) (1 - (s/cutoff)^2)_+^4 on the own side, else 0; s = t - start in side lengths.

    At a vertex, sides of other lengths see the cutoff's end from coordinates.
    """
    case = load(name, polygon, side)
    t = np.linspace(0, 1, 1001)
    s = t - start
    expected = np.sqrt(np.maximum(s, 0)) * np.maximum(1 - (s / cutoff) ** 2, 0) ** 4
    for i in range(case.polygon.n_sides):
        _, flux, _ = case.trace_flux_and_gap(np.full(1001, i), t * case.polygon.lengths[i])
        np.testing.assert_allclose(flux, expected if i == side else 0, rtol=0, atol=rounding)


@on_every_place
def test_traces_are_limits_from_inside(name, polygon, side):
    """At a distance of 1e-9 u and du/dn differ from their boundary values by O(1e-9) times derivatives."""
    case = load(name, polygon, side)
    n = 40
    rng = np.random.default_rng(3)
    sides = np.repeat(np.arange(case.polygon.n_sides), n)
    s = rng.uniform(0.01, 0.99, len(sides))
    points = case.polygon.at(sides, s)
    u, flux, _ = case.trace_flux_and_gap(sides, s)
    normals = case.polygon.normals[sides]
    value, gradient = case.value_and_gradient(points - 1e-9 * normals)
    np.testing.assert_allclose(value, u, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.sum(gradient * normals, axis=1), flux, rtol=0, atol=1e-6)


def test_distances_along_a_side_do_not_round():
    """1/3 + 1e-20 is 1/3, its distance from there is not 0."""
    third = np.array([1 / 3])
    displaced = np.array([1e-20])
    assert SidePoints(third + displaced, third, displaced).distance_from(1 / 3).tolist() == [1e-20]


@pytest.mark.parametrize(
    ("kink", "crossings"),
    [
        (Kink((1 / 2, 0), 1 / 4), [(0, 1 / 4), (0, 3 / 4)]),
        (Kink((0, 0), 1 / 4), [(0, 1 / 4), (3, 3 / 4)]),
        (Kink((1 / 2, 1 / 2), 1 / 4), []),
        (Kink((1 / 2, 1 / 2), 3), []),
        (Kink((3 / 10, 7), 0, (0, 1)), [(0, 3 / 10), (2, 7 / 10)]),
        (Kink((0, 1 / 4), 0, (1 / np.sqrt(2), 1 / np.sqrt(2))), [(2, 1 / 4), (3, 3 / 4)]),
        (Kink((1 / 2, 1), 0, (1, 0)), []),
        (Kink((1 / 2, 2), 0, (1, 0)), []),
    ],
)
@pytest.mark.parametrize("size", [1.0, 8.0])
def test_crossings_of_curves_with_sides_are_those_by_hand(kink, crossings, size):
    """By hand, as fractions of the sides of the square; a curve along a side or through a vertex is on it."""
    centre = (size * kink.centre[0], size * kink.centre[1])
    large = Kink(centre, size * kink.radius, kink.tangent)
    singular_points = large.crossings(Polygon(size * square().vertices))
    assert sorted((p.side, p.t) for p in singular_points) == [
        (side, pytest.approx(t)) for side, t in crossings
    ]
    assert {p.grading for p in singular_points} <= {1}


TEST_FUNCTIONS = ("1", "x", "y", "x*y", "cos(3*x + y)")
GREEN = [  # a place, the test function, None for u itself, h, the degree of the rule, the defect
    *[
        (place, v, 1 / 12 if place[0] == "smooth" else 1 / 8, 14, 1e-9)
        for place in (
            ("natural", "square", 0),
            ("full_contact", "lshape", 0),
            ("no_contact", "lshape", 0),
            *(
                (name, *position)
                for name in ("smooth", "thirds")
                for position in (("square", 1), ("lshape", 2))
            ),
        )
        for v in TEST_FUNCTIONS
    ],
    *[((name, polygon, 0), None, 1 / 12, 14, 1e-8) for name, (polygon, *_) in IRREGULAR.items()],
    (("violates_jjj", "square", 0), None, 1 / 12, 5, 1e-4),
]


@cache
def sample(place, h, degree):
    """Rules on triangles with u, grad u and f there, and the rule on the boundary with u and lambda."""
    case = load(*place)
    inner = []
    for rule in triangle_rules(make_structured_mesh(case.polygon, h), case, degree):
        u, gradient = case.value_and_gradient(rule.origin, rule.offset)
        inner.append((rule, u, gradient, case.source(rule.origin, rule.offset)))
    rule = boundary_rule(case.polygon, case.polygon.starts, case.singular_points())
    u, flux, _ = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    return inner, (case.polygon.at(rule.side, rule.s), rule.weight, u, flux)


def greens_defect(place, v, h, degree, source=1.0):
    """|int grad u . grad v + u v - source f v - int lambda v|, in units of the first integral's scale."""
    inner, (points, weight, u, flux) = sample(place, h, degree)
    test = SmoothAtom(parse_formula(v, "xy", "v")) if v else None
    defect = -weight @ (flux * (test.value_and_gradient(points)[0] if v else u))
    scale = 0.0
    for rule, value_u, slope_u, f in inner:
        value, slope = test.value_and_gradient(rule.origin, rule.offset) if v else (value_u, slope_u)
        energy = np.sum(slope_u * slope, axis=1) + value_u * value
        defect += rule.weight.ravel() @ (energy - source * f * value)
        scale += rule.weight.ravel() @ np.abs(energy)
    return abs(defect) / (max(1.0, scale) if v else scale)


@pytest.mark.parametrize(("place", "v", "h", "degree", "maximum"), GREEN, ids=str)
def test_u_f_and_lambda_belong_together(place, v, h, degree, maximum):
    """Green's formula, (1.1)-(1.2), on meshes with edges along straight kinks; by smooth functions and by u.

    For `rough` |grad u|^2 is like r^(-1.9), lambda u like r^(-0.9). The f of `violates_jjj` has a kink
    at every cutoff's end.
    """
    assert greens_defect(place, v, h, degree) < maximum


def test_greens_formula_sees_a_wrong_source():
    assert greens_defect(("natural", "square", 0), "x", 1 / 8, 14, source=1.001) > 1e-4


@pytest.mark.parametrize("name", ["smooth", "thirds"])
def test_the_flux_does_not_depend_on_the_size(name):
    """u = L v(x / L): equal flux, L-fold values."""
    large = cases.load_solution(name, Polygon(10 * square().vertices, "large"), 0)
    s = np.linspace(0, 1, 101)
    u, flux, gap = load(name).trace_flux_and_gap(np.zeros(101, dtype=int), s)
    U, FLUX, GAP = large.trace_flux_and_gap(np.zeros(101, dtype=int), 10 * s)
    np.testing.assert_allclose(FLUX, flux, rtol=0, atol=1e-14)
    np.testing.assert_allclose(U, 10 * u, rtol=0, atol=1e-13)
    np.testing.assert_allclose(GAP, gap, rtol=0, atol=1e-13)
    certify_case(large)
    for kink, other_kink in zip(load(name).kinks(), large.kinks(), strict=True):
        points = inside(square(), 20)
        np.testing.assert_allclose(
            other_kink.signed_distances(10 * points), 10 * kink.signed_distances(points)
        )
    points = np.array([[0.37, 0.01], [0.43, 0.11], [0.5, 0.2]])
    by_differences, laplacian = differences(lambda p: large.value_and_gradient(p)[0], 10 * points, 1e-2)
    u_large, gradient = large.value_and_gradient(10 * points)
    np.testing.assert_allclose(gradient, by_differences, rtol=0, atol=1e-6 * np.abs(gradient).max())
    np.testing.assert_allclose(large.source(10 * points), u_large - laplacian, rtol=1e-5)


def test_natural_is_that_by_complex_arithmetic():
    """u = -Im z^(3/2) + 4 |z|^2, z = x - 1/2 + iy; the principal branch is continuous on Im z >= 0."""
    points = np.vstack([inside(square(), 500), [[0.2, 0.0], [0.8, 0.0], [0.5, 0.0], [0.0, 0.0]]])
    z = points[:, 0] - 0.5 + 1j * points[:, 1]
    u, _ = load("natural").value_and_gradient(points)
    np.testing.assert_allclose(u, -(z**1.5).imag + 4 * np.abs(z) ** 2, rtol=0, atol=3e-14)
    x = np.linspace(0, 1, 201)
    _, flux, gap = load("natural").trace_flux_and_gap(np.zeros(201, dtype=int), x)
    np.testing.assert_allclose(flux, 1.5 * np.sqrt(np.maximum(x - 0.5, 0)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(gap, 2 * x * np.maximum(0.5 - x, 0) ** 1.5, rtol=0, atol=1e-14)


def contact(name, polygon, side):
    """By the declarations: where the gap is 0."""
    n = POLYGONS[polygon].n_sides
    return {
        "natural": [(0, 0.5, 1.0), (1, 0.0, 1.0), (2, 0.0, 1.0), (3, 0.0, 1.0)],
        "full_contact": [(i, 0.0, 1.0) for i in range(n)],
        "no_contact": [],
        "smooth": sorted([(side, 1 / 3, 2 / 3), ((side + 1) % n, 1 / 3, 2 / 3)]),
        "vertex": [(0, 0, 5 / 12)],
        "violates_j": [(i, 0, 1) for i in range(6)],
        "reentrant_full": [(i, 0, 1) for i in range(6)],
        "reentrant": [(0, 1 / 3, 2 / 3)],
    }.get(name, [(side, 1 / 3, 7 / 12)])


@pytest.mark.parametrize(
    ("name", "polygon", "side"), [*PLACES, *((n, position[0], 0) for n, position in IRREGULAR.items())]
)
def test_every_case_is_certified(name, polygon, side):
    """The hypotheses as the catalogue of the design states them.

    u - g is not in H^(3/2) where it is like s_+^k with k <= 1, for that is in H^tau for tau < k + 1/2.
    lambda is unbounded where it is like r^(-1/3), at a held corner, or like s^alpha with alpha < 0.
    """
    case = load(name, polygon, side)
    certificate = load_certificate(name, polygon, side)
    hypotheses = IRREGULAR[name][1] if name in IRREGULAR else (True, True, True)
    assert (
        tuple(certificate.hypotheses.values()) == tuple(case.declaration["hypotheses"].values()) == hypotheses
    )
    expected = np.array(contact(name, polygon, side)).reshape(-1, 3)
    np.testing.assert_allclose(np.array(certificate.contact).reshape(-1, 3), expected, rtol=0, atol=1e-14)
    assert certificate.g_regular == (name not in GAPS_WITH_KINKS)
    assert math.isinf(certificate.max_multiplier) == (name in ("violates_j", "singular", "rough"))
    assert (certificate.max_gap == 0) == (name in ("full_contact", "violates_j", "reentrant_full"))
    assert (certificate.max_multiplier < 1e-14) == (name == "no_contact")


@pytest.mark.parametrize("hypothesis", ["j", "jj", "jjj"])
def test_a_wrong_claim_is_noticed(hypothesis, case_like):
    """Control: each hypothesis declared as its opposite."""
    declared = load("violates_j", "lshape").declaration["hypotheses"]
    wrong = declared | {hypothesis: not declared[hypothesis]}
    with sentences.raises(InputError, hypothesis):
        certify_case(case_like("violates_j", find_polygon("lshape"), hypotheses=wrong))


HARMONIC = {"atom": "harmonic", "side": 0, "at": "1/3", "alpha": "1/2", "cutoff": "1/4"}
TENSOR = {"atom": "tensor", "side": 0}
GAP = "pos(1/3 - t, 3/2) + pos(4/5*(t - 7/12), 3/2)"


def smooth(formula):
    return [{"atom": "smooth", "formula": formula}]


def holding(j, jj, jjj):
    return {"hypotheses": {"j": j, "jj": jj, "jjj": jjj}}


def gap(formula, elsewhere="sqrt(3)/9"):
    return {"gap": {"elsewhere": elsewhere, "sides": [{"side": 0, "formula": formula}]}}


@pytest.fixture
def declare_thirds(tmp_path):
    """A file like `thirds` with other fields in place of some; a field None is left out."""
    return lambda **changed: case_file(tmp_path, "thirds", **changed)


def refusal(file, polygon="square", side=0):
    with pytest.raises(InputError) as error:
        certify_case(cases.load_solution(file, find_polygon(polygon), side))
    return str(error.value)


def test_an_own_file_is_a_case(declare_thirds):
    """The file that the refusals below change is itself certified."""
    case = cases.load_solution(declare_thirds(), square(), 2)
    assert case.name == "mine"
    assert certify_case(case).contact == ((2, 1 / 3, pytest.approx(7 / 12, abs=1e-15)),)


FAR = "1e10*t + sqrt(3)/9", "1e10 + sqrt(3)/9"
"""A gap that grows on side 1 and is large on side 2."""


def declare_large_gaps(first, last):
    """A gap on side 0, and one on side 3, beside those that are large."""
    formulas = first, *FAR, last
    sides = [{"side": i, "formula": formula} for i, formula in enumerate(formulas)]
    return {"gap": {"elsewhere": 1, "sides": sides}}


LATE = "pos(1/3 - t, 3/2) + pos(t - 5/6, 3/2)"
NOT_CERTIFIED = [
    (declare_large_gaps(GAP, "1e10*(1 - t) + sqrt(3)/9 + 1/200"), r"side 0, t = 0: g jumps by 0.00499"),
    (declare_large_gaps(f"{GAP} - t*(1 - t)/200", "1e10*(1 - t) + sqrt(3)/9"), r"side 0, .*: u - g < 0"),
    ({"u": [HARMONIC | {"times": -1}]}, r"at \(0.333333, 0\), side 0.*lambda = du/dn < 0"),
    ({"u": smooth("-y*(x - 1/4)")}, r"at \(0.000249875, 0\), side 0.*lambda = du/dn < 0"),
    (gap("pos(1/3 - t, 3/2) + pos(4/5*(t - 1/2), 3/2)"), r"at \(0.5, 0\), side 0, t = 0.5: .* is not 0"),
    (gap(GAP, "1/5"), r"at \(0, 0\), side 0, t = 0: g jumps by 0.00754991 at this vertex"),
    (gap("pos(1/3 - t, 3/2) - pos(4/5*(t - 7/12), 3/2)"), r"at \(0.583333, 0\), side 0.*u - g < 0"),
    (gap("pos(1/3 - t, 3/2) + pos(t - 2/3, 1)/sqrt(3)"), r"at \(0.583.* vanish together on an interval"),
    ({"u": smooth("cos(pi*x)"), "gap": {"elsewhere": 0}}, "vanish together on an interval"),
    ({"u": [HARMONIC | {"cutoff": "1/2"}]} | gap(LATE), r"at \(0, .*side 3.*lambda"),
    (gap(GAP + " + 1/(t - 1/2)**2"), r"at \(0.5, 0\), side 0.*is not finite"),
    ({"u": [HARMONIC | {"cutoff": "1e-160"}]}, r" on 'square' at \(0."),
    (holding(False, True, True), r"field hypotheses.j: \(j\) holds, declared otherwise"),
    ({"u": [HARMONIC | {"alpha": "-1/4"}]}, r"field hypotheses.j: \(j\) does not hold"),
    (gap("pos(1/3 - t, 1/2)/3 + pos(4/5*(t - 7/12), 3/2)"), r"field hypotheses.jj: \(jj\) does not hold"),
]
BAD_FIELDS = [
    ({"gaps": 0}, "mine.yaml: there is no field 'gaps' here; the fields are "),
    (
        {"constants": {1: 2}},
        "case 'mine', field constants: '1' cannot be a constant's name; take one such as",
    ),
    ({"constants": {"c": 0}, "gap": {"elsewhere": "t/c"}}, "gap.elsewhere: it is not a finite real function"),
    *[({"constants": {name: 2}}, f"'{name}' cannot be a constant's name") for name in ("t", "if", "pos")],
    (holding("yes", True, True), "'yes' is not of type 'boolean'; write true"),
    (holding(1, True, True), "field hypotheses.j: 1 is not of type"),
    ({"gap": None}, "mine.yaml: the field gap is missing"),
    ({"u": [{"atom": "harmonc"}]}, r"mine.yaml, field u\[0\].atom: 'harmonc' is not one of"),
    ({"u": [HARMONIC | {"profile": 1}]}, r"field u\[0\]: there is no field 'profile' here; the fields are "),
    ({"u": [TENSOR]}, r"field u\[0\]: the field profile is missing"),
    ({"u": [HARMONIC | {"side": -2}]}, r"field u\[0\].side: -2 is less than the minimum"),
    ({"u": [HARMONIC | {"at": 1}]}, r"case 'mine', u\[0\], at: 1 must lie between 0 and 1"),
    ({"u": [HARMONIC | {"cutoff": 0}]}, r"u\[0\], cutoff: 0 must be positive"),
    ({"u": [HARMONIC | {"alpha": "sqrt(2)"}]}, r"u\[0\], alpha: sqrt\(2\) must be a fraction"),
    ({"u": [HARMONIC | {"alpha": 1}]}, "a harmonic atom needs alpha > -1 that is not an integer"),
    (
        {"u": [TENSOR | {"profile": "pos(t, 1)", "cutoff": 1}]},
        r"u\[0\], profile: its powers must be above 3/2",
    ),
    ({"u": smooth("pos(x, 2)")}, r"u\[0\]: a smooth atom has no"),
    (gap("sqrt(t)"), r"gap.sides\[0\]: write a fractional power as pos\(a, k\)"),
    ({"gap": {"elsewhere": "x"}}, "gap.elsewhere: 'x' is unknown; known are t, pi"),
]


@pytest.mark.parametrize(("changed", "message"), NOT_CERTIFIED)
def test_what_is_not_certified_is_refused_with_the_point(declare_thirds, changed, message):
    assert re.match(f"case 'mine'.*{message}", refusal(declare_thirds(**changed)))


@pytest.mark.parametrize(("changed", "message"), BAD_FIELDS)
def test_bad_fields_are_named(declare_thirds, changed, message):
    assert re.search(message, refusal(declare_thirds(**changed)))


@pytest.mark.parametrize(
    ("name", "polygon", "side", "message"),
    [
        *[("natural", "square", side, "on 'square' at (") for side in (1, 2, 3)],  # there is lambda > 0 below
        ("natural", "lshape", 0, "is for square, not for 'lshape'"),
        *[("thirds", "square", side, f"the polygon has the sides 0 to 3, not {side}") for side in (4, -1)],
        ("unnatural", "square", 0, "case 'unnatural' is unknown; known are borderline_0.05,"),
        ("nowhere.yaml", "square", 0, "there is no file nowhere.yaml"),
    ],
)
def test_wrong_places_are_refused_with_the_reason(name, polygon, side, message):
    assert message in refusal(name, polygon, side)


def test_a_constant_without_a_value_on_the_polygon_is_refused(declare_thirds):
    triangle = Polygon(np.array([[0, 0], [1, 0], [0, 1]]), "triangle")
    file = declare_thirds(polygons="any", constants={"c1": {"square": "1/2"}})
    with sentences.raises(InputError):
        cases.load_solution(file, triangle)


def test_a_harmonic_atom_without_a_cutoff_needs_a_half_plane(declare_thirds):
    endless = {key: value for key, value in HARMONIC.items() if key != "cutoff"}
    message = refusal(declare_thirds(u=[endless]), "lshape", 1)
    assert "a harmonic atom on side 1 of 'lshape' needs a cutoff" in message
