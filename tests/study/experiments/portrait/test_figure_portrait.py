"""The picture of a solution: its table against the solution, and what of it is drawn."""

import numpy as np
import pytest
from pages import draw_page, lines, list_texts, read_committed_table

import unilateral as ul
from study.experiments.portrait import portrait_figure as portrait
from unilateral.geometry.polygon import find_polygon

F = "-1 - 3*x - 9*x*y"
DOMAIN = find_polygon("lshape")


@pytest.fixture(scope="module")
def table():
    return portrait.table("lshape", F, "1/8", "1/4", "1/16")


@pytest.fixture(scope="module")
def solution():
    """By the library's way from outside."""
    return ul.solve(ul.Problem(DOMAIN, F, 0), h=1 / 8, H=1 / 4)


def rows(table, kind, origin="computed"):
    return table[(table["kind"] == kind) & (table["of"] == origin)]


def test_the_triangles_cover_the_domain_and_u_h_is_one_value_at_each_node(table):
    field = rows(table, "mesh")
    corners = field[["x", "y"]].to_numpy().reshape(-1, 3, 2)
    a = corners[:, 1] - corners[:, 0]
    b = corners[:, 2] - corners[:, 0]
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert np.all(areas > 0)
    assert areas.sum() == pytest.approx(3, rel=1e-12)
    assert (field.groupby(["x", "y"])["value"].nunique() == 1).all()


def test_values_are_those_of_the_library(table, solution):
    """An absolute algebraic error of the size of both guaranteed stops."""
    field = rows(table, "mesh")
    cells = rows(table, "cell")
    u = solution.u_at(field[["x", "y"]].to_numpy())
    np.testing.assert_allclose(field["value"], u, rtol=0, atol=1e-2 * np.ptp(u))
    np.testing.assert_allclose(
        cells["value"], solution.multiplier, rtol=0, atol=1e-2 * solution.multiplier.max()
    )


def test_nodes_lie_on_the_boundary_where_the_arc_length_says(table):
    """Every vertex once for either side; 8 edges in a unit on a perimeter of 8."""
    nodes = rows(table, "node")
    assert len(nodes) == 8 * 8 + DOMAIN.n_sides
    side = nodes["side"].to_numpy(dtype=int)
    position = DOMAIN.at(side, nodes["s"].to_numpy() - DOMAIN.starts[side])
    np.testing.assert_allclose(nodes[["x", "y"]], position, rtol=0, atol=1e-12)
    inside = rows(table, "mesh").groupby(["x", "y"])["value"].first()
    assert nodes["value"].tolist() == inside.loc[list(zip(nodes["x"], nodes["y"], strict=True))].tolist()


def test_cells_follow_each_other_and_those_of_the_reference_are_finer(table):
    for origin, H in (("computed", 1 / 4), ("reference", 1 / 8)):
        cells = rows(table, "cell", origin)
        np.testing.assert_allclose(cells["end"] - cells["s"], H, rtol=1e-12)
        assert cells["s"].tolist()[1:] == cells["end"].tolist()[:-1]


def test_contact_is_drawn_where_the_reference_has_a_multiplier():
    """At the foot of the lower panel."""
    committed_table = read_committed_table("portrait")
    figure, _ = draw_page("portrait", committed_table)
    lower = figure.axes[3]
    assert lower.get_xlabel().startswith("arc length")
    (foot,) = [line for line in lower.lines if line.get_color() == portrait.CONTACT_LOOK["color"]]
    cells = rows(committed_table, "cell", "reference")
    in_contact = cells["value"] > 0
    assert 0.2 < in_contact.mean() < 0.8
    middle = (cells["s"] + cells["end"]) / 2
    np.testing.assert_allclose(foot.get_xdata(), middle.where(in_contact))


def test_nodes_steps_and_sizes_are_drawn():
    committed_table = read_committed_table("portrait")
    figure, _ = draw_page("portrait", committed_table)
    nodes = rows(committed_table, "node")
    assert lines(figure.axes[3], markers=True) == [[*zip(nodes["s"], nodes["value"].round(9), strict=True)]]
    assert "$u_h$,  $h=1/10$,  $H=1/4$" in list_texts(figure)
    steps = [value for patch in figure.axes[2].patches for value in patch.get_data().values]
    assert set(steps) == set(rows(committed_table, "cell")["value"])
