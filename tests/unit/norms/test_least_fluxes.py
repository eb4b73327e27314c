"""The dual norm with clamped sides and c = 0: against series, single functions, and that of c = 1."""

import math

import numpy as np
import pytest

from unilateral.fem.form import Form
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import find_polygon, square
from unilateral.norms import least_fluxes
from unilateral.norms.dual import build_dual_norm

ODD = math.pi * np.arange(1, 20_001, 2)
ACROSS = float(np.sum(8 / (ODD**3 * np.tanh(ODD))))
"""||mu||^2 where y = 0 and y = 1 are clamped and mu is 1 at x = 1.

mu is the sum of 4/p sin(p y) over p = pi, 3 pi, and so on, and u that of 4/p^2 sin(p y) cosh(p x)/sinh(p).
||mu||^2 is the integral of u at x = 1.
"""


def squares(cells: Partition, clamped: tuple[int, ...], mu: dict[int, float]) -> tuple[float, float]:
    """Bounds on the square of the norm of a mu that is constant on sides."""
    values = np.array([mu.get(side, 0.0) for side in cells.side.tolist()])
    bracket = build_dual_norm(cells, form=Form(c=0.0, clamped=clamped)).bound_p0(values[None])
    return float(bracket.lower[0]) ** 2, float(bracket.upper[0]) ** 2


@pytest.mark.parametrize(
    ("clamped", "mu", "exact"),
    [((0,), {2: 1.0}, 1.0), ((0, 2), {1: 1.0}, ACROSS), ((0, 2), {3: -2.0}, 4 * ACROSS)],
)
def test_without_a_reaction_the_norm_lies_between_its_bounds(clamped, mu, exact):
    """u = y for mu = 1 at y = 1 and 0 beside; else the series, with two arcs that are not clamped."""
    lower, upper = squares(make_uniform_partition(square(), 1 / 4), clamped, mu)
    assert lower <= exact * (1 + 1e-12)
    assert exact * (1 - 1e-12) <= upper
    assert upper <= 1.002 * lower


def test_the_form_is_that_of_single_functions():
    """The form on all cells, by differences of columns, against one function at a time. Two arcs."""
    norm = build_dual_norm(make_uniform_partition(square(), 1 / 4), form=Form(c=0.0, clamped=(0, 2)))
    gram = norm.gram()
    mu = np.random.default_rng(3).standard_normal((5, 16))
    kept_mu = mu[:, gram.cells]
    single = norm.bound_p0(mu)
    for form, end in zip(gram.p0, (single.lower, single.upper), strict=True):
        assert np.allclose(np.einsum("ki,ij,kj->k", kept_mu, form, kept_mu), end**2, rtol=1e-9)


def test_a_constant_of_an_arc_is_an_unknown(monkeypatch):
    """Control: with the flux through a clamped side held at 0 the upper bound is far too large."""
    from_matrix = least_fluxes.CondensedEnergy.from_matrix.__func__

    def clamp_jumps(cls, matrix, clamped_values, rank):
        return from_matrix(
            cls, matrix, np.append(clamped_values.ravel(), np.flatnonzero(np.isinf(rank))), rank
        )

    monkeypatch.setattr(least_fluxes.CondensedEnergy, "from_matrix", classmethod(clamp_jumps))
    assert squares(make_uniform_partition(square(), 1 / 4), (0, 2), {1: 1.0})[1] > 1.5 * ACROSS


@pytest.mark.parametrize("smallest", [2.0**-8, 2.0**-15])
def test_bounds_on_cells_graded_to_a_vertex_are_as_near_each_other_as_for_c_1(smallest):
    """At the end of a clamped side, at 270 degrees, where the forms are alike. A tenth is room for the rest.

    A matrix with div q in it was singular there.
    """
    polygon = find_polygon("lshape")
    position = polygon.starts[2] + 2.0 ** -np.arange(1, 1 - math.log2(smallest))
    cells = Partition(polygon, np.union1d(make_uniform_partition(polygon, 1 / 2).points, position))

    def excess(c):
        lower, upper = build_dual_norm(cells, form=Form(c=c, clamped=(1,))).gram().p0
        ratios = np.linalg.eigvals(np.linalg.solve(lower, upper)).real - 1
        assert ratios.min() > -1e-9
        return ratios.max()

    assert excess(0.0) < 1.1 * excess(1.0)


def test_psi_is_the_integral_of_the_flux():
    """At ends and midpoints of 3 edges, against Simpson's rule, which is exact for linear functions."""
    start, end = np.random.default_rng(4).standard_normal((2, 3, 2))
    values = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6]])
    psi = least_fluxes._integrate_stream_function(np.zeros((7, 2)), values, start, end)
    quarter = 0.75 * start + 0.25 * end
    middle = 0.5 * (start + end)
    halves = (start + 4 * quarter + middle) / 12
    wholes = (start + 4 * middle + end) / 6
    before = np.vstack([np.zeros((1, 2)), np.cumsum(wholes, axis=0)])
    assert np.allclose(psi[:4], before, atol=1e-15)
    assert np.allclose(psi[4:], before[:-1] + halves, atol=1e-15)
