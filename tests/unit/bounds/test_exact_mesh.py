"""Bounds hold on the polygon itself: u is linear, so that its error is what displaced nodes and rounding do.

The true errors are computed with 50 digits on the exact mesh, whose boundary nodes lie on the sides.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import scipy.sparse.linalg as sla
import sentences
import sympy
from displaced import add_doubt
from known_solutions import fluxes
from mpmath import mp, mpf
from symbolic import X, Y, plain

from unilateral.bounds import local_bounds
from unilateral.bounds.balanced_potential import balance_potential, build_energy
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.equilibrated_flux import triangle_inflows
from unilateral.bounds.flux_residuals import misfit, residual_parts
from unilateral.bounds.forces import bound_forces
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.misfit_field import build_misfit_field
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.bounds.source import Source, enclose_function
from unilateral.discrete.problem_data import problem_form
from unilateral.errors import InputError
from unilateral.fem.condense import form_matrix
from unilateral.fem.form import H1
from unilateral.fem.p2 import linear_square_norms
from unilateral.formulas.expression import rational_expression as exact_number
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry import refinement
from unilateral.geometry.adapted import refine_and_balance, start_adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.triangulation_checks import round_off
from unilateral.problems.problem import Problem

KITE = np.array([[0, 0], [1, 0], [1, 0.7], [0, 1.3]])


def exact(number):
    return sympy.Rational(float(number))


def digits(numbers):
    return np.array([[mpf(float(x)) for x in row] for row in numbers], dtype=object)


def rotate(vertices, angle):
    c = np.cos(angle)
    s = np.sin(angle)
    return vertices @ np.array([[c, s], [-s, c]])


def place_polygon(size, place, angle=0.6, shape=KITE):
    return Polygon(size * rotate(shape, angle) + np.array([0.3, 1.0]) * place)


def move_nodes_off_sides(mesh, component=0.9):
    """A mesh whose boundary nodes lie beside their sides, off by a part of what is left as round-off."""
    rng = np.random.default_rng(5)
    points = mesh.points.copy()
    polygon = mesh.polygon
    shift = component * round_off(polygon) * rng.choice([-1, 1], len(mesh.boundary))
    inner = ~np.isin(mesh.s[:-1], polygon.starts)
    points[mesh.boundary] += (inner * shift)[:, None] * polygon.normals[mesh.side]
    return meshes.from_arrays(polygon, points, mesh.triangles)


def halved_somewhere(polygon):
    adapted_mesh = start_adapted_mesh(
        meshes.triangulate_from_cells(partitions.make_uniform_partition(polygon, polygon.lengths.max()), 2)[0]
    )
    rng = np.random.default_rng(2)
    for _ in range(4):
        chosen = adapted_mesh.mesh.boundary_triangles[rng.random(len(adapted_mesh.mesh.boundary)) < 0.3]
        adapted_mesh = refine_and_balance(adapted_mesh, chosen)
    return adapted_mesh.mesh


class Linear(NamedTuple):
    """-k lap u + c u = f with u = slope . (x - vertex 0), the slope along side 0: so lambda = 0 there.

    The other sides are free, with the flux given.
    """

    problem: Problem
    slope: tuple[sympy.Rational, sympy.Rational]

    def evaluate(self, points):
        """u (n,) at points (n, 2) of 50 digits."""
        slope_x, slope_y = self.slope
        a = mpf(slope_x.p) / mpf(slope_x.q)
        b = mpf(slope_y.p) / mpf(slope_y.q)
        start = digits(self.problem.polygon.vertices[:1])[0]
        return a * (points[:, 0] - start[0]) + b * (points[:, 1] - start[1])


def linear(polygon, k=1, c=1):
    x, y = [exact(z) for z in polygon.vertices[0]]
    end_x, end_y = [exact(z) for z in polygon.vertices[1]]
    a = end_x - x
    b = end_y - y
    u = a * (X - x) + b * (Y - y)
    q = tuple(k * u for u in fluxes(u, polygon.vertices))
    g = (u - a**2 - b**2, *[sympy.S.Zero] * (polygon.n_sides - 1))
    free = tuple(range(1, polygon.n_sides))
    coefficients = {"k": plain(sympy.sympify(k)), "c": plain(sympy.sympify(c))}
    f = plain(c * u)
    g = tuple(map(plain, g))
    q = tuple(map(plain, q))
    return Linear(Problem("linear", polygon, f, g, free, q=q, **coefficients), (a, b))


def exact_nodes(mesh):
    """(n, 2) the nodes, those on the boundary where s divides the exact sides."""
    polygon = mesh.polygon
    computed = digits(mesh.points)
    vertices = digits(polygon.vertices)
    starts = [mpf(float(s)) for s in polygon.starts]
    for node, s, side in zip(mesh.boundary, mesh.s[:-1], mesh.side, strict=True):
        t = (mpf(float(s)) - starts[side]) / (starts[side + 1] - starts[side])
        computed[node] = vertices[side] + t * (vertices[(side + 1) % polygon.n_sides] - vertices[side])
    return computed


def true_error(exact, mesh, u_h):
    """(k |u - u_h|_1^2 + c ||u - u_h||_0^2)^{1/2} on the exact mesh, where u - u_h is linear on triangles."""
    places = exact_nodes(mesh)
    problem = exact.problem
    displaced = (exact.evaluate(places) - np.array([mpf(float(x)) for x in u_h], dtype=object))[
        mesh.triangles
    ]
    x, y = places[mesh.triangles].transpose(2, 0, 1)
    e = np.roll(x, 1, axis=1) - np.roll(x, -1, axis=1)
    f = np.roll(y, 1, axis=1) - np.roll(y, -1, axis=1)
    twice = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    squares = ((displaced * f).sum(axis=1) ** 2 + (displaced * e).sum(axis=1) ** 2) / twice / 2
    values = ((displaced**2).sum(axis=1) + displaced.sum(axis=1) ** 2) * twice / 24
    k = mpf(problem.k.rational.numerator) / mpf(problem.k.rational.denominator)
    c = mpf(problem.c.rational.numerator) / mpf(problem.c.rational.denominator)
    return float(mp.sqrt(k * squares.sum() + c * values.sum()))


def indices(exact, mesh):
    """Bounds over errors: of u at the nodes in memory, and of what the mesh in memory has as its solution."""
    polygon = mesh.polygon
    cells = partitions.make_uniform_partition(polygon, polygon.lengths.max())
    form = problem_form(exact.problem, mesh)
    on_mesh = enclose_data(exact.problem, mesh, form)
    discrete = sla.splu(form_matrix(mesh, form).tocsc()).solve(on_mesh.load)
    computed = []
    with mp.workdps(50):
        at_nodes = exact.evaluate(digits(mesh.points)).astype(float)
        for u_h in (at_nodes, discrete):
            lambda_H = np.zeros(cells.n_cells)
            bounds = [bound(on_mesh, cells, u_h, lambda_H, form).u for bound in (local_bound, sharp_bound)]
            error = true_error(exact, mesh, u_h)
            computed.append(min(bounds) / error if error else np.inf)
    return computed


FAR = {
    "small": lambda: meshes.make_unstructured_mesh(place_polygon(1 / 128, 1e6), 1 / 1024),
    "smaller": lambda: meshes.make_unstructured_mesh(place_polygon(1e-3, 1e4), 1e-4),
    "beside its sides": lambda: move_nodes_off_sides(
        meshes.make_unstructured_mesh(place_polygon(1 / 128, 1e6), 1 / 512)
    ),
    "beside, fine": lambda: move_nodes_off_sides(
        meshes.make_unstructured_mesh(place_polygon(1e-3, 1e4), 1e-4)
    ),
    "refined": lambda: meshes.refine_uniformly(
        move_nodes_off_sides(meshes.make_unstructured_mesh(place_polygon(1 / 128, 1e6), 1 / 128)), 3
    ),
}
"""Polygons far from the origin, on whose slanted sides nodes are rounded."""
OTHERS = {
    "needle": lambda: meshes.make_unstructured_mesh(place_polygon(1, 1e3, shape=KITE * [1, 1e-3]), 0.02),
    "square": lambda: meshes.make_unstructured_mesh(place_polygon(1, 1e6, shape=square().vertices), 0.2),
    "adapted": lambda: halved_somewhere(place_polygon(1, 1e4)),
    "short side": lambda: meshes.make_unstructured_mesh(
        place_polygon(1, 0, shape=np.vstack([KITE, [[0, 1e-5]]])), 0.5
    ),
    "often refined": lambda: meshes.refine_uniformly(
        meshes.make_unstructured_mesh(place_polygon(1, 1e5), 2), 4
    ),
}


@pytest.mark.parametrize("name", [*FAR, *OTHERS])
def test_bounds_hold_on_the_polygon_itself(name):
    mesh = (FAR | OTHERS)[name]()
    assert min(indices(linear(mesh.polygon), mesh)) >= 1


@pytest.mark.parametrize("name", ["beside its sides", "beside, fine", "refined"])
def test_without_the_distance_from_the_exact_mesh_bounds_fail(name, monkeypatch):
    monkeypatch.setattr(Mesh, "distortion", property(lambda mesh: np.zeros(len(mesh.triangles))))
    mesh = FAR[name]()
    assert min(indices(linear(mesh.polygon), mesh)) < 0.7


@pytest.mark.parametrize(
    ("k", "c"), [("1e-6", "1e6"), ("1e6", "1e-6"), ("1/3", "7"), ("1e12", "1"), ("2", "1e-4")]
)
@pytest.mark.parametrize("place", [0.0, 1e5])
def test_bounds_with_coefficients_hold_on_the_polygon_itself(k, c, place):
    polygon = place_polygon(1 / 4, place)
    mesh = meshes.make_unstructured_mesh(polygon, 0.1)
    assert min(indices(linear(polygon, *map(sympy.Rational, (k, c))), mesh)) >= 1


def displace_nodes(mesh, u, q, rng):
    """||grad u - q|| and ||div q|| on a mesh all of whose nodes are moved by nearly their shift.

    Nodes on the sides stay where they divide them, and flows through them are as their lengths.
    """
    polygon = mesh.polygon
    side = mesh.side
    angle = rng.uniform(0, 2 * np.pi, mesh.n_nodes)
    shift = mesh.node_shifts * rng.uniform(0.8, 1, mesh.n_nodes)
    points = mesh.points + shift[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = points[mesh.boundary[np.isin(mesh.s[:-1], polygon.starts)]]
    edges = np.roll(vertices, -1, axis=0) - vertices
    t = (mesh.s[:-1] - polygon.starts[side]) / polygon.lengths[side]
    points[mesh.boundary] = vertices[side] + t[:, None] * edges[side]
    shifted_mesh = replace(mesh, points=points)
    q = q.copy()
    q[:, mesh.triangulation.boundary_edges] *= (np.hypot(*edges.T) / polygon.lengths)[side]
    gradient = linear_square_norms(shifted_mesh.areas, misfit(shifted_mesh, u, q, slice(None)))
    flow = np.sum(triangle_inflows(shifted_mesh, q, slice(None)), axis=(0, 1))
    return np.sqrt(gradient.sum()), np.sqrt(np.sum((0.5 * flow) ** 2 / shifted_mesh.areas))


@pytest.mark.parametrize("size", [1.0, 1e-2])
def test_what_is_added_holds_what_displaced_nodes_do(size):
    """For q = grad u, u linear, and f = u both norms are 0 in memory. Control: a tenth is too little."""
    ratios = []
    for number in range(12):
        rng = np.random.default_rng(number)
        polygon = Polygon(size * KITE * [1, 10.0 ** -(number % 2)])
        mesh = add_doubt(meshes.make_unstructured_mesh(polygon, size / rng.choice([2, 8, 20])), 1e-6 * size)
        slope = rotate(np.array([1.0, 0.0]), rng.uniform(0, 2 * np.pi))
        u = mesh.points @ slope
        (start, end) = mesh.points[mesh.triangulation.ends.T]
        e, f = (end - start).T
        q = np.stack([slope[1] * e - slope[0] * f, np.zeros_like(e)])
        at_nodes = u[mesh.triangles]
        source = Source(mesh, at_nodes, *np.zeros((3, len(at_nodes))))
        components = residual_parts(source, no_given_flux(mesh), u, q, H1)
        assert np.linalg.norm(components.mean) < 1e-12 * size
        added = np.linalg.norm(components.misfit), np.linalg.norm(components.remainder)
        ratios.append(np.divide(displace_nodes(mesh, u, q, rng), added))
    assert np.all(np.max(ratios, axis=0) > 0.1)
    assert np.max(ratios) <= 1


def test_f_is_enclosed_where_displaced_nodes_put_it(monkeypatch):
    """f = 3 x is off by 3 times the doubt where all nodes are moved in x by that much."""
    polygon = Polygon(KITE)
    mesh = meshes.make_unstructured_mesh(polygon, 0.3)
    monkeypatch.setattr(Mesh, "node_shifts", property(lambda mesh: np.full(mesh.n_nodes, 1e-3)))
    g = (exact_number(-9),) * polygon.n_sides
    source = enclose_function(mesh, Problem("moved", polygon, plain(3 * X), g, ()).source)
    assert np.all(source.remainder >= 3e-3 * np.sqrt(mesh.areas))


def test_what_the_sharp_bound_adds_to_the_flux_is_displaced_too():
    """curl phi makes q larger, and so what the exact mesh may do to it: eps |curl phi| on a triangle."""
    polygon = Polygon(KITE)
    mesh = add_doubt(meshes.make_unstructured_mesh(polygon, 0.3), 1e-6)
    rng = np.random.default_rng(9)
    problem = Problem("waves", polygon, plain(sympy.sin(3 * X) * Y), (exact_number(-9),) * 4, ())
    source = enclose_function(mesh, problem.source)
    sigma = np.zeros((len(mesh.boundary), 2))
    energy = build_energy(mesh, H1)
    w, q = balance_potential(source, np.zeros(mesh.n_nodes), sigma, energy)
    field = build_misfit_field(energy.spaces, source, w, q, H1)
    phi = rng.uniform(-1, 1, field.spaces.size)
    curl = linear_square_norms(mesh.areas, field.spaces.gradient(phi))
    extra = field.add_curl(phi).misfit_allowance - field.misfit_allowance
    assert np.all(mesh.areas * extra**2 >= mesh.distortion**2 * curl)


@pytest.mark.parametrize("bound", [local_bound, sharp_bound])
def test_both_bounds_are_multiplied_by_the_growth(bound, monkeypatch):
    """And so is the norm that bounds a force."""
    mesh = meshes.make_unstructured_mesh(square(), 1 / 4)
    cells = partitions.make_uniform_partition(square(), 1 / 2)
    problem = Problem("bowl", square(), plain(X**2 + Y**2), (exact_number(0),) * 4, ())
    data = enclose_data(problem, mesh, H1)
    u_h = np.sum(mesh.points**2, axis=1)
    lambda_H = np.ones(cells.n_cells)
    computed = []
    for growth in (1.0, 1.5):
        monkeypatch.setattr(Mesh, "exact_mesh_factor", growth)
        bounds = bound(data, cells, u_h, lambda_H, H1)
        computed.append(
            [bounds.u, bounds.lambda_, bound_forces(mesh, cells, 0 * lambda_H, 0.1, [range(4)])[0].upper]
        )
    np.testing.assert_allclose(computed[1], 1.5 * np.array(computed[0]), rtol=1e-12)


def test_nodes_within_the_tolerance_are_moved():
    """Off by 0.99e-10 they once left an error that was above the bound; moved, they leave none."""
    mesh = meshes.make_unstructured_mesh(square(), 1 / 8)
    rng = np.random.default_rng(0)
    points = mesh.points.copy()
    inner = ~np.isin(mesh.s[:-1], square().starts)
    shift = 0.99e-10 * inner * rng.choice([-1, 1], len(inner))
    points[mesh.boundary] += shift[:, None] * square().normals[mesh.side]
    original = meshes.from_arrays(square(), points, mesh.triangles)
    exact = linear(square())
    with mp.workdps(50):
        error = true_error(exact, original, original.points[:, 0])
        assert true_error(exact, original, points[:, 0]) > 1e-10
    assert error < 1e-15
    assert min(indices(exact, original)) >= 1


@pytest.mark.parametrize(("place", "refused"), [(1e6, False), (1e9, True)])
def test_meshes_that_rounding_distorts_have_no_bound(place, refused):
    """At 1e9 coordinates are rounded by 6e-8, more than 1e-3 of the least heights, which are some 2e-5.

    Nor is a mesh refined until it is one; here its nodes are given.
    """
    polygon = place_polygon(1, place, shape=KITE * [1, 1e-4])
    coarse = meshes.from_arrays(polygon, polygon.vertices, [[0, 1, 2], [0, 2, 3]])
    fine, step = refinement.refine_triangulation(coarse.triangulation)
    middle = polygon.vertices[step.ends].mean(axis=1)
    mesh = meshes.from_arrays(polygon, np.concatenate([polygon.vertices, middle]), fine.nodes)
    cells = partitions.make_uniform_partition(polygon, 1)
    u_h = np.zeros(mesh.n_nodes)
    lambda_H = np.zeros(cells.n_cells)
    if not refused:
        local_bounds.check_discrete_solution(mesh, cells, u_h, lambda_H, H1)
        return
    with sentences.raises(InputError):
        local_bounds.check_discrete_solution(mesh, cells, u_h, lambda_H, H1)
    with sentences.raises(InputError):
        meshes.refine_uniformly(coarse)
