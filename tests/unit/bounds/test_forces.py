"""The force over each side, between two numbers: with the least error that is known it still lies there."""

import math

import numpy as np
import pytest
import scipy.sparse as sp
from test_sharp import CASES, pair

import unilateral as ul
from unilateral.bounds import forces as of_forces
from unilateral.bounds.forces import forces
from unilateral.fem.p1 import h1_norm, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured
from unilateral.norms.exact import cell_means
from unilateral.solvers import descent

SMOOTH = [(name, polygon) for name, polygon in CASES if name not in ("rough", "singular", "violates_jj")]
"""Whose lambda is integrated by quadrature up to rounding."""


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


@pytest.mark.parametrize("kind", ["square", "lshape"])
def test_w_is_above_and_below_the_indicator_of_a_side(kind):
    polygon = named(kind)
    mesh, rng = meshes.unstructured(polygon, 1 / 4), np.random.default_rng(1)
    for side in range(polygon.n_sides):
        pressed = rng.random(len(mesh.boundary)) < 0.5
        on = mesh.side == side
        of_side = on | np.roll(on, 1)
        over, under = of_forces._traces(mesh, on, ~on, pressed)
        assert np.all(over[of_side] == 1)
        assert np.all(over >= 0)
        assert np.all(over[pressed & ~of_side] == 0)
        others = ~on | np.roll(~on, 1)
        assert np.all(under[others] == 0)
        assert np.all((under >= 0) & (under <= 1))
        assert np.all(under[pressed & ~others] == 1)


def test_w_falls_with_the_distances():
    """Boundary nodes of the unit square, h = 1/4: 1 up to s = 1, 0 from s = 2 on, linear between."""
    mesh = structured(square(), 1 / 4)
    s = mesh.s[:-1]
    w = of_forces._between(mesh, s >= 2, s <= 1)
    assert w == pytest.approx(np.clip(2 - s, 0, 1), abs=1e-15)
    around = of_forces._distance(mesh.s, s == 3.5)
    assert around == pytest.approx(np.minimum(np.abs(s - 3.5), 4 - np.abs(s - 3.5)), abs=1e-15)


@pytest.mark.parametrize("iterated", [False, True])
def test_its_norm_is_nearly_the_least(iterated, monkeypatch):
    """Against a dense solve for the interior; steps end where one takes off 1e-3 of the square."""
    if iterated:
        monkeypatch.setattr(descent, "DIRECT", 0)
    mesh = structured(square(), 1 / 16)
    trace = (mesh.side == 0).astype(float)
    A = sum(stiffness_and_mass(mesh)).toarray()
    inside, w = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary), np.zeros(mesh.n_nodes)
    w[mesh.boundary] = trace
    w[inside] = np.linalg.solve(A[np.ix_(inside, inside)], -(A @ w)[inside])
    assert of_forces._extensions(mesh)(trace) == pytest.approx(h1_norm(mesh, w), rel=1e-3)


def test_the_norm_of_nearly_a_constant_is_not_lost_in_rounding():
    """In a square of side a, for w = 1 on the boundary, the least ||w||_1 is a, up to the order a^2 of that.

    By w . A w, in which the gradients of a constant cancel, it was 3e-3 off.
    """
    a = 1e-5
    mesh = meshes.unstructured(Polygon(a * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), "small"), a / 64)
    assert of_forces._extensions(mesh)(np.ones(len(mesh.boundary))) == pytest.approx(a, rel=1e-8)


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


def test_a_norm_that_rounding_hides_ends_no_search(monkeypatch):
    """In a square that small w . A w may be below 0, and every step is more than a share of that."""
    monkeypatch.setattr(of_forces, "ENOUGH", 0.0)
    steps = []
    monkeypatch.setattr(descent.Descent, "step", lambda _: steps.append(1) or 1.0)
    mesh = structured(square(), 1 / 4)
    assert of_forces._extensions(mesh)(np.ones(len(mesh.boundary))) > 0
    assert len(steps) == descent.MOST_STEPS


def test_a_step_whose_curvature_is_hidden_is_none():
    """Where p . A p is not above 0."""
    run = descent.Descent(sp.csr_array(-np.eye(2)), np.ones(2), np.zeros(2), np.copy)
    assert (run.step(), run.rz) == (0.0, 0.0)
    assert run.x.tolist() == [0, 0]
