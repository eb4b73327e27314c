"""g on the edges of a mesh, what is done for v >= g there, and what is missing then."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
import sympy
from conftest import discrete
from hand_made import Manufactured, pair
from skfem.helpers import dot, grad

import unilateral as ul
from unilateral.bounds import constraint as constraints
from unilateral.bounds import feasible
from unilateral.bounds.constraint import Constraint, build_constraint
from unilateral.bounds.local_bounds import local_bound
from unilateral.fem.form import H1, Form
from unilateral.fem.p2 import boundary_layer
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import piecewise

WAVES = {
    "sin(40*pi*x) + y": lambda x, y: np.sin(40 * np.pi * x) + y,
    "100000*cos(3*x - y)": lambda x, y: 1e5 * np.cos(3 * x - y),
}


def make_constraint(text, n=4):
    """The constraint on all edges of a mesh of the unit square."""
    problem = ul.Problem(square(), f=0, g=text)
    mesh = make_structured_mesh(square(), 1 / n)
    return build_constraint(problem.enclosed_obstacle, mesh, H1)


@pytest.mark.parametrize("text", WAVES)
@pytest.mark.parametrize("maximum", [8, 60_000])
def test_g_is_within_the_doubt_of_p(text, maximum, monkeypatch):
    """In the points of the rule, against numpy. With 8 pieces the doubt is of the size of what p misses."""
    monkeypatch.setattr(piecewise, "MAX_SIDE_PIECES", maximum)
    constraint = make_constraint(text)
    s = (
        constraint.mesh.s[constraint.edge][:, None]
        + constraint.x * np.diff(constraint.mesh.s)[constraint.edge][:, None]
    )
    side = np.broadcast_to(constraint.mesh.side[constraint.edge][:, None], s.shape).ravel()
    points = constraint.mesh.polygon.at(side, s.ravel() - constraint.mesh.polygon.starts[side])
    g = WAVES[text](*points.T).reshape(s.shape)
    away = np.abs(g - constraint.p).max(axis=1)
    assert np.all(away <= constraint.remainder + 1e-15 * np.abs(g).max())
    assert np.all(g.max(axis=1) <= constraint.g_upper + 1e-15 * np.abs(g).max())
    if maximum == 8 and "40" in text:
        assert np.any(away > 0.5)
    if maximum > 8:
        assert constraint.remainder.max() <= 1e-9 * np.abs(g).max()


def test_what_is_added_for_the_doubt_is_pressed_like_the_doubt():
    """v = p = 0 on the unit square, doubt 1/1000, q.n = 1: v + 1/1000 - g may be 2/1000 all around."""
    constraint = make_constraint("0")
    g = replace(constraint, remainder=np.full_like(constraint.remainder, 1e-3))
    nb = len(g.mesh.boundary)
    every = np.ones(nb, dtype=bool)
    v = np.zeros(2 * nb)
    missing = feasible.bound_shortfall(g, H1, v, every, np.ones((nb, 2)))
    assert missing.nodal_raise == pytest.approx(1e-3)
    assert missing.complementarity == pytest.approx(8e-3)


def short_of(g, rng):
    """Of v from just below g to far above, at midpoints, too, and sigma > 0 on every third edge."""
    nb = len(g.unknowns)
    v = np.where(rng.random(2 * nb) < 0.2, g.p_at_unknowns, g.p_at_unknowns + rng.uniform(-0.1, 4, 2 * nb))
    contact = v == g.p_at_unknowns
    flux = np.where(np.arange(nb) % 3 == 0, rng.random((2, nb)), 0.0).T
    v, touching = feasible.raise_to_obstacle(g, H1, v, contact, flux, rng.random(nb))
    v[nb:] -= rng.uniform(0, 4, nb)
    shortfall = feasible.bound_shortfall(g, H1, v, touching, flux)
    return [v, touching, *shortfall, g.select_near_edges(v, touching)]


@pytest.mark.parametrize("seed", range(4))
def test_intervals_of_edges_far_from_g_change_nothing(seed, monkeypatch):
    """Against all of them; some are left out. Control: so they do where v is told by its ends only."""
    g = make_constraint("sin(9*pi*x) + y", 16)
    *computed, near = short_of(g, np.random.default_rng(seed))
    kept_select_near_edges = Constraint.select_near_edges
    monkeypatch.setattr(Constraint, "select_near_edges", lambda self, v, also: self)
    *expected, every = short_of(g, np.random.default_rng(seed))
    assert 0 < len(near.edge) < len(every.edge)
    for first, second in zip(computed, expected, strict=True):
        assert np.array_equal(first, second)

    def select_by_ends(self, v, also):
        level = v.copy()
        level[self.unknowns[:, 2]] = 0.5 * v[self.unknowns[:, :2]].sum(axis=1)
        return kept_select_near_edges(self, level, also)

    monkeypatch.setattr(Constraint, "select_near_edges", select_by_ends)
    *wrong, _ = short_of(g, np.random.default_rng(seed))
    assert wrong[2].sum() < 0.99 * expected[2].sum()


def extension_norm(triangle, r, form=H1):
    """||w|| of w(apex + t (y - apex)) = t r(y), y on the side from vertex 0 to 1, by differentiation."""
    a, b, c = triangle
    s, x, y = sympy.symbols("s x y")
    length = float(np.hypot(*(b - a)))
    e = (b - a) / length
    n = np.array([a[1] - b[1], b[0] - a[0]]) / length
    p = float((c - a) @ e)
    k = float((c - a) @ n)
    t = 1 - y / k
    w = t * r.subs(s, p + (x - p) / t)
    components = sympy.lambdify((x, y), [w, sympy.diff(w, x), sympy.diff(w, y)])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    nodes = 0.5 * (nodes + 1)
    weights = 0.5 * weights
    along, down = np.meshgrid(length * nodes, nodes)
    values = components(p + down * (along - p), k * (1 - down))
    weighted = zip((form.c, form.k, form.k), values, strict=True)
    density = sum(factor * np.asarray(value) ** 2 for factor, value in weighted)
    return np.sqrt(length * k * weights @ (density * down) @ weights)


def test_the_extension_s_norm_is_that_of_its_definition():
    """r = g - v for a cubic g on the edges of one triangle; what three edges share is tripled."""
    points = np.array([[0.0, 0.0], [1.3, 0.1], [0.4, 0.9]])
    polygon = Polygon(points, "triangle")
    problem = Manufactured(polygon, "x**3 - 2*x*y**2")
    mesh = meshes.from_arrays(polygon, points, [[0, 1, 2]])
    every = np.ones(3, dtype=bool)
    g = build_constraint(problem.enclose_gap(), mesh, H1)
    missing = feasible.bound_shortfall(g, H1, g.p_at_unknowns, every, np.ones((3, 2)))
    s = sympy.Symbol("s")
    squares = 0.0
    for i in range(3):
        a, b, c = np.roll(points, -i, axis=0)
        on_edge = a + (b - a) * np.array([0.0, 0.5, 1.0])[:, None]
        length = float(np.hypot(*(b - a)))
        along = sympy.interpolate(list(zip([0, length / 2, length], problem.u(*on_edge.T), strict=True)), s)
        x = float(a[0]) + s * float((b - a)[0]) / length
        y = float(a[1]) + s * float((b - a)[1]) / length
        squares += extension_norm((a, b, c), sympy.expand(x**3 - 2 * x * y**2 - along)) ** 2
    assert missing.extension_norm == pytest.approx(np.sqrt(3 * squares), rel=1e-10)
    assert 0 <= missing.complementarity <= 1e-8
    assert np.max(missing.nodal_raise) <= 1e-8


def shortfall(case, g, v, flux):
    """||w||_1 and <q.n, v + w - g> for w from r = (g - v)_+, by sums over 20000 points of every edge."""
    mesh = g.mesh
    x = (np.arange(20_000) + 0.5) / 20_000
    squares = 0.0
    slack = 0.0
    foot, height = feasible._extension_apexes(mesh, Form(c=0.0))
    shared = np.bincount(mesh.boundary_triangles)[mesh.boundary_triangles]
    for e, length in enumerate(np.diff(mesh.s)):
        start = mesh.s[e] - mesh.polygon.starts[mesh.side[e]]
        u, _, gap = case.trace_flux_and_gap(np.full(len(x), mesh.side[e]), start + length * x)
        a, b, c = v[g.unknowns[e]]
        below = u - gap - (a * (1 - x) * (1 - 2 * x) + b * x * (2 * x - 1) + 4 * c * x * (1 - x))
        r = np.maximum(below, 0)
        slope = np.gradient(np.maximum(below, 0), length * x)
        components = [length * np.mean(y**2) for y in (r, slope, (length * x - foot[e]) * slope)]
        slope_square = 0.5 * (height[e] * components[1] + (components[2] + 2 * components[0]) / height[e])
        squares += shared[e] * (slope_square + 0.25 * height[e] * components[0])
        slack += length * np.mean((flux[e, 0] * (1 - x) + flux[e, 1] * x) * (r - below))
    return np.sqrt(squares), slack


@pytest.mark.parametrize("name", ["thirds", "natural", "smooth"])
def test_what_is_missing_is_not_less_than_it_is(name):
    """v is g at the nodes and near it at midpoints, so that g - v changes its sign within edges.

    Against sums; they miss r' near kinks by less than 1e-3. Control: they are not much less either.
    """
    d = discrete(name, 8, 4)
    mesh = d.mesh
    case = d.exact.ritz.case
    values = np.ones(len(mesh.boundary), dtype=bool)
    g = build_constraint(case.problem.enclosed_obstacle, mesh, H1)
    v = np.where(np.isfinite(g.p_at_unknowns), g.p_at_unknowns, 0.0)
    rng = np.random.default_rng(1)
    v[len(values) :] += rng.normal(0, 0.01, len(values))
    flux = rng.random((len(values), 2))
    computed = feasible.bound_shortfall(g, H1, v, ~values, flux)
    norm, slack = shortfall(case, g, v, flux)
    assert (1 - 1e-3) * norm <= computed.extension_norm <= 1.15 * norm
    assert (1 - 1e-3) * slack <= computed.complementarity <= 1.3 * slack
    assert np.all(computed.nodal_raise <= 1e-6)


def test_p_that_differs_at_a_vertex_by_rounding_is_raised_there():
    """Else v - p would not vanish at the ends, and w would not be in H1; control: a jump."""
    values = np.array([True, True])
    unknowns = np.array([[0, 1, 3], [1, 2, 4]])
    on_edges = np.array([[1.0, 1.0, 2.0], [1 + 4e-14, 5.0, 3.0]])
    position, rise, jumps = constraints._join_at_vertices(on_edges, unknowns, values, np.full((2, 2), 1e-12))
    assert not jumps.any()
    np.testing.assert_allclose(rise, [[0, 4e-14], [0, 0]], rtol=1e-2)
    np.testing.assert_allclose(position - [1, 1, 5, 2, 3], [0, 4e-14, 0, 2e-14, 0], rtol=0.05, atol=1e-17)
    on_edges[1, 0] += 1e-11
    assert constraints._join_at_vertices(on_edges, unknowns, values, np.full((2, 2), 1e-12))[2].tolist() == [
        True,
        False,
    ]


def test_the_rounding_of_v_is_allowed_for():
    """On an edge where v varies by 1e9 p - v is not known better than to 1e-7 and more."""
    mesh = make_structured_mesh(square(), 1 / 2)
    problem = Manufactured(square(), "1", gap="1 + x")
    every = np.ones(8, dtype=bool)
    g = build_constraint(problem.enclose_gap(), mesh, H1)
    steep = np.zeros(16)
    steep[g.unknowns[0]] = 0.0, 1e9, 1e9 / 2
    v = np.maximum(steep, g.p_at_unknowns)
    flux = np.ones((8, 2))
    pair = v, np.maximum(0, g.p_at_unknowns)
    doubt = [feasible.bound_shortfall(g, H1, values, every, flux).nodal_raise.max() for values in pair]
    assert doubt[0] > 1e-16 * 1e9 > 100 * doubt[1]


def test_v_is_g_at_the_ends_of_edges_that_it_may_cross(monkeypatch):
    """Else the extension of g - v from such an edge would be no function of H1; u_h is above g there, too."""
    known_pair = pair("natural", 16)
    original = feasible.bound_shortfall
    calls = []
    monkeypatch.setattr(
        feasible, "bound_shortfall", lambda *arguments: calls.append(arguments[:4]) or original(*arguments)
    )
    local_bound(*known_pair.bound_arguments)
    g, _, v, touching = calls[0]
    unknowns = np.unique(g.unknowns[touching])
    assert np.all(v[unknowns] == g.p_at_unknowns[unknowns])
    nodes = unknowns[unknowns < len(touching)]
    assert np.max(known_pair.u_h[known_pair.mesh.boundary[nodes]] - g.p_at_unknowns[nodes]) > 1e-4


@pytest.mark.parametrize("form", [H1, Form(3.0, 0.0), Form(0.5, 1e3)])
@pytest.mark.parametrize("name", ["square", "lshape"])
def test_functions_of_the_layer_are_those_of_P2(name, form):
    """Norms against scikit-fem's, of random values at boundary nodes and midpoints."""
    mesh = meshes.make_unstructured_mesh(find_polygon(name), 0.3)
    rng = np.random.default_rng(0)
    layer = boundary_layer(mesh)
    nb = len(mesh.boundary)
    nodal, bubble = rng.standard_normal((2, nb))
    p2 = skfem.Basis(
        skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()), skfem.ElementTriP2(), intorder=4
    )
    v = np.zeros(p2.N)
    v[p2.nodal_dofs[0][mesh.boundary]] = nodal
    v[p2.facet_dofs[0]] = v[p2.nodal_dofs[0]][p2.mesh.facets].mean(axis=0)
    ends = np.sort(np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)]), axis=1)
    facets = [np.flatnonzero((two == p2.mesh.facets.T).all(axis=1))[0] for two in ends]
    v[p2.facet_dofs[0, facets]] += bubble

    @skfem.Functional
    def square(w):
        return form.k * dot(grad(w.of), grad(w.of)) + form.c * w.of**2

    square_norms = layer.square_norms(form, *layer.expand(nodal, bubble)).sum()
    assert square_norms == pytest.approx(square.assemble(p2, of=p2.interpolate(v)), rel=1e-12)
    norms = [layer.square_norms(form, *layer.expand(np.zeros(nb), item)).sum() for item in np.eye(nb)[:3]]
    assert layer.bubble_square_norms(form)[:3] == pytest.approx(norms, rel=1e-12)


@pytest.mark.parametrize("apex", [(0.25, 0.7), (1.4, 0.2), (-0.3, 0.4)])
@pytest.mark.parametrize(("length", "form"), [(1, H1), (20, H1), (1, Form(3.0, 0.0)), (1, Form(2.0, 1e3))])
def test_an_extension_is_bounded_by_the_slope_of_what_it_extends(apex, length, form):
    """r = sin(pi s / |e|) vanishes at the ends and has ||r||_e = |e| ||r'||_e / pi, the most there is.

    Its extension's norm is by differentiation; the vertex off the edge may lie beside it. On a large triangle
    most of the norm is that in L2.
    """
    points = length * np.array([[0.0, 0.0], [1.0, 0.0], apex])
    mesh = meshes.from_arrays(Polygon(points, "triangle"), points, [[0, 1, 2]])
    foot, height = feasible._extension_apexes(mesh, form)
    allowed = feasible._extension_constants(mesh, form, foot, height)[0]
    triangle = points[0], points[1], np.array([foot[0], height[0]])
    s = sympy.Symbol("s")
    nodes, weights = np.polynomial.legendre.leggauss(12)
    ratios = []
    for r in (sympy.sin(sympy.pi * s / length), s**3 * (length - s), s * (length - s) ** 3):
        slope = sympy.lambdify(s, sympy.diff(r, s))(0.5 * length * (1 + nodes))
        ratios.append(extension_norm(triangle, r, form) ** 2 / (0.5 * length * weights @ slope**2))
    assert max(ratios) <= allowed * (1 + 1e-9)
    assert allowed < 4 * ratios[0]


FLAT = Form(c=0.0)
"""For this form extensions fill their triangles."""


@pytest.mark.parametrize("form", [Form(4.0, 9.0), Form(1.0, 1e4)])
def test_extensions_are_not_deeper_than_two_layers(form):
    """Their triangles lie in those of the mesh, for the apex is between the edge's midpoint and a vertex."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.4, 3.0]])
    mesh = meshes.from_arrays(Polygon(points, "triangle"), points, [[0, 1, 2]])
    foot, height = feasible._extension_apexes(mesh, form)
    depth = 2 * np.sqrt(form.k / form.c)
    assert height[0] == pytest.approx(depth)
    assert foot[0] == pytest.approx(0.5 + (1.4 - 0.5) * depth / 3.0)
    assert feasible._extension_apexes(mesh, FLAT)[0][0] == pytest.approx(1.4)
    # the norm of a shallow extension is about (c k)^(1/4); without that depth it would be c^(1/2)
    r = sympy.Symbol("s") * (1 - sympy.Symbol("s"))
    shallow = extension_norm((points[0], points[1], np.array([foot[0], depth])), r, form)
    assert (depth < 0.1) == (shallow < 0.3 * extension_norm(tuple(points), r, form))


@pytest.mark.parametrize("apex", [(0.5, 0.01), (0.5, 50.0), (0.25, 0.7), (1.4, 0.2)])
def test_no_extension_exceeds_what_its_slope_allows(apex):
    """The largest norm over all r = sum r_k sin(k pi s) with ||r'|| = 1, k up to 60, by an eigenvalue."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], apex])
    mesh = meshes.from_arrays(Polygon(points, "triangle"), points, [[0, 1, 2]])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s = 0.5 * (1 + nodes)
    weight = 0.5 * weights
    k = np.pi * np.arange(1, 61)[:, None]
    slopes = np.sqrt(2) * np.cos(k * s)
    values = np.sqrt(2) * np.sin(k * s) / k
    foot, height = apex
    slope_squares = slopes * weight @ slopes.T
    arm_squares = ((s - foot) * slopes) * weight @ ((s - foot) * slopes).T
    value_squares = values * weight @ values.T
    form = (
        0.5 * (height * slope_squares + (arm_squares + 2 * value_squares) / height)
        + 0.25 * height * value_squares
    )
    largest = np.linalg.eigvalsh(form)[-1]
    assert (
        largest
        <= feasible._extension_constants(mesh, H1, *feasible._extension_apexes(mesh, FLAT))[0]
        <= 1.5 * largest
    )
