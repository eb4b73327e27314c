"""The interval of a force: w, the best one, extreme sizes; and the small mesh that w is made on."""

import math
from dataclasses import replace
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import scipy.optimize
from hand_made import exact_forces

import unilateral as ul
from unilateral.bounds import force_mesh
from unilateral.bounds import forces as of_forces
from unilateral.bounds.clamped_ends import ClampedEnds, ReactionData, no_reactions
from unilateral.bounds.force_mesh import (
    MAX_BOUNDARY_NODES,
    MAX_LIGHT_LOAD,
    extend_with_least_norm,
    grade_force_mesh,
)
from unilateral.bounds.forces import bound_forces, enclose_total_force
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.source import Source, enclose_source
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import coupling, stiffness_and_mass
from unilateral.formulas.taylor import number_model
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.obstacle_and_flux import enclose_given_flux
from unilateral.solvers import least_norm

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
KITE = np.array([[0, 0], [1, 0], [1, 0.7], [0, 1.3]])


@pytest.fixture
def traces(monkeypatch):
    """The meshes of w, and its values at the boundary nodes: of -w below the force, then of w above."""
    meshes_and_traces = []

    def record_extension(space, v):
        meshes_and_traces.append((space.mesh, v))
        return extend_with_least_norm(space, v)

    monkeypatch.setattr(of_forces, "extend_with_least_norm", record_extension)
    return meshes_and_traces


@pytest.mark.parametrize("steps", [1, 2, least_norm.MAX_SET_UPDATES])
@pytest.mark.parametrize("kind", ["square", "lshape"])
def test_w_is_above_and_below_the_indicator_of_a_side(kind, steps, traces, monkeypatch):
    """At the middles of edges, too, and wherever the iteration ends."""
    monkeypatch.setattr(least_norm, "MAX_SET_UPDATES", steps)
    polygon = find_polygon(kind)
    mesh = make_structured_mesh(polygon, 1 / 8)
    cells = partitions.make_uniform_partition(polygon, 1 / 4)
    rng = np.random.default_rng(1)
    for side in range(polygon.n_sides):
        lambda_H = rng.random(cells.n_cells) * (rng.random(cells.n_cells) < 0.5)
        lambda_H[cells.side == side] = 1.0
        bound_forces(mesh, cells, lambda_H, 0.02, [[side]])
        (trace, minus), (_, over) = traces[-2:]
        assert over.shape == minus.shape == (len(trace.boundary), 1)
        for share in (0.0, 0.5, 1.0):
            above = (1 - share) * over[:, 0] + share * np.roll(over[:, 0], -1)
            below = (1 - share) * (-minus[:, 0]) + share * np.roll(-minus[:, 0], -1)
            assert np.all(above >= (trace.side == side))
            assert np.all(below <= (trace.side == side))


def test_an_interval_misses_the_force_where_w_is_too_small(monkeypatch):
    """The control: w is not held at the ends of a side, so it is below 1 on the edges there."""
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    lambda_H = np.ones(cells.n_cells)
    assert bound_forces(mesh, cells, lambda_H, 1e-3, [[0]])[0].upper >= 1
    limits = of_forces._nodal_lower_bounds
    monkeypatch.setattr(
        of_forces,
        "_nodal_lower_bounds",
        lambda *arguments: tuple(np.minimum(c, 0) for c in limits(*arguments)),
    )
    assert bound_forces(mesh, cells, lambda_H, 1e-3, [[0]])[0].upper < 1


def refuse(*_):
    raise InputError("no")


def test_the_interval_is_the_best_on_its_mesh(traces):
    """By SLSQP, which knows nothing of active sets, and with S made by dense algebra."""
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    lambda_H = np.where(cells.side < 2, 1.0, 0.0)
    E = 0.3
    force = bound_forces(mesh, cells, lambda_H, E, [[0]])[0]
    trace = traces[-1][0]
    A = sum(stiffness_and_mass(trace)).toarray()
    b = trace.boundary
    inside = np.setdiff1d(np.arange(trace.n_nodes), b)
    across = A[np.ix_(inside, b)]
    S = A[np.ix_(b, b)] - across.T @ np.linalg.solve(A[np.ix_(inside, inside)], across)
    pairing = coupling(trace, cells).T @ lambda_H
    on_side = (trace.side == 0) | np.roll(trace.side == 0, 1)
    off_side = (trace.side != 0) | np.roll(trace.side != 0, 1)
    for c, start, end in (
        (1.0 * on_side, np.ones(len(b)), force.upper),
        (np.where(off_side, 0.0, -1.0), -1.0 * ~off_side, -force.lower),
    ):
        minimum = scipy.optimize.minimize(
            lambda v: pairing @ v + E * np.sqrt(v @ S @ v),
            start,
            jac=lambda v: pairing + E * S @ v / np.sqrt(v @ S @ v),
            bounds=[(low, None) for low in c],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        assert minimum.success
        assert end == pytest.approx(minimum.fun, rel=1e-6)


def test_the_extension_has_the_least_norm():
    """Against a dense solve for the interior."""
    mesh = make_structured_mesh(square(), 1 / 16)
    trace = (mesh.side == 0).astype(float)
    A = sum(stiffness_and_mass(mesh)).toarray()
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    w = np.zeros(mesh.n_nodes)
    w[mesh.boundary] = trace
    w[inside] = np.linalg.solve(A[np.ix_(inside, inside)], -(A @ w)[inside])
    extension = extend_with_least_norm(condense(mesh), trace[:, None])[:, 0]
    assert np.array_equal(extension[mesh.boundary], trace)
    assert extension == pytest.approx(w, abs=1e-12)


@pytest.mark.parametrize("a", [1e-9, 1e-5])
def test_the_norm_of_nearly_a_constant_is_not_lost_in_rounding(a):
    """In a square of side a, for w = 1 on the boundary, the least ||w||_1 is a, up to the order a^2 of that.

    By w . A w, in which the gradients of a constant cancel, it was 3e-3 off.
    """
    polygon = Polygon(a * SQUARE, "small")
    mesh = meshes.make_unstructured_mesh(polygon, a / 64)
    cells = partitions.make_uniform_partition(polygon, a / 32)
    full, side = bound_forces(mesh, cells, np.ones(cells.n_cells), 1.0, [range(4), [0]])
    assert full.upper - full.value == pytest.approx(a, rel=1e-8)
    assert 0 <= side.value <= side.upper <= full.upper


@pytest.mark.parametrize("length", [1e-70, 1e-20, 1e-7, 1e7, 1e70])
def test_polygons_of_all_sizes_have_a_force(length):
    """Nothing overflows, and the interval of a side is not that of a constant w."""
    polygon = Polygon(length * SQUARE, "scaled")
    mesh = meshes.make_unstructured_mesh(polygon, length / 8)
    cells = partitions.make_uniform_partition(polygon, length / 4)
    full, side = bound_forces(mesh, cells, np.ones(cells.n_cells), 1e-3 * min(length, 1.0), [range(4), [0]])
    assert 0.9 * full.value < full.lower <= full.value <= full.upper < 1.1 * full.value
    assert side.value == pytest.approx(length)
    assert 0 < side.lower <= side.value <= side.upper < 3 * length


@pytest.mark.parametrize("k", [1e-50, 1.0, 1e12, 1e50])
@pytest.mark.parametrize("size", [1e-4, 1 / 2, 8])
def test_a_force_is_that_of_another_unit_of_length_and_of_k(k, size):
    """With x in units of `size` and c size^2 / k as before, N is k^(1/2) times as large, forces size times.

    Control: with the c of size 1 the interval is another one.
    """
    computed = []
    for length, form in ((1.0, Form()), (size, Form(k, k / size**2)), (size, Form(k, k / size))):
        polygon = Polygon(length * SQUARE, "square")
        mesh = make_structured_mesh(polygon, length / 8)
        cells = partitions.make_uniform_partition(polygon, length / 4)
        bound = 0.1 * length / form.k**0.5
        clamps = no_reactions(4)._replace(form=form)
        computed.append(bound_forces(mesh, cells, 1.0 * (cells.side < 2), bound, [range(4), [0]], clamps))
    for first, same, second in zip(*computed, strict=True):
        assert size * np.array(first) == pytest.approx(np.array(same), rel=1e-9)
        assert size * np.array(first) != pytest.approx(np.array(second), rel=1e-3)


@pytest.mark.parametrize("bound", [0.0, 1e-300, 1e-20, 1e20, 1e150])
def test_intervals_hold_the_value_for_errors_of_all_sizes(bound):
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    for lambda_H in (np.zeros(cells.n_cells), np.where(cells.side < 2, 1.0, 0.0)):
        for force in bound_forces(mesh, cells, lambda_H, bound, [range(4), [0], [2]]):
            assert 0 <= force.lower <= force.value <= force.upper < math.inf
            if bound < 1e-10:
                assert force.upper - force.lower <= 1e-8 * lambda_H.sum() + 2 * bound


def test_without_a_small_mesh_w_is_a_constant(monkeypatch):
    """1 or 0, with the root of the area, 1, as its norm."""
    monkeypatch.setattr(force_mesh, "condense", refuse)
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    full, side = bound_forces(mesh, cells, np.ones(cells.n_cells), 0.1, [range(4), [0]])
    assert full == pytest.approx((4, 3.9, 4.1), rel=1e-8)
    assert side == pytest.approx((1, 0, 4.1), rel=1e-8)


def test_a_free_side_has_no_force_and_hinders_no_other():
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    lambda_H = np.where(cells.side == 0, 1.0, 0.0)
    clamped_forces = bound_forces(mesh, cells, lambda_H, 0.1, [[0], [1]])
    freed = bound_forces(
        mesh, cells, lambda_H, 0.1, [[0], [1]], no_reactions(4)._replace(form=Form(free=(1, 3)))
    )
    assert freed[1] == (0, 0, 0)
    assert freed[0].lower > clamped_forces[0].lower


def test_without_a_bound_of_lambda_there_is_none_of_the_force():
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    force = bound_forces(mesh, cells, np.ones(cells.n_cells), math.inf, [[0]])[0]
    assert force == (1, 0, math.inf)


def test_forces_of_a_solution_enclose_the_exact_ones():
    s = ul.solve(ul.case("natural"), h=1 / 16, H=1 / 8)
    local = s.forces()
    sharp = s.forces(sharp=True)
    exact = exact_forces(s.problem.exact, s.partition)[0]
    assert local.whole.lower < sharp.whole.lower <= exact <= sharp.whole.upper < local.whole.upper
    assert len(local.sides) == 4
    assert local.whole.value == pytest.approx(sum(side.value for side in local.sides))
    sampled = ul.Problem(square(), f=lambda x, y: -np.ones_like(x), g="-1")
    full = ul.solve(sampled, h=1 / 8, H=1 / 4).forces().whole
    assert full.lower <= 0 <= full.upper < 1e-6  # u = -1 without any force


@pytest.mark.parametrize("kind", ["structured", "unstructured"])
def test_the_force_mesh_does_not_grow_with_the_mesh_of_the_solution(kind, monkeypatch):
    """If that is refined, or too large to begin with."""
    polygon = find_polygon("lshape") if kind == "structured" else Polygon(KITE, "kite")
    cells = partitions.make_uniform_partition(polygon, 1 / 4)
    sizes = []
    load = np.where(cells.side < 2, 1e3, 0.0)
    for h in (1 / 16, 1 / 64, 1 / 128):
        mesh = (
            make_structured_mesh(polygon, h)
            if kind == "structured"
            else meshes.make_unstructured_mesh(polygon, h)
        )
        sizes.append(grade_force_mesh(mesh, cells, load, 1.0).n_nodes)
    assert max(sizes) < 2000
    assert sizes[1] == sizes[2]


def test_the_force_mesh_of_a_refined_mesh_needs_no_gmsh(monkeypatch):
    mesh = meshes.refine_uniformly(meshes.make_unstructured_mesh(Polygon(KITE, "kite"), 1 / 4))
    cells = partitions.make_uniform_partition(mesh.polygon, 1 / 4)
    monkeypatch.setattr(meshes, "triangulate_from_boundary", None)
    force_mesh = grade_force_mesh(mesh, cells, np.ones(cells.n_cells), 1.0)
    n = mesh.coarse.n_nodes
    assert np.array_equal(force_mesh.points[:n], mesh.coarse.points)


def test_the_force_mesh_is_halved_at_ends_until_loads_are_light():
    """A load of 100 on the lower side up to 3/4: there, at the vertex where it begins, and nowhere else."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    load = np.where((cells.side == 0) & (cells.points[:-1] < 0.75), 100.0, 0.0)
    force_mesh = grade_force_mesh(make_structured_mesh(square(), 1 / 8), cells, load, 1.0)
    nodes = coupling(force_mesh, cells).T @ load
    edges = np.diff(force_mesh.s)
    indexes = [np.flatnonzero(force_mesh.s[:-1] == s)[0] for s in (0.0, 0.75)]
    assert np.all(nodes[indexes] <= MAX_LIGHT_LOAD)
    assert min(edges[indexes]) <= 2 * MAX_LIGHT_LOAD / 100
    uniform = edges[force_mesh.side == 2]
    assert np.all(uniform == uniform[0])
    assert uniform[0] > 1 / 32


def test_a_light_load_or_none_leaves_the_force_mesh_uniform():
    """By counting: with the edges of h = 1/8 halved once there are 17^2 nodes."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    for load in (0.0, 0.1):
        force_mesh = grade_force_mesh(
            make_structured_mesh(square(), 1 / 8), cells, np.full(cells.n_cells, load), 1.0
        )
        assert force_mesh.n_nodes == 17**2


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_edges_at_the_boundary_of_a_polygon_are_halved_to_the_depth_of_functions(size):
    """Not so those inside."""
    polygon = Polygon(30 * size * KITE, "large")
    mesh = meshes.make_unstructured_mesh(polygon, 10 * size)
    cells = partitions.make_uniform_partition(polygon, 10 * size)
    force_mesh = grade_force_mesh(mesh, cells, np.zeros(14), size)
    assert force_mesh.h <= size
    assert force_mesh.diameter > 2 * size


@pytest.mark.parametrize("n", [4, 100])
def test_many_ends_of_contact_leave_the_force_mesh_small(n):
    """Load on every second one of 4 n cells, and far too much of it."""
    cells = partitions.make_uniform_partition(square(), 1 / n)
    load = np.where(np.arange(cells.n_cells) % 2, 1e9, 0.0)
    force_mesh = grade_force_mesh(make_structured_mesh(square(), 1 / 8), cells, load, 1.0)
    assert len(force_mesh.boundary) <= MAX_BOUNDARY_NODES


def test_many_sides_leave_the_force_mesh_small():
    angle = 2 * np.pi * np.arange(400) / 400
    polygon = Polygon(np.column_stack([np.cos(angle), np.sin(angle)]), "many")
    cells = partitions.make_uniform_partition(polygon, 1.0)
    mesh = meshes.triangulate_from_boundary(polygon, partitions.divide_cells(cells, 2).points[:-1], 0.2)
    assert mesh.n_nodes > force_mesh.MAX_FIRST_NODES
    graded_mesh = grade_force_mesh(mesh, cells, np.full(400, 1e9), 1.0)
    assert len(graded_mesh.boundary) <= MAX_BOUNDARY_NODES
    assert graded_mesh.n_nodes < mesh.n_nodes


@pytest.mark.parametrize("place", [1e6, 1e9, 2.0**30])
def test_the_force_mesh_is_not_halved_where_rounding_shows(place):
    """Far from the origin, on slanted sides, and on such between dyadic places, whose nodes are exact."""
    polygon = Polygon((KITE if place != 2.0**30 else np.round(KITE)) + place, "far")
    cells = partitions.make_uniform_partition(polygon, 1 / 2)
    condensed, space = force_mesh.condense_force_mesh(
        meshes.make_unstructured_mesh(polygon, 1 / 4),
        cells,
        np.full(cells.n_cells, 1e6),
        no_reactions(polygon.n_sides),
    )
    assert space is not None
    assert condensed.exact_mesh_factor < 1 + 1e-4


E = math.e
BALANCED = [
    ({"f": "-exp(x)"}, E - 1),
    ({"f": "-pos(x - 3/10, 1)*exp(y)", "q": ["-exp(x)", None, None, None]}, 0.7**2 / 2 * (E - 1) + E - 1),
    ({"f": "pos(x - 1/3, 0) - 2", "q": [None, None, "-x*pos(x - 1/3, 0)", None]}, 2 - 2 / 3 + 4 / 9),
    ({"f": "1e6*(2*x - 1) - 1", "k": "1/3"}, 1.0),
]


@pytest.mark.parametrize("clamped", [(3,), (1, 3)])
@pytest.mark.parametrize(("data", "exact"), BALANCED)
def test_without_a_reaction_the_sum_of_all_forces_is_known(data, exact, clamped):
    """-int f - int q, in closed form. Control: that of a reaction is 100 times as wide."""
    free = [side for side in (0, 2) if side not in clamped]
    g = [-0.01 if side not in (*free, *clamped) else None for side in range(4)]
    problem = ul.Problem(square(), g=g, free_sides=free, u=dict.fromkeys(clamped, 0), c=0, **data)
    s = ul.solve(problem, h=1 / 4, H=1 / 2)
    forces = s.forces()
    sides = [side for side in range(4) if side not in free]
    assert forces.total == s.force(sides=sides)
    assert forces.total.lower <= forces.total.value <= forces.total.upper
    assert forces.total.lower <= exact <= forces.total.upper
    assert abs(forces.total.value - exact) <= 0.51 * (forces.total.upper - forces.total.lower)
    assert forces.total.upper - forces.total.lower < 1e-2 * (
        forces.reactions[3,].upper - forces.reactions[3,].lower
    )
    assert "sum of forces and reactions: " in repr(forces)


def test_the_only_reaction_is_known_where_no_side_has_contact():
    """The integral of x + 1 over the square is 3/2. Control: with two clamped sides, neither is known so."""
    reaction = ul.solve(
        ul.Problem(square(), "-x - 1", None, [0, 1, 2], u=dict.fromkeys([3], 0), c=0), h=1 / 4, H=1 / 2
    ).forces()
    other_forces = ul.solve(
        ul.Problem(square(), "-x - 1", None, [0, 2], u=dict.fromkeys([1, 3], 0), c=0), h=1 / 4, H=1 / 2
    ).forces()
    assert reaction.reactions[3,] == reaction.total
    assert reaction.total.value == pytest.approx(1.5, rel=1e-12)
    assert reaction.total.upper - reaction.total.lower < 1e-8
    assert all(force.upper - force.lower > 1e-2 for force in other_forces.reactions.values())


def test_with_a_reaction_the_sum_is_not_known():
    """Control: without one it is, of a function, too."""
    for f, c in ((-1, 1), (lambda x, y: 0 * x - 1, 0)):
        problem = ul.Problem(square(), f, [None, -1, None, None], [0, 2], u={3: 0}, c=c)
        total = ul.solve(problem, h=1 / 4, H=1 / 2).forces().total
        assert total is None if c else total.lower <= 1 <= total.upper < 1 + 1e-6


def test_all_that_is_not_known_of_f_and_q_is_in_the_balance():
    """By hand on two triangles of the unit square, f = -1 up to a norm of 3 on each, q = 2 up to 1/10."""
    mesh = make_structured_mesh(square(), 1)
    source = Source(mesh, np.full((2, 3), -1.0), np.ones(2), np.ones(2), np.zeros(2))
    flux = enclose_given_flux(square(), lambda _, t: number_model(t, 2.0), (1,))
    none = enclose_given_flux(square(), lambda _, t: t, ())
    for enclosed, width in ((source, 0), (replace(source, remainder=np.full(2, 3.0)), 6 * math.sqrt(1 / 2))):
        lower, upper = enclose_total_force(enclosed, none)
        assert 0.5 * (lower + upper) == pytest.approx(1)
        assert width + 1e-16 < upper - 1 < width + 1e-8
    unknown = replace(source, f_h=np.zeros((2, 3)), remainder=np.full(2, 3.0))  # areas are rounded, too
    assert (
        6 * math.sqrt(1 / 2) * (1 + 1e-12)
        < enclose_total_force(unknown, none)[1]
        < 6 * math.sqrt(1 / 2) * (1 + 1e-8)
    )
    far = replace(source, f_h=np.array([[1e9, 1e9, 1e9], [-1e9, -1e9, -1e9]]))
    assert enclose_total_force(far, none)[1] > 1e9 * np.finfo(float).eps
    exact = enclose_total_force(source, flux)
    assert exact[0] <= -1 <= exact[1] <= -1 + 1e-8
    doubtful = replace(flux, remainder=np.full_like(flux.remainder, 0.1))
    assert enclose_total_force(source, doubtful)[1] == pytest.approx(-1 + 0.4)
    jumping = replace(flux, jumps=np.full_like(flux.jumps, 1.0), reach=0.01)
    assert enclose_total_force(source, jumping)[1] >= -1 + 0.02 * len(flux.jumps)


def test_the_rounding_of_a_force_is_that_of_its_own_side():
    """1 on side 2 beside 1e12 on side 0, lambda_H being exact. In all it is rounded by more than 1.

    w passes from 1 to 0 on the first and last edge of a side.
    """
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    lambda_H = np.where(cells.side == 0, 1e12, np.where(cells.side == 2, 1.0, 0.0))
    side_2, full = bound_forces(mesh, cells, lambda_H, 0.0, [[2], [0, 1, 2, 3]])
    assert 0.9 < side_2.lower < 1 <= side_2.upper < 1.1
    assert full.lower < 1e12 < full.upper
    assert full.upper - full.lower > 1


# Beside clamped sides, and each term for rounding

ON_SQUARE = make_structured_mesh(square(), 1 / 8), partitions.make_uniform_partition(square(), 1 / 4)
LITTLE = 1e-30
"""A bound on the error of lambda_H beside which all else is large."""


def clamped_at(*sides, constant=1.0, flows=(0.0, 0.0), reach=0.0, gamma=1.0, product=0.0, bound=LITTLE):
    """`ReactionData` of the unit square: flow and its magnitude through side 3, a gap at vertex 0."""
    at_vertex_0 = np.arange(4) == 0
    through_3 = np.arange(4) == 3
    ends = ClampedEnds(np.where(at_vertex_0, reach, 0.0), np.where(at_vertex_0, gamma, 1.0), product)
    return ReactionData(
        Form(c=0.0, clamped=sides, friedrichs=constant), np.outer(flows, through_3), ends, bound
    )


def test_a_function_counts_in_L2_by_friedrichs_constant():
    """1 on the square, whose gradient vanishes, has the norm 1/C. No smaller one has 1 on all sides."""
    clamps = clamped_at(0, 1, 2, 3, constant=100.0, bound=0.5)
    (force,) = bound_forces(*ON_SQUARE, np.zeros(16), 7.0, [range(4)], clamps)
    assert force.value == 0
    assert force.upper == pytest.approx(0.5 / 100, rel=1e-3)
    assert force.lower == pytest.approx(-0.5 / 100, rel=1e-3)


def test_reactions_have_a_bound_of_their_own_and_forces_that_of_lambda():
    """Widths are proportional to the bound; a force is not negative, a reaction may be."""
    lambda_H = np.where(ON_SQUARE[1].side == 1, 1.0, 0.0)
    wide = bound_forces(*ON_SQUARE, lambda_H, 0.2, [[1], [3]], clamped_at(3, bound=LITTLE))
    narrow = bound_forces(*ON_SQUARE, lambda_H, LITTLE, [[1], [3]], clamped_at(3, bound=0.2))
    assert wide[0].upper > 1.1
    assert narrow[0].upper == pytest.approx(1.0)
    expected = [clamped_at(3, bound=fluxes) for fluxes in (0.2, LITTLE)]
    forces = [bound_forces(*ON_SQUARE, lambda_H, 7.0, [[2, 3, 0]], clamps)[0] for clamps in expected]
    assert forces[0].lower < -0.05
    assert forces[1].lower == pytest.approx(0.0, abs=1e-6)


def test_what_flows_through_a_side_is_its_reaction_up_to_the_rounding_of_its_terms():
    """With free sides beside it nothing else counts."""
    clamps = clamped_at(3, flows=(5.0, 1e12))
    clamps = clamps._replace(form=clamps.form._replace(free=(0, 2)))
    (force,) = bound_forces(*ON_SQUARE, np.zeros(16), LITTLE, [[3]], clamps)
    assert force.value == 5.0
    assert 5 - force.lower == pytest.approx(1e12 * SQUARES_ROUNDING, rel=1e-5)
    assert force.upper - 5 == pytest.approx(1e12 * SQUARES_ROUNDING, rel=1e-5)


def test_what_flows_through_a_side_is_longer_by_its_stretch(monkeypatch):
    """By hand: the stretch of 1e-4 times the integral 8 of the flux's magnitude."""
    clamps = clamped_at(3, flows=(5.0, 8.0))
    clamps = clamps._replace(form=clamps.form._replace(free=(0, 2)))
    monkeypatch.setattr(Polygon, "stretch", property(lambda self: np.array([0, 0, 0, 1e-4])))
    (force,) = bound_forces(*ON_SQUARE, np.zeros(16), LITTLE, [[3]], clamps)
    assert force.upper - 5 == pytest.approx(8e-4, rel=1e-4)


def test_forces_and_reactions_lack_the_product_over_the_gap_beside_each_other():
    """Of side 0 the bound above lacks 6 / 3, of sides 2 and 3 that below; without a gap both are infinite."""
    for reach, lacking in ((0.5, 2.0), (0.0, math.inf)):
        clamps = clamped_at(3, reach=reach, gamma=3.0, product=6.0)
        force, row = bound_forces(*ON_SQUARE, np.zeros(16), LITTLE, [[0], [2, 3]], clamps)
        assert (force.lower, force.upper) == pytest.approx((0.0, lacking), abs=1e-6)
        assert (row.lower, row.upper) == pytest.approx((-lacking, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("component", "above", "below"),
    [
        ([3], [1, 0, 0, 0, 0, 0, 1, 1], [-1, -1, 0, 0, 0, 0, -1, -1]),
        ([0], [0, 0, 1, 0, 0, 0, 0, 0], [0, -1, 0, 0, 0, 0, 0, 0]),
        ([1], [0, 0, 1, 1, 1, 0, 0, 0], [0, 0, 0, -1, 0, 0, 0, 0]),
    ],
)
def test_nodal_lower_bounds_of_w_are_those_by_hand(component, above, below):
    """Side 3 is clamped, the gap on side 0 is known: at node 1 w may be lower than it should by 1.

    Nodes 6, 7 and 0 lie on side 3, where w is 1 or 0 and -w is -1 or 0; node 1 is inside side 0.
    """
    clamps = clamped_at(3, reach=1.0)
    lower_bounds = of_forces._nodal_lower_bounds(
        make_structured_mesh(square(), 1 / 2), np.array(component), clamps
    )
    assert [bound.tolist() for bound in lower_bounds] == [above, below]


def pressed_on_one_side(k, c):
    """A problem with u = sin(x) y + x^2: contact on side 1, clamped side 3, and the flux on the others."""
    u = "sin(x)*y + x**2"
    return ul.Problem(
        SQUARE.tolist(),
        f"{k!r}*(sin(x)*y - 2) + {c!r}*({u})",
        [None, u, None, None],
        [0, 2],
        q=[f"-{k!r}*sin(x)", None, f"{k!r}*sin(x)", None],
        u={3: u},
        k=k,
        c=c,
    )


@pytest.mark.parametrize("sharp", [False, True])
@pytest.mark.parametrize("k", [1e-12, 1.0, 1e12])
def test_forces_and_reactions_lie_in_their_intervals_for_every_reaction_coefficient(k, sharp):
    """k du/dn is k (cos(1) y + 2) on side 1 and -k y on side 3. For tiny c the intervals are those of c = 0.

    Control: by a thousandth of the bounds they are missed.
    """
    exact = k * (0.5 * math.cos(1) + 2), -0.5 * k
    computed = []
    for ratio in (0.0, 1e-18, 1e-8, 1e-2, 1.0, 1e2, 1e4, 1e8, 1e14):
        s = ul.solve(pressed_on_one_side(k, k * ratio), h=1 / 8, H=1 / 4)
        pair = s.forces(sharp).sides[1], s.forces(sharp).reactions[3,]
        assert all(force.lower <= true <= force.upper for force, true in zip(pair, exact, strict=True))
        computed.append(pair)
    for first, tiny in zip(computed[0], computed[1], strict=True):
        assert np.array(tiny) == pytest.approx(np.array(first), rel=1e-2)
    s = ul.solve(pressed_on_one_side(k, k), h=1 / 8, H=1 / 4)
    bound = s.solved.bound(sharp)
    data = s.solved.data
    clamps = ReactionData(
        s.solved.form,
        bound.outflows,
        s.solved.local_bound.clamped_ends,
        1e-3 * bound.reaction_bound,
        data.total_force,
    )
    narrow = bound_forces(
        s.mesh, s.solved.partition, s.solved.lambda_H, 1e-3 * bound.lambda_, [[1], [3]], clamps
    )
    assert not any(force.lower <= true <= force.upper for force, true in zip(narrow, exact, strict=True))


@pytest.fixture
def boundary(monkeypatch):
    """`LeastBound` on sixteen boundary edges; edge 0 is as short as 1e-12. No w has a norm."""
    monkeypatch.setattr(of_forces, "energy_norm", lambda *arguments: 0.0)
    s = np.linspace(0, 4, 17)
    s[1] = 1e-12
    mesh = SimpleNamespace(boundary=np.arange(16), polygon=square(), s=s, exact_mesh_factor=1.0, n_nodes=16)
    load = np.zeros(16)
    load[[0, 1, 5]] = 1.0, 2.0, 4.0
    return of_forces.LeastBound(mesh, None, load, 0.5, load, np.zeros(16, dtype=bool), H1)


def test_the_pairing_is_rounded_and_so_are_places_on_short_edges(boundary):
    """w = 1 at node 0, -1 at node 1: a place that moves by eps 4 on edge 0 changes w by 2 eps 4 / 1e-12."""
    w = np.zeros((16, 1))
    w[:2, 0] = 1.0, -1.0
    (bound,) = boundary._bound_on_exact_mesh(w)
    places = np.finfo(float).eps * 4 * (2 * (1 + 2) / 1e-12 + 2 / 0.25)
    # On edge 15, from 3.75 on, w rises by 1, with a load of 1; on edge 1 it rises by 1 with a load of 2.
    assert bound - (1.0 - 2.0) == pytest.approx(places + SQUARES_ROUNDING * (1 + 2), rel=1e-2)


def test_the_pairing_is_rounded_relative_to_its_own_terms(boundary):
    """w = 1: no place matters, and loads of 7 in all are rounded. w = 3 at node 5 alone: 3 times 4 is."""
    (bound,) = boundary._bound_on_exact_mesh(np.ones((16, 1)))
    assert bound - 7 == pytest.approx(7 * SQUARES_ROUNDING, rel=1e-3)
    (bound,) = boundary._bound_on_exact_mesh(np.where(np.arange(16)[:, None] == 5, 3.0, 0.0))
    assert bound - 12 == pytest.approx(12 * SQUARES_ROUNDING, rel=1e-3)


def test_the_pairing_is_longer_by_the_stretch(boundary, monkeypatch):
    monkeypatch.setattr(Polygon, "stretch", property(lambda self: np.array([0, 1e-4, 0, 0])))
    assert boundary._bound_on_exact_mesh(np.ones((16, 1)))[0] - 7 == pytest.approx(7e-4, rel=1e-3)


def test_the_norm_of_w_is_rounded_up_and_grows(boundary, monkeypatch):
    """E = 1/2."""
    calls = []
    monkeypatch.setattr(of_forces, "energy_norm", lambda mesh, w, norm: calls.append(norm) or 1e6)
    boundary.mesh.exact_mesh_factor = 1.5
    (bound,) = boundary._bound_on_exact_mesh(np.zeros((16, 1)))
    assert (
        1.5 * 0.5 * 1e6 * (1 + 0.999 * SQUARES_ROUNDING)
        <= bound
        <= 1.5 * 0.5 * 1e6 * (1 + 1.001 * SQUARES_ROUNDING)
    )
    assert calls == [H1]


def exact_balance(polygon, f, q):
    """- int f - int q with 40 digits, f = a + bx + cy and q = a + bx + cy on the sides that have one."""

    def mean(linear, corners):
        xs, ys = np.transpose(corners).tolist()
        x = sum(map(mpmath.mpf, xs)) / len(corners)
        y = sum(map(mpmath.mpf, ys)) / len(corners)
        return linear[0] + linear[1] * x + linear[2] * y

    with mpmath.workdps(40):
        total = mpmath.mpf(0)
        v = polygon.vertices
        for i in range(1, len(v) - 1):  # triangles (v_0, v_i, v_{i+1}), with signs
            ax, ay = map(mpmath.mpf, v[0].tolist())
            bx, b_y = map(mpmath.mpf, v[i].tolist())
            cx, cy = map(mpmath.mpf, v[i + 1].tolist())
            area = ((bx - ax) * (cy - ay) - (b_y - ay) * (cx - ax)) / 2
            total += area * mean(f, v[[0, i, i + 1]])
        for side, linear in q.items():
            ends = v[[side, (side + 1) % len(v)]]
            ax, ay = map(mpmath.mpf, ends[0].tolist())
            bx, b_y = map(mpmath.mpf, ends[1].tolist())
            total += mpmath.hypot(bx - ax, b_y - ay) * mean(linear, ends)
        return -total


def test_the_balance_encloses_the_exact_sum_for_random_data_on_random_polygons():
    """60 polygons, far from the origin too, with f and q of sizes from 1e-6 to 1e6: the exact sum is inside.

    Control: the interval is narrow. Sums are rounded by SUMS of their terms, and q is not known to a few
    units in the last place of its own; so its width is at most 100 SUMS of the largest sizes of the terms.
    """
    rng = np.random.default_rng(17)
    for _ in range(60):
        n = int(rng.integers(3, 7))
        angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
        place = 10 ** rng.uniform(-2, 4)
        radius = rng.uniform(0.5, 1, n)[:, None]
        polygon = Polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]) + place, "random")
        linear = [tuple((rng.normal(size=3) * 10 ** rng.uniform(-6, 6)).tolist()) for _ in range(n)]
        free = [side for side in range(1, n) if rng.random() < 0.5]
        q = {side: linear[side] for side in free}
        as_text = {
            side: "{!r} + {!r}*x + {!r}*y".format(*coefficients) for side, coefficients in enumerate(linear)
        }
        problem = ul.Problem(
            polygon,
            as_text[0],
            [None if side in (0, *free) else -1e9 for side in range(n)],
            free,
            q=[as_text[side] if side in free else None for side in range(n)] if free else None,
            u={0: 0},
            c=0,
        )
        mesh = meshes.make_unstructured_mesh(polygon, 0.5)
        lower, upper = enclose_total_force(
            enclose_source(mesh, problem.source, Form()), problem.enclosed_flux
        )
        exact = exact_balance(polygon, linear[0], q)
        assert lower <= exact <= upper
        largest = np.abs([linear[0], *q.values()]) @ [1.0, *np.abs(polygon.vertices).max(axis=0)]
        assert upper - lower <= 100 * SQUARES_ROUNDING * largest @ [polygon.area, *polygon.lengths[free]]
