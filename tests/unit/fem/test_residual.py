"""The bound of dual norms: its constants by independent computation, itself against true norms."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from nested import Nested, refined
from scipy.sparse.linalg import SuperLU, splu

from unilateral.fem import residual
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.fem.residual import dual_norm, growth, without_coarsest
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon, named
from unilateral.geometry.structured import structured

ROUNDING = 1 + 1e-9


def equilateral(side: float = 1.0) -> Mesh:
    corners = side * np.array([[0, 0], [1, 0], [0.5, math.sqrt(0.75)]])
    return meshes.from_arrays(Polygon(corners), corners, [[0, 1, 2]])


@cache
def nested(name: str, refinements: int) -> Nested:
    if name == "equilateral":
        return refined(equilateral(), refinements)
    if name == "gmsh":
        return refined(meshes.unstructured(named("lshape"), 0.4), refinements)
    return refined(structured(named(name), 1), refinements)


def least_energy(k: int) -> float:
    """Of v = 0, 1 at two nodes of an equilateral triangle refined k times, over that for k = 0."""
    found = nested("equilateral", k)
    K = stiffness_and_mass(found.mesh)[0]
    v = np.zeros(found.mesh.n_nodes)
    v[1] = 1
    free = np.arange(2, len(v))
    v[2:] = splu(K[free][:, free].tocsc()).solve(-(K @ v)[2:])
    return float(v @ K @ v) / (math.sqrt(3) / 4)


def test_energies_of_refined_triangles_fall_as_stated() -> None:
    exact = [1 / least_energy(k) for k in range(residual.COMPUTED + 1)]
    bounds = [growth(k) for k in range(residual.COMPUTED + 1)]
    assert exact[1] == pytest.approx(1.6)
    assert all(0.9 * b < e <= b * ROUNDING for e, b in zip(exact, bounds, strict=True))
    assert not all(e <= 1 + 0.57 * k for k, e in enumerate(exact))
    # In the limit ln 2 / angle more resistance at each of two corners.
    assert exact[-1] - exact[-2] == pytest.approx(math.sqrt(3) / 2 * math.log(2) / (math.pi / 3), rel=1e-6)
    assert growth(11) == growth(9) * growth(2)


def test_hats_of_an_equilateral_triangle_have_at_least_the_stated_energy() -> None:
    level = nested("equilateral", 1).levels[1]
    hierarchical = np.column_stack([level.P.toarray(), np.eye(6)[:, 3:]])
    K = stiffness_and_mass(nested("equilateral", 1).mesh)[0].toarray()
    K = hierarchical.T @ K @ hierarchical
    schur = K[3:, 3:] - K[3:, :3] @ np.linalg.pinv(K[:3, :3]) @ K[:3, 3:]
    values, vectors = np.linalg.eigh(schur)
    assert values[0] == pytest.approx(1 / math.sqrt(3))
    assert np.allclose(np.abs(vectors[:, 0]), 1 / math.sqrt(3))


def functionals(found: Nested) -> list[np.ndarray]:
    """Random ones, rough and smooth, and what a V-cycle leaves of one."""
    rng, A = np.random.default_rng(5), found.levels[-1].A
    n = A.shape[0]
    x, y = found.mesh.points.T
    rough = rng.standard_normal(n)
    left = rough.copy()
    for _ in range(3):
        left = left - A @ residual.downwards(found.levels, coarsest(found), left)
    one = np.zeros(n)
    one[n // 3] = 1.0
    return [rough, left, one, A @ rough, A @ (np.sin(7 * x) * np.exp(y)), A @ np.ones(n)]


def coarsest(found: Nested) -> SuperLU:
    return splu(found.levels[0].A.tocsc())


def true_norm(found: Nested, R: np.ndarray) -> float:
    return math.sqrt(R @ splu(found.levels[-1].A.tocsc()).solve(R))


@pytest.mark.parametrize("name", ["square", "lshape", "gmsh", "equilateral"])
@pytest.mark.parametrize("refinements", [0, 1, 3, 5])
def test_the_bound_is_one_and_not_too_large(name: str, refinements: int) -> None:
    found = nested(name, refinements)
    for R in functionals(found):
        index = dual_norm(found.levels, coarsest(found), R) / true_norm(found, R)
        # log2(1/h) = 5 terms, each too large by less than 2.
        assert 1 / ROUNDING <= index < 10


def test_without_refinement_the_norm_is_exact() -> None:
    found = nested("gmsh", 0)
    for R in functionals(found):
        assert dual_norm(found.levels, coarsest(found), R) == pytest.approx(true_norm(found, R))


def worst(side: float) -> tuple[float, float]:
    """Bound and true norm of R = (v, .)_1, v the new hats of an equilateral triangle refined once.

    For these (1) is an equality; the mass, which makes the norm smaller, vanishes with the side.
    """
    found = refined(equilateral(side), 1)
    R = found.levels[-1].A @ np.array([0.0, 0, 0, 1, 1, 1])
    return without_coarsest(found.levels, R), true_norm(found, R)


def test_the_constants_cannot_be_smaller() -> None:
    bound, exact = worst(1e-4)
    assert exact <= bound * ROUNDING
    assert exact > 0.99 * bound


def test_both_terms_are_needed() -> None:
    alone = nested("square", 0)
    assert without_coarsest(alone.levels, functionals(alone)[0]) == 0
    found = nested("square", 5)
    rough = functionals(found)[0]
    z = residual.downwards(found.levels, coarsest(found), rough)
    assert math.sqrt(z @ found.levels[-1].A @ z) < true_norm(found, rough)


def test_the_rest_vanishes_on_the_coarsest_space() -> None:
    found = nested("lshape", 4)
    R = functionals(found)[0]
    left = R - found.levels[-1].A @ residual.downwards(found.levels, coarsest(found), R)
    for level in found.levels[:0:-1]:
        R, left = level.P.T @ R, level.P.T @ left
    assert np.abs(left).max() < 1e-12 * np.abs(R).max()
