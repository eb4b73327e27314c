"""What is derived of a case against sympy, from its declaration alone, with 30 digits.

Derivatives are sympy's, in polar coordinates all of them: that the polar factors are harmonic is not used.
"""

from functools import cache

import mpmath
import numpy as np
import pytest
import sympy
from symbolic import THETA, D, R, T, X, Y, compile_mpmath, pos

from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.problems import case as cases
from unilateral.problems.cantor_atom import UNREMOVED_GAP_FACTOR
from unilateral.problems.catalogue import case_names

DIGITS = 30
ROUNDING = 2e-12
"""Relative to the largest value of a kind. Places are rounded by some 1e-16 of a side, a few times, and
functions change on the scale of the distance from a singular point, which is 0.003 or more."""
POLYGONS = ("square", "lshape", "hexagon")
PLACES = [
    (name, polygon)
    for name in case_names()
    for polygon in POLYGONS
    if cases.read_case_declaration(name)[0]["polygons"] == "any"
    or polygon in cases.read_case_declaration(name)[0]["polygons"]
]


@cache
def compile_with_digits(expression, *symbols):
    """A function of numbers with DIGITS, made once for all polygons."""
    return compile_mpmath(expression, *symbols)


@cache
def derive(v, polar):
    """v of an atom, its slopes along both coordinates, polar or Cartesian, and its Laplacian."""
    symbols = (R, THETA) if polar else (T, D)
    first, second = symbols
    r = R if polar else sympy.Integer(1)
    along = sympy.diff(v, first)
    across = sympy.diff(v, second) / r
    laplacian = sympy.diff(v, first, 2) + sympy.diff(v, second, 2) / r**2
    if polar:
        laplacian += along / r
    components = [compile_with_digits(e, *symbols) for e in (v, along, across, laplacian)]
    return lambda first, second: [component(first, second) for component in components]


def cut_off(v, entry):
    """With the factor (1 - (r/R)^2)_+^4."""
    return (
        v * pos(1 - (R / sympy.sympify(str(entry["cutoff"]), rational=True)) ** 2, 4)
        if "cutoff" in entry
        else v
    )


def exact(value):
    return sympy.sympify(str(value), rational=True)


def polar_factor(entry, omega):
    """By the README: r^beta times a cosine or a sine."""
    alpha = exact(entry.get("alpha", 0))
    times = exact(entry.get("times", 1))
    beta = 1 + alpha
    kind = entry.get("kind", "harmonic")
    if kind == "harmonic":
        v = R**beta * sympy.cos(beta * (sympy.pi - THETA)) / (beta * sympy.sin(alpha * sympy.pi))
    elif kind == "free":
        v = R ** (sympy.pi / omega) * sympy.cos(sympy.pi * THETA / omega)
    elif kind == "held":
        v = -(R ** (sympy.pi / omega)) * sympy.sin(sympy.pi * THETA / omega)
    elif kind == "transition":
        v = -(R**beta) * sympy.cos(beta * (omega - THETA)) / (beta * sympy.sin(omega * beta))
    elif "alpha" in entry:  # clamped, u = 0 at theta = omega and -dv/dtheta = r^beta at 0
        v = R**beta * sympy.sin(beta * (omega - THETA)) / (beta * sympy.cos(omega * beta))
    else:
        v = R ** (sympy.pi / (2 * omega)) * sympy.cos(sympy.pi * THETA / (2 * omega))
    return times * v


def quotient(fraction):
    return mpmath.mpf(fraction.p) / fraction.q


def turn_derivatives(derived):
    """The parts of an atom in polar coordinates, in Cartesian ones with the same origin."""

    def parts(along, into):
        r = mpmath.hypot(along, into)
        theta = mpmath.atan2(into, along) % (2 * mpmath.pi)
        v, outward, around, laplacian = derived(r, theta)
        c = mpmath.cos(theta)
        s = mpmath.sin(theta)
        return [v, outward * c - around * s, outward * s + around * c, laplacian]

    return parts


def sum_of_intervals(intervals):
    """The sum of atoms (a, b, their parts), each of which is 0 beyond the distance b - a from a."""
    places = [(quotient(a), quotient(b - a), turn_derivatives(derived)) for a, b, derived in intervals]

    def parts(along, into):
        near = [atom(along - a, into) for a, reach, atom in places if mpmath.hypot(along - a, into) < reach]
        return [mpmath.fsum(item) for item in zip(*near, strict=True)] or [mpmath.mpf(0)] * 4

    return parts


class Oracle:
    """u, grad u, f, lambda and the gap of a case, from its declaration."""

    def __init__(self, name, polygon, side=0):
        self.declaration, _ = cases.read_case_declaration(name)
        self.polygon = polygon
        self.side = side
        self.atoms = []
        self.vertices = [[mpmath.mpf(z) for z in vertex] for vertex in polygon.vertices.tolist()]
        self.constants = {
            key: exact(value[polygon.name] if isinstance(value, dict) else value)
            for key, value in self.declaration.get("constants", {}).items()
        }
        for entry in self.declaration["u"]:
            self.add(entry)

    def formula(self, text, **variables):
        return sympy.sympify(str(text), {"pos": pos, **variables, **self.constants}, rational=True)

    def add(self, entry):
        n = self.polygon.n_sides
        if entry["atom"] == "smooth":
            u = self.formula(entry["formula"], x=X, y=Y)
            slopes = [sympy.diff(u, z) for z in (X, Y)]
            components = [u, *slopes, sympy.diff(slopes[0], X) + sympy.diff(slopes[1], Y)]
            components = [compile_with_digits(component, X, Y) for component in components]
            self.atoms.append(lambda x, y: [component(x, y) for component in components])
            return
        side = entry["vertex"] if "vertex" in entry else (self.side + entry["side"]) % n
        if entry["atom"] == "tensor":
            cutoff = exact(entry["cutoff"])
            v = -D * self.formula(entry["profile"], t=T) * pos(1 - (D / cutoff) ** 2, 4)
            self.atoms.append(self.place_on_side(side, 0, derive(v, polar=False), polar=False))
        elif entry["atom"] == "cantor":
            unit = {"alpha": entry["alpha"], "cutoff": 1}
            derived = derive(cut_off(polar_factor(unit, None), unit), polar=True)
            alpha = exact(entry["alpha"])
            intervals = [(a, b, self.scale_atom(derived, b - a, alpha)) for a, b in contact_intervals(entry)]
            self.atoms.append(self.place_on_side(side, 0, sum_of_intervals(intervals), polar=False))
        else:
            angle = (
                sympy.nsimplify(self.polygon.angles[side] / np.pi, rational=True, tolerance=1e-9) * sympy.pi
            )
            derived = derive(cut_off(polar_factor(entry, angle), entry), polar=True)
            self.atoms.append(self.place_on_side(side, exact(entry.get("at", 0)), derived))

    @staticmethod
    def scale_atom(derived, length, alpha):
        """The unit atom on a contact of another length: v(r) = l^(1 + alpha) v_1(r / l)."""
        size = quotient(length)

        def parts(r, theta):
            v, along, across, laplacian = derived(r / size, theta)
            factor = size ** (1 + quotient(alpha))
            return factor * v, factor * along / size, factor * across / size, factor * laplacian / size**2

        return parts

    def place_on_side(self, side, t, derived, polar=True):
        """u, its two derivatives and its Laplacian by x and y, of L v(x / L)."""
        a = self.vertices[side % self.polygon.n_sides]
        b = self.vertices[(side + 1) % self.polygon.n_sides]
        length = mpmath.hypot(b[0] - a[0], b[1] - a[1])
        p = (b[0] - a[0]) / length
        q = (b[1] - a[1]) / length
        t = quotient(t) if t else mpmath.mpf(0)

        def parts(x, y):
            dx = (x - a[0]) / length - t * p
            dy = (y - a[1]) / length - t * q
            along = p * dx + q * dy
            into = p * dy - q * dx
            into = abs(into) if abs(into) < 1e-12 else into
            v, first, second, laplacian = (turn_derivatives(derived) if polar else derived)(along, into)
            return length * v, first * p - second * q, first * q + second * p, laplacian / length

        return parts

    def evaluate(self, x, y):
        """u, u_x, u_y and f = c u - Delta u."""
        sums = [
            mpmath.fsum(components) for components in zip(*(atom(x, y) for atom in self.atoms), strict=True)
        ]
        u, u_x, u_y, laplacian = sums
        return u, u_x, u_y, self.declaration.get("c", 1) * u - laplacian

    def values(self, points):
        """u, u_x, u_y and f at points (k, 2)."""
        with mpmath.workdps(DIGITS):
            return np.array(
                [self.evaluate(*map(mpmath.mpf, point)) for point in points.tolist()], dtype=float
            ).T

    def gap(self, side, t):
        """The gap at places t (k,) of a side."""
        n = self.polygon.n_sides
        declared = self.declaration["gap"]
        position = [e for e in declared.get("sides", []) if (self.side + e["side"]) % n == side]
        if side in self.clamped_sides:
            gap = sympy.Integer(0)
        elif position and "cantor" in position[0]:
            gap = cantor_gap(position[0]["cantor"])
        else:
            gap = self.formula(position[0]["formula"] if position else declared["elsewhere"], t=T)
        value = compile_with_digits(gap, T)
        with mpmath.workdps(DIGITS):
            return np.array([value(mpmath.mpf(item)) for item in t.tolist()], dtype=float)

    @property
    def clamped_sides(self):
        entries = self.declaration.get("clamped", [])
        return {(self.side + entry["side"]) % self.polygon.n_sides for entry in entries}


def list_removed_intervals(entry):
    """The intervals that each generation removes, and those that are left."""
    keep = exact(entry["keep"])
    inset = exact(entry["inset"])
    remaining_pieces = [(inset, 1 - inset)]
    generations = []
    for _ in range(entry["generations"]):
        generations.append([(a + keep * (b - a), b - keep * (b - a)) for a, b in remaining_pieces])
        remaining_pieces = [
            piece for a, b in remaining_pieces for piece in ((a, a + keep * (b - a)), (b - keep * (b - a), b))
        ]
    return generations, remaining_pieces


def contact_intervals(entry):
    return [interval for generation in list_removed_intervals(entry)[0][::2] for interval in generation]


def cantor_gap(entry):
    """By the README: tents on what even generations remove, DUST times such tents on what is left."""
    generations, remaining = list_removed_intervals(entry)
    inset = exact(entry["inset"])
    gamma = exact(entry["gamma"])
    tents = [(1, pair) for generation in generations[1::2] for pair in generation]
    tents += [(sympy.Rational(UNREMOVED_GAP_FACTOR), pair) for pair in remaining]
    return (
        pos(inset - T, gamma)
        + pos(T - 1 + inset, gamma)
        + sympy.Add(*(times * pos((T - c) * (d - T), gamma) / (d - c) ** gamma for times, (c, d) in tents))
    )


def inside(polygon, numbers, rng):
    """Random points of a polygon, none within 0.003 of its boundary."""
    low = polygon.vertices.min(axis=0)
    high = polygon.vertices.max(axis=0)
    points = low + (high - low) * rng.random((40 * numbers, 2))
    a = polygon.vertices
    b = np.roll(polygon.vertices, -1, axis=0)
    dx = points[:, None, 0]
    dy = points[:, None, 1]
    crossed = (a[:, 1] > dy) != (b[:, 1] > dy)
    with np.errstate(all="ignore"):
        remaining = dx < a[:, 0] + (dy - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    within = np.sum(crossed & remaining, axis=1) % 2 == 1
    shift = np.clip(np.sum((points[:, None] - a) * (b - a), axis=2) / np.sum((b - a) ** 2, axis=1), 0, 1)
    apart = np.linalg.norm(points[:, None] - a - shift[..., None] * (b - a), axis=2).min(axis=1)
    return points[within & (apart > 0.003)][:numbers]


def deviations(name, polygon, times=1.0, numbers=8):
    """The largest difference of each kind, relative to the largest value of u, grad u or f."""
    case = cases.load_solution(name, polygon)
    rng = np.random.default_rng(47)
    oracle = Oracle(name, polygon)
    # points inside, as many of them near side 0, where the atoms are
    near = polygon.at(np.zeros(numbers, dtype=int), polygon.lengths[0] * rng.uniform(0.05, 0.95, numbers))
    points = np.vstack([inside(polygon, numbers, rng), near - 0.01 * polygon.normals[0]])
    u, gradient, f = case.value_gradient_and_source(points)
    expected = oracle.values(points)
    sizes = {
        "u": np.abs(expected[0]).max(),
        "grad u": np.abs(expected[1:3]).max(),
        "f": np.abs(expected[3]).max(),
    }
    computed = {
        "u": np.abs(times * u - expected[0]).max() / sizes["u"],
        "grad u": np.abs(times * gradient.T - expected[1:3]).max() / sizes["grad u"],
        "f": np.abs(times * f - expected[3]).max() / sizes["f"],
    }
    for side in range(polygon.n_sides):
        t = rng.uniform(0.02, 0.98, numbers)
        sides = np.full(numbers, side)
        s = t * polygon.lengths[side]
        trace, flux, gap = case.trace_flux_and_gap(sides, s)
        exact_trace, *exact_gradient, _ = oracle.values(polygon.at(sides, s))
        exact_gap = oracle.gap(side, t)
        normal = polygon.normals[side]
        exact_flux = (
            0 * t
            if side in oracle.clamped_sides
            else exact_gradient[0] * normal[0] + exact_gradient[1] * normal[1]
        )
        u_scale = max(sizes["u"], np.abs(exact_gap).max())
        computed[f"lambda on side {side}"] = np.abs(flux - exact_flux).max() / sizes["grad u"]
        computed[f"gap on side {side}"] = np.abs(gap - exact_gap).max() / u_scale
        computed[f"g on side {side}"] = np.abs(trace - gap - (exact_trace - exact_gap)).max() / u_scale
    return computed


@pytest.mark.parametrize(("name", "polygon"), PLACES)
def test_what_is_derived_is_what_sympy_derives(name, polygon):
    largest_deviations = deviations(name, find_polygon(polygon))
    assert max(largest_deviations.values()) < ROUNDING, largest_deviations


@pytest.mark.parametrize("name", ["thirds", "smooth", "clamped_90"])
def test_the_size_of_the_side_is_known_to_the_derivation(name):
    large = Polygon(10 * square().vertices, "square")
    assert max(deviations(name, large).values()) < ROUNDING


@pytest.mark.parametrize("name", ["thirds", "smooth", "full_contact", "violates_jjj"])
def test_a_deviation_of_1e_10_is_noticed(name):
    """Control."""
    largest_deviations = deviations(name, square(), times=1 + 1e-10)
    assert min(largest_deviations["u"], largest_deviations["grad u"], largest_deviations["f"]) > 10 * ROUNDING
