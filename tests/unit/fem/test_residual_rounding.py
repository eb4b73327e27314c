"""Bounds of rounding against 60 digits, and the dual norm of what they bound."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from flint import arb, ctx
from nested import assemble_by_elements

from unilateral.arrays import Array
from unilateral.fem import residual_rounding
from unilateral.fem.p1 import coupling, lumped_mass
from unilateral.fem.residual_rounding import Rounded
from unilateral.geometry import mesh as meshes
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import find_polygon

DIGITS = 60
LSHAPE = find_polygon("lshape")
MESH = meshes.make_unstructured_mesh(LSHAPE, 0.3)
A = assemble_by_elements(MESH)
MASS = lumped_mass(MESH)
CELLS = make_uniform_partition(LSHAPE, 0.7)
B = coupling(MESH, CELLS)


@pytest.fixture(autouse=True)
def digits():
    before = ctx.dps
    ctx.dps = DIGITS
    yield
    ctx.dps = before


def exactly(u: Array) -> list[arb]:
    return [arb(value) for value in u.tolist()]


def row_times(matrix: sp.csr_array, i: int, u: list[arb]) -> arb:
    row = slice(matrix.indptr[i], matrix.indptr[i + 1])
    pairs = zip(matrix.data[row].tolist(), matrix.indices[row].tolist(), strict=True)
    return sum((arb(a) * u[j] for a, j in pairs), arb(0))


def products(u: Array) -> tuple[Rounded, list[arb]]:
    """Of the matrix; its diagonal is what makes the rows add up to the mass."""
    numbers = exactly(u)
    masses = exactly(MASS)
    differences = ([value - original for value in numbers] for original in numbers)
    exact = [masses[i] * numbers[i] + row_times(A, i, difference) for i, difference in enumerate(differences)]
    return residual_rounding.product_with_rounding(A, MASS, u), exact


def loads(u: Array) -> tuple[Rounded, list[arb]]:
    load = u[: B.shape[1]]
    pressure = np.abs(u[: B.shape[0]])
    pull = B.T.tocsr()
    exact = [value + row_times(pull, j, exactly(pressure)) for j, value in enumerate(exactly(load))]
    return residual_rounding.load_with_rounding(load, B, pressure), exact


def integrals(u: Array) -> tuple[Rounded, list[arb]]:
    """Of what is above the obstacle."""
    v = u[: B.shape[1]]
    d = B @ v
    numbers = exactly(v)
    exact = [row_times(B, i, numbers) - value for i, value in enumerate(exactly(d))]
    return residual_rounding.gap_with_rounding(B, v, d), exact


def means(u: Array) -> tuple[Rounded, list[arb]]:
    v = u[: B.shape[1]]
    g = B @ v / CELLS.lengths
    numbers = exactly(v)
    rows = enumerate(zip(exactly(CELLS.lengths), exactly(g), strict=True))
    exact = [row_times(B, i, numbers) / H - value for i, (H, value) in rows]
    return residual_rounding.gap_with_rounding(B, v, g, CELLS.lengths), exact


@pytest.mark.parametrize("compute", [products, loads, integrals, means])
def test_no_error_is_above_its_bound(compute: Callable[[Array], tuple[Rounded, list[arb]]]) -> None:
    """For rough vectors, and large constants with a little more; a bound of a fiftieth would be missed."""
    rng = np.random.default_rng(8)
    largest = 0.0
    for size in (1e-90, 1, 1e90):
        for constant in (0, 1, 1e6, 1e15):
            computed, exact = compute(size * (constant + rng.standard_normal(len(MASS))))
            for value, doubt, true in zip(
                exactly(computed.values), exactly(computed.rounding), exact, strict=True
            ):
                largest = max(largest, float((abs(value - true) / doubt).upper()))
    assert 0.02 < largest <= 1


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_the_dual_norm_scales_at_every_size(size: float) -> None:
    """Against (R . A^{-1} R)^(1/2) at size 1; the squares of these numbers would vanish, or be infinite."""
    R = np.random.default_rng(1).standard_normal(len(MASS))
    exact = np.sqrt(R @ np.linalg.solve(A.toarray(), R))
    assert exact <= residual_rounding.lumped_dual_norm_bound(size * R, MASS) / size < 20 * exact
    assert residual_rounding.product_root(size * R, size * R) / size == pytest.approx(np.linalg.norm(R))
    assert residual_rounding.product_root(R, -R) == 0
    assert residual_rounding.product_root(0 * R, R) == 0
    assert residual_rounding.lumped_dual_norm_bound(0 * R, MASS) == 0


def test_the_dual_norm_of_the_mass_is_nearly_twice_its_own() -> None:
    """R = M 1 has ||R|| = |Omega|^(1/2), and 2 (sum m_i)^(1/2) is twice that: no factor below 1 is left."""
    assert residual_rounding.lumped_dual_norm_bound(MASS, MASS) == pytest.approx(2 * np.sqrt(LSHAPE.area))


# Sums in which every addition is rounded the same way: k terms lose k - 1 half units

K = 40
"""Terms of a sum; the allowance for them has 4 units more."""
SLIVER = 0.99 * 2.0**-53
"""Less than half a unit in the last place of 1, so 1 + SLIVER is 1."""


def largest_error_ratio(computed: Rounded, exact: list[arb]) -> float:
    """The largest error over its allowance."""
    triples = zip(exactly(computed.values), exactly(computed.rounding), exact, strict=True)
    return max(float((abs(value - true) / doubt).lower()) for value, doubt, true in triples)


def test_sums_of_means_and_loads_lose_a_unit_for_each_term() -> None:
    """The worst sums: most of what is allowed is lost, and no more."""
    terms = np.append(1.0, np.full(K - 1, SLIVER))
    row = sp.csr_array(np.ones((1, K)))
    exact = sum(exactly(terms), arb(0))
    gap = residual_rounding.gap_with_rounding(row, terms, np.zeros(1))
    assert gap.values[0] == 1.0
    assert 0.8 < largest_error_ratio(gap, [exact]) <= 1
    column = sp.csr_array(np.ones((K, 1)))
    gap = residual_rounding.load_with_rounding(np.zeros(1), column, terms)
    assert gap.values[0] == 1.0
    assert 0.8 < largest_error_ratio(gap, [exact]) <= 1


def test_products_lose_a_unit_for_each_entry_of_a_row() -> None:
    """Node 0 with seven neighbours, which are summed one after another; u_j - u_0 are 1 and slivers.

    Six units are lost of the twelve that are allowed for eight entries and four units more.
    """
    u = np.append([0.0, 1.0], np.full(6, SLIVER))
    product = residual_rounding.product_with_rounding(sp.csr_array(np.ones((8, 8))), np.zeros(8), u)
    assert product.values[0] == 1.0
    first = Rounded(product.values[:1], product.rounding[:1])
    assert 0.4 < largest_error_ratio(first, [sum(exactly(u), arb(0))]) <= 1


def test_a_large_load_hides_a_small_product() -> None:
    """1 - 1e-17 is 1: only the rounding of the difference is as large as that."""
    matrix = sp.csr_array(np.ones((1, 1)))
    tiny = np.array([1e-17])
    load = Rounded(np.ones(1), np.zeros(1))
    residual = residual_rounding.residual_with_rounding(matrix, np.ones(1), tiny, load)
    assert residual.values[0] == 1.0
    assert largest_error_ratio(residual, [arb(1) - arb(1e-17)]) <= 1


def test_norms_are_above_their_rounding() -> None:
    """A sum of n products >= 0 is off by n half units of it, its root by half of that: n up to 16 million."""
    assert residual_rounding.NORM_ROUNDING_FACTOR >= 1 + 16e6 * 2.0**-53 / 2
