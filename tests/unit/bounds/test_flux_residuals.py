"""What rounding does to the parts of a residual, against numbers with eleven bits more; and s' by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hand_made import Manufactured, enclose_source
from skfem.quadrature import get_quadrature_tri

from unilateral.bounds import flux_residuals
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.equilibrated_flux import equilibrate_flux, triangle_inflows
from unilateral.bounds.flux_residuals import add_lift_to_residual, bound_by_parts, misfit, residual_parts
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, ResidualParts
from unilateral.bounds.source import Source
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import gradients
from unilateral.fem.p2 import boundary_layer, linear_square_norms, quadratic_space, quadratic_square_norms
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

MORE = np.longdouble
MESHES = {
    "square": lambda: make_structured_mesh(square(), 1 / 16),
    "lshape": lambda: meshes.make_unstructured_mesh(find_polygon("lshape"), 0.1),
    "thin": lambda: meshes.make_unstructured_mesh(
        Polygon(np.array([[0, 0], [10, 0], [10, 1e-3], [0, 1e-3]]), "thin"), 0.05
    ),
    "far": lambda: meshes.make_unstructured_mesh(Polygon(square().vertices + np.array([0, 1e6]), "far"), 0.2),
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
    a = points[mesh.triangles[:, 0]]
    b = points[mesh.triangles[:, 1]]
    c = points[mesh.triangles[:, 2]]
    (ux, uy) = (b - a).T
    (vx, vy) = (c - a).T
    edges = {"triangulation": mesh.triangulation, "opposite_edges": mesh.opposite_edges}
    return SimpleNamespace(points=points, triangles=mesh.triangles, areas=(ux * vy - uy * vx) / 2, **edges)


def functions(mesh):
    x = mesh.points[:, 0] - mesh.points[:, 0].min()
    return [np.random.default_rng(0).standard_normal(mesh.n_nodes), 1e6 + x, x]


def flux_of_x_direction(mesh):
    """q.n for q = (1, 0)."""
    return np.repeat(mesh.polygon.normals[mesh.side, :1], 2, axis=1)


def fluxes(mesh, u, source):
    """One that has nothing to do with u, and one that cancels with it."""
    yield np.random.default_rng(1).standard_normal((2, len(mesh.triangulation.ends)))
    yield equilibrate_flux(mesh, u, source.moments, flux_of_x_direction(mesh))


def forbid_allowances(monkeypatch):
    monkeypatch.setattr(
        flux_residuals,
        "rounding_allowances",
        lambda mesh, triangles, *_: np.zeros((2, len(mesh.areas[triangles]))),
    )


def shares(mesh, monkeypatch):
    """What rounding has done to the parts of f + div q - u and k grad u - q, over what is allowed for it."""
    fine = finer(mesh)
    zero = np.zeros(len(mesh.triangles))
    for u in functions(mesh):
        source = Source(mesh, 1.1 * u[mesh.triangles], zero, zero, zero)
        for q in fluxes(mesh, u, source):
            components = residual_parts(source, no_given_flux(mesh), u, q, H1)
            with monkeypatch.context() as patch:
                forbid_allowances(patch)
                plain = residual_parts(source, no_given_flux(mesh), u, q, H1)
            field = misfit(fine, u.astype(MORE), q.astype(MORE), slice(None))
            exact = np.sqrt(linear_square_norms(fine.areas, field))
            yield np.linalg.norm(plain.misfit - exact) / np.linalg.norm(components.misfit - plain.misfit)
            flow = np.sum(triangle_inflows(fine, q.astype(MORE), slice(None)), axis=(0, 1))
            g = source.f_h.astype(MORE) - u.astype(MORE)[fine.triangles]
            mean = g.mean(axis=1) - flow / 2 / fine.areas
            oscillation = np.sqrt(linear_square_norms(fine.areas, g - g.mean(axis=1, keepdims=True)))
            for computed, expected in (
                (plain.mean, np.sqrt(fine.areas) * abs(mean)),
                (plain.oscillation, oscillation),
            ):
                yield np.linalg.norm(computed - expected) / np.linalg.norm(
                    components.remainder - plain.remainder
                )


@pytest.mark.skipif(np.finfo(MORE).nmant < 63, reason="this machine has no longer numbers")
@pytest.mark.parametrize("name", MESHES)
def test_rounding_is_far_below_its_allowance_and_not_nothing(name, monkeypatch):
    worst = max(shares(as_if_exact(MESHES[name]()), monkeypatch))
    assert 1e-4 < worst < 1 / RESERVE


def test_rounding_is_added():
    """u = 1e6 + x, f = u: the error of its interpolant is 0, and the bound what derivatives of it lose."""
    problem = Manufactured(square(), "1000000 + x", "1")
    mesh = make_structured_mesh(square(), 1 / 16)
    u_h = 1e6 + mesh.points[:, 0]
    source = enclose_source(mesh, problem)
    q = equilibrate_flux(mesh, u_h, source.moments, flux_of_x_direction(mesh))
    assert 0 < max(residual_parts(source, no_given_flux(mesh), u_h, q, H1).dual_norms()) < 1e-4


def test_the_allowance_for_roots_of_sums_covers_16_million_squares():
    """Of 16 million squares, each added with half a unit of rounding: the root has half of that."""
    assert SQUARES_ROUNDING >= 16e6 * 2.0**-53 / 2


def copy_components(components):
    """The same parts, in arrays of their own."""
    return ResidualParts(
        components.mesh, components.form, *(component.copy() for component in components[2:])
    )


@pytest.mark.parametrize("form", [Form(2.0, 3.0), Form(1.0, 0.0), Form(0.5, 1e4)])
def test_the_parts_of_a_function_of_P2_are_those_of_its_coefficients(form, monkeypatch):
    """On all triangles of a mesh whose nodes lie on the boundary, against P2 there. Control: of u_h alone."""
    forbid_allowances(monkeypatch)
    mesh = make_structured_mesh(square(), 1)
    rng = np.random.default_rng(5)
    spaces = quadratic_space(mesh)
    layer = boundary_layer(mesh)
    u_h, nodal, edges = rng.standard_normal((3, 4))
    q = rng.standard_normal((2, 5))
    f_h = rng.standard_normal((2, 3))
    source = Source(mesh, f_h, *rng.uniform(1, 2, (2, 2)), np.zeros(2))
    tau = no_given_flux(mesh)
    before = residual_parts(source, tau, u_h, q, form)
    hats, bubbles = layer.expand(nodal, edges)
    components = copy_components(before)
    add_lift_to_residual(components, source, tau, u_h, q, layer, hats, bubbles)
    v = spaces.embed_linear(u_h)
    v[spaces.boundary_unknowns] += np.concatenate([nodal, edges])
    hat_coefficients, bubble_coefficients = spaces.coefficients(v)
    field = misfit(mesh, np.zeros(4), q, slice(None)) + form.k * spaces.gradient(v)
    assert components.misfit == pytest.approx(np.sqrt(linear_square_norms(mesh.areas, field)))
    divergence = -0.5 * np.sum(triangle_inflows(mesh, q, slice(None)), axis=(0, 1)) / mesh.areas
    rho = f_h - form.c * hat_coefficients + divergence[:, None]
    mean = (rho.sum(axis=1) - form.c * bubble_coefficients.sum(axis=1)) / 3
    assert components.mean == pytest.approx(np.sqrt(mesh.areas) * np.abs(mean))
    norm = np.sqrt(quadratic_square_norms(mesh.areas, rho - mean[:, None], -form.c * bubble_coefficients))
    assert components.oscillation == pytest.approx(norm + source.oscillation + source.jumps)
    # what f_h leaves is orthogonal to linear functions
    linear = f_h - form.c * u_h[mesh.triangles]
    squares_of_u = linear_square_norms(mesh.areas, linear - linear.mean(axis=1, keepdims=True))
    assert before.oscillation == pytest.approx(np.sqrt(squares_of_u + source.oscillation**2) + source.jumps)
    assert not np.allclose(components.misfit, before.misfit)


def test_parts_of_other_triangles_stay():
    """On the layer s' was finite for u_h; for a function of P2 it is infinite."""
    mesh = make_structured_mesh(square(), 1 / 8)
    rng = np.random.default_rng(6)
    u_h = rng.standard_normal(mesh.n_nodes)
    q = rng.standard_normal((2, len(mesh.triangulation.ends)))
    m = len(mesh.triangles)
    source = Source(mesh, np.zeros((m, 3)), *np.zeros((3, m)))
    tau = no_given_flux(mesh)
    layer = boundary_layer(mesh)
    before = residual_parts(source, tau, u_h, q, Form(1.0, 1e3))
    hats, bubbles = layer.expand(*rng.standard_normal((2, len(mesh.boundary))))
    after = copy_components(before)
    add_lift_to_residual(after, source, tau, u_h, q, layer, hats, bubbles)
    inside = np.setdiff1d(np.arange(m), layer.triangles)
    for original, second in zip(before[2:], after[2:], strict=True):
        assert np.array_equal(original[inside], second[inside])
        assert not np.array_equal(original[layer.triangles], second[layer.triangles])
    assert np.all(np.isfinite(before.s_prime))
    assert np.all(np.isinf(after.s_prime[layer.triangles]))


def constant_flux(mesh):
    """(2, E) q = (1, 0), and the source of nothing."""
    m = len(mesh.triangles)
    source = Source(mesh, np.zeros((m, 3)), *np.zeros((3, m)))
    return equilibrate_flux(
        mesh, mesh.points[:, 0], source.moments, flux_of_x_direction(mesh), Form(c=0.0)
    ), source


@pytest.mark.parametrize(("c", "component"), [(0.0, "misfit"), (1e4, "s_prime")])
def test_on_the_exact_mesh_a_flux_is_larger_by_the_distortion(c, component):
    """eps |q|, with |q| = 1 on the unit square, whose area is 1."""
    mesh = make_structured_mesh(square(), 1 / 4)
    q, source = constant_flux(mesh)
    computed = []
    for eps in (0.0, 1e-3):
        mesh.__dict__["distortion"] = np.full(len(mesh.triangles), eps)
        components = residual_parts(source, no_given_flux(mesh), mesh.points[:, 0], q, Form(1.0, c))
        computed.append(np.linalg.norm(getattr(components, component)))
    assert computed[1] - computed[0] >= 1e-3 * (1.0 if component == "misfit" else c**-0.25)
    assert computed[1] - computed[0] <= 0.05


@pytest.mark.parametrize("k", [1.0, 3.0])
def test_the_residual_has_the_coefficients_c_and_k(k):
    """q = (1, 0) and f = 0: div q = 0, and -c x has its mean on each triangle; k grad x - q is (k - 1, 0)."""
    mesh = make_structured_mesh(square(), 1 / 4)
    q, source = constant_flux(mesh)
    x = mesh.points[:, 0]
    for c in (0.0, 1.0, 5.0):
        components = residual_parts(source, no_given_flux(mesh), x, q, Form(k, c))
        length = np.sqrt(mesh.areas)
        assert components.misfit == pytest.approx((k - 1) * length, abs=1e-11)
        assert components.mean == pytest.approx(c * x[mesh.triangles].mean(axis=1) * length, abs=1e-11)


@pytest.mark.parametrize("length", [1.0, 1e-3])
def test_on_the_exact_mesh_flows_are_larger_by_the_stretch(length, monkeypatch):
    """q_T of Raviart and Thomas with the flow F at an edge: |div q_T| = F/|T|, |q_T| <= F d / (2 |T|)."""
    mesh = make_structured_mesh(Polygon(length * square().vertices, "scaled"), length)
    q, source = constant_flux(mesh)
    without = residual_parts(source, no_given_flux(mesh), mesh.points[:, 0], q, H1)
    monkeypatch.setattr(Polygon, "stretch", property(lambda self: np.array([0, 1e-3, 0, 0])))
    components = residual_parts(source, no_given_flux(mesh), mesh.points[:, 0], q, H1)
    flow = 1e-3 * length
    area = length**2 / 2
    d = math.sqrt(2) * length
    (right,) = mesh.boundary_triangles[mesh.side == 1]
    extra = components.remainder - without.remainder
    assert (1 - 1e-9) * flow / area <= extra[right] / math.sqrt(area) <= 2 * flow / area
    more_field = components.misfit - without.misfit
    assert (1 - 1e-9) * flow * d / (2 * area) <= more_field[right] / math.sqrt(area) <= 2 * flow * d / area
    for extra_remainder in (extra, more_field):
        assert extra_remainder.sum() == pytest.approx(extra_remainder[right], rel=1e-9)


def test_on_the_exact_mesh_fields_are_larger_at_edges():
    """k grad v - q = (1, 0) on the unit square: its flow through edges may be larger by eps |k grad v|.

    With eps = 1/1000 that is some thousandths of it, for grad v is no larger than it with q = 0.
    """
    mesh = make_structured_mesh(square(), 1 / 4)
    every = np.arange(32)
    field = np.stack([np.ones((3, 32)), np.zeros((3, 32))])
    computed = []
    for eps in (0.0, 1e-3):
        mesh.__dict__["distortion"] = np.full(32, eps)
        computed.append(bound_by_parts(mesh, every, field, np.zeros(32), np.zeros(32), Form(1.0, 1e4)))
    assert np.all(computed[1] >= (1 + 0.9e-3) * computed[0])
    assert np.all(computed[1] <= (1 + 4e-3) * computed[0])


def linear_flux(mesh, slopes):
    """(2, E) the flux with the components a + b x + c y; these are the `slopes` (2, 3)."""
    first, last = mesh.triangulation.ends.T
    start = mesh.points[first]
    end = mesh.points[last]
    along_x, along_y = (end - start).T
    flow = []
    for x, y in (start.T, end.T):
        q = slopes @ np.stack([np.ones_like(x), x, y])
        flow.append(q[1] * along_x - q[0] * along_y)
    return np.stack([flow[0] + flow[1], flow[0] - flow[1]]) / 2


def test_by_parts_a_residual_is_the_same(monkeypatch):
    """(q - k grad v, grad z)_T + (f + div q - c v, z)_T for a linear q and a quadratic z, by quadrature.

    It is (f - c v, z)_T and what flows through the edges, and at most s' times the norm of z. s' is made of
    these two parts. Triangles are large: s' is finite on all.
    """
    k = 2.0
    c = 5e3
    mesh = meshes.make_unstructured_mesh(square(), 0.35)
    rng = np.random.default_rng(7)
    m = len(mesh.triangles)
    form = Form(k, c)
    slopes = rng.standard_normal((2, 3))
    u_h = rng.standard_normal(mesh.n_nodes)
    f_h = rng.standard_normal((m, 3))
    source = Source(mesh, f_h, *c * rng.uniform(1, 2, (3, m)))
    calls = []
    original = flux_residuals.bound_by_parts
    monkeypatch.setattr(
        flux_residuals,
        "bound_by_parts",
        lambda *arguments: calls.append(arguments[1:4]) or original(*arguments),
    )
    components = residual_parts(source, no_given_flux(mesh), u_h, linear_flux(mesh, slopes), form)
    ((rows, at_nodes, inside),) = calls
    assert np.array_equal(rows, np.arange(m))

    def q(points):
        return np.moveaxis(slopes[:, :1, None] + np.tensordot(slopes[:, 1:], points, (1, 2)), 0, 2)

    # z = x^2 - x y + 2 y and its gradient
    def z(points):
        x, y = np.moveaxis(points, 2, 0)
        return x**2 - x * y + 2 * y

    def slope_of_z(points):
        x, y = np.moveaxis(points, 2, 0)
        return np.stack([2 * x - y, 2 - x], axis=2)

    # the field at the nodes is k grad v - q
    corners = mesh.points[mesh.triangles]
    slope = np.einsum("tid,ti->td", gradients(mesh), u_h[mesh.triangles])[:, None]
    np.testing.assert_allclose(at_nodes.transpose(2, 1, 0), k * slope - q(corners), rtol=1e-9, atol=1e-9)

    # the norm of f - c v, with what is left of f; p - f_h is orthogonal to f_h - c v
    points, weights = get_quadrature_tri(4)
    bary = np.column_stack([1 - points.sum(axis=0), *points])
    places = bary @ corners
    weights = 2 * mesh.areas[:, None] * weights
    g = (f_h - c * u_h[mesh.triangles]) @ bary.T
    norm = np.sqrt(np.sum(weights * g**2, axis=1) + source.oscillation**2) + source.jumps + source.remainder
    assert np.all(norm * (1 - 1e-12) <= inside)
    assert inside == pytest.approx(norm, rel=1e-6)

    # both sides; Simpson's rule is exact on edges
    field = np.sum((q(places) - k * slope) * slope_of_z(places), axis=2)
    divergence = slopes[0, 1] + slopes[1, 2]
    residual = np.sum(weights * (field + (g + divergence) * z(places)), axis=1)
    by_parts_of_it = np.sum(weights * g * z(places), axis=1)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        along_x, along_y = (corners[:, j] - corners[:, i]).T
        start = along_x * at_nodes[1, i] - along_y * at_nodes[0, i]
        end = along_x * at_nodes[1, j] - along_y * at_nodes[0, j]
        middle = z((corners[:, i] + corners[:, j])[:, None] / 2)[:, 0]
        z_start, z_end = z(corners)[:, [i, j]].T
        by_parts_of_it += (start * z_start + 2 * (start + end) * middle + end * z_end) / 6
    assert by_parts_of_it == pytest.approx(residual, rel=1e-9)
    squares_of_z = k * np.sum(slope_of_z(places) ** 2, axis=2) + c * z(places) ** 2
    assert np.all(np.abs(residual) <= components.s_prime * np.sqrt(np.sum(weights * squares_of_z, axis=1)))


def set_allowances(monkeypatch, field, rho):
    monkeypatch.setattr(
        flux_residuals,
        "rounding_allowances",
        lambda mesh, triangles, *_: np.array([[field], [rho]]) + 0 * mesh.areas[triangles],
    )


def test_by_parts_rounding_counts_on_edges_and_inside(monkeypatch):
    """Where all else is 0: by the formula, with a field of 5 at all edges, counted at most twice; and with 7.

    With the edges' lengths as weights the point x_0 is the centre of the circle that touches them.
    """
    mesh = make_structured_mesh(square(), 1 / 4)
    form = Form(2.0, 1e3)
    q = np.zeros((2, len(mesh.triangulation.ends)))
    zero = np.zeros(mesh.n_nodes)
    source = Source(mesh, np.zeros((32, 3)), *np.zeros((3, 32)))

    def compute_norms(field, rho):
        with monkeypatch.context() as patch:
            set_allowances(patch, field, rho)
            return residual_parts(source, no_given_flux(mesh), zero, q, form).s_prime

    assert compute_norms(1e-100, 7.0) == pytest.approx(7 * np.sqrt(mesh.areas / 1e3))
    R = (1 - math.sqrt(0.5)) / 4 / math.sin(math.pi / 8)
    G = 5 * (2 + math.sqrt(2)) / 4 / np.sqrt(mesh.areas)
    minimum = math.sqrt((1 + math.sqrt(1 + R**2 * 500)) / 2e3) * G
    assert np.all(minimum * (1 - 1e-9) <= compute_norms(5.0, 0.0))
    assert np.all(compute_norms(5.0, 0.0) <= 2 * minimum * (1 + 1e-9))


def test_by_parts_rounding_is_below_its_allowance(monkeypatch):
    """u = 1e6 + x and f = c u with q = k grad u: s' is 0, but for what derivatives of u lose.

    u is off by a unit in its last place. The slope has k/d times that, and s' k c^(-1/2) times and more.
    """
    mesh = as_if_exact(meshes.make_unstructured_mesh(square(), 1 / 16))
    form = Form(3.0, 1e6)
    u = 1e6 + mesh.points[:, 0]
    source = Source(mesh, 1e6 * u[mesh.triangles], *np.zeros((3, len(mesh.triangles))))
    q = linear_flux(mesh, np.array([[3.0, 0, 0], [0, 0, 0]]))
    allowed = residual_parts(source, no_given_flux(mesh), u, q, form).s_prime
    set_allowances(monkeypatch, 1e-100, 0.0)
    rounding = residual_parts(source, no_given_flux(mesh), u, q, form).s_prime
    assert rounding.max() > 3 * np.spacing(1e6) / 1e3
    assert np.all(rounding < allowed - rounding)


def test_by_parts_what_is_not_known_of_a_given_flux_counts():
    """On one edge its norm is 5. z = exp(-(c/k)^(1/2) t), t the distance, has ||z||_e / ||z|| = (k c)^(-1/4).

    At least, as the triangle lies within the strip of the edge.
    """
    mesh = make_structured_mesh(square(), 1 / 4)
    form = Form(2.0, 1e4, free=(0, 1, 2, 3))
    q, source = constant_flux(mesh)
    size = np.where(np.arange(16) == 3, 5.0, 0.0)
    s_primes = [
        residual_parts(
            source, no_given_flux(mesh)._replace(remainder_norms=unknown), mesh.points[:, 0], q, form
        ).s_prime
        for unknown in (0 * size, size)
    ]
    boundary_triangle = mesh.boundary_triangles[3]
    added = s_primes[1] - s_primes[0]
    assert added[boundary_triangle] >= 5 * 2e4 ** (-1 / 4)
    assert not np.delete(added, boundary_triangle).any()
