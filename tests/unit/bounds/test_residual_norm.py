"""Norms of residuals on a few triangles against those on P2 of a fine mesh, which are smaller."""

import math
from functools import cache

import numpy as np
import pytest
import skfem
from skfem.helpers import dot, grad

from unilateral.bounds import residual_norm
from unilateral.bounds.flux_residuals import bound_by_parts
from unilateral.bounds.residual_norm import ResidualParts
from unilateral.fem.form import Form
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon

SHAPES = {
    "right": [[0, 0], [1, 0], [0, 1]],
    "thin": [[0, 0], [1, 0], [0.5, 0.1]],
    "obtuse": [[0, 0], [1, 0], [-1, 0.3]],
    "square": [[0, 0], [1, 0], [1, 1], [0, 1]],
}
CLAMPED = {"square": (3,)}
FRIEDRICHS = 2 / math.pi
"""The constant of functions on the unit square that vanish on one side."""
RATIOS = [0.0, 1e-8, 1e-2, 1.0, 10.0, 100.0, 1e4, 1e8]
KINDS = ("misfit", "oscillation", "mean", "remainder")


@cache
def fine(shape):
    """A few triangles, and P2 on them refined, with the coarse triangle of every fine one."""
    vertices = np.array(SHAPES[shape], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]][: len(vertices) - 2])
    mesh = meshes.from_arrays(Polygon(vertices, shape), vertices, triangles)
    coarse = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.Basis(coarse.refined(5), skfem.ElementTriP2(), intorder=6)
    middle = basis.mesh.p[:, basis.mesh.t].mean(axis=1)
    return mesh, basis, coarse.element_finder()(*middle)


def make_residual(shape, rng, sizes, form, factor=0.0):
    """Parts of those sizes at random, and their functional (N,); s' times the `factor`, if that is not 0."""
    mesh, basis, coarse = fine(shape)
    x = basis.global_coordinates()
    n = len(mesh.triangles)
    area = mesh.areas

    def norms(values):
        squares = np.sum(basis.dx * values**2, axis=-1)
        return np.sqrt(np.bincount(coarse, squares, n))

    def linear(random):
        a = random[:, coarse, None]
        return a[0] + a[1] * x[0] + a[2] * x[1]

    def mean_free(values):
        means = np.bincount(coarse, np.sum(basis.dx * values, axis=-1), n) / area
        return values - means[coarse, None]

    # a linear field, and rho with all its parts; the rest is a step
    slopes = rng.standard_normal((2, 3, n))
    field = np.stack([linear(slopes[0]), linear(slopes[1])])
    scale = sizes[0] / math.sqrt(float((norms(field[0]) ** 2 + norms(field[1]) ** 2).max()))
    field = scale * field
    slopes = scale * slopes
    oscillation = mean_free(linear(rng.standard_normal((3, n))))
    oscillation *= sizes[1] / norms(oscillation).max()
    mean = sizes[2] * rng.standard_normal(n)
    remaining = sizes[3] * np.sign(linear(rng.standard_normal((3, n))))
    rho = oscillation + mean[coarse, None] + remaining

    @skfem.LinearForm
    def functional(v, w):
        return dot(w.field, grad(v)) + w.rho * v

    # the field at the nodes, and rho - div, for the bound by parts
    corners = mesh.points[mesh.triangles].transpose(2, 1, 0)
    nodal = slopes[:, None, 0] + slopes[:, None, 1] * corners[0] + slopes[:, None, 2] * corners[1]
    divergence = slopes[0, 1] + slopes[1, 2]
    inside = norms(rho - divergence[coarse, None])

    layers = np.full(n, math.inf)
    if factor and form.c:
        layers = factor * bound_by_parts(mesh, np.arange(n), nodal, inside, np.zeros(n), form)
    residual_parts = ResidualParts(
        mesh=mesh,
        form=form,
        misfit=np.hypot(norms(field[0]), norms(field[1])),
        oscillation=norms(oscillation),
        mean=np.sqrt(area) * np.abs(mean),
        remainder=norms(remaining),
        s_prime=layers,
    )
    return residual_parts, functional.assemble(basis, field=field, rho=rho)


@cache
def matrices(shape):
    """(grad ., grad .)_0 and (., .)_0."""

    @skfem.BilinearForm
    def stiffness(u, v, _):
        return dot(grad(u), grad(v))

    @skfem.BilinearForm
    def mass(u, v, _):
        return u * v

    return stiffness.assemble(fine(shape)[1]), mass.assemble(fine(shape)[1])


def dual_norm(shape, load, form):
    """The norm of the functional on P2, where it vanishes on the clamped sides."""
    _, basis, _ = fine(shape)
    K, M = matrices(shape)
    A = (form.k * K + form.c * M).tocsr()
    x = basis.doflocs
    free = np.flatnonzero(x[0] > 0) if form.clamped else np.arange(basis.N)
    solution = skfem.solve(A[free][:, free], load[free])
    return math.sqrt(float(load[free] @ solution))


def forms(shape):
    """All ratios of c and k, with and without clamped sides."""
    for ratio in RATIOS:
        for k in (1.0, 1e3):
            if ratio:
                yield Form(k, ratio * k)
            if shape in CLAMPED:
                yield Form(k, ratio * k, CLAMPED[shape], friedrichs=FRIEDRICHS)


def bounds(shape, seed=0, kinds=KINDS, exact=KINDS, factor=0.0):
    """Bounds over the norms on P2; the kinds are those that are there, the exact ones those that count.

    s' counts times the `factor`, if that is not 0.
    """
    rng = np.random.default_rng(seed)
    for form in forms(shape):
        for _ in range(3):
            sizes = [10.0 ** rng.uniform(-2, 2) * (kind in kinds) for kind in KINDS]
            computed, load = make_residual(shape, rng, sizes, form, factor)
            computed = computed._replace(**{kind: 0 * computed.mean for kind in KINDS if kind not in exact})
            yield form, computed.dual_norms()[1] / dual_norm(shape, load, form)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_bound_is_never_below_the_norm(shape):
    assert min(ratio for _, ratio in bounds(shape)) >= 1


@pytest.mark.parametrize("shape", SHAPES)
def test_the_bound_by_parts_is_never_below_the_norm(shape):
    """Control: half of it is."""
    assert min(ratio for _, ratio in bounds(shape, 8, factor=1.0)) >= 1
    assert min(ratio for _, ratio in bounds(shape, 8, factor=0.4)) < 1


def test_by_parts_a_layer_that_is_not_seen_costs_little():
    """For fields alone; (k/c)^(1/2) is a hundredth of the triangle, which the fine mesh hardly resolves."""
    form = Form(1.0, 1e4)
    residual, load = make_residual("right", np.random.default_rng(9), [1.0, 0.0, 0.0, 0.0], form, 1.0)
    min_dual_norm = dual_norm("right", load, form)
    assert residual.dual_norms()[0] < 3 * min_dual_norm
    assert residual._replace(s_prime=0 * residual.mean + math.inf).dual_norms()[0] > 4 * min_dual_norm


@pytest.mark.parametrize("kind", KINDS)
def test_no_part_may_be_left_out(kind):
    """The control of the test above: without a part the norm of what it makes alone is 0."""
    ratios = [
        ratio
        for _, ratio in bounds(
            "square", 1, (kind,), [other_kind for other_kind in KINDS if other_kind != kind]
        )
    ]
    assert max(ratios) < 1


@pytest.mark.parametrize(("kind", "maximum"), [("misfit", 1.5), ("oscillation", 5.0), ("mean", 1.5)])
def test_one_part_alone_has_nearly_its_norm(kind, maximum):
    """On H^1, or where c is large, a constant alone has its norm; a field may be no gradient."""
    ratios = [ratio for form, ratio in bounds("right", 2, (kind,)) if form.c]
    assert 1 <= min(ratios) < maximum


def test_a_smaller_constant_is_too_small(monkeypatch):
    """The control of j: cos(pi x) on an equilateral triangle has a hundredth less, but not a half."""
    monkeypatch.setattr(residual_norm, "BESSEL_ZERO", 2 * residual_norm.BESSEL_ZERO)
    assert min(ratio for _, ratio in bounds("thin", 3, ("oscillation",))) < 1


def test_theta_is_the_best_one():
    """Of all theta in [0, 1], for E = 0; with E any theta makes a bound."""
    rng = np.random.default_rng(4)
    mesh, _, _ = fine("square")
    delta = mesh.longest_edges / residual_norm.BESSEL_ZERO
    for form in forms("square"):
        if form.c == 0:
            continue
        m, o, r = 10.0 ** rng.uniform(-3, 3, (3, len(mesh.triangles)))
        squares = ResidualParts(mesh, form, m, o, r, 0 * m, 0 * m + math.inf).squares()
        theta = np.linspace(0, 1, 100001)[:, None]
        all_of_them = (m + theta * delta * o) ** 2 / form.k + (r**2 + ((1 - theta) * o) ** 2) / form.c
        assert np.all(squares <= all_of_them.min(axis=0) * (1 + 1e-12))
        np.testing.assert_allclose(squares, all_of_them.min(axis=0), rtol=1e-4)


def test_gamma_is_the_best_one():
    """S_2 is the least of M^2 / ((1 - gamma) k) + N^2 / (c + gamma k / C^2) for gamma in [0, 1)."""
    rng = np.random.default_rng(5)
    mesh, _, _ = fine("square")
    gamma = np.linspace(0, 1, 100001)[:-1]
    for form in forms("square"):
        if not form.clamped:
            continue
        m, r = 10.0 ** rng.uniform(-3, 3, (2, len(mesh.triangles)))
        residual_parts = ResidualParts(mesh, form, m, 0 * m, r, 0 * m, 0 * m + math.inf)
        with np.errstate(divide="ignore"):
            squares = np.sum(m**2) / ((1 - gamma) * form.k)
            squares += np.sum(r**2) / (form.c + gamma * form.k / FRIEDRICHS**2)
        assert residual_parts.dual_norms()[1] == pytest.approx(math.sqrt(squares.min()), rel=1e-3)


def test_nothing_jumps_as_c_vanishes():
    """With Friedrichs' constant; without, the bound grows like c^(-1/2), and is infinite for c = 0."""
    clamped = Form(1.0, 0.0, (3,), friedrichs=FRIEDRICHS)
    computed, _ = make_residual("square", np.random.default_rng(6), [1.0, 1.0, 1.0, 0.1], clamped)
    on_H1, exact = computed.dual_norms()
    assert computed._replace(form=clamped._replace(c=1e-30)).dual_norms()[1] == pytest.approx(
        exact, rel=1e-12
    )
    assert on_H1 == math.inf
    small = computed._replace(form=Form(c=1e-4)).dual_norms()[0]
    larger = computed._replace(form=Form(c=1e-2)).dual_norms()[0]
    assert 10 < small / larger * 1.01 < 11


def test_the_smaller_of_both_counts_on_a_triangle():
    residual, _ = make_residual("square", np.random.default_rng(7), [1.0, 1.0, 1.0, 0.1], Form())
    squares = residual.squares()
    second = np.array([0.5 * math.sqrt(squares[0]), math.inf])
    np.testing.assert_allclose(residual._replace(s_prime=second).squares(), squares * [0.25, 1.0])


@pytest.mark.parametrize("form", [Form(), Form(2.0, 0.5, (3,), friedrichs=FRIEDRICHS), *forms("square")])
def test_shares_are_parts_of_the_square(form):
    """Their sum is at most S^2 and at least half of it."""
    rng = np.random.default_rng(10)
    residual, _ = make_residual("square", rng, [1.0, 1.0, 1.0, 0.1], form)
    total = residual.shares(residual.squares()).sum()
    S = residual.dual_norms()[1]
    assert 0.5 * S**2 * (1 - 1e-6) <= total <= S**2
