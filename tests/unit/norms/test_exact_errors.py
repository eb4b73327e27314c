"""What is known of a case on a mesh and on a partition before anything is solved: closed forms."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import sentences
import skfem
from conftest import condensed, discrete, load
from skfem.helpers import dot, grad

from unilateral.errors import InputError
from unilateral.formulas.expression import ONE
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.norms.exact_errors import cell_means, cell_means_of_gaps
from unilateral.norms.ritz import (
    RitzProjection,
    _check_u_size,
    h1_distance,
    ritz_projection,
    ritz_projections,
)


def test_the_norm_of_u_and_the_order_of_its_approximations():
    """u = cos(pi x) cos(2 pi y)/2: ||u||_1^2 = (1 + 5 pi^2)/16; none in V_h is closer than z_h."""
    case = load("no_contact")
    on = condensed("square", 8)
    problem = ritz_projection(case, on, 12)
    assert problem.u_norm == pytest.approx(math.sqrt((1 + 5 * math.pi**2) / 16), rel=1e-9)
    x, y = on.mesh.points.T
    interpolant = np.cos(math.pi * x) * np.cos(2 * math.pi * y) / 2
    distance = h1_distance(case, on.mesh, interpolant, 12)
    assert problem.interpolation_error == pytest.approx(distance, rel=1e-12)
    assert problem.ritz_error < 0.999 * distance


@pytest.mark.parametrize("name", ["smooth", "thirds", "vertex"])
def test_where_u_vanishes_a_function_counts_that_does_not(name):
    """The parallelogram law: ||u - 1||^2 + ||u + 1||^2 = 2 ||u||^2 + 2 |Omega|."""
    case = load(name)
    on = condensed("square", 8)
    one = np.ones(on.mesh.n_nodes)
    of_u = h1_distance(case, on.mesh, 0 * one) ** 2
    less = h1_distance(case, on.mesh, one) ** 2
    more = h1_distance(case, on.mesh, -one) ** 2
    assert less + more == pytest.approx(2 * of_u + 2, rel=1e-12)


def test_triangles_on_which_u_and_its_approximation_are_0_are_left_out(monkeypatch):
    """The places at which `thirds` is evaluated lie within its cutoff and a triangle's diameter of 1/3."""
    case = load("thirds")
    on = condensed("square", 16)
    seen = []

    def whole(self, places, offset=0.0):
        seen.append(places + offset)
        nothing = np.zeros(len(seen[-1]))
        return nothing, np.zeros((len(nothing), 2)), nothing

    monkeypatch.setattr(type(case), "value_gradient_and_source", whole)
    ritz_projection(case, on)
    away = np.hypot(*(np.concatenate(seen) - [1 / 3, 0]).T)
    assert 0.2 < away.max() < 1 / 4 + 2 * on.mesh.diameter


def test_all_cases_on_a_mesh_take_two_solves_and_are_as_alone(monkeypatch):
    """One with f and lambda and one with the residual; a solve for each case would be six."""
    cases = [load(name) for name in ("natural", "smooth", "no_contact")]
    on = condensed("square", 8)
    alone = [ritz_projection(case, on) for case in cases]
    solves = []
    solve = type(on).solve
    monkeypatch.setattr(type(on), "solve", lambda self, rhs: solves.append(rhs.shape) or solve(self, rhs))
    together = ritz_projections(cases, on)
    assert solves == [(on.mesh.n_nodes, 3)] * 2
    for one, other in zip(alone, together, strict=True):
        assert other.ritz_error == pytest.approx(one.ritz_error, rel=1e-12)
        np.testing.assert_allclose(
            other.load_trace, one.load_trace, rtol=0, atol=1e-13 * np.abs(one.load_trace).max()
        )


def test_errors_take_one_dual_norm(monkeypatch):
    """||lambda - mu||_{-1/2,h} is a part of ||u - u(mu)||_1; to find it again would be a second solve."""
    of = discrete("natural", 8, 4)
    norms = []
    dual = RitzProjection.discrete_dual_norm
    monkeypatch.setattr(
        RitzProjection, "discrete_dual_norm", lambda *of: norms.append(dual(*of)) or norms[-1]
    )
    errors = of.exact.errors(of.spaces, np.ones(len(of.cells)))
    assert norms == [errors.hm12_discrete]


def by_skfem(case, mesh):
    """The boundary values of z_h, from (z_h, v)_1 = (u, v)_1 by scikit-fem, exact to degree 12."""
    skmesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.Basis(skmesh, skfem.ElementTriP1(), intorder=12)

    @skfem.BilinearForm
    def product(v, w, _):
        return dot(grad(v), grad(w)) + v * w

    @skfem.LinearForm
    def of_u(v, at):
        value, slope = case.value_and_gradient(at.x.reshape(2, -1).T)
        return value.reshape(at.x.shape[1:]) * v + dot(slope.T.reshape(at.x.shape), grad(v))

    return skfem.solve(product.assemble(basis), of_u.assemble(basis))[mesh.boundary]


def along(trace, z_h, mesh, points):
    """Integrals (k,) of u - z_h and of its square between arc lengths, by 40 Gauss points a piece."""
    x, w = np.polynomial.legendre.leggauss(40)
    s = np.union1d(mesh.s, points)
    at = 0.5 * (s[1:] + s[:-1])[:, None] + 0.5 * np.diff(s)[:, None] * x
    of = trace(at) - np.interp(at, mesh.s, np.append(z_h, z_h[0]))
    interval = np.searchsorted(points, at[:, 0]) - 1
    return [np.bincount(interval, 0.5 * np.diff(s) * (f @ w)) for f in (of, of**2)]


def trace_of_no_contact(s):
    """cos(pi x) cos(2 pi y)/2 along the unit square's sides, anticlockwise from the origin."""
    x = np.clip(np.minimum(s, 3 - s), 0, 1)
    y = np.clip(np.minimum(s - 1, 4 - s), 0, 1)
    return np.cos(np.pi * x) * np.cos(2 * np.pi * y) / 2


@pytest.mark.parametrize("m", [2, 4, 8])
def test_how_far_the_ritz_projection_is_from_u_on_the_boundary(m):
    """By scikit-fem's projection, u in closed form and another quadrature; 1e-6 for the quadrature of f."""
    of = discrete("no_contact", 8, m, degree=12)
    z_h = by_skfem(load("no_contact"), of.mesh)
    check_boundary_errors(of, *along(trace_of_no_contact, z_h, of.mesh, of.partition.points))
    assert of.exact.ritz_means_norm(of.spaces) < 0.99 * of.exact.ritz.ritz_boundary_error


def check_boundary_errors(of, means, squares):
    """Against integrals (k,) of u - z_h over the cells, and of its square."""
    assert of.exact.ritz.ritz_boundary_error == pytest.approx(math.sqrt(squares.sum()), rel=1e-6)
    expected = math.sqrt(np.sum(means**2 / of.partition.lengths))
    assert of.exact.ritz_means_norm(of.spaces) == pytest.approx(expected, rel=1e-6)


def test_the_boundary_error_where_u_is_singular():
    """u = (1/2 - x)_+^{3/2} + 4 (x - 1/2)^2 on the bottom of `natural`; on the other sides u is the case's.

    1/2 is an end of edges, towards which 40 Gauss points leave 1e-7 of such a power: rel = 1e-6.
    """
    of = discrete("natural", 8, 4)
    case = load("natural")

    def trace(s):
        side = np.minimum(s.astype(int), 3)
        u, _, _ = case.trace_flux_and_gap(side.ravel(), (s - side).ravel())
        bottom = np.maximum(0.5 - s, 0) ** 1.5 + 4 * (s - 0.5) ** 2
        return np.where(side == 0, bottom, u.reshape(s.shape))

    check_boundary_errors(of, *along(trace, of.exact.ritz.boundary_values, of.mesh, of.partition.points))


def test_means_of_several_gaps_are_those_of_each():
    """Another gap's singular points only cut the rule; u and lambda are the first one's."""
    case = load("thirds")
    cells = make_uniform_partition(square(), 1 / 8)
    other = replace(case, gaps=(ONE,) * 4)
    for one, found in zip((case, other), cell_means_of_gaps([case, other], cells), strict=True):
        alone = cell_means(one, cells)
        np.testing.assert_allclose(found.gap_means, alone.gap_means, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.g_means, alone.g_means, rtol=0, atol=1e-14)
        assert found.has_transition.sum() == alone.has_transition.sum()
        assert found.projection_error == pytest.approx(alone.projection_error, rel=1e-12)


def test_norms_of_a_multiplier_in_closed_form():
    """6^6 ((s - 1/3)(2/3 - s))^3 on two sides: by Euler's beta function; its parts are orthogonal.

    ||lambda - mu||^2 + ||lambda + mu||^2 = 2 ||lambda||^2 + 2 ||mu||^2 for a random mu.
    """
    cells = make_uniform_partition(square(), 1 / 8)
    found = cell_means(load("smooth"), cells)
    mu = np.random.default_rng(1).standard_normal(cells.n_cells)
    square_of_norm = 2 * 6**12 / 3**13 * math.factorial(6) ** 2 / math.factorial(13)
    assert found.lambda_norm == pytest.approx(math.sqrt(square_of_norm), rel=1e-12)
    integral = 2 * 6**6 / 3**7 * math.factorial(3) ** 2 / math.factorial(7)
    assert cells.lengths @ found.lambda_means == pytest.approx(integral, rel=1e-12)
    of_means = cells.lengths @ found.lambda_means**2
    assert found.projection_error == pytest.approx(math.sqrt(square_of_norm - of_means), rel=1e-10)
    both = found.l2_error(mu) ** 2 + found.l2_error(-mu) ** 2
    assert both == pytest.approx(2 * square_of_norm + 2 * cells.lengths @ mu**2, rel=1e-12)


def test_the_size_of_a_case_is_that_of_u_and_of_the_gap():
    """|cos(pi x) cos(2 pi y)|/2 + 1, at points of quadrature near the vertices."""
    assert cell_means(load("no_contact"), make_uniform_partition(square(), 1 / 8)).data_size == pytest.approx(
        1.5, abs=1e-3
    )


@pytest.mark.parametrize(
    ("norm", "size", "zero"), [(1e-13, 1, True), (1e-11, 1, False), (1e-9, 1e4, True), (1e-13, 1e-2, False)]
)
def test_a_multiplier_is_zero_relative_to_its_case(norm, size, zero):
    """To 1e-12, a thousand times the rounding of cancelling fluxes."""
    found = cell_means(load("no_contact"), make_uniform_partition(square(), 1 / 2))
    assert replace(found, lambda_norm=norm, data_size=size).lambda_is_zero == zero


@pytest.mark.parametrize(("size", "refused"), [(0.0, False), (1e-150, False), (1e-155, True), (1e155, True)])
def test_cases_have_a_size_whose_square_is_a_number_or_are_0(size, refused):
    """Squares of doubles are normal numbers from 1e-154 to 1e154; errors of 0 are 0."""
    with sentences.raises(InputError) if refused else nullcontext():
        _check_u_size(load("no_contact"), size)
