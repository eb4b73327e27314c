"""What is known of a case on a mesh and on a partition before anything is solved: closed forms."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import sentences
import skfem
from conftest import condense_structured_mesh, discrete, load
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
    l2_distance,
    ritz_projection,
    ritz_projections,
)


def test_the_norm_of_u_is_its_closed_form_and_the_ritz_projection_is_nearest():
    """u = cos(pi x) cos(2 pi y)/2: ||u||_1^2 = (1 + 5 pi^2)/16; none in V_h is closer than z_h."""
    case = load("no_contact")
    spaces = condense_structured_mesh("square", 8)
    problem = ritz_projection(case, spaces, 12)
    assert problem.u_norm == pytest.approx(math.sqrt((1 + 5 * math.pi**2) / 16), rel=1e-9)
    x, y = spaces.mesh.points.T
    interpolant = np.cos(math.pi * x) * np.cos(2 * math.pi * y) / 2
    distance = h1_distance(case, spaces.mesh, interpolant, 12)
    assert problem.interpolation_error == pytest.approx(distance, rel=1e-12)
    assert problem.ritz_error < 0.999 * distance


def gauss_points(corners):
    """Points (t, 400, 2) and weights (t, 400) on triangles (t, 3, 2): Gauss's rule on a square, collapsed."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    a, b = np.meshgrid(0.5 * (nodes + 1), 0.5 * (nodes + 1))
    first = (1 - a).ravel()
    second = (a * (1 - b)).ravel()
    barycentric = np.array([first, second, 1 - first - second]).T
    sides = corners[:, 1:] - corners[:, :1]
    twice_area = np.abs(np.linalg.det(sides))
    square_weight = 0.25 * np.outer(weights, weights).ravel() * a.ravel()
    return barycentric @ corners, twice_area[:, None] * square_weight


def test_the_distance_in_L2_is_that_of_another_quadrature():
    """u = cos(pi x) cos(2 pi y)/2 is written here again. Control: the gradient has no part in it."""
    case = load("no_contact")
    mesh = condense_structured_mesh("square", 4).mesh
    slope = np.array([0.3, -0.7])
    values = mesh.points @ slope + 0.1
    places, weight = gauss_points(mesh.points[mesh.triangles])
    x = places[..., 0]
    y = places[..., 1]
    difference = np.cos(math.pi * x) * np.cos(2 * math.pi * y) / 2 - places @ slope - 0.1
    expected = math.sqrt(np.sum(weight * difference**2))
    assert l2_distance(case, mesh, values, 12) == pytest.approx(expected, rel=1e-9)
    assert l2_distance(case, mesh, values) < h1_distance(case, mesh, values)


@pytest.mark.parametrize("name", ["smooth", "thirds", "vertex"])
def test_where_u_vanishes_a_function_counts_that_does_not(name):
    """The parallelogram law: ||u - 1||^2 + ||u + 1||^2 = 2 ||u||^2 + 2 |Omega|."""
    case = load(name)
    spaces = condense_structured_mesh("square", 8)
    values = np.ones(spaces.mesh.n_nodes)
    u = h1_distance(case, spaces.mesh, 0 * values) ** 2
    smaller = h1_distance(case, spaces.mesh, values) ** 2
    extra = h1_distance(case, spaces.mesh, -values) ** 2
    assert smaller + extra == pytest.approx(2 * u + 2, rel=1e-12)


def test_triangles_on_which_u_and_its_approximation_are_0_are_left_out(monkeypatch):
    """The places at which `thirds` is evaluated lie within its cutoff and a triangle's diameter of 1/3."""
    case = load("thirds")
    spaces = condense_structured_mesh("square", 16)
    calls = []

    def whole(self, places, offset=0.0):
        calls.append(places + offset)
        nothing = np.zeros(len(calls[-1]))
        return nothing, np.zeros((len(nothing), 2)), nothing

    monkeypatch.setattr(type(case), "value_gradient_and_source", whole)
    ritz_projection(case, spaces)
    away = np.hypot(*(np.concatenate(calls) - [1 / 3, 0]).T)
    assert 0.2 < away.max() < 1 / 4 + 2 * spaces.mesh.diameter


def test_all_cases_on_a_mesh_take_two_solves_and_are_as_alone(monkeypatch):
    """One with f and lambda and one with the residual; a solve for each case would be six."""
    cases = [load(name) for name in ("natural", "smooth", "no_contact")]
    spaces = condense_structured_mesh("square", 8)
    single_ritz_projections = [ritz_projection(case, spaces) for case in cases]
    solves = []
    solve = type(spaces).solve
    monkeypatch.setattr(type(spaces), "solve", lambda self, rhs: solves.append(rhs.shape) or solve(self, rhs))
    together = ritz_projections(cases, spaces)
    assert solves == [(spaces.mesh.n_nodes, 3)] * 2
    for first, second in zip(single_ritz_projections, together, strict=True):
        assert second.ritz_error == pytest.approx(first.ritz_error, rel=1e-12)
        np.testing.assert_allclose(
            second.load_trace, first.load_trace, rtol=0, atol=1e-13 * np.abs(first.load_trace).max()
        )


def test_errors_take_one_dual_norm(monkeypatch):
    """||lambda - mu||_{-1/2,h} is a part of ||u - u(mu)||_1; to find it again would be a second solve."""
    discrete_problem = discrete("natural", 8, 4)
    norms = []
    dual = RitzProjection.discrete_dual_norm
    monkeypatch.setattr(
        RitzProjection, "discrete_dual_norm", lambda *arguments: norms.append(dual(*arguments)) or norms[-1]
    )
    errors = discrete_problem.exact.errors(discrete_problem.spaces, np.ones(len(discrete_problem.cells)))
    assert norms == [errors.hm12_discrete]


def project_by_skfem(case, mesh):
    """The boundary values of z_h, from (z_h, v)_1 = (u, v)_1 by scikit-fem, exact to degree 12."""
    skmesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.Basis(skmesh, skfem.ElementTriP1(), intorder=12)

    @skfem.BilinearForm
    def product(v, w, _):
        return dot(grad(v), grad(w)) + v * w

    @skfem.LinearForm
    def integrate_u(v, position):
        value, slope = case.value_and_gradient(position.x.reshape(2, -1).T)
        return value.reshape(position.x.shape[1:]) * v + dot(slope.T.reshape(position.x.shape), grad(v))

    return skfem.solve(product.assemble(basis), integrate_u.assemble(basis))[mesh.boundary]


def along(trace, z_h, mesh, points):
    """Integrals (k,) of u - z_h and of its square between arc lengths, by 40 Gauss points a piece."""
    x, w = np.polynomial.legendre.leggauss(40)
    s = np.union1d(mesh.s, points)
    position = 0.5 * (s[1:] + s[:-1])[:, None] + 0.5 * np.diff(s)[:, None] * x
    gap = trace(position) - np.interp(position, mesh.s, np.append(z_h, z_h[0]))
    interval = np.searchsorted(points, position[:, 0]) - 1
    return [np.bincount(interval, 0.5 * np.diff(s) * (f @ w)) for f in (gap, gap**2)]


def trace_of_no_contact(s):
    """cos(pi x) cos(2 pi y)/2 along the unit square's sides, anticlockwise from the origin."""
    x = np.clip(np.minimum(s, 3 - s), 0, 1)
    y = np.clip(np.minimum(s - 1, 4 - s), 0, 1)
    return np.cos(np.pi * x) * np.cos(2 * np.pi * y) / 2


@pytest.mark.parametrize("m", [2, 4, 8])
def test_the_boundary_error_of_the_ritz_projection_is_that_by_scikit_fem(m):
    """By scikit-fem's projection, u in closed form and another quadrature; 1e-6 for the quadrature of f."""
    discrete_problem = discrete("no_contact", 8, m, degree=12)
    z_h = project_by_skfem(load("no_contact"), discrete_problem.mesh)
    check_boundary_errors(
        discrete_problem,
        *along(trace_of_no_contact, z_h, discrete_problem.mesh, discrete_problem.partition.points),
    )
    assert (
        discrete_problem.exact.ritz_means_norm(discrete_problem.spaces)
        < 0.99 * discrete_problem.exact.ritz.ritz_boundary_error
    )


def check_boundary_errors(discrete, means, squares):
    """Against integrals (k,) of u - z_h over the cells, and of its square."""
    assert discrete.exact.ritz.ritz_boundary_error == pytest.approx(math.sqrt(squares.sum()), rel=1e-6)
    expected = math.sqrt(np.sum(means**2 / discrete.partition.lengths))
    assert discrete.exact.ritz_means_norm(discrete.spaces) == pytest.approx(expected, rel=1e-6)


def test_the_boundary_error_where_u_is_singular_is_that_of_its_closed_form():
    """u = (1/2 - x)_+^{3/2} + 4 (x - 1/2)^2 on the bottom of `natural`; on the other sides u is the case's.

    1/2 is an end of edges, towards which 40 Gauss points leave 1e-7 of such a power: rel = 1e-6.
    """
    discrete_problem = discrete("natural", 8, 4)
    case = load("natural")

    def trace(s):
        side = np.minimum(s.astype(int), 3)
        u, _, _ = case.trace_flux_and_gap(side.ravel(), (s - side).ravel())
        bottom = np.maximum(0.5 - s, 0) ** 1.5 + 4 * (s - 0.5) ** 2
        return np.where(side == 0, bottom, u.reshape(s.shape))

    check_boundary_errors(
        discrete_problem,
        *along(
            trace,
            discrete_problem.exact.ritz.boundary_values,
            discrete_problem.mesh,
            discrete_problem.partition.points,
        ),
    )


def test_means_of_several_gaps_are_those_of_each():
    """Another gap's singular points only cut the rule; u and lambda are the first one's."""
    case = load("thirds")
    cells = make_uniform_partition(square(), 1 / 8)
    other_case = replace(case, gaps=(ONE,) * 4)
    for first, cell_mean in zip(
        (case, other_case), cell_means_of_gaps([case, other_case], cells), strict=True
    ):
        single_cell_means = cell_means(first, cells)
        np.testing.assert_allclose(cell_mean.gap_means, single_cell_means.gap_means, rtol=0, atol=1e-14)
        np.testing.assert_allclose(cell_mean.g_means, single_cell_means.g_means, rtol=0, atol=1e-14)
        assert cell_mean.has_transition.sum() == single_cell_means.has_transition.sum()
        assert cell_mean.projection_error == pytest.approx(single_cell_means.projection_error, rel=1e-12)


def test_norms_of_a_multiplier_are_their_closed_forms():
    """6^6 ((s - 1/3)(2/3 - s))^3 on two sides: by Euler's beta function; its parts are orthogonal.

    ||lambda - mu||^2 + ||lambda + mu||^2 = 2 ||lambda||^2 + 2 ||mu||^2 for a random mu.
    """
    cells = make_uniform_partition(square(), 1 / 8)
    computed = cell_means(load("smooth"), cells)
    mu = np.random.default_rng(1).standard_normal(cells.n_cells)
    square_of_norm = 2 * 6**12 / 3**13 * math.factorial(6) ** 2 / math.factorial(13)
    assert computed.lambda_norm == pytest.approx(math.sqrt(square_of_norm), rel=1e-12)
    integral = 2 * 6**6 / 3**7 * math.factorial(3) ** 2 / math.factorial(7)
    assert cells.lengths @ computed.lambda_means == pytest.approx(integral, rel=1e-12)
    means = cells.lengths @ computed.lambda_means**2
    assert computed.projection_error == pytest.approx(math.sqrt(square_of_norm - means), rel=1e-10)
    pair = computed.l2_error(mu) ** 2 + computed.l2_error(-mu) ** 2
    assert pair == pytest.approx(2 * square_of_norm + 2 * cells.lengths @ mu**2, rel=1e-12)


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
    means = cell_means(load("no_contact"), make_uniform_partition(square(), 1 / 2))
    assert replace(means, lambda_norm=norm, data_size=size).lambda_is_zero == zero


@pytest.mark.parametrize(("size", "refused"), [(0.0, False), (1e-150, False), (1e-155, True), (1e155, True)])
def test_cases_have_a_size_whose_square_is_a_number_or_are_0(size, refused):
    """Squares of doubles are normal numbers from 1e-154 to 1e154; errors of 0 are 0."""
    with sentences.raises(InputError) if refused else nullcontext():
        _check_u_size(load("no_contact"), size)
