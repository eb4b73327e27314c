"""Fluxes on edges: exact moments, and bounds of all that is left, against suprema on finer meshes."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.sparse.linalg import spsolve

import unilateral as ul
from unilateral.bounds import boundary_flux as module
from unilateral.bounds.boundary_flux import (
    EDGE_REACTION_RATIO,
    GivenEdgeFlux,
    build_normal_flux,
    no_given_flux,
    project_given_flux,
)
from unilateral.bounds.flux_residuals import add_given_flux_remainder
from unilateral.bounds.residual_norm import BESSEL_ZERO, ResidualParts
from unilateral.fem.condense import form_matrix
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import edge_load
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.oscillation import (
    MEAN_FREE_SQUARE_CONSTANT,
    SQUARE_CONSTANT,
    trace_constants,
    value_constants,
)
from unilateral.problems import piecewise

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
FUNCTIONS = {
    "cos(8*pi*x)": lambda x: np.cos(8 * np.pi * x),
    "2*pos(x - 1/3, 0) - x": lambda x: 2 * (x > 1 / 3) - x,
    "exp(-((x - 0.3)*100)**2)": lambda x: np.exp(-(((x - 0.3) * 100) ** 2)),
    "3*x - 1": lambda x: 3 * x - 1,
}


def flux_of(q):
    """q on the bottom of the unit square, where x is the arc length."""
    return ul.Problem(SQUARE, f=0, g=0, free_sides=[0], q=q).enclosed_flux


@pytest.mark.parametrize("q", FUNCTIONS)
def test_moments_with_hats_are_exact(q):
    """Against adaptive quadrature, cut at the jump and the peak; where q is linear it is its own part."""
    mesh = make_structured_mesh(square(), 1 / 4)
    value = FUNCTIONS[q]
    flux = project_given_flux(flux_of(q), mesh)
    load = edge_load(mesh, flux.end_values)[mesh.boundary[:5]]
    for i, x in enumerate(np.linspace(0, 1, 5)):
        cuts = sorted(
            {
                max(x - 1 / 4, 0),
                min(x + 1 / 4, 1),
                x,
                *(c for c in (0.29, 0.3, 0.31, 1 / 3) if abs(c - x) < 1 / 4),
            }
        )
        quads = [
            quad(lambda t, x=x: value(t) * (1 - 4 * abs(t - x)), a, b, epsabs=1e-14)[0]
            for a, b in pairwise(cuts)
        ]
        assert load[i] == pytest.approx(sum(quads), abs=1e-12)
    assert flux.end_values[4:].max() == 0
    assert (distance(mesh, flux) < 1e-10) == (q == "3*x - 1")


def distance(mesh, flux, form=H1):
    """A bound on the norm of tau - tau~: that of p - tau~, and of a residual that has no parts but rho."""
    zero = np.zeros(len(mesh.triangles))
    residual_parts = ResidualParts(mesh, form, zero.copy(), zero, zero, zero.copy(), zero + np.inf)
    add_given_flux_remainder(residual_parts, flux)
    return flux.projection_error(mesh, form) + residual_parts.dual_norms()[0]


def supremum(mesh, flux, fine, fine_flux, form=H1):
    """sup <tau - tau~, v>/||v|| over V_h of a finer mesh, on which tau has those moments: a lower bound."""
    x = fine.s[:-1]
    edge = np.searchsorted(mesh.s, 0.5 * (fine.s[1:] + fine.s[:-1])) - 1
    fractions = (np.stack([x, fine.s[1:]], axis=1) - mesh.s[edge][:, None]) / np.diff(mesh.s)[edge][:, None]
    linear = flux.end_values[edge, :1] * (1 - fractions) + flux.end_values[edge, 1:] * fractions
    remaining_edge_load = edge_load(fine, fine_flux.end_values - linear)
    return np.sqrt(remaining_edge_load @ spsolve(form_matrix(fine, form).tocsc(), remaining_edge_load))


@pytest.mark.parametrize("q", [*FUNCTIONS][:3])
@pytest.mark.parametrize("kind", ["structured", "gmsh", "coarsest"])
def test_what_is_left_is_bounded(q, kind):
    """Against suprema on meshes of 1/64 and 1/32. Control: without ||p - tau~|| they are above.

    Where edges see most of the flux it is sharp within a factor of 6: triangles have constants that are up to
    3.3 times those of squares.
    """
    polygon = square()
    mesh = {
        "structured": lambda: make_structured_mesh(polygon, 1 / 8),
        "gmsh": lambda: meshes.make_unstructured_mesh(polygon, 1 / 5),
        "coarsest": lambda: make_structured_mesh(polygon, 1),
    }[kind]()
    fine = meshes.refine_uniformly(mesh, 3 if kind != "coarsest" else 5)
    flux = flux_of(q)
    given_flux = project_given_flux(flux, mesh)
    min_supremum = supremum(mesh, given_flux, fine, project_given_flux(flux, fine))
    assert min_supremum <= distance(mesh, given_flux)
    assert kind == "coarsest" or distance(mesh, given_flux) <= 6 * min_supremum
    assert distance(mesh, given_flux._replace(oscillation=0 * given_flux.oscillation)) < min_supremum


def test_a_flux_that_is_hardly_known_is_bounded(monkeypatch):
    """400 waves with 8 pieces: p is nothing like it. Control: what p leaves is nothing."""
    right = flux_of("1 + sin(40*pi*x)")
    mesh = make_structured_mesh(square(), 1 / 2)
    monkeypatch.setattr(piecewise, "MAX_SIDE_PIECES", 8)
    flux = project_given_flux(flux_of("1 + sin(40*pi*x)"), mesh)
    fine = meshes.refine_uniformly(mesh, 5)
    min_supremum = supremum(mesh, flux, fine, project_given_flux(right, fine))
    assert min_supremum <= distance(mesh, flux)
    assert flux.remainder_dual_norm(mesh, H1) > 0.5 * distance(mesh, flux) > 0.1
    assert (
        distance(
            mesh,
            flux._replace(
                remainder_norms=0 * flux.remainder_norms, remainder_integrals=0 * flux.remainder_integrals
            ),
        )
        < min_supremum
    )


@pytest.mark.parametrize("form", [H1, Form(2.0, 1e3), Form(0.5, 0.1)])
@pytest.mark.parametrize(("rho", "n"), [("mean", 1), ("mean", 8), ("free of means", 1), ("free of means", 8)])
def test_a_function_is_bounded_by_its_norm_and_its_mean(rho, n, form):
    """1, and half a wave per edge, sqrt(2) cos(pi n x), without means.

    Their norms and integrals on every edge are exact. Control: without the integral, and without the norm,
    the bounds are too small; but for means on triangles that are large, whose constants are too good.
    """
    mesh = make_structured_mesh(square(), 1 / n)
    bottom = np.arange(4 * n) < n
    means = rho == "mean"
    zero = np.zeros(4 * n)
    norm = np.where(bottom, n**-0.5, 0.0)
    mean = np.where(bottom & means, 1 / n, 0.0)
    edge_flux = GivenEdgeFlux(np.zeros((4 * n, 2)), zero, norm, mean)
    fine = meshes.refine_uniformly(mesh, 5 if n == 1 else 3)
    exact = project_given_flux(flux_of("1" if means else f"sqrt(2)*cos({n}*pi*x)"), fine)
    min_supremum = supremum(mesh, no_given_flux(mesh), fine, exact, form)
    assert min_supremum <= distance(mesh, edge_flux, form)
    without = (
        edge_flux._replace(remainder_integrals=zero) if means else edge_flux._replace(remainder_norms=zero)
    )
    assert distance(mesh, without, form) < min_supremum or (means and form.c / n**2 > 0.1 * form.k)


def test_a_jump_at_a_node_may_be_on_either_edge():
    """Of height 3, within a few units in the last place of 1/2: both edges have it; others have round-off."""
    mesh = make_structured_mesh(square(), 1 / 4)
    flux = flux_of("3*pos(x - 1/2, 0)")
    norm, integral = module._remainder_bounds(
        flux, mesh, *(np.zeros(0, dtype=t) for t in (int, float, float))
    )
    assert np.all(norm[1:3] >= 3 * np.sqrt(flux.reach))
    assert np.all(integral[1:3] >= 3 * flux.reach)
    assert norm[[0, 3]].max() < 1e-6 * norm[1:3].min()


def test_one_jump_at_a_node_is_on_both_edges():
    """A single place, 1/2, where rho is up to 3 within the reach: on either edge that is a whole reach."""
    mesh = make_structured_mesh(square(), 1 / 4)
    flux = flux_of("0")
    flux = replace(flux, points=np.array([0.0, 0.5, 4.0]), jumps=np.array([0.0, 3.0, 0.0]), reach=1e-3)
    norm, integral = module._remainder_bounds(
        flux, mesh, *(np.zeros(0, dtype=t) for t in (int, float, float))
    )
    assert np.all(norm[1:3] >= 3 * np.sqrt(1e-3))
    assert np.all(integral[1:3] >= 3 * 1e-3)
    assert norm[[0, *range(3, 16)]].max() == 0


def test_a_jump_inside_an_edge_counts_on_both_sides_of_its_place():
    """Its place is known up to the reach: on twice that the flux may differ by 3."""
    mesh = make_structured_mesh(square(), 1 / 4)
    flux = flux_of("3*pos(x - 1/3, 0)")
    index = np.argmin(np.abs(flux.points - 1 / 3))
    flux = replace(flux, jumps=np.where(np.arange(len(flux.jumps)) == index, 3.0, 0.0))
    norm, integral = module._remainder_bounds(
        flux, mesh, *(np.zeros(0, dtype=t) for t in (int, float, float))
    )
    assert norm[1] == pytest.approx(3 * np.sqrt(2 * flux.reach))
    assert integral[1] == pytest.approx(3 * 2 * flux.reach)


def test_places_on_an_edge_are_known_up_to_the_reach():
    """Moved by that, a flux changes its mean by as much over the edge; and 8 products are summed for it."""
    mesh = make_structured_mesh(square(), 1 / 4)
    flux = flux_of("1000/3")
    edge = np.array([0, 1])
    size = np.array([2.0, 3.0])
    flux_rounding = module._given_flux_rounding(flux, mesh, edge, size)
    assert np.all(flux_rounding[:2] >= size * (8 * 2**-52 + flux.reach / 0.25))
    assert not flux_rounding[2:].any()


def test_rounding_is_unknown_too():
    """Of a flux that is p: that of the moments, at least EPS / 2 of their size."""
    flux = flux_of("1000/3")
    exact = replace(flux, remainder=0 * flux.remainder, jumps=0 * flux.jumps)
    computed = project_given_flux(exact, make_structured_mesh(square(), 1 / 4))
    assert 2**-53 * 333 < computed.remainder_dual_norm(make_structured_mesh(square(), 1 / 4), H1) < 1e-10


def test_a_jump_leaves_next_to_nothing_unknown():
    """A piece of 2^-44 with half of the jump: in L2 2^-23; its mean is 2^-45."""
    mesh = make_structured_mesh(square(), 1 / 8)
    flux = project_given_flux(flux_of("2*pos(x - 1/3, 0)"), mesh)
    assert flux.remainder_dual_norm(mesh, H1) <= 2**-20
    assert distance(mesh, flux) > 0.01


def test_a_flux_without_bounds_is_not_taken_for_one():
    """1/x on a side that ends at 0, which a file refuses: nothing is known."""
    problem = ul.Problem(SQUARE, f=0, g=0, free_sides=[0], q="x")
    worse = replace(problem, q=(problem.q[0] ** -1, *problem.q[1:]))
    mesh = make_structured_mesh(square(), 1 / 2)
    assert distance(mesh, project_given_flux(worse.enclosed_flux, mesh)) == np.inf


def test_without_a_given_flux_nothing_of_it_is_unknown():
    mesh = make_structured_mesh(square(), 1 / 2)
    flux = project_given_flux(ul.case("natural").enclosed_flux, mesh)
    assert distance(mesh, flux) < 1e-140
    assert flux.remainder_dual_norm(mesh, H1) == 0
    assert not flux.end_values.any()
    assert no_given_flux(mesh).oscillation.shape == (8,)


def test_what_the_flux_leaves_of_lambda_is_its_norm():
    """||lambda_H - q.n||_e^2 by sums over 20000 points of every edge; slopes are limited on some of them.

    q.n >= 0 is linear; where it is not lambda_H's linear part, only the mean is kept, with the larger
    constant.
    """
    mesh = make_structured_mesh(square(), 1 / 3)
    cells = partitions.make_shifted_partition(square(), 0.11, 0.3)
    lambda_H = np.random.default_rng(1).random(cells.n_cells) ** 6
    normal_flux = build_normal_flux(mesh, cells, lambda_H, np.zeros(mesh.n_nodes), Form(c=0.0))
    x = (np.arange(20_000) + 0.5) / 20_000
    limited = []
    for e, length in enumerate(np.diff(mesh.s)):
        value = lambda_H[np.searchsorted(cells.points, mesh.s[e] + length * x) - 1]
        q_n = normal_flux.end_values[e, 0] * (1 - x) + normal_flux.end_values[e, 1] * x
        assert normal_flux.oscillation_squares[e] == pytest.approx(
            length * np.mean((value - q_n) ** 2), rel=2e-3
        )
        assert np.mean(q_n) == pytest.approx(np.mean(value), rel=1e-3)
        slope = 6 * np.mean((2 * x - 1) * value)
        limited.append(abs(np.diff(normal_flux.end_values[e])[0] - slope) > 1e-2 * abs(slope))
    assert np.all(normal_flux.end_values >= 0)
    np.testing.assert_array_equal(normal_flux.square_constants == MEAN_FREE_SQUARE_CONSTANT, limited)
    assert 0 < sum(limited) < len(limited)


def test_the_constants_on_squares_cannot_be_smaller():
    """On a half-plane: exp(-k pi y / h) cos(k pi x / h) has the energy k pi/h of its trace's square.

    k = 1 is orthogonal to constants on every edge of length h, k = 2 to linear functions: 1 / (k pi) at
    least.
    """
    for k, constant in ((1, MEAN_FREE_SQUARE_CONSTANT), (2, SQUARE_CONSTANT)):
        assert 1 / (k * np.pi) <= constant <= 1.01 / (k * np.pi)
    x = np.linspace(0, 1, 1001)
    assert (
        abs(np.trapezoid(np.cos(2 * np.pi * x) * x, x)) < 1e-12 < abs(np.trapezoid(np.cos(np.pi * x) * x, x))
    )


@pytest.mark.parametrize("form", [Form(4.0, 1.0), Form(1.0, 0.0, (2,), friedrichs=3.0)])
def test_what_is_unknown_counts_by_gradients_and_values(form):
    """||rho||_e times the root of the triangle's constant over k; the mean over |T|^(1/2) by W."""
    mesh = make_structured_mesh(square(), 1 / 8)
    size, integral = np.zeros((2, 32))
    size[3] = 2.0
    integral[4] = 5.0
    rho = GivenEdgeFlux(np.zeros((32, 2)), np.ones(32), size, integral)
    constant = trace_constants(mesh, 1 / BESSEL_ZERO)[3]
    values = 5.0 / math.sqrt(mesh.areas[0]) * form.value_constant
    assert rho.remainder_dual_norm(mesh, form) == pytest.approx(2 * math.sqrt(constant / form.k) + values)


def test_both_the_size_and_the_mean_of_what_is_unknown_have_the_rounding_of_moments():
    """As if places were known up to a hundredth of an edge: a flux of 5 is known up to 0.05."""
    mesh = make_structured_mesh(square(), 1 / 8)
    flux = flux_of("5")
    flux = replace(flux, remainder=0 * flux.remainder, jumps=0 * flux.jumps, reach=0.01 / 8)
    given_flux = project_given_flux(flux, mesh)
    assert np.all(given_flux.remainder_norms[:8] >= 0.05 * np.sqrt(1 / 8))
    assert np.all(given_flux.remainder_integrals[:8] >= 0.05 / 8)
    assert not given_flux.remainder_norms[8:].any()


def test_the_largest_force_of_a_cell_at_an_edge_pushes_it():
    """H_i lambda_i / k, of two cells that meet inside an edge."""
    mesh = make_structured_mesh(square(), 1 / 2)
    cells = partitions.from_points(square(), [0, 0.3, 1, 2, 3, 4])
    lambda_H = np.array([2.0, 1.0, 0.5, 0.0, 0.0])
    contact_scale = build_normal_flux(
        mesh, cells, lambda_H, np.zeros(mesh.n_nodes), Form(2.0, 0.0)
    ).contact_scale
    assert contact_scale.tolist() == pytest.approx([0.35, 0.35, 0.25, 0.25, 0, 0, 0, 0])


@pytest.mark.parametrize("ratio", [1e-3, 2.0, 1e3])
def test_where_no_layer_is_seen_sigma_is_at_most_the_flux_of_u_h(ratio):
    """w mu + (1 - w) min(mu, k du_h/dn): du_h/dn = 1 on side 1, -1 on side 3 of u_h = x, and 0 on the others.

    lambda_H = 5 is mu, so that nothing but mu - sigma is left of it.
    """
    mesh = make_structured_mesh(square(), 1 / 4)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    k = 3.0
    form = Form(k, ratio * EDGE_REACTION_RATIO * k * 16)
    lambda_H = np.full(cells.n_cells, 5.0)
    normal_flux = build_normal_flux(mesh, cells, lambda_H, mesh.points[:, 0], form)
    w = min(1.0, 1 / ratio) ** 2
    for side, flux in ((0, 0.0), (1, 3.0), (2, 0.0), (3, 0.0)):
        expected = w * 5 + (1 - w) * flux
        assert normal_flux.end_values[mesh.side == side] == pytest.approx(expected)
        assert normal_flux.reduction_squares[mesh.side == side] == pytest.approx((5 - expected) ** 2 / 4)
    assert not normal_flux.oscillation_squares.any()
    lowered = math.sqrt(value_constants(mesh, form) @ normal_flux.reduction_squares)
    assert normal_flux.multiplier_distance(mesh, form) == pytest.approx(lowered)
    assert normal_flux.contact_scale == pytest.approx(w * 5 / 4 / 3)
    free = build_normal_flux(mesh, cells, 0 * lambda_H, mesh.points[:, 0], form)
    assert not free.end_values.any()
    assert free.multiplier_distance(mesh, form) == 0
