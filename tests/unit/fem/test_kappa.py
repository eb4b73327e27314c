"""The constant of ||w||_0 <= KAPPA d |w|_1 for functions w with the mean 0 on each edge of a triangle.

The first test is the computation in its proof, with Proposition S1 in supplement.md. The others bound the
best constant from below, by conforming functions on a finer mesh.
"""

import math

import numpy as np
import pytest
from scipy.linalg import LinAlgError, cholesky, eigh

from unilateral.fem.p1 import stiffness_and_mass
from unilateral.fem.poincare import KAPPA, crouzeix_raviart_matrix
from unilateral.formulas.taylor import EPS
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon

HALVINGS = 4
PARTS = 2**HALVINGS
"""Sides are cut into so many parts, a triangle into PARTS^2 that are similar to it."""
PENALTY = 1e4
"""Of means over sides; a finite one can only lower the least eigenvalue, here by less than a thousandth."""
BELOW = 1 - 1e-4
"""It is proved of this part of the eigenvalue computed that the exact one is not smaller."""
EXACT = 1 - 1e-9
"""The exact eigenvalue is not smaller than this part of that of a triangle with rounded coordinates.

Coordinates are rounded by at most 2^-53 and the parts are at least sin(0.12)/16 high, so that gradients
change by less than 1e-13.
"""
EQUILATERAL = 3.0
"""tau = cot(theta/2)^2 for the apex angle theta of an isosceles triangle, here 60 degrees."""


def divide_triangle(vertices, halvings=HALVINGS):
    """The triangle cut into 4^halvings ones that are similar to it."""
    triangle = Polygon(np.array(vertices, dtype=float), "triangle")
    return meshes.refine_uniformly(meshes.from_arrays(triangle, triangle.vertices, [[0, 1, 2]]), halvings)


def isosceles(tau):
    """The vertices of the isosceles triangle with two sides of length 1, which are its longest."""
    half = math.atan(1 / math.sqrt(tau))
    return [[0, 0], [math.cos(half), -math.sin(half)], [math.cos(half), math.sin(half)]]


def eigenvalue_below(tau):
    """A lower bound on the least |w|_1^2 / ||w||_0^2 for functions w with the mean 0 on the sides.

    Let C^{-2} be that least value. On each of the m^2 similar triangles the constant is C/m, and with the
    least value lambda_m for functions of Crouzeix and Raviart C^2 <= 1/lambda_m + C^2/m^2, so that C^{-2} is
    at least (1 - m^{-2}) lambda_m, up to EXACT. That no eigenvalue is below mu is proved by a factorisation
    of Cholesky (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, theorem 10.3).
    """
    mesh = divide_triangle(isosceles(tau))
    B, root_mass = crouzeix_raviart_matrix(mesh)
    boundary = mesh.triangulation.boundary_edges
    means = np.zeros((3, len(root_mass)))
    means[mesh.side, boundary] = 1 / (PARTS * root_mass[boundary])
    A = B.toarray() + PENALTY * means.T @ means
    mu = BELOW * float(eigh(A, eigvals_only=True, subset_by_index=[0, 0])[0])
    rounding = (len(A) + 16) * EPS * np.trace(A)
    cholesky(A - (mu + rounding) * np.eye(len(A)))
    return EXACT * (1 - PARTS**-2) * mu


def values_of_tau(constant):
    """The values of tau between which the eigenvalue stays above constant^{-2}, up to the last, infinity.

    The eigenvalue is 1 + 1/tau times a function that does not decrease. Raises AssertionError where that does
    not do.
    """
    minimum = constant**-2
    tau = EQUILATERAL
    calls = []
    while tau < math.inf:
        calls.append(tau)
        assert len(calls) < 100
        below = eigenvalue_below(tau)
        assert below > minimum
        excess = minimum * (1 + 1 / tau) / below - 1
        tau = 1 / excess if excess > 0 else math.inf
    return calls


def test_the_constant_is_large_enough_for_all_triangles():
    """A proof. Control: the computation does not prove a constant that is a hundredth smaller."""
    assert len(values_of_tau(KAPPA)) > 5
    with pytest.raises(AssertionError):
        values_of_tau(0.99 * KAPPA)


def test_no_number_above_the_eigenvalue_passes(monkeypatch):
    """Control of the factorisation."""
    monkeypatch.setitem(globals(), "BELOW", 1.0001)
    with pytest.raises(LinAlgError):
        eigenvalue_below(EQUILATERAL)


def constant_above(vertices):
    """The largest ||w||_0 / (d |w|_1) of continuous w that are linear on a finer mesh, so a lower bound."""
    mesh = divide_triangle(vertices)
    stiffness, mass = stiffness_and_mass(mesh)
    K = stiffness.toarray()
    M = mass.toarray()
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    integrals = np.zeros((3, mesh.n_nodes))
    for ends in (start, end):
        np.add.at(integrals, (mesh.side, ends), 0.5 * np.diff(mesh.s))
    free = np.linalg.svd(integrals)[2][3:].T
    largest = eigh(free.T @ M @ free, free.T @ K @ free, eigvals_only=True)[-1]
    return math.sqrt(largest) / mesh.polygon.lengths.max()


def corners():
    """Third vertices, on a grid, of triangles whose longest side is that from (0, 0) to (1, 0)."""
    for a in np.linspace(0.5, 1, 6):
        highest = math.sqrt(max(1 - a**2, 0.0))
        yield from ((a, b) for b in (0.02, *(highest * np.linspace(0.25, 1, 4))) if 0.02 <= b <= highest)


def test_no_shape_needs_a_larger_constant_and_one_needs_almost_this():
    """Control: a constant that is 3 % smaller is not enough for all of them."""
    constants = {corner: constant_above([[0, 0], [1, 0], corner]) for corner in corners()}
    assert len(constants) > 20
    assert max(constants.values()) <= KAPPA
    assert max(constants.values()) > 0.97 * KAPPA
    assert math.dist(max(constants, key=constants.get), (0.5, math.sqrt(0.75))) < 1e-12


def test_the_constant_grows_with_the_height():
    """As the proof says, for which isosceles triangles are enough."""
    for a in (0.5, 0.7, 0.9):
        highest = math.sqrt(1 - a**2)
        heights = [constant_above([[0, 0], [1, 0], (a, b * highest)]) for b in (0.3, 0.6, 1)]
        assert heights == sorted(heights)
