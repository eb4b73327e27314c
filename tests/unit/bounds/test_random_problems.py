"""Certificates of random problems on random polygons: never below the true error, whatever u_h and lambda_H.

The true error of u is by a quadrature of its own. That of lambda is at least the norm of lambda - lambda_H
over V_h, and its integral over |Omega|^{1/2}. `make fuzz` tries hundreds of numbers.
"""

from dataclasses import replace

import numpy as np
import pytest
from random_problems import at_a_corner, known, with_fluxes
from test_adversarial import FUZZ, SIZE, true_errors

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.levels import two_edges_per_cell
from unilateral.accuracy.search import search
from unilateral.bounds import local, source
from unilateral.bounds.forces import forces
from unilateral.bounds.given import given
from unilateral.choice import condensed
from unilateral.fem.condense import condense
from unilateral.fem.p1 import coupling, h1_norm
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import adapted, marked, refined
from unilateral.geometry.structured import natural_kind
from unilateral.multilevel import after
from unilateral.solvers.stop import Stop

FORMULAS = range(5 * FUZZ) if FUZZ else (0, 4, 8, 20, 22, 26, 32, 39, 42, 48)
FLUXES = range(2 * FUZZ) if FUZZ else (0, 1, 2, 7, 20)
CORNERS = range(FUZZ) if FUZZ else (1,)
SEARCHES = range(FUZZ) if FUZZ else (4, 8, 22)
"""Numbers of problems: all, or some that take about a second."""
ADAPTED = 3
"""Adapted meshes after a uniform one."""
QUADRATURE = 1e-4
"""Of a true error: what the quadrature may be off by, see the test of it."""
MOST = 1000
"""Unknowns of a search."""


def made(kind, number, folder):
    return (
        {"formula": known, "flux": with_fluxes}[kind](number)
        if kind != "corner"
        else at_a_corner(number, folder)
    )


def solutions(problem, rng):
    """On a uniform mesh, there with cells that are not made of edges, and on adapted ones."""
    polygon, stop = problem.polygon, Stop()
    H = polygon.lengths.max() / rng.integers(1, 5)
    mesh, cells = uniform(polygon, H, rng.random())
    found = condensed(problem, mesh, cells).solved(stop)
    yield found
    yield condensed(problem, mesh, partitions.shifted(polygon, 1.3 * H, rng.random())).solved(stop)
    of = adapted(mesh)
    for _ in range(ADAPTED):
        of = refined(of, marked(of.mesh, found.shares))
        found = after(found, problem, of).solved(stop)
        yield found


def uniform(polygon, H, choice):
    """A structured mesh where there is one, or a mesh by gmsh, halved or not; and its cells."""
    if choice < 0.4:
        return meshes.following(partitions.uniform(polygon, 2 * H), 2, 1)
    of = adapted(two_edges_per_cell(polygon, H, natural_kind(polygon) if choice < 0.8 else "unstructured"))
    return of.mesh, of.partition


def pairs(solved, rng):
    """(u_h, lambda_H), and others that do not solve the discrete problem."""
    u, lambda_H, mesh = solved.u_h, solved.lambda_H, solved.discrete.mesh
    noise = rng.standard_normal(len(u))
    noise *= 10.0 ** rng.uniform(-4, 1) * h1_norm(mesh, u) / h1_norm(mesh, noise)
    inside = u.copy()
    inside[mesh.boundary] = 0.0
    yield u, lambda_H
    yield u + noise, lambda_H
    yield u, lambda_H * rng.uniform(0, 2, len(lambda_H))
    yield u * rng.uniform(-1, 2), np.zeros_like(lambda_H)
    yield inside, lambda_H


def outcomes(of, solved, rng):
    """Of these pairs: the bound, the true error of u, and a lower bound of that of lambda."""
    discrete, problem = solved.discrete, of.problem
    mesh, cells, tried = discrete.mesh, discrete.partition, list(pairs(solved, rng))
    of_f, g = discrete.source or source.enclosed(mesh, problem), problem.enclosed_obstacle
    moments, on_mesh, to_mesh = of.flux_moments(mesh), condense(mesh), coupling(mesh, cells).T
    errors = of.errors(mesh, [u_h for u_h, _ in tried])
    for (u_h, lambda_H), error in zip(tried, errors, strict=True):
        tau = given(problem.enclosed_flux, mesh)
        bound = local.local_bound(of_f, g, cells, u_h, lambda_H, problem.free_sides, tau)
        rest = moments - to_mesh @ lambda_H
        dual = np.sqrt(max(rest @ on_mesh.solve_boundary(rest), 0.0))
        yield bound, error, max(dual, abs(rest.sum()) / np.sqrt(mesh.polygon.area))


def violations(of, rng):
    """The outcomes, of all solutions, in which a bound is too small."""
    return [
        (bound.u, error, bound.lambda_, of_lambda)
        for solved in solutions(of.problem, rng)
        for bound, error, of_lambda in outcomes(of, solved, rng)
        if error > bound.u * (1 + QUADRATURE) or of_lambda > bound.lambda_ * (1 + 1e-6)
    ]


@pytest.fixture(autouse=True)
def _few_pieces(monkeypatch):
    """So that what takes too many is known less well, and sooner."""
    monkeypatch.setattr(source, "MOST_PIECES", 6000)


@pytest.mark.parametrize(
    ("kind", "number"),
    [("formula", n) for n in FORMULAS] + [("flux", n) for n in FLUXES] + [("corner", n) for n in CORNERS],
)
def test_no_bound_is_below_a_true_error(tmp_path, kind, number):
    assert not violations(made(kind, number, tmp_path), np.random.default_rng([17, number]))


def forces_outside(of, rng, share=1.0):
    """Over the boundary and each side: exact forces that do not lie between the numbers that are guaranteed.

    The moments of lambda with the hats of a side's nodes, with its ends and without, have its force between
    them. The `share` is of the bound of lambda.
    """
    wrong, free = [], of.problem.free_sides
    for solved in solutions(of.problem, rng):
        mesh = solved.discrete.mesh
        parts = [[*range(mesh.polygon.n_sides)], *([side] for side in range(mesh.polygon.n_sides))]
        moments, bound = of.flux_moments(mesh), share * solved.bound().lambda_
        off = 1e-6 * np.abs(moments).sum() + 1e-12 * solved.u_norm  # of the quadrature, and of rounding
        found = forces(mesh, solved.discrete.partition, solved.lambda_H, bound, parts, free)
        for part, force in zip(parts, found, strict=True):
            on = np.isin(mesh.side, part)
            least, most = moments[on & np.roll(on, 1)].sum(), moments[on | np.roll(on, 1)].sum()
            if force.upper < least - off or force.lower > most + off:
                wrong.append((part, force, least, most))
    return wrong


@pytest.mark.parametrize(
    ("kind", "number"), [("formula", n) for n in FORMULAS] + [("flux", n) for n in FLUXES]
)
def test_no_force_lies_outside(kind, number):
    assert not forces_outside(made(kind, number, None), np.random.default_rng([19, number]))


def test_a_force_outside_is_noticed():
    """Control: without what the error adds, exact forces lie outside."""
    assert forces_outside(known(4), np.random.default_rng([19, 4]), share=0.0)


@pytest.mark.parametrize("number", SEARCHES)
def test_what_is_certified_is_as_accurate_as_that(number):
    """The relative error by the norm of u itself, which the search does not know."""
    of, accuracy = known(number), 10.0 ** np.random.default_rng([18, number]).uniform(-1.5, -0.3)
    found = search(of.problem, Goal(accuracy, max_unknowns=MOST))
    solved = found.best.solved
    error, norm = of.errors(solved.discrete.mesh, [solved.u_h, np.zeros_like(solved.u_h)])
    assert not found.certified or error <= accuracy * norm * (1 + QUADRATURE)
    assert found.best.size <= norm * (1 + QUADRATURE)
    assert found.ended == ""


@pytest.mark.parametrize("name", ["u", "lambda_"])
def test_a_bound_that_is_a_fifth_too_small_is_noticed(monkeypatch, name):
    """Control: the bounds are nearer than that to some of the errors."""
    right = local.local_bound

    def too_small(*given):
        bound = right(*given)
        return replace(bound, **{name: 0.8 * getattr(bound, name)})

    monkeypatch.setattr(local, "local_bound", too_small)
    assert violations(known(4), np.random.default_rng([17, 4]))


@pytest.mark.parametrize("number", FORMULAS)
def test_the_quadrature_of_the_true_error(number):
    """Pieces of half the size, which have a quarter of its error at most, change it by less."""
    of = known(number)
    solved = next(solutions(of.problem, np.random.default_rng([17, number])))
    mesh, functions = solved.discrete.mesh, [solved.u_h, np.zeros_like(solved.u_h)]
    (coarse, norm), (fine, _) = (true_errors(of, mesh, functions, size) for size in (SIZE, SIZE / 2))
    assert coarse == pytest.approx(fine, rel=0.75 * QUADRATURE, abs=1e-12 * norm)


@pytest.mark.parametrize(
    ("kind", "number"),
    [("formula", n) for n in FORMULAS] + [("flux", n) for n in FLUXES] + [("corner", n) for n in CORNERS],
)
def test_the_random_solutions_solve_their_problems(tmp_path, kind, number):
    """(1.2) in points of the boundary, up to rounding; (1.1) is how f is made."""
    of = made(kind, number, tmp_path)
    lengths, per_side = of.problem.polygon.lengths, 200
    side = np.repeat(np.arange(len(lengths)), per_side)
    s = lengths[side] * np.tile((np.arange(per_side) + 0.5) / per_side, len(lengths))
    u, flux, gap = of.boundary(side, s)
    size = np.abs(u).max()
    of_u, of_flux = 1e-12 * size, 1e-9 * max(size / lengths.min(), np.abs(flux).max())
    assert gap.min() >= -of_u
    assert flux.min() >= -of_flux
    assert not np.any((gap > of_u) & (flux > of_flux))
