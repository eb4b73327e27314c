"""Declared partitions and boundary nodes: expected values from the definitions, by hand."""

import numpy as np
import pytest
import sentences
import xarray as xr
import yaml
from conftest import ROOT
from numpy.testing import assert_allclose, assert_array_equal

from study.experiments.stability import measure as stability
from study.experiments.stability.measure import (
    make_meshes,
    make_partition,
    place_boundary_nodes,
    survey_pairs,
)
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.resolution import resolution

TRIANGLE = Polygon(np.array([[0, 0], [4, 0], [0, 3]]), "triangle")
"""Its sides are 4, 5 and 3 long."""
ROUND_OFF = 1e-14
"""A few operations on arc lengths up to 12 are rounded by less."""
RANDOM = {"H": "1/4", "spread": 4, "seed": 1}
PARTITIONS = [
    {"H": "1/4"},
    {"H": "1/4", "shift": "1/3"},
    {"H": "1/4", "grading": 3},
    RANDOM,
    {"counts": [4, 3, 5, 1]},
    {"points": [0, "1/3", 1, 2, "5/2", 3, 4]},
]
KINDS = [
    {"kind": "follow"},
    {"kind": "equal"},
    {"kind": "graded", "grading": 2},
    {"kind": "random", "spread": 10, "seed": 3},
]
INNER = [{"kind": "inner"}, {"kind": "inner", "ends": True}, {"kind": "inner", "seed": 3}]


def mesh_of(cells, spec, K):
    return make_meshes([cells], [spec], K)[0]


def test_all_that_can_be_asked_for_is_tried_here():
    """The schema's kinds of boundary nodes, and its forms of partitions."""
    schema = yaml.safe_load((ROOT / "src/study/experiments/stability/schema.yaml").read_text())
    rules = schema["surveys"]["$defs"]
    assert rules["nodes"]["properties"]["kind"]["enum"] == [
        "structured",
        *(spec["kind"] for spec in KINDS),
        "inner",
    ]
    forms = [form["required"] for form in rules["partition"]["oneOf"]]
    assert forms == [list(spec) for spec in PARTITIONS]


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ({"H": 2}, [0, 2, 4, 4 + 5 / 3, 4 + 10 / 3, 9, 9 + 3 / 2, 12]),
        (
            {"H": 2, "shift": "1/4"},
            [0, 2 + 1 / 2, 4, 4 + 5 / 3 + 5 / 12, 4 + 10 / 3 + 5 / 12, 9, 9 + 3 / 2 + 3 / 8, 12],
        ),
        ({"H": 2, "grading": 3}, [0, 2, 4, 4 + 5 * 4 / 27, 4 + 5 * 23 / 27, 9, 9 + 3 / 2, 12]),
        ({"counts": [1, 2, 3]}, [0, 4, 6.5, 9, 10, 11, 12]),
        ({"points": [0, "1/3", 4, 9, 12]}, [0, 1 / 3, 4, 9, 12]),
    ],
)
def test_points_of_partitions_are_those_by_hand(spec, expected):
    """H = 2 are two cells of 2, three of 5/3, two of 3/2; shifted by a quarter, the first is longer.

    Graded ones are powers towards both ends of a side.
    """
    assert_allclose(make_partition(TRIANGLE, spec).points, expected, rtol=0, atol=ROUND_OFF)


def test_random_lengths_are_log_uniform():
    """log(H_i) has a range of at most log 4 on each side, and is spread evenly in it: with 4000 cells its
    standard deviation is log 4 / 12^(1/2), up to 5 %, five standard deviations of that estimate."""
    cells = make_partition(square(), {"H": "1/1000", "spread": 4, "seed": 1})
    logarithms = np.log(cells.lengths).reshape(4, 1000)
    assert np.all(np.ptp(logarithms, axis=1) <= np.log(4) + 1e-9)
    assert_allclose(logarithms.std(axis=1), np.log(4) / np.sqrt(12), rtol=0.05)
    again = make_partition(square(), {"H": "1/1000", "spread": 4, "seed": 1})
    other_partition = make_partition(square(), {"H": "1/1000", "spread": 4, "seed": 2})
    assert_array_equal(cells.points, again.points)
    assert not np.array_equal(cells.points, other_partition.points)


@pytest.mark.parametrize("spec", [{"H": "1/4"}, {"H": "1/4", "shift": 0}, {"H": "1/4", "grading": 1}])
def test_the_neutral_parameters_are_uniform(spec):
    assert_array_equal(make_partition(square(), spec).points, np.arange(17) / 4)


@pytest.mark.parametrize("spec", PARTITIONS)
@pytest.mark.parametrize("K", [1, 2, 3])
def test_followed_cells_have_the_same_number_of_edges(spec, K):
    """Each cell in K equal edges, its ends nodes to the last bit."""
    cells = make_partition(square(), spec)
    nodes = place_boundary_nodes(cells, {"kind": "follow"}, K)
    assert_array_equal(nodes[::K], cells.points[:-1])
    expected = np.repeat(cells.lengths / K, K)
    assert_allclose(np.diff(nodes, append=4), expected, rtol=0, atol=ROUND_OFF)


def test_followed_nodes_lie_at_equal_fractions_of_the_cells():
    """Two cells of 1/4 and 3/4 with three edges: nodes at 2/3 of the first, at 1/3 of the second."""
    cells = make_partition(square(), {"points": [0, "1/4", 1, "5/4", 2, "9/4", 3, "13/4", 4]})
    nodes = place_boundary_nodes(cells, {"kind": "follow"}, "3/2")
    assert_allclose(nodes[:3], [0, 1 / 6, 1 / 2], rtol=0, atol=ROUND_OFF)
    assert_allclose(nodes, np.add.outer(np.arange(4), nodes[:3]).ravel(), rtol=0, atol=ROUND_OFF)


def test_equal_and_graded_nodes_lie_where_their_formulas_say():
    """Sides with one cell each of length 4, 5, 3."""
    cells = make_partition(TRIANGLE, {"counts": [1, 1, 1]})
    assert_allclose(
        place_boundary_nodes(cells, {"kind": "equal"}, 2), [0, 2, 4, 6.5, 9, 10.5], rtol=0, atol=ROUND_OFF
    )
    graded = place_boundary_nodes(cells, {"kind": "graded", "grading": 2}, 3)
    shares = np.array([0, 2 / 9, 7 / 9])
    assert_allclose(graded, [*(4 * shares), *(4 + 5 * shares), *(9 + 3 * shares)], rtol=0, atol=ROUND_OFF)


def test_random_nodes_are_drawn_like_random_partitions():
    cells = make_partition(square(), {"H": "1/4"})
    nodes = place_boundary_nodes(cells, {"kind": "random", "spread": 4, "seed": 1}, 1)
    assert_array_equal(nodes, make_partition(square(), RANDOM).points[:-1])


@pytest.mark.parametrize("K", ["1/10", "9/8", "3/2", 2.7])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("spec", PARTITIONS)
def test_a_side_of_m_cells_has_K_m_edges_rounded(spec, kind, K):
    """max(1, round(K m)) on a side with m cells, halves rounded up."""
    cells = make_partition(square(), spec)
    nodes = place_boundary_nodes(cells, kind, K)
    factor = {"1/10": 0.1, "9/8": 1.125, "3/2": 1.5}.get(K, K)
    expected = [max(1, int(factor * m + 0.5)) for m in np.bincount(cells.side)]
    assert_array_equal(np.bincount(np.searchsorted([1, 2, 3], nodes, side="right")), expected)
    assert np.isin(np.arange(4), nodes).all()
    assert np.all(np.diff(nodes, append=4) > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_meshes_have_the_nodes_asked_for(kind):
    """To the last bit, so that nodes and ends of cells that are the same number stay the same."""
    cells = make_partition(find_polygon("lshape"), RANDOM)
    mesh = mesh_of(cells, kind, 2)
    assert_array_equal(mesh.s[:-1], place_boundary_nodes(cells, kind, 2))
    if kind["kind"] == "follow":
        assert_allclose(resolution(mesh, cells)[:3], (2, 2, 1), rtol=1e-12)


def test_inner_nodes_lie_on_the_far_side_of_the_middle_of_each_cell():
    """A side of 5 cells and one of 4, of the length 1 each: before the middle at 3/4, after it at 1/4."""
    polygon = Polygon(np.array([[0, 0], [5, 0], [5, 4], [0, 4]]), "rectangle")
    cells = make_partition(polygon, {"counts": [5, 4, 1, 1]})
    expected = [0, 0.75, 1.75, 2.5, 3.25, 4.25, 5, 5.75, 6.5, 7.5, 8.25, 9, 11.5, 14, 16]
    assert_array_equal(place_boundary_nodes(cells, INNER[0], "1/4"), expected)
    assert_array_equal(place_boundary_nodes(cells, INNER[1], "1/4"), np.union1d(expected, cells.points[:-1]))


@pytest.mark.parametrize("kind", INNER)
@pytest.mark.parametrize("spec", PARTITIONS)
@pytest.mark.parametrize("delta", [0.5, 0.3, 1 / 1024])
def test_every_cell_has_one_node_inside_and_at_least_delta_from_its_ends(kind, spec, delta):
    cells = make_partition(square(), spec)
    mesh = mesh_of(cells, kind, delta)
    cell_resolution = resolution(mesh, cells)
    assert delta * (1 - 1e-9) <= cell_resolution.delta <= 0.5
    assert len(mesh.boundary) == (2 * cells.n_cells if "ends" in kind else cells.n_cells + 4)
    assert (cell_resolution.nodes_per_cell, cell_resolution.alpha_1) == (1, cells.alpha_1)


def test_explicit_nodes_are_taken_as_given():
    cells = make_partition(square(), {"H": 1})
    mesh = mesh_of(cells, {"nodes": [0, "1/3", 1, 2, 2.5, 3]}, 1)
    assert_array_equal(mesh.s, [0, 1 / 3, 1, 2, 2.5, 3, 4])


def test_structured_meshes_have_the_size_of_the_cells_over_the_ratio():
    cells = make_partition(square(), {"H": "1/4"})
    mesh = mesh_of(cells, {"kind": "structured"}, "3/2")
    assert_array_equal(mesh.points, make_structured_mesh(square(), 1 / 6).points)


@pytest.mark.parametrize(
    "spec",
    [
        {"H": "a quarter"},
        {"H": 0},
        {"H": "1/4", "shift": 1},
        {"H": "1/4", "shift": -0.1},
        {"points": [0, 1, 2, 4]},
        {"points": [0, 2, 1, 3, 4]},
    ],
)
def test_partitions_that_cannot_be_are_refused(spec):
    with sentences.raises(InputError):
        make_partition(square(), spec)


@pytest.mark.parametrize(
    ("spec", "K"),
    [
        ({"kind": "equal"}, "two"),
        ({"kind": "inner"}, "half"),
        ({"nodes": [0, 1, 2]}, 1),
        ({"nodes": [0, 1, 2, 3, 4]}, 1),
        ({"nodes": [0, 1, 2, 3, 2.5]}, 1),
        ({"nodes": [-0.5, 0, 1, 2, 3]}, 1),
    ],
)
def test_meshes_that_cannot_be_are_refused(spec, K):
    with sentences.raises(InputError):
        mesh_of(make_partition(square(), {"H": 1}), spec, K)


RANDOM_EDGES = {"kind": "random", "spread": 4, "seed": 7}
SAME_NUMBERS = [{"H": "1/2", "spread": 2, "seed": seed} for seed in (1, 2)]
"""Other cells, but as many on each side."""


def test_one_mesh_serves_all_partitions_with_its_boundary_nodes():
    """Edges that are drawn know the number of cells only; those that follow cells do not agree."""
    polygon = square()
    cells = [make_partition(polygon, spec) for spec in SAME_NUMBERS]
    first, second = make_meshes(cells, [RANDOM_EDGES] * 2, 3)
    assert first is second
    assert_array_equal(first.s[:-1], place_boundary_nodes(cells[1], RANDOM_EDGES, 3))
    first, second = make_meshes(cells, [{"kind": "follow"}] * 2, 3)
    assert not np.array_equal(first.s, second.s)


def test_a_survey_condenses_each_mesh_once_and_tells_of_every_partition(monkeypatch):
    """Two numbers of edges make two meshes; each partition's values are those of its own survey."""
    condensed = []
    original = stability.condense
    monkeypatch.setattr(stability, "condense", lambda mesh: condensed.append(mesh) or original(mesh))
    polygon = square()
    cells = [make_partition(polygon, spec) for spec in SAME_NUMBERS]
    table = survey_pairs(cells, [RANDOM_EDGES] * 2, [2, 3], {})
    assert len(condensed) == 2
    for p in range(2):
        single_survey_pairs = survey_pairs(cells[p : p + 1], [RANDOM_EDGES], [2, 3], {})
        xr.testing.assert_equal(table.isel(partition=[p]), single_survey_pairs)
    assert len(condensed) == 6
