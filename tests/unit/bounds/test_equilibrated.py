"""Fluxes on vertex patches: what they are equal to, that they are nearest, and how little they cost."""

import numpy as np
import pytest

from unilateral.bounds import equilibrated_flux as module
from unilateral.bounds.equilibrated_flux import equilibrate_flux, triangle_inflows
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import gradients, load_vector, stiffness_and_mass
from unilateral.fem.p2 import linear_square_norms
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.geometry.structured import make_structured_mesh

MESHES = {
    "structured": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 4),
    "gmsh": lambda: meshes.make_unstructured_mesh(find_polygon("square"), 1 / 5),
    "graded": lambda: meshes.triangulate_from_boundary(
        find_polygon("square"), np.append(np.geomspace(0.05, 1, 6) - 0.05, [1, 2, 3])
    ),
    "refined": lambda: meshes.refine_uniformly(
        meshes.make_unstructured_mesh(find_polygon("lshape"), 1 / 2), 2
    ),
    "two triangles": lambda: meshes.from_arrays(
        find_polygon("square"), [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]]
    ),
}


def turn_right(v):
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


def compute_inflows(mesh, q):
    """(2, 3, m) what flows in through the edge from node i to the next, at these nodes."""
    return np.array(triangle_inflows(mesh, q, slice(None)))[:, [2, 0, 1]]


def flux_values(mesh, flux):
    """(m, 3, 2) q at the triangles' nodes, from its fluxes (2, 3, m) by the two edges at each."""
    slopes = gradients(mesh)
    (first, second) = flux.transpose(0, 2, 1)
    through_next = turn_right(np.roll(slopes, -1, axis=1))
    through_before = turn_right(np.roll(slopes, -2, axis=1))
    return through_next * first[..., None] - through_before * np.roll(second, 1, axis=1)[..., None]


def make_balanced_data(mesh, rng, form=H1):
    """Random u_h, moments of f and sigma, with (u_h, psi) = (f, psi)_0 + <sigma, psi> for all hats psi."""
    u_h = rng.standard_normal(mesh.n_nodes)
    sigma = rng.uniform(size=(len(mesh.boundary), 2))
    moments = rng.standard_normal((len(mesh.triangles), 3)) * mesh.areas[:, None]
    stiffness, mass = stiffness_and_mass(mesh)
    missing = (form.k * stiffness + form.c * mass) @ u_h - load_vector(mesh, moments)
    lengths = np.diff(mesh.s)
    for position, (near, far) in ((mesh.boundary, sigma.T), (np.roll(mesh.boundary, -1), sigma.T[::-1])):
        missing[position] -= lengths * (near / 3 + far / 6)
    valence = np.bincount(mesh.triangles.ravel())
    return u_h, moments + (missing / valence)[mesh.triangles], sigma


FORMS = [Form(1.0, 0.0), Form(3.0, 1e-12), Form(0.2, 5.0)]


@pytest.fixture
def equilibrated_only(monkeypatch):
    """w = 1, whatever c."""
    monkeypatch.setattr(module, "PATCH_REACTION_RATIO", 1e150)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.usefixtures("equilibrated_only")
def test_the_divergence_and_the_flux_through_the_boundary_are_the_given_ones(name, form):
    """Up to rounding; and q is in H(div), for what leaves a triangle enters the next."""
    mesh = MESHES[name]()
    u_h, moments, sigma = make_balanced_data(mesh, np.random.default_rng(0), form)
    flux = compute_inflows(mesh, equilibrate_flux(mesh, u_h, moments.__getitem__, sigma, form))
    expected = form.c * mesh.areas * u_h[mesh.triangles].mean(axis=1) - moments.sum(axis=1)
    assert -0.5 * flux.sum(axis=(0, 1)) == pytest.approx(expected, abs=1e-13 * np.abs(flux).max())
    edges = mesh.opposite_edges[:, [2, 0, 1]]
    through = np.zeros((2, len(mesh.triangulation.ends)))
    for i in range(3):
        first = mesh.triangulation.ends[edges[:, i], 0] == mesh.triangles[:, i]
        for k in range(2):
            np.add.at(through, (np.where(first, k, 1 - k), edges[:, i]), flux[k, i])
    boundary = mesh.triangulation.boundary_edges
    assert np.all(np.delete(through, boundary, axis=1) == 0)
    rounding = 2 * np.finfo(float).eps * np.diff(mesh.s) * sigma.max(axis=1)
    assert np.all(np.abs(through[:, boundary] + np.diff(mesh.s) * sigma.T) <= rounding)


@pytest.mark.parametrize("form", [*FORMS, Form(2.0, 1e6)])
@pytest.mark.parametrize("name", MESHES)
def test_the_gradient_of_a_linear_function_is_its_own_flux(name, form):
    """Of q_1 and of q_0 alike, so for all weights."""
    mesh = MESHES[name]()
    slope = np.array([0.3, -1.1])
    u = 0.7 + mesh.points @ slope
    nodal = u[mesh.triangles]
    moments = form.c * mesh.areas[:, None] / 12 * (nodal + nodal.sum(axis=1, keepdims=True))
    sigma = form.k * np.repeat(mesh.polygon.normals[mesh.side] @ slope, 2).reshape(-1, 2)
    q = flux_values(mesh, compute_inflows(mesh, equilibrate_flux(mesh, u, moments.__getitem__, sigma, form)))
    assert q == pytest.approx(np.broadcast_to(form.k * slope, q.shape), abs=1e-15 * max(form[:2]) + 1e-11)


@pytest.mark.parametrize("clamped", [False, True])
@pytest.mark.parametrize("name", MESHES)
def test_where_c_is_large_the_flux_is_the_mean_of_both_sides(name, clamped):
    """q_0.n is the mean of k grad u_h.n, constant on each edge. On clamped ones there is one side."""
    mesh = MESHES[name]()
    form = Form(2.0, 1e30)
    u_h, moments, sigma = make_balanced_data(mesh, np.random.default_rng(3), form)
    sigma = np.full_like(sigma, np.nan) if clamped else sigma
    slopes = form.k * np.einsum("tid,ti->td", gradients(mesh), u_h[mesh.triangles])
    edges = mesh.triangulation.ends
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    sides = mesh.triangulation.edge_triangles
    through = [np.sum(turn_right(along) * slopes[sides[:, i]], axis=1) for i in (0, 1)]
    expected = np.where(sides[:, 1] < 0, through[0], 0.5 * (through[0] + through[1]))
    flow, tilt = equilibrate_flux(mesh, u_h, moments.__getitem__, sigma, form)
    on_sides = mesh.triangulation.boundary_edges
    free = np.ones(len(edges), dtype=bool)
    free[on_sides] = clamped
    size = np.abs(expected).max()
    assert flow[free] == pytest.approx(expected[free], abs=1e-12 * size)
    assert tilt[free] == pytest.approx(0, abs=1e-12 * size)
    if not clamped:
        pair = np.stack([flow + tilt, flow - tilt])[:, on_sides]
        assert pair == pytest.approx(-np.diff(mesh.s) * sigma.T)


def wheel():
    """Five irregular triangles around one node, the first one of each, for it is off their longest edge."""
    outer = np.array([[1, 0], [0.33, 0.96], [-0.8, 0.6], [-0.82, -0.58], [0.3, -0.97]])
    triangles = [[5, i, (i + 1) % 5] for i in range(5)]
    return meshes.from_arrays(Polygon(outer, "wheel"), np.vstack([outer, [0.05, -0.02]]), triangles)


def numbers_of_the_hub(mesh, u_h, moments, form):
    """The numbers of the patch of the wheel's inner node, and its triangles."""
    corners = np.arange(3 * len(mesh.triangles)).reshape(-1, 3)
    (after, corner) = module.order_spokes(mesh, corners.__getitem__)
    (_, f) = module.order_spokes(mesh, moments.__getitem__)
    spokes = next(fan for edge, fan in module.gather_patches(mesh, after) if not edge.size)
    ends = mesh.triangulation.ends
    triangle = corner[spokes[:-1, 0]].astype(int) // 3
    assert np.array_equal(triangle, (triangle[0] + np.arange(5)) % 5)
    assert np.array_equal(ends.ravel()[spokes ^ 1][:-1, 0], triangle)
    hub = np.array([5])
    rim = ends.ravel()[spokes ^ 1]
    return module._assemble_patches(mesh, u_h, hub, rim, f[spokes[:-1]], form), triangle


@pytest.mark.parametrize("ratio", [1e-3, 2.0, 1e3])
def test_on_a_patch_the_flux_is_a_mean_with_the_weight_of_its_area(ratio):
    """w = 1/4 where c |a| = 2 BALANCE k, for the patch of a node inside, which is the whole mesh."""
    mesh = wheel()
    form = Form(3.0, ratio * module.PATCH_REACTION_RATIO * 3.0 / mesh.areas.sum())
    u_h, moments, _ = make_balanced_data(mesh, np.random.default_rng(0), form)
    numbers, _ = numbers_of_the_hub(mesh, u_h, moments, form)
    w = min(1.0, 1 / ratio) ** 2
    assert numbers.weight == pytest.approx(w)
    first = module._solve_inner_patches(numbers._replace(weight=np.array([1.0])))
    last = module._solve_inner_patches(numbers._replace(weight=np.array([0.0])))
    assert module._solve_inner_patches(numbers) == pytest.approx(w * first + (1 - w) * last)
    assert not np.allclose(first, last)


@pytest.mark.usefixtures("equilibrated_only")
def test_no_other_flux_of_a_patch_is_nearer():
    """The squared distance of q_a from psi_a grad u_h has no derivative by any z_j or F_0, and grows.

    It is integrated from q_a at the nodes. Control: so it is not when one z_j is moved.
    """
    mesh = wheel()
    rng = np.random.default_rng(1)
    u_h, moments, _ = make_balanced_data(mesh, rng)
    numbers, triangle = numbers_of_the_hub(mesh, u_h, moments, H1)
    slope = np.einsum("tid,ti->td", gradients(mesh), u_h[mesh.triangles])

    def squared_distance(spokes):
        flux = np.zeros((2, 3, 5))
        after = np.roll(spokes, -1, axis=1)
        flux[:, 0, triangle] = spokes[..., 0]
        flux[:, 2, triangle] = -after[::-1, :, 0]
        away = flux_values(mesh, flux)
        away[:, 0] -= slope
        return linear_square_norms(mesh.areas, away).sum()

    F, z = module._solve_inner_patches(numbers)
    best = np.stack([F + z, F - z])
    moves = [np.ones((2, 5, 1))]
    for j in range(5):
        move = np.zeros((2, 5, 1))
        move[:, j] = [[1], [-1]]
        moves.append(move)
    for move in moves:
        extra_squared_distance = squared_distance(best + 1 * move)
        smaller = squared_distance(best + (-1) * move)
        min_squared_distance = squared_distance(best + 0 * move)
        assert extra_squared_distance == pytest.approx(smaller, rel=1e-12)
        assert extra_squared_distance > min_squared_distance
    extra_squared_distance = squared_distance(best + 0.01 * moves[1] + 1 * moves[1])
    smaller = squared_distance(best + 0.01 * moves[1] + (-1) * moves[1])
    assert extra_squared_distance != pytest.approx(smaller, rel=1e-4)


def test_patches_are_taken_together(monkeypatch):
    """As many eliminations as there are numbers of triangles around a node, however many nodes."""
    counts = []
    for n in (8, 32):
        calls = []
        mesh = make_structured_mesh(find_polygon("square"), 1 / n)
        original = module._solve_inner_patches
        with monkeypatch.context() as patch:
            patch.setattr(
                module,
                "_solve_inner_patches",
                lambda patches, original_value=original, calls=calls: (
                    calls.append(1) or original_value(patches)
                ),
            )
            u_h, moments, sigma = make_balanced_data(mesh, np.random.default_rng(2))
            equilibrate_flux(mesh, u_h, moments.__getitem__, sigma)
        counts.append(len(calls))
    assert counts[0] == counts[1] <= 3
