"""The ways to S y: by solves with A or A_3 or by S itself, in double precision, single, or refined."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.fem.linear_systems import SparseFactors
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.solvers.uzawa import ApplyS

PRODUCTS_PER_REFRESH = 50
"""The refined way makes one of so many products in double precision."""


def make_product(algebra: str, precision: str, spaces: MixedSpaces, factors: SparseFactors) -> ApplyS:
    """y -> S y with that matrix, A, A_3 or S, in that precision; `factors` are those of A for all nodes."""
    match algebra, precision:
        case "A", "float64":
            return make_product_by_A(factors, spaces)
        case "A_3", "float64":
            return make_product_by_A_3(spaces)
        case "S", "float64":
            return make_product_by_S(spaces.operator)
        case "S", "float32":
            return make_single_product(spaces.operator)
        case "S", "refined":
            return make_refined_product(spaces.operator)
    raise ValueError(f"there is no way to S y by {algebra} in {precision}")


def make_product_by_A(factors: SparseFactors, spaces: MixedSpaces) -> ApplyS:
    """y -> S y with a solve on all nodes: u of (5.1) without the partial elimination."""
    root = np.sqrt(spaces.operator.H_i)
    boundary = spaces.mesh.boundary
    load = np.zeros(spaces.mesh.n_nodes)

    def apply(y: Array, out: Array) -> None:
        """H_i^{-1/2} B A^{-1} B^T H_i^{-1/2} y."""
        load[boundary] = spaces.B.T @ (y / root)
        np.divide(spaces.B @ factors.solve(load)[boundary], root, out=out)

    return apply


def make_product_by_A_3(spaces: MixedSpaces) -> ApplyS:
    """y -> S y with a solve on the boundary nodes: A_3 c'' = g'' of section 5."""
    root = np.sqrt(spaces.operator.H_i)

    def apply(y: Array, out: Array) -> None:
        """H_i^{-1/2} B A_3^{-1} B^T H_i^{-1/2} y."""
        np.divide(spaces.B @ spaces.condensed.solve_boundary(spaces.B.T @ (y / root)), root, out=out)

    return apply


def make_product_by_S(operator: DualOperator) -> ApplyS:
    """y -> S y by all of S, which is what `operations` counts; the loop's own way leaves columns out."""
    return lambda y, out: np.dot(operator.S, y, out=out)


def make_single_product(operator: DualOperator) -> ApplyS:
    """y -> S y in single precision, S and y rounded to it."""
    S = operator.S.astype(np.float32)

    def apply(y: Array, out: Array) -> None:
        """The product in float32, stored in float64."""
        out[:] = S @ y.astype(np.float32)

    return apply


def make_refined_product(operator: DualOperator) -> ApplyS:
    """y -> S y_0 + S (y - y_0), the increment in single precision; every 50 products y_0 = y, in double.

    Iterative refinement, see N. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., chapter 12.
    """
    S = operator.S
    single = make_single_product(operator)
    anchor = np.zeros(len(S))
    product = np.zeros(len(S))
    count = 0

    def apply(y: Array, out: Array) -> None:
        """S y_0 + S (y - y_0), of which the first is kept from one refresh to the next."""
        nonlocal count
        if count % PRODUCTS_PER_REFRESH == 0:
            np.copyto(anchor, y)
            np.dot(S, y, out=product)
        single(y - anchor, out)
        np.add(out, product, out=out)
        count += 1

    return apply
