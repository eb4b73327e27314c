"""Each term of what is known at the ends of clamped sides, on boundaries with numbers made by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import bound_arguments

import unilateral as ul
from unilateral.bounds import clamped_ends as module
from unilateral.bounds import local_bounds
from unilateral.bounds.clamped_ends import (
    LOWERING_PER_REMAINDER,
    ClampedEnds,
    ReactionData,
    conflict_allowances,
    gap_nodes,
    no_clamped_ends,
    no_reactions,
    outflows,
)
from unilateral.bounds.constraint import quadratic_lower_bounds
from unilateral.fem.form import Form
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh

LENGTHS = np.array([0.1, 0.2, 0.3, 0.4])
"""Of the four edges of each side of the unit square, along the boundary."""
BOUNDARY = SimpleNamespace(
    polygon=square(),
    side=np.repeat(np.arange(4), 4),
    boundary=np.arange(16),
    s=np.concatenate([[0.0], np.cumsum(np.tile(LENGTHS, 4))]),
)
U_H = np.array([3.0, 2.5, 2.0, 2.8, 1.2])
"""Values at the five nodes of side 0; the gaps above 0 on its edges are 2.5, 2, 2 and 1.2."""


def ends(clamped, u_on_side_0=U_H, doubts=(), pushed=(), upper=()):
    """Side 0 has g = 0, and so has the clamped one, which is above it; all others are free.

    `doubts`, `pushed` and `upper` change numbers of edges.
    """
    edges = np.flatnonzero(np.isin(BOUNDARY.side, [0, clamped]))
    g = SimpleNamespace(
        edge=np.repeat(edges, 2), g_upper=np.zeros(2 * len(edges)), remainder=np.zeros(2 * len(edges))
    )
    for edge, doubt in doubts:
        g.remainder[np.flatnonzero(g.edge == edge)[0]] = doubt
    for edge, high in upper:
        g.g_upper[np.flatnonzero(g.edge == edge)[0]] = high
    push = np.zeros(16)
    u_h = np.full(16, 9.0)
    push[list(pushed)] = 1e-9
    u_h[:5] = u_on_side_0
    v_lower = quadratic_lower_bounds(u_h, np.roll(u_h, -1), 0.5 * (u_h + np.roll(u_h, -1)))
    form = Form(c=0.0, clamped=(clamped,), free=tuple({1, 2, 3} - {clamped}))
    lift = SimpleNamespace(constraint=g)
    return module.find_clamped_ends(BOUNDARY, form, lift, v_lower, SimpleNamespace(contact_scale=push), 7.0)


def test_the_part_after_a_clamped_side_has_its_least_gap():
    """Up to where the gap is below half of 2.5: three edges, on which it is 2 at least."""
    clamped_ends = ends(clamped=3)
    assert clamped_ends.gap_length == pytest.approx([0.1 + 0.2 + 0.3, 0, 0, 0])
    assert clamped_ends.gamma == pytest.approx([2.0, 1, 1, 1])
    assert clamped_ends.gamma_force_bound == 7.0


def test_the_part_before_a_clamped_side_runs_backwards():
    """From the other end of side 0, with its longest edge first; gaps are 2.5, 2, 2, 1.2 from there."""
    clamped_ends = ends(clamped=1, u_on_side_0=U_H[::-1])
    assert clamped_ends.gap_length == pytest.approx([0, 0.4 + 0.3 + 0.2, 0, 0])
    assert clamped_ends.gamma == pytest.approx([1, 2.0, 1, 1])


def test_where_all_of_a_side_is_wide_all_of_it_counts():
    clamped_ends = ends(clamped=3, u_on_side_0=np.full(5, 2.0))
    assert (clamped_ends.gap_length[0], clamped_ends.gamma[0]) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize("u_at_vertex", [0.0, -1.0])
def test_without_a_gap_at_the_vertex_nothing_is_known(u_at_vertex):
    clamped_ends = ends(clamped=3, u_on_side_0=np.array([u_at_vertex, 2, 2, 2, 2]))
    assert not clamped_ends.gap_length.any()


def test_beside_free_sides_nothing_is_known():
    """Sides 3 and 2 meet at vertex 3, sides 0 and 1 at vertex 1: no g, so no gap."""
    assert np.flatnonzero(ends(clamped=3).gap_length).tolist() == [0]


def test_the_highest_g_on_an_edge_counts():
    """One of two intervals of edge 1 has g up to 1/4."""
    assert ends(clamped=3, upper=[(1, 0.25)]).gamma[0] == pytest.approx(1.75)


@pytest.mark.parametrize("edge", [0, 1, 2])
def test_the_doubt_on_an_edge_and_those_beside_it_lowers_v(edge):
    """v may be lower by the doubt at nodes, which belong to two edges. The least gap is that of edge 1 or 2.

    By `shift_to_feasible` v is lowered by the remainder of one of the edges, and g is known up to its own: 2
    at least.
    """
    assert LOWERING_PER_REMAINDER >= 2
    clamped_ends = ends(clamped=3, doubts=[(edge, 0.01)])
    assert clamped_ends.gamma[0] == pytest.approx(2.0 - LOWERING_PER_REMAINDER * 0.01)


def test_the_doubt_of_the_clamped_side_lowers_v_at_the_vertex():
    """u_D is known up to 0.4 on the last edge of side 3, so v may be lower by that at vertex 0, and not g."""
    clamped_ends = ends(clamped=3, doubts=[(15, 0.4)])
    assert clamped_ends.gamma[0] <= 2.5 - 0.4
    assert clamped_ends.gamma[0] == pytest.approx(2.5 - LOWERING_PER_REMAINDER * 0.4)
    assert not ends(clamped=3, doubts=[(15, 0.7)]).gap_length.any()


@pytest.mark.parametrize(("pushed", "reach"), [(3, 0.1 + 0.2), (2, 0.1), (1, 0.0), (0, 0.0), (15, 0.0)])
def test_next_to_contact_there_is_no_gap(pushed, reach):
    """v may be below u_h on an edge with lambda_H > 0, and so at its ends, which other edges share."""
    assert ends(clamped=3, pushed=[pushed]).gap_length[0] == pytest.approx(reach)


def clamps(reach, gamma, product=6.0, clamped=(3,), free=()):
    form = Form(c=0.0, clamped=clamped, friedrichs=2.0, free=free)
    known_clamped_ends = ClampedEnds(np.array(reach, float), np.array(gamma, float), product)
    return ReactionData(form, np.zeros((2, 4)), known_clamped_ends, 0.5)


def test_forces_lack_the_product_over_the_gap():
    """int lambda <= <lambda, v - g> / gamma where v - g >= gamma; the bound above of side 0 lacks it."""
    known_clamps = clamps([0.3, 0, 0, 0], [3, 1, 1, 1])
    assert conflict_allowances(BOUNDARY, np.array([0]), known_clamps) == (0.0, 2.0)
    assert conflict_allowances(BOUNDARY, np.array([3]), clamps([0.3, 0, 0, 0.4], [3, 1, 1, 12])) == (2.0, 0.0)


@pytest.mark.parametrize(("reach", "amount"), [(0.1, 2.0), (0.09, math.inf)])
def test_the_first_edge_has_to_lie_within_reach(reach, amount):
    """Else w has no node on which to pass from one side to the other; side 0 begins with an edge of 0.1."""
    assert conflict_allowances(BOUNDARY, np.array([0]), clamps([reach, 0, 0, 0], [3, 1, 1, 1]))[1] == amount


@pytest.mark.parametrize(("reach", "amount"), [(0.4, 2.0), (0.39, math.inf)])
def test_before_a_clamped_side_it_is_the_last_edge(reach, amount):
    known_clamps = clamps([0, reach, 0, 0], [1, 3, 1, 1], clamped=(1,))
    assert conflict_allowances(BOUNDARY, np.array([0]), known_clamps)[1] == amount


@pytest.mark.parametrize("gamma", [[3, 2, 1, 1], [2, 3, 1, 1]])
def test_of_two_ends_the_worse_one_counts(gamma):
    """Side 0 between two clamped ones. lambda >= 0, so both pieces together have at most that."""
    known_clamps = clamps([0.1, 0.4, 0, 0], gamma, clamped=(1, 3))
    assert conflict_allowances(BOUNDARY, np.array([0]), known_clamps) == (0.0, 3.0)
    known_clamps = clamps([0.1, 0.3, 0, 0], [3, 2, 1, 1], clamped=(1, 3))
    assert conflict_allowances(BOUNDARY, np.array([0]), known_clamps)[1] == math.inf


@pytest.mark.parametrize(("reach", "nodes"), [(0.1, []), (0.31, [1]), (0.59, [1]), (0.61, [1, 2])])
def test_w_is_lower_only_at_nodes_between_edges_within_reach(reach, nodes):
    assert gap_nodes(BOUNDARY, 0, clamps([reach, 0, 0, 0], [1, 1, 1, 1])).tolist() == nodes


@pytest.mark.parametrize(("reach", "nodes"), [(0.41, []), (0.71, [3]), (0.91, [2, 3])])
def test_before_a_clamped_side_nodes_are_counted_from_its_vertex(reach, nodes):
    known_clamps = clamps([0, reach, 0, 0], [1, 1, 1, 1], clamped=(1,))
    assert sorted(gap_nodes(BOUNDARY, 1, known_clamps).tolist()) == nodes


def test_the_depth_is_the_smaller_one_of_the_layer_and_friedrichs_constant():
    """||v||_0 is at most C |v|_1 and, where c > 0, at most the energy norm over c^(1/2)."""
    known_clamps = clamps([0] * 4, [1] * 4)  # C = 2
    for k, c, depth in (
        (1, 0, 2.0),
        (9, 0, 2.0),
        (9, 1, 2.0),
        (1, 1e-30, 2.0),
        (1, 4, 0.5),
        (1e-50, 1e50, 1e-50),
    ):
        assert known_clamps._replace(form=known_clamps.form._replace(k=k, c=c)).depth == pytest.approx(
            depth, rel=1e-14
        )
    assert no_reactions(4).depth == 1.0
    assert not no_clamped_ends(4).gap_length.any()


def test_outflows_are_the_flux_through_clamped_sides_and_its_magnitude():
    """q.n = 1 - 2 t on the left side of the square, 0 elsewhere; flows are given towards the inside."""
    mesh = make_structured_mesh(square(), 1 / 2)
    q = np.zeros((2, len(mesh.triangulation.ends)))
    q[0, mesh.triangulation.boundary_edges] = np.arange(8.0) * [1, 1, 1, 1, 1, 1, 1, -1]
    flux_through_sides = outflows(mesh, Form(c=0.0, clamped=(3,)), q)
    assert flux_through_sides.tolist() == [[0, 0, 0, -6.0 + 7.0], [0, 0, 0, 13.0]]


# gamma <lambda, w> <= B + S^2 / 4, where S has all parts of the residual of v, each made large


@pytest.fixture(scope="module")
def arguments():
    """Of `local_bound` for a membrane that is clamped on the left and has a gap on the right."""
    problem = ul.Problem(square(), -1, [None, -1, None, None], [0, 2], c=0, u={3: 0})
    return bound_arguments(ul.solve(problem, h=1 / 4, H=1 / 2).solved)


@pytest.mark.parametrize(("u", "gap_length"), [(-0.4, 1.0), (-0.9, 0.0)])
def test_gamma_is_no_more_than_the_gap_between_the_nodes(u, gap_length):
    """u_h is constant, u_D = 0 on side 0, g = -1: u_h + y is 0 at the vertex, and dips below u_h beside it.

    For u_h = -0.9 it dips to 0.0006 above g, where nothing is known. Control: v is u_h beyond the first edge.
    """
    solved = ul.solve(ul.Problem(square(), 0, -1, u={0: 0}), h=1 / 8, H=1 / 4).solved
    data, partition, _, lambda_H, form = bound_arguments(solved)[:5]
    mesh = data.mesh
    bound = local_bounds.local_bound(data, partition, np.full(mesh.n_nodes, u), 0 * lambda_H, form)
    start = u + bound.lift[0]
    x = np.linspace(0, 1, 101)
    v = np.outer(start, 1 - x) + np.outer(np.roll(start, -1), x) + np.outer(bound.lift[1], 4 * x * (1 - x))
    gap = v[mesh.side == 1] + 1
    assert bound.clamped_ends.gap_length[1] == gap_length
    assert not gap_length or 0.3 < bound.clamped_ends.gamma[1] <= gap.min() < 0.56
    assert gap.min() < gap[1:].min() == pytest.approx(1 + u)


def test_quadratic_functions_are_at_least_their_bounds():
    """As values at 101 points are. Control: the bound is sharp for linear ones."""
    start, end, middle = np.random.default_rng(1).standard_normal((3, 100))
    x = np.linspace(0, 1, 101)[:, None]
    v = start * (1 - x) * (1 - 2 * x) + end * x * (2 * x - 1) + middle * 4 * x * (1 - x)
    assert np.all(quadratic_lower_bounds(start, end, middle) <= v.min(axis=0) + 1e-15)
    linear = quadratic_lower_bounds(start, end, 0.5 * (start + end))
    assert linear == pytest.approx(np.minimum(start, end))


LARGE = 1e6
"""All other parts of the bounds are below 1."""


def test_the_product_has_a_quarter_of_the_square_of_the_residual(arguments, monkeypatch):
    """The field q - k grad v is that large on one triangle; of u_h it is as before."""
    original = local_bounds.add_lift_to_residual

    def move_parts(components, *arguments):
        original(components, *arguments)
        components.misfit[0] = LARGE

    monkeypatch.setattr(local_bounds, "add_lift_to_residual", move_parts)
    bound = local_bounds.local_bound(*arguments)
    assert LARGE**2 / 4 <= bound.clamped_ends.gamma_force_bound <= LARGE**2 / 4 * (1 + 1e-5)
    assert bound.u < LARGE


def raise_by_shortfall(monkeypatch, **options):
    """`Shortfall` has other numbers on the first boundary edge, which has no other part in the product."""
    original = local_bounds.build_lifting

    def lifting(*arguments):
        lift_map = original(*arguments)

        class Lifted(type(lift_map)):
            def make_feasible(self, nodal, bubbles):
                lift = lift_map.make_feasible(nodal, bubbles)
                first = np.arange(len(nodal)) == 0
                changed = {name: np.where(first, value, 0.0) for name, value in options.items()}
                return lift._replace(shortfall=lift.shortfall._replace(**changed))

        return Lifted(*lift_map)

    monkeypatch.setattr(local_bounds, "build_lifting", lifting)


def test_the_product_has_the_slack_once(arguments, monkeypatch):
    raise_by_shortfall(monkeypatch, edge_complementarity=LARGE)
    assert LARGE <= local_bounds.local_bound(*arguments).clamped_ends.gamma_force_bound <= LARGE + 1


def test_the_product_has_a_quarter_of_the_square_of_the_extension(arguments, monkeypatch):
    """The energy norm of w is 1e6, of what is missing at the boundary."""
    raise_by_shortfall(monkeypatch, extension_squares=LARGE**2)
    gamma_force_bound = local_bounds.local_bound(*arguments).clamped_ends.gamma_force_bound
    assert LARGE**2 / 4 <= gamma_force_bound <= LARGE**2 / 4 * (1 + 1e-5)
