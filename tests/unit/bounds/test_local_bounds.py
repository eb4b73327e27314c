"""The cheap guaranteed bound: never below the true error, how sharp, and that it needs all its parts."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from skfem.helpers import dot, grad
from test_dual import POLYGONS
from test_sharp_bounds import (
    CASES,
    CENTRES,
    Manufactured,
    OnlyTopAndBottom,
    bound_on,
    enclosed,
    h1_error,
    norm_for,
    pair,
)

from unilateral.bounds import feasible_p2, flux_residuals, lifting, local_bounds
from unilateral.bounds.edge_flux import SUMS
from unilateral.errors import InputError
from unilateral.fem.p1 import h1_norm
from unilateral.fem.p2 import layer
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.norms.dual import dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import Case


def local_bound(problem, mesh, cells, u_h, lambda_H, free=()):
    g = problem.enclosed_obstacle if isinstance(problem, Case) else problem.enclosed(free)
    return local_bounds.local_bound(enclosed(mesh, problem), g, cells, u_h, lambda_H, free)


@pytest.mark.parametrize(("name", "polygon"), CASES)
@pytest.mark.parametrize("crude", [None, "zero", "noise"])
def test_the_bounds_are_never_below_the_true_errors(name, polygon, crude):
    """On coarse meshes; on finer ones those below that are sharp."""
    for n in (4, 8):
        of = pair(name, n, polygon, crude)
        assert of.exceeded_by(local_bound(*of[:5]))


@pytest.mark.parametrize(("name", "polygon"), CASES[::2])
@pytest.mark.parametrize("size", [1e-3, 0.1, 3.0])
def test_nothing_is_asked_of_u_h(name, polygon, size):
    """u_h with noise of that size in ||.||_1; u - u_h is then no less than size less the error without."""
    of, rng = pair(name, 8, polygon), np.random.default_rng(3)
    noise = rng.standard_normal(of.mesh.n_nodes)
    noise *= size / h1_norm(of.mesh, noise)
    bound = local_bound(of.case, of.mesh, of.cells, of.u_h + noise, of.lambda_H)
    assert max(size - of.h1_error, 0) <= bound.u
    assert of.lower <= bound.lambda_
    assert bound.residual > 0.1 * size


SHARP = {"natural": (16, 32), "full_contact": (16, 32), "smooth": (32, 64), "thirds": (64, 128)}
"""1/h from which contact zones and f are resolved: the last two have them and cutoffs of 1/3 and 1/4."""


@pytest.mark.parametrize("name", SHARP)
def test_the_index_of_u_is_at_most_1_3_on_smooth_cases_and_falls_with_h(name):
    """1.3 is the round number of claim F.cheap; theory says only that the index is bounded."""
    found = [pair(name, n) for n in SHARP[name]]
    indices = [local_bound(*of[:5]).u / of.h1_error for of in found]
    assert all(index >= 1 for index in indices)
    assert indices[1] < indices[0]
    assert indices[1] <= 1.3


@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_partitions_whose_points_are_no_vertices_of_the_mesh(name, shift):
    """Full contact with a g that is not quadratic, triangles of all shapes.

    lambda_H jumps inside edges. There the flux has not its moments, and the patches do not fit: valid all the
    same, and less sharp.
    """
    polygon, (a, b) = POLYGONS[name], CENTRES[name]
    x, y = f"(x - {a})", f"(y - {b})"
    problem = Manufactured(polygon, f"({x}**2 + {y}**2)/2 + {x}**3/200 + {y}**4/200 + 0.03*{x}*{y}")
    mesh, cells = meshes.unstructured(polygon, 0.11), partitions.shifted(polygon, 0.27, shift)
    lambda_H = cell_means(problem, cells).lambda_means
    u_h = bound_on(problem, mesh, cells, lambda_H)[1]
    bound, error = local_bound(problem, mesh, cells, u_h, lambda_H), h1_error(problem, mesh, u_h)
    assert error <= bound.u <= 2 * error
    assert dual_norm(cells, [problem]).of_error(problem, lambda_H[None]).lower[0] <= bound.lambda_


@pytest.mark.parametrize(("name", "polygon"), CASES)
@pytest.mark.parametrize("crude", [None, "zero", "noise"])
def test_the_triangles_shares_add_up_to_the_squared_bound(name, polygon, crude):
    """At most that, for squares of sums are more; at least a sixth, by Cauchy's inequality used twice.

    (a + b)^2 <= 2 (a^2 + b^2) for data and the rest, (a + b + c)^2 <= 3 (..) for the parts of the lifting.
    """
    of = pair(name, 8, polygon, crude)
    bound = local_bound(*of[:5])
    assert np.all(bound.shares >= 0)
    assert bound.u**2 / 6 <= bound.shares.sum() * (1 + 1e-6) <= bound.u**2 * (1 + 2e-6)
    inside = np.delete(bound.shares, layer(of.mesh).triangles)
    assert inside.sum() <= bound.flux**2 + bound.residual**2 + bound.data**2


def test_a_triangle_s_share_is_its_own():
    """A value of u_h at a node in the middle moves shares of triangles at its neighbours, and no others."""
    of = pair("natural", 16)
    node, n = np.argmin(np.hypot(*(of.mesh.points - 0.5).T)), of.mesh.n_nodes
    shares = [
        local_bound(*of[:3], of.u_h + 0.01 * moved, of.lambda_H).shares for moved in (0, np.eye(n)[node])
    ]
    near = np.isin(of.mesh.triangles, of.mesh.triangles[(of.mesh.triangles == node).any(axis=1)]).any(axis=1)
    assert np.all(shares[1][~near] == shares[0][~near])
    assert shares[1][near].sum() > 2 * shares[0][near].sum()


def test_free_sides_have_no_obstacle():
    """u does not depend on x, so lambda = 0 on the free sides; the index as where everything is contact."""
    problem = OnlyTopAndBottom(square(), "cosh(y - 0.45) + 0.2")
    mesh, cells = structured(square(), 1 / 16), partitions.uniform(square(), 1 / 8)
    lambda_H = cell_means(problem, cells).lambda_means
    lambda_H[cells.side % 2 == 1] = 0
    u_h = bound_on(problem, mesh, cells, lambda_H, free=(1, 3))[1]
    error = h1_error(problem, mesh, u_h)
    assert error <= local_bound(problem, mesh, cells, u_h, lambda_H, free=(1, 3)).u <= 1.3 * error
    assert local_bound(problem, mesh, cells, u_h, lambda_H).u > 1e5


def test_nothing_but_free_sides():
    """Neumann's problem."""
    problem = Manufactured(square(), "cos(pi*x)*cos(2*pi*y)")
    mesh, cells = structured(square(), 1 / 16), partitions.uniform(square(), 1 / 8)
    zero, free = np.zeros(cells.n_cells), (0, 1, 2, 3)
    u_h = bound_on(problem, mesh, cells, zero, free=free)[1]
    bound, error = local_bound(problem, mesh, cells, u_h, zero, free=free), h1_error(problem, mesh, u_h)
    assert error <= bound.u <= 1.3 * error
    assert bound.lambda_ == bound.lifting == 0


def test_a_mesh_of_one_triangle():
    polygon = Polygon(np.array([[0, 0], [1, 0], [0, 1]]), "triangle")
    problem = Manufactured(polygon, "0.5*(x - 0.3)**2 + 0.5*(y - 0.3)**2 + 0.1*x**3")
    mesh, cells = meshes.from_arrays(polygon, polygon.vertices, [[0, 1, 2]]), partitions.uniform(polygon, 2)
    lambda_H = cell_means(problem, cells).lambda_means
    u_h = bound_on(problem, mesh, cells, lambda_H)[1]
    assert local_bound(problem, mesh, cells, u_h, lambda_H).u >= h1_error(problem, mesh, u_h)


def test_what_constants_on_triangles_leave_out_of_f():
    """u = cos(8 pi x), a wave per edge: without the data's share the bound is below the error."""
    problem = Manufactured(square(), "cos(8*pi*x)", "10")
    mesh, cells = structured(square(), 1 / 4), partitions.uniform(square(), 1 / 2)
    zero = np.zeros(cells.n_cells)
    u_h = bound_on(problem, mesh, cells, zero)[1]
    bound, error = local_bound(problem, mesh, cells, u_h, zero), h1_error(problem, mesh, u_h)
    assert bound.u - bound.data < error <= bound.u


def test_without_feasibility_the_bound_is_too_small(monkeypatch):
    """Control: with lambda_H = 0 the flux is that of Neumann's problem, which u_h solves."""
    of = pair("full_contact", 8, crude="zero")
    assert of.exceeded_by(local_bound(*of[:5]))
    nothing = feasible_p2.Missing(*np.zeros((2, len(of.mesh.boundary))), np.zeros(of.mesh.n_nodes))
    monkeypatch.setattr(lifting, "raised", lambda g, v, *_: (v, np.zeros(len(g.unknowns), dtype=bool)))
    monkeypatch.setattr(lifting, "missing", lambda *_: nothing)
    assert not of.exceeded_by(local_bound(*of[:5]))


def test_v_is_g_at_the_ends_of_edges_that_it_may_cross(monkeypatch):
    """Else the extension of g - v from such an edge would be no function of H1; u_h is above g there, too."""
    of, own, seen = pair("natural", 16), lifting.missing, []
    monkeypatch.setattr(lifting, "missing", lambda *given: seen.append(given[:3]) or own(*given))
    local_bound(*of[:5])
    g, v, touching = seen[0]
    unknowns = np.unique(g.unknowns[touching])
    assert np.all(v[unknowns] == g.at_unknowns[unknowns])
    nodes = unknowns[unknowns < len(touching)]
    assert np.max(of.u_h[of.mesh.boundary[nodes]] - g.at_unknowns[nodes]) > 1e-4


def test_with_other_fluxes_on_the_edges_the_bound_is_too_small(monkeypatch):
    """Control: q.n of the right lambda_H says nothing of one that is five times as large."""
    of, own = pair("full_contact", 8), local_bounds.edge_flux
    wrong = 5 * of.lambda_H
    lower = float(norm_for("full_contact", 4, "square").of_error(of.case, wrong[None]).lower[0])
    assert lower <= local_bound(*of[:4], wrong).lambda_
    monkeypatch.setattr(local_bounds, "edge_flux", lambda *_: own(of.mesh, of.cells, of.lambda_H))
    assert lower > 5 * local_bound(*of[:4], wrong).lambda_


def test_bad_input():
    """The sharp bound's checks."""
    problem, mesh = Manufactured(square(), "x"), structured(square(), 1 / 4)
    cells = partitions.uniform(square(), 1 / 2)
    with pytest.raises(InputError, match="another polygon"):
        local_bound(problem, mesh, partitions.uniform(named("lshape"), 1), np.zeros(25), np.ones(8))
    with pytest.raises(InputError, match="u_h must hold 25 finite numbers"):
        local_bound(problem, mesh, cells, np.zeros(24), np.ones(8))


@pytest.mark.parametrize("name", ["square", "lshape"])
def test_functions_of_the_layer_are_those_of_P2(name):
    """Norms against scikit-fem's, of random values at boundary nodes and midpoints."""
    mesh, rng = meshes.unstructured(named(name), 0.3), np.random.default_rng(0)
    of, nb = layer(mesh), len(mesh.boundary)
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
        return dot(grad(w.of), grad(w.of)) + w.of**2

    found = of.norms(*of.function(nodal, bubble)).sum()
    assert found == pytest.approx(square.assemble(p2, of=p2.interpolate(v)), rel=1e-12)
    norms = [of.norms(*of.function(np.zeros(nb), each)).sum() for each in np.eye(nb)[:3]]
    assert of.bubble_squares()[:3] == pytest.approx(norms, rel=1e-12)


def test_rounding_is_added():
    """u = 1e6 + x, f = u: the error of its interpolant is 0, and the bound what derivatives of it lose."""
    problem = Manufactured(square(), "1000000 + x", "1")
    mesh = structured(square(), 1 / 16)
    u_h = 1e6 + mesh.points[:, 0]
    squares, residual, rounding = flux_residuals.defects(
        enclosed(mesh, problem),
        u_h,
        local_bounds.equilibrated(mesh, u_h, enclosed(mesh, problem).moments_on, sigma(mesh)),
    )
    assert 0 < np.sqrt(squares.sum() + mesh.areas @ residual**2) <= rounding < 1e-4


def sigma(mesh):
    """q.n for q = (1, 0)."""
    return np.repeat(mesh.polygon.normals[mesh.side, 0], 2).reshape(-1, 2)


@pytest.mark.parametrize("depth", [30, 1000])
def test_a_steep_obstacle_below_u_h_costs_nothing(problem_of, depth):
    """g falls by `depth` on a side of length 0.0014. u_h = 0.99 is raised at its ends only, as for depth 1.

    g is so steep there that places, rounded, move it by more than its own rounding.
    """

    def lifting(depth):
        problem = problem_of(
            polygon="[[0, 0], [1, 0], [1, 1], [1/1000, 1], [0, 999/1000]]",
            f="1",
            g=f"[1, 1, 1, '1 - {depth}*(1 - 1000*x)*1000*x', 1]",
        )
        mesh, cells = meshes.unstructured(problem.polygon, 0.5), partitions.uniform(problem.polygon, 1.0)
        given = enclosed(mesh, problem), problem.enclosed_obstacle, cells
        return local_bounds.local_bound(*given, np.full(mesh.n_nodes, 0.99), np.zeros(cells.n_cells)).lifting

    assert lifting(depth) == pytest.approx(lifting(1), rel=1e-6)


def test_the_rounding_of_a_root_of_a_sum():
    """Of 16 million squares, each added with half a unit of rounding: the root has half of that."""
    assert SUMS >= 16e6 * 2.0**-53 / 2


def test_what_is_not_known_of_g_counts_three_times(monkeypatch):
    """Full contact and sigma > 0: by the doubt t, g may be lower and u_h + d is higher, and ||d||_1 grows.

    <sigma, u_h + d - g> grows by 2 t times the force, and the function added is t on the whole boundary.
    """
    of, t = pair("full_contact", 8), 1e-3
    force, shorts = of.cells.lengths @ of.lambda_H, []
    own = lifting.missing
    monkeypatch.setattr(lifting, "missing", lambda *given: shorts.append(own(*given)) or shorts[-1])
    g = of.case.enclosed_obstacle
    less = replace(g, doubt=g.doubt + t, upper=g.upper + t)
    for obstacle in (g, less):
        local_bounds.local_bound(enclosed(of.mesh, of.case), obstacle, of.cells, of.u_h, of.lambda_H)
    known, doubtful = shorts
    assert doubtful.product - known.product == pytest.approx(2 * t * force, rel=1e-6)
    np.testing.assert_allclose(doubtful.added[of.mesh.boundary], t, rtol=1e-6)
