"""The bound of dual norms: its constants by independent computation, itself against true norms."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from nested import (
    RIGHT,
    Nested,
    assemble_by_elements,
    coarse,
    grade_mesh_levels,
    make_mesh_levels,
    prolongation,
    refine_mesh_levels,
)
from scipy.sparse.linalg import SuperLU, splu

from unilateral.fem import functional_norm
from unilateral.fem.functional_norm import (
    edge_weights,
    interpolation_constant,
    multilevel_dual_norm_bound,
    norm_bound_beyond_coarsest,
)
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon

Array = np.ndarray
ROUNDING = 1 + 1e-9


def energy(points: Array, triangles: Array) -> sp.csc_array:
    """(n, n) the products of the gradients of hats."""
    sides = points[triangles[:, [2, 0, 1]]] - points[triangles[:, [1, 2, 0]]]
    twice = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    entries = np.einsum("tid,tjd->tij", sides, sides) / (2 * twice)[:, None, None]
    position = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, 3).ravel()
    return sp.coo_array((entries.ravel(), position), shape=(len(points), len(points))).tocsc()


CUT = {  # triangles of the corners a, b, c, and the midpoints of bc, ca and ab; which of these there are
    2: ([[3, 0, 1], [3, 2, 0]], [3]),
    3: ([[5, 3, 0], [5, 1, 3], [3, 2, 0]], [3, 5]),
    4: ([[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]], [3, 4, 5]),
}


def add_midpoints(corners: Array) -> Array:
    """(..., 6, 2) the corners (..., 3, 2), and the midpoints opposite to them."""
    middle = 0.5 * (np.roll(corners, -1, axis=-2) + np.roll(corners, 1, axis=-2))
    return np.concatenate([corners, middle], axis=-2)


def descendants(halvings: int, rng: np.random.Generator | None = None) -> Array:
    """(T, 3, 2) of a right and isosceles triangle, each after so many halvings of its area.

    They are cut in four, and once by two if the number is odd; given `rng` in four or by two at random.
    """
    triangles = RIGHT.vertices[None]
    remaining = np.array([halvings])
    while remaining.any():
        four = (remaining > 1) & (True if rng is None else rng.random(len(remaining)) < 0.5)
        two = (remaining > 0) & ~four
        cut = [add_midpoints(triangles[selection])[:, CUT[k][0]] for selection, k in ((four, 4), (two, 2))]
        triangles = np.concatenate(
            [triangles[remaining == 0], *(children.reshape(-1, 3, 2) for children in cut)]
        )
        remaining = np.concatenate(
            [remaining[remaining == 0], np.repeat(remaining[four] - 2, 4), np.repeat(remaining[two] - 1, 2)]
        )
    return triangles


def largest_interpolation_ratio(triangles: Array) -> float:
    """The largest |I_0 v|_1^2 / |v|_1^2 for v on those triangles, all but the corners eliminated."""
    points, number = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    A = energy(points, number.reshape(-1, 3))
    corner = [int(np.argmin(np.abs(points - vertex).sum(axis=1))) for vertex in RIGHT.vertices]
    free = np.setdiff1d(np.arange(len(points)), corner)
    inner = splu(A[free][:, free].tocsc()).solve(A[free][:, corner].toarray())
    remaining = A[corner][:, corner].toarray() - A[corner][:, free] @ inner
    full_energy = energy(points[corner], np.array([[0, 1, 2]])).toarray()
    # Constants have no energy: the value at the first corner is 0.
    return float(np.linalg.eigvals(np.linalg.solve(remaining[1:, 1:], full_energy[1:, 1:])).real.max())


@cache
def lattice_constant(k: int) -> float:
    """M_k: the largest |I_0 v|_1^2 / |v|_1^2 on the criss-cross lattice of 2^k squares on each leg."""
    triangles = descendants(2 * k + 1)
    sides = 2**k * triangles[:, 1:]  # hypotenuses are sides of the squares
    assert len(triangles) == 2 * 4**k
    assert np.array_equal(sides, np.rint(sides))
    assert np.all(np.abs(np.diff(sides, axis=1)).sum(axis=(1, 2)) == 1)
    return largest_interpolation_ratio(triangles)


@pytest.mark.parametrize("k", range(8))
def test_what_interpolation_adds_to_the_energy_is_as_printed(k: int) -> None:
    exact = lattice_constant(k)
    assert exact <= functional_norm.INTERPOLATION_CONSTANTS[k] <= exact + 1e-3
    assert interpolation_constant(2 * k + 1) == functional_norm.INTERPOLATION_CONSTANTS[k]
    assert k == 0 or interpolation_constant(2 * k) == functional_norm.INTERPOLATION_CONSTANTS[k]


def test_interpolation_constants_grow_by_their_known_limit() -> None:
    """Of two halves of a triangle, and by how much many halvings add: (ln 2) / angle to each resistance."""
    assert lattice_constant(0) == pytest.approx(2)
    assert lattice_constant(7) - lattice_constant(6) == pytest.approx(math.log(2) * 4 / math.pi, rel=1e-3)
    assert interpolation_constant(0) == 1
    assert (
        interpolation_constant(16)
        == functional_norm.INTERPOLATION_CONSTANTS[7] * functional_norm.INTERPOLATION_CONSTANTS[1]
    )
    assert interpolation_constant(43) == functional_norm.INTERPOLATION_CONSTANTS[7] ** 3
    assert all(interpolation_constant(k) >= interpolation_constant(k - 1) for k in range(1, 100))


def steepest(children: int) -> float:
    """C: the largest sum of w_e^2 over |v|_1^2, v linear and so much higher at midpoints, by elimination."""
    triangles, new = CUT[children]
    points = add_midpoints(RIGHT.vertices)
    K = energy(points, np.array(triangles)).toarray()
    w = np.eye(6)[:, new]
    linear = points.T @ K @ points
    mixed = points.T @ K @ w
    return float(1 / np.linalg.eigvalsh(w.T @ K @ w - mixed.T @ np.linalg.solve(linear, mixed))[0])


@pytest.mark.parametrize("children", [2, 3, 4])
def test_hats_have_at_least_the_stated_energy(children: int) -> None:
    exact = steepest(children)
    assert exact <= functional_norm.CHILDREN_CONSTANTS[children] <= exact + 1e-3
    assert exact == pytest.approx({2: 1, 3: 1.4472, 4: 2}[children], abs=1e-4)


@pytest.mark.parametrize("halvings", [1, 2, 3, 5, 6, 7])
def test_descendants_have_at_most_the_energy_of_the_lattice_s(halvings: int) -> None:
    """However triangles are cut, each in two or four: of 2 k + 1 halvings it is M_k, and of 2 k no more."""
    rng = np.random.default_rng(halvings)
    max_interpolation_constant = functional_norm.INTERPOLATION_CONSTANTS[halvings // 2]
    for _ in range(30):
        largest_ratio = largest_interpolation_ratio(descendants(halvings, rng))
        assert largest_ratio <= max_interpolation_constant
        if halvings % 2:
            assert largest_ratio == pytest.approx(lattice_constant(halvings // 2), rel=1e-12)


@cache
def adapt_mesh_levels(name: str, times: int) -> Nested:
    """At the re-entrant corner of the L-shape, or in ever smaller parts at random."""
    if name != "lshape":
        return make_mesh_levels(name, "at random", times, 4)
    first = coarse("lshape 1")
    return grade_mesh_levels(first, int(np.argmin(np.hypot(*first.points.T))), times)


GRADED = [("lshape", 10), ("lshape", 20), ("gmsh", 10), ("flat", 8)]


def functionals(nested: Nested) -> list[Array]:
    """Random ones, rough and smooth, hats, those of one level, and what V-cycles leave of one."""
    rng = np.random.default_rng(5)
    A = nested.hierarchy.A
    n = A.shape[0]
    x, y = nested.mesh.points.T
    rough = rng.standard_normal(n)
    remaining = rough.copy()
    for _ in range(3):
        remaining = remaining - A @ functional_norm.apply_presmoothing_cycle(nested.hierarchy, remaining)
    first, last = np.zeros((2, n))
    first[n // 3] = last[-1] = 1.0
    smooth = np.sin(7 * x) * np.exp(y)
    return [
        rough,
        remaining,
        first,
        last,
        *(A @ v for v in (rough, smooth, np.ones(n))),
        *sample_levels(nested),
    ]


def sample_levels(nested: Nested) -> list[Array]:
    """For every third level A v of a random v of the hats that are new there, and numbers at those alone."""
    rng = np.random.default_rng(6)
    result = []
    for k, level in list(enumerate(nested.hierarchy.levels))[::3]:
        v = np.zeros(nested.hierarchy.n)
        v[level.n_coarse : level.n] = rng.standard_normal(level.n - level.n_coarse)
        result.append(v.copy())
        for finer in nested.hierarchy.levels[k + 1 :]:
            finer.prolong(v)
        result.append(nested.hierarchy.A @ v)
    return result


@cache
def factor(nested: Nested) -> SuperLU:
    return splu(assemble_by_elements(nested.mesh).tocsc())


def true_norm(nested: Nested, R: Array) -> float:
    return math.sqrt(R @ factor(nested).solve(R))


@pytest.mark.parametrize("name", ["square 1", "lshape 1", "gmsh", "one triangle"])
@pytest.mark.parametrize("refinements", [0, 1, 3, 5])
def test_the_bound_is_one_and_not_too_large(name: str, refinements: int) -> None:
    nested = make_mesh_levels(name, "uniform", refinements)
    for R in functionals(nested):
        index = multilevel_dual_norm_bound(nested.hierarchy, R) / true_norm(nested, R)
        # log2(1/h) = 5 terms, each too large by less than 2.
        assert 1 / ROUNDING <= index < 10


@pytest.mark.parametrize(("name", "times"), GRADED)
def test_the_bound_is_one_and_not_too_large_on_adapted_meshes(name: str, times: int) -> None:
    """10 at 10 levels, over the root of the roundness; deeper, M is a product, and its root counts twice."""
    mesh = adapt_mesh_levels(name, times)
    maximum = (
        10 / math.sqrt(mesh.hierarchy.roundness.min())
        if times <= 10
        else 2 * math.sqrt(interpolation_constant(2 * times))
    )
    for R in functionals(mesh):
        index = multilevel_dual_norm_bound(mesh.hierarchy, R) / true_norm(mesh, R)
        assert 1 / ROUNDING <= index < maximum


def test_without_refinement_the_norm_is_exact() -> None:
    nested = make_mesh_levels("gmsh", "uniform", 0)
    for R in functionals(nested):
        assert multilevel_dual_norm_bound(nested.hierarchy, R) == pytest.approx(true_norm(nested, R))


def shrunk(mesh: Mesh, factor: float) -> Mesh:
    """The same triangles with all lengths times a factor."""
    polygon = Polygon(factor * mesh.polygon.vertices)
    return meshes.from_arrays(polygon, factor * mesh.points, mesh.triangles)


def worst(leg: float) -> tuple[float, float]:
    """Bound and true norm of R = (v, .)_1 on a triangle cut in four, v the function for which (2) is sharp.

    Of v, as linear functions are orthogonal to it, (3) is then, too. The mass, which makes the norm smaller,
    vanishes with the leg.
    """
    mesh = refine_mesh_levels(shrunk(coarse("one triangle"), leg), 1)
    A = mesh.hierarchy.A.toarray()
    P = prolongation(mesh.hierarchy.levels[0]).toarray()
    hierarchical = np.column_stack([P, np.eye(6)[:, 3:]])
    H = hierarchical.T @ A @ hierarchical
    K = H[3:, 3:] - H[3:, :3] @ np.linalg.solve(H[:3, :3], H[:3, 3:])
    w = np.linalg.eigh(K)[1][:, 0]
    v = hierarchical @ np.concatenate([-np.linalg.solve(H[:3, :3], H[:3, 3:] @ w), w])
    R = A @ v
    return norm_bound_beyond_coarsest(mesh.hierarchy, R), true_norm(mesh, R)


def test_the_constants_cannot_be_smaller() -> None:
    bound, exact = worst(1e-4)
    assert exact <= bound * ROUNDING
    assert exact > 0.999 * bound


def shares(nested: Nested, k: int) -> sp.csr_array:
    """(edges, n) the numbers w_e of level k, from values at the nodes."""
    step = nested.hierarchy.levels[k].step
    rows = np.arange(len(step.ends))
    new = step.n_old_nodes + np.arange(len(step.ends))
    entries = np.repeat([1.0, -0.5, -0.5], len(rows))
    position = np.tile(rows, 3), np.concatenate([new, *step.ends.T])
    return sp.coo_array((entries, position), shape=(len(rows), nested.hierarchy.n)).tocsr()


def largest(nested: Nested, k: int) -> float:
    """The largest sum of w_e^2 rho_e over |v|_1^2, up to the mass, which is nothing on a small domain."""
    W = shares(nested, k).toarray()
    rho = list(edge_weights(nested.hierarchy))[::-1][k]
    S = np.sqrt(rho)[:, None] * W
    return float(np.linalg.eigvalsh(S @ factor(nested).solve(S.T.copy()))[-1])


@pytest.mark.parametrize(("name", "times"), [("lshape", 6), ("lshape", 12), ("gmsh", 5), ("flat", 6)])
def test_every_level_s_part_is_at_most_the_energy(name: str, times: int) -> None:
    mesh = adapt_mesh_levels(name, times)
    assert max(largest(mesh, k) for k in range(len(mesh.hierarchy.levels))) <= ROUNDING


def test_what_finer_levels_hide_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were M 1 for all, a level's part would be larger than the energy, and the bound below the norm."""
    nested = make_mesh_levels("one triangle", "uniform", 5)
    monkeypatch.setattr(functional_norm, "interpolation_constant", lambda halvings: 1.0)
    assert largest(nested, 0) > 1.5


def test_weights_are_those_of_the_triangles_at_an_edge() -> None:
    """Found from the places of triangles: C from halved edges, M from the smallest one in each child."""
    for nested in (
        adapt_mesh_levels("gmsh", 4),
        adapt_mesh_levels("flat", 5),
        make_mesh_levels("square 1", "uniform", 3),
    ):
        for k, rho in enumerate(reversed(list(edge_weights(nested.hierarchy)))):
            np.testing.assert_allclose(rho, again(nested, k), rtol=1e-9)


def again(nested: Nested, k: int) -> Array:
    before = nested.meshes[k]
    after = nested.meshes[k + 1]
    last = nested.mesh
    first = nested.meshes[0]
    position = {
        tuple(sorted(ends)): e for e, ends in enumerate(nested.hierarchy.levels[k].step.ends.tolist())
    }
    parent = locate_fine_triangles(before, after)
    child = locate_fine_triangles(after, last)
    root = locate_fine_triangles(first, before)
    smallest = np.full(len(after.areas), np.inf)
    np.minimum.at(smallest, child, last.areas)
    growths = np.array([interpolation_constant(round(x)) for x in np.log2(after.areas / smallest).tolist()])
    rho = np.zeros(len(position))
    for t, (a, b, c) in enumerate(before.triangles.tolist()):
        halved = [
            position[e] for e in (tuple(sorted(pair)) for pair in ((b, c), (c, a), (a, b))) if e in position
        ]
        if halved:
            C = {1: 1.0001, 2: 1.4473, 3: 2.0001}[len(halved)]
            rho[halved] += nested.hierarchy.roundness[root[t]] / (C * growths[parent == t].max())
    return rho


def locate_fine_triangles(coarse: Mesh, fine: Mesh) -> Array:
    """(m,) the coarse triangle in which each fine one lies."""
    centre = fine.points[fine.triangles].mean(axis=1)
    a, b, c = np.moveaxis(coarse.points[coarse.triangles], 1, 0)
    edges = np.stack([b - a, c - a], axis=2)
    share = np.linalg.solve(edges[:, None], (centre[None] - a[:, None])[..., None])[..., 0]
    hit = (share > 0).all(axis=2) & (share.sum(axis=2) < 1)
    assert np.all(hit.sum(axis=0) == 1)
    return np.argmax(hit, axis=0)


def test_neither_term_alone_bounds_the_norm() -> None:
    single_nested = make_mesh_levels("square 1", "uniform", 0)
    assert norm_bound_beyond_coarsest(single_nested.hierarchy, functionals(single_nested)[0]) == 0
    nested = make_mesh_levels("square 1", "uniform", 5)
    rough = functionals(nested)[0]
    z = functional_norm.apply_presmoothing_cycle(nested.hierarchy, rough)
    assert math.sqrt(z @ nested.hierarchy.A @ z) < true_norm(nested, rough)


@pytest.mark.parametrize("way", ["uniform", "adapted"])
def test_the_rest_vanishes_on_the_coarsest_space(way: str) -> None:
    nested = make_mesh_levels("lshape 1", "uniform", 4) if way == "uniform" else adapt_mesh_levels("gmsh", 10)
    R = functionals(nested)[0]
    remaining = R - nested.hierarchy.A @ functional_norm.apply_presmoothing_cycle(nested.hierarchy, R)
    for level in nested.hierarchy.levels[::-1]:
        P = prolongation(level)
        R = P.T @ R
        remaining = P.T @ remaining
    assert np.abs(remaining).max() < 1e-12 * np.abs(R).max()


def test_what_is_doubtful_is_added() -> None:
    """A functional that is known up to a millionth: the bound is one for all that it may be."""
    mesh = adapt_mesh_levels("gmsh", 5)
    R = functionals(mesh)[1]
    n = mesh.hierarchy.n
    doubt = 1e-6 * np.abs(np.random.default_rng(3).standard_normal(n))
    for sign in (np.ones(n), np.sign(R), np.sign(np.random.default_rng(4).standard_normal(n))):
        assert true_norm(mesh, R + sign * doubt) <= multilevel_dual_norm_bound(mesh.hierarchy, R, doubt)
    assert (
        multilevel_dual_norm_bound(mesh.hierarchy, 0 * R)
        == 0
        < true_norm(mesh, doubt)
        <= multilevel_dual_norm_bound(mesh.hierarchy, 0 * R, doubt)
    )


# What rounding may have done, term by term

FAN = 12


@cache
def fan() -> Nested:
    """Twelve triangles around node 0, refined once: node 0 is an end of twelve halved edges."""
    angle = 2 * np.pi * np.arange(FAN) / FAN
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    around = np.arange(FAN)
    triangles = np.column_stack([0 * around, 1 + around, 1 + (around + 1) % FAN])
    return refine_mesh_levels(meshes.from_arrays(Polygon(rim), np.vstack([[0.0, 0.0], rim]), triangles), 1)


def test_a_functional_that_cancels_on_the_coarsest_space_is_known_up_to_its_rounding() -> None:
    """1 + 10 slivers - 1, each half of a number at a midpoint: computed it is 0, exactly ten slivers."""
    level = fan().hierarchy.levels[0]
    sliver = 0.99 * 2.0**-53
    R = np.zeros(fan().hierarchy.n)
    ends = level.step.ends
    spokes = level.n_coarse + np.flatnonzero((ends == 0).any(axis=1))
    assert len(spokes) == FAN == level.max_summands - 1
    R[spokes] = 2 * np.array([1.0, *[sliver] * (FAN - 2), -1.0])
    on_coarse = R.copy()
    level.restrict(on_coarse)
    assert on_coarse[0] == 0
    assert functional_norm._bound_coarse_remainder(fan().hierarchy, R)[0] >= (FAN - 2) * sliver


def test_numbers_of_a_functional_are_rounded_on_all_levels() -> None:
    R = np.random.default_rng(1).standard_normal(fan().hierarchy.n)
    assert np.all(functional_norm._bound_coarse_remainder(fan().hierarchy, R) >= 2.0**-53 * np.abs(R))


def test_what_a_functional_has_on_the_coarsest_space_is_doubt() -> None:
    """(3) is for functionals that vanish there; here one is 1 on the hat of node 0."""
    R = np.zeros(fan().hierarchy.n)
    R[0] = 1.0
    assert functional_norm._bound_coarse_remainder(fan().hierarchy, R)[0] >= 1


def test_the_rounding_of_A_z_counts_for_the_norm_of_z_and_for_what_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """||z|| <= (z . values)^(1/2) + ||doubt||, and R - A z is known up to that doubt, too."""
    nested = make_mesh_levels("square 1", "uniform", 2)
    R = functionals(nested)[0]
    doubt = np.full(nested.hierarchy.n, 1e6)
    original = functional_norm.residual_rounding.product_with_rounding
    monkeypatch.setattr(
        functional_norm.residual_rounding,
        "product_with_rounding",
        lambda *arguments: original(*arguments)._replace(rounding=doubt),
    )
    once = functional_norm.residual_rounding.lumped_dual_norm_bound(doubt, nested.hierarchy.nodal_weights)
    assert 2 * once <= multilevel_dual_norm_bound(nested.hierarchy, R) <= 2 * once * 1.001


def test_norms_are_rounded_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """By SLACK: that of z, and the sums of (3); twice as large a SLACK doubles what is not a doubt."""
    nested = make_mesh_levels("square 1", "uniform", 2)
    R = functionals(nested)[0]
    before = multilevel_dual_norm_bound(nested.hierarchy, R), norm_bound_beyond_coarsest(nested.hierarchy, R)
    slack = functional_norm.residual_rounding.NORM_ROUNDING_FACTOR
    monkeypatch.setattr(functional_norm.residual_rounding, "NORM_ROUNDING_FACTOR", 2 * slack)
    after = multilevel_dual_norm_bound(nested.hierarchy, R), norm_bound_beyond_coarsest(nested.hierarchy, R)
    assert after == pytest.approx((2 * before[0], 2 * before[1]), rel=1e-9)
