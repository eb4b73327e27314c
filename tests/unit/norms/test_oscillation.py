"""What BDM1 does not carry: its constants against eigenvalues, where squares fit, and that it is needed."""

from fractions import Fraction
from functools import cache
from math import pi, sinh, sqrt, tanh

import numpy as np
import pytest
import skfem
from boundary_norms import POLYGONS, Flux, alternating, bound_p0_on_bottom, brackets, norm_on
from displaced import add_doubt
from scipy.linalg import eigh
from skfem.models.poisson import laplace, mass, unit_load

from unilateral.fem.form import H1, Form
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms import functionals
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.oscillation import (
    MEAN_FREE_SQUARE_CONSTANT,
    SQUARE_CONSTANT,
    SQUARE_REACH,
    has_square,
    oscillation_bound,
    trace_constants,
    value_constants,
)
from unilateral.norms.reference import build_reference_spaces

WEDGE = Polygon(np.array([[0, 0], [1, 0], [np.cos(pi / 18), np.sin(pi / 18)]]), "wedge")
SLIT = Polygon(np.array([[0, 0], [3, 0], [3, 1], [0.3, 1], [0.3, 1.05], [3, 1.05], [3, 2], [0, 2]]), "slit")
TRIANGLES = {
    "right": [[0, 0], [1, 0], [0, 1]],
    "30-60-90": [[0, 0], [sqrt(3), 0], [0, 1]],
    "thin": [[0, 0], [1, 0], [0.5, 0.03]],
    "obtuse": [[0, 0], [1, 0], [-1, 0.3]],
    "needle": [[0, 0], [0.05, 0], [0.9, 1]],
    "equilateral": [[0, 0], [1, 0], [0.5, sqrt(3) / 2]],
}
MESHES = {
    "structured": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 16),
    "thin": lambda: meshes.make_unstructured_mesh(WEDGE, 0.02),
    "slit": lambda: meshes.make_unstructured_mesh(SLIT, 0.1),
    "graded": lambda: build_reference_spaces(partitions.make_uniform_partition(WEDGE, 0.3), [0.1, 1.3]).mesh,
    "graded slit": lambda: (
        build_reference_spaces(partitions.make_uniform_partition(SLIT, 0.7), [0.4, 6.0]).mesh
    ),
}


def trace_eigenvalues(n=400):
    """The least c in <r, v> <= c^{1/2} ||r|| |v|_1 on the unit square: r without 1, r without 1 and x.

    The Neumann-to-Dirichlet map has the eigenfunctions cos(k pi x), the eigenvalues 1 / (k pi tanh k pi).
    """
    k = np.arange(1, n + 1)
    eigenvalues = 1 / (k * pi * np.tanh(k * pi))
    x = ((-1.0) ** k - 1) / k**2  # cosine coefficients, up to a factor
    away = np.eye(n) - np.outer(x, x) / (x @ x)
    return eigenvalues[0], np.linalg.eigvalsh(away * eigenvalues @ away)[-1]


def test_the_square_s_constant_is_the_greatest_eigenvalue():
    """Without x among the excluded functions it would be twice as large (control)."""
    without_1, without_both = trace_eigenvalues()
    assert pytest.approx(without_both, rel=1e-12) == SQUARE_CONSTANT
    assert without_1 == pytest.approx(MEAN_FREE_SQUARE_CONSTANT, rel=1e-12)
    assert without_1 > 1.9 * SQUARE_CONSTANT


def best_constants(vertices, mean_free=True, refinements=4, form=H1):
    """(3,) the largest ||v||_e^2 over an energy, for a triangle's edges e, from below: P2 on its parts.

    For mean-free v the energy is |v|_1^2, else that of the form.
    """
    mesh = skfem.MeshTri(np.array(vertices, float).T.copy(), np.array([[0], [1], [2]])).refined(refinements)
    basis = skfem.Basis(mesh, skfem.ElementTriP2())
    K = laplace.assemble(basis).toarray()
    integral = unit_load.assemble(basis)
    projector = np.eye(basis.N)
    if mean_free:
        projector -= np.outer(np.ones(basis.N), integral) / integral.sum()
        K += np.outer(integral, integral)
    else:
        K = form.k * K + form.c * mass.assemble(basis).toarray()
    largest = []
    last = [basis.N - 1] * 2
    v = np.array(vertices)
    boundary = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, mesh.boundary_facets()]].mean(axis=1)
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        displaced = np.abs((b - a)[0] * (middle[1] - a[1]) - (b - a)[1] * (middle[0] - a[0]))
        on_edge = skfem.FacetBasis(mesh, skfem.ElementTriP2(), facets=boundary[displaced < 1e-12 * np.ptp(v)])
        M = projector.T @ mass.assemble(on_edge).toarray() @ projector
        largest.append(eigh(M, K, eigvals_only=True, subset_by_index=last)[0])
    return np.array(largest)


def triangle(name, size=1.0):
    """A mesh of one triangle, which its three edges share."""
    polygon = Polygon(size * np.array(TRIANGLES[name]), name)
    return meshes.from_arrays(polygon, polygon.vertices, [[0, 1, 2]])


@cache
def best_of_traces(name):
    return best_constants(TRIANGLES[name])


@pytest.mark.parametrize("name", TRIANGLES)
def test_a_triangle_s_constants_are_never_below_the_best(name):
    """And at most 4 times the best, so that what oscillates is at most doubled."""
    mesh = triangle(name)
    best = best_of_traces(name)
    selected = trace_constants(mesh) / 3
    assert np.all(best <= selected)
    assert np.all(selected <= 4 * best)


def test_payne_and_weinberger_alone_would_be_too_small():
    """Control: without the gradient's term some constant lies below an eigenvalue."""
    below = []
    for name in TRIANGLES:
        polygon = triangle(name).polygon
        below.append(
            np.any(polygon.lengths / polygon.area * polygon.diameter**2 / pi**2 < best_of_traces(name))
        )
    assert sum(below) >= 3


def test_the_constants_of_edges_that_share_a_triangle_are_doubled():
    """Both triangles of the square cut in two have two boundary edges; d = 2^{1/2}, a = 2^{1/2}."""
    mesh = make_structured_mesh(square(), 1.0)
    edge_constants = trace_constants(mesh)
    np.testing.assert_allclose(edge_constants, 2 * 2 * (2 / pi**2 + 2 / pi), rtol=1e-14)


@pytest.mark.parametrize("form", [H1, Form(4.0, 9.0), Form(1.0, 1e3)])
@pytest.mark.parametrize("size", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("name", TRIANGLES)
def test_the_constant_for_values_on_an_edge_is_above_the_best_one(name, size, form):
    """Control: a third of it is too small where triangles are small beside (k/c)^(1/2).

    There the best v is 1, with |e|/|T|/c.
    """
    mesh = triangle(name, size)
    selected = value_constants(mesh, form) / 3
    best = best_constants(mesh.polygon.vertices, mean_free=False, refinements=3, form=form)
    assert np.all(best <= selected)
    assert size**2 * form.c > 1e-3 * form.k or np.all(selected / 3 < best)


def test_without_c_values_on_an_edge_have_no_constant():
    assert np.all(np.isinf(value_constants(triangle("thin"), Form(c=0.0))))


@pytest.mark.parametrize("form", [Form(5.0, 0.0), Form(5.0, 1e6)])
def test_on_every_edge_the_smaller_constant_counts(form):
    """Those of |v|_1 are divided by k; for a layer much thinner than edges that of ||v||_T is smaller."""
    mesh = make_structured_mesh(square(), 1 / 8)
    squares = np.eye(32)[:, 3:4]
    (bound,) = oscillation_bound(mesh, squares, form=form)
    values = np.sqrt(value_constants(mesh, form)[3])
    assert bound == pytest.approx(min(values, np.sqrt(SQUARE_CONSTANT / 8 / 5.0)))
    assert (bound == values) == (form.c > 0)


def lie_in_squares(mesh, points):
    """(k, nb) whether the points (k, 2) lie inside the squares on the boundary edges."""
    tangents = mesh.polygon.tangents[mesh.side]
    lengths = np.diff(mesh.s)
    offset = points[:, None] - mesh.points[mesh.boundary]
    along = np.sum(offset * tangents, axis=2) / lengths
    into = -np.sum(offset * mesh.polygon.normals[mesh.side], axis=2) / lengths
    return (along > 1e-9) & (along < 1 - 1e-9) & (into > 1e-9) & (into < 1 - 1e-9)


def squares_fit(mesh, used):
    """Whether 100 random points of every square that is used lie in Omega and in no other such square."""
    rng = np.random.default_rng(0)
    edge = np.repeat(np.flatnonzero(used), 100)
    along, into = rng.uniform(0.01, 0.99, (2, len(edge), 1)) * np.diff(mesh.s)[edge, None]
    polygon = mesh.polygon
    side = mesh.side[edge]
    points = mesh.points[mesh.boundary[edge]] + along * polygon.tangents[side] - into * polygon.normals[side]
    return np.all(polygon.contains(points)) and np.all(lie_in_squares(mesh, points)[:, used].sum(axis=1) == 1)


@pytest.mark.parametrize("name", MESHES)
def test_the_squares_lie_inside_and_are_disjoint(name):
    mesh = MESHES[name]()
    used = has_square(mesh)
    assert squares_fit(mesh, used)
    assert 0.2 < used.mean() < 1
    assert not squares_fit(mesh, np.ones_like(used))  # control: at corners and in thin parts they do not


@pytest.mark.parametrize(
    ("n", "waves", "constant", "unit_norm"),
    [*((n, 1, SQUARE_CONSTANT, 1e-3) for n in (8, 16, 64)), (16, 0.5, MEAN_FREE_SQUARE_CONSTANT, 5e-3)],
)
def test_waves_on_edges_are_bounded_sharply(n, waves, constant, unit_norm):
    """cos(2 pi w n x) on one side of the square, w waves an edge: without linear functions, or constants.

    Its norm is (coth(q) / (2 q))^{1/2}, q^2 = 1 + (2 pi w n)^2. The squares' share is sharp, but for what the
    1 in q^2 makes. Control: for half a wave the constant that excludes linear functions is too small.
    """
    mesh = make_structured_mesh(square(), 1 / n)
    squares = np.where(mesh.side == 0, 1 / (2 * n), 0.0)[:, None]
    q = sqrt(1 + (2 * pi * waves * n) ** 2)
    used = has_square(mesh)
    true = sqrt(1 / (2 * q * tanh(q)))
    assert oscillation_bound(mesh, squares, constant)[0] >= true
    squares = squares * used[:, None]
    share = true * sqrt(used[:n].mean())
    squares_bound = oscillation_bound(mesh, squares, constant)[0]
    assert squares_bound == pytest.approx(share, rel=unit_norm)
    assert used[:n].any()
    if waves < 1:
        assert oscillation_bound(mesh, squares)[0] < 0.75 * share


@pytest.mark.parametrize("n", [1, 4, 16])
def test_squares_that_overlap_at_vertices_are_left_out(n):
    """cos(2 pi n s) on all sides of the unit square: at its vertices squares on two edges are the same.

    The function with this flux is the sum over the sides of cos(2 pi n x) cosh(q (1 - y)) / (q sinh q), with
    q^2 = 1 + (2 pi n)^2. Each meets itself, the one opposite and two beside it. The constant of squares on
    all edges gives less than the norm; for n = 1 its square would be 0.318, and that of the norm is 0.416.
    """
    mesh = make_structured_mesh(square(), 1 / n)
    squared_norms = np.full((4 * n, 1), 1 / (2 * n))
    q = sqrt(1 + (2 * pi * n) ** 2)
    true = 2 / (q * tanh(q)) + 2 / (q * sinh(q)) + 8 / (q**2 + (2 * pi * n) ** 2)
    on_all_edges = float(np.sum(SQUARE_CONSTANT / n * squared_norms))
    if n == 1:
        assert (on_all_edges, true) == (pytest.approx(0.3183, abs=5e-5), pytest.approx(0.4155, abs=5e-5))
    assert on_all_edges < true
    assert oscillation_bound(mesh, squared_norms)[0] ** 2 >= true


@pytest.mark.parametrize("name", POLYGONS)
def test_brackets_overlap_for_a_partition_that_is_not_nested_in_the_reference_mesh(name):
    """Bounds by spaces for a finer partition overlap those by spaces for its own; 5 % as for errors."""
    polygon = POLYGONS[name]
    other_shifted_partition = partitions.make_shifted_partition(polygon, 1 / 4, 0.37)
    case = Flux(polygon, 0.41, Fraction(1, 2))
    original = build_dual_norm(other_shifted_partition, (), 16)
    assert not np.isin(other_shifted_partition.points, norm_on(name, 6).spaces.mesh.s).all()
    mu = np.random.default_rng(4).standard_normal((3, other_shifted_partition.n_cells))
    fine = original.bound_p0(mu)
    coarse = norm_on(name, 6).bound_p0(mu, other_shifted_partition)
    assert brackets(coarse, fine.lower, fine.upper, gap=0.05)
    original = build_dual_norm(other_shifted_partition, [case], 16)
    fine = original.bound_error(case, mu)
    coarse = norm_on(name, 6).bound_error(case, mu, other_shifted_partition)
    assert brackets(coarse, fine.lower, fine.upper, gap=0.05)


def test_without_the_oscillation_the_upper_bound_lies_below_the_value(monkeypatch):
    """Control: a function that alternates within the reference edges, against its cosine series."""
    other_uniform_partition = partitions.make_uniform_partition(square(), 1 / 32)
    mu = np.where(np.arange(other_uniform_partition.n_cells) < 32, alternating(other_uniform_partition), 0)[
        None
    ]
    below, above = bound_p0_on_bottom(np.arange(33) / 32, mu[0, :32])
    norm = norm_on("square", 1, 4)
    bracket = norm.bound_p0(mu, other_uniform_partition)
    assert bracket.lower <= above
    assert below <= bracket.upper
    monkeypatch.setattr(functionals, "oscillation_bound", lambda _, squares: np.zeros(squares.shape[1]))
    assert norm.bound_p0(mu, other_uniform_partition).upper < 0.9 * below


def test_squares_have_room_for_the_displacement_of_nodes():
    """On edges of 1/8 beside the middles of sides: 7/16 from the next sides, where the reach is 0.28."""
    mesh = meshes.make_unstructured_mesh(square(), 1 / 8)
    middle = np.isclose(np.abs(np.mod(0.5 * (mesh.s[1:] + mesh.s[:-1]), 1) - 0.5), 1 / 16)
    for room, expected in ((0.9, True), (1.1, False)):
        doubt = room * (7 / 16 - SQUARE_REACH * 2 / 8) / 4
        lengths = 2 * doubt * SQUARE_REACH * 2 / 8 / 4  # what sides may be longer takes of it
        assert np.all(has_square(add_doubt(mesh, doubt - lengths))[middle] == expected)
    assert middle.sum() == 8


def test_no_corner_of_a_square_is_beyond_its_reach():
    """From the midpoint of the edge, (0, 0) to (1, 0), to the farthest corners of the square on it."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    assert max(np.hypot(*(corners - [0.5, 0]).T)) <= SQUARE_REACH
