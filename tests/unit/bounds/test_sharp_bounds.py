"""The sharp bound: its identity, its flux and its potential, and the steps towards the best ones."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import skfem
from conftest import bound_arguments
from hand_made import LINEAR_SOURCE, Manufactured, enclose_source, given_to, pair, u_of
from skfem.helpers import div, dot, grad
from skfem.quadrature import get_quadrature_tri

import unilateral as ul
from unilateral.bounds import balanced_potential, feasible, flux_residuals, misfit_field
from unilateral.bounds import sharp_bounds as bounds
from unilateral.bounds.balanced_potential import balance_potential, build_energy
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.constraint import build_constraint
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.flux_residuals import bound_by_parts, misfit, residual_parts
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.misfit_field import MisfitField, build_misfit_field
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.bounds.source import Source, linear_source
from unilateral.fem import linear_systems
from unilateral.fem.condense import form_matrix
from unilateral.fem.form import H1, Form
from unilateral.fem.linear_systems import factorise_by_dissection
from unilateral.fem.p1 import gradients
from unilateral.fem.p2 import quadratic_space, quadratic_square_norms
from unilateral.fem.quadrature import boundary_rule
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.least_fluxes import normal_flux_matrix
from unilateral.norms.oscillation import trace_constants
from unilateral.norms.reference import boundary_facets


def flux_in(field, bary):
    """q (m, k, 2) and div q (m, k) in the points (k, 3) of every triangle, by differentiation."""
    spaces = field.spaces
    hats = field.misfit_hats
    slopes = spaces.hat_gradients(slice(None))
    pairs = [(0, 1), (1, 2), (2, 0)]
    bubbles = np.stack([4 * bary[:, i] * bary[:, j] for i, j in pairs], axis=1)
    w = field.form.k * np.einsum("tid,ti->td", slopes, field.w[spaces.mesh.triangles])[:, None]
    difference = np.einsum("kb,tbd->tkd", bary, hats) + np.einsum(
        "kb,tbd->tkd", bubbles, field.misfit_bubbles
    )
    divergence = np.einsum("tid,tid->t", slopes, hats)[:, None]
    for b, (i, j) in enumerate(pairs):
        along = [np.einsum("td,td->t", field.misfit_bubbles[:, b], slopes[:, c])[:, None] for c in (i, j)]
        divergence = divergence + 4 * (along[0] * bary[:, j] + along[1] * bary[:, i])
    return w + difference, divergence


def field_of(spaces, source, w, sigma, form):
    """The field of the flux with q.n = sigma (nb, 2) on the boundary, for w or what balances it."""
    energy = build_energy(spaces.mesh, form)
    w, q = balance_potential(source, w, sigma, energy)
    return build_misfit_field(spaces, source, w, q, form)


def make_random_flux(problem, mesh, seed=0):
    """The flux for random w and sigma, turned by a random phi; and sigma, v - w, v at the boundary, too."""
    rng = np.random.default_rng(seed)
    nb = len(mesh.boundary)
    spaces = quadratic_space(mesh)
    sigma = problem.k * rng.standard_normal((nb, 2))
    form = Form(problem.k, problem.c)
    w = rng.standard_normal(mesh.n_nodes)
    field = field_of(spaces, enclose_source(mesh, problem), w, sigma, form)
    phi, d = rng.standard_normal((2, spaces.size))
    phi[spaces.boundary_unknowns] = 0
    return field.add_curl(problem.k * phi), sigma, d


def rule_of(mesh, degree):
    """Barycentric points (k, 3), places (m, k, 2), weights (m, k)."""
    points, weights = get_quadrature_tri(degree)
    bary = np.column_stack([1 - points.sum(axis=0), *points])
    return bary, bary @ mesh.points[mesh.triangles], 2 * mesh.areas[:, None] * weights


def u_with_linear_source(k, c):
    """A u with -k Delta u + c u = c (x/10 - y/20)."""
    rate = math.sqrt(c / k)
    return f"cosh({rate}*(x - 0.4)) + cosh({rate}*(y - 0.55)) + 0.1*x - 0.05*y"


@pytest.mark.parametrize(("k", "c"), [(1.0, 1.0), (3.0, 48.0), (0.25, 0.0625)])
@pytest.mark.parametrize("name", ["square", "wedge"])
def test_the_identity_holds_for_any_v_and_any_flux(name, k, c):
    """The left side by quadrature with the exact u, for random v of P2 and a random flux.

    All of it is contact, so 2 <q.n, u - g> = 0. Control: half of 2 <lambda, v - g> is not enough.
    """
    wedge = Polygon(np.array([[0, 0], [1, 0], [np.cos(np.pi / 18), np.sin(np.pi / 18)]]), "wedge")
    polygon = square() if name == "square" else wedge
    problem = Manufactured(polygon, u_with_linear_source(k, c), k=k, c=c)
    mesh = meshes.make_unstructured_mesh(polygon, 0.35)
    field, sigma, d = make_random_flux(problem, mesh)
    spaces = field.spaces
    v = field.spaces.embed_linear(field.w) + d
    bary, places, weights = rule_of(mesh, 14)
    q, div_q = flux_in(field, bary)
    u = problem.u(*np.moveaxis(places, 2, 0))
    u_x = problem.u_x(*np.moveaxis(places, 2, 0))
    u_y = problem.u_y(*np.moveaxis(places, 2, 0))
    f = problem.f(*np.moveaxis(places, 2, 0))
    shapes = np.column_stack([bary, *(4 * bary[:, i] * bary[:, j] for i, j in ((0, 1), (1, 2), (2, 0)))])
    v_flux = v[spaces.unknowns] @ shapes.T
    true = np.stack([u_x, u_y], axis=2)
    slope = np.einsum("kb,tbd->tkd", bary, spaces.gradient(v)) - true
    gradients = np.sum(k * slope**2 + (q - k * true) ** 2 / k, axis=2)
    total = np.sum(weights * (gradients + c * (v_flux - u) ** 2 + (f + div_q - c * u) ** 2 / c))
    rule = boundary_rule(polygon, mesh.s)
    edge = rule.interval
    points = polygon.at(rule.side, rule.s)
    x = (rule.s - (mesh.s[edge] - polygon.starts[rule.side])) / np.diff(mesh.s)[edge]
    nodal, bubbles = np.split(v[spaces.boundary_unknowns], 2)
    below = nodal[edge] * (1 - x) + np.roll(nodal, -1)[edge] * x + 4 * bubbles[edge] * x * (1 - x)
    below -= problem.u(*points.T)
    normals = polygon.normals[rule.side]
    flux = k * (problem.u_x(*points.T) * normals[:, 0] + problem.u_y(*points.T) * normals[:, 1])
    original = (1 - x) * sigma[edge, 0] + x * sigma[edge, 1]
    gradients, *values = field.square_norms(d).sum(axis=1)
    right = gradients / k + sum(values) / c + 2 * rule.weight @ (original * below)
    assert total + 2 * rule.weight @ (flux * below) == pytest.approx(right, rel=1e-11)
    assert total + rule.weight @ (flux * below) != pytest.approx(right, rel=1e-3)


def test_the_flux_has_its_normal_part_and_its_divergence():
    """Across every edge q.n does not jump, on the boundary it is sigma; div q = c w - f_h + rho.

    The jump by q.n at three points of every edge from either side. f_h is f, which is linear.
    """
    problem = Manufactured(square(), LINEAR_SOURCE)
    mesh = meshes.make_unstructured_mesh(square(), 0.35)
    field, sigma, _ = make_random_flux(problem, mesh)
    x = np.array([0.1, 0.5, 0.9])
    through = np.zeros((len(mesh.triangulation.ends), 3))
    count = np.zeros(len(mesh.triangulation.ends))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        bary = np.zeros((3, 3))
        bary[:, i] = 1 - x
        bary[:, j] = x
        along = mesh.points[mesh.triangles[:, j]] - mesh.points[mesh.triangles[:, i]]
        q = flux_in(field, bary)[0]
        edges = mesh.opposite_edges[:, k]
        out = q[..., 0] * along[:, 1, None] - q[..., 1] * along[:, 0, None]
        forward = mesh.triangulation.ends[edges, 0] == mesh.triangles[:, i]
        np.add.at(through, edges, np.where(forward[:, None], out, out[:, ::-1]))
        np.add.at(count, edges, 1)
    triangulation = mesh.triangulation
    assert np.all(np.delete(count, triangulation.boundary_edges) == 2)
    assert np.all(count[triangulation.boundary_edges] == 1)
    np.testing.assert_allclose(
        np.delete(through, triangulation.boundary_edges, axis=0), 0, rtol=0, atol=1e-11
    )
    on_boundary = through[triangulation.boundary_edges]
    ahead = triangulation.ends[triangulation.boundary_edges, 0] == mesh.boundary
    on_boundary = np.where(ahead[:, None], on_boundary, on_boundary[:, ::-1])
    expected = np.diff(mesh.s)[:, None] * (sigma[:, :1] * (1 - x) + sigma[:, 1:] * x)
    np.testing.assert_allclose(on_boundary, expected, rtol=0, atol=1e-11)
    bary, places, _ = rule_of(mesh, 4)
    w = field.w[mesh.triangles] @ bary.T
    f = problem.f(*np.moveaxis(places, 2, 0))
    np.testing.assert_allclose(flux_in(field, bary)[1], w - f + field.rho @ bary.T, rtol=0, atol=1e-10)
    assert np.abs(field.rho).max() < 1e-2 * np.abs(w - f).max()


@skfem.BilinearForm
def h1_product(v, w, _):
    return dot(grad(v), grad(w)) + v * w


def best_distance(mesh, g, f, w, remaining, sigma):
    """||grad v - q|| by scikit-fem: v of P2 is g on the boundary, div q = w - f + rest for q of RT1."""
    skfem_mesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    p2 = skfem.Basis(skfem_mesh, skfem.ElementTriP2(), intorder=6)
    rt = p2.with_element(skfem.ElementTriRT2())
    dg = p2.with_element(skfem.ElementDG(skfem.ElementTriP1()))
    nodal = skfem.Basis(skfem_mesh, skfem.ElementTriP1(), intorder=6).interpolate(w)
    load_f = skfem.LinearForm(lambda v, x: f(*x.x) * v)
    on_boundary = p2.get_dofs()
    v = p2.project(lambda x: g(*x))
    v[on_boundary] = g(*p2.doflocs[:, on_boundary])
    v = skfem.solve(*skfem.condense(h1_product.assemble(p2), load_f.assemble(p2), x=v, D=on_boundary))
    M = skfem.BilinearForm(lambda q, r, _: dot(q, r)).assemble(rt).toarray()
    D = skfem.BilinearForm(lambda q, s, _: div(q) * s).assemble(rt, dg).toarray()
    facet = boundary_facets(skfem_mesh, mesh)
    q = normal_flux_matrix(rt, mesh, facet) @ sigma.ravel()
    remaining_value = np.empty(dg.N)
    remaining_value[dg.element_dofs] = np.take_along_axis(
        remaining, np.argsort(mesh.triangles, axis=1), axis=1
    ).T
    expected_assemble = skfem.LinearForm(lambda s, x: (x.w - f(*x.x) + x.rest) * s).assemble(
        dg, w=nodal, rest=dg.interpolate(remaining_value)
    )
    v_load = skfem.LinearForm(lambda r, x: dot(grad(x.potential), r)).assemble(
        rt, potential=p2.interpolate(v)
    )
    inner = np.setdiff1d(np.arange(rt.N), rt.facet_dofs[:, facet])
    k = len(inner)
    m = D.shape[0]
    saddle = np.block([[M[np.ix_(inner, inner)], D[:, inner].T], [D[:, inner], np.zeros((m, m))]])
    rhs = np.append((v_load - M @ q)[inner], expected_assemble - D @ q)
    q[inner] += np.linalg.lstsq(saddle, rhs)[0][:k]
    square = skfem.Functional(lambda x: dot(grad(x.potential) - x.flux, grad(x.potential) - x.flux))
    return np.sqrt(square.assemble(p2, potential=p2.interpolate(v), flux=rt.interpolate(q)))


@cache
def make_full_contact(n):
    """A problem, its mesh and cells, u_h and lambda_H: everything is contact, g is not quadratic."""
    problem = Manufactured(square(), LINEAR_SOURCE)
    mesh = make_structured_mesh(square(), 1 / n)
    cells = partitions.make_uniform_partition(square(), 2 / n)
    lambda_H = cell_means(problem, cells).lambda_means
    return problem, mesh, cells, u_of(problem, mesh, cells, lambda_H), lambda_H


def test_the_steps_go_to_the_best_potential_and_the_best_flux(monkeypatch):
    """Against scikit-fem's; a share of 1e-12 of the square may be left. Control: the first step does not."""
    problem, mesh, cells, u_h, lambda_H = make_full_contact(4)
    monkeypatch.setattr(bounds, "MIN_RELATIVE_GAIN", 1e-13)
    source = enclose_source(mesh, problem)
    flux = bounds.build_normal_flux(mesh, cells, lambda_H, u_h, H1)
    spaces = quadratic_space(mesh)
    field = field_of(spaces, source, u_h, flux.end_values, H1)
    lift = feasible.build_lifting(build_constraint(problem.enclose_gap(), mesh, H1), H1, u_h, flux)
    computed = []
    energy = build_energy(mesh, H1)
    no_flux = np.zeros((len(mesh.boundary), 2))
    for maximum in (1, 50):
        monkeypatch.setattr(bounds, "MAX_DESCENT_STEPS", maximum)
        d, phi, _ = bounds._minimise_eta(lift, energy, field, no_flux, 0.0)
        computed.append(np.sqrt(field.add_curl(phi).square_norms(d)[0].sum()))
    best = best_distance(mesh, problem.g, problem.f, field.w, field.rho, flux.end_values)
    assert computed[1] == pytest.approx(best, rel=1e-6)
    assert computed[0] > 1.01 * best


def test_no_other_potential_is_better_where_sigma_is_large_and_nothing_in_contact(monkeypatch):
    """eta^2 has <sigma, v>, which cancels the flux of q: with sigma in the load of v, too, eta is larger.

    lambda_H = 1 where u - g = 10, and the steps end at the best v.
    """
    problem = Manufactured(square(), "cosh(x - 0.4)", "10")
    mesh = make_structured_mesh(square(), 1 / 4)
    cells = partitions.make_uniform_partition(square(), 1 / 2)
    arguments = given_to(problem, mesh, cells, problem.u(*mesh.points.T), np.ones(cells.n_cells))
    monkeypatch.setattr(bounds, "MIN_RELATIVE_GAIN", 1e-12)
    best = sharp_bound(*arguments).eta
    original = bounds._minimise_eta

    def add_sigma_load(lift, energy, field, tau, slack):
        return original(lift, energy, field, tau + lift.sigma, slack)

    monkeypatch.setattr(bounds, "_minimise_eta", add_sigma_load)
    assert sharp_bound(*arguments).eta > 1.01 * best


def test_the_bounds_hold_after_any_number_of_steps(monkeypatch):
    """The bounds hold after any number of steps, and eta falls."""
    known_pair = pair("natural", 8)
    etas = []
    for maximum in (0, 1, 2, 4):
        monkeypatch.setattr(bounds, "MAX_DESCENT_STEPS", maximum)
        bound = sharp_bound(*known_pair.bound_arguments)
        assert known_pair.is_below(bound)
        assert bound.steps == maximum
        etas.append(bound.eta)
    assert np.all(np.diff(etas) < 0)


def test_the_number_of_steps_does_not_grow_on_finer_meshes(monkeypatch):
    """Preconditioned by multigrid; without it their number would be that of 1/h, fourfold here."""
    monkeypatch.setattr(linear_systems, "MAX_FACTORISED_UNKNOWNS", 0)
    pairs = [pair("natural", n) for n in (16, 64)]
    coarse, fine = sharp_bounds = [sharp_bound(*known_pair.bound_arguments) for known_pair in pairs]
    assert all(known_pair.is_below(bound) for known_pair, bound in zip(pairs, sharp_bounds, strict=True))
    assert fine.steps < 2 * coarse.steps


def test_multigrid_in_place_of_factors_changes_little(monkeypatch):
    """Of what is left eta has at most ENOUGH, as long as a step takes half of it and more."""
    arguments = pair("natural", 16).bound_arguments
    direct = sharp_bound(*arguments)
    monkeypatch.setattr(linear_systems, "MAX_FACTORISED_UNKNOWNS", 0)
    assert sharp_bound(*arguments).eta <= (1 + bounds.MIN_RELATIVE_GAIN) * direct.eta


def test_what_the_solver_left_is_no_part_of_the_bound_of_lambda(monkeypatch):
    """u_h off by a tenth of its error: eta of w is that of u_h. Control: without w it is twice as large."""
    known_pair = pair("full_contact", 16)
    shifted = known_pair.add_noise(0.1 * known_pair.h1_error, np.random.default_rng(4)).bound_arguments
    exact = sharp_bound(*known_pair.bound_arguments)
    computed = sharp_bound(*shifted)
    assert computed.eta == pytest.approx(exact.eta, rel=0.01)
    assert known_pair.h1_error <= computed.u + 0.1 * known_pair.h1_error
    monkeypatch.setattr(balanced_potential, "MAX_IMBALANCE_FRACTION", np.inf)
    assert sharp_bound(*shifted).eta > 2 * exact.eta


def test_the_index_of_u_tends_to_1_without_contact():
    """lambda = lambda_H = 0 is exact; eta, of second order, is all that is left of the bound of lambda."""
    coarse = sharp_bound(*pair("no_contact", 16).bound_arguments)
    fine = sharp_bound(*pair("no_contact", 32).bound_arguments)
    assert fine.u <= 1.02 * pair("no_contact", 32).h1_error
    assert coarse.lambda_ >= 3.5 * fine.lambda_


def excess(n):
    """The bound of u over its error, less 1, in full contact with a curved g."""
    known_pair = pair("full_contact", n)
    return sharp_bound(*known_pair.bound_arguments).u / known_pair.h1_error - 1


def test_the_index_of_u_tends_to_1_only_if_u_h_is_lowered_in_contact(monkeypatch):
    """Proposition S20: its excess falls like h, less the tolerance of F.exact. Control: y >= 0 everywhere.

    Then 2 <lambda, u_h + y - g> is of the order of the squared error.
    """
    required = 2**0.8
    assert excess(8) > required * excess(16)
    monkeypatch.setattr(feasible, "find_contact", lambda _, u_h, __: np.zeros(len(u_h), dtype=bool))
    assert excess(8) < required * excess(16)


def test_on_large_triangles_the_flux_gets_no_linear_divergence(monkeypatch):
    """On a square of the size 1000 it would be larger than what it takes away: above the cheap bound.

    No contact, so that nothing but the flux counts.
    """
    polygon = Polygon(1000 * square().vertices, "large")
    problem = Manufactured(polygon, "cos(pi*x/1000)*cos(2*pi*y/1000)", "5")
    mesh = meshes.make_unstructured_mesh(polygon, 125)
    cells = partitions.make_uniform_partition(polygon, 250)
    zero = np.zeros(cells.n_cells)
    u_h = u_of(problem, mesh, cells, zero)
    data = given_to(problem, mesh, cells, u_h, zero)
    cheap = local_bound(*data)
    assert problem.error(mesh, u_h) <= sharp_bound(*data).u <= (1 + 1e-9) * cheap.u
    original = bounds.build_misfit_field

    def keep_whole_misfit(spaces, source, *arguments):
        with monkeypatch.context() as small:
            small.setattr(misfit_field, "THICK_TRIANGLE_LAYERS", math.inf)
            field = original(spaces, source, *arguments)
        p = field.w[mesh.triangles] - source.f_h
        p -= p.mean(axis=1, keepdims=True)
        mean = field.rho.mean(axis=1, keepdims=True)
        theta = 1 + np.sum((field.rho - mean) * p, axis=1) / np.sum(p**2, axis=1)
        return replace(field, misfit_bubbles=field.misfit_bubbles / theta[:, None, None], rho=mean + 0 * p)

    monkeypatch.setattr(bounds, "build_misfit_field", keep_whole_misfit)
    assert sharp_bound(*data).u > cheap.u


def test_the_bound_of_lambda_holds_for_cells_shorter_than_edges():
    """lambda_H jumps four times inside every edge: without what oscillates the bound would be too small."""
    problem = Manufactured(square(), "0.5*(x - 0.45)**2 + 0.5*(y - 0.55)**2")
    mesh = make_structured_mesh(square(), 1 / 4)
    cells = partitions.make_uniform_partition(square(), 1 / 16)
    lambda_H = cell_means(problem, cells).lambda_means * np.tile([0.2, 1.8, 1.8, 0.2], cells.n_cells // 4)
    u_h = u_of(problem, mesh, cells, lambda_H)
    bound = sharp_bound(*given_to(problem, mesh, cells, u_h, lambda_H))
    lower = float(build_dual_norm(cells, [problem]).bound_error(problem, lambda_H[None]).lower[0])
    assert bound.eta < lower <= bound.lambda_


def test_the_slack_counts_twice(monkeypatch):
    """By the identity eta^2 has 2 <q.n, v - g> in it, as has R + D^2: a slack of 1/2 adds 1 to both."""
    original = feasible.bound_shortfall
    arguments = given_to(*make_full_contact(4))
    bounds_with_slack = []
    monkeypatch.setattr(bounds, "MIN_RELATIVE_GAIN", 0.0)  # or there would be fewer steps
    for extra in (0.0, 0.5 / 16):
        monkeypatch.setattr(
            feasible,
            "bound_shortfall",
            lambda *a, s=extra: original(*a)._replace(
                edge_complementarity=original(*a).edge_complementarity + s
            ),
        )
        bounds_with_slack.append(sharp_bound(*arguments))
    assert bounds_with_slack[1].eta ** 2 - bounds_with_slack[0].eta ** 2 == pytest.approx(1, rel=1e-8)
    R_and_D = [item.u**2 + max(item.lift_norm - item.eta, 0) ** 2 for item in bounds_with_slack]
    assert R_and_D[1] - R_and_D[0] == pytest.approx(1, rel=1e-8)


def test_the_rounding_of_a_defect_of_0_is_below_its_allowance():
    """u_h = 1e6 + x, f = u_h and q = grad u_h: exactly 0, but for what derivatives of u_h lose."""
    problem = Manufactured(square(), "1000000 + x", "1")
    mesh = meshes.make_unstructured_mesh(square(), 1 / 16)
    sigma = np.repeat(mesh.polygon.normals[mesh.side, :1], 2, axis=1)
    spaces = quadratic_space(mesh)
    field = field_of(spaces, enclose_source(mesh, problem), 1e6 + mesh.points[:, 0], sigma, H1)
    nothing = np.zeros(spaces.size)
    gradients = np.linalg.norm(np.sqrt(mesh.areas) * field.misfit_allowance)
    values = np.linalg.norm(np.sqrt(mesh.areas) * field.rho_allowance)
    assert 1e-4 * gradients < np.sqrt(field.square_norms(nothing)[0].sum()) <= gradients
    assert 1e-4 * values < np.sqrt(field.square_norms(nothing)[1:].sum()) <= values
    turned = field.add_curl(1e6 + nothing)
    assert np.linalg.norm(np.sqrt(mesh.areas) * turned.misfit_allowance) > gradients


def test_all_that_rounding_may_do_is_in_the_parts():
    """Where field and rho vanish the parts are their allowances; a large v has larger ones."""
    mesh = make_structured_mesh(square(), 1 / 4)
    spaces = quadratic_space(mesh)
    zero = np.zeros(mesh.n_nodes)
    field = field_of(
        spaces, linear_source(mesh, zero), zero, np.zeros((len(mesh.boundary), 2)), Form(2.0, 3.0)
    )
    large = replace(
        field, misfit_allowance=field.misfit_allowance + 5.0, rho_allowance=field.rho_allowance + 7.0
    )
    zero_parts = large.residual_parts(np.zeros(spaces.size), no_given_flux(mesh))
    np.testing.assert_allclose(zero_parts.misfit, 5 * np.sqrt(mesh.areas), rtol=1e-9)
    np.testing.assert_allclose(zero_parts.remainder, 7 * np.sqrt(mesh.areas), rtol=1e-9)
    # 1e6 is off by some units in the last place, and so is its gradient
    constant_parts = field.residual_parts(spaces.embed_linear(1e6 + zero), no_given_flux(mesh))
    eps = np.finfo(float).eps
    assert np.all(constant_parts.misfit > 2.0 * 1e6 * eps / mesh.longest_edges * np.sqrt(mesh.areas))
    assert np.all(constant_parts.remainder > 3.0 * 1e6 * eps * np.sqrt(mesh.areas))


def test_what_f_h_leaves_is_orthogonal_to_linear_functions_alone():
    """For v of V_h squares are added, for v of P2 norms; what jumps leave is added always."""
    mesh = make_structured_mesh(square(), 1 / 4)
    rng = np.random.default_rng(12)
    spaces = quadratic_space(mesh)
    m = len(mesh.triangles)
    source = Source(mesh, rng.standard_normal((m, 3)), *rng.uniform(1, 2, (3, m)))
    sigma = np.zeros((len(mesh.boundary), 2))
    w = rng.standard_normal(mesh.n_nodes)
    field = field_of(spaces, source, w, sigma, Form(2.0, 300.0))
    for d in (spaces.embed_linear(w), rng.standard_normal(spaces.size)):
        norm = np.sqrt(field.square_norms(d)[1])
        pair = np.hypot(norm, source.oscillation) if not d[len(w) :].any() else norm + source.oscillation
        assert field.residual_parts(d, no_given_flux(mesh)).oscillation == pytest.approx(pair + source.jumps)


@pytest.mark.parametrize("field", ["oscillation", "remainder_norms", "remainder_integrals"])
def test_what_is_left_of_a_given_flux_counts(field):
    """tau - tau~ is large on the lower side: what is free of means, what is not known, and its integral."""
    problem = Manufactured(square(), LINEAR_SOURCE)
    mesh = make_structured_mesh(square(), 1 / 4)
    cells = partitions.make_uniform_partition(square(), 1 / 2)
    u_h = problem.u(*mesh.points.T)
    zero = np.zeros(cells.n_cells)
    data, *discrete_arguments = given_to(problem, mesh, cells, u_h, zero, (0, 1, 2, 3))
    large = np.where(mesh.side == 0, 1e6, 0.0)
    tau = data.given_flux._replace(**{field: large})
    on_edges = np.sqrt(trace_constants(mesh)) * 1e6, 1e6 / np.sqrt(mesh.areas[mesh.boundary_triangles])
    max_norm = np.linalg.norm(on_edges[field == "remainder_integrals"] * (large > 0))
    assert (
        0.1 * max_norm < sharp_bound(replace(data, given_flux=tau), *discrete_arguments).u <= 1.1 * max_norm
    )


@pytest.mark.parametrize("c", [1e3, 1e8])
def test_constants_on_a_tiny_square_are_bounded_in_spite_of_rounding(c):
    """u = 1 and u_h = c: the error is (c - 1) |Omega|^(1/2); control: c . A c loses more than SUMS."""
    polygon = Polygon(1e-3 * square().vertices, "tiny")
    mesh = meshes.make_unstructured_mesh(polygon, 1e-3 / 16)
    cells = partitions.make_uniform_partition(polygon, 1e-3 / 8)
    problem = Manufactured(polygon, "1")
    u_h = np.full(mesh.n_nodes, c)
    bounds = sharp_bound(*given_to(problem, mesh, cells, u_h, np.zeros(cells.n_cells)))
    assert (c - 1) * 1e-3 * (1 - 1e-14) <= bounds.u <= 1.01 * (c - 1) * 1e-3
    spaces = quadratic_space(mesh)
    v = spaces.embed_linear(u_h)
    assert quadratic_square_norms(mesh.areas, *spaces.coefficients(v)).sum() == pytest.approx(
        (c * 1e-3) ** 2, rel=1e-9
    )
    assert abs(u_h @ (form_matrix(mesh) @ u_h) / (c * 1e-3) ** 2 - 1) > 1e-9


def test_where_s_prime_counts_the_flux_stays_as_it_is(monkeypatch):
    """Where triangles are thick, as half of them are here, s' by the flux that is turned elsewhere.

    f is linear on triangles, and u_h is not the discrete solution. On the other triangles s' is infinite.
    Control: there fluxes differ, and s' of the one that is not turned is finite and, on some, smaller.
    """
    k = 2.0
    mesh = meshes.make_unstructured_mesh(square(), 0.2)
    cells = partitions.make_uniform_partition(square(), 0.5)
    c = k * (misfit_field.THICK_TRIANGLE_LAYERS / np.median(mesh.longest_edges)) ** 2
    form = Form(k, c)
    zero = np.zeros(cells.n_cells)
    values, noise = np.random.default_rng(11).standard_normal((2, mesh.n_nodes))
    data = enclose_data(ul.Problem(SQUARE, 0, -100, k=k, c=c), mesh, form, linear_source(mesh, c * values))
    u_h = factorise_by_dissection(form_matrix(mesh, form)).solve(data.load) + noise
    fields = []
    residuals = []
    components = MisfitField.residual_parts
    defect = bounds.bound_residual
    monkeypatch.setattr(
        MisfitField,
        "residual_parts",
        lambda field, *arguments: fields.append(field) or components(field, *arguments),
    )
    monkeypatch.setattr(
        bounds,
        "bound_residual",
        lambda residual, *arguments: residuals.append(residual) or defect(residual, *arguments),
    )
    sharp_bound(data, cells, u_h, zero, form)
    field = fields[0]
    s_prime = residuals[0].s_prime
    thick = mesh.longest_edges > np.median(mesh.longest_edges)

    # the flux before it was turned
    flux = bounds.build_normal_flux(mesh, cells, zero, u_h, form)
    energy = build_energy(mesh, form)
    w, q = balance_potential(data.source, u_h, flux.end_values + data.given_flux.end_values, energy)
    slopes = gradients(mesh)
    w_flux = k * np.einsum("tid,ti->td", slopes, w[mesh.triangles])[:, None]
    u_flux = k * np.einsum("tid,ti->td", slopes, u_h[mesh.triangles])[:, None]
    bary, _, weights = rule_of(mesh, 4)
    before = np.einsum("kb,tbd->tkd", bary, w_flux - misfit(mesh, w, q, slice(None), k))
    apart = np.abs(flux_in(field, bary)[0] - before).max(axis=(1, 2))
    assert np.all(apart[thick] <= 1e-9 * np.abs(before).max())
    assert np.all(apart[~thick] > 1e-3 * np.abs(before).max())

    # s' by the turned one
    g = c * (values - u_h)[mesh.triangles] @ bary.T
    norm = np.sqrt(np.sum(weights * g**2, axis=1))
    every = np.arange(len(mesh.triangles))
    at_nodes = (u_flux - flux_in(field, np.eye(3))[0]).transpose(2, 1, 0)
    expected = bound_by_parts(mesh, every, at_nodes, norm, 0 * norm, form)
    assert s_prime[thick] == pytest.approx(expected[thick], rel=1e-6)
    assert np.all(s_prime[~thick] == math.inf)
    not_turned = residual_parts(data.source, data.given_flux, u_h, q, form).s_prime
    assert np.any(not_turned[~thick] < (1 - 1e-6) * expected[~thick])


def test_what_is_added_to_v_is_in_eta(monkeypatch):
    """What is missing of v >= g by its norm, and what is added for the doubt by that of its hats."""
    fields = given_to(*make_full_contact(4))
    original = feasible.bound_shortfall
    before = sharp_bound(*fields)
    for field, extra in (("extension_squares", 1.0), ("nodal_raise", 1e3)):
        calls = []

        def missing(*arguments, field=field, extra_value=extra, recorded=calls):
            short = original(*arguments)._replace(
                edge_complementarity=0 * original(*arguments).edge_complementarity,
                extension_squares=0 * original(*arguments).extension_squares,
            )
            recorded.append(short._replace(**{field: 0 * getattr(short, field) + extra_value}))
            return recorded[-1]

        monkeypatch.setattr(feasible, "bound_shortfall", missing)
        after = sharp_bound(*fields)
        data, cells, u_h, lambda_H, form = fields
        flux = bounds.build_normal_flux(data.mesh, cells, lambda_H, u_h, form)
        added = feasible.build_lifting(data.constraint, form, u_h, flux).remainder_squares(calls[-1]).sum()
        norm = calls[-1].extension_norm + math.sqrt(added)
        assert norm > 100 * before.eta
        assert norm < after.eta < 1.01 * norm


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
U = "sin(x)*y + x**2"
KINDS = {"clamped": (), "contact": (1, 2)}
"""The sides on which u = g; it is given on the others."""


def make_layer_data(kind, n, k, c):
    """What both bounds take of the problem with the solution U, and the error of u_h in the energy norm."""
    contact = KINDS[kind]
    g = [U if side in contact else None for side in range(4)]
    u_D = {side: U for side in range(4) if side not in contact}
    problem = ul.Problem(SQUARE, f"{k!r}*(sin(x)*y - 2) + {c!r}*({U})", g, u=u_D, k=k, c=c)
    arguments = bound_arguments(ul.solve(problem, h=1 / n, H=2 / n).solved)
    mesh = arguments[0].mesh
    u_h = arguments[2]
    bary, places, weights = rule_of(mesh, 12)
    x, y = np.moveaxis(places, 2, 0)
    slopes = np.einsum("tid,ti->td", gradients(mesh), u_h[mesh.triangles])
    along_x = np.cos(x) * y + 2 * x - slopes[:, :1]
    along_y = np.sin(x) - slopes[:, 1:]
    values = np.sin(x) * y + x**2 - u_h[mesh.triangles] @ bary.T
    return arguments, math.sqrt(np.sum(weights * (k * (along_x**2 + along_y**2) + c * values**2)))


@pytest.mark.parametrize("ratio", [1e-30, 1e-8, 1.0, 1e2, 1e3, 1e4, 1e6, 1e10, 1e16])
@pytest.mark.parametrize("kind", KINDS)
def test_the_index_does_not_depend_on_the_reaction(kind, ratio):
    """It is at most 5, and the bound is at most the cheap one, however thin the layer is beside h = 1/8."""
    k = 3.0
    arguments, error = make_layer_data(kind, 8, k, k * ratio)
    bound = sharp_bound(*arguments)
    assert error <= bound.u <= 5 * error
    assert bound.u <= local_bound(*arguments).u * (1 + 1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tiny_reaction_changes_nothing(kind):
    """Both bounds of u, of lambda, and of fluxes are those of c = 0 up to 1 %."""
    without = sharp_bound(*make_layer_data(kind, 8, 1.0, 0.0)[0])
    tiny = sharp_bound(*make_layer_data(kind, 8, 1.0, 1e-30)[0])
    for name in ("u", "lambda_", "reaction_bound", "eta"):
        assert getattr(tiny, name) == pytest.approx(getattr(without, name), rel=1e-2)


@pytest.mark.parametrize("side", [(), (1, 2)])
def test_the_part_of_y_at_clamped_sides_is_known(side, monkeypatch):
    """u_h is off by 1 at all boundary nodes: y lies at clamped sides, all of it if all sides are clamped."""
    (data, cells, u_h, lambda_H, form), _ = make_layer_data("contact" if side else "clamped", 8, 1.0, 0.0)
    calls = []
    original = bounds.bound_total_errors
    monkeypatch.setattr(
        bounds,
        "bound_total_errors",
        lambda *arguments, **keywords: calls.append(keywords) or original(*arguments, **keywords),
    )
    displaced_u_h = u_h.copy()
    displaced_u_h[data.mesh.boundary] -= 1
    sharp_bound(data, cells, displaced_u_h, lambda_H, form, u_h)
    (norms,) = calls
    share = norms["D_clamped"] / norms["D"]
    assert 0.5 < share < 0.99 if side else share == pytest.approx(1, rel=1e-9)


def step(n, kind, c):
    """What both bounds take of a step of the heat equation, k = 1, and the error of u_h in the energy norm.

    f = c phi with phi of V_h, which depends on x only and vanishes on the clamped sides, x = 0 and x = 1. Let
    J be the jumps of phi', and G Green's function. Then u - phi = sum J_i G(., x_i), and by Galerkin's
    equations the squared error is c (phi, u - u_h) = c (phi, u - phi) + c (phi, phi - u_h). The first one is
    - |phi|_1^2 + (grad u, grad phi) - |phi|_1^2
    """
    mesh = make_structured_mesh(square(), 1 / n)
    cells = partitions.make_uniform_partition(square(), 2 / n)
    x = np.linspace(0, 1, n + 1)
    phi = np.sin(np.pi * x) if kind == "smooth" else np.random.default_rng(3).standard_normal(n + 1)
    phi[[0, n]] = 0
    form = Form(1.0, c, clamped=(1, 3), free=(0, 2))
    values = phi[np.rint(mesh.points[:, 0] * n).astype(int)]
    problem = ul.Problem(SQUARE, 0, [None] * 4, [0, 2], u={1: 0, 3: 0}, c=c)
    data = enclose_data(problem, mesh, form, linear_source(mesh, c * values))
    u_h = factorise_by_dissection(form_matrix(mesh, form)).solve(
        np.where(form.clamped_nodes(mesh), 0, data.load)
    )

    # G(x, y) = sinh(s x) sinh(s (1 - y)) / (s sinh s) for x < y, by logarithms
    s = math.sqrt(c)
    slopes = np.diff(phi) * n
    low = np.minimum.outer(x, x)[1:-1, 1:-1]
    high = np.maximum.outer(x, x)[1:-1, 1:-1]

    def log_sinh(t):
        return t + np.log1p(-np.exp(-2 * t)) - math.log(2)

    green = np.exp(log_sinh(s * low) + log_sinh(s * (1 - high)) - log_sinh(s)) / s
    jumps = np.diff(slopes)
    mass = (np.ones((3, 3)) + np.eye(3)) / 12
    on_triangles = values[mesh.triangles], (values - u_h)[mesh.triangles]
    remaining = c * np.einsum("t,ti,ij,tj", mesh.areas, on_triangles[0], mass, on_triangles[1])
    square_of_error = jumps @ green @ jumps - np.sum(slopes**2) / n + remaining
    return (data, cells, u_h, np.zeros(cells.n_cells), form), math.sqrt(square_of_error)


@pytest.mark.parametrize("c", [1.0, 1e2, 1e4, 1e6, 1e8])
@pytest.mark.parametrize("kind", ["smooth", "rough"])
def test_the_index_of_a_time_step_is_bounded(kind, c, monkeypatch):
    """Jumps of grad u_h are the error then. Control: not so without integration by parts, for large c."""
    arguments, error = step(8, kind, c)
    u = sharp_bound(*arguments).u
    assert error <= u <= 5 * error
    assert u <= local_bound(*arguments).u * (1 + 1e-6)
    if c == 1e8:
        monkeypatch.setattr(
            flux_residuals, "bound_by_parts", lambda mesh, triangles, *_: np.full(len(triangles), math.inf)
        )
        assert sharp_bound(*arguments).u > 5 * error
