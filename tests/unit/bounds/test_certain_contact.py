"""What is proved of contact, arc by arc: against exact contact sets, and the kernels against quadrature."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

import unilateral as ul
from unilateral.bounds.certain_contact import ContactProof, Verdict, find_certain_contact
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.source import Source
from unilateral.bounds.super_means import (
    RADIUS_RATIO,
    W_NORM,
    Arcs,
    ErrorBounds,
    SuperMeans,
    list_ranges,
    select_along,
)
from unilateral.fem.form import Form
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.case_certificate import certify_case
from unilateral.solution.evaluation import evaluate_at_points, evaluate_u_h

KNOWN_CASES = ["natural", "clamped", "vertex"]
"""Cases with known ends of contact: a square root inside a side, a clamped side, and one at a vertex."""
KNOWN_LEVELS = (16, 32, 64)
SQUARE = Polygon([(0, 0), (1, 0), (1, 1), (0, 1)], "square")
L_SHAPE = Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], "l")


def make_arcs(polygon, *ends):
    """Arcs of side 0 from pairs of arc lengths."""
    start, end = np.array(ends).T
    return Arcs(polygon, 0, start, end)


BOTTOM = make_arcs(SQUARE, (0.0, 1.0))
ONE_ARC = make_arcs(SQUARE, (0.4375, 0.5))


def integrate(f):
    """The integral over the unit half disc of a function of t = r^2: pi/2 int f(t) dt."""
    return 0.5 * math.pi * quad(f, 0, 1, limit=200)[0]


def omega(t):
    return 6 / math.pi * (1 - t) ** 2


def W(t):
    return (-math.log(t) - 3 * (1 - t) + 1.5 * (1 - t**2) - (1 - t**3) / 3) / (2 * math.pi)


def test_the_kernel_is_what_the_proof_takes():
    """int omega = 1, int W = 1/16, ||W||_0 is just below its constant, and the moment is 32 / (35 pi).

    -Laplace W = -omega away from 0: with t = r^2, Laplace W = 4 (t W')'.
    """
    assert integrate(omega) == pytest.approx(1)
    assert integrate(W) == pytest.approx(1 / 16)
    assert 0.999 * W_NORM < math.sqrt(integrate(lambda t: W(t) ** 2)) <= W_NORM
    moment = 2 * quad(lambda r: omega(r**2) * r**2, 0, 1)[0]
    assert moment == pytest.approx(32 / (35 * math.pi))
    d = 1e-4
    for t in (0.2, 0.5, 0.8):
        half = [(t + shift * d / 2) * (W(t + shift * d) - W(t)) / (shift * d) for shift in (-1, 1)]
        assert 4 * (half[1] - half[0]) / d == pytest.approx(omega(t), rel=1e-3)


def means_with(errors, k=1.0, c=0.0):
    """Means on a square that need no solution: f = 3, and half of its norm on each triangle is not known."""
    mesh = make_structured_mesh(SQUARE, 1 / 8)
    n = len(mesh.triangles)
    source = Source(mesh, np.full((n, 3), 3.0), np.zeros(n), np.zeros(n), 1.5 * np.sqrt(mesh.areas))
    data = SimpleNamespace(mesh=mesh, source=source)
    return SuperMeans(data, np.ones(mesh.n_nodes), Form(k=k, c=c), errors, BOTTOM, np.arange(n))


def means_of(mesh, u_h):
    """Means of u_h on a mesh, with all its triangles in the layer."""
    errors = ErrorBounds(0.0, 0.0, 0.0)
    layer = np.arange(len(mesh.triangles))
    return SuperMeans(SimpleNamespace(mesh=mesh), u_h, Form(), errors, BOTTOM, layer)


def test_an_arc_meets_the_intervals_in_which_a_part_of_it_lies():
    """By hand: an end in the middle of an interval, at its end, and both ends in one."""
    points = np.array([0.0, 0.25, 0.5, 1.0])
    arcs = make_arcs(SQUARE, (0.1, 0.3), (0.0, 0.25), (0.25, 0.5), (0.3, 0.4))
    first, end = arcs.find_intervals(points)
    assert first.tolist() == [0, 0, 1, 1]
    assert end.tolist() == [2, 1, 2, 2]


def test_ranges_are_listed_one_after_another():
    """By hand, with an empty one."""
    numbers, owner = list_ranges(np.array([3, 5, 0]), np.array([5, 5, 3]))
    assert numbers.tolist() == [3, 4, 0, 1, 2]
    assert owner.tolist() == [0, 0, 2, 2, 2]


def test_the_part_of_the_error_is_bounded_by_two_fields():
    """int (m_rho - t_R)^2 / (pi r) dr over the half disc of radius R, by quadrature; and 2 / (pi R^2)."""
    radius = 0.1
    R = 0.43
    q = (radius / R) ** 2

    def integrand(t):
        return (1 - (1 - min(t / q, 1)) ** 3 - t) ** 2 / t

    field = math.sqrt(quad(integrand, 0, 1, points=[q], limit=200)[0] / (2 * math.pi))
    bound = means_with(ErrorBounds(1.0, 0.0, 0.0), k=4)._bound_error_losses(radius, R)
    assert field / 2 <= bound <= 1.1 * field / 2
    # the norm of 2 / (pi R^2) over the half disc, whose area is pi R^2 / 2
    kappa = 2 / (math.pi * R**2) * math.sqrt(math.pi * R**2 / 2)
    assert means_with(ErrorBounds(0.0, 1.0, 0.0))._bound_error_losses(radius, R) == pytest.approx(kappa)
    # for c > 0 int W e comes to it
    loss = means_with(ErrorBounds(1.0, 0.5, 0.0), k=1, c=4)._bound_error_losses(radius, R)
    assert loss == pytest.approx(2 * bound + kappa / 2 + 4 * W_NORM * 0.1 * 0.5)


def test_all_triangles_that_half_discs_of_an_arc_meet_are_near_it():
    """Those with a node in a half disc about an end or the midpoint, and those near halves; not all."""
    mesh = make_structured_mesh(SQUARE, 1 / 64)
    means = means_of(mesh, np.ones(mesh.n_nodes))
    near, _ = means.select_near(ONE_ARC)
    radius = RADIUS_RATIO * ONE_ARC.half_length
    for s in (ONE_ARC.start, ONE_ARC.middle, ONE_ARC.end):
        inside = np.hypot(*(mesh.points - [s[0], 0]).T) <= radius
        assert set(np.flatnonzero(inside[mesh.triangles].any(axis=1))) <= set(near)
    assert set(means.select_near(ONE_ARC.halve())[0]) <= set(near)
    assert set(means.select_near(ONE_ARC.halve())[1]) == {0, 1}
    assert len(near) < len(mesh.triangles) / 8


def test_the_layer_along_a_side_has_all_that_half_discs_of_short_arcs_meet():
    """Of arcs with 8 edges; but not the whole mesh. Of a side with fewer edges the whole side counts."""
    mesh = make_structured_mesh(SQUARE, 1 / 128)
    layer = select_along(mesh, BOTTOM, 8)
    means = means_of(mesh, np.ones(mesh.n_nodes))
    for start in (0.0, 0.3, 120 / 128):
        arc = make_arcs(SQUARE, (start, start + 8 / 128))
        distance = np.hypot(*(mesh.points - arc.centre).T)
        inside = distance <= (RADIUS_RATIO + 1) * arc.half_length
        met = np.flatnonzero(inside[mesh.triangles].any(axis=1))
        assert set(met) <= set(layer) & set(means.select_near(arc)[0])
    assert len(layer) < len(mesh.triangles) / 3
    assert len(select_along(mesh, BOTTOM, 200)) == len(mesh.triangles)


def test_the_part_of_the_source():
    """f - c u = 3 - 1 on all triangles, so rho^2 / 16 times 2 / k is gained; the rest is lost by its norm."""
    means = means_with(ErrorBounds(0.0, 0.0, 0.0), k=2, c=1)
    mesh = means.data.mesh
    disc = means.make_half_discs(ONE_ARC, np.array([0.1]), *means.select_near(ONE_ARC))
    area = mesh.areas[disc.triangle].sum()
    loss = means._bound_source_losses(disc)
    assert loss == pytest.approx((W_NORM * 0.1 * 1.5 * math.sqrt(area) - 0.01 / 16 * 2) / 2, rel=1e-6)
    assert area > math.pi * 0.1**2 / 2


@pytest.mark.parametrize(("k", "c"), [(1.0, 0.0), (4.0, 30.0)])
def test_the_force_on_a_tent(k, c):
    """lambda_H = s: int s w = rho times the midpoint, less E N(w)."""
    cells = make_uniform_partition(SQUARE, 1 / 64)
    middle = 0.5 * (cells.points[1:] + cells.points[:-1])
    norm = math.sqrt(k * math.pi / 2 + c * math.pi / 12 / 32**2)
    for E in (0.0, 0.1):
        means = means_with(ErrorBounds(0.0, 0.0, E), k=k, c=c)
        bound = ContactProof(means, cells, middle).bound_tents(ONE_ARC)
        assert bound == pytest.approx(15 / 32 / 32 - E * norm, abs=1e-9)
        assert bound <= 15 / 32 / 32 - E * norm + 1e-15


def test_the_norm_of_a_tent():
    """|w|_1^2 = pi / 2 and ||w||_0^2 = pi / 12 for w = 1 - r on the unit half disc."""
    assert integrate(lambda t: 1) == pytest.approx(math.pi / 2)
    assert integrate(lambda t: (1 - math.sqrt(t)) ** 2) == pytest.approx(math.pi / 12)


@pytest.mark.parametrize("polygon", [L_SHAPE, Polygon([(0, 0), (3, 0), (2.9, 0.4), (0.5, 0.6)], "thin")])
def test_no_side_is_nearer_than_an_arc_is_clear(polygon):
    """Against 4000 points of the boundary, seen from points of the arcs; and it is nearly the distance."""
    places = np.linspace(0, polygon.perimeter, 4001)[:-1]
    sides = polygon.sides_of(places)
    boundary = polygon.at(sides, places - polygon.starts[sides])
    for side, share in np.ndindex(polygon.n_sides, 3):
        start = polygon.starts[side] + (0.3, 0.5, 0.62)[share] * polygon.lengths[side]
        arc = Arcs(polygon, side, np.array([start]), np.array([start + 0.03 * polygon.lengths[side]]))
        distances = [
            np.hypot(*(boundary[sides != side] - polygon.at(np.array([side]), np.array([s]))).T).min()
            for s in np.linspace(arc.start[0], arc.end[0], 5) - polygon.starts[side]
        ]
        assert max(distances) - arc.end + arc.start - 2e-3 < arc.clearance <= min(distances)


@pytest.mark.parametrize(
    ("n", "radius", "half", "roughness"), [(4, 0.25, 0.001, 1), (2, 0.12, 0.05, 1), (64, 0.11, 0.05, 0)]
)
def test_a_mean_is_not_above_that_about_any_point_of_the_arc(n, radius, half, roughness):
    """Against 100 x 100 points of each half disc: of rough u_h, and of one with a kink, nearly met."""
    mesh = make_structured_mesh(SQUARE, 1 / n)
    rng = np.random.default_rng(50)
    arc = make_arcs(SQUARE, (0.5 - half, 0.5 + half))
    r = (np.arange(100) + 0.5) / 100
    angle = r * math.pi
    weight = np.repeat(omega(r**2) * r * math.pi / 100 / 100, 100)
    disc = radius * (r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    for _ in range(10 if roughness else 1):
        u_h = -np.abs(mesh.points[:, 0] - 0.5) + roughness * rng.standard_normal(mesh.n_nodes)
        means = means_of(mesh, u_h)
        near = mesh.areas > 0 if n < 64 else np.hypot(*(mesh.enclosing_circles[0] - arc.centre).T) < 0.2
        near_triangles = np.flatnonzero(near)
        half_disc = means.make_half_discs(arc, np.array([radius]), near_triangles, 0 * near_triangles)
        (mean,), (slope,) = half_disc.bound_means()
        excesses = []
        for s in np.linspace(-half, half, 3):
            values = evaluate_at_points(mesh, disc + np.array([0.5 + s, 0]), partial(evaluate_u_h, mesh, u_h))
            excesses.append(weight @ values - slope * s - mean)
        assert min(excesses) > -2e-3
    assert roughness or max(excesses) < 0.07


def test_half_discs_are_bounded_together_as_each_by_itself():
    """Of 40 arcs of several lengths, so that there are several blocks; -inf where no half disc fits."""
    solution = ul.solve("natural", h=1 / 32, H=1 / 16).bounded
    side = make_arcs(solution.mesh.polygon, (0.0, 1.0))
    errors = ErrorBounds(0.1, 0.1, 0.1)
    layer = select_along(solution.mesh, side, 8)
    means = SuperMeans(solution.data, solution.u_h, solution.form, errors, side, layer)
    starts = np.linspace(0, 0.95, 39)
    longer = make_arcs(side.polygon, (0.0, 1.0), *zip(starts, starts + 0.05, strict=True))
    for arcs in (longer, longer.halve()):
        together = means.bound_gaps(arcs)
        separately = [means.bound_gaps(arcs.select([k]))[0] for k in range(len(together))]
        np.testing.assert_allclose(together, separately, rtol=1e-12)
        assert 0 < np.count_nonzero(together == -math.inf) < len(together) / 2


@pytest.mark.parametrize("slope", [0.0, -2.0])
def test_without_errors_only_the_moment_of_the_weight_is_lost(slope):
    """u = 1 + x + slope y, k = 3, c = 0: u - g = 0.5, and the mean of u is less by 32 rho / (35 pi) |slope|.

    rho is four half lengths of the arc.
    """
    problem = ul.Problem(
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        0,
        ["0.5 + x", None, None, None],
        free_sides=(1, 3),
        k=3,
        c=0,
        u={2: f"1 + x + {slope}"},
        q=[None, 3, None, -3],
    )
    d = ul.solve(problem, h=1 / 16, H=1 / 8).bounded
    u_h = 1 + d.mesh.points @ [1.0, slope]
    layer = np.arange(len(d.mesh.triangles))
    side = make_arcs(problem.polygon, (0.0, 1.0))
    means = SuperMeans(d.data, u_h, d.form, ErrorBounds(0.0, 0.0, 0.0), side, layer)
    expected = 0.5 + slope * 32 * 0.125 / (35 * math.pi)
    for start in (0.25, 0.5):
        (gap,) = means.bound_gaps(make_arcs(problem.polygon, (start, start + 0.0625)))
        assert gap == pytest.approx(expected, abs=1e-6)
        assert gap <= expected


def contact_of(solution):
    """The exact contact set of a case: side, start, end from the start of the side."""
    lengths = solution.polygon.lengths
    contact = certify_case(solution.problem.exact).contact
    return [(side, start * lengths[side], end * lengths[side]) for side, start, end in contact]


def list_contradictions(arcs, contact):
    """Arcs that are called free and meet the contact set, and those said to touch that do not."""
    wrong = []
    for arc in arcs:
        met = [
            c for c in contact if c[0] == arc.side and c[1] <= arc.end + 1e-12 and c[2] >= arc.start - 1e-12
        ]
        inside = [c for c in met if c[1] < arc.end - 1e-9 and c[2] > arc.start + 1e-9]
        if (arc.verdict is Verdict.FREE and inside) or (arc.verdict is Verdict.TOUCHES and not met):
            wrong.append(arc)
    return wrong


def total_length(arcs, verdict):
    return sum(arc.end - arc.start for arc in arcs if arc.verdict is verdict)


@pytest.mark.parametrize("name", KNOWN_CASES)
def test_what_is_certain_never_contradicts_a_known_contact_set(name):
    """On all levels; arcs cover the sides with contact once, and ends of contact lie in no free arc."""
    for n in KNOWN_LEVELS:
        solution = ul.solve(name, h=1 / n, H=2 / n)
        arcs = solution.contact.certain
        assert not list_contradictions(arcs, contact_of(solution))
        for side in solution.problem.contact_sides:
            side_arcs = [arc for arc in arcs if arc.side == side]
            ends = [side_arcs[0].start, *(arc.end for arc in side_arcs)]
            assert ends[:-1] == [arc.start for arc in side_arcs]
            assert (ends[0], ends[-1]) == pytest.approx((0, solution.polygon.lengths[side]))
    assert total_length(arcs, Verdict.TOUCHES) > 0.1


def test_the_undecided_length_falls_as_the_theory_says():
    """By h^(2/3) up to the factor 2 of halved arcs: over three halvings of h to at most a half."""
    lengths = [
        total_length(ul.solve("clamped", h=1 / n, H=2 / n).contact.certain, Verdict.UNDECIDED)
        for n in (8, 64)
    ]
    assert lengths[1] <= lengths[0] / 2


def spoil(solution, share, u_rise=0.0, lambda_rise=0.0):
    """What is certain for a u_h and a lambda_H that are too high, with that share of the bounds."""
    d = solution.bounded
    u_h = d.u_h + u_rise
    lambda_H = d.lambda_H.copy()
    lambda_H[d.cells] += lambda_rise
    bound = local_bound(d.data, d.partition, u_h, lambda_H, d.form)
    bound = replace(bound, u=share * bound.u, lambda_=share * bound.lambda_, eta=share * bound.eta)
    return find_certain_contact(d.data, d.partition, u_h, lambda_H, d.form, bound)


@pytest.mark.parametrize(
    ("name", "spoilt", "verdict"),
    [
        ("vertex", {"u_rise": 0.3}, Verdict.FREE),
        ("vertex", {"lambda_rise": 3.0}, Verdict.TOUCHES),
    ],
)
def test_a_bound_that_is_a_hundred_times_too_small_is_noticed(name, spoilt, verdict):
    """Control: contact is called free where u_h is too high, and gaps touch where lambda_H is.

    With the true bounds neither happens.
    """
    solution = ul.solve(name, h=1 / 32, H=1 / 16)
    contact = contact_of(solution)
    assert not list_contradictions(spoil(solution, 1.0, **spoilt), contact)
    assert {arc.verdict for arc in list_contradictions(spoil(solution, 0.01, **spoilt), contact)} == {verdict}
