"""||.||_{-1/2} between bounds: against a closed form, cosine series, uniform P2 and finer spaces."""

from fractions import Fraction
from functools import cache
from math import pi, sqrt

import numpy as np
import pytest
import sentences
from boundary_norms import (
    POLYGONS,
    Flux,
    alternating,
    bound_by_series,
    bound_p0_on_bottom,
    brackets,
    norm_on,
    one_on_a_square,
    p0_coefficients,
    p2_gram,
)
from conftest import load
from numpy.testing import assert_allclose
from scipy.special import beta, betainc

from unilateral.errors import InputError
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import find_polygon, square
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.problems import case as cases

ONE_ON_THE_SQUARE = one_on_a_square(1.0)
CASE = """
title: a transition at a third, contact up to 7/12
polygons: any
u: [{{ atom: harmonic, side: 0, at: 1/3, alpha: {alpha}, cutoff: 1/4 }}]
gap: {{ elsewhere: 1 }}
hypotheses: {{ j: true, jj: true, jjj: true }}
asymptotic: {{ reason: none, h1: {{ from: 1/8 }}, hm12: {{ from: 1/8 }}, l2: {{ from: 1/8 }} }}
"""


COSINES = 2000
R = 1 / 4


@cache
def cosine_coefficients(alpha):
    """(COSINES + 1,) of lambda of CASE, by Gauss's rule in t for s = R t^4."""
    x, w = np.polynomial.legendre.leggauss(8)
    t = ((np.arange(1000)[:, None] + 0.5 * (x + 1)) / 1000).ravel()
    weighted = np.tile(w / 2000, 1000) * 4 * R * t**3 * (R * t**4) ** alpha * (1 - t**8) ** 4
    blocks = np.array_split(np.arange(1, COSINES + 1), 20)
    waves = [np.cos(pi * np.outer(k, 1 / 3 + R * t**4)) @ weighted for k in blocks]
    return np.concatenate([[weighted.sum()], sqrt(2) * np.concatenate(waves)])


def bound_projection_error(m, alpha):
    """||lambda - Pi_H lambda||_{-1/2} for CASE: means by Euler's beta, and the cosine series."""
    points = np.arange(m + 1) / m
    p = (1 + alpha) / 2
    inside = np.clip((points - 1 / 3) / R, 0, 1)
    means = m * np.diff(R ** (1 + alpha) / 2 * beta(p, 5) * betainc(p, 5, inside**2))
    coefficients = cosine_coefficients(alpha) - p0_coefficients(points, means, COSINES)
    return bound_by_series(coefficients, 4 * R**alpha)  # the means vary no more than lambda


@pytest.mark.parametrize("m", [2, 3, 8, 12])
def test_the_norm_of_1_on_the_square_lies_in_its_bracket(m):
    """The maximiser is smooth; 1e-5 is asked for."""
    bracket = norm_on("square", m).bound_p0(np.ones((1, 4 * m)))
    assert bracket.lower <= ONE_ON_THE_SQUARE * (1 + 1e-12)
    assert bracket.upper >= ONE_ON_THE_SQUARE * (1 - 1e-12)
    assert_allclose(bracket, ONE_ON_THE_SQUARE, rtol=1e-5)


def test_the_weighted_l2_norm_is_not_this_norm():
    """Control: H^{1/2} ||1||_0 is too small by a factor of 5.8 at H = 1/8."""
    shortcut = sqrt(1 / 8) * sqrt(4)
    assert pytest.approx(5.8, abs=0.05) == ONE_ON_THE_SQUARE / shortcut
    assert norm_on("square", 8).bound_p0(np.ones((1, 32))).lower / shortcut > 5.75


@pytest.mark.parametrize("m", [4, 12])
@pytest.mark.parametrize("name", ["alternating", "one cell", "random"])
def test_the_norm_of_p0_data_on_one_side_is_that_by_the_cosine_series(m, name):
    mu = {
        "alternating": (-1.0) ** np.arange(m),
        "one cell": (np.arange(m) == 1).astype(float),
        "random": np.random.default_rng(1).standard_normal(m),
    }[name]
    bracket = norm_on("square", m).bound_p0(np.concatenate([mu, np.zeros(3 * m)])[None])
    assert brackets(bracket, *bound_p0_on_bottom(np.arange(m + 1) / m, mu), gap=0.005)


@pytest.mark.parametrize("alpha", ["1/2", "1/20"])
@pytest.mark.parametrize("m", [4, 8, 16])
def test_the_error_of_a_singular_lambda_is_that_by_its_cosine_series(m, alpha, tmp_path):
    (tmp_path / "atom.yaml").write_text(CASE.format(alpha=alpha))
    case = cases.load_solution(tmp_path / "atom.yaml", square())
    cells = partitions.make_uniform_partition(square(), 1 / m)
    error = build_dual_norm(cells, [case]).bound_error(case, cell_means(case, cells).lambda_means[None])
    assert brackets(error, *bound_projection_error(m, float(Fraction(alpha))), gap=0.05)


@pytest.mark.parametrize(
    ("cells", "n"),
    [
        (partitions.make_uniform_partition(square(), 1 / 8), 64),
        (partitions.make_shifted_partition(square(), 1 / 4, 0.5), 64),
        (partitions.make_uniform_partition(find_polygon("lshape"), 1 / 4), 32),
    ],
    ids=["square", "shifted", "lshape"],
)
def test_norms_of_alternating_and_random_data_are_those_by_uniform_p2(cells, n):
    """The uniform meshes have at least 8 edges to a cell of length H; they resolve the norm to 1 %."""
    mu = np.stack([alternating(cells), np.random.default_rng(2).standard_normal(cells.n_cells)])
    below = np.sqrt(np.einsum("ki,ij,kj->k", mu, p2_gram(cells, n), mu))
    assert brackets(build_dual_norm(cells).bound_p0(mu), below, 1.01 * below, gap=0.005)


@pytest.mark.parametrize("name", POLYGONS)
def test_brackets_overlap_those_of_finer_spaces_at_angles_of_all_sizes(name):
    """Bounds of one number overlap; three times the edges leave at most a third of the limit, 0.5 %."""
    cells = partitions.make_uniform_partition(POLYGONS[name], 1 / 3)
    mu = np.stack([alternating(cells), *np.random.default_rng(3).standard_normal((3, cells.n_cells))])
    coarse = norm_on(name, 3, 8).bound_p0(mu)
    fine = norm_on(name, 3, 24).bound_p0(mu)
    assert brackets(coarse, fine.lower, fine.upper, gap=0.005)
    assert brackets(fine, coarse.lower, coarse.upper, gap=0.005 / 3)


@pytest.fixture(scope="module")
def norms_at_a_point(request):
    """A place on side 0 of a polygon, and norms on a coarse and a fine mesh that are graded to it.

    The meshes do not depend on the power of the singularity there.
    """
    name, position = request.param
    cells = partitions.make_uniform_partition(POLYGONS[name], 1 / 3)
    case = Flux(POLYGONS[name], position, Fraction(1, 2))
    return position, *(build_dual_norm(cells, [case], edges) for edges in (8, 24))


@pytest.mark.parametrize(
    "norms_at_a_point",
    [*((name, 0.4) for name in POLYGONS), ("square", 0.0)],
    indirect=True,
    scope="module",
    ids=[*POLYGONS, "a vertex"],
)
@pytest.mark.parametrize("alpha", [Fraction(1, 2), Fraction(1, 20), Fraction(-1, 4)])
def test_brackets_overlap_those_of_finer_spaces_at_singular_points_and_a_vertex(norms_at_a_point, alpha):
    """As above, with the limit for errors, 5 %."""
    position, coarse_norm, fine_norm = norms_at_a_point
    cells = coarse_norm.partition
    case = Flux(cells.polygon, position, alpha)
    means = cell_means(case, cells).lambda_means[None]
    coarse = coarse_norm.bound_error(case, means)
    fine = fine_norm.bound_error(case, means)
    assert brackets(coarse, fine.lower, fine.upper, gap=0.05)
    assert brackets(fine, coarse.lower, coarse.upper, gap=0.05 / 3)


def test_the_norm_is_homogeneous_and_takes_many_at_once():
    mu = np.random.default_rng(0).standard_normal((3, 16))
    norm = norm_on("square", 4)
    bracket = norm.bound_p0(mu)
    assert bracket.lower.shape == bracket.upper.shape == (3,)
    assert_allclose(norm.bound_p0(-2.5 * mu), 2.5 * np.array(bracket), rtol=1e-12)
    assert_allclose([np.ravel(norm.bound_p0(row[None])) for row in mu], np.transpose(bracket), rtol=1e-12)
    assert_allclose(norm.bound_p0(np.zeros((1, 16))), 0)


@pytest.mark.parametrize(("name", "vertex"), [("lshape", 2), ("re-entrant", 3)])
def test_the_mesh_is_graded_to_a_re_entrant_vertex(name, vertex):
    """Eight halvings at both edges there, none at the other vertices, whose cells are about as long."""
    mesh = norm_on(name, 4).spaces.mesh
    edges = np.diff(mesh.s)
    index = np.searchsorted(mesh.s, mesh.polygon.starts[:-1])
    longer = np.maximum(edges[index], edges[index - 1])
    assert longer[vertex] < np.delete(longer, vertex).min() / 2**7


@pytest.mark.parametrize("alpha", [Fraction(-1, 2), Fraction(-3, 5)])
def test_a_flux_outside_L2_has_a_lower_bound_only(alpha):
    """What oscillates has no bound in L2; nor have L2 norms a value. Control: alpha = -2/5 has all."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    for case, in_L2 in ((Flux(square(), 0.4, alpha), False), (Flux(square(), 0.4, Fraction(-2, 5)), True)):
        norm = build_dual_norm(cells, [case])
        means = cell_means(case, cells)
        for bracket in (
            norm.bound_error(case, means.lambda_means[None]),
            norm.gram([case]).error_bounds(0, np.zeros((1, 16))),
        ):
            assert bracket.lower[0] > 0
            assert np.isfinite(bracket.upper[0]) == in_L2
        assert (
            np.isfinite(
                [means.lambda_norm, means.projection_error, means.l2_error(0 * means.lambda_means)]
            ).all()
            == in_L2
        )


@cache
def build_norm_and_gram(name, m):
    """A norm, its cases and their Gram matrices."""
    polygon = POLYGONS[name]
    fluxes = [Flux(polygon, 0.4, Fraction(1, 2)), load("thirds", polygon.name)]
    norm = build_dual_norm(partitions.make_uniform_partition(polygon, 1 / m), fluxes)
    return norm, fluxes, norm.gram(fluxes)


@pytest.mark.parametrize(("m", "rounding"), [(4, 1e-9), (2, 1e-8)])
@pytest.mark.parametrize("name", ["square", "lshape"])
def test_the_gram_matrices_give_what_a_direct_evaluation_gives(name, m, rounding):
    """Also on a coarser partition, whose P0 lies in the finer P0: on the same reference mesh."""
    norm, functionals, gram = build_norm_and_gram(name, 4)
    cells = partitions.make_uniform_partition(POLYGONS[name], 1 / m)
    gram = gram if m == 4 else gram.coarsen(cells)
    mu = np.random.default_rng(5).standard_normal((3, cells.n_cells))
    computed = [np.sqrt(np.einsum("ki,ij,kj->k", mu, G, mu)) for G in gram.p0]
    assert_allclose(computed, norm.bound_p0(mu, cells), rtol=1e-9)
    for c, case in enumerate(functionals):
        means = cell_means(case, cells).lambda_means
        assert_allclose(gram.means[c], means, rtol=0, atol=1e-12)
        for scale in (1.0, 1e-3, 0.0):
            expected = norm.bound_error(case, means + scale * mu, cells)
            assert_allclose(gram.error_bounds(c, -scale * mu), expected, rtol=rounding)


def test_the_forms_of_a_partition_are_its_own():
    norm, _, gram = build_norm_and_gram("square", 4)
    for coarse_form, form in zip(
        vars(gram.coarsen(norm.partition)).values(), vars(gram).values(), strict=True
    ):
        assert_allclose(coarse_form, form, rtol=1e-12, atol=1e-15)


def test_a_partition_that_is_not_nested_has_no_forms_here():
    with sentences.raises(InputError):
        build_norm_and_gram("square", 4)[2].coarsen(
            partitions.make_uniform_partition(POLYGONS["square"], 1 / 3)
        )


@pytest.mark.parametrize("name", ["square", "lshape"])
def test_the_bounds_are_ordered_as_forms(name):
    gram = build_norm_and_gram(name, 4)[2]
    for form in (gram.lower, gram.upper - gram.lower):
        assert np.linalg.eigvalsh(form)[0] >= -1e-12 * np.linalg.norm(gram.upper, 2)


def test_the_best_approximation_follows_from_direct_evaluations():
    """Their square is quadratic in mu_H; its least value follows from those at 21 places."""
    norm, functionals, gram = build_norm_and_gram("square", 1)
    n = norm.partition.n_cells
    first_value = np.eye(n)
    places = np.vstack([np.zeros(n), first_value, (first_value[:, None] + first_value).reshape(-1, n)])
    for c, case in enumerate(functionals):
        means = cell_means(case, norm.partition).lambda_means
        squares = norm.bound_error(case, means + places).lower ** 2
        at_means = squares[0]
        single = squares[1 : n + 1]
        double = squares[n + 1 :].reshape(n, n)
        second = double - single - single[:, None] + at_means
        first = single - at_means - 0.5 * np.diag(second)
        best = at_means - 0.5 * first @ np.linalg.solve(second, first)
        assert gram.best_approximations[c] == pytest.approx(sqrt(best), rel=1e-6)
        assert gram.best_approximations[c] < sqrt(at_means)
