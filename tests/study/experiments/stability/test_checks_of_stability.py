"""The checks of stability on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table

RATIOS = [[0.5, 1], [0.25, 0.5]]


def eigenvalues(*ratio):
    """lambda_min/lambda_max is 1, 1/4, 1/8."""
    return table(lambda_min=[[2.0, 1.0, 0.5]], lambda_max=[[2.0, 4.0, 4.0]], h_over_H=[ratio])


def make_adapted_levels(ratios, angles):
    """Three levels, the same for every case without clamped sides; for one with them beta is 0."""
    cases = ["reentrant", "violates_j", "singular", "thirds", "step", "clamped_270"]
    beta = np.zeros((6, 3))
    ratio = np.full((6, 3), 3.0)
    angle = np.full((6, 3), 45.0)
    beta[:5] = [0.9, 0.5, 0.25]
    ratio[:5] = ratios
    angle[:5] = angles
    fields = {"beta_lower": beta, "cell_over_edge": ratio, "smallest_angle": angle}
    return table(**{name: (("case", "level"), value) for name, value in fields.items()}, case=cases)


def inner_nodes(deltas, ratios=(1.0, 1, 1), angles=(45.0, 45, 45), beta=(0.9, 0.6, 0.3)):
    """4 delta (1 - delta) is 1, 0.75, 0.36 at 1/2, 1/4, 1/10."""
    fields = {"delta": [deltas], "alpha_1": [ratios], "smallest_angle": [angles]}
    return table(beta_lower=[beta], beta_0_cellwise=[[0.3, 0.15, 0.1]], **fields)


def make_unsolved_bounds(*bounds, ratio=1.0):
    """beta is at most 3/4 and 1/2; the bound on it that needs no eigenvalues, in two pairs."""
    fields = {"delta": [[0.5, 0.5]], "alpha_1": [[1.0, ratio]], "smallest_angle": [[45.0, 45.0]]}
    return table(beta_upper=[[0.75, 0.5]], beta_fortin=[bounds], **fields)


def make_cells(*bounds):
    """beta_0 is 1/2 and 3/10; the shortest cells are a half and a quarter of the longest one."""
    return table(beta_0=[[0.5, 0.3]], beta_0_certified=[bounds], H_over_Hi_max=("partition", [2.0, 4.0]))


def pairing(*deltas):
    """The bound, delta/4, is 1/8 at 1/2, 0.08 at 0.32, 1/32 at 1/8; constants are 1/4, 0.4 or not known."""
    return table(pairing=[np.where(np.array(deltas) > 0, [0.25, 0.4], NAN)], delta=[deltas])


def near_ends(last):
    """beta of 0.4 at delta = H = 1/2, and the last one at 1/4; of the order 1 at the least delta."""
    beta = [[0.4, 9.0], [9.0, last], [0.3, 0.15]]
    return table(beta_lower=beta, delta=np.outer([0.5, 0.25, 0.01], [1, 1]), H=[0.5, 0.25])


ROWS = [
    ("3.1a", table(beta_lower=[[5, 1], [9, 4]], h_over_H=RATIOS), 4),
    ("3.1a", table(beta_lower=[[5, 1], [9, NAN]], h_over_H=RATIOS), "not known of square; unstruct"),
    # Eigenvalues have to vanish from H = h on; without such a pair nothing is judged.
    ("3.1c", eigenvalues(0.5, 1, 2), 0.25),
    ("3.1c", eigenvalues(0.5, 0.75, 2), 0.125),
    ("3.1c", eigenvalues(0.5, 0.5, 0.5), "is not known of square"),
    # The local rule asks for short edges, a cell of 2 edges to round-off, and for angles of 20 degrees.
    ("A.beta", make_adapted_levels([2.0, 1.9, 3.0], [45.0, 45, 19]), 0.9),
    ("A.beta", make_adapted_levels([2.0, 2.0, 3.0], [45.0, 20, 19]), 0.5),
    ("A.beta", make_adapted_levels([2.0, 1.9, 3.0], [45.0, 45, 20]), (0.25, False)),
    ("A.beta", make_adapted_levels([2 - 1e-10, 1, 1], [45.0, 45, 45]), 0.9),
    ("A.beta", make_adapted_levels([1.0, 1, 1], [45.0, 45, 45]), "nothing of which to find the smallest"),
    # The rule of inner nodes asks for delta, comparable cells and no flat triangles.
    ("T.node", inner_nodes([0.5, 0.5, 0.5]), 0.3),
    ("T.node", inner_nodes([0.5, 0.25, 0.1]), 0.6 / 0.75),
    ("T.node", inner_nodes([0.5, 0.25, 0.5], [1.0, 1, 10.1]), 0.6 / 0.75),
    ("T.node", inner_nodes([0.5, 0.25, 0.5], [10.0, 1, 1], [45.0, 20, 19.9]), 0.6 / 0.75),
    ("T.node", inner_nodes([0.5, 0, 0]), 0.9),
    ("T.node", inner_nodes([0.0, 0, 0]), "nothing of which to find the smallest lower bound"),
    ("T.node0", inner_nodes([0.5, 0.25, 0.5], angles=(45.0, 45, 19.9)), (0.15 / 0.75, False)),
    # The pairing is judged where every cell has an inner node.
    ("T.pair", pairing(0.5, 0.32), 2.0),
    ("T.pair", pairing(0.5, 0.0), 2.0),
    ("T.pair", pairing(0.125, 0.32), 5.0),
    ("T.pair", pairing(0.0, 0.0), "nothing of which"),
    # A certified constant is judged where there is one.
    ("T.low", table(beta_0_cellwise=[[0.5, 0.4]], beta_0_certified=[[0.25, 0.1]]), 2.0),
    ("T.low", table(beta_0_cellwise=[[0.5, 0.4]], beta_0_certified=[[0.0, 0.1]]), 4.0),
    ("T.low", table(beta_0_cellwise=[[0.5, 0.4]], beta_0_certified=[[0.0, 0.0]]), "nothing of which"),
    # lambda_min(S) = beta_0^2 H over beta_*^2 min H_i: by hand 0.25 2/0.25 and 0.09 4/0.16.
    ("T.step", make_cells(0.5, 0.4), 2.0),
    ("T.step", make_cells(0.0, 0.4), 2.25),
    ("T.step", make_cells(1.0, 0.4), (0.5, False)),
    # The bound without eigenvalues is judged where there is one: that it is below, and how far.
    ("T.fortin", make_unsolved_bounds(0.25, 0.25), 2.0),
    ("T.fortin", make_unsolved_bounds(0.25, 0.0), 3.0),
    ("T.fortin", make_unsolved_bounds(0.0, 0.0), "nothing of which"),
    ("T.near", make_unsolved_bounds(0.25, 0.25), 3.0),
    ("T.near", make_unsolved_bounds(0.25, 0.1, ratio=10.1), 3.0),
    # Near the ends beta falls with the cells, from both sides.
    ("T.ends", near_ends(0.2), 0.0),
    ("T.ends", near_ends(0.1), (1.0, False)),
    ("T.ends", near_ends(0.4), (1.0, False)),
    # Edges alone are judged where every cell has two.
    ("S.edges", table(beta_upper=[[0.25, 0.5]], edges_per_cell=[[1.0, 2 - 1e-10]]), 0.5),
    ("S.edges", table(beta_upper=[[0.25, 0.5]], edges_per_cell=[[1.0, 1.9]]), "is not known of betaworst"),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
