"""The constants of Theorem 5, by the matrix B of all boundary nodes and by hand, and what a run says."""

from math import sqrt

import numpy as np
import pytest
import xarray as xr
from boundary_norms import gram, make_operator_and_gram
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from study.stability_constants import (
    cellwise_constant,
    cellwise_lower_bound,
    lemma_quotients,
    pairing_constant,
    pairing_constant_bound,
    pairing_matrix,
)
from unilateral.fem.condense import condense
from unilateral.fem.p1 import coupling
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.infsup import infsup_constants
from unilateral.norms.resolution import innermost_nodes


def between(s, nodes, period):
    """(nb, m) values at arc lengths s of the hats of the nodes, linear and periodic."""
    hats = np.eye(len(nodes))
    places = np.concatenate([nodes - period, nodes, nodes + period])
    return np.array([np.interp(s, places, np.tile(hat, 3)) for hat in hats]).T


@pytest.mark.parametrize("seed", range(4))
def test_the_pairing_is_that_of_traces_of_V_h(seed):
    """Interpolated at all boundary nodes, vertices among them, a hat of V has B's integrals.

    Up to rounding, for between two kept nodes a hat is linear: it is a trace of V_h.
    """
    rng = np.random.default_rng(seed)
    polygon = [square(), find_polygon("lshape")][seed % 2]
    points = np.union1d(polygon.starts, rng.uniform(0, polygon.perimeter, 9))
    cells = partitions.from_points(polygon, points)
    inside = cells.points[:-1] + rng.uniform(0.1, 0.9, (3, cells.n_cells)) * cells.lengths
    s = np.unique([*polygon.starts, *inside.ravel(), *(cells.points[1:4] if seed < 2 else [])])[:-1]
    mesh = meshes.triangulate_from_boundary(polygon, s)
    nodes = innermost_nodes(mesh.s, cells)[0]
    B = coupling(mesh, cells) @ between(mesh.s[:-1], nodes, polygon.perimeter)
    assert_allclose(pairing_matrix(nodes, cells), B / cells.lengths[:, None], rtol=0, atol=1e-13)


@pytest.mark.parametrize("delta", [0.5, 0.3, 0.01])
def test_on_equal_cells_alternating_values_are_the_worst(delta):
    """M is circulant, 1 - r - l, r = (1 - delta)^2/2, l = delta^2/2; |its symbol| is least at -1."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    nodes = cells.points[:-1] + delta * cells.lengths
    M = pairing_matrix(nodes, cells)
    assert_allclose(M.sum(axis=1), 1, rtol=1e-14)
    assert_allclose(M[0, [0, 1, -1]], [0.5 + delta - delta**2, (1 - delta) ** 2 / 2, delta**2 / 2])
    constant = pairing_constant(np.append(nodes, 4.0), cells)
    assert constant == pytest.approx(2 * delta * (1 - delta), rel=1e-12)


@pytest.mark.parametrize("ratio", [1, 30, 1e6])
def test_the_bound_of_the_proof_holds_for_random_cells_and_nodes(ratio):
    """By (6), whatever the lengths of the cells."""
    rng = np.random.default_rng(int(ratio))
    sides = square().starts
    for _ in range(100):
        side = ratio ** rng.random((4, 3))
        ends = sides[:-1, None] + np.cumsum(side, axis=1) / side.sum(axis=1)[:, None]
        cells = partitions.from_points(square(), np.append(0.0, ends.ravel()))
        delta = rng.uniform(0.01, 0.5)
        nodes = cells.points[:-1] + rng.uniform(delta, 1 - delta, 12) * cells.lengths
        delta = innermost_nodes(np.append(nodes, 4.0), cells)[1].min()
        constant = pairing_constant(np.append(nodes, 4.0), cells)
        assert constant >= pairing_constant_bound(delta) == pytest.approx(delta / 4, rel=1e-14)


def test_no_bound_holds_that_is_eight_times_as_large():
    """Control: on equal cells the constant is 2 delta (1 - delta)."""
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    nodes = cells.points[:-1] + 0.01 * cells.lengths
    assert pairing_constant(np.append(nodes, 4.0), cells) < 8 * pairing_constant_bound(0.01)


def test_there_is_no_pairing_where_a_cell_has_no_node_inside():
    """A node at an end, up to round-off, is not inside."""
    cells = partitions.make_uniform_partition(square(), 1 / 2)
    s = np.append(cells.points[:-1] + 0.25, 4.0)
    s[2] = cells.points[2] + 1e-12
    nodes, deltas = innermost_nodes(s, cells)
    assert (nodes[2], deltas[2]) == (cells.points[2], 0)
    assert np.isnan(pairing_constant(s, cells))


PAIRS = {
    "two edges": lambda: (
        make_structured_mesh(square(), 1 / 8),
        partitions.make_uniform_partition(square(), 1 / 4),
    ),
    "staggered": lambda: (
        make_structured_mesh(square(), 1 / 12),
        partitions.make_shifted_partition(square(), 1 / 8, 0.3),
    ),
    "re-entrant": lambda: (
        meshes.make_unstructured_mesh(find_polygon("lshape"), 0.2),
        partitions.make_uniform_partition(find_polygon("lshape"), 0.4),
    ),
}


@pytest.mark.parametrize("name", PAIRS)
def test_the_certified_constant_lies_below_the_one_by_solving_and_within_a_half(name):
    """Below: by the proof. Control: without the energy, as sigma alone, it would not."""
    mesh, cells = PAIRS[name]()
    solved = cellwise_constant(mixed_spaces(condense(mesh), cells).operator)
    lower_bound = cellwise_lower_bound(mesh, cells)
    assert solved / 2 < lower_bound <= solved < pairing_constant(mesh.s, cells)


def test_nothing_is_certified_where_a_cell_has_no_node_inside():
    assert (
        cellwise_lower_bound(
            make_structured_mesh(square(), 1 / 4), partitions.make_uniform_partition(square(), 1 / 4)
        )
        == 0
    )


def test_the_cellwise_constant_is_a_generalised_eigenvalue():
    """(sum_i H_i^2 mu_i^2)^{1/2} for H^{1/2} ||mu||_0; on equal cells it is beta_0."""
    cells = partitions.make_shifted_partition(square(), 1 / 4, 0.6)
    op = mixed_spaces(condense(make_structured_mesh(square(), 1 / 18)), cells).operator
    expected = sqrt(eigh(op.D, np.diag(op.H_i**2), eigvals_only=True)[0])
    assert cellwise_constant(op) == pytest.approx(expected, rel=1e-10)
    assert cellwise_constant(op) > 1.1 * infsup_constants(op, gram(cells)).beta_0
    op, form = make_operator_and_gram("square", 8, 4)
    assert cellwise_constant(op) == pytest.approx(infsup_constants(op, form).beta_0, rel=1e-10)


def runs(hm12, h1_error, beta=(0.5, 0.5)):
    """A table of one run with the bounds hm12, of which 0.9 is the discrete norm, and the distance 0.1."""
    grid = ("mesh", "partition")
    run = ("case", "mesh", "partition")
    values = {"hm12_error_lower": hm12[0], "hm12_error_upper": hm12[1], "h1_error": h1_error}
    values |= {"discrete_error": 0.9, "hm12_best": 0.1}
    pair = {"beta_lower": beta[0], "beta_upper": beta[1], "beta_0": 0.3}
    table = {name: (run, [[[value]]]) for name, value in values.items()}
    table |= {name: (grid, [[value]]) for name, value in pair.items()}
    return xr.Dataset({**table, "u_norm": (("case", "mesh"), [[1.0]])})


def test_the_quotients_of_a_run_take_every_bound_on_its_unfavourable_side():
    """Every factor on its unfavourable side: the largest error over the smallest right side of (4.6)."""
    quotients = lemma_quotients(runs((1.0, 1.2), 0.2, (0.4, 0.5))).squeeze()
    assert_allclose(quotients["norm_ratio_lower"], 0.9 / 1.2)
    assert_allclose(quotients["norm_ratio_upper"], 0.9 / 1.0)
    assert_allclose(quotients["lemma_4_3"], 1.2 / ((1 + 1 / 0.5) * 0.1 + 0.2 / 0.5))
    assert float(quotients["lemma_4_3"]) > 1  # a run against the lemma would show
    assert float(lemma_quotients(runs((1.0, 1.2), 0.2, (0.1, 0.1)))["lemma_4_3"].squeeze()) < 1


@pytest.mark.parametrize("table", [runs((1, 1.2), 0.2, (0, 0)), runs((0, 1e-13), 0.2)], ids=["beta", "error"])
def test_without_a_beta_or_an_error_there_is_no_ratio(table):
    quotients = lemma_quotients(table)
    for name in ("norm_ratio_lower", "norm_ratio_upper", "lemma_4_3"):
        assert np.isnan(quotients[name]).all()


def test_uzawa_contracts_as_the_constant_says_and_no_better_than_the_spectrum():
    """Supplement, E.6 (b), with rho = sigma_1 on cells whose lengths differ by a factor of 9.

    lambda_H is chosen, with cells in contact and off contact, and the data are made from it. Control: where
    no cell is clipped the slowest part falls by 1 - sigma_1 lambda_min, so no smaller factor is a bound.
    """
    cells = partitions.from_points(square(), [0, 0.05, 0.15, 0.6, *np.arange(1, 4.25, 0.25)])
    mesh = meshes.triangulate_from_cells(cells, 2)[0]
    condensed = condense(mesh)
    operator = mixed_spaces(condensed, cells).operator
    sigma = condensed.sigma_1
    factor = 1 - sigma * cellwise_lower_bound(mesh, cells) ** 2 * cells.lengths.min()
    slowest = 1 - sigma * operator.lambda_min
    assert 0 < slowest <= factor < 1
    rng = np.random.default_rng(0)
    solution = np.maximum(rng.uniform(-1, 1, cells.n_cells), 0.0)
    gap = np.where(solution > 0, 0.0, rng.uniform(0, 1, cells.n_cells))
    # F(x) = S x + b is the scaled gap: F(solution) = gap
    for start in rng.uniform(0, 3, (20, cells.n_cells)):
        x = start
        for _ in range(5):
            new = np.maximum(x - sigma * (operator.S @ (x - solution) + gap), 0.0)
            assert np.linalg.norm(new - solution) <= factor * np.linalg.norm(x - solution)
            x = new
    mode = np.linalg.eigh(operator.S)[1][:, 0]
    assert np.linalg.norm(mode - sigma * operator.S @ mode) == pytest.approx(slowest, rel=1e-12)
