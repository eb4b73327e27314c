"""The force over each side, between two numbers: with the least error that is known it still lies there."""

import math

import numpy as np
import pytest
import scipy.optimize
from test_sharp_bounds import CASES, pair

import unilateral as ul
from unilateral.bounds import forces as of_forces
from unilateral.bounds.forces import extended, forces
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.p1 import coupling, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.norms.exact_errors import cell_means
from unilateral.solvers import least_norm

SMOOTH = [(name, polygon) for name, polygon in CASES if name not in ("rough", "singular", "violates_jj")]
"""Whose lambda is integrated by quadrature up to rounding."""
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def exact_forces(case, cells):
    """By the boundary's quadrature, over the whole boundary and over each side."""
    per_cell = cells.lengths * cell_means(case, cells).lambda_means
    per_side = np.bincount(cells.side, per_cell, cells.polygon.n_sides)
    return [per_side.sum(), *per_side]


def found(of, bound):
    sides = range(of.mesh.polygon.n_sides)
    return forces(of.mesh, of.cells, of.lambda_H, bound, [[*sides], *([i] for i in sides)])


@pytest.mark.parametrize(("name", "polygon"), SMOOTH)
@pytest.mark.parametrize("crude", [None, "zero", "noise"])
def test_the_exact_force_lies_between(name, polygon, crude):
    """With the true error in place of its bound, which is the hardest."""
    for n in (4, 8):
        of = pair(name, n, polygon, crude)
        for exact, force in zip(exact_forces(of.case, of.cells), found(of, of.upper + 1e-12), strict=True):
            assert force.lower <= exact + 1e-12
            assert exact <= force.upper + 1e-12
            assert force.lower <= force.value <= force.upper


def test_a_bound_that_is_too_small_is_seen():
    """The control: without what the error adds, the exact force over the boundary lies outside."""
    of = pair("natural", 8)
    exact, force = exact_forces(of.case, of.cells)[0], found(of, 1e-3 * of.lower)[0]
    assert not force.lower <= exact <= force.upper


@pytest.fixture
def traces(monkeypatch):
    """The meshes of w, and its values at the boundary nodes: of -w below the force, then of w above."""
    found = []

    def recorded(space, v):
        found.append((space.mesh, v))
        return extended(space, v)

    monkeypatch.setattr(of_forces, "extended", recorded)
    return found


@pytest.mark.parametrize("steps", [1, 2, least_norm.MOST_STEPS])
@pytest.mark.parametrize("kind", ["square", "lshape"])
def test_w_is_above_and_below_the_indicator_of_a_side(kind, steps, traces, monkeypatch):
    """At the middles of edges, too, and wherever the iteration ends."""
    monkeypatch.setattr(least_norm, "MOST_STEPS", steps)
    polygon = named(kind)
    mesh, cells = structured(polygon, 1 / 8), partitions.uniform(polygon, 1 / 4)
    rng = np.random.default_rng(1)
    for side in range(polygon.n_sides):
        lambda_H = rng.random(cells.n_cells) * (rng.random(cells.n_cells) < 0.5)
        lambda_H[cells.side == side] = 1.0
        forces(mesh, cells, lambda_H, 0.02, [[side]])
        (of, minus), (_, over) = traces[-2:]
        assert over.shape == minus.shape == (len(of.boundary), 1)
        for share in (0.0, 0.5, 1.0):
            above, below = ((1 - share) * w + share * np.roll(w, -1) for w in (over[:, 0], -minus[:, 0]))
            assert np.all(above >= (of.side == side))
            assert np.all(below <= (of.side == side))


def test_an_interval_misses_the_force_where_w_is_too_small(monkeypatch):
    """The control: w is not held at the ends of a side, so it is below 1 on the edges there."""
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    given = mesh, cells, np.ones(cells.n_cells), 1e-3, [[0]]
    assert forces(*given)[0].upper >= 1
    limits = of_forces._limits
    monkeypatch.setattr(of_forces, "_limits", lambda *of: tuple(np.minimum(c, 0) for c in limits(*of)))
    assert forces(*given)[0].upper < 1


def refused(mesh):
    raise InputError("no")


def test_the_interval_is_the_best_on_its_mesh(traces):
    """By SLSQP, which knows nothing of active sets, and with S made by dense algebra."""
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    lambda_H, E = np.where(cells.side < 2, 1.0, 0.0), 0.3
    force = forces(mesh, cells, lambda_H, E, [[0]])[0]
    of = traces[-1][0]
    A, b = sum(stiffness_and_mass(of)).toarray(), of.boundary
    inside = np.setdiff1d(np.arange(of.n_nodes), b)
    across = A[np.ix_(inside, b)]
    S = A[np.ix_(b, b)] - across.T @ np.linalg.solve(A[np.ix_(inside, inside)], across)
    pairing = coupling(of, cells).T @ lambda_H
    on, off = (edges | np.roll(edges, 1) for edges in (of.side == 0, of.side != 0))
    for c, start, end in (
        (1.0 * on, np.ones(len(b)), force.upper),
        (np.where(off, 0.0, -1.0), -1.0 * ~off, -force.lower),
    ):
        found = scipy.optimize.minimize(
            lambda v: pairing @ v + E * np.sqrt(v @ S @ v),
            start,
            jac=lambda v: pairing + E * S @ v / np.sqrt(v @ S @ v),
            bounds=[(low, None) for low in c],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        assert found.success
        assert end == pytest.approx(found.fun, rel=1e-6)


def test_its_norm_is_the_least():
    """Against a dense solve for the interior."""
    mesh = structured(square(), 1 / 16)
    trace = (mesh.side == 0).astype(float)
    A = sum(stiffness_and_mass(mesh)).toarray()
    inside, w = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary), np.zeros(mesh.n_nodes)
    w[mesh.boundary] = trace
    w[inside] = np.linalg.solve(A[np.ix_(inside, inside)], -(A @ w)[inside])
    found = extended(condense(mesh), trace[:, None])[:, 0]
    assert np.array_equal(found[mesh.boundary], trace)
    assert found == pytest.approx(w, abs=1e-12)


@pytest.mark.parametrize("a", [1e-9, 1e-5])
def test_the_norm_of_nearly_a_constant_is_not_lost_in_rounding(a):
    """In a square of side a, for w = 1 on the boundary, the least ||w||_1 is a, up to the order a^2 of that.

    By w . A w, in which the gradients of a constant cancel, it was 3e-3 off.
    """
    polygon = Polygon(a * SQUARE, "small")
    mesh, cells = meshes.unstructured(polygon, a / 64), partitions.uniform(polygon, a / 32)
    whole, side = forces(mesh, cells, np.ones(cells.n_cells), 1.0, [range(4), [0]])
    assert whole.upper - whole.value == pytest.approx(a, rel=1e-8)
    assert 0 <= side.value <= side.upper <= whole.upper


@pytest.mark.parametrize("length", [1e-70, 1e-20, 1e-7, 1e7, 1e70])
def test_polygons_of_all_sizes_have_a_force(length):
    """Nothing overflows, and the interval of a side is not that of a constant w."""
    polygon = Polygon(length * SQUARE, "scaled")
    mesh, cells = meshes.unstructured(polygon, length / 8), partitions.uniform(polygon, length / 4)
    whole, side = forces(mesh, cells, np.ones(cells.n_cells), 1e-3 * min(length, 1.0), [range(4), [0]])
    assert 0.9 * whole.value < whole.lower <= whole.value <= whole.upper < 1.1 * whole.value
    assert side.value == pytest.approx(length)
    assert 0 < side.lower <= side.value <= side.upper < 3 * length


@pytest.mark.parametrize("bound", [0.0, 1e-300, 1e-20, 1e20, 1e150])
def test_errors_of_all_sizes(bound):
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    for lambda_H in (np.zeros(cells.n_cells), np.where(cells.side < 2, 1.0, 0.0)):
        for force in forces(mesh, cells, lambda_H, bound, [range(4), [0], [2]]):
            assert 0 <= force.lower <= force.value <= force.upper < math.inf
            if bound < 1e-10:
                assert force.upper - force.lower <= 1e-8 * lambda_H.sum() + 2 * bound


def test_without_a_small_mesh_w_is_a_constant(monkeypatch):
    """1 or 0, with the root of the area, 1, as its norm."""
    monkeypatch.setattr(of_forces, "condense", refused)
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    whole, side = forces(mesh, cells, np.ones(cells.n_cells), 0.1, [range(4), [0]])
    assert whole == pytest.approx((4, 3.9, 4.1), rel=1e-8)
    assert side == pytest.approx((1, 0, 4.1), rel=1e-8)


def test_a_free_side_has_no_force_and_hinders_no_other():
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    lambda_H = np.where(cells.side == 0, 1.0, 0.0)
    held = forces(mesh, cells, lambda_H, 0.1, [[0], [1]])
    freed = forces(mesh, cells, lambda_H, 0.1, [[0], [1]], free=[1, 3])
    assert freed[1] == (0, 0, 0)
    assert freed[0].lower > held[0].lower


def test_without_a_bound_of_lambda_there_is_none_of_the_force():
    mesh, cells = structured(square(), 1 / 8), partitions.uniform(square(), 1 / 4)
    force = forces(mesh, cells, np.ones(cells.n_cells), math.inf, [[0]])[0]
    assert force == (1, 0, math.inf)


def test_of_a_solution_from_python():
    s = ul.solve(ul.case("natural"), h=1 / 16, H=1 / 8)
    local, sharp = s.forces(), s.forces(sharp=True)
    exact = exact_forces(s.solved.discrete.data, s.partition)[0]
    assert local.whole.lower < sharp.whole.lower <= exact <= sharp.whole.upper < local.whole.upper
    assert len(local.sides) == 4
    assert local.whole.value == pytest.approx(sum(side.value for side in local.sides))
    sampled = ul.Problem(square(), f=lambda x, y: -np.ones_like(x), g="-1")
    assert ul.solve(sampled, h=1 / 8, H=1 / 4).forces().whole.upper == math.inf
