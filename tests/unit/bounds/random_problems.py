"""Random problems with known solutions on random polygons, each told by its number.

u' and the gap u' - g' are made on a polygon of the size of 1. The problem has u(x) = A u'((x - a) / S) with
powers of ten and two for A and S. Vertices and numbers in formulas are dyadic, so that they are what they
look like in floating point, and conditions such as du/dn = 0 hold exactly.
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import sympy
from conftest import case_file
from known_solutions import Catalogued, Feature, Known, KnownSolution, fluxes
from random_polygons import columns, distances, draw_over_base, star, wedge
from symbolic import X, Y, plain, pos

from unilateral.adaptive.loop import make_edge_pair_mesh
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.discrete.condensed import discretise_on_condensed_spaces
from unilateral.discrete.multilevel import discretise_on_adapted_mesh
from unilateral.discrete.problem_data import problem_form
from unilateral.fem.condense import condense
from unilateral.fem.p1 import energy_norm
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.expression import ZERO
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import mark_triangles, refine_and_balance, start_adapted_mesh
from unilateral.geometry.plane import segment_distances
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import default_mesh_kind
from unilateral.problems import case as cases
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop

POWERS = [2, sympy.Rational(5, 2), 3, 4]
"""The powers of kinks in u; the first one makes f jump."""
FAR = 1e6
"""Sides away from a side, farther than any other part of a polygon."""


ADAPTED = 3
"""Adapted meshes after a uniform one."""
KINDS = ("formula", "flux", "corner")


def try_kind(kind, number, folder):
    """A problem of a kind, with discrete solutions."""
    if kind == "corner":
        mesh = place_corner_singularity(number, folder)
    else:
        mesh = {"formula": make_random_problem, "flux": give_fluxes}[kind](number)
    rng = np.random.default_rng([17, number])
    return KnownSolution(mesh, [(solved, [*pairs(solved, rng)]) for solved in solutions(mesh.problem, rng)])


def solutions(problem, rng):
    """On a uniform mesh, there with cells that are not made of edges, and on adapted ones."""
    polygon = problem.polygon
    stop = Stop()
    H = polygon.lengths.max() / rng.integers(1, 5)
    mesh, cells = uniform(polygon, H, rng.random())
    form = problem_form(problem, mesh)
    factorised = condense(mesh, form)
    data = enclose_data(problem, mesh, form)  # of a case, too, which is solved without them
    discrete = discretise_on_condensed_spaces(problem, mixed_spaces(factorised, cells), data.source)
    solution = replace(discrete, data=data).solve(stop)
    yield solution
    shifted = partitions.make_shifted_partition(polygon, 1.3 * H, rng.random())
    discrete = discretise_on_condensed_spaces(problem, mixed_spaces(factorised, shifted), data.source)
    yield replace(discrete, data=data).solve(stop)
    adapted_mesh = start_adapted_mesh(mesh)
    discrete = None
    for _ in range(ADAPTED):
        adapted_mesh = refine_and_balance(
            adapted_mesh, mark_triangles(adapted_mesh.mesh, solution.bound_shares)
        )
        discrete = discretise_on_adapted_mesh(problem, adapted_mesh, discrete, solution)
        solution = discrete.solve(stop)
        yield solution


def uniform(polygon, H, choice):
    """A structured mesh where there is one, or a mesh by gmsh, halved or not; and its cells."""
    if choice < 0.4:
        return meshes.triangulate_from_cells(partitions.make_uniform_partition(polygon, 2 * H), 2, 1)
    adapted_mesh = start_adapted_mesh(
        make_edge_pair_mesh(polygon, H, default_mesh_kind(polygon) if choice < 0.8 else "unstructured")
    )
    return adapted_mesh.mesh, adapted_mesh.partition


def pairs(solved, rng):
    """(u_h, lambda_H), and others that do not solve the discrete problem."""
    u = solved.u_h
    lambda_H = solved.lambda_H
    mesh = solved.mesh
    noise = rng.standard_normal(len(u))
    noise *= 10.0 ** rng.uniform(-4, 1) * energy_norm(mesh, u) / energy_norm(mesh, noise)
    inside = u.copy()
    inside[mesh.boundary] = 0.0
    yield u, lambda_H
    yield u + noise, lambda_H
    yield u, lambda_H * rng.uniform(0, 2, len(lambda_H))
    yield u * rng.uniform(-1, 2), np.zeros_like(lambda_H)
    yield inside, lambda_H


class Part(NamedTuple):
    """A term of u', and what is narrow in it."""

    u: sympy.Expr
    features: tuple[Feature, ...] = ()


def make_random_problem(number):
    """Of one of the families, large or small, far from the origin or not."""
    rng = np.random.default_rng([16, number])
    family = FAMILIES[number % len(FAMILIES)]
    vertices, components, gap, free = family(rng)
    a = [dyadic(c) for c in rng.choice([0, 1, 30]) * rng.uniform(-1, 1, 2)]
    S = _size(rng)
    A = sympy.Integer(10) ** int(rng.choice([0, 0, -8, 8]))
    place = {X: (X - a[0] * S) / S, Y: (Y - a[1] * S) / S}
    u = sum(component.u for component in components)
    f = plain(A * (u - laplacian(u) / S**2).xreplace(place))
    g = tuple(plain((A * (u - gap_on_side)).xreplace(place)) for gap_on_side in gap)
    features = [feature for component in components for feature in component.features]
    shifted_features = tuple(
        Feature((S * level).xreplace(place), float(S * width)) for level, width in features
    )
    polygon = Polygon((vertices + np.array(a, dtype=float)) * float(S), f"{family.__name__}_{number}")
    return Known(Problem(polygon.name, polygon, f, g, free), (A * u).xreplace(place), shifted_features)


def give_fluxes(number):
    """The same problem with du/dn given on some sides, in contact before or not: all but one at most."""
    known_case = make_random_problem(number)
    rng = np.random.default_rng([20, number])
    vertices = known_case.problem.polygon.vertices
    free = known_case.problem.free_sides
    remaining_sides = np.setdiff1d(np.arange(len(vertices)), free)
    some = rng.choice(
        remaining_sides,
        rng.integers(1, len(remaining_sides)) if len(remaining_sides) > 1 else 0,
        replace=False,
    ).tolist()
    q = tuple(plain(u) if i in some else ZERO for i, u in enumerate(fluxes(known_case.u, vertices)))
    return known_case._replace(
        problem=replace(known_case.problem, free_sides=tuple(sorted([*free, *some])), q=q)
    )


def place_corner_singularity(number, folder):
    """A singular function at a vertex or on a side: without flux, without trace, or where contact begins."""
    rng = np.random.default_rng([18, number])
    kind = ["free", "held", "transition", "harmonic"][number % 4]
    vertices = star(rng) if kind == "harmonic" else wedge(rng)
    polygon = Polygon(vertices * float(_size(rng)), f"{kind}_{number}")
    position = 0.0 if kind != "harmonic" else round(rng.uniform(0.2, 0.5), 3)
    side = int(rng.integers(polygon.n_sides)) if position else 0
    R = f"{0.9 * _room(polygon, side, position):.5f}"
    times = round(10.0 ** rng.uniform(-1, 1), 3)
    alpha = ["-1/4", "-1/10", "1/10", "1/3", "1/2", "5/4"][rng.integers(6)]
    atom = {"atom": "corner", "kind": kind, "side": 0, "cutoff": R, "times": times}
    u, gap, elsewhere = {
        "free": ([atom, {"atom": "smooth", "formula": 1}], {}, 1),
        "held": ([atom, {"atom": "smooth", "formula": "x**2 + y**2"}], {}, 0),
        "transition": (
            [atom | {"alpha": alpha}],
            {0: f"pos(t - {R}, 2)", -1: f"(1 - {R})**2*pos(1 - t, 2)"},
            f"(1 - {R})**2",
        ),
        "harmonic": (
            [{"atom": kind, "side": 0, "at": position, "alpha": alpha, "cutoff": R, "times": times}],
            {0: f"pos({position} - t, 2) + pos({position}/(1 - {position} - {R})*(t - {position} - {R}), 2)"},
            f"{position}**2",
        ),
    }[kind]
    sides = [{"side": i, "formula": formula} for i, formula in gap.items()]
    file = case_file(folder, "thirds", u=u, gap={"sides": sides, "elsewhere": elsewhere})
    return Catalogued(cases.load_solution(file, polygon, side).problem)


def _room(polygon, side, position):
    """The distance of a place on a side from others and from the side's ends, in side lengths."""
    other_sides = np.setdiff1d(
        np.arange(polygon.n_sides), [side] if position else [side, (side - 1) % polygon.n_sides]
    )
    starts = polygon.vertices
    ends = np.roll(polygon.vertices, -1, axis=0)
    apart = segment_distances(polygon.point(side, position)[None], starts[other_sides], ends[other_sides])
    nearest = min(apart.min(initial=np.inf), np.inf if position else polygon.lengths[side - 1])
    return min(nearest / polygon.lengths[side], 1 - position)


def _size(rng):
    return sympy.Integer(2) ** int(rng.choice([0, 0, 0, -4, -2, 2, 5, 10]))


def laplacian(u):
    return sympy.diff(u, X, 2) + sympy.diff(u, Y, 2)


def dyadic(number):
    """That number, up to 2^-20 of 1 or, if it is smaller, of its own size."""
    unit = sympy.Integer(2) ** (20 - min(int(np.floor(np.log2(abs(number)))), 0) if number else 0)
    return sympy.Integer(round(float(number * unit))) / unit


# Terms of u'


def bowl(c=(0, 0)):
    return Part(((X - c[0]) ** 2 + (Y - c[1]) ** 2) / 2)


def gentle(rng, slope):
    """A term whose gradient is at most `slope` within a distance of 1 from 0."""
    centre = rng.uniform(-0.6, 0.6, 2)
    a = dyadic(centre[0])
    b = dyadic(centre[1])
    kind = rng.choice(["wave", "peak", "circle", "line", "front", "rational", "cosh", "cubic"])
    if kind == "wave":
        k = rng.uniform(-1, 1, 2) * 10.0 ** rng.uniform(0, 1.7)
        wave = sympy.sin(dyadic(k[0]) * X + dyadic(k[1]) * Y + a)
        width = 1 / float(np.hypot(*k))
        return Part(dyadic(0.9 * slope * width) * wave, (Feature(sympy.S.Zero * X, width),))
    if kind in ("peak", "rational"):
        w = dyadic(10.0 ** rng.uniform(-2.5, -0.3))
        square = (X - a) ** 2 + (Y - b) ** 2
        shape = sympy.exp(-square / w**2) if kind == "peak" else 1 / (1 + square / w**2)
        return Part(dyadic(slope * float(w)) * shape, (Feature(sympy.sqrt(square), float(w)),))
    if kind == "circle":
        r = dyadic(rng.uniform(0.05, 0.5))
        square = (X - a) ** 2 + (Y - b) ** 2
        k = POWERS[rng.integers(3)]
        ring = Feature(sympy.sqrt(square) - r, float(r) / 20)
        return Part(dyadic(slope * float(r) / 6) * pos(1 - square / r**2, k), (ring,))
    angle = rng.uniform(0, 2 * np.pi)
    level = dyadic(np.cos(angle)) * X + dyadic(np.sin(angle)) * Y + a
    if kind == "line":
        return Part(dyadic(slope / 9) * pos(level, POWERS[rng.integers(3)]), (Feature(level, 8e-3),))
    k = dyadic(rng.uniform(1, 8))
    if kind == "front":
        return Part(
            dyadic(0.9 * slope / float(k) / 4) * sympy.tanh(4 * k * level),
            (Feature(level, 1 / float(4 * k)),),
        )
    if kind == "cosh":
        return Part(dyadic(slope / float(k) / np.exp(float(k))) * sympy.cosh(k * X))
    return Part(dyadic(slope / 3) * X * Y * (X + a))


def bump(rng, polygon):
    """A term in a disc inside, as high as it likes; f may jump at the circle, or at a line in the disc."""
    centre = _inside(rng, polygon)
    starts = polygon.vertices
    room = float(segment_distances(centre[None], starts, np.roll(starts, -1, axis=0)).min())
    r = dyadic(0.9 * room * 10.0 ** -rng.choice([0, 0, 0.3, 0.6, 1.2]))
    a = dyadic(centre[0])
    b = dyadic(centre[1])
    square = (X - a) ** 2 + (Y - b) ** 2
    k = [*POWERS, 4, 6, 8][rng.integers(7)]
    height = dyadic(
        float(rng.choice([-1, 1])) * float(r) * 10.0 ** (rng.uniform(-1, 1) + rng.choice([0, 0, 0, 0, -8, 8]))
    )
    u = height * pos(1 - square / r**2, k)
    disc = Feature(pos(sympy.sqrt(square) - r, 1), float(r) / 4)
    features = (disc, Feature(sympy.sqrt(square) - r, float(r) / 20)) if k < 3 else (disc,)
    if rng.random() < 0.3:
        level = (X - a) + dyadic(rng.uniform(-2, 2)) * (Y - b)
        u = u * pos(level, 2) / r**2
        features = (*features, disc._replace(width=float(r) / 20))
    return Part(u, features)


def _inside(rng, polygon):
    low = polygon.vertices.min(axis=0)
    high = polygon.vertices.max(axis=0)
    while True:
        points = rng.uniform(low, high, (50, 2))
        point = points[polygon.contains(points)]
        if len(point):
            return point[0]


def flat(rng, vertices):
    """A smooth term that is 0 with its gradient on every side; 0 for polygons of many sides."""
    if len(vertices) > 6:
        return Part(sympy.S.Zero)
    edges = np.roll(vertices, -1, axis=0) - vertices
    product = sympy.S.One
    position = vertices.mean(axis=0)
    for (x, y), (ex, ey) in zip(vertices, edges, strict=True):
        scale = max(float(np.hypot(ex, ey) * np.abs(vertices - position).max()), 1e-3)
        product *= ((exact(ex) * (Y - exact(y)) - exact(ey) * (X - exact(x))) / dyadic(scale)) ** 2
    k = [dyadic(c) for c in rng.uniform(-6, 6, 2)]
    return Part(dyadic(10.0 ** rng.uniform(-1, 2)) * product * sympy.sin(k[0] * X + k[1] * Y))


def exact(number):
    return sympy.Rational(float(number))


class Zone(NamedTuple):
    """Contact between t = start and t = end on a side, and the term of u' that has its flux there."""

    start: sympy.Rational
    end: sympy.Rational
    summand: Part


def zone(rng, vertices, side, start, end):
    """-d l(t) chi(d), d the distance from the side, where no other side is near; None if there is no room."""
    frame = _frame(vertices, side)
    depth = 0.5
    while depth > 1e-3 and not _clear(vertices, side, float(start), float(end), -depth, depth):
        depth /= 2
    if depth <= 1e-3:
        return None
    depth = dyadic(depth)
    q = POWERS[rng.integers(4)]
    t, d = frame
    length = float(np.hypot(*(np.roll(vertices, -1, axis=0) - vertices)[side]))
    profile = pos(t - start, q) * pos(end - t, q) * dyadic(float(2 / (end - start)) ** float(2 * q))
    strength = dyadic(length * 10.0 ** rng.uniform(-1, 1))
    u = -strength * d * profile * pos(1 - d / depth, 4)
    if not _clear(vertices, side, float(start), float(end), -FAR, float(depth)):
        u *= pos(1 + d / depth, 4)
    outside = (pos(t - end, 1) + pos(start - t, 1)) ** 2 + (pos(d - depth, 1) + pos(-d - depth, 1)) ** 2
    width = length * min(float(end - start), float(depth)) / (4 if q < 3 else 3)
    return Zone(start, end, Part(u, (Feature(dyadic(length) * sympy.sqrt(outside), width),)))


def _frame(vertices, side):
    """t along a side, from 0 to 1, and the distance from its line, in side lengths, as formulas."""
    (x, y) = [exact(c) for c in vertices[side]]
    (ex, ey) = [exact(c) for c in vertices[(side + 1) % len(vertices)]]
    ex = ex - x
    ey = ey - y
    square = ex**2 + ey**2
    return (ex * (X - x) + ey * (Y - y)) / square, (ex * (Y - y) - ey * (X - x)) / square


def _clear(vertices, side, start, end, lowest, highest):
    """Whether no other side meets start < t < end, lowest < d < highest."""
    edge = vertices[(side + 1) % len(vertices)] - vertices[side]
    shifted = (vertices - vertices[side]) / (edge @ edge)
    local = np.column_stack([shifted @ edge, shifted @ np.array([-edge[1], edge[0]])])
    other_vertices = np.delete(np.arange(len(vertices)), side)
    a = local[other_vertices]
    b = local[(other_vertices + 1) % len(vertices)]
    first = np.zeros(len(a))
    last = np.ones(len(a))
    for i, low, high in ((0, start, end), (1, lowest, highest)):
        with np.errstate(all="ignore"):
            ends = (np.array([low, high])[:, None] - a[:, i]) / (b - a)[:, i]
        level = a[:, i] == b[:, i]
        within = (low < a[:, i]) & (a[:, i] < high)
        first = np.where(level, np.where(within, first, 1), np.maximum(first, ends.min(axis=0)))
        last = np.where(level, np.where(within, last, 0), np.minimum(last, ends.max(axis=0)))
    return not np.any(last > first + 1e-12)


# Families


def everywhere(rng):
    """Contact on all sides of a star-shaped polygon: a bowl, whose flux outweighs that of other terms."""
    vertices = star(rng)
    n = int(rng.integers(0, 4))
    slope = 0.9 * float(distances(vertices).min()) / max(n, 1)
    components = [bowl(), *(gentle(rng, slope) for _ in range(n))]
    components += [bump(rng, Polygon(vertices)) for _ in range(rng.choice([0, 0, 1, 2]))]
    return vertices, components, [sympy.S.Zero] * len(vertices), ()


def draw_contact_zones(rng):
    """Contact on parts of sides of any polygon, up to vertices or not; elsewhere a gap or a free side."""
    vertices = star(rng) if rng.random() < 0.5 else columns(rng)
    n = len(vertices)
    polygon = Polygon(vertices)
    loaded = rng.choice(n, rng.choice([0, 1, 1, 1, 2]), replace=False)
    zones = [_zones(rng, vertices, side, polygon.angles) if side in loaded else [] for side in range(n)]
    heights = [dyadic(10.0 ** rng.uniform(-2, 0.5)) for _ in range(n)]
    for side in range(n):
        for zone in zones[side]:
            if zone.start == 0:
                heights[side] = sympy.S.Zero
            if zone.end == 1:
                heights[(side + 1) % n] = sympy.S.Zero
    gap = [_gap(rng, _frame(vertices, i)[0], zones[i], heights[i], heights[(i + 1) % n]) for i in range(n)]
    free = [i for i in range(n) if not zones[i] and rng.random() < 0.3]
    components = [Part(dyadic(rng.uniform(-2, 2))), flat(rng, vertices)]
    components += [bump(rng, polygon) for _ in range(rng.choice([0, 1, 1, 2]))]
    level = components[0].u
    components += [entry.summand for side in zones for entry in side]
    # u' = level on the boundary: so g' has no other terms, which vanish there
    trace = sum(component.u for component in components) - level
    return vertices, components, [entry + trace for entry in gap], tuple(free if len(free) < n else free[1:])


def _zones(rng, vertices, side, angles):
    """One zone or two on a side; at a vertex only where its angle leaves room."""
    n = int(rng.choice([1, 1, 2]))
    ends = np.sort(rng.uniform(0.02, 0.98, 2 * n))
    ends = [dyadic(t) for t in ends]
    if rng.random() < 0.4 and angles[side] > np.pi / 2 - 1e-9:
        ends[0] = sympy.S.Zero
    if rng.random() < 0.4 and angles[(side + 1) % len(vertices)] > np.pi / 2 - 1e-9:
        ends[-1] = sympy.S.One
    pairs = [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b - a > 0.02]
    zones = [zone(rng, vertices, side, a, b) for a, b in pairs]
    return [item for item in zones if item]


def _gap(rng, t, zones, first, last):
    """0 in the zones and at least that elsewhere, with those values at the ends of the side."""
    p = [1, sympy.Rational(3, 2), 2, 3][rng.integers(4)]
    if not zones:
        k = int(rng.integers(1, 40))
        s = k * (t - dyadic(rng.uniform(0, 1)))
        waves = [sympy.sin(sympy.pi * s) ** 2, sympy.exp(-(s**2))]
        steps = [1 / (1 + s**2), sympy.tanh(s) ** 2]
        extra = [sympy.S.Zero, *waves, *steps, sympy.cosh(s / k) - 1, pos(s, sympy.Rational(3, 2))][
            rng.integers(7)
        ]
        return first * (1 - t) + last * t + t * (1 - t) * dyadic(10.0 ** rng.uniform(-1, 1)) * extra
    total = sum(
        dyadic(10.0 ** rng.uniform(0, 2)) * pos(t - a.end, p) * pos(b.start - t, p)
        for a, b in pairwise(zones)
    )
    start = zones[0].start
    end = zones[-1].end
    if start > 0:
        total += first * pos(1 - t / start, p)
    if end < 1:
        total += last * pos(1 - (1 - t) / (1 - end), p)
    return total


def draw_contact_beside_base(rng):
    """Contact on all sides but the base, on which u and du/dn are 0: u' = y^2 exp(k |x - c|^2 / 2) + ..

    Its flux is not negative on the other sides, whose angles with the base are at most 90 degrees.
    """
    vertices = draw_over_base(rng)
    k = dyadic(rng.uniform(0.2, 4))
    c = (dyadic(rng.uniform(0.3, 0.7)), dyadic(0.5 * vertices[:, 1].max()))
    x = float(c[0])
    y = float(c[1])
    if distances(vertices - np.array([x, y]))[1:].min() < 0:
        return draw_contact_beside_base(rng)
    components = [
        Part(Y**2 * sympy.exp(k * bowl(c).u)),
        *(bump(rng, Polygon(vertices)) for _ in range(rng.integers(3))),
    ]
    gap = [sympy.S.Zero] * len(vertices)
    gap[0] = X * (1 - X) * dyadic(10.0 ** rng.uniform(-2, 1))
    return vertices, components, gap, (0,) if rng.random() < 0.3 else ()


FAMILIES = (everywhere, draw_contact_zones, draw_contact_beside_base, draw_contact_zones)
