"""Cases: what is derived against independent computations, the certificate, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
import yaml

from unilateral.errors import InputError
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.geometry.curves import Kink
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.problems import case as cases
from unilateral.problems.atoms import Along, D, Smooth, T, Tensor, X, Y
from unilateral.problems.case import Case
from unilateral.problems.certificate import certify
from unilateral.problems.polar import THETA, Polar, R

POLYGONS = {"square": square(), "lshape": named("lshape")}
PLACES = [("natural", "square", 0)] + [
    (name, polygon, side)
    for name in ("full_contact", "no_contact", "smooth", "thirds")
    for polygon in POLYGONS
    for side in (range(POLYGONS[polygon].n_sides) if name in ("smooth", "thirds") else [0])
]
on_every_place = pytest.mark.parametrize(("name", "polygon", "side"), PLACES)


@cache
def load(name: str, polygon: str, side: int) -> Case:
    return cases.load(name, POLYGONS[polygon], side)


def inside(polygon: Polygon, n: int) -> np.ndarray:
    """(n, 2) pseudo-random points of the polygon, by rejection from the centroids of a fine mesh."""
    mesh = structured(polygon, 1 / 64)
    centroids = mesh.points[mesh.triangles].mean(axis=1)
    return np.random.default_rng(1).permutation(centroids)[:n]


def differences(f: Callable[[np.ndarray], np.ndarray], points: np.ndarray, step: float) -> tuple[Any, Any]:
    """Central differences of fourth order: the gradient (k, 2) and the Laplacian (k,)."""
    gradient, laplacian = np.zeros_like(points), np.zeros(len(points))
    centre = f(points)
    for axis in range(2):
        e = np.zeros(2)
        e[axis] = step
        m2, m1, p1, p2 = (f(points + k * e) for k in (-2, -1, 1, 2))
        gradient[:, axis] = (m2 - 8 * m1 + 8 * p1 - p2) / (12 * step)
        laplacian += (-m2 + 16 * m1 - 30 * centre + 16 * p1 - p2) / (12 * step**2)
    return gradient, laplacian


def test_the_catalogue() -> None:
    assert set(cases.names()) >= {"full_contact", "natural", "no_contact", "smooth", "thirds"}


@pytest.mark.parametrize(
    ("name", "polygon"),
    [
        ("natural", "square"),
        ("thirds", "lshape"),
        ("smooth", "square"),
        ("no_contact", "square"),
        ("violates_jj", "square"),
        ("violates_j", "lshape"),
    ],
)
def test_the_obstacle_and_its_slope(name: str, polygon: str) -> None:
    """g = u - gap, and central differences of it away from the points at which it is not smooth."""
    case, step = load(name, polygon, 0), 1e-6
    side, t = np.repeat(np.arange(case.polygon.n_sides), 40), np.tile((np.arange(40) + 0.4) / 40, 6)
    t = t[: len(side)]
    s = t * case.polygon.lengths[side]
    along, found = case.polygon.starts[side] + s, case.enclosed_obstacle
    slope = found.at(found.on(along), along)[1]
    (u, _, gap), (before, _, gap_before) = (case.boundary(side, s + d) for d in (step, -step))
    difference = (u - gap - before + gap_before) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-6)
    assert np.ptp(slope) > 0.1


@on_every_place
def test_derivatives_are_those_of_u(name: str, polygon: str, side: int) -> None:
    """Fourth-order differences, step 1e-3, 0.02 away from kinks and singular points: errors below 1e-4."""
    case, step = load(name, polygon, side), 1e-3
    points = inside(case.polygon, 400)
    level = [np.abs(kink.level(points)) for kink in case.kinks()]
    singular = case.singular()
    at = case.polygon.at(
        np.array([p.side for p in singular], dtype=np.intp),
        np.array([p.t * case.polygon.lengths[p.side] for p in singular]),
    )
    away = [np.hypot(*(points - p).T) for p in at]
    points = points[np.min([np.ones(len(points)), *level, *away], axis=0) > 0.02]
    assert len(points) > 100
    u, gradient = case.value_and_gradient(points)
    by_differences, laplacian = differences(lambda p: case.value_and_gradient(p)[0], points, step)
    scale = max(1.0, np.abs(case.source(points)).max())
    np.testing.assert_allclose(gradient, by_differences, atol=1e-6 * scale)
    np.testing.assert_allclose(case.source(points), u - laplacian, atol=1e-4 * scale)
    assert not np.allclose(case.source(points), u + laplacian, atol=1e-4 * scale)


def test_the_polar_atoms_source_symbolically() -> None:
    """Polar Laplacian of v by sympy; so the harmonic factor has none."""
    atom = load("thirds", "square", 0).atoms[0]
    assert isinstance(atom, Polar)
    v, v_r, v_theta, laplacian = atom.symbolic
    eta = 1 - (R / sympy.Rational(1, 4)) ** 2
    at = {R: sympy.Rational(1, 7), THETA: sympy.Rational(9, 5)}

    def polar_laplacian(w: sympy.Expr) -> sympy.Expr:
        return w.diff(R, 2) + w.diff(R) / R + w.diff(THETA, 2) / R**2

    phi = atom.factor * R**atom.beta * sympy.cos(atom.beta * (THETA - atom.theta_0))
    assert sympy.simplify(polar_laplacian(phi)) == 0
    for mine, theirs in (
        (v, phi * eta**4),
        (v_r, (phi * eta**4).diff(R)),
        (v_theta, (phi * eta**4).diff(THETA) / R),
        (laplacian, polar_laplacian(phi * eta**4)),
    ):
        assert abs((mine.subs(at).doit() - theirs.subs(at)).evalf(30)) < 1e-25
    assert sympy.simplify(polar_laplacian(phi.subs(atom.theta_0, 0) * R)) != 0


def test_the_tensor_and_smooth_sources_symbolically() -> None:
    """-Delta u + u by sympy from the formula of u, inside the support, at a rational point."""
    tensor = load("smooth", "square", 0).atoms[0]
    assert isinstance(tensor, Tensor)
    third = sympy.Rational(1, 3)
    v = -D * 46656 * ((T - third) * (2 * third - T)) ** 3 * (1 - (D / third) ** 2) ** 4
    at = {T: sympy.Rational(2, 5), D: sympy.Rational(1, 5)}
    expected = float((v - v.diff(T, 2) - v.diff(D, 2)).subs(at))
    assert tensor.source(np.array([[0.4, 0.2]]))[0] == pytest.approx(expected, rel=1e-12)
    smooth = Smooth(sympy.sin(X) * Y**2)
    exact = float((2 * sympy.sin(X) * Y**2 - 2 * sympy.sin(X)).subs({X: 0.3, Y: 0.7}))
    assert smooth.source(np.array([[0.3, 0.7]]))[0] == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize(("polygon", "side"), [p[1:] for p in PLACES if p[0] == "thirds"])
def test_the_harmonic_atoms_flux(polygon: str, side: int) -> None:
    """lambda = s_+^(1/2) (1 - (4 s)^2)_+^4 on the own side, else 0; s = t - 1/3 in side lengths."""
    case = load("thirds", polygon, side)
    s = np.linspace(-1 / 3, 2 / 3, 1001)
    expected = np.sqrt(np.maximum(s, 0)) * np.maximum(1 - (4 * s) ** 2, 0) ** 4
    for i in range(case.polygon.n_sides):
        _, flux, _ = case.boundary(np.full(1001, i), (s + 1 / 3) * case.polygon.lengths[i])
        np.testing.assert_allclose(flux, expected if i == side else 0, rtol=0, atol=1e-14)


@on_every_place
def test_traces_are_limits_from_inside(name: str, polygon: str, side: int) -> None:
    """At a distance of 1e-9 u and du/dn differ from their boundary values by O(1e-9) times derivatives."""
    case, n = load(name, polygon, side), 40
    rng = np.random.default_rng(3)
    sides = np.repeat(np.arange(case.polygon.n_sides), n)
    s = rng.uniform(0.01, 0.99, len(sides))
    points = case.polygon.at(sides, s)
    u, flux, _ = case.boundary(sides, s)
    normals = case.polygon.normals[sides]
    value, gradient = case.value_and_gradient(points - 1e-9 * normals)
    np.testing.assert_allclose(value, u, atol=1e-7)
    np.testing.assert_allclose(np.sum(gradient * normals, axis=1), flux, atol=1e-6)


def test_distances_along_a_side_do_not_round() -> None:
    """1/3 + 1e-20 is 1/3, its distance from there is not 0."""
    third, off = np.array([1 / 3]), np.array([1e-20])
    assert Along(third + off, third, off).minus(1 / 3).tolist() == [1e-20]


@pytest.mark.parametrize("name", ["smooth", "thirds"])
def test_kinks_grow_with_the_polygon(name: str) -> None:
    small, large = load(name, "square", 0), cases.load(name, Polygon(8 * square().vertices, "large"), 0)
    assert len(small.kinks()) == len(large.kinks())
    for one, other in zip(small.kinks(), large.kinks(), strict=True):
        np.testing.assert_allclose(other.level(8 * inside(square(), 20)), 8 * one.level(inside(square(), 20)))


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
def test_where_curves_cross_the_sides(kink: Kink, crossings: list[tuple[int, float]], size: float) -> None:
    """By hand, as fractions of the sides of the square; a curve along a side or through a vertex is on it."""
    centre = (size * kink.centre[0], size * kink.centre[1])
    large = Kink(centre, size * kink.radius, kink.tangent)
    found = large.crossings(Polygon(size * square().vertices))
    assert sorted((p.side, p.t) for p in found) == [(side, pytest.approx(t)) for side, t in crossings]
    assert {p.grading for p in found} <= {1}


TEST_FUNCTIONS = {
    "1": sympy.Integer(1),
    "x": X,
    "y": Y,
    "xy": X * Y,
    "cos(3x + y)": sympy.cos(3 * X + Y),
}


def weak_defect(case: Case, v: sympy.Expr, h: float, source: float = 1.0) -> float:
    """|int grad u . grad v + u v - source f v - int lambda v|, in units of the first integral's scale."""
    w = Smooth(v)
    defect, scale = 0.0, 0.0
    for rule in triangle_rules(structured(case.polygon, h), case, 14):
        (u, du), (value, dv) = case.value_and_gradient(rule.points), w.value_and_gradient(rule.points)
        energy = np.sum(du * dv, axis=1) + u * value
        defect += rule.weight.ravel() @ (energy - source * case.source(rule.points) * value)
        scale += rule.weight.ravel() @ np.abs(energy)
    rule = boundary_rule(case.polygon, case.polygon.starts, case.singular())
    _, flux, _ = case.boundary(rule.side, rule.s)
    value, _ = w.value_and_gradient(case.polygon.at(rule.side, rule.s))
    return float(abs(defect - rule.weight @ (flux * value)) / max(1.0, scale))


@pytest.mark.parametrize("v", TEST_FUNCTIONS.values(), ids=TEST_FUNCTIONS)
@pytest.mark.parametrize(
    ("name", "polygon", "side"),
    [("natural", "square", 0), ("full_contact", "lshape", 0), ("no_contact", "lshape", 0)]
    + [
        (name, polygon, side)
        for name in ("smooth", "thirds")
        for polygon, side in (("square", 1), ("lshape", 2))
    ],
)
def test_u_f_and_lambda_belong_together(name: str, polygon: str, side: int, v: sympy.Expr) -> None:
    """Green's formula, (1.1)-(1.2) by smooth functions, on meshes with edges along straight kinks."""
    h = 1 / 12 if name == "smooth" else 1 / 8
    assert weak_defect(load(name, polygon, side), v, h) < 1e-9


def test_greens_formula_sees_a_wrong_source() -> None:
    assert weak_defect(load("natural", "square", 0), X, 1 / 8, source=1.001) > 1e-4


@pytest.mark.parametrize("name", ["smooth", "thirds"])
def test_the_flux_does_not_depend_on_the_size(name: str) -> None:
    """u = L v(x / L): equal flux, L-fold values."""
    large = cases.load(name, Polygon(10 * square().vertices, "large"), 0)
    s = np.linspace(0, 1, 101)
    u, flux, gap = load(name, "square", 0).boundary(np.zeros(101, dtype=int), s)
    U, FLUX, GAP = large.boundary(np.zeros(101, dtype=int), 10 * s)
    np.testing.assert_allclose(FLUX, flux, atol=1e-14)
    np.testing.assert_allclose(U, 10 * u, atol=1e-13)
    np.testing.assert_allclose(GAP, gap, atol=1e-13)
    certify(large)
    points = np.array([[0.37, 0.01], [0.43, 0.11], [0.5, 0.2]])
    by_differences, laplacian = differences(lambda p: large.value_and_gradient(p)[0], 10 * points, 1e-2)
    u_large, gradient = large.value_and_gradient(10 * points)
    np.testing.assert_allclose(gradient, by_differences, atol=1e-6 * np.abs(gradient).max())
    np.testing.assert_allclose(large.source(10 * points), u_large - laplacian, rtol=1e-5)


def test_natural_by_complex_arithmetic() -> None:
    """u = -Im z^(3/2) + 4 |z|^2, z = x - 1/2 + iy; the principal branch is continuous on Im z >= 0."""
    points = np.vstack([inside(square(), 500), [[0.2, 0.0], [0.8, 0.0], [0.5, 0.0], [0.0, 0.0]]])
    z = points[:, 0] - 0.5 + 1j * points[:, 1]
    u, _ = load("natural", "square", 0).value_and_gradient(points)
    np.testing.assert_allclose(u, -(z**1.5).imag + 4 * np.abs(z) ** 2, rtol=0, atol=3e-14)
    x = np.linspace(0, 1, 201)
    _, flux, gap = load("natural", "square", 0).boundary(np.zeros(201, dtype=int), x)
    np.testing.assert_allclose(flux, 1.5 * np.sqrt(np.maximum(x - 0.5, 0)), atol=1e-14)
    np.testing.assert_allclose(gap, 2 * x * np.maximum(0.5 - x, 0) ** 1.5, atol=1e-14)


def expected_contact(name: str, polygon: str, side: int) -> list[tuple[int, float, float]]:
    """By the declarations: where the gap is 0."""
    n = POLYGONS[polygon].n_sides
    return {
        "natural": [(0, 0.5, 1.0), (1, 0.0, 1.0), (2, 0.0, 1.0), (3, 0.0, 1.0)],
        "full_contact": [(i, 0.0, 1.0) for i in range(n)],
        "no_contact": [],
        "smooth": sorted([(side, 1 / 3, 2 / 3), ((side + 1) % n, 1 / 3, 2 / 3)]),
        "thirds": [(side, 1 / 3, 7 / 12)],
    }[name]


@on_every_place
def test_every_case_is_certified(name: str, polygon: str, side: int) -> None:
    case = load(name, polygon, side)
    certificate = certify(case)
    assert certificate.hypotheses == case.declaration["hypotheses"] == {"j": True, "jj": True, "jjj": True}
    found, expected = np.array(certificate.contact), np.array(expected_contact(name, polygon, side))
    np.testing.assert_allclose(found.reshape(-1, 3), expected.reshape(-1, 3), atol=1e-14)
    assert certificate.lambda_max >= 0
    if name == "full_contact":
        assert certificate.gap_max == 0
    if name == "no_contact":
        assert certificate.lambda_max < 1e-14


HARMONIC = {"atom": "harmonic", "side": 0, "at": "1/3", "alpha": "1/2", "cutoff": "1/4"}
GAP = "pos(1/3 - t, 3/2) + pos(4/5*(t - 7/12), 3/2)"


def on_own_side(formula: str) -> dict[str, Any]:
    return {"elsewhere": "sqrt(3)/9", "sides": [{"side": 0, "formula": formula}]}


@pytest.fixture
def declared(tmp_path: Path) -> Callable[..., Path]:
    """A file like `thirds` with other fields in place of some; a field None is left out."""

    def write(**changed: Any) -> Path:
        source = Path(str(cases.resources.files("unilateral.manufactured") / "thirds.yaml"))
        fields = yaml.safe_load(source.read_text()) | changed
        file = tmp_path / "mine.yaml"
        file.write_text(yaml.safe_dump({key: value for key, value in fields.items() if value is not None}))
        return file

    return write


def refusal(file: str | Path, polygon: str = "square", side: int = 0) -> str:
    with pytest.raises(InputError) as error:
        certify(cases.load(file, named(polygon), side))
    return str(error.value)


def test_an_own_file_is_a_case(declared: Callable[..., Path]) -> None:
    """The file that the refusals below change is itself certified."""
    case = cases.load(declared(), square(), 2)
    assert case.name == "mine"
    assert certify(case).contact == ((2, 1 / 3, pytest.approx(7 / 12, abs=1e-15)),)


NOT_CERTIFIED: dict[str, tuple[dict[str, Any], list[str]]] = {
    "lambda negative": (
        {"u": [HARMONIC | {"times": -1}]},
        ["at (0.333333, 0), side 0", "lambda = du/dn < 0"],
    ),
    "lambda changes sign": (
        {"u": [{"atom": "smooth", "formula": "-y*(x - 1/4)"}]},
        ["at (0.000249875, 0), side 0", "lambda = du/dn < 0"],
    ),
    "not complementary": (
        {"gap": on_own_side("pos(1/3 - t, 3/2) + pos(4/5*(t - 1/2), 3/2)")},
        ["at (0.5, 0), side 0, t = 0.5", "lambda (u - g) is not 0"],
    ),
    "g jumps": (
        {"gap": on_own_side(GAP) | {"elsewhere": "1/5"}},
        ["at (0, 0), side 0, t = 0", "g jumps by 0.00754991 at this vertex"],
    ),
    "gap negative": (
        {"gap": on_own_side("pos(1/3 - t, 3/2) - pos(4/5*(t - 7/12), 3/2)")},
        ["at (0.583333, 0), side 0", "u - g < 0"],
    ),
    "both vanish": (
        {"gap": on_own_side("pos(1/3 - t, 3/2) + pos(t - 2/3, 1)/sqrt(3)")},
        ["at (0.583", "lambda and u - g vanish together on an interval"],
    ),
    "both vanish but for round-off": (
        {"u": [{"atom": "smooth", "formula": "cos(pi*x)"}], "gap": {"elsewhere": 0}},
        ["vanish together on an interval"],
    ),
    "cutoff meets another side": (
        {"u": [HARMONIC | {"cutoff": "1/2"}], "gap": on_own_side("pos(1/3 - t, 3/2) + pos(t - 5/6, 3/2)")},
        ["at (0, ", "side 3", "lambda"],
    ),
    "not finite": (
        {"gap": on_own_side(GAP + " + 1/(t - 1/2)**2")},
        ["at (0.5, 0), side 0", "is not finite"],
    ),
    "cutoff too small for its derivatives": (
        {"u": [HARMONIC | {"cutoff": "1e-160"}]},
        ["case 'mine' on 'square' at (0."],
    ),
    "(j) declared wrongly": (
        {"hypotheses": {"j": False, "jj": True, "jjj": True}},
        ["field hypotheses.j: (j) holds, declared otherwise"],
    ),
    "alpha < 0": ({"u": [HARMONIC | {"alpha": "-1/4"}]}, ["field hypotheses.j: (j) does not hold"]),
    "gap not Lipschitz": (
        {"gap": on_own_side("pos(1/3 - t, 1/2)/3 + pos(4/5*(t - 7/12), 3/2)")},
        ["field hypotheses.jj: (jj) does not hold"],
    ),
}


@pytest.mark.parametrize(("changed", "parts"), NOT_CERTIFIED.values(), ids=NOT_CERTIFIED)
def test_refused_with_the_point(
    declared: Callable[..., Path], changed: dict[str, Any], parts: list[str]
) -> None:
    message = refusal(declared(**changed))
    assert message.startswith("case 'mine'")
    for part in parts:
        assert part in message


@pytest.mark.parametrize("side", [1, 2, 3])
def test_natural_is_refused_on_other_sides(side: int) -> None:
    """There is contact on its first side only where lambda > 0 on the bottom."""
    assert "on 'square' at (" in refusal("natural", side=side)


def test_wrong_places() -> None:
    assert "is for square, not for 'lshape'" in refusal("natural", "lshape")
    assert "'square' has the sides 0 to 3, not 4" in refusal("thirds", "square", 4)
    assert "case 'unnatural' is unknown; the catalogue has borderline_0.05," in refusal("unnatural")
    assert "there is no file nowhere.yaml" in refusal("nowhere.yaml")
    with pytest.raises(InputError, match="polygon 'circle' is unknown"):
        named("circle")


def test_a_constant_without_a_value(declared: Callable[..., Path]) -> None:
    triangle = Polygon(np.array([[0, 0], [1, 0], [0, 1]]), "triangle")
    file = declared(polygons="any", constants={"c1": {"square": "1/2"}})
    with pytest.raises(InputError, match="case 'mine': the constant 'c1' has no value for 'triangle'"):
        cases.load(file, triangle)


BAD_FIELDS: dict[str, tuple[dict[str, Any], str]] = {
    "unknown field": (
        {"gaps": 0},
        "mine.yaml: there is no field 'gaps' here; the fields are ",
    ),
    "a number as a name": (
        {"constants": {1: 2}},
        "case 'mine', field constants: '1' cannot be a constant's name; take one such as c1",
    ),
    "a formula of a constant 0": (
        {"constants": {"c": 0}, "gap": {"elsewhere": "t/c"}},
        "case 'mine', gap.elsewhere: it is not a finite real function",
    ),
    "a variable as a name": ({"constants": {"t": 2}}, "field constants: 't' cannot be a constant's name"),
    "a keyword as a name": ({"constants": {"if": 2}}, "field constants: 'if' cannot be a constant's name"),
    "a function as a name": ({"constants": {"pos": 2}}, "field constants: 'pos' cannot be a constant's name"),
    "yes": (
        {"hypotheses": {"j": "yes", "jj": True, "jjj": True}},
        "'yes' is not of type 'boolean'; write true",
    ),
    "missing field": ({"gap": None}, "mine.yaml: 'gap' is a required property"),
    "unknown atom": ({"u": [{"atom": "harmonc"}]}, "mine.yaml, field u[0].atom: 'harmonc' is not one of"),
    "field of another atom": (
        {"u": [HARMONIC | {"profile": 1}]},
        "field u[0]: there is no field 'profile' here; the fields are ",
    ),
    "missing in an atom": ({"u": [{"atom": "tensor", "side": 0}]}, "field u[0]: 'profile' is a required"),
    "wrong type": ({"hypotheses": {"j": 1, "jj": True, "jjj": True}}, "field hypotheses.j: 1 is not of type"),
    "negative side": ({"u": [HARMONIC | {"side": -2}]}, "field u[0].side: -2 is less than the minimum"),
    "at a vertex": ({"u": [HARMONIC | {"at": 1}]}, "case 'mine', u[0], at: 1 must lie between 0 and 1"),
    "no cutoff": ({"u": [HARMONIC | {"cutoff": 0}]}, "u[0], cutoff: 0 must be positive"),
    "irrational": ({"u": [HARMONIC | {"alpha": "sqrt(2)"}]}, "u[0], alpha: sqrt(2) must be a fraction"),
    "integer": ({"u": [HARMONIC | {"alpha": 1}]}, "a harmonic atom needs alpha > -1 that is not an integer"),
    "rough profile": (
        {"u": [{"atom": "tensor", "side": 0, "profile": "pos(t, 1)", "cutoff": 1}]},
        "u[0], profile: its powers must be above 3/2",
    ),
    "kink in a smooth atom": (
        {"u": [{"atom": "smooth", "formula": "pos(x, 2)"}]},
        "u[0]: a smooth atom has no",
    ),
    "hidden kink": ({"gap": on_own_side("sqrt(t)")}, "gap.sides[0]: write a fractional power as pos(a, k)"),
    "unknown name": ({"gap": {"elsewhere": "x"}}, "gap.elsewhere: 'x' is unknown; known are t, pi"),
}


@pytest.mark.parametrize(("changed", "message"), BAD_FIELDS.values(), ids=BAD_FIELDS)
def test_bad_fields_are_named(declared: Callable[..., Path], changed: dict[str, Any], message: str) -> None:
    assert message in refusal(declared(**changed))


@pytest.mark.parametrize("content", [b"title: [", b"\xff\xfe"])
def test_a_file_that_is_not_yaml(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "mine.yaml"
    file.write_bytes(content)
    assert "mine.yaml is not a YAML file" in refusal(file)


def test_a_harmonic_atom_without_a_cutoff_needs_a_half_plane(declared: Callable[..., Path]) -> None:
    endless = {key: value for key, value in HARMONIC.items() if key != "cutoff"}
    message = refusal(declared(u=[endless]), "lshape", 1)
    assert "a harmonic atom on side 1 of 'lshape' needs a cutoff" in message
