"""The worst multiplier against beta, kernels that are known, and matrices by hand."""

from math import sqrt

import numpy as np
import pytest
from boundary_norms import EQUAL_POINTS, gram, make_operator_and_gram, operator, own_cells
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from study.experiments.stability.measure import worst_multiplier
from unilateral.norms.infsup import infsup_constants


def symmetries(m):
    """Of the unit square with m cells a side: the half-turn and the reflection in the diagonal x = y."""
    i = np.arange(4 * m)
    return [(i + 2 * m) % (4 * m), 4 * m - 1 - i]


@pytest.mark.parametrize(("n", "m"), [(8, 4), (12, 8), (8, 7)])
def test_the_worst_multiplier_attains_beta_and_is_symmetric(n, m):
    """1e-6: G is symmetric up to 1e-5 only, its mesh is not; of that the quotient sees the square."""
    op, G = make_operator_and_gram("square", n, m)
    for image in symmetries(m):
        assert_allclose(op.D[np.ix_(image, image)], op.D, rtol=0, atol=1e-13 * op.D.max())
    for mu in (worst_multiplier(op.D, G.lower), worst_multiplier(op.D, G.lower, symmetries(m))):
        assert sqrt((mu @ op.D @ mu) / (mu @ G.lower @ mu)) == pytest.approx(
            infsup_constants(op, G).beta_upper, rel=1e-6
        )
        assert mu.max() == pytest.approx(
            np.abs(mu).max(), rel=1e-3
        )  # the sign of one of equal size up to TIE
    for image in symmetries(m):
        assert min(abs(mu[image] - mu).max(), abs(mu[image] + mu).max()) <= 1e-12


@pytest.mark.parametrize("name", EQUAL_POINTS)
def test_where_beta_is_zero_it_spans_the_kernel(name):
    """That of D: (-1)^e / |e| for an even number of edges that are the cells."""
    mesh = EQUAL_POINTS[name]()
    cells = own_cells(mesh)
    kernel = (-1.0) ** np.arange(cells.n_cells) / cells.lengths
    worst = worst_multiplier(operator(mesh, cells).D, gram(cells).lower)
    largest = np.abs(kernel).argmax()
    assert_allclose(worst, kernel / kernel[largest] * worst[largest], rtol=0, atol=1e-6)


def test_the_worst_of_equally_bad_multipliers_is_the_symmetric_one():
    """D = 1, G = 1: every mu is; then the one that only the second symmetry turns into -mu made the worst."""
    first = np.eye(8)
    pair = symmetries(2)
    mu = worst_multiplier(first, first, pair)
    assert_allclose(mu[pair[0]], mu, rtol=0, atol=1e-14)
    assert_allclose(mu[pair[1]], mu, rtol=0, atol=1e-14)
    odd = np.array([1.0, 2, -2, -1, 1, 2, -2, -1])
    worst = worst_multiplier(first - 0.5 * np.outer(odd, odd) / (odd @ odd), first, pair)
    assert_allclose(worst, odd / 2, rtol=0, atol=1e-12)


def test_the_worst_multiplier_of_a_single_class_is_the_eigenvector():
    rng = np.random.default_rng(1)
    X, Y = rng.standard_normal((2, 6, 6))
    D = X @ X.T + np.eye(6)
    G = Y @ Y.T + np.eye(6)
    expected = eigh(D, G)[1][:, 0]
    expected /= expected[np.abs(expected).argmax()]
    assert_allclose(worst_multiplier(D, G), expected, rtol=1e-10)
