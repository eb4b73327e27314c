"""Bounds of rounding against 60 digits, and the dual norm of what they bound."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from flint import arb, ctx

from unilateral.arrays import Array
from unilateral.fem import rounded
from unilateral.fem.p1 import coupling, lumped_mass, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import named

DIGITS = 60
LSHAPE = named("lshape")
MESH = meshes.unstructured(LSHAPE, 0.3)
A = sp.csr_array(sum(stiffness_and_mass(MESH)))
MASS = lumped_mass(MESH)


@pytest.fixture(autouse=True)
def digits():
    before, ctx.dps = ctx.dps, DIGITS
    yield
    ctx.dps = before


def vectors(n: int) -> list[Array]:
    """Rough ones, and large constants with a little more, at several sizes."""
    rng = np.random.default_rng(8)
    return [
        size * (constant + rng.standard_normal(n))
        for size in (1e-90, 1, 1e90)
        for constant in (0, 1, 1e6, 1e15)
    ]


def row_times(matrix: sp.csr_array, i: int, u: list[arb]) -> arb:
    of = slice(matrix.indptr[i], matrix.indptr[i + 1])
    pairs = zip(matrix.data[of].tolist(), matrix.indices[of].tolist(), strict=True)
    return sum((arb(a) * u[j] for a, j in pairs), arb(0))


def shares(found: rounded.Rounded, exact: list[arb]) -> Array:
    """(k,) errors over their bounds."""
    triples = zip(found.values.tolist(), found.doubt.tolist(), exact, strict=True)
    return np.array([float((abs(arb(value) - true) / arb(doubt)).upper()) for value, doubt, true in triples])


def assert_bounds(all_shares: list[Array]) -> None:
    """No error is above its bound; one of a fiftieth would be missed."""
    largest = max(each.max() for each in all_shares)
    assert 0.02 < largest <= 1


def test_products_with_the_matrix() -> None:
    """Its diagonal is what makes the rows add up to the mass."""
    found = []
    for u in vectors(len(MASS)):
        numbers = [arb(value) for value in u.tolist()]
        exact = []
        for i, m in enumerate(MASS.tolist()):
            differences = [value - numbers[i] for value in numbers]
            exact.append(arb(m) * numbers[i] + row_times(A, i, differences))
        found.append(shares(rounded.product(A, MASS, u), exact))
    assert_bounds(found)


def test_residuals_and_loads() -> None:
    B = coupling(MESH, uniform(LSHAPE, 0.7))
    found = []
    for u in vectors(len(MESH.boundary)):
        pressure = np.abs(u[: B.shape[0]])
        pull = B.T.tocsr()
        numbers = [arb(value) for value in pressure.tolist()]
        exact = [arb(load) + row_times(pull, i, numbers) for i, load in enumerate(u.tolist())]
        found.append(shares(rounded.loaded(u, B, pressure), exact))
    assert_bounds(found)


def test_means_and_integrals_of_what_is_above_the_obstacle() -> None:
    cells = uniform(LSHAPE, 0.7)
    B, lengths = coupling(MESH, cells), cells.lengths
    of_means, of_integrals = [], []
    for u in vectors(len(MESH.boundary)):
        numbers, g = [arb(value) for value in u.tolist()], B @ u / lengths
        integrals = [row_times(B, i, numbers) for i in range(len(g))]
        means = [
            each / arb(H) - arb(d) for each, H, d in zip(integrals, lengths.tolist(), g.tolist(), strict=True)
        ]
        of_means.append(shares(rounded.constrained(B, u, g, lengths), means))
        d = B @ u
        minus = [each - arb(value) for each, value in zip(integrals, d.tolist(), strict=True)]
        of_integrals.append(shares(rounded.constrained(B, u, d), minus))
    assert_bounds(of_means)
    assert_bounds(of_integrals)


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_the_dual_norm_at_every_size(size: float) -> None:
    """Against (R . A^{-1} R)^(1/2) at size 1; the squares of these numbers would vanish, or be infinite."""
    R = np.random.default_rng(1).standard_normal(len(MASS))
    exact = np.sqrt(R @ np.linalg.solve(A.toarray(), R))
    assert exact <= rounded.dual_norm(size * R, MASS) / size < 20 * exact
    assert rounded.root(size * R, size * R) / size == pytest.approx(np.linalg.norm(R))
    assert rounded.root(R, -R) == 0
    assert rounded.root(0 * R, R) == 0
    assert rounded.dual_norm(0 * R, MASS) == 0


def test_the_dual_norm_of_the_mass_is_nearly_twice_its_own() -> None:
    """R = M 1 has ||R|| = |Omega|^(1/2), and 2 (sum m_i)^(1/2) is twice that: no factor below 1 is left."""
    assert rounded.dual_norm(MASS, MASS) == pytest.approx(2 * np.sqrt(LSHAPE.area))
