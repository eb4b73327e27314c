"""What rounding does to the parts of a residual, against numbers with eleven bits more; and s' by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hand_made import Manufactured, enclosed

from unilateral.bounds import flux_residuals
from unilateral.bounds.boundary_flux import nothing
from unilateral.bounds.equilibrated_flux import equilibrated, flows
from unilateral.bounds.flux_residuals import by_parts, misfit, move_parts, residual_parts
from unilateral.bounds.residual_norm import SUMS, ResidualParts
from unilateral.bounds.source import Source
from unilateral.fem.form import H1, Form
from unilateral.fem.p2 import layer, linear_squares, quadratic, squares
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

MORE = np.longdouble
MESHES = {
    "square": lambda: structured(square(), 1 / 16),
    "lshape": lambda: meshes.unstructured(named("lshape"), 0.1),
    "thin": lambda: meshes.unstructured(
        Polygon(np.array([[0, 0], [10, 0], [10, 1e-3], [0, 1e-3]]), "thin"), 0.05
    ),
    "far": lambda: meshes.unstructured(Polygon(square().vertices + np.array([0, 1e6]), "far"), 0.2),
}
RESERVE = 256
"""The allowance over what rounding does at random: some twenty operations may all round the same way."""


def as_if_exact(mesh):
    """The mesh with sides that go through its nodes, so that what is allowed is for rounding alone."""
    mesh.__dict__["distortion"] = np.zeros(len(mesh.triangles))
    mesh.polygon.__dict__["stretch"] = np.zeros(len(mesh.polygon.vertices))
    return mesh


def finer(mesh):
    """The same triangles, their areas with those bits."""
    points = mesh.points.astype(MORE)
    a, b, c = (points[mesh.triangles[:, i]] for i in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    edges = {"triangulation": mesh.triangulation, "opposite_edges": mesh.opposite_edges}
    return SimpleNamespace(points=points, triangles=mesh.triangles, areas=(ux * vy - uy * vx) / 2, **edges)


def functions(mesh):
    x = mesh.points[:, 0] - mesh.points[:, 0].min()
    return [np.random.default_rng(0).standard_normal(mesh.n_nodes), 1e6 + x, x]


def of_x(mesh):
    """q.n for q = (1, 0)."""
    return np.repeat(mesh.polygon.normals[mesh.side, :1], 2, axis=1)


def fluxes(mesh, u, source):
    """One that has nothing to do with u, and one that cancels with it."""
    yield np.random.default_rng(1).standard_normal((2, len(mesh.triangulation.ends)))
    yield equilibrated(mesh, u, source.moments, of_x(mesh))


def without_allowances(monkeypatch):
    monkeypatch.setattr(flux_residuals, "allowances", lambda mesh, of, *_: np.zeros((2, len(mesh.areas[of]))))


def shares(mesh, monkeypatch):
    """What rounding has done to the parts of f + div q - u and k grad u - q, over what is allowed for it."""
    of, zero = finer(mesh), np.zeros(len(mesh.triangles))
    for u in functions(mesh):
        source = Source(mesh, 1.1 * u[mesh.triangles], zero, zero)
        for q in fluxes(mesh, u, source):
            parts = residual_parts(source, nothing(mesh), u, q, H1)
            with monkeypatch.context() as patch:
                without_allowances(patch)
                plain = residual_parts(source, nothing(mesh), u, q, H1)
            field = misfit(of, u.astype(MORE), q.astype(MORE), slice(None))
            exact = np.sqrt(linear_squares(of.areas, field))
            yield np.linalg.norm(plain.misfit - exact) / np.linalg.norm(parts.misfit - plain.misfit)
            flow = np.sum(flows(of, q.astype(MORE), slice(None)), axis=(0, 1))
            g = source.f_h.astype(MORE) - u.astype(MORE)[of.triangles]
            mean = g.mean(axis=1) - flow / 2 / of.areas
            oscillation = np.sqrt(linear_squares(of.areas, g - g.mean(axis=1, keepdims=True)))
            for own, other in ((plain.mean, np.sqrt(of.areas) * abs(mean)), (plain.oscillation, oscillation)):
                yield np.linalg.norm(own - other) / np.linalg.norm(parts.rest - plain.rest)


@pytest.mark.skipif(np.finfo(MORE).nmant < 63, reason="this machine has no longer numbers")
@pytest.mark.parametrize("name", MESHES)
def test_rounding_is_far_below_its_allowance_and_not_nothing(name, monkeypatch):
    worst = max(shares(as_if_exact(MESHES[name]()), monkeypatch))
    assert 1e-4 < worst < 1 / RESERVE


def test_rounding_is_added():
    """u = 1e6 + x, f = u: the error of its interpolant is 0, and the bound what derivatives of it lose."""
    problem = Manufactured(square(), "1000000 + x", "1")
    mesh = structured(square(), 1 / 16)
    u_h, source = 1e6 + mesh.points[:, 0], enclosed(mesh, problem)
    q = equilibrated(mesh, u_h, source.moments, of_x(mesh))
    assert 0 < max(residual_parts(source, nothing(mesh), u_h, q, H1).norms(H1)) < 1e-4


def test_the_rounding_of_a_root_of_a_sum():
    """Of 16 million squares, each added with half a unit of rounding: the root has half of that."""
    assert SUMS >= 16e6 * 2.0**-53 / 2


def copied(parts):
    """The same parts, in arrays of their own."""
    return ResidualParts(parts.mesh, *(part.copy() for part in parts[1:]))


@pytest.mark.parametrize("form", [Form(2.0, 3.0), Form(1.0, 0.0), Form(0.5, 1e4)])
def test_the_parts_of_a_function_of_P2_are_those_of_its_coefficients(form, monkeypatch):
    """On all triangles of a mesh whose nodes lie on the boundary, against P2 there. Control: of u_h alone."""
    without_allowances(monkeypatch)
    mesh, rng = structured(square(), 1), np.random.default_rng(5)
    spaces, of = quadratic(mesh), layer(mesh)
    u_h, nodal, edges = rng.standard_normal((3, 4))
    q, f_h = rng.standard_normal((2, 5)), rng.standard_normal((2, 3))
    source = Source(mesh, f_h, np.zeros(2), np.zeros(2))
    tau = nothing(mesh)
    before = residual_parts(source, tau, u_h, q, form)
    hats, bubbles = of.function(nodal, edges)
    found = copied(before)
    move_parts(found, source, tau, u_h, q, form, of, hats, bubbles)
    v = spaces.of_hats(u_h)
    v[spaces.of_boundary] += np.concatenate([nodal, edges])
    of_hats, of_bubbles = spaces.coefficients(v)
    field = misfit(mesh, np.zeros(4), q, slice(None)) + form.k * spaces.gradient(v)
    assert found.misfit == pytest.approx(np.sqrt(linear_squares(mesh.areas, field)))
    divergence = -0.5 * np.sum(flows(mesh, q, slice(None)), axis=(0, 1)) / mesh.areas
    rho = f_h - form.c * of_hats + divergence[:, None]
    mean = (rho.sum(axis=1) - form.c * of_bubbles.sum(axis=1)) / 3
    assert found.mean == pytest.approx(np.sqrt(mesh.areas) * np.abs(mean))
    rest = squares(mesh.areas, rho - mean[:, None], -form.c * of_bubbles)
    assert found.oscillation == pytest.approx(np.sqrt(rest))
    assert not np.allclose(found.misfit, before.misfit)


def test_parts_of_other_triangles_stay():
    mesh, rng = structured(square(), 1 / 8), np.random.default_rng(6)
    u_h, q = rng.standard_normal(mesh.n_nodes), rng.standard_normal((2, len(mesh.triangulation.ends)))
    m = len(mesh.triangles)
    source, tau, of = Source(mesh, np.zeros((m, 3)), *np.zeros((2, m))), nothing(mesh), layer(mesh)
    before = residual_parts(source, tau, u_h, q, Form(1.0, 1e3))
    hats, bubbles = of.function(*rng.standard_normal((2, len(mesh.boundary))))
    after = copied(before)
    move_parts(after, source, tau, u_h, q, Form(1.0, 1e3), of, hats, bubbles)
    inside = np.setdiff1d(np.arange(m), of.triangles)
    for own, other in zip(before[1:], after[1:], strict=True):
        assert np.array_equal(own[inside], other[inside])
        assert not np.array_equal(own[of.triangles], other[of.triangles])


def constant_flux(mesh):
    """(2, E) q = (1, 0), and the source of nothing."""
    m = len(mesh.triangles)
    source = Source(mesh, np.zeros((m, 3)), *np.zeros((2, m)))
    return equilibrated(mesh, mesh.points[:, 0], source.moments, of_x(mesh), Form(c=0.0)), source


@pytest.mark.parametrize(("c", "part"), [(0.0, "misfit"), (1e4, "by_parts")])
def test_on_the_exact_mesh_a_flux_is_larger_by_the_distortion(c, part):
    """eps |q|, with |q| = 1 on the unit square, whose area is 1."""
    mesh = structured(square(), 1 / 4)
    q, source = constant_flux(mesh)
    found = []
    for eps in (0.0, 1e-3):
        mesh.__dict__["distortion"] = np.full(len(mesh.triangles), eps)
        parts = residual_parts(source, nothing(mesh), mesh.points[:, 0], q, Form(1.0, c))
        found.append(np.linalg.norm(getattr(parts, part)))
    assert found[1] - found[0] >= 1e-3 * (1.0 if part == "misfit" else c**-0.25)
    assert found[1] - found[0] <= 0.05


@pytest.mark.parametrize("k", [1.0, 3.0])
def test_c_and_k_are_in_the_residual(k):
    """q = (1, 0) and f = 0: div q = 0, and -c x has its mean on each triangle; k grad x - q is (k - 1, 0)."""
    mesh = structured(square(), 1 / 4)
    q, source = constant_flux(mesh)
    x = mesh.points[:, 0]
    for c in (0.0, 1.0, 5.0):
        parts = residual_parts(source, nothing(mesh), x, q, Form(k, c))
        length = np.sqrt(mesh.areas)
        assert parts.misfit == pytest.approx((k - 1) * length, abs=1e-11)
        assert parts.mean == pytest.approx(c * x[mesh.triangles].mean(axis=1) * length, abs=1e-11)


@pytest.mark.parametrize("length", [1.0, 1e-3])
def test_on_the_exact_mesh_flows_are_larger_by_the_stretch(length, monkeypatch):
    """q_T of Raviart and Thomas with the flow F at an edge: |div q_T| = F/|T|, |q_T| <= F d / (2 |T|)."""
    mesh = structured(Polygon(length * square().vertices, "scaled"), length)
    q, source = constant_flux(mesh)
    without = residual_parts(source, nothing(mesh), mesh.points[:, 0], q, H1)
    monkeypatch.setattr(Polygon, "stretch", property(lambda self: np.array([0, 1e-3, 0, 0])))
    found = residual_parts(source, nothing(mesh), mesh.points[:, 0], q, H1)
    flow, area, d = 1e-3 * length, length**2 / 2, math.sqrt(2) * length
    (right,) = mesh.boundary_triangles[mesh.side == 1]
    more = found.rest - without.rest
    assert (1 - 1e-9) * flow / area <= more[right] / math.sqrt(area) <= 2 * flow / area
    more_field = found.misfit - without.misfit
    assert (1 - 1e-9) * flow * d / (2 * area) <= more_field[right] / math.sqrt(area) <= 2 * flow * d / area
    for each in (more, more_field):
        assert each.sum() == pytest.approx(each[right], rel=1e-9)


def test_on_the_exact_mesh_fields_are_larger_at_edges():
    """k grad v - q = (1, 0) on the unit square: its flow through edges may be larger by eps |k grad v|.

    With eps = 1/1000 that is some thousandths of it, for grad v is no larger than it with q = 0.
    """
    mesh, every = structured(square(), 1 / 4), np.arange(32)
    field = np.stack([np.ones((3, 32)), np.zeros((3, 32))])
    found = []
    for eps in (0.0, 1e-3):
        mesh.__dict__["distortion"] = np.full(32, eps)
        found.append(by_parts(mesh, every, field, np.zeros(32), np.zeros(32), Form(1.0, 1e4)))
    assert np.all(found[1] >= (1 + 0.9e-3) * found[0])
    assert np.all(found[1] <= (1 + 4e-3) * found[0])


def test_by_parts_a_function_of_P2_has_its_laplacian():
    """v = x^2 on a square without a flux, f = 0: f - c v + k lap v = 2 k - c x^2, and no more in the mean."""
    mesh, form = structured(square(), 1), Form(1.0, 100.0)
    m = len(mesh.triangles)
    source, of = Source(mesh, np.zeros((m, 3)), *np.zeros((2, m))), layer(mesh)
    u_h, q = mesh.points[:, 0] ** 2, np.zeros((2, 5))
    before = residual_parts(source, nothing(mesh), u_h, q, form)
    start, end = mesh.points[mesh.boundary], mesh.points[np.roll(mesh.boundary, -1)]
    edges = -0.25 * (end - start)[:, 0] ** 2
    hats, bubbles = of.function(np.zeros(4), edges)
    # the diagonal has a bubble, too
    node = [[i for i in range(3) if bubbles[t, i] == 0 and _crosses(mesh, t, i)] for t in range(m)]
    for t, (i,) in enumerate(node):
        bubbles[t, i] = -0.25
    found = copied(before)
    move_parts(found, source, nothing(mesh), u_h, q, form, of, hats, bubbles)
    x = np.linspace(0, 1, 2001)
    # sums over the square of (2 - 100 x^2)^2, and the flow (-2 x, 0) through all edges of both triangles
    inside = math.sqrt(np.mean((2 - 100 * x**2) ** 2))
    field = -2 * mesh.points[mesh.triangles][..., 0].T
    flows_in = by_parts(mesh, np.arange(m), np.stack([field, 0 * field]), np.zeros(m), np.zeros(m), form)
    squares_inside = (found.by_parts - flows_in) ** 2 * form.c
    assert math.sqrt(squares_inside.sum()) == pytest.approx(inside, rel=1e-3)


def _crosses(mesh, t, i):
    """Whether an edge of a triangle is the diagonal of the square."""
    a, b = mesh.points[mesh.triangles[t, [i, (i + 1) % 3]]]
    return np.all(a != b)
